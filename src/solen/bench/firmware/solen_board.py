"""The core of the emitter board without hardware, for both MicroPython and CPython.

A loop calls `Board.work` as often as it can and `Board.receive` with the bytes from the host. A period is divided into
two halves for each emitter, on and off; at the end of each half every input is sampled, and then the emitters are
switched. The checksum is computed half by half, because one long computation would delay a half. A motor follows a ramp
by the same clock. Each kind of hardware implements `Hardware`; frames and commands are those of `solen.bench.frames`
and `solen.bench.board`, which this file does not import, because it is copied onto boards unchanged.

Public names: `Board` and `Hardware`.
"""

import struct
from array import array

VERSION, SAMPLES, REPLY = 1, 1, 2
IDENTIFY, CONFIGURE, START, STOP, ALIVE, TIME, MOVE, HALT, WHERE, PLACE = range(16, 26)
DONE, UNKNOWN, INVALID, UNCONFIGURED, NO_MOTOR = 0, 1, 2, 3, 5
LATE = 1
HEAD_BYTES, PERIOD_BYTES, MAX_COMMAND_LENGTH = 10, 8, 64
FLAGS_AT = HEAD_BYTES + 6
WATCHDOG_US = 800_000
"""Silence of the host in µs after which the emitters are switched off; less than a second, including a loop."""
LATE_DIVISOR = 8
"""A period is late if a half is sampled later than the duration of a half divided by this number."""


def _table() -> "array[int]":
    table = array("H", [0] * 256)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
        table[byte] = crc & 0xFFFF
    return table


TABLE = _table()


def crc_update(crc: int, data: "bytes | bytearray", begin: int, end: int) -> int:
    """Return the CRC-16/CCITT-FALSE, continued over ``data[begin:end]``."""
    table = TABLE
    for index in range(begin, end):
        crc = ((crc << 8) & 0xFFFF) ^ table[(crc >> 8) ^ data[index]]
    return crc


class Hardware:
    """Hardware of a board: the methods that each kind of board implements.

    Attributes
    ----------
    max_steps_per_s
        Highest step rate of its motor; 0 without a motor.
    """

    max_steps_per_s = 0

    def now_us(self) -> int:
        """Return the microseconds since an arbitrary origin; they never decrease and never wrap."""
        raise NotImplementedError  # MicroPython has no abc

    def light(self, emitter: int) -> None:
        """Switch one emitter on, counted from 0, and all others off; -1 switches all off."""
        raise NotImplementedError  # MicroPython has no abc

    def sample(self, buffer: bytearray, at: int, inputs: int) -> None:
        """Write the counts of the inputs to a buffer from an offset on, 2 bytes each, low byte first."""
        raise NotImplementedError  # MicroPython has no abc

    def send(self, data: bytearray) -> None:
        """Send bytes to the host; the buffer is reused afterwards."""
        raise NotImplementedError  # MicroPython has no abc

    def supports(self, half_us: int, emitters: int, inputs: int) -> bool:
        """Whether the board has so many emitters and inputs, and can sample the inputs within a half."""
        raise NotImplementedError  # MicroPython has no abc

    def step(self, position: int, forward: bool) -> None:
        """Move the motor by one step, to a position."""
        raise NotImplementedError  # MicroPython has no abc


