/* The core of the board in C; solen_board.py explains it. Numbers on the wire are little-endian, as on an AVR. */
#include "solen_board.h"

#include <math.h>
#include <string.h>

enum { SAMPLES = 1, REPLY = 2 };
enum { IDENTIFY = 16, CONFIGURE, START, STOP, ALIVE, TIME, MOVE, HALT, WHERE, PLACE };
enum { DONE, UNKNOWN, INVALID, UNCONFIGURED, NO_MOTOR = 5 };
enum { LATE = 1, HEAD = 10, PERIOD = 8, FLAGS_AT = HEAD + 6, MAX_COMMAND = 64, LATE_DIVISOR = 8 };
static const uint32_t WATCHDOG_US = 800000;

static uint8_t frame[SOLEN_MAX_FRAME], received[HEAD + MAX_COMMAND + 2];
static uint8_t frame_size, emitters, inputs, half, received_bytes;
static uint16_t crc, late_crc;
static uint32_t period_us, number, period_start_us, stamp_us, start_us, last_byte_us;
static bool sampling, late;

static struct {
    int32_t position, start;
    bool moving, forward, braking;
    uint32_t begin_us, last_us; /* start of the ramp, and the last time since then */
    uint8_t wraps;              /* of the time since the start, for moves of more than 71 minutes */
    uint32_t last_step_us, min_step_us; /* time of the last step, and shortest interval between steps */
    float distance, velocity, acceleration, ramp_s, total_s;
} motor;

static uint16_t crc_update(uint16_t value, uint8_t byte) {
    uint8_t high = (value >> 8) ^ byte;
    high ^= high >> 4;
    return (value << 8) ^ ((uint16_t)high << 12) ^ ((uint16_t)high << 5) ^ high;
}

static void put(uint8_t *to, uint32_t value, uint8_t bytes) {
    while (bytes--) {
        *to++ = value;
        value >>= 8;
    }
}

static uint32_t get(const uint8_t *from, uint8_t bytes) {
    uint32_t value = 0;
    while (bytes--) value = value << 8 | from[bytes];
    return value;
}

static void head(uint8_t *to, uint8_t kind, uint16_t length) {
    put(to, 0x5AA5, 2);
    to[2] = 1;
    to[3] = kind;
    put(to + 4, length, 2);
    put(to + 6, 0, 4);
}

static uint16_t crc_of(const uint8_t *data, uint16_t begin, uint16_t end) {
    uint16_t value = 0xFFFF;
    for (; begin < end; begin++) value = crc_update(value, data[begin]);
    return value;
}

/* ---------------------------------------------------------------------------------------------- periods */

static void stop_sampling(void) {
    sampling = false;
    hw_light(-1);
}

static uint32_t due_us(void) { /* end of the current half */
    return period_start_us + (uint32_t)((uint64_t)(half + 1) * period_us / (2 * emitters));
}

static void begin_period(void) { /* the first emitter is already on */
    half = 0;
    late = false;
    put(frame + 6, number, 4);
    put(frame + HEAD, stamp_us, 4);
    frame[FLAGS_AT] = 0;
    crc = crc_of(frame, 2, HEAD + PERIOD);
}

static void end_period(void) {
    frame[FLAGS_AT] = late ? LATE : 0;
    put(frame + frame_size - 2, late ? crc ^ late_crc : crc, 2);
    hw_send(frame, frame_size);
    do { /* the numbers of periods that could not be sampled are skipped */
        number++;
        stamp_us += period_us;
        period_start_us += period_us;
    } while (hw_now_us() - period_start_us >= period_us && (int32_t)(hw_now_us() - period_start_us) > 0);
    begin_period();
}

static void end_half(uint32_t late_us) {
    uint8_t *at = frame + HEAD + PERIOD + half * 2 * inputs;
    for (uint8_t input = 0; input < inputs; input++) put(at + 2 * input, hw_sample(input), 2);
    half++;
    hw_light(half == 2 * emitters ? 0 : half & 1 ? -1 : half >> 1);
    late = late || late_us * 2 * emitters * LATE_DIVISOR > period_us;
    for (uint8_t byte = 0; byte < 2 * inputs; byte++) crc = crc_update(crc, at[byte]);
    if (half == 2 * emitters) end_period();
}

