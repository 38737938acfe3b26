"""Pins of a Raspberry Pi Pico, by GPIO number."""

NAME = "solen board, Raspberry Pi Pico"
EMITTERS = (2, 3, 4, 5)
INPUTS = (26, 27, 28)
ADC_OPTIONS = {}
TIMER_OPTIONS = {}

# driver of a stepper, or instead the pin of a hobby servo, whose steps are microseconds of pulse width from the centre
STEP, DIRECTION = 10, 11
SERVO = None
SERVO_CENTRE_US = 1500
MAX_STEPS_PER_S = 2000
