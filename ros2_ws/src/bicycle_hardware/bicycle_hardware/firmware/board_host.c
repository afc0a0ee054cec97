/* Board layer of the simulation: the serial line is a pseudo-terminal, the sensors are lines of text.
 *
 * Writes the pseudo-terminal's path as its first line; the program's argument, if there is one, becomes a link to
 * it. Then, for each line "now_us imu_us steer_us wheel_us gx gy gz fx fy fz steer wheel battery stopped" of
 * standard input, takes what has come over the serial line, makes one tick and answers "torque drive mode reasons".
 * The line "wait stamp_us asked milliseconds" lets it listen, without a tick, until a command came that answers that
 * stamp, or more than that many questions for the time. It answers "stamp_us asked age_us": what the last command
 * answers, the number of questions, and the real time since the last period ended. The line "restart" is a switch
 * of its power. Ends with standard input.
 */
#define _XOPEN_SOURCE 600
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "bicycle_core.h"

static int serial;
static struct timespec beat; /* when the last period ended */

/* us since the last period ended, by a real clock. */
static long since_beat(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (now.tv_sec - beat.tv_sec) * 1000000L + (now.tv_nsec - beat.tv_nsec) / 1000;
}

static void write_serial(void *context, const uint8_t *bytes, size_t count) {
    (void)context;
    /* A full line loses bytes, as a real one does: the core never waits. */
    ssize_t sent = write(serial, bytes, count);
    (void)sent;
}

static uint32_t answered(const struct core *core) {
    return core->has_command ? core->command_stamp_us : 0;
}

static void read_serial(struct core *core, uint32_t now) {
    uint8_t bytes[512];
    ssize_t count;
    while ((count = read(serial, bytes, sizeof bytes)) > 0) core_receive(core, bytes, (size_t)count, now);
}

/* Listen until the command that answers `stamp` came or more than `asked` questions did, or for `milliseconds`. */
static void wait_for(struct core *core, uint32_t stamp, uint32_t asked, int milliseconds, uint32_t now) {
    struct timespec began, then;
    clock_gettime(CLOCK_MONOTONIC, &began);
    for (;;) {
        read_serial(core, now);
        clock_gettime(CLOCK_MONOTONIC, &then);
        long past = (then.tv_sec - began.tv_sec) * 1000 + (then.tv_nsec - began.tv_nsec) / 1000000;
        if (answered(core) == stamp || core->asked > asked || past >= milliseconds) return;
        struct pollfd line = {.fd = serial, .events = POLLIN};
        poll(&line, 1, milliseconds - (int)past);
    }
}

static int link_to(const char *path, const char *link) {
    unlink(link);
    return symlink(path, link);
}

int main(int count, char **words) {
    serial = posix_openpt(O_RDWR | O_NOCTTY);
    if (serial < 0 || grantpt(serial) || unlockpt(serial)) {
        perror("pseudo-terminal");
        return 1;
    }
    const char *path = ptsname(serial);
    /* Held open here, so that a reader may come and go. */
    int line = open(path, O_RDWR | O_NOCTTY);
    struct termios raw;
    if (line < 0 || tcgetattr(line, &raw)) {
        perror(path);
        return 1;
    }
    raw.c_iflag = raw.c_oflag = raw.c_lflag = 0;
    raw.c_cflag = CS8 | CREAD | CLOCAL;
    tcsetattr(line, TCSANOW, &raw);
    fcntl(serial, F_SETFL, O_NONBLOCK);
    if (count > 1 && link_to(path, words[1])) {
        perror(words[1]);
        return 1;
    }
    printf("%s\n", path);
    fflush(stdout);

    struct core core;
    core_init(&core, &CORE_DEFAULTS, write_serial, NULL);
    static char text[1024];
    unsigned now = 0;
    while (fgets(text, sizeof text, stdin)) {
        struct core_inputs in;
        unsigned stamp, asked, imu, steer, wheel;
        int stopped, milliseconds;
        if (sscanf(text, "wait %u %u %d", &stamp, &asked, &milliseconds) == 3) {
            wait_for(&core, stamp, asked, milliseconds, now);
            printf("%u %u %ld\n", answered(&core), core.asked, since_beat());
            fflush(stdout);
            continue;
        }
        if (strcmp(text, "restart\n") == 0) {
            read_serial(&core, now);
            core_init(&core, &CORE_DEFAULTS, write_serial, NULL);
            printf("restarted\n");
            fflush(stdout);
            continue;
        }
        int found = sscanf(text, "%u %u %u %u %f %f %f %f %f %f %f %f %f %d", &now, &imu, &steer, &wheel,
                           &in.gyro[0], &in.gyro[1], &in.gyro[2], &in.force[0], &in.force[1], &in.force[2],
                           &in.steer, &in.wheel, &in.battery, &stopped);
        if (found != 14) {
            fprintf(stderr, "no sensors: %s", text);
            return 1;
        }
        in.imu_us = imu;
        in.steer_us = steer;
        in.wheel_us = wheel;
        in.stopped = stopped != 0;
        read_serial(&core, now);
        uint32_t periods = core.period_number;
        core_tick(&core, &in, now);
        if (core.period_number != periods) clock_gettime(CLOCK_MONOTONIC, &beat);
        printf("%.9g %.9g %d %d\n", (double)core.applied_torque, (double)core.applied_drive, (int)core.mode,
               (int)core.reasons);
        fflush(stdout);
    }
    return 0;
}
