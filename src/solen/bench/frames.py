"""The wire format of the emitter board: numbered frames with a checksum, read from an unreliable stream.

In each period the board switches its emitters on one after the other and samples every receiver, first with the emitter
on and then with it off again. A frame contains one period; a lost frame is a lost period, which the frame numbers
reveal. A frame is valid only if its checksum is correct; after an error the reader searches for the next frame mark.
All numbers are little-endian. A frame contains, by offset in bytes:

- 0 (2 bytes): A5 5A, the frame mark
- 2 (1 byte): version of this format, 1
- 3 (1 byte): kind: 1 for samples, 2 for a reply, 16 and above for commands
- 4 (2 bytes): length n of the payload
- 6 (4 bytes): frame number, which increases by one with each frame and wraps after 2³² − 1
- 10 (n bytes): payload
- 10 + n (2 bytes): CRC-16/CCITT-FALSE (polynomial 1021h, initial value FFFFh) of bytes 2 to 9 + n

The payload of a frame of samples: start of the period by the board clock in µs (4 bytes, wraps), number of emitters E,
number of receivers R, flags (1 for a late period, 2 for a faulty emitter; the reader adds 4 to the first period after a
restart, which resets the board clock to 0), one zero byte, then for each emitter R samples with the emitter on and R
with it off, in counts of the ADC (2 bytes each).

Public names: `Layout`, `sample_frames`, `frame`, `FrameReader`, `Periods` and `Losses`.
"""

import binascii
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.errors import BenchError

SYNC = b"\xa5\x5a"
VERSION = 1
SAMPLES, REPLY = 1, 2
LATE, FAULT, RESTARTED = 1, 2, 4
INVALID = LATE | FAULT
"""Periods with one of these flags give no readings."""
MAX_PAYLOAD_BYTES = 4096
"""Longest payload in bytes, enough for 16 emitters and 63 receivers; a greater length is corrupt."""
RESTART_FRAMES = 3
"""Number of consecutive frames with repeated numbers that indicate a restart of the board."""
HEAD = struct.Struct("<2sBBHI")
PERIOD = struct.Struct("<IBBBx")
_CRC = struct.Struct("<H")
_WRAP = 1 << 32


@dataclass(frozen=True)
class Layout:
    """Number of alternating emitters, and number of receivers sampled for each emitter.

    Raises
    ------
    BenchError
        If one of the numbers is not 1 to 255, or if a frame cannot contain so many samples.
    """

    emitters: int
    receivers: int

    def __post_init__(self) -> None:
        for name, value in (("emitters", self.emitters), ("receivers", self.receivers)):
            if not 1 <= value <= 255:
                raise BenchError(name, value=value, limit="must be 1 to 255")
        if self.payload_bytes > MAX_PAYLOAD_BYTES:
            limit = (
                f"with {self.receivers} receivers would give frames with a payload of {self.payload_bytes} bytes, but "
                f"at most {MAX_PAYLOAD_BYTES} are possible"
            )
            raise BenchError("emitters", value=self.emitters, limit=limit, remedy="use fewer emitters or receivers")

    @property
    def values(self) -> int:
        """Number of samples in a period: on and off, for each receiver and each emitter."""
        return 2 * self.emitters * self.receivers

    @property
    def payload_bytes(self) -> int:
        """Length of the payload of a period in bytes."""
        return PERIOD.size + 2 * self.values


