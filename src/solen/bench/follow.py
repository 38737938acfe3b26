"""Reading the journal of a run while it grows: sensor readings are available as soon as their period is written.

Each journal record is either complete or missing, so that reading on from the last complete record neither misses nor
repeats anything. A period is demodulated together with the preceding period, because the first emitter needs the last
"off" phase of that period. Times are board times, counted from the first period of the part, because the run clock is
known only after the end of the run.

Public name: `Following`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.bench.journal import read_journal, read_on
from solen.bench.journal_content import Rows, dtypes_of
from solen.bench.readings import Converter, View, sound, subtracted, views_of
from solen.bench.records import END, ROWS
from solen.errors import DataError


@dataclass(frozen=True, eq=False)
class Fresh:
    """New readings: times (n,), left and right readings (n, 2), and clipping marks.

    For a network, signals and marks are (n, emitters, receivers); a missing reading is NaN.
    """

    time_s: FloatArray
    volts: FloatArray
    clipped: NDArray[np.bool_]


class Following:
    """A journal that is read while it grows.

    Raises
    ------
    DataError
        If the file is not a journal, or contains a waveform.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.ended = False
        self.header = read_journal(path).header
        self._dtypes = dtypes_of(self.header, path)
        if "board" not in self._dtypes:
            limit = "contains a waveform, whose readings are computed when the run is closed"
            raise DataError(
                str(path), limit=limit, remedy="close it with solen bench recover, and decode the recording"
            )
        self._number = list(self._dtypes).index("board")
        self._place = 0
        self._last: Rows | None = None
        self._begun_us: dict[int, int] = {}

    def readings(self, sensor: str) -> Iterator[Fresh]:
        """Return the sensor readings that are new since the last call, one item for each part of the run."""
        view = next(view for view in views_of(self.header) if view.name == sensor)
        for rows in self._fresh():
            found = self._under(*self._with_before(rows), view)  # right before left
            yield Fresh(found.time_s, found.volts[:, ::-1], found.clipped[:, ::-1])

    def turns(self, sensor: str) -> Iterator[Fresh]:
        """Return the new emitter cycles of a network since the last call, one item for each part of the run."""
        views = [view for view in views_of(self.header) if view.sensor["name"] == sensor]
        for rows in self._fresh():
            both, time_s, new = self._with_before(rows)
            signal = np.full((len(rows), len(views), len(views[0].inputs)), np.nan)
            clipped = np.zeros(signal.shape, bool)
            for place, view in enumerate(views):
                found = self._under(both, time_s, new, view)
                at = np.searchsorted(time_s, found.time_s, "right") - 1 - new
                signal[at, place], clipped[at, place] = found.volts, found.clipped
            yield Fresh(time_s[new:], signal, clipped)

    def _fresh(self) -> list[Rows]:
        """Return the new periods by part; if the journal no longer exists, its run has ended."""
        try:
            records, self._place = read_on(self._path, self._place)
        except OSError:
            records, self.ended = [], True
        self.ended |= any(kind == END for kind, _, _ in records)
        data = b"".join(payload for kind, stream, payload in records if kind == ROWS and stream == self._number)
        fresh = np.frombuffer(data, self._dtypes["board"])
        edges = np.flatnonzero(np.diff(fresh["part"].astype(np.int64))) + 1
        return np.split(fresh, edges) if len(fresh) else []

    def _with_before(self, rows: Rows) -> tuple[Rows, FloatArray, int]:
        """Return the periods with the preceding period, if any, their times, and the number of earlier periods."""
        part = int(rows["part"][0])
        before = self._last if self._last is not None and int(self._last["part"][0]) == part else rows[:0]
        self._last = rows[-1:]
        begun = self._begun_us.setdefault(part, int(rows["board_us"][0]))
        both = np.concatenate([before, rows])
        return both, 1e-6 * (both["board_us"] - begun).astype(np.float64), len(before)

    def _under(self, both: Rows, time_s: FloatArray, new: int, view: View) -> Fresh:
        """Return the readings under one emitter in the periods from an index on, with the receivers in their order."""
        inputs, converter = [one - 1 for one in view.inputs.values()], Converter.of(self.header)
        readings = subtracted(both["counts"], time_s, view.emitter, inputs, converter)
        kept = readings.of(view.emitter) & (readings.time_s >= time_s[new])
        kept &= sound(both["flags"], time_s, readings.time_s)
        return Fresh(readings.time_s[kept], readings.signal[kept], readings.clipped[kept])
