#include "bicycle_core.h"

#include <math.h>
#include <string.h>

const struct core_settings CORE_DEFAULTS = {
    .torque_limit = 7.0f,
    .drive_limit = 200.0f,
    .gain = 10.0f,
    .damping = 1.5f,
    .stable_speed = 6.0f,
    .arm_speed = 0.2f,
    .longest_ms = 200,
    .stale_us = 50000,
    .period_us = 25000,
};

#define REST_TURN 0.03f       /* rad/s beside the bias: more is no rest */
#define REST_BIAS 0.25f       /* rad/s: no gyro's bias is larger */
#define STUCK_SAMPLES 10      /* equal readings in a row: a gyro that lives has noise */
#define REST_SAMPLES 100      /* readings of rest that calibrate */
#define ADVANCING_US 1000000u /* time for which commands must have come before arming */
#define GAP_US 200000u        /* longest gap within that time */
#define STATE_US 50000u
#define FORGOTTEN_US 5000000u /* rest without commands after which it is disarmed */

/* Frames: kind, sequence (u16), payload, CRC-16/CCITT-FALSE of all before it; then COBS and a zero.
 * All numbers are little-endian. */

uint16_t core_crc(const uint8_t *bytes, size_t count) {
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < count; i++) {
        crc ^= (uint16_t)((uint16_t)bytes[i] << 8);
        for (int bit = 0; bit < 8; bit++)
            crc = (uint16_t)((crc << 1) ^ ((crc & 0x8000u) ? 0x1021 : 0));
    }
    return crc;
}

static size_t stuff(const uint8_t *bytes, size_t count, uint8_t *out) {
    size_t code_at = 0, n = 1;
    uint8_t code = 1;
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] != 0) {
            out[n++] = bytes[i];
            code++;
        } else {
            out[code_at] = code;
            code_at = n++;
            code = 1;
        }
    }
    out[code_at] = code;
    out[n++] = 0;
    return n;
}

/* Number of bytes, 0 if they are no stuffed frame. */
static size_t unstuff(const uint8_t *bytes, size_t count, uint8_t *out, size_t room) {
    size_t n = 0, i = 0;
    while (i < count) {
        uint8_t code = bytes[i++];
        if (code == 0 || i + code - 1u > count) return 0;
        for (uint8_t k = 1; k < code; k++) {
            if (n >= room) return 0;
            out[n++] = bytes[i++];
        }
        if (code < 0xFF && i < count) {
            if (n >= room) return 0;
            out[n++] = 0;
        }
    }
    return n;
}