class Axis:
    """A motor that follows a ramp from rest to rest, step by step.

    Attributes
    ----------
    position, moving
        Position in steps, and whether a ramp is in progress.
    """

    def __init__(self, hardware: Hardware) -> None:
        self._hardware = hardware
        self.position, self.moving = 0, False
        self._begin_us, self._start, self._sign = 0, 0, 1
        self._last_step_us = self._min_step_us = 0
        self._distance = self._velocity = self._acceleration = self._ramp_s = self._total_s = 0.0

    def move(self, now_us: int, target: int, velocity: float, acceleration: float) -> None:
        """Begin a ramp to a position, in steps, steps/s and steps/s²."""
        self._min_step_us = 1_000_000 // self._hardware.max_steps_per_s
        distance = float(abs(target - self.position))
        ramp_s = min(velocity / acceleration, (distance / acceleration) ** 0.5)
        uniform_s = (distance - acceleration * ramp_s * ramp_s) / velocity
        self._sign = 1 if target >= self.position else -1
        self._begin(now_us, distance, acceleration * ramp_s, acceleration, ramp_s, uniform_s)

    def halt(self, now_us: int) -> None:
        """Decelerate from the current position as at the end of the ramp, unless the axis is already halting."""
        if self.moving and self._ramp_s:
            elapsed = 1e-6 * (now_us - self._begin_us)
            speed = self._acceleration * min(elapsed, max(0.0, self._total_s - elapsed))
            speed = min(speed, self._velocity)
            self._begin(now_us, speed * speed / (2.0 * self._acceleration), speed, self._acceleration, 0.0, 0.0)

    def set_position(self, position: int) -> None:
        """Define the current position as a given value; nothing moves."""
        self.position, self.moving = position, False

    def work(self, now_us: int) -> None:
        """Make a step if the ramp is ahead of the motor and the shortest interval between steps has passed."""
        elapsed = 1e-6 * (now_us - self._begin_us)
        if self._sign * (self.position - self._start) < int(self._travelled(elapsed) + 0.5):
            if now_us - self._last_step_us >= self._min_step_us:
                self._last_step_us = now_us
                self.position += self._sign
                self._hardware.step(self.position, self._sign > 0)
        elif elapsed >= self._total_s:
            self.moving = False

    def _begin(
        self, now_us: int, distance: float, velocity: float, acceleration: float, ramp_s: float, uniform_s: float
    ) -> None:
        self._distance, self._velocity, self._acceleration, self._ramp_s = distance, velocity, acceleration, ramp_s
        self._total_s = ramp_s + max(uniform_s, 0.0) + velocity / acceleration
        self._begin_us, self._start, self.moving = now_us, self.position, True

    def _travelled(self, elapsed: float) -> float:
        """Return the steps travelled some time after the start of the ramp."""
        remaining = self._total_s - elapsed
        if remaining <= 0.0:
            return self._distance
        if elapsed < self._ramp_s:
            return 0.5 * self._acceleration * elapsed * elapsed
        if remaining < self._velocity / self._acceleration:
            return self._distance - 0.5 * self._acceleration * remaining * remaining
        return self._velocity * (elapsed - 0.5 * self._ramp_s)


