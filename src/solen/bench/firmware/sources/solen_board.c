/* See solen_board.h, and solen_board.py for the idea. Numbers on the wire are little-endian, as those of an AVR are. */
#include "solen_board.h"

#include <math.h>
#include <string.h>

enum { SAMPLES = 1, ANSWER = 2 };
enum { IDENTIFY = 16, CONFIGURE, START, STOP, ALIVE, TIME, MOVE, HALT, WHERE, PLACE };
enum { DONE, UNKNOWN, UNFIT, UNCONFIGURED, NO_MOTOR = 5 };
enum { LATE = 1, HEAD = 10, PERIOD = 8, FLAGS_AT = HEAD + 6, LONGEST_COMMAND = 64, LATE_SHARE = 8 };
static const uint32_t WATCHDOG_US = 800000;

static uint8_t frame[SOLEN_LONGEST], coming[HEAD + LONGEST_COMMAND + 2];
static uint8_t size_of_frame, emitters, inputs, half, heard_bytes;
static uint16_t crc, late_crc;
static uint32_t period_us, number, period_begun_us, stamp_us, begun_us, heard_us;
static bool lit, late;

static struct {
    int32_t position, start;
    bool moving, forward, braking;
    uint32_t begin_us, last_us; /* since it began; beside how often that has wrapped, for moves of over 71 minutes */
    uint8_t wraps;
    uint32_t stepped_us, least_us; /* of the last step; and from a step to the next */
    float way, velocity, acceleration, up_s, all_s;
} motor;

static uint16_t crc_on(uint16_t value, uint8_t byte) {
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
    for (; begin < end; begin++) value = crc_on(value, data[begin]);
    return value;
}

/* ---------------------------------------------------------------------------------------------- periods */

static void dark(void) {
    lit = false;
    hw_light(-1);
}

static uint32_t due_us(void) { /* end of the half under way */
    return period_begun_us + (uint32_t)((uint64_t)(half + 1) * period_us / (2 * emitters));
}

static void begin_period(void) { /* its first emitter is on */
    half = 0;
    late = false;
    put(frame + 6, number, 4);
    put(frame + HEAD, stamp_us, 4);
    frame[FLAGS_AT] = 0;
    crc = crc_of(frame, 2, HEAD + PERIOD);
}

static void end_period(void) {
    frame[FLAGS_AT] = late ? LATE : 0;
    put(frame + size_of_frame - 2, late ? crc ^ late_crc : crc, 2);
    hw_send(frame, size_of_frame);
    do { /* periods that could not be sampled are missing by their numbers */
        number++;
        stamp_us += period_us;
        period_begun_us += period_us;
    } while (hw_now_us() - period_begun_us >= period_us && (int32_t)(hw_now_us() - period_begun_us) > 0);
    begin_period();
}

static void end_half(uint32_t behind_us) {
    uint8_t *at = frame + HEAD + PERIOD + half * 2 * inputs;
    for (uint8_t input = 0; input < inputs; input++) put(at + 2 * input, hw_sample(input), 2);
    half++;
    hw_light(half == 2 * emitters ? 0 : half & 1 ? -1 : half >> 1);
    late = late || behind_us * 2 * emitters * LATE_SHARE > period_us;
    for (uint8_t byte = 0; byte < 2 * inputs; byte++) crc = crc_on(crc, at[byte]);
    if (half == 2 * emitters) end_period();
}

static uint8_t configure(const uint8_t *payload, uint8_t length) {
    if (length != 6) return UNFIT;
    dark();
    uint32_t asked_us = get(payload, 4);
    uint16_t size = PERIOD + 4 * (uint16_t)payload[4] * payload[5];
    period_us = 0;
    if (!asked_us || !payload[4] || !payload[5] || size > SOLEN_LONGEST - HEAD - 2) return UNFIT;
    if (!hw_fits(asked_us / (2 * payload[4]), payload[4], payload[5])) return UNFIT;
    period_us = asked_us;
    emitters = payload[4];
    inputs = payload[5];
    size_of_frame = HEAD + size + 2;
    memset(frame, 0, sizeof frame);
    head(frame, SAMPLES, size);
    frame[HEAD + 4] = emitters;
    frame[HEAD + 5] = inputs;
    late_crc = crc_on(0, LATE); /* the checksum is linear */
    for (uint8_t byte = 0; byte < size - 7; byte++) late_crc = crc_on(late_crc, 0);
    return DONE;
}

/* ------------------------------------------------------------------------------------------------ motor */

static void ramp(bool forward, float way, float velocity, float acceleration, float up_s, float flat_s) {
    motor.start = motor.position;
    motor.forward = forward;
    motor.way = way;
    motor.velocity = velocity;
    motor.acceleration = acceleration;
    motor.up_s = up_s;
    motor.all_s = up_s + (flat_s > 0 ? flat_s : 0) + velocity / acceleration;
    motor.begin_us = hw_now_us();
    motor.last_us = 0;
    motor.wraps = 0;
    motor.moving = true;
}

static void move(int32_t target, float velocity, float acceleration) {
    bool forward = target >= motor.position;
    float way = forward ? target - motor.position : motor.position - target;
    float up = fminf(velocity / acceleration, sqrtf(way / acceleration));
    motor.braking = false;
    motor.least_us = 1000000 / hw_most_steps_per_s;
    ramp(forward, way, acceleration * up, acceleration, up, (way - acceleration * up * up) / velocity);
}