static uint32_t get_u32(const uint8_t *b) {
    return (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static uint16_t get_u16(const uint8_t *b) { return (uint16_t)(b[0] | b[1] << 8); }

static float get_f32(const uint8_t *b) {
    uint32_t bits = get_u32(b);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static uint8_t *put_u16(uint8_t *at, uint16_t value) {
    at[0] = (uint8_t)value;
    at[1] = (uint8_t)(value >> 8);
    return at + 2;
}

static uint8_t *put_u32(uint8_t *at, uint32_t value) {
    at = put_u16(at, (uint16_t)value);
    return put_u16(at, (uint16_t)(value >> 16));
}

static uint8_t *put_f32(uint8_t *at, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return put_u32(at, bits);
}

static void send(struct core *core, uint8_t kind, const uint8_t *payload, size_t count) {
    uint8_t plain[CORE_LARGEST], stuffed[CORE_LARGEST + 4];
    uint8_t *at = plain;
    *at++ = kind;
    at = put_u16(at, core->own_sequence++);
    memcpy(at, payload, count);
    at += count;
    at = put_u16(at, core_crc(plain, (size_t)(at - plain)));
    core->write(core->context, stuffed, stuff(plain, (size_t)(at - plain), stuffed));
}

void core_init(struct core *core, const struct core_settings *settings,
               void (*write)(void *, const uint8_t *, size_t), void *context) {
    memset(core, 0, sizeof *core);
    core->settings = *settings;
    /* After this silence any sequence is taken: no older command may still be valid. */
    if (core->settings.longest_ms > GAP_US / 1000u) core->settings.longest_ms = GAP_US / 1000u;
    core->write = write;
    core->context = context;
}

static float limited(float value, float limit) {
    return value > limit ? limit : value < -limit ? -limit : value;
}

static void take_actuators(struct core *core, uint16_t sequence, const uint8_t *b, uint32_t now) {
    float torque = get_f32(b + 4), drive = get_f32(b + 8);
    uint16_t valid_ms = get_u16(b + 12);
    bool began = !core->advancing || now - core->advanced_us > GAP_US;
    /* A sequence that does not advance is a repeated or a late frame. After a silence it is a PC that began anew: a
     * frame from before it is too old to be obeyed. */
    int16_t ahead = (int16_t)(uint16_t)(sequence - core->sequence);
    if (!isfinite(torque) || !isfinite(drive) || (!began && ahead <= 0)) {
        core->bad_frames++;
        return;
    }
    if (began) core->advancing_since_us = now;
    core->advancing = true;
    core->sequence = sequence;
    core->advanced_us = now;
    if (valid_ms > core->settings.longest_ms) valid_ms = core->settings.longest_ms;
    core->torque = limited(torque, core->settings.torque_limit);
    core->drive = limited(drive, core->settings.drive_limit);
    core->command_stamp_us = get_u32(b);
    core->valid_us = (uint32_t)valid_ms * 1000u;
    core->has_command = core->fresh_command = true;
    core->commands++;
}

static void report_state(struct core *core, uint32_t now) {
    uint8_t bytes[CORE_LARGEST], *at = bytes;
    uint32_t age = core->has_command ? (now - core->command_stamp_us) / 1000u : 65535u;
    at = put_u32(at, now);
    *at++ = (uint8_t)core->mode;
    *at++ = core->reasons;
    at = put_f32(at, core->applied_torque);
    at = put_f32(at, core->applied_drive);
    at = put_f32(at, core->battery);
    at = put_u16(at, core->sequence);
    at = put_u16(at, (uint16_t)(age > 65535u ? 65535u : age));
    at = put_u32(at, core->bad_frames);
    send(core, CORE_STATE, bytes, (size_t)(at - bytes));
}

static void arm(struct core *core, bool wanted) {
    if (!wanted) {
        core->mode = CORE_DISARMED;
        core->applied_torque = core->applied_drive = 0.0f;
    } else if (core->mode == CORE_DISARMED && core->begun && core->reasons == 0)
        core->mode = CORE_ARMED;
}

static void take_frame(struct core *core, uint32_t now) {
    uint8_t plain[CORE_LARGEST];
    size_t count = unstuff(core->received, core->received_count, plain, sizeof plain);
    if (count < 5 || core_crc(plain, count - 2) != get_u16(plain + count - 2)) {
        core->bad_frames++;
        return;
    }
    const uint8_t *payload = plain + 3;
    size_t size = count - 5;
    uint16_t sequence = get_u16(plain + 1);
    if (plain[0] == CORE_ACTUATORS && size == 14)
        take_actuators(core, sequence, payload, now);
    else if (plain[0] == CORE_ARM && size == 1) {
        arm(core, payload[0] == 1);
        report_state(core, now); /* whoever asked waits for it */
    } else if (plain[0] == CORE_STOP && size == 0) {
        core_stop(core);
        report_state(core, now);
    } else if (plain[0] == CORE_TIME && size == 8) {
        uint8_t answer[12];
        core->asked++;
        memcpy(answer, payload, 8);
        put_u32(answer + 8, now);
        send(core, CORE_TIME_IS, answer, sizeof answer);
    } else
        core->bad_frames++;
}

void core_receive(struct core *core, const uint8_t *bytes, size_t count, uint32_t now_us) {
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] == 0) {
            if (core->received_too_much)
                core->bad_frames++;
            else if (core->received_count > 0)
                take_frame(core, now_us);
            core->received_count = 0;
            core->received_too_much = false;
        } else if (core->received_count < sizeof core->received)
            core->received[core->received_count++] = bytes[i];
        else
            core->received_too_much = true;
    }
}

void core_stop(struct core *core) {
    core->mode = core->mode == CORE_DISARMED ? CORE_DISARMED : CORE_ESTOP;
    core->applied_drive = 0.0f;
}

