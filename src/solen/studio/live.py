"""Live views of running jobs: a bench run, and angles as they are decoded.

A page shows the entire curve, reduced to a number of points that can be sent with each update.
"""

import time
from collections.abc import Mapping, Sequence

from solen.bench.run import Tick
from solen.studio.jobs import Reporter

MAX_POINTS, UPDATE_INTERVAL_S = 600, 0.2
"""Maximum number of points of a curve, and the interval between updates."""
ENDS = ("from (95 %)", "to (95 %)")
SHOWN = {"angle_deg": "angle / °", "force_N": "force / N", "depth_mm": "depth / mm"}


class LiveCurve:
    """Values against time, thinned out as their number increases."""

    def __init__(self, reporter: Reporter) -> None:
        self.reporter = reporter
        self.rows: list[tuple[float, ...]] = []
        self.stride, self.count, self.reported_s = 1, 0, -UPDATE_INTERVAL_S

    def add(self, row: Sequence[float], names: Sequence[str], axis: str, **values: float) -> None:
        """Add a row of values, beginning with the time, and report the curve if an update is due."""
        if self.count % self.stride == 0:
            self.rows.append(tuple(row))
        self.count += 1
        if len(self.rows) >= MAX_POINTS:
            self.rows, self.stride = self.rows[::2], 2 * self.stride
        if time.monotonic() - self.reported_s >= UPDATE_INTERVAL_S:
            self.reported_s = time.monotonic()
            self.update(names, axis, **values)

    def update(self, names: Sequence[str], axis: str, **values: float) -> None:
        """Report the curve so far."""
        columns = [list(column) for column in zip(*self.rows, strict=True)]
        self.reporter(live={"names": list(names), "axis": axis, "columns": columns}, **values)


class Levels(LiveCurve):
    """Light at each rig input during a run."""

    def __call__(self, tick: Tick) -> None:
        """Record the state of the run."""
        levels = tick.levels.tolist()
        fraction = (tick.cycle - 1) / max(tick.cycles, 1)
        if levels:
            names = [f"input {number}" for number, _ in enumerate(levels, 1)]
            self.add((tick.t_s, *levels), names, "light, as a fraction of the dark reading", share=fraction)


class Angles(LiveCurve):
    """Rows of a decoded stream, received as text."""

    names: Mapping[str, int]

    def write(self, text: str) -> int:
        """Write lines of CSV, the header first."""
        for line in text.splitlines():
            cells = line.split(",")
            if cells[0] == "time_s":
                self.names = {name: index for index, name in enumerate(cells)}
                continue
            key, unit = self._key()
            columns = ("time_s", key, f"low95_{unit}", f"high95_{unit}")
            self.add([_number(cells[self.names[name]]) for name in columns], (key, *ENDS), SHOWN[key])
        return len(text)

    def _key(self) -> tuple[str, str]:
        """Return the column of the decoded quantity, and its unit."""
        key = next(name for name in SHOWN if name in self.names)
        return key, key.rpartition("_")[2]

    def flush(self) -> None:
        """Report the rows received so far."""
        if self.rows:
            key, _ = self._key()
            self.update((key, *ENDS), SHOWN[key])


def _number(text: str) -> float:
    return float(text) if text else float("nan")
