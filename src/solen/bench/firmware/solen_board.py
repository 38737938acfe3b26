"""The emitter board's core without its hardware, for both MicroPython and CPython.

A loop calls `Board.work` as often as it can and `Board.hear` with the bytes from the host. A period is divided into two
halves for each emitter, on and off; at the end of each half every input is sampled and the next emitter is switched.
The checksum is computed half by half, which avoids one long computation that would delay a half. A motor follows its
ramp by the same clock. Each hardware implements `Hardware`; frames and commands are those of `solen.bench.frames` and
`solen.bench.board`, but this file imports neither, because it is copied onto boards unchanged.

Public names: `Board` and `Hardware`.
"""

import struct
from array import array

VERSION, SAMPLES, ANSWER = 1, 1, 2
IDENTIFY, CONFIGURE, START, STOP, ALIVE, TIME, MOVE, HALT, WHERE, PLACE = range(16, 26)
DONE, UNKNOWN, UNFIT, UNCONFIGURED, NO_MOTOR = 0, 1, 2, 3, 5
LATE = 1
HEAD_BYTES, PERIOD_BYTES, MAX_COMMAND_LENGTH = 10, 8, 64
FLAGS_AT = HEAD_BYTES + 6
WATCHDOG_US = 800_000
"""Silence of the host in µs after which the emitters go off; together with the time of a loop, within a second."""
LATE_SHARE = 8
"""A half that is sampled later than its length divided by this number makes its period late."""


def _table() -> "array[int]":
    table = array("H", [0] * 256)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        table[byte] = crc & 0xFFFF
    return table


TABLE = _table()


def crc_on(crc: int, data: "bytes | bytearray", begin: int, end: int) -> int:
    """Return CRC-16/CCITT-FALSE, continued over ``data[begin:end]``."""
    table = TABLE
    for at in range(begin, end):
        crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ data[at]]
    return crc


class Hardware:
    """Hardware of a board: the methods that each kind of board implements.

    Attributes
    ----------
    most_steps_per_s
        Highest step rate of its motor; 0 without one.
    """

    most_steps_per_s = 0

    def now_us(self) -> int:
        """Return the microseconds since an arbitrary beginning; they never decrease and never wrap."""
        raise NotImplementedError  # MicroPython has no abc

    def light(self, emitter: int) -> None:
        """Switch on one emitter, counted from 0, and all others off; -1 for none."""
        raise NotImplementedError  # MicroPython has no abc

    def sample(self, buffer: bytearray, at: int, inputs: int) -> None:
        """Write the counts of the inputs into a buffer, 2 bytes each, low byte first."""
        raise NotImplementedError  # MicroPython has no abc

    def send(self, data: bytearray) -> None:
        """Send bytes to the host; the buffer is reused afterwards."""
        raise NotImplementedError  # MicroPython has no abc

    def fits(self, half_us: int, emitters: int, inputs: int) -> bool:
        """Whether the board has this number of emitters and inputs, and can sample them within a half."""
        raise NotImplementedError  # MicroPython has no abc

    def step(self, position: int, forward: bool) -> None:
        """Move the motor by one step, to a position."""
        raise NotImplementedError  # MicroPython has no abc


