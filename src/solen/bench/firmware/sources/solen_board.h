/* The core of the emitter board in C, without hardware; it sends the same frames as solen_board.py. */
#ifndef SOLEN_BOARD_H
#define SOLEN_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef SOLEN_MAX_FRAME
#define SOLEN_MAX_FRAME 212 /* bytes of a frame with 4 emitters and 12 inputs */
#endif

/* Functions of the hardware, called by the core. */
uint32_t hw_now_us(void);      /* wraps after 2^32 */
void hw_light(int8_t emitter); /* from 0; -1 for none */
uint16_t hw_sample(uint8_t input);
void hw_send(const uint8_t *data, uint8_t size); /* the buffer is reused afterwards */
bool hw_supports(uint32_t half_us, uint8_t emitters, uint8_t inputs);
void hw_step(int32_t position, bool forward);
extern const uint32_t hw_max_steps_per_s; /* 0 for no motor */
extern const char hw_name[];

/* Functions of the core. */
void board_work(void);  /* to be called as often as possible */
void board_motor(void); /* makes a step of the motor if one is due */
void board_receive(uint8_t byte);
bool board_next_us(uint32_t *due); /* time at which the next half is due; false if the board does not sample */

#ifdef __cplusplus
}
#endif
#endif
