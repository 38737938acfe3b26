"""Axes of a run: the stage that makes each motion, its recorded positions, and whether it has arrived.

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
"""Time in s, counted from the shortest possible duration of a move, after which a stage is asked whether it has arrived
even if it is still moving.
"""
OVERSHOOT = 1e-3
"""Fraction of the travel by which a stage may overshoot at the end of its travel."""
RESTING = 0.01
"""Fraction of its velocity below which a stage counts as at rest."""
STREAM = "stage"


def stream_of(motion: str) -> str:
    """Return the name of a stage's position stream in a journal; ``motion`` is empty for a run's only stage."""
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
    _looks: list[tuple[int, float, float, float]] = field(default_factory=list)
    _last_two: list[tuple[float, float]] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Name of the stage in messages about a stage that does not stop."""
        return f"stage of {self.motion}" if self.motion else "stage"

    def look(self) -> float:
        """Ask the stage for its position; the question and the answer are timestamped."""
        sent_s = self.clock.now_s()
        position = self.stage.position()
        at_s = self.clock.now_s()
        self._looks.append((self.part, sent_s, at_s, position))
        self._last_two = [*self._last_two[-1:], (at_s, position)]
        return position

    def write(self, journal: Journal) -> None:
        """Record the positions received since the last call."""
        looks, self._looks = self._looks, []
        stream = stream_of(self.motion)
        journal.rows(stream, np.array(looks, journal.dtype(stream)))

    def check_travel(self, step: Step, start: float, target: float) -> None:
        """Raise an error if a part of the planned path is outside the rig's travel."""
        if self.travel is None:
            return
        low, high = self.travel
        slack = OVERSHOOT * (high - low)
        for what, position in (("stands at", start), ("is sent to", target)):
            if position < low - slack or position > high + slack:
                limit = f"{what} position {position:g} {step.unit}, and the rig's travel is {low:g} to {high:g}"
                raise BenchError(
                    self.stage.name, limit=limit, remedy="move it back by hand, or widen the travel in the rig file"
                )

    def arrived(self, step: Step, arrives_s: float) -> bool:
        """Whether the stage has arrived.

        The stage is asked once the shortest possible duration has passed and it seems to be at rest, or `SETTLE_S`
        later.
        """
        now_s = self.clock.now_s()
        if now_s < arrives_s:
            return False
        if now_s < arrives_s + SETTLE_S and len(self._last_two) == 2:
            (before_s, before), (at_s, at) = self._last_two
            if abs(at - before) > RESTING * step.velocity * (at_s - before_s):
                return False
        return self.stage.on_target()


def axes_of(
    stages: Stage | Mapping[str, Stage],
    clock: Clock,
    part: int,
    travel: Mapping[str, tuple[float, float] | None] | tuple[float, float] | None,
) -> dict[str, Axis]:
    """Return the axes of a run by motion; ``travel`` is specified for each motion, or once for all stages."""
    named = stages if isinstance(stages, Mapping) else {"": stages}
    return {
        motion: Axis(motion, stage, clock, part, travel.get(motion) if isinstance(travel, Mapping) else travel)
        for motion, stage in named.items()
    }
