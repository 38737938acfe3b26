"""Pins of an ESP32, by GPIO number; the inputs are those of its first ADC."""

from machine import ADC

NAME = "solen board, ESP32"
EMITTERS = (16, 17, 18, 19)
INPUTS = (32, 33, 34, 35, 36, 39)
ADC_OPTIONS = {"atten": ADC.ATTN_11DB}
TIMER_OPTIONS = {"id": 0}

# driver of a stepper, or instead the pin of a hobby servo, whose steps are microseconds of pulse width from the centre
STEP, DIRECTION = 25, 26
SERVO = None
SERVO_CENTRE_US = 1500
MAX_STEPS_PER_S = 2000