class Axis:
    """A motor that follows a ramp from rest to rest, step by step.

    Attributes
    ----------
    position, moving
        Steps from its zero, and whether a ramp is in progress.
    """

    def __init__(self, hardware: Hardware) -> None:
        self._hardware = hardware
        self.position, self.moving = 0, False
        self._begin_us, self._start, self._sign = 0, 0, 1
        self._stepped_us = self._least_us = 0
        self._way = self._velocity = self._acceleration = self._up_s = self._flat_s = self._all_s = 0.0

    def send(self, now_us: int, target: int, velocity: float, acceleration: float) -> None:
        """Begin a ramp to a position, in steps, steps/s and steps/s²."""
        self._least_us = 1_000_000 // self._hardware.most_steps_per_s
        way = float(abs(target - self.position))
        up = min(velocity / acceleration, (way / acceleration) ** 0.5)
        flat = (way - acceleration * up * up) / velocity
        self._ramp(now_us, 1 if target >= self.position else -1, way, (acceleration * up, acceleration), (up, flat))

    def halt(self, now_us: int) -> None:
        """Slow down from the current position with the deceleration of the ramp, unless already slowing down."""
        if self.moving and self._up_s:
            since = 1e-6 * (now_us - self._begin_us)
            speed = self._acceleration * min(since, max(0.0, self._all_s - since))
            speed = min(speed, self._velocity)
            way = speed * speed / (2.0 * self._acceleration)
            self._ramp(now_us, self._sign, way, (speed, self._acceleration), (0.0, 0.0))

    def place(self, position: int) -> None:
        """Define the current position as a given value; nothing moves."""
        self.position, self.moving = position, False

    def work(self, now_us: int) -> None:
        """Make one step if the ramp is ahead of the motor, respecting the motor's minimum interval."""
        since = 1e-6 * (now_us - self._begin_us)
        if self._sign * (self.position - self._start) < int(self._gone(since) + 0.5):
            if now_us - self._stepped_us >= self._least_us:
                self._stepped_us = now_us
                self.position += self._sign
                self._hardware.step(self.position, self._sign > 0)
        elif since >= self._all_s:
            self.moving = False

    def _ramp(
        self, now_us: int, sign: int, way: float, speeds: "tuple[float, float]", times_s: "tuple[float, float]"
    ) -> None:
        self._velocity, self._acceleration = speeds
        self._up_s, self._flat_s = times_s
        self._all_s = self._up_s + max(self._flat_s, 0.0) + self._velocity / self._acceleration
        self._begin_us, self._start, self._sign, self._way, self.moving = now_us, self.position, sign, way, True

    def _gone(self, since: float) -> float:
        """Return the steps travelled since the start of the move at a later time."""
        left = self._all_s - since
        if left <= 0.0:
            return self._way
        if since < self._up_s:
            return 0.5 * self._acceleration * since * since
        if left < self._velocity / self._acceleration:
            return self._way - 0.5 * self._acceleration * left * left
        return self._velocity * (since - 0.5 * self._up_s)