@dataclass(frozen=True, eq=False)
class Periods:
    """Periods in order, without duplicates.

    Attributes
    ----------
    number
        Number of the period, (N,), unwrapped.
    board_us
        Start of the period by the board clock in µs, (N,), unwrapped, but reset when the board restarts.
    flags
        `LATE`, `FAULT`, and `RESTARTED` for the first period after a restart of the board, (N,).
    counts
        ADC counts (N, emitters, 2, receivers); on the third axis, 0 is with the emitter on, 1 with it off again.
    """

    number: NDArray[np.int64]
    board_us: NDArray[np.int64]
    flags: NDArray[np.uint8]
    counts: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, which: Any) -> "Periods":
        """Return the periods selected by an index, a slice or a mask."""
        return Periods(self.number[which], self.board_us[which], self.flags[which], self.counts[which])

    @staticmethod
    def joined(parts: Sequence["Periods"], layout: "Layout") -> "Periods":
        """Return the concatenated parts; without parts, no periods."""
        nothing = np.zeros((0, layout.emitters, 2, layout.receivers), np.uint16)
        return Periods(
            np.concatenate([np.zeros(0, np.int64), *(part.number for part in parts)]),
            np.concatenate([np.zeros(0, np.int64), *(part.board_us for part in parts)]),
            np.concatenate([np.zeros(0, np.uint8), *(part.flags for part in parts)]),
            np.concatenate([nothing, *(part.counts for part in parts)]),
        )


@dataclass
class Losses:
    """Counts of lost and discarded data.

    Attributes
    ----------
    dropped
        Periods whose numbers never arrived.
    garbled
        Frames with a wrong checksum; their periods are also counted as dropped.
    doubled
        Periods that were discarded because they arrived twice or out of order.
    restarts
        Restarts of the board, which then counts from 0 again; the duration of each interruption is unknown.
    other
        Complete frames with another layout or version.
    skipped_bytes
        Bytes that belong to no frame.
    """

    dropped: int = 0
    garbled: int = 0
    doubled: int = 0
    restarts: int = 0
    other: int = 0
    skipped_bytes: int = 0


def checksum(data: bytes | memoryview) -> int:
    """Return the CRC-16/CCITT-FALSE of bytes; for ``b"123456789"`` it is 29B1h."""
    return binascii.crc_hqx(data, 0xFFFF)


