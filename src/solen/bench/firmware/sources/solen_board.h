/* The emitter board's core without its hardware, in C: as solen_board.py, frame for frame. */
#ifndef SOLEN_BOARD_H
#define SOLEN_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#ifndef SOLEN_LONGEST
#define SOLEN_LONGEST 212 /* bytes of a frame of 4 emitters and 12 inputs */
#endif

/* What the hardware does for the core. */
uint32_t hw_now_us(void);                       /* wraps after 2^32 */
void hw_light(int8_t emitter);                  /* from 0; -1 for none */
uint16_t hw_sample(uint8_t input);
void hw_send(const uint8_t *data, uint8_t size); /* the buffer is used again */
bool hw_fits(uint32_t half_us, uint8_t emitters, uint8_t inputs);
void hw_step(int32_t position, bool forward);
extern const uint32_t hw_most_steps_per_s; /* 0 for no motor */
extern const char hw_name[];

/* To be called as often as possible, and with each byte that came. */
void board_work(void);
void board_motor(void);
void board_hear(uint8_t byte);
bool board_next_us(uint32_t *due); /* when the next half is due; false while it is dark */

#ifdef __cplusplus
}
#endif
#endif
