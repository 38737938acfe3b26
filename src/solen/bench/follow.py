"""Reading the journal of a run while it grows: readings are available as soon as their period is written.

A journal record is either complete or missing; reading on after the last complete record therefore neither misses nor
repeats anything. A period is demodulated together with the preceding one, whose last off phase the first emitter needs.
Times are those of the board clock since the first period of the part, because the line to the run's clock is fitted
only after the end of the run.

Public name: `JournalFollower`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.bench.journal import read_from, read_journal
from solen.bench.journal_content import Rows, dtypes_of
from solen.bench.readings import BoardAdc, View, demodulated, valid, views_of
from solen.bench.records import END, ROWS
from solen.errors import DataError


@dataclass(frozen=True, eq=False)
class NewReadings:
    """New readings: times (n,), left and right readings (n, 2), and which of these are clipped (n, 2).

    For a network, the latter two are (n, emitters, receivers), and a missing reading is NaN.
    """

    time_s: FloatArray
    volts: FloatArray
    clipped: NDArray[np.bool_]


class JournalFollower:
    """A journal that is read while it grows.

    Raises
    ------
    DataError
        If the file is not a journal, or contains no periods of a board.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.ended = False
        self.header = read_journal(path).header
        self._dtypes = dtypes_of(self.header, path)
        if "board" not in self._dtypes:
            limit = "was recorded without a board; only the readings of a board are available during a run"
            remedy = "close it with solen bench recover, and decode the recording"
            raise DataError(str(path), limit=limit, remedy=remedy)
        self._stream = list(self._dtypes).index("board")
        self._offset = 0
        self._last: Rows | None = None
        self._begun_us: dict[int, int] = {}

    def readings(self, sensor: str) -> Iterator[NewReadings]:
        """Yield the readings of a sensor that are new since the last call, one item for each part of the run."""
        view = next(view for view in views_of(self.header) if view.name == sensor)
        for periods in self._new_periods():
            new = self._demodulated(*self._with_previous(periods), view)  # right before left
            yield NewReadings(new.time_s, new.volts[:, ::-1], new.clipped[:, ::-1])

    def network_readings(self, sensor: str) -> Iterator[NewReadings]:
        """Yield the readings of a network that are new since the last call, one item for each part of the run."""
        views = [view for view in views_of(self.header) if view.sensor["name"] == sensor]
        for periods in self._new_periods():
            rows, time_s, first = self._with_previous(periods)
            signal = np.full((len(periods), len(views), len(views[0].inputs)), np.nan)
            clipped = np.zeros(signal.shape, bool)
            for emitter, view in enumerate(views):
                new = self._demodulated(rows, time_s, first, view)
                period = np.searchsorted(time_s, new.time_s, "right") - 1 - first
                signal[period, emitter], clipped[period, emitter] = new.volts, new.clipped
            yield NewReadings(time_s[first:], signal, clipped)

    def _new_periods(self) -> list[Rows]:
        """Return the new periods, split by part; if the journal no longer exists, its run has ended."""
        try:
            records, self._offset = read_from(self._path, self._offset)
        except OSError:
            records, self.ended = [], True
        self.ended |= any(kind == END for kind, _, _ in records)
        data = b"".join(payload for kind, stream, payload in records if kind == ROWS and stream == self._stream)
        periods = np.frombuffer(data, self._dtypes["board"])
        edges = np.flatnonzero(np.diff(periods["part"].astype(np.int64))) + 1
        return np.split(periods, edges) if len(periods) else []

    def _with_previous(self, periods: Rows) -> tuple[Rows, FloatArray, int]:
        """Return the preceding period, if any, and the new ones; their times; and the index of the first new one."""
        part = int(periods["part"][0])
        previous = self._last if self._last is not None and int(self._last["part"][0]) == part else periods[:0]
        self._last = periods[-1:]
        begun_us = self._begun_us.setdefault(part, int(periods["board_us"][0]))
        rows = np.concatenate([previous, periods])
        return rows, 1e-6 * (rows["board_us"] - begun_us).astype(np.float64), len(previous)

    def _demodulated(self, rows: Rows, time_s: FloatArray, first: int, view: View) -> NewReadings:
        """Return the readings under one emitter from period ``first`` on, with the receivers in the view's order."""
        inputs = [number - 1 for number in view.inputs.values()]
        readings = demodulated(rows["counts"], time_s, view.emitter, inputs, BoardAdc.of(self.header))
        kept = readings.of(view.emitter) & (readings.time_s >= time_s[first])
        kept &= valid(rows["flags"], time_s, readings.time_s)
        return NewReadings(readings.time_s[kept], readings.signal[kept], readings.clipped[kept])