def frame(kind: int, number: int, payload: bytes) -> bytes:
    """Return a frame with a payload."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise BenchError("payload length", value=len(payload), limit=f"must be at most {MAX_PAYLOAD_BYTES} bytes")
    body = HEAD.pack(SYNC, VERSION, kind, len(payload), number % _WRAP) + payload
    return body + _CRC.pack(checksum(memoryview(body)[2:]))


def sample_frames(layout: Layout, periods: Periods) -> bytes:
    """Return the frames that contain the given periods, concatenated as the board sends them."""
    heads = zip(periods.number.tolist(), periods.board_us.tolist(), periods.flags.tolist(), strict=True)
    samples = np.ascontiguousarray(periods.counts, "<u2").reshape(len(periods), layout.values)
    counts = layout.emitters, layout.receivers
    return b"".join(
        frame(SAMPLES, number, PERIOD.pack(us % _WRAP, *counts, flags) + row.tobytes())
        for (number, us, flags), row in zip(heads, samples, strict=True)
    )


@dataclass
class FrameReader:
    """A reader of frames from bytes that arrive in chunks of any length.

    Attributes
    ----------
    layout
        Layout of the expected periods; frames with another layout are counted as `Losses.other`.
    losses
        Counts of lost and discarded data since the reader was created.
    replies
        Payloads of the `REPLY` frames that have not been fetched yet.
    """

    layout: Layout
    losses: Losses = field(default_factory=Losses, init=False)
    replies: list[bytes] = field(default_factory=list, init=False)
    _buffer: bytearray = field(default_factory=bytearray, init=False)
    _next: int | None = field(default=None, init=False)
    _shift: int = field(default=0, init=False)
    _repeated: tuple[int, int] = field(default=(-2, 0), init=False)
    _us: int | None = field(default=None, init=False)

    def feed(self, data: bytes) -> Periods:
        """Return the periods that these bytes complete."""
        self._buffer += data
        numbers: list[int] = []
        times: list[int] = []
        flags: list[int] = []
        rows: list[bytes] = []
        for kind, wire_number, payload in self._frames():
            if kind == REPLY:
                self.replies.append(payload)
                continue
            us, emitters, receivers, flag = PERIOD.unpack_from(payload) if len(payload) >= PERIOD.size else (0, 0, 0, 0)
            expected = self.layout.emitters, self.layout.receivers, self.layout.payload_bytes
            fits = (emitters, receivers, len(payload)) == expected
            if kind != SAMPLES or not fits:
                self.losses.other += 1
                continue
            restarts = self.losses.restarts
            number = self._unwrapped(wire_number)
            if number is None:
                self.losses.doubled += 1
                continue
            numbers.append(number)
            times.append(self._time(us))
            flags.append(flag | RESTARTED if self.losses.restarts > restarts else flag & ~RESTARTED)
            rows.append(payload[PERIOD.size :])
        shape = (len(rows), self.layout.emitters, 2, self.layout.receivers)
        counts = np.frombuffer(b"".join(rows), "<u2").astype(np.uint16).reshape(shape)
        return Periods(np.array(numbers, np.int64), np.array(times, np.int64), np.array(flags, np.uint8), counts)

    def _frames(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield kind, number and payload of each complete frame; all other bytes are counted and discarded."""
        data, at = bytes(self._buffer), 0
        while (begin := self._next_mark(data, at)) + HEAD.size + _CRC.size <= len(data):
            at = begin
            _, version, kind, length, number = HEAD.unpack_from(data, at)
            end = at + HEAD.size + length + _CRC.size
            if length > MAX_PAYLOAD_BYTES:
                at = self._skip(at)
                continue
            if end > len(data):
                break
            if checksum(data[at + 2 : end - 2]) != _CRC.unpack_from(data, end - 2)[0]:
                self.losses.garbled += 1
                at = self._skip(at)
                continue
            at = end
            if version != VERSION:
                self.losses.other += 1
                continue
            yield kind, number, data[end - length - 2 : end - 2]
        else:
            at = begin
        del self._buffer[:at]

    def _next_mark(self, data: bytes, at: int) -> int:
        """Return the offset of the next frame mark; without one, that of a half mark at the end, or of the end."""
        if data[at : at + 2] == SYNC:
            return at
        mark = data.find(SYNC, at)
        if mark < 0:
            mark = max(at, len(data) - 1 if data.endswith(SYNC[:1]) else len(data))
        self.losses.skipped_bytes += mark - at
        return mark

    def _skip(self, at: int) -> int:
        """Skip two bytes that were mistaken for a frame mark."""
        self.losses.skipped_bytes += 2
        return at + 2

    def _unwrapped(self, wire_number: int) -> int | None:
        """Return the unwrapped number of a frame, and count the missing frames; None if its number is repeated."""
        if self._next is None:
            self._next = wire_number
        ahead = (wire_number + self._shift - self._next) % _WRAP
        if ahead >= _WRAP // 2:
            if not self._restarted(wire_number):
                return None
            ahead = 0
        self._repeated = (-2, 0)
        self.losses.dropped += ahead
        number = self._next + ahead
        self._next = number + 1
        return number

    def _restarted(self, wire_number: int) -> bool:
        """Whether enough consecutive frames have repeated numbers to indicate a restart of the board."""
        before, run = self._repeated
        run = run + 1 if wire_number == before + 1 else 1
        self._repeated = (wire_number, run)
        if run < RESTART_FRAMES or self._next is None:
            return False
        self.losses.restarts += 1
        self._shift, self._us = self._next - wire_number, None
        return True

    def unwrapped_us(self, us: int) -> int:
        """Return a time of the board clock in µs, unwrapped like that of the last period."""
        if self._us is None:
            return us
        return self._us + (us - self._us + _WRAP // 2) % _WRAP - _WRAP // 2

    def _time(self, us: int) -> int:
        """Return the unwrapped time of the board clock in µs."""
        self._us = us if self._us is None else self._us + (us - self._us) % _WRAP
        return self._us
