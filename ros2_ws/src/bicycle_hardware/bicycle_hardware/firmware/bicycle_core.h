/* The bicycle's microcontroller, without its board: frames, arming, watchdog and fallback law.
 *
 * Plain C99, no heap, no operating system. A board layer reads sensors, calls these functions and
 * moves the motors; board_host.c is one for the simulation, README.md says what a real one has to
 * do. This code has run on a PC only, never on a board.
 *
 * Signs are REP-103: gyro_x is positive when rolling to the right, steering is positive to the left.
 */
#ifndef BICYCLE_CORE_H
#define BICYCLE_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CORE_LARGEST 64 /* bytes of a frame before framing */

enum core_mode { CORE_DISARMED = 0, CORE_ARMED = 1, CORE_RIDING = 2, CORE_FALLBACK = 3, CORE_ESTOP = 4 };

/* Why arming is refused, as bits. */
enum core_reason {
    CORE_MOVES = 1u << 0,         /* the gyro is not at rest */
    CORE_UNCALIBRATED = 1u << 1,  /* no second of rest since the start */
    CORE_NO_IMU = 1u << 2,        /* its readings are old, or always the same */
    CORE_NO_STEER = 1u << 3,
    CORE_NO_WHEEL = 1u << 4,
    CORE_NO_COMMANDS = 1u << 5,   /* the sequence has not advanced for a second */
    CORE_TOO_FAST = 1u << 6,      /* the wheel's speed is not one to arm at */
    CORE_STOPPED = 1u << 7        /* the emergency stop is pressed */
};

enum core_kind {
    CORE_ACTUATORS = 1, /* PC to board: u32 stamp_us, f32 torque, f32 drive, u16 valid_ms */
    CORE_ARM = 2,       /* PC to board: u8 */
    CORE_TIME = 3,      /* PC to board: u64 of the PC's clock; answered by CORE_TIME_IS */
    CORE_STOP = 4,      /* PC to board: nothing; as the stop button, but for the wire */
    CORE_IMU = 16,      /* board to PC: u32 stamp_us, f32 gyro x y z, f32 force x y z */
    CORE_STEER = 17,    /* board to PC: u32 stamp_us, f32 angle, f32 torque */
    CORE_STATE = 18,    /* board to PC, 20 Hz: u32 stamp_us, u8 mode, u8 reasons, f32 torque, f32 drive,
                           f32 battery, u16 last sequence, u16 command's age in ms, u32 bad frames */
    CORE_TIME_IS = 19,  /* board to PC: u64 as it came, u32 stamp_us */
    CORE_WHEEL = 20,    /* board to PC: u32 stamp_us, f32 speed */
    CORE_PERIOD = 21    /* board to PC, last of each control period: u32 stamp_us, u32 number, u8 mode,
                           f32 torque, f32 drive, u16 last sequence; the PC answers it */
};

struct core_settings {
    float torque_limit;   /* N m */
    float drive_limit;    /* N */
    float gain;           /* N m per rad/s of roll rate and m/s: kappa */
    float damping;        /* N m per rad/s of steer rate: what a motor that lags needs */
    float stable_speed;   /* m/s from which on the fallback law gives no torque */
    float arm_speed;      /* m/s up to which arming is allowed */
    uint16_t longest_ms;  /* no command is valid for longer; at most 200 */
    uint32_t stale_us;    /* age of a reading from which on it is old */
    uint32_t period_us;   /* of the PC's control loop, whose beat the board gives */
};

struct core_inputs {
    uint32_t imu_us, steer_us, wheel_us; /* stamps of the readings */
    float gyro[3], force[3];             /* rad/s, m/s^2 */
    float steer;                         /* rad */
    float wheel;                         /* m/s */
    float battery;                       /* V */
    bool stopped;                        /* the emergency stop, which also cuts the motors by wire */
};

struct core_age {
    uint32_t stamp; /* of the last reading */
    bool old;
};

struct core {
    struct core_settings settings;
    enum core_mode mode;
    uint8_t reasons;        /* of the last look */
    float bias[3];          /* rad/s, of the gyros */
    float sum[3];           /* of the rest that is going on */
    uint32_t rest_count;    /* readings in it */
    bool resting;           /* at the last reading */
    bool calibrated;
    float steer, steer_rate; /* rad, rad/s from its differences */
    uint32_t steer_us;
    uint16_t sequence;      /* last one accepted */
    uint32_t advanced_us;   /* when it last advanced, and since when it has kept doing so */
    uint32_t advancing_since_us;
    bool advancing;
    float torque, drive;    /* commanded */
    uint32_t command_stamp_us; /* of the state that it answers */
    uint32_t valid_us;
    bool has_command;
    bool fresh_command;      /* not older than it may be, since it came */
    struct core_age imu_age, steer_age, wheel_age;
    float gyro[3], force[3]; /* last reading of the IMU, and how often it came in a row */
    uint32_t imu_repeats;
    uint32_t bad_frames;
    uint16_t own_sequence;
    bool begun;              /* true after the first tick */
    uint32_t moved_us;       /* last time at which it did not rest */
    uint32_t state_us;       /* when the next state is due; the same of the period */
    uint32_t period_us;
    uint32_t period_number;
    uint32_t sent_imu_us, sent_steer_us, sent_wheel_us;
    float battery;
    uint32_t asked;          /* questions for the time */
    uint32_t commands;       /* taken */
    uint8_t received[CORE_LARGEST + 2]; /* stuffed bytes since the last zero */
    size_t received_count;
    bool received_too_much;
    float applied_torque, applied_drive;
    void (*write)(void *context, const uint8_t *bytes, size_t count);
    void *context;
};

extern const struct core_settings CORE_DEFAULTS;

void core_init(struct core *core, const struct core_settings *settings,
               void (*write)(void *, const uint8_t *, size_t), void *context);

/* Take bytes of the serial line, in any portions. */
void core_receive(struct core *core, const uint8_t *bytes, size_t count, uint32_t now_us);

/* Every 5 or 10 ms: decide, and send new readings, the state when it is due, and last the period's beat. */
void core_tick(struct core *core, const struct core_inputs *inputs, uint32_t now_us);

/* Between ticks and at an interrupt of the stop button: the drive is off at once. */
void core_stop(struct core *core);

uint16_t core_crc(const uint8_t *bytes, size_t count);

#endif