static float since_s(void) {
    uint32_t us = hw_now_us() - motor.begin_us;
    if (us < motor.last_us) motor.wraps++;
    motor.last_us = us;
    return 1e-6f * us + 4294.967296f * motor.wraps;
}

static void halt(void) {
    if (!motor.moving || motor.braking) return;
    float since = since_s();
    float speed = motor.acceleration * fminf(since, fmaxf(0, motor.all_s - since));
    speed = fminf(speed, motor.velocity);
    motor.braking = true;
    ramp(motor.forward, speed * speed / (2 * motor.acceleration), speed, motor.acceleration, 0, 0);
}

static float gone(float since) {
    float left = motor.all_s - since;
    if (left <= 0) return motor.way;
    if (since < motor.up_s) return 0.5f * motor.acceleration * since * since;
    if (left < motor.velocity / motor.acceleration) return motor.way - 0.5f * motor.acceleration * left * left;
    return motor.velocity * (since - 0.5f * motor.up_s);
}

void board_motor(void) {
    if (!motor.moving) return;
    float since = since_s();
    int32_t made = motor.forward ? motor.position - motor.start : motor.start - motor.position;
    if (made < (int32_t)(gone(since) + 0.5f)) {
        uint32_t now = hw_now_us();
        if (now - motor.stepped_us < motor.least_us) return; /* steps that were missed are made up no faster */
        motor.stepped_us = now;
        motor.position += motor.forward ? 1 : -1;
        hw_step(motor.position, motor.forward);
    } else if (since >= motor.all_s) {
        motor.moving = false;
    }
}

static uint8_t motor_does(uint8_t kind, const uint8_t *payload, uint8_t length, uint8_t *words, uint8_t *size) {
    if (!hw_most_steps_per_s) return NO_MOTOR;
    if (kind == WHERE) {
        put(words, hw_now_us() - begun_us, 4);
        put(words + 4, motor.position, 4);
        words[8] = motor.moving;
        *size = 9;
    } else if (kind == HALT) {
        halt();
    } else if (kind == PLACE && length == 4) {
        motor.position = get(payload, 4);
        motor.moving = false;
    } else if (kind == MOVE && length == 12) {
        uint32_t milli_steps = get(payload + 4, 4), acceleration = get(payload + 8, 4);
        if (motor.moving || !acceleration || !milli_steps || milli_steps > 1000 * hw_most_steps_per_s) return UNFIT;
        move(get(payload, 4), 1e-3f * milli_steps, acceleration);
    } else {
        return UNFIT;
    }
    return DONE;
}

/* --------------------------------------------------------------------------------------------- commands */

static void does(uint8_t kind, const uint8_t *payload, uint8_t length) {
    uint8_t answer[HEAD + 2 + 48 + 2], *words = answer + HEAD + 2, size = 0, status = DONE;
    switch (kind) {
        case ALIVE:
            return;
        case IDENTIFY:
            size = strlen(hw_name);
            memcpy(words, hw_name, size);
            break;
        case CONFIGURE:
            status = configure(payload, length);
            break;
        case START:
            status = period_us ? DONE : UNCONFIGURED;
            if (period_us && !lit) {
                number = stamp_us = 0;
                begun_us = period_begun_us = hw_now_us();
                lit = true;
                hw_light(0);
                begin_period();
            }
            break;
        case STOP:
            dark();
            break;
        case TIME:
            put(words, hw_now_us() - begun_us, 4);
            size = 4;
            break;
        default:
            status = kind >= MOVE && kind <= PLACE ? motor_does(kind, payload, length, words, &size) : UNKNOWN;
    }
    head(answer, ANSWER, 2 + size);
    answer[HEAD] = kind;
    answer[HEAD + 1] = status;
    put(words + size, crc_of(answer, 2, HEAD + 2 + size), 2);
    hw_send(answer, HEAD + 2 + size + 2);
}

static void forget(uint8_t bytes) {
    heard_bytes -= bytes;
    memmove(coming, coming + bytes, heard_bytes);
}

static bool command(void) { /* does the next one; false where none is complete */
    while (heard_bytes && (coming[0] != 0xA5 || (heard_bytes > 1 && coming[1] != 0x5A))) forget(1);
    if (heard_bytes < HEAD + 2) return false;
    uint16_t length = get(coming + 4, 2);
    if (length <= LONGEST_COMMAND && heard_bytes < HEAD + length + 2) return false;
    bool whole = length <= LONGEST_COMMAND && crc_of(coming, 2, HEAD + length) == get(coming + HEAD + length, 2);
    if (whole && coming[2] == 1) does(coming[3], coming + HEAD, length);
    forget(whole ? HEAD + length + 2 : 2);
    return true;
}

void board_hear(uint8_t byte) {
    heard_us = hw_now_us();
    coming[heard_bytes++] = byte;
    while (command()) continue;
}

bool board_next_us(uint32_t *due) {
    *due = lit ? due_us() : 0;
    return lit;
}

void board_work(void) {
    board_motor();
    if (!lit) return;
    uint32_t now = hw_now_us(), behind = now - due_us();
    if (now - heard_us > WATCHDOG_US && (int32_t)(now - heard_us) > 0) {
        dark();
    } else if ((int32_t)behind >= 0) {
        end_half(behind);
    }
}
