/* Board layer of the simulation: the serial line is a pseudo-terminal, the sensors are lines of text.
 *
 * Writes the pseudo-terminal's path as its first line; the program's argument, if there is one, becomes a link to
 * it. Then, for each line "now_us imu_us steer_us wheel_us gx gy gz fx fy fz steer wheel battery stopped" of
 * standard input, takes what has come over the serial line, makes one tick and answers "torque drive mode reasons".
 * The line "wait stamp_us asked milliseconds" lets it listen, without a tick, until a command came that answers that
 * stamp, or more than that many questions for the time. It answers "stamp_us asked" and ages: what the last command
 * answers, the number of questions, and the age in us of each command taken since the last such answer. The line
 * "restart" is a switch of its power. Ends with standard input.
 *
 * The core's clock is `now_us` of the lines: it stands between two ticks, so it cannot tell how old a command is that
 * comes between them. The ages are by a real clock: from the period that the command answers to its last byte's
 * arrival here, for which this program listens while it waits for a line.
 */
#define _XOPEN_SOURCE 600
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "bicycle_core.h"

#define BEATS 64    /* periods whose ends are remembered */
#define AGES 64     /* ages of commands that are kept until they are told */
#define PORTIONS 32 /* of bytes that have come and were not taken yet */

struct beat {
    uint32_t stamp;
    struct timespec ended;
};

struct portion {
    struct timespec came;
    ssize_t count;
    uint8_t bytes[256];
};

static int serial;
static struct beat beats[BEATS];
static unsigned beat_count;
static long ages[AGES]; /* us */
static int age_count;
static struct portion portions[PORTIONS];
static int portion_count;

static struct timespec real_time(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now;
}

static long us_between(struct timespec from, struct timespec to) {
    return (to.tv_sec - from.tv_sec) * 1000000L + (to.tv_nsec - from.tv_nsec) / 1000;
}

/* Keep the age of a command that came, if the period that it answers is remembered. */
static void keep_age(uint32_t stamp, struct timespec came) {
    for (unsigned back = 1; back <= BEATS && back <= beat_count && age_count < AGES; back++) {
        const struct beat *beat = &beats[(beat_count - back) % BEATS];
        if (beat->stamp != stamp) continue;
        ages[age_count++] = us_between(beat->ended, came);
        return;
    }
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

/* Keep what has come over the serial line, with the time, as far as it fits. */
static void listen(void) {
    while (portion_count < PORTIONS) {
        struct portion *next = &portions[portion_count];
        next->count = read(serial, next->bytes, sizeof next->bytes);
        if (next->count <= 0) return;
        next->came = real_time();
        portion_count++;
    }
}

static void take_portion(struct core *core, const struct portion *portion, uint32_t now) {
    for (ssize_t i = 0; i < portion->count; i++) {
        uint32_t before = core->commands;
        core_receive(core, &portion->bytes[i], 1, now);
        if (core->commands != before) keep_age(core->command_stamp_us, portion->came);
    }
}

/* Give the core what has come over the serial line. */
static void take_serial(struct core *core, uint32_t now) {
    bool full;
    do {
        listen();
        full = portion_count == PORTIONS;
        for (int i = 0; i < portion_count; i++) take_portion(core, &portions[i], now);
        portion_count = 0;
    } while (full);
}

/* Listen until the command that answers `stamp` came or more than `asked` questions did, or for `milliseconds`. */
static void wait_for(struct core *core, uint32_t stamp, uint32_t asked, int milliseconds, uint32_t now) {
    struct timespec began = real_time();
    for (;;) {
        take_serial(core, now);
        long past = us_between(began, real_time()) / 1000;
        if (answered(core) == stamp || core->asked > asked || past >= milliseconds) return;
        struct pollfd line = {.fd = serial, .events = POLLIN};
        poll(&line, 1, milliseconds - (int)past);
    }
}

static void tell_heard(const struct core *core) {
    printf("%u %u", answered(core), core->asked);
    for (int i = 0; i < age_count; i++) printf(" %ld", ages[i]);
    printf("\n");
    fflush(stdout);
    age_count = 0;
}

static void tick(struct core *core, const struct core_inputs *in, uint32_t now) {
    uint32_t periods = core->period_number;
    struct beat beat = {.stamp = now, .ended = real_time()}; /* before its frames leave */
    core_tick(core, in, now);
    if (core->period_number != periods) beats[beat_count++ % BEATS] = beat;
}

/* Read a line of standard input, and listen to the serial line meanwhile; false at the end. */
static bool read_line(char *text, size_t room) {
    static char kept[1024];
    static size_t count;
    for (;;) {
        char *end = memchr(kept, '\n', count);
        if (end) {
            size_t size = (size_t)(end - kept) + 1;
            if (size >= room) return false;
            memcpy(text, kept, size);
            text[size] = 0;
            count -= size;
            memmove(kept, end + 1, count);
            return true;
        }
        struct pollfd both[] = {{.fd = STDIN_FILENO, .events = POLLIN}, {.fd = serial, .events = POLLIN}};
        /* What does not fit stays on the line. */
        if (poll(both, portion_count < PORTIONS ? 2 : 1, -1) < 0 && errno != EINTR) return false;
        if (both[1].revents) listen();
        if (!both[0].revents) continue;
        ssize_t more = read(STDIN_FILENO, kept + count, sizeof kept - count);
        if (more <= 0) return false;
        count += (size_t)more;
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
    while (read_line(text, sizeof text)) {
        struct core_inputs in;
        unsigned stamp, asked, imu, steer, wheel;
        int stopped, milliseconds;
        if (sscanf(text, "wait %u %u %d", &stamp, &asked, &milliseconds) == 3) {
            wait_for(&core, stamp, asked, milliseconds, now);
            tell_heard(&core);
            continue;
        }
        if (strcmp(text, "restart\n") == 0) {
            take_serial(&core, now);
            core_init(&core, &CORE_DEFAULTS, write_serial, NULL);
            beat_count = 0;
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
        take_serial(&core, now);
        tick(&core, &in, now);
        printf("%.9g %.9g %d %d\n", (double)core.applied_torque, (double)core.applied_drive, (int)core.mode,
               (int)core.reasons);
        fflush(stdout);
    }
    return 0;
}
