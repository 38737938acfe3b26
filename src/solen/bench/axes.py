"""Axes of a run: the stage of each motion, its recorded positions, and whether it has arrived.

Public names: `Axis` and `stream_of`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from solen.bench.clock import Clock
from solen.bench.journal import Journal
from solen.bench.protocol import Step
from solen.bench.roles import Stage
from solen.errors import BenchError

SETTLE_S = 0.5
"""Time in s after the shortest possible duration of a move; from then on the stage is asked whether it has arrived even
if its position still changes.
"""
MAX_OVERSHOOT = 1e-3
"""Largest overshoot at either end of the travel, as a fraction of the travel."""
AT_REST_FRACTION = 0.01
"""Fraction of the commanded velocity below which a stage is considered at rest."""
STREAM = "stage"


def stream_of(motion: str) -> str:
    """Return the name of a stage's position stream in a journal; ``motion`` is empty for the only stage of a run."""
    return f"{STREAM} {motion}" if motion else STREAM


@dataclass
class Axis:
    """One stage of a run.

    Attributes
    ----------
    motion
        The motion that the stage makes; empty for the only axis.
    stage, clock, part
        The stage, the run's clock and the part of the protocol for this stage.
    travel
        Lowest and highest allowed position; None if only the stage's own limits apply.
    """

    motion: str
    stage: Stage
    clock: Clock
    part: int
    travel: tuple[float, float] | None = None
    _queries: list[tuple[int, float, float, float]] = field(default_factory=list)
    _last_two: list[tuple[float, float]] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Name of the axis in messages about a stage that does not stop."""
        return f"stage of {self.motion}" if self.motion else "stage"

    def query(self) -> float:
        """Query the position of the stage; query and reply are timestamped."""
        sent_s = self.clock.now_s()
        position = self.stage.position()
        at_s = self.clock.now_s()
        self._queries.append((self.part, sent_s, at_s, position))
        self._last_two = [*self._last_two[-1:], (at_s, position)]
        return position

    def write(self, journal: Journal) -> None:
        """Record the positions received since the last call."""
        queries, self._queries = self._queries, []
        stream = stream_of(self.motion)
        journal.rows(stream, np.array(queries, journal.dtype(stream)))

    def check_travel(self, step: Step, start: float, target: float) -> None:
        """Raise `BenchError` if a move would begin or end outside the travel of the rig."""
        if self.travel is None:
            return
        low, high = self.travel
        slack = MAX_OVERSHOOT * (high - low)
        for what, position in (("position", start), ("target", target)):
            if position < low - slack or position > high + slack:
                limit = f"is outside the travel of the rig, {low:g} to {high:g} {step.unit}"
                remedy = "move the stage back by hand, or widen travel in the rig file"
                raise BenchError(f"{self.stage.name}: {what}", value=position, limit=limit, remedy=remedy)

    def arrived(self, step: Step, arrives_s: float) -> bool:
        """Whether the stage has arrived.

        The stage is asked as soon as the shortest possible duration has passed and the last two positions show that it
        is at rest, but not later than `SETTLE_S` after that duration.
        """
        now_s = self.clock.now_s()
        if now_s < arrives_s:
            return False
        if now_s < arrives_s + SETTLE_S and len(self._last_two) == 2:
            (before_s, before), (at_s, at) = self._last_two
            if abs(at - before) > AT_REST_FRACTION * step.velocity * (at_s - before_s):
                return False
        return self.stage.on_target()


def axes_of(
    stages: Stage | Mapping[str, Stage],
    clock: Clock,
    part: int,
    travel: Mapping[str, tuple[float, float] | None] | tuple[float, float] | None,
) -> dict[str, Axis]:
    """Return the axes of a run, keyed by motion; ``travel`` is keyed by motion too, or applies to all stages."""
    by_motion = stages if isinstance(stages, Mapping) else {"": stages}
    return {
        motion: Axis(motion, stage, clock, part, travel.get(motion) if isinstance(travel, Mapping) else travel)
        for motion, stage in by_motion.items()
    }