static uint8_t configure(const uint8_t *payload, uint8_t length) {
    if (length != 6) return INVALID;
    stop_sampling();
    uint32_t requested_us = get(payload, 4);
    uint16_t size = PERIOD + 4 * (uint16_t)payload[4] * payload[5];
    period_us = 0;
    if (!requested_us || !payload[4] || !payload[5] || size > SOLEN_MAX_FRAME - HEAD - 2) return INVALID;
    if (!hw_supports(requested_us / (2 * payload[4]), payload[4], payload[5])) return INVALID;
    period_us = requested_us;
    emitters = payload[4];
    inputs = payload[5];
    frame_size = HEAD + size + 2;
    memset(frame, 0, sizeof frame);
    head(frame, SAMPLES, size);
    frame[HEAD + 4] = emitters;
    frame[HEAD + 5] = inputs;
    late_crc = crc_update(0, LATE); /* change of the checksum by the flag: the checksum is linear */
    for (uint8_t byte = 0; byte < size - 7; byte++) late_crc = crc_update(late_crc, 0);
    return DONE;
}

/* ------------------------------------------------------------------------------------------------ motor */

static void ramp(bool forward, float distance, float velocity, float acceleration, float ramp_s, float uniform_s) {
    motor.start = motor.position;
    motor.forward = forward;
    motor.distance = distance;
    motor.velocity = velocity;
    motor.acceleration = acceleration;
    motor.ramp_s = ramp_s;
    motor.total_s = ramp_s + (uniform_s > 0 ? uniform_s : 0) + velocity / acceleration;
    motor.begin_us = hw_now_us();
    motor.last_us = 0;
    motor.wraps = 0;
    motor.moving = true;
}

static void move(int32_t target, float velocity, float acceleration) {
    bool forward = target >= motor.position;
    float distance = forward ? target - motor.position : motor.position - target;
    float up = fminf(velocity / acceleration, sqrtf(distance / acceleration));
    motor.braking = false;
    motor.min_step_us = 1000000 / hw_max_steps_per_s;
    ramp(forward, distance, acceleration * up, acceleration, up, (distance - acceleration * up * up) / velocity);
}

static float elapsed_s(void) {
    uint32_t us = hw_now_us() - motor.begin_us;
    if (us < motor.last_us) motor.wraps++;
    motor.last_us = us;
    return 1e-6f * us + 4294.967296f * motor.wraps;
}

static void halt(void) {
    if (!motor.moving || motor.braking) return;
    float elapsed = elapsed_s();
    float speed = motor.acceleration * fminf(elapsed, fmaxf(0, motor.total_s - elapsed));
    speed = fminf(speed, motor.velocity);
    motor.braking = true;
    ramp(motor.forward, speed * speed / (2 * motor.acceleration), speed, motor.acceleration, 0, 0);
}

static float travelled(float elapsed) {
    float remaining = motor.total_s - elapsed;
    if (remaining <= 0) return motor.distance;
    if (elapsed < motor.ramp_s) return 0.5f * motor.acceleration * elapsed * elapsed;
    if (remaining < motor.velocity / motor.acceleration)
        return motor.distance - 0.5f * motor.acceleration * remaining * remaining;
    return motor.velocity * (elapsed - 0.5f * motor.ramp_s);
}

void board_motor(void) {
    if (!motor.moving) return;
    float elapsed = elapsed_s();
    int32_t steps_made = motor.forward ? motor.position - motor.start : motor.start - motor.position;
    if (steps_made < (int32_t)(travelled(elapsed) + 0.5f)) {
        uint32_t now = hw_now_us();
        if (now - motor.last_step_us < motor.min_step_us) return; /* also limits the rate after a delay */
        motor.last_step_us = now;
        motor.position += motor.forward ? 1 : -1;
        hw_step(motor.position, motor.forward);
    } else if (elapsed >= motor.total_s) {
        motor.moving = false;
    }
}