class Board:
    """A board that switches emitters, samples, moves and answers.

    Attributes
    ----------
    lit
        Whether its emitters alternate.
    axis
        Its motor.
    """

    def __init__(self, hardware: Hardware, name: str) -> None:
        self._hardware, self._name = hardware, name
        self.lit, self.axis = False, Axis(hardware)
        self._coming, self._heard_us, self._begun_us = bytearray(), 0, 0
        self._period_us = self._emitters = self._inputs = 0
        self._frame, self._other, self._crc, self._late_crc = bytearray(), bytearray(), 0, 0
        self._number = self._half = 0
        self._late = False

    def work(self) -> bool:
        """Do the work that is due and return whether there was any; to be called as often as possible."""
        now = self._hardware.now_us()
        if self.axis.moving:
            self.axis.work(now)
        if self.lit and now - self._heard_us > WATCHDOG_US:
            self._dark()
        due = self._due_us(self._half + 1) if self.lit else now + 1
        if now < due:
            return self.axis.moving
        self._end_half(now - due)
        return True

    def next_us(self) -> "int | None":
        """Return the time at which the next half is due; None if the board does not sample."""
        return self._due_us(self._half + 1) if self.lit else None

    def hear(self, data: bytes) -> None:
        """Accept bytes from the host, and execute the commands that are complete."""
        if not data:
            return
        self._heard_us = self._hardware.now_us()
        self._coming += data
        while self._command():
            pass

    # ------------------------------------------------------------------------------------------------ periods

    def _start(self) -> None:
        self._number, self._begun_us, self.lit = 0, self._hardware.now_us(), True
        self._begin_period()

    def _dark(self) -> None:
        self.lit = False
        self._hardware.light(-1)

    def _due_us(self, half: int) -> int:
        """Return the time at which a half of the period begins."""
        period = self._period_us
        return self._begun_us + self._number * period + half * period // (2 * self._emitters)

    def _begin_period(self) -> None:
        self._hardware.light(0)
        self._half, self._late = 0, False
        stamp = (self._due_us(0) - self._begun_us) & 0xFFFFFFFF
        struct.pack_into("<I", self._frame, 6, self._number & 0xFFFFFFFF)
        struct.pack_into("<I", self._frame, HEAD_BYTES, stamp)
        self._frame[FLAGS_AT] = 0
        self._crc = crc_on(0xFFFF, self._frame, 2, HEAD_BYTES + PERIOD_BYTES)

    def _end_half(self, behind_us: int) -> None:
        size = 2 * self._inputs
        at = HEAD_BYTES + PERIOD_BYTES + self._half * size
        self._hardware.sample(self._frame, at, self._inputs)
        self._half += 1
        whole = self._half == 2 * self._emitters
        if not whole:
            self._hardware.light(-1 if self._half & 1 else self._half >> 1)
        self._late = self._late or behind_us * 2 * self._emitters * LATE_SHARE > self._period_us
        self._crc = crc_on(self._crc, self._frame, at, at + size)
        if whole:
            self._end_period()

    def _end_period(self) -> None:
        crc = self._crc
        if self._late:
            self._frame[FLAGS_AT] = LATE
            crc ^= self._late_crc
        struct.pack_into("<H", self._frame, len(self._frame) - 2, crc)
        frame, self._frame, self._other = self._frame, self._other, self._frame
        self._number += 1
        behind = (self._hardware.now_us() - self._due_us(0)) // self._period_us
        if behind > 0:  # periods that could not be sampled are missing by their numbers
            self._number += behind
        self._begin_period()
        self._hardware.send(frame)

    def _configure(self, payload: bytes) -> int:
        if len(payload) != 6:
            return UNFIT
        self._dark()
        period, emitters, inputs = struct.unpack("<IBB", payload)
        self._period_us = 0
        if not (emitters and inputs and period):
            return UNFIT
        if not self._hardware.fits(period // (2 * emitters), emitters, inputs):
            return UNFIT
        self._period_us, self._emitters, self._inputs = period, emitters, inputs
        size = PERIOD_BYTES + 4 * emitters * inputs
        self._frame = bytearray(HEAD_BYTES + size + 2)
        struct.pack_into("<HBBHIIBBBB", self._frame, 0, 0x5AA5, VERSION, SAMPLES, size, 0, 0, emitters, inputs, 0, 0)
        self._other = bytearray(self._frame)
        # the checksum is linear: its change due to the flag is independent of the samples
        flag = bytearray(size - 6)
        flag[0] = LATE
        self._late_crc = crc_on(0, flag, 0, len(flag))
        return DONE

    # ----------------------------------------------------------------------------------------------- commands

    def _command(self) -> bool:
        """Execute the next command; return False if no command is complete."""
        data = self._coming
        begin = data.find(b"\xa5\x5a")
        if begin < 0:
            self._coming = data[-1:] if data[-1:] == b"\xa5" else bytearray()
            return False
        if begin:
            self._coming = data = data[begin:]
        if len(data) < HEAD_BYTES + 2:
            return False
        length = data[4] | data[5] << 8
        end = HEAD_BYTES + length
        if length <= MAX_COMMAND_LENGTH and len(data) < end + 2:
            return False
        whole = length <= MAX_COMMAND_LENGTH and crc_on(0xFFFF, data, 2, end) == data[end] | data[end + 1] << 8
        if whole and data[2] == VERSION:
            self._do(data[3], bytes(data[HEAD_BYTES:end]))
        self._coming = data[end + 2 :] if whole else data[2:]
        return True

    def _do(self, kind: int, payload: bytes) -> None:
        """Execute a command and answer it."""
        status, words = DONE, b""
        if kind == IDENTIFY:
            words = self._name.encode()
        elif kind == CONFIGURE:
            status = self._configure(payload)
        elif kind == START:
            status = DONE if self._period_us else UNCONFIGURED
            if self._period_us and not self.lit:
                self._start()
        elif kind == STOP:
            self._dark()
        elif kind == ALIVE:
            return
        elif kind == TIME:
            words = struct.pack("<I", self._stamp())
        elif MOVE <= kind <= PLACE:
            status, words = self._motor(kind, payload)
        else:
            status = UNKNOWN
        self._answer(bytes((kind, status)) + words)

    def _motor(self, kind: int, payload: bytes) -> "tuple[int, bytes]":
        now, axis = self._hardware.now_us(), self.axis
        if not self._hardware.most_steps_per_s:
            return NO_MOTOR, b""
        if kind == WHERE:
            return DONE, struct.pack("<IiB", self._stamp(), axis.position, axis.moving)
        if kind == HALT:
            axis.halt(now)
        elif kind == PLACE and len(payload) == 4:
            axis.place(struct.unpack("<i", payload)[0])
        elif kind == MOVE and len(payload) == 12:
            target, milli_steps, acceleration = struct.unpack("<iII", payload)
            if axis.moving or not acceleration or not 0 < milli_steps <= 1000 * self._hardware.most_steps_per_s:
                return UNFIT, b""
            axis.send(now, target, 1e-3 * milli_steps, float(acceleration))
        else:
            return UNFIT, b""
        return DONE, b""

    def _stamp(self) -> int:
        """Return the board's clock in the form that stamps periods."""
        return (self._hardware.now_us() - self._begun_us) & 0xFFFFFFFF

    def _answer(self, payload: bytes) -> None:
        frame = bytearray(HEAD_BYTES + len(payload) + 2)
        struct.pack_into("<HBBHI", frame, 0, 0x5AA5, VERSION, ANSWER, len(payload), 0)
        frame[HEAD_BYTES : HEAD_BYTES + len(payload)] = payload
        struct.pack_into("<H", frame, len(frame) - 2, crc_on(0xFFFF, frame, 2, len(frame) - 2))
        self._hardware.send(frame)
