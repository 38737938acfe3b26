"""Live views of running work: a bench run, and angles as they are decoded.

A page shows the entire curve, reduced to few enough points to be sent at each update.
"""

import time
from collections.abc import Mapping, Sequence

from solen.bench.run import Tick
from solen.studio.jobs import SendNews

MAX_POINTS, LOOK_S = 600, 0.2
"""Largest number of points shown on a curve, and the time between updates."""
ENDS = ("from (95 %)", "to (95 %)")
SHOWN = {"angle_deg": "angle / °", "force_N": "force / N", "depth_mm": "depth / mm"}


class LiveCurve:
    """Values over time, thinned out as their number grows."""

    def __init__(self, send_news: SendNews) -> None:
        self.send_news = send_news
        self.rows: list[tuple[float, ...]] = []
        self.every, self.seen, self.reported_s = 1, 0, -LOOK_S

    def add(self, row: Sequence[float], names: Sequence[str], axis: str, **news: float) -> None:
        """Add values, the time first, and report the curve if an update is due."""
        if self.seen % self.every == 0:
            self.rows.append(tuple(row))
        self.seen += 1
        if len(self.rows) >= MAX_POINTS:
            self.rows, self.every = self.rows[::2], 2 * self.every
        if time.monotonic() - self.reported_s >= LOOK_S:
            self.reported_s = time.monotonic()
            self.report(names, axis, **news)

    def report(self, names: Sequence[str], axis: str, **news: float) -> None:
        """Report the curve so far."""
        columns = [list(column) for column in zip(*self.rows, strict=True)]
        self.send_news(live={"names": list(names), "axis": axis, "columns": columns}, **news)


class Levels(LiveCurve):
    """Light at each rig input during a run."""

    def __call__(self, tick: Tick) -> None:
        """Record the state of the run."""
        levels = tick.levels.tolist()
        share = (tick.cycle - 1) / max(tick.cycles, 1)
        if levels:
            names = [f"input {number}" for number, _ in enumerate(levels, 1)]
            self.add((tick.t_s, *levels), names, "light, as a fraction of the dark reading", share=share)


class Angles(LiveCurve):
    """Rows of a decoded stream, received as text."""

    names: Mapping[str, int]

    def write(self, text: str) -> int:
        """Write lines of CSV, the header first."""
        for line in text.splitlines():
            cells = line.split(",")
            if cells[0] == "time_s":
                self.names = {name: place for place, name in enumerate(cells)}
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
            self.report((key, *ENDS), SHOWN[key])


def _number(text: str) -> float:
    return float(text) if text else float("nan")
