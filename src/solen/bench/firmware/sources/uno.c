/* The hardware of an Arduino Uno (ATmega328P, 16 MHz): pins, ADC, serial line, clock. */
#include "solen_board.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <util/atomic.h>

/* Emitters 1 to 4 on D2 to D5, each by a transistor; inputs 1 to 6 on A0 to A5. */
enum { EMITTERS = 4, INPUTS = 6, FIRST_EMITTER = 2 };
/* Driver of the stepper: STEP on D8, DIR on D9. */
enum { STEP_BIT = 0, DIR_BIT = 1 };
enum { SUMMED = 4, CONVERSION_US = 60 }; /* conversions summed to 12 bits, or only one if there is no time */
#ifndef SOLEN_BAUD
#define SOLEN_BAUD 500000
#endif

const char hw_name[] = "solen board, Arduino Uno";
const uint32_t hw_max_steps_per_s = 2000;

static uint8_t summed = SUMMED;
static volatile uint32_t ticks; /* overflows of timer 1, which counts half microseconds */
static volatile uint8_t sending[256], send_end, send_begin, received[64], write_at, read_at;

ISR(TIMER1_OVF_vect) { ticks++; }

ISR(USART_RX_vect) {
    uint8_t byte = UDR0, next = (write_at + 1) % sizeof received;
    if (next != read_at) {
        received[write_at] = byte;
        write_at = next;
    }
}

ISR(USART_UDRE_vect) {
    if (send_begin == send_end) UCSR0B &= ~(1 << UDRIE0);
    else UDR0 = sending[send_begin++];
}

uint32_t hw_now_us(void) {
    uint32_t high;
    uint16_t low;
    ATOMIC_BLOCK(ATOMIC_RESTORESTATE) {
        low = TCNT1;
        high = ticks;
        if ((TIFR1 & (1 << TOV1)) && low < 0x8000) high++;
    }
    return high << 15 | low >> 1;
}

void hw_light(int8_t emitter) {
    uint8_t on = emitter < 0 ? 0 : 1 << (FIRST_EMITTER + emitter);
    PORTD = (PORTD & ~(((1 << EMITTERS) - 1) << FIRST_EMITTER)) | on;
}

uint16_t hw_sample(uint8_t input) {
    uint16_t sum = 0;
    ADMUX = 1 << REFS0 | input;
    for (uint8_t conversion = 0; conversion <= summed; conversion++) { /* the first one after a change of input is discarded */
        ADCSRA |= 1 << ADSC;
        board_motor();
        while (ADCSRA & (1 << ADSC)) continue;
        if (conversion) sum += ADC;
    }
    if (summed == 1) sum *= SUMMED;
    return sum + (sum >> 10); /* up to 4095 */
}

void hw_send(const uint8_t *data, uint8_t size) {
    while (size--) {
        sending[send_end] = *data++;
        while ((uint8_t)(send_end + 1) == send_begin) continue;
        send_end++;
        UCSR0B |= 1 << UDRIE0;
    }
}

bool hw_supports(uint32_t half_us, uint8_t emitters, uint8_t inputs) {
    uint32_t free_us = half_us > 200 ? half_us - 200 : 0, input_us = (uint32_t)inputs * CONVERSION_US;
    summed = free_us >= (1 + SUMMED) * input_us ? SUMMED : 1;
    return emitters <= EMITTERS && inputs <= INPUTS && free_us >= 2 * input_us;
}

void hw_step(int32_t position, bool forward) {
    (void)position;
    if (forward) PORTB |= 1 << DIR_BIT;
    else PORTB &= ~(1 << DIR_BIT);
    PORTB |= 1 << STEP_BIT;
    for (uint8_t cycle = 0; cycle < 16; cycle++) __asm__ volatile("nop"); /* drivers need a pulse of 1 or 2 us */
    PORTB &= ~(1 << STEP_BIT);
}

void board_begin(void) {
    DDRD |= ((1 << EMITTERS) - 1) << FIRST_EMITTER;
    hw_light(-1);
    DDRB |= 1 << STEP_BIT | 1 << DIR_BIT;
    ADCSRA = 1 << ADEN | 1 << ADPS2 | 1 << ADPS1; /* 250 kHz */
    TCCR1A = 0;
    TCCR1B = 1 << CS11; /* 2 MHz */
    TIMSK1 = 1 << TOIE1;
    UBRR0 = 2000000UL / SOLEN_BAUD - 1;
    UCSR0A = 1 << U2X0;
    UCSR0B = 1 << RXEN0 | 1 << TXEN0 | 1 << RXCIE0;
    UCSR0C = 1 << UCSZ01 | 1 << UCSZ00;
    sei();
}

void board_loop(void) {
    while (read_at != write_at) {
        board_receive(received[read_at]);
        read_at = (read_at + 1) % sizeof received;
    }
    board_work();
}

#ifndef ARDUINO
int main(void) {
    board_begin();
    for (;;) board_loop();
}
#endif