static bool rests(const struct core *core, const struct core_inputs *in) {
    for (int axis = 0; axis < 3; axis++) {
        float mean = core->rest_count ? core->sum[axis] / (float)core->rest_count : in->gyro[axis];
        if (!(fabsf(in->gyro[axis] - mean) < REST_TURN) || !(fabsf(in->gyro[axis]) < REST_BIAS))
            return false;
    }
    return fabsf(in->wheel) <= core->settings.arm_speed;
}

/* The gyros' biases are their mean over a second of rest; more rest makes it better. */
static bool calibrate(struct core *core, const struct core_inputs *in) {
    if (core->begun && in->imu_us == core->sent_imu_us) /* no new reading */
        return core->resting && fabsf(in->wheel) <= core->settings.arm_speed;
    if (!rests(core, in)) {
        core->rest_count = 0;
        memset(core->sum, 0, sizeof core->sum);
        return false;
    }
    if (core->rest_count < 100000u) {
        core->rest_count++;
        for (int axis = 0; axis < 3; axis++) core->sum[axis] += in->gyro[axis];
    }
    if (core->rest_count >= REST_SAMPLES) {
        for (int axis = 0; axis < 3; axis++)
            core->bias[axis] = core->sum[axis] / (float)core->rest_count;
        core->calibrated = true;
    }
    return true;
}

static void follow_steering(struct core *core, const struct core_inputs *in) {
    uint32_t gap = in->steer_us - core->steer_us;
    if (gap == 0 || !isfinite(in->steer)) return;
    float rate = gap < 100000u && core->steer_us != 0 ? (in->steer - core->steer) / (1e-6f * (float)gap) : 0.0f;
    core->steer_rate = 0.5f * (core->steer_rate + rate);
    core->steer = in->steer;
    core->steer_us = in->steer_us;
}

/* A reading is old until another comes, and not young again when the clock wraps. */
static bool is_old(struct core_age *age, uint32_t stamp, uint32_t longest, uint32_t now) {
    if (stamp != age->stamp) age->old = false;
    age->stamp = stamp;
    if (now - stamp > longest) age->old = true;
    return age->old;
}

/* True for an IMU that repeats itself to the last digit. */
static bool is_stuck(struct core *core, const struct core_inputs *in) {
    if (in->imu_us == core->imu_age.stamp) return core->imu_repeats >= STUCK_SAMPLES;
    bool same = memcmp(core->gyro, in->gyro, sizeof core->gyro) == 0 &&
                memcmp(core->force, in->force, sizeof core->force) == 0;
    core->imu_repeats = same ? core->imu_repeats + 1u : 0;
    memcpy(core->gyro, in->gyro, sizeof core->gyro);
    memcpy(core->force, in->force, sizeof core->force);
    return core->imu_repeats >= STUCK_SAMPLES;
}

static uint8_t look(struct core *core, const struct core_inputs *in, bool resting, uint32_t now) {
    uint8_t reasons = 0;
    uint32_t stale = core->settings.stale_us;
    if (!resting) reasons |= CORE_MOVES;
    if (!core->calibrated) reasons |= CORE_UNCALIBRATED;
    bool stuck = is_stuck(core, in);
    if (is_old(&core->imu_age, in->imu_us, stale, now) || stuck) reasons |= CORE_NO_IMU;
    if (is_old(&core->steer_age, in->steer_us, stale, now) || !isfinite(in->steer)) reasons |= CORE_NO_STEER;
    if (is_old(&core->wheel_age, in->wheel_us, 4u * stale, now) || !isfinite(in->wheel)) reasons |= CORE_NO_WHEEL;
    if (!core->advancing || now - core->advanced_us > GAP_US) {
        core->advancing = false;
        reasons |= CORE_NO_COMMANDS;
    } else if (now - core->advancing_since_us < ADVANCING_US)
        reasons |= CORE_NO_COMMANDS;
    if (!(fabsf(in->wheel) <= core->settings.arm_speed)) reasons |= CORE_TOO_FAST;
    if (in->stopped) reasons |= CORE_STOPPED;
    return reasons;
}

