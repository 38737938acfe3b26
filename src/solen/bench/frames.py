"""The wire format of the emitter board: frames with a checksum and a number, read from an unreliable stream.

In each period the board switches its emitters on one after the other and samples every receiver with the emitter on and
with it off again. One frame contains one period; a lost frame is a lost period, and the frame numbers show it. A frame
counts only if its checksum is right; after an error the reader searches for the next two bytes that begin a frame. All
numbers are little-endian:

====== ===== ========================================================================================== offset bytes
content ====== ===== ========================================================================================== 0      2
A5 5A, the beginning 2      1     version of this table, 1 3      1     kind: 1 samples, 2 answer, 16 and above commands
4      2     length of the payload, n 6      4     number of the frame, increased by one for each frame, from 0 again
after 2³² − 1 10     n     payload 10 + n 2     CRC-16/CCITT-FALSE (polynomial 1021h, from FFFFh) of bytes 2 to 9 + n
====== ===== ==========================================================================================

The payload of samples: time of the period's start by the board's clock in µs (4 bytes, wraps), number of emitters E,
number of receivers R, flags (1 for a late period, 2 for a faulty emitter; a reader adds 4 to the first period after a
restart, at which the board's clock begins again at 0), one zero byte, then for each emitter R samples with it on and R
with it off, 2 bytes each, in counts of the converter.

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
SAMPLES, ANSWER = 1, 2
LATE, FAULT, ANEW = 1, 2, 4
UNSOUND = LATE | FAULT
"""Periods with these flags give no readings."""
LONGEST_PAYLOAD = 4096
"""Longest payload in bytes, more than 16 emitters and 64 receivers need; a greater length is corrupt."""
Other = tuple[int, bytes]
"""Kind and payload of a frame, unprocessed."""
RESTART_AFTER = 3
"""Number of consecutive frames with repeated numbers that indicates a restart of the board."""
HEAD = struct.Struct("<2sBBHI")
PERIOD = struct.Struct("<IBBBx")
_CRC = struct.Struct("<H")
_WRAP = 1 << 32


@dataclass(frozen=True)
class Layout:
    """Number of alternating emitters, and of receivers read at each.

    Raises
    ------
    BenchError
        If one of the numbers is 0, or there are more than a frame can contain.
    """

    emitters: int
    receivers: int

    def __post_init__(self) -> None:
        for name, value in (("emitters", self.emitters), ("receivers", self.receivers)):
            if not 1 <= value <= 255:
                raise BenchError(name, value=value, limit="must be 1 to 255")
        if self.payload_bytes > LONGEST_PAYLOAD:
            limit = (
                f"with {self.receivers} receivers need {self.payload_bytes} bytes; a frame "
                f"has at most {LONGEST_PAYLOAD}"
            )
            raise BenchError("emitters", value=self.emitters, limit=limit, remedy="use fewer")

    @property
    def values(self) -> int:
        """Number of samples in a period: on and off, of each receiver, for each emitter."""
        return 2 * self.emitters * self.receivers

    @property
    def payload_bytes(self) -> int:
        """Length of the payload of a period."""
        return PERIOD.size + 2 * self.values


@dataclass(frozen=True, eq=False)
class Periods:
    """Periods in order, without duplicates.

    Attributes
    ----------
    number
        Number of the period since the first, shape (N,), continued when the transmitted number wraps.
    board_us
        Start by the board's clock in µs, shape (N,), continued when it wraps, but reset when the board restarts.
    flags
        `LATE`, `FAULT`, and `ANEW` for the first period after a restart of the board, shape (N,).
    counts
        Shape (N, emitters, 2, receivers): 0 with the emitter on, 1 with it off again.
    """

    number: NDArray[np.int64]
    board_us: NDArray[np.int64]
    flags: NDArray[np.uint8]
    counts: NDArray[np.uint16]

    def __len__(self) -> int:
        return len(self.number)

    def __getitem__(self, which: Any) -> "Periods":
        """Return some of the periods."""
        return Periods(self.number[which], self.board_us[which], self.flags[which], self.counts[which])

    @staticmethod
    def joined(parts: Sequence["Periods"], layout: "Layout") -> "Periods":
        """Return the concatenated parts; an empty result if there are none."""
        nothing = np.zeros((0, layout.emitters, 2, layout.receivers), np.uint16)
        return Periods(
            np.concatenate([np.zeros(0, np.int64), *(part.number for part in parts)]),
            np.concatenate([np.zeros(0, np.int64), *(part.board_us for part in parts)]),
            np.concatenate([np.zeros(0, np.uint8), *(part.flags for part in parts)]),
            np.concatenate([nothing, *(part.counts for part in parts)]),
        )


@dataclass
class Losses:
    """Numbers of losses in a stream.

    Attributes
    ----------
    dropped
        Periods whose numbers never arrived.
    garbled
        Beginnings of frames whose checksum is wrong; their periods also count as dropped.
    doubled
        Periods that arrived again or late, and were discarded.
    restarts
        How often the board restarted and counted from 0; how long it was off is unknown.
    other
        Complete frames of another layout or version.
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
    """Return the CRC-16/CCITT-FALSE; for ``b"123456789"`` it is 29B1h."""
    return binascii.crc_hqx(data, 0xFFFF)