static uint8_t motor_command(uint8_t kind, const uint8_t *payload, uint8_t length, uint8_t *data, uint8_t *size) {
    if (!hw_max_steps_per_s) return NO_MOTOR;
    if (kind == WHERE) {
        put(data, hw_now_us() - start_us, 4);
        put(data + 4, motor.position, 4);
        data[8] = motor.moving;
        *size = 9;
    } else if (kind == HALT) {
        halt();
    } else if (kind == PLACE && length == 4) {
        motor.position = get(payload, 4);
        motor.moving = false;
    } else if (kind == MOVE && length == 12) {
        uint32_t milli_steps_per_s = get(payload + 4, 4), acceleration = get(payload + 8, 4);
        if (motor.moving || !acceleration || !milli_steps_per_s) return INVALID;
        if (milli_steps_per_s > 1000 * hw_max_steps_per_s) return INVALID;
        move(get(payload, 4), 1e-3f * milli_steps_per_s, acceleration);
    } else {
        return INVALID;
    }
    return DONE;
}

/* --------------------------------------------------------------------------------------------- commands */

static void execute(uint8_t kind, const uint8_t *payload, uint8_t length) {
    uint8_t reply[HEAD + 2 + 48 + 2], *data = reply + HEAD + 2, size = 0, status = DONE;
    switch (kind) {
        case ALIVE:
            return;
        case IDENTIFY:
            size = strlen(hw_name);
            memcpy(data, hw_name, size);
            break;
        case CONFIGURE:
            status = configure(payload, length);
            break;
        case START:
            status = period_us ? DONE : UNCONFIGURED;
            if (period_us && !sampling) {
                number = stamp_us = 0;
                start_us = period_start_us = hw_now_us();
                sampling = true;
                hw_light(0);
                begin_period();
            }
            break;
        case STOP:
            stop_sampling();
            break;
        case TIME:
            put(data, hw_now_us() - start_us, 4);
            size = 4;
            break;
        default:
            status = kind >= MOVE && kind <= PLACE ? motor_command(kind, payload, length, data, &size) : UNKNOWN;
    }
    head(reply, REPLY, 2 + size);
    reply[HEAD] = kind;
    reply[HEAD + 1] = status;
    put(data + size, crc_of(reply, 2, HEAD + 2 + size), 2);
    hw_send(reply, HEAD + 2 + size + 2);
}

static void discard(uint8_t bytes) {
    received_bytes -= bytes;
    memmove(received, received + bytes, received_bytes);
}

static bool next_command(void) { /* execute the next command; return false if none is complete */
    while (received_bytes && (received[0] != 0xA5 || (received_bytes > 1 && received[1] != 0x5A))) discard(1);
    if (received_bytes < HEAD + 2) return false;
    uint16_t length = get(received + 4, 2);
    if (length <= MAX_COMMAND && received_bytes < HEAD + length + 2) return false;
    bool valid = length <= MAX_COMMAND && crc_of(received, 2, HEAD + length) == get(received + HEAD + length, 2);
    if (valid && received[2] == 1) execute(received[3], received + HEAD, length);
    discard(valid ? HEAD + length + 2 : 2);
    return true;
}

void board_receive(uint8_t byte) {
    last_byte_us = hw_now_us();
    received[received_bytes++] = byte;
    while (next_command()) continue;
}

bool board_next_us(uint32_t *due) {
    *due = sampling ? due_us() : 0;
    return sampling;
}

void board_work(void) {
    board_motor();
    if (!sampling) return;
    uint32_t now = hw_now_us(), late_us = now - due_us();
    if (now - last_byte_us > WATCHDOG_US && (int32_t)(now - last_byte_us) > 0) {
        stop_sampling();
    } else if ((int32_t)late_us >= 0) {
        end_half(late_us);
    }
}