/* Steer into the lean: what keeps a bicycle upright that nobody commands. */
static float fallback(const struct core *core, const struct core_inputs *in) {
    float missing = core->settings.stable_speed - in->wheel;
    if ((core->reasons & CORE_NO_IMU) || !(missing > 0.0f)) return 0.0f;
    if (missing > core->settings.stable_speed) missing = core->settings.stable_speed;
    float torque = -core->settings.gain * missing * (in->gyro[0] - core->bias[0]);
    if (!(core->reasons & CORE_NO_STEER)) torque -= core->settings.damping * core->steer_rate;
    return isfinite(torque) ? limited(torque, core->settings.torque_limit) : 0.0f;
}

static void decide(struct core *core, const struct core_inputs *in, uint32_t now) {
    /* From the state that it answers: a PC that answers late, but steadily, would fell the bicycle. */
    if (now - core->command_stamp_us > core->valid_us) core->fresh_command = false;
    bool valid = core->fresh_command;
    /* Armed since the last tick, and the newest readings speak against it. */
    if (core->mode == CORE_ARMED && core->reasons != 0) core->mode = CORE_DISARMED;
    if (core->mode != CORE_DISARMED) {
        if (in->stopped)
            core->mode = CORE_ESTOP;
        else if (core->mode != CORE_ESTOP)
            core->mode = valid ? CORE_RIDING : CORE_FALLBACK;
    }
    /* Left alone at rest, as after a ride that ended without its PC: the motors are off. */
    if (!core->resting || core->mode != CORE_FALLBACK) core->moved_us = now;
    if (now - core->moved_us > FORGOTTEN_US) core->mode = CORE_DISARMED;
    core->applied_torque = core->applied_drive = 0.0f;
    if (core->mode == CORE_RIDING) {
        core->applied_torque = core->torque;
        core->applied_drive = core->drive;
    } else if (core->mode == CORE_FALLBACK || core->mode == CORE_ESTOP)
        core->applied_torque = fallback(core, in);
}

static void report_readings(struct core *core, const struct core_inputs *in) {
    uint8_t bytes[CORE_LARGEST], *at = put_u32(bytes, in->imu_us);
    for (int axis = 0; axis < 3; axis++) at = put_f32(at, in->gyro[axis]);
    for (int axis = 0; axis < 3; axis++) at = put_f32(at, in->force[axis]);
    if (in->imu_us != core->sent_imu_us) send(core, CORE_IMU, bytes, (size_t)(at - bytes));
    at = put_u32(bytes, in->steer_us);
    at = put_f32(at, in->steer);
    at = put_f32(at, core->applied_torque);
    if (in->steer_us != core->sent_steer_us)
        send(core, CORE_STEER, bytes, (size_t)(at - bytes));
    at = put_u32(bytes, in->wheel_us);
    at = put_f32(at, in->wheel);
    if (in->wheel_us != core->sent_wheel_us)
        send(core, CORE_WHEEL, bytes, (size_t)(at - bytes));
    core->sent_imu_us = in->imu_us;
    core->sent_steer_us = in->steer_us;
    core->sent_wheel_us = in->wheel_us;
}

/* When `due` has come, make it a period later and return true; after a long pause, a period from now. */
static bool is_due(uint32_t *due, uint32_t period, uint32_t now) {
    if ((int32_t)(now - *due) < 0) return false;
    *due += period;
    if ((int32_t)(now - *due) >= 0) *due = now + period;
    return true;
}

static void report(struct core *core, const struct core_inputs *in, uint32_t now) {
    report_readings(core, in);
    core->battery = in->battery;
    if (!core->begun) core->state_us = core->period_us = now;
    core->begun = true;
    if (is_due(&core->state_us, STATE_US, now)) report_state(core, now);
    if (is_due(&core->period_us, core->settings.period_us, now)) {
        uint8_t bytes[CORE_LARGEST], *at = put_u32(bytes, now);
        at = put_u32(at, core->period_number++);
        *at++ = (uint8_t)core->mode;
        at = put_f32(at, core->applied_torque);
        at = put_f32(at, core->applied_drive);
        at = put_u16(at, core->sequence);
        send(core, CORE_PERIOD, bytes, (size_t)(at - bytes));
    }
}

void core_tick(struct core *core, const struct core_inputs *inputs, uint32_t now_us) {
    follow_steering(core, inputs);
    bool resting = core->resting = calibrate(core, inputs);
    core->reasons = look(core, inputs, resting, now_us);
    decide(core, inputs, now_us);
    report(core, inputs, now_us);
}
