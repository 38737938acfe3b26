"""The hardware of a board with MicroPython; pins.py assigns the pins."""

import gc
import select
import struct
import sys
from time import ticks_diff, ticks_us

import micropython
import pins
from machine import ADC, PWM, Pin, Timer
from solen_board import Board, Hardware

GUARD_MS, MAX_SILENT_TICKS = 50, 17


class Pins(Hardware):
    """Emitters, inputs and a motor on the pins of this board."""

    max_steps_per_s = pins.MAX_STEPS_PER_S

    def __init__(self):
        self._emitters = [Pin(number, Pin.OUT, value=0) for number in pins.EMITTERS]
        self._inputs = [ADC(Pin(number), **pins.ADC_OPTIONS) for number in pins.INPUTS]
        self._lit, self._last_ticks, self._us = -1, ticks_us(), 0
        self._out = sys.stdout.buffer
        self._servo = None
        if pins.SERVO is None:
            self._step, self._forward = Pin(pins.STEP, Pin.OUT, value=0), Pin(pins.DIRECTION, Pin.OUT, value=0)

    def now_us(self):
        now = ticks_us()
        self._us += ticks_diff(now, self._last_ticks)
        self._last_ticks = now
        return self._us

    def light(self, emitter):
        if self._lit >= 0:
            self._emitters[self._lit].value(0)
        if emitter >= 0:
            self._emitters[emitter].value(1)
        self._lit = emitter

    def all_off(self):
        for emitter in self._emitters:
            emitter.value(0)

    def sample(self, buffer, at, inputs):
        for number in range(inputs):
            struct.pack_into("<H", buffer, at + 2 * number, self._inputs[number].read_u16())

    def send(self, data):
        self._out.write(data)

    def supports(self, half_us, emitters, inputs):
        return emitters <= len(self._emitters) and inputs <= len(self._inputs) and half_us >= 400 + 60 * inputs

    def step(self, position, forward):
        if pins.SERVO is None:
            self._forward.value(forward)
            self._step.value(1)
            self._step.value(0)
            return
        if self._servo is None:  # no pulses before the first move
            self._servo = PWM(Pin(pins.SERVO), freq=50)
        self._servo.duty_ns(1000 * min(max(pins.SERVO_CENTRE_US + position, 500), 2500))


def run():
    micropython.kbd_intr(-1)  # byte 3 is data, not Ctrl-C
    hardware = Pins()
    board, silent_ticks = Board(hardware, pins.NAME), [0]

    def guard(_):  # switches the emitters off even during a long write to a disconnected host
        silent_ticks[0] += 1
        if silent_ticks[0] > MAX_SILENT_TICKS:
            hardware.all_off()

    Timer(period=GUARD_MS, mode=Timer.PERIODIC, callback=guard, **pins.TIMER_OPTIONS)
    poll, stdin = select.poll(), sys.stdin.buffer
    poll.register(sys.stdin, select.POLLIN)
    gc.disable()
    while True:
        if poll.poll(0):
            silent_ticks[0] = 0
            board.receive(stdin.read(1))
        elif not board.work() and gc.mem_free() < 60_000:
            gc.collect()


run()
