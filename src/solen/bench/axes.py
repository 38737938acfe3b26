"""Axes of a run: each stage by the motion that it makes, where it was seen, and whether it has arrived.

The interface: `Axis`; `stream_of` a motion is the name of its stage's positions in a journal.
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
"""After a move's shortest time, a stage that does not come to rest is asked all the same whether it has arrived."""
OVERSHOOT = 1e-3
"""Fraction of the travel by which a stage at its end may overshoot."""
RESTING = 0.01
"""Fraction of its velocity below which a stage counts as at rest."""
STREAM = "stage"


def stream_of(motion: str) -> str:
    """Stream of a journal for positions of the stage of a motion; the only one of a run has no name."""
    return f"{STREAM} {motion}" if motion else STREAM


@dataclass
class Axis:
    """One stage of a run.

    Attributes
    ----------
    motion
        The motion it makes; empty for the only axis.
    stage, clock, part
        The stage, the run's clock and its part.
    travel
        Lowest and highest allowed position; None for the stage's own limits only.
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
        """Its name in a message that it does not stop."""
        return f"stage of {self.motion}" if self.motion else "stage"

    def look(self) -> float:
        """Ask the stage where it is; question and answer are stamped."""
        sent_s = self.clock.now_s()
        position = self.stage.position()
        at_s = self.clock.now_s()
        self._looks.append((self.part, sent_s, at_s, position))
        self._last_two = [*self._last_two[-1:], (at_s, position)]
        return position

    def write(self, journal: Journal) -> None:
        """Record the positions seen since the last call."""
        looks, self._looks = self._looks, []
        stream = stream_of(self.motion)
        journal.rows(stream, np.array(looks, journal.dtype(stream)))

    def check_travel(self, step: Step, start: float, target: float) -> None:
        """Refuse a way that is not within the rig's travel from end to end."""
        if self.travel is None:
            return
        low, high = self.travel
        slack = OVERSHOOT * (high - low)
        for what, position in (("stands at", start), ("is sent to", target)):
            if position < low - slack or position > high + slack:
                limit = f"{what} {position:g} {step.unit}, and travel in the rig is {low:g} to {high:g}"
                raise BenchError(self.stage.name, limit=limit, remedy="move it back by hand, or widen travel")

    def arrived(self, step: Step, arrives_s: float) -> bool:
        """Whether the stage has arrived; queried from the earliest possible time, and only if it seems to rest."""
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
    """Axes of a run by motion; ``travel`` is that of each stage, or of all."""
    named = stages if isinstance(stages, Mapping) else {"": stages}
    return {
        motion: Axis(motion, stage, clock, part, travel.get(motion) if isinstance(travel, Mapping) else travel)
        for motion, stage in named.items()
    }