def frame(kind: int, number: int, payload: bytes) -> bytes:
    """Return one frame around a payload."""
    if len(payload) > LONGEST_PAYLOAD:
        raise BenchError("payload", value=len(payload), limit=f"a frame has at most {LONGEST_PAYLOAD} bytes")
    body = HEAD.pack(SYNC, VERSION, kind, len(payload), number % _WRAP) + payload
    return body + _CRC.pack(checksum(memoryview(body)[2:]))


def sample_frames(layout: Layout, periods: Periods) -> bytes:
    """Return the frames of many periods, one after the other, as the board sends them."""
    heads = zip(periods.number.tolist(), periods.board_us.tolist(), periods.flags.tolist(), strict=True)
    samples = np.ascontiguousarray(periods.counts, "<u2").reshape(len(periods), layout.values)
    counts = layout.emitters, layout.receivers
    return b"".join(
        frame(SAMPLES, number, PERIOD.pack(us % _WRAP, *counts, flags) + row.tobytes())
        for (number, us, flags), row in zip(heads, samples, strict=True)
    )


@dataclass
class FrameReader:
    """Reads frames from bytes as they arrive, in pieces of any length.

    Attributes
    ----------
    layout
        Layout of the expected periods; others are counted as `Losses.other`.
    losses
        Losses since the reader was created.
    answers
        Payloads of `ANSWER` frames that have not been fetched yet.
    every_kind
        Keep all frames unprocessed in ``others``, with kind and payload; a board reads commands in this way.
    """

    layout: Layout
    every_kind: bool = False
    losses: Losses = field(default_factory=Losses, init=False)
    answers: list[bytes] = field(default_factory=list, init=False)
    others: list[Other] = field(default_factory=list, init=False)
    _waiting: bytearray = field(default_factory=bytearray, init=False)
    _next: int | None = field(default=None, init=False)
    _shift: int = field(default=0, init=False)
    _again: tuple[int, int] = field(default=(-2, 0), init=False)
    _us: int | None = field(default=None, init=False)

    def feed(self, data: bytes) -> Periods:
        """Return the periods that these bytes complete."""
        self._waiting += data
        numbers: list[int] = []
        times: list[int] = []
        flags: list[int] = []
        rows: list[bytes] = []
        for kind, wire_number, payload in self._frames():
            if self.every_kind:
                self.others.append((kind, payload))
                continue
            if kind == ANSWER:
                self.answers.append(payload)
                continue
            us, emitters, receivers, flag = PERIOD.unpack_from(payload) if len(payload) >= PERIOD.size else (0, 0, 0, 0)
            fits = (emitters, receivers, len(payload)) == (*self._counts, self.layout.payload_bytes)
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
            flags.append(flag | ANEW if self.losses.restarts > restarts else flag & ~ANEW)
            rows.append(payload[PERIOD.size :])
        shape = (len(rows), self.layout.emitters, 2, self.layout.receivers)
        counts = np.frombuffer(b"".join(rows), "<u2").astype(np.uint16).reshape(shape)
        return Periods(np.array(numbers, np.int64), np.array(times, np.int64), np.array(flags, np.uint8), counts)

    @property
    def _counts(self) -> tuple[int, int]:
        return self.layout.emitters, self.layout.receivers

    def _frames(self) -> Iterator[tuple[int, int, bytes]]:
        """Return kind, number and payload of each complete frame; other bytes are counted and discarded."""
        data, at = bytes(self._waiting), 0
        while (found := self._begin(data, at)) + HEAD.size + _CRC.size <= len(data):
            at = found
            _, version, kind, length, number = HEAD.unpack_from(data, at)
            end = at + HEAD.size + length + _CRC.size
            if length > LONGEST_PAYLOAD:
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
            at = found
        del self._waiting[:at]

    def _begin(self, data: bytes, at: int) -> int:
        """Return the position of the next frame mark; without one, the end of the data, less a possible half mark."""
        if data[at : at + 2] == SYNC:
            return at
        found = data.find(SYNC, at)
        if found < 0:
            found = max(at, len(data) - 1 if data.endswith(SYNC[:1]) else len(data))
        self.losses.skipped_bytes += found - at
        return found

    def _skip(self, at: int) -> int:
        """Skip two bytes that resembled the beginning of a frame."""
        self.losses.skipped_bytes += 2
        return at + 2

    def _unwrapped(self, wire_number: int) -> int | None:
        """Return the number since the first, including missing ones; None for a number that has occurred before."""
        if self._next is None:
            self._next = wire_number
        ahead = (wire_number + self._shift - self._next) % _WRAP
        if ahead >= _WRAP // 2:
            if not self._restarted(wire_number):
                return None
            ahead = 0
        self._again = (-2, 0)
        self.losses.dropped += ahead
        number = self._next + ahead
        self._next = number + 1
        return number

    def _restarted(self, wire_number: int) -> bool:
        """Whether repeated numbers follow one another, which means that the board has restarted."""
        before, run = self._again
        run = run + 1 if wire_number == before + 1 else 1
        self._again = (wire_number, run)
        if run < RESTART_AFTER or self._next is None:
            return False
        self.losses.restarts += 1
        self._shift, self._us = self._next - wire_number, None
        return True

    def unwrapped_us(self, us: int) -> int:
        """Return a time of the board in µs on the unwrapped count of its last period."""
        if self._us is None:
            return us
        return self._us + (us - self._us + _WRAP // 2) % _WRAP - _WRAP // 2

    def _time(self, us: int) -> int:
        """Return the time of the board, continued when its counter wraps around."""
        self._us = us if self._us is None else self._us + (us - self._us) % _WRAP
        return self._us
