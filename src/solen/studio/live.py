"""Live views while work runs: a run of the bench, and angles as they are decoded.

A page is shown the whole course, with few enough points to be sent at each look.
"""

import time
from collections.abc import Mapping, Sequence

from solen.bench.run import Tick
from solen.studio.jobs import Tell

MOST_POINTS, LOOK_S = 600, 0.2
"""Points of a course that is shown, and time between looks at it."""
ENDS = ("from (95 %)", "to (95 %)")
SHOWN = {"angle_deg": "angle / °", "force_N": "force / N", "depth_mm": "depth / mm"}


class Course:
    """Values over time, thinned out as they become many."""

    def __init__(self, tell: Tell) -> None:
        self.tell = tell
        self.rows: list[tuple[float, ...]] = []
        self.every, self.seen, self.reported_s = 1, 0, -LOOK_S

    def add(self, row: Sequence[float], names: Sequence[str], axis: str, **news: float) -> None:
        """Add values, the time first, and tell the course if it is time to."""
        if self.seen % self.every == 0:
            self.rows.append(tuple(row))
        self.seen += 1
        if len(self.rows) >= MOST_POINTS:
            self.rows, self.every = self.rows[::2], 2 * self.every
        if time.monotonic() - self.reported_s >= LOOK_S:
            self.reported_s = time.monotonic()
            self.report(names, axis, **news)

    def report(self, names: Sequence[str], axis: str, **news: float) -> None:
        """Tell the course so far."""
        columns = [list(column) for column in zip(*self.rows, strict=True)]
        self.tell(live={"names": list(names), "axis": axis, "columns": columns}, **news)


class Levels(Course):
    """Light at each input of a rig, as a run goes on."""

    def __call__(self, tick: Tick) -> None:
        """Take the state of the run."""
        levels = tick.levels.tolist()
        share = (tick.cycle - 1) / max(tick.cycles, 1)
        if levels:
            names = [f"input {number}" for number, _ in enumerate(levels, 1)]
            self.add((tick.t_s, *levels), names, "light, as a share of the dark reading", share=share)


class Angles(Course):
    """Rows of a decoded stream, as text that is written."""

    names: Mapping[str, int]

    def write(self, text: str) -> int:
        """Take lines of CSV, the header first."""
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
        """Column of what is decoded, and its unit."""
        key = next(name for name in SHOWN if name in self.names)
        return key, key.rpartition("_")[2]

    def flush(self) -> None:
        """Tell what was taken so far."""
        if self.rows:
            key, _ = self._key()
            self.report((key, *ENDS), SHOWN[key])


def _number(text: str) -> float:
    return float(text) if text else float("nan")