class Board:
    """A board that switches emitters, samples inputs, moves a motor and replies to commands.

    Attributes
    ----------
    sampling
        Whether it switches the emitters and samples.
    axis
        Its motor.
    """

    def __init__(self, hardware: Hardware, name: str) -> None:
        self._hardware, self._name = hardware, name
        self.sampling, self.axis = False, Axis(hardware)
        self._received, self._last_byte_us, self._start_us = bytearray(), 0, 0
        self._period_us = self._emitters = self._inputs = 0
        self._frame, self._spare_frame, self._crc, self._late_crc = bytearray(), bytearray(), 0, 0
        self._number = self._half = 0
        self._late = False

    def work(self) -> bool:
        """Do the work that is due, and return whether there was any; to be called as often as possible."""
        now = self._hardware.now_us()
        if self.axis.moving:
            self.axis.work(now)
        if self.sampling and now - self._last_byte_us > WATCHDOG_US:
            self._stop()
        due = self._due_us(self._half + 1) if self.sampling else now + 1
        if now < due:
            return self.axis.moving
        self._end_half(now - due)
        return True

    def next_us(self) -> "int | None":
        """Return the time at which the next half is due; None if the board does not sample."""
        return self._due_us(self._half + 1) if self.sampling else None

    def receive(self, data: bytes) -> None:
        """Accept bytes from the host, and execute the commands that are complete."""
        if not data:
            return
        self._last_byte_us = self._hardware.now_us()
        self._received += data
        while self._next_command():
            pass

    # ------------------------------------------------------------------------------------------------ periods

    def _start(self) -> None:
        self._number, self._start_us, self.sampling = 0, self._hardware.now_us(), True
        self._begin_period()

    def _stop(self) -> None:
        self.sampling = False
        self._hardware.light(-1)

    def _due_us(self, half: int) -> int:
        """Return the time at which a half of the period begins."""
        period = self._period_us
        return self._start_us + self._number * period + half * period // (2 * self._emitters)

    def _begin_period(self) -> None:
        self._hardware.light(0)
        self._half, self._late = 0, False
        stamp = (self._due_us(0) - self._start_us) & 0xFFFFFFFF
        struct.pack_into("<I", self._frame, 6, self._number & 0xFFFFFFFF)
        struct.pack_into("<I", self._frame, HEAD_BYTES, stamp)
        self._frame[FLAGS_AT] = 0
        self._crc = crc_update(0xFFFF, self._frame, 2, HEAD_BYTES + PERIOD_BYTES)

    def _end_half(self, late_us: int) -> None:
        size = 2 * self._inputs
        at = HEAD_BYTES + PERIOD_BYTES + self._half * size
        self._hardware.sample(self._frame, at, self._inputs)
        self._half += 1
        is_last = self._half == 2 * self._emitters
        if not is_last:
            self._hardware.light(-1 if self._half & 1 else self._half >> 1)
        self._late = self._late or late_us * 2 * self._emitters * LATE_DIVISOR > self._period_us
        self._crc = crc_update(self._crc, self._frame, at, at + size)
        if is_last:
            self._end_period()

    def _end_period(self) -> None:
        crc = self._crc
        if self._late:
            self._frame[FLAGS_AT] = LATE
            crc ^= self._late_crc
        struct.pack_into("<H", self._frame, len(self._frame) - 2, crc)
        frame, self._frame, self._spare_frame = self._frame, self._spare_frame, self._frame
        self._number += 1
        missed = (self._hardware.now_us() - self._due_us(0)) // self._period_us
        if missed > 0:  # the numbers of periods that could not be sampled are skipped
            self._number += missed
        self._begin_period()
        self._hardware.send(frame)

    def _configure(self, payload: bytes) -> int:
        if len(payload) != 6:
            return INVALID
        self._stop()
        period, emitters, inputs = struct.unpack("<IBB", payload)
        self._period_us = 0
        if not (emitters and inputs and period):
            return INVALID
        if not self._hardware.supports(period // (2 * emitters), emitters, inputs):
            return INVALID
        self._period_us, self._emitters, self._inputs = period, emitters, inputs
        size = PERIOD_BYTES + 4 * emitters * inputs
        self._frame = bytearray(HEAD_BYTES + size + 2)
        struct.pack_into("<HBBHIIBBBB", self._frame, 0, 0x5AA5, VERSION, SAMPLES, size, 0, 0, emitters, inputs, 0, 0)
        self._spare_frame = bytearray(self._frame)
        # the checksum is linear: its change due to the flag is independent of the samples
        flag = bytearray(size - 6)
        flag[0] = LATE
        self._late_crc = crc_update(0, flag, 0, len(flag))
        return DONE

    # ----------------------------------------------------------------------------------------------- commands

    def _next_command(self) -> bool:
        """Execute the next command; return False if no command is complete."""
        data = self._received
        begin = data.find(b"\xa5\x5a")
        if begin < 0:
            self._received = data[-1:] if data[-1:] == b"\xa5" else bytearray()
            return False
        if begin:
            self._received = data = data[begin:]
        if len(data) < HEAD_BYTES + 2:
            return False
        length = data[4] | data[5] << 8
        end = HEAD_BYTES + length
        if length <= MAX_COMMAND_LENGTH and len(data) < end + 2:
            return False
        valid = length <= MAX_COMMAND_LENGTH and crc_update(0xFFFF, data, 2, end) == data[end] | data[end + 1] << 8
        if valid and data[2] == VERSION:
            self._execute(data[3], bytes(data[HEAD_BYTES:end]))
        self._received = data[end + 2 :] if valid else data[2:]
        return True

    def _execute(self, kind: int, payload: bytes) -> None:
        """Execute a command and reply to it."""
        status, data = DONE, b""
        if kind == IDENTIFY:
            data = self._name.encode()
        elif kind == CONFIGURE:
            status = self._configure(payload)
        elif kind == START:
            status = DONE if self._period_us else UNCONFIGURED
            if self._period_us and not self.sampling:
                self._start()
        elif kind == STOP:
            self._stop()
        elif kind == ALIVE:
            return
        elif kind == TIME:
            data = struct.pack("<I", self._stamp())
        elif MOVE <= kind <= PLACE:
            status, data = self._execute_motor(kind, payload)
        else:
            status = UNKNOWN
        self._reply(bytes((kind, status)) + data)

    def _execute_motor(self, kind: int, payload: bytes) -> "tuple[int, bytes]":
        """Execute a command to the motor, and return status and data of the reply."""
        now, axis = self._hardware.now_us(), self.axis
        if not self._hardware.max_steps_per_s:
            return NO_MOTOR, b""
        if kind == WHERE:
            return DONE, struct.pack("<IiB", self._stamp(), axis.position, axis.moving)
        if kind == HALT:
            axis.halt(now)
        elif kind == PLACE and len(payload) == 4:
            axis.set_position(struct.unpack("<i", payload)[0])
        elif kind == MOVE and len(payload) == 12:
            target, milli_steps_per_s, acceleration = struct.unpack("<iII", payload)
            if axis.moving or not acceleration:
                return INVALID, b""
            if not 0 < milli_steps_per_s <= 1000 * self._hardware.max_steps_per_s:
                return INVALID, b""
            axis.move(now, target, 1e-3 * milli_steps_per_s, float(acceleration))
        else:
            return INVALID, b""
        return DONE, b""

    def _stamp(self) -> int:
        """Return the time of the board clock as in the frames of samples."""
        return (self._hardware.now_us() - self._start_us) & 0xFFFFFFFF

    def _reply(self, payload: bytes) -> None:
        frame = bytearray(HEAD_BYTES + len(payload) + 2)
        struct.pack_into("<HBBHI", frame, 0, 0x5AA5, VERSION, REPLY, len(payload), 0)
        frame[HEAD_BYTES : HEAD_BYTES + len(payload)] = payload
        struct.pack_into("<H", frame, len(frame) - 2, crc_update(0xFFFF, frame, 2, len(frame) - 2))
        self._hardware.send(frame)
