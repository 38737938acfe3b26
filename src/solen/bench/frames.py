"""The wire of the emitter board: frames with a checksum and a number, read from a stream that may lose or garble some.

The idea: in each period the board lights its emitters one after the other and samples every receiver with the emitter
on and with it off again. One frame carries one period, so a lost frame is a lost period, and the frame numbers show it.
A frame counts only if its checksum is right; a reader that lost its place looks for the next two
bytes that begin a frame. All numbers are little-endian:

====== ===== ==========================================================================================
offset bytes what
====== ===== ==========================================================================================
0      2     A5 5A, the beginning
2      1     version of this table, 1
3      1     kind: 1 samples, 2 answer, 16 and above commands
4      2     length of the payload, n
6      4     number of the frame, one more each time, from 0 again after 2³² − 1
10     n     payload
10 + n 2     CRC-16/CCITT-FALSE (polynomial 1021h, from FFFFh) of bytes 2 to 9 + n
====== ===== ==========================================================================================

The payload of samples: time of the period's start by the board's clock in µs (4 bytes, wraps), number of emitters E,
number of receivers R, flags (1 where a period was late, 2 where an emitter is at fault; a reader adds 4 to the first
period after a restart, where the board's clock begins anew), one byte of nought, then for
each emitter R samples with it on and R with it off, 2 bytes each, as the converter counts.

The interface: `Layout`; `sample_frames` makes frames of many periods at once, `frame` any one; `FrameReader.feed` takes
bytes as they come and gives `Periods`; `Losses` counts what was not believed or not there.
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
"""More than 16 emitters and 64 receivers need; a length beyond it is a garbled one."""
Other = tuple[int, bytes]
"""Kind and payload of a frame, unprocessed."""
RESTART_AFTER = 3
"""Frames with numbers that were there before, each one more than the last, that make a restart of the board."""
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
        If there are none, or more than a frame can hold.
    """

    emitters: int
    receivers: int

    def __post_init__(self) -> None:
        for name, value in (("emitters", self.emitters), ("receivers", self.receivers)):
            if not 1 <= value <= 255:
                raise BenchError(name, value=value, limit="must be 1 to 255")
        if self.payload_bytes > LONGEST_PAYLOAD:
            limit = f"with {self.receivers} receivers need {self.payload_bytes} bytes; a frame holds {LONGEST_PAYLOAD}"
            raise BenchError("emitters", value=self.emitters, limit=limit, remedy="use fewer")

    @property
    def values(self) -> int:
        """Samples of a period: on and off, of each receiver, at each emitter."""
        return 2 * self.emitters * self.receivers

    @property
    def payload_bytes(self) -> int:
        """Length of the payload of a period."""
        return PERIOD.size + 2 * self.values


@dataclass(frozen=True, eq=False)
class Periods:
    """Periods in order, each once.

    Attributes
    ----------
    number
        Number of the period since the first, shape (N,), continued when the transmitted number wraps.
    board_us
        Start by the board's clock in µs, shape (N,), continued likewise, but reset when the board restarts.
    flags
        `LATE`, `FAULT`, and `ANEW` at the first period after a restart of the board, shape (N,).
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
        """Some of the periods."""
        return Periods(self.number[which], self.board_us[which], self.flags[which], self.counts[which])

    @staticmethod
    def joined(parts: Sequence["Periods"], layout: "Layout") -> "Periods":
        """Concatenated parts; empty without any."""
        nothing = np.zeros((0, layout.emitters, 2, layout.receivers), np.uint16)
        return Periods(
            np.concatenate([np.zeros(0, np.int64), *(part.number for part in parts)]),
            np.concatenate([np.zeros(0, np.int64), *(part.board_us for part in parts)]),
            np.concatenate([np.zeros(0, np.uint8), *(part.flags for part in parts)]),
            np.concatenate([nothing, *(part.counts for part in parts)]),
        )


@dataclass
class Losses:
    """Losses of a stream, all counted.

    Attributes
    ----------
    dropped
        Periods whose numbers never came.
    garbled
        Beginnings of frames whose checksum is wrong; their periods are among the dropped.
    doubled
        Periods that came again, or late, and were not taken twice.
    restarts
        How often the board restarted and counted from 0; how long it was away is unknown.
    other
        Whole frames of another layout or version.
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
    """CRC-16/CCITT-FALSE; of ``b"123456789"`` it is 29B1h."""
    return binascii.crc_hqx(data, 0xFFFF)


def frame(kind: int, number: int, payload: bytes) -> bytes:
    """One frame around a payload."""
    if len(payload) > LONGEST_PAYLOAD:
        raise BenchError("payload", value=len(payload), limit=f"a frame holds {LONGEST_PAYLOAD} bytes")
    body = HEAD.pack(SYNC, VERSION, kind, len(payload), number % _WRAP) + payload
    return body + _CRC.pack(checksum(memoryview(body)[2:]))


def sample_frames(layout: Layout, periods: Periods) -> bytes:
    """Frames of many periods, one after the other, as the board sends them."""
    heads = zip(periods.number.tolist(), periods.board_us.tolist(), periods.flags.tolist(), strict=True)
    samples = np.ascontiguousarray(periods.counts, "<u2").reshape(len(periods), layout.values)
    counts = layout.emitters, layout.receivers
    return b"".join(
        frame(SAMPLES, number, PERIOD.pack(us % _WRAP, *counts, flags) + row.tobytes())
        for (number, us, flags), row in zip(heads, samples, strict=True)
    )


@dataclass
class FrameReader:
    """Reads frames from bytes as they come, in pieces of any length.

    Attributes
    ----------
    layout
        Layout of the expected periods; others are counted as `Losses.other`.
    losses
        Losses so far.
    answers
        Payloads of `ANSWER` frames that nobody has taken yet.
    every_kind
        Keep all frames as they are in ``others``, kind and payload: how a board reads commands.
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
        """Periods that are complete with these bytes."""
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
        """Kind, number and payload of each whole frame; other bytes are counted and dropped."""
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
        """Where the next frame begins, or the end but for a byte that may be its first."""
        if data[at : at + 2] == SYNC:
            return at
        found = data.find(SYNC, at)
        if found < 0:
            found = max(at, len(data) - 1 if data.endswith(SYNC[:1]) else len(data))
        self.losses.skipped_bytes += found - at
        return found

    def _skip(self, at: int) -> int:
        """Past two bytes that only looked like a beginning."""
        self.losses.skipped_bytes += 2
        return at + 2

    def _unwrapped(self, wire_number: int) -> int | None:
        """Number since the first, counting what is missing; None for a number that came before."""
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
        """Whether numbers that came before follow one another: then the board has restarted."""
        before, run = self._again
        run = run + 1 if wire_number == before + 1 else 1
        self._again = (wire_number, run)
        if run < RESTART_AFTER or self._next is None:
            return False
        self.losses.restarts += 1
        self._shift, self._us = self._next - wire_number, None
        return True

    def unwrapped_us(self, us: int) -> int:
        """A time of the board on the count of its last period's."""
        if self._us is None:
            return us
        return self._us + (us - self._us + _WRAP // 2) % _WRAP - _WRAP // 2

    def _time(self, us: int) -> int:
        """Time of the board, continued where its counter wraps around."""
        self._us = us if self._us is None else self._us + (us - self._us) % _WRAP
        return self._us
