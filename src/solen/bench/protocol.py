"""The protocol: what the stage does, as data.

The idea: a protocol is a list of steps, each a place to go to, how fast, and how long to stay, done over and over. A
step in degrees is for a rotation stage, one in mm for a linear stage; which of them moves, and what it moves, is for
the rig to say. A step to a force moves a linear stage until a load cell reads it.

The interface: `Protocol` and `Step`; `load_protocol` of a file.
"""

import math
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.bench.tables import BenchTable, load_table
from solen.spec.strict import NotNegative, Number, Positive, Text, refused

LONGEST_S = 7 * 86_400.0
"""A protocol that moves for longer than a week is a slip of the pen."""

SLOW_SHARE = 1.0 / 3.0
"""Velocity of slow cycles as a share of that of the others."""


class Step(BenchTable):
    """One move and the rest after it."""

    table: ClassVar[str] = "step"

    to_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(None, description="Where to turn to, in degrees.")
    to_mm: Annotated[Number, Field(ge=-1000, le=1000)] | None = Field(None, description="Where to shift to, in mm.")
    to_N: Positive | None = Field(None, description="What force to press to, in N, by the rig's load cell.")
    velocity_deg_per_s: Positive | None = Field(None, description="How fast, in degrees per second.")
    velocity_mm_per_s: Positive | None = Field(None, description="How fast, in mm per second.")
    hold_s: NotNegative = Field(0.0, description="How long to stay there, in s.")

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if self.to_mm is not None and self.to_N is not None:
            raise refused("to_N", "has no use beside to_mm", value=self.to_N, remedy="leave one of them out")
        place = self.to_N if self.to_mm is None else self.to_mm
        units = (self.to_deg, self.velocity_deg_per_s), (place, self.velocity_mm_per_s)
        stated = sorted([value is not None for value in unit] for unit in units)
        if stated != [[False, False], [True, True]]:
            remedy = "give to_deg with velocity_deg_per_s, or to_mm or to_N with velocity_mm_per_s"
            raise refused("", "must say where to and how fast, in one unit", remedy=remedy)
        return self

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of the move."""
        return "mm" if self.to_deg is None else "deg"

    @property
    def target(self) -> float:
        """Where to, in its unit; NaN of a step to a force, whose place is found."""
        return math.nan if self.to_N is not None else self.to_mm or self.to_deg or 0.0

    @property
    def velocity(self) -> float:
        """Speed, in the unit of the motion per s."""
        return self.velocity_mm_per_s or self.velocity_deg_per_s or 0.0

    def slowed(self, share: float) -> Self:
        """The step at a share of its velocity."""
        key = "velocity_deg_per_s" if self.unit == "deg" else "velocity_mm_per_s"
        return self.model_copy(update={key: share * self.velocity})


class Protocol(BenchTable):
    """Steps, how often, and the rest before and after them."""

    name: Text = Field(description="what the protocol is called.")
    cycles: Annotated[int, Field(strict=True, ge=1, le=100_000)] = Field(1, description="How often the steps are done.")
    rest_s: NotNegative = Field(1.0, description="Rest before the first cycle and after the last, in s.")
    slow_cycles: Annotated[int, Field(strict=True, ge=0, le=100_000)] = Field(
        0, description="Further cycles at a lower velocity: what differs between the two is time, not hysteresis."
    )
    slow_share: Annotated[Number, Field(gt=0, lt=1)] | None = Field(
        None, description="Velocity of the slow cycles, as a share of that of the others; default: a third."
    )
    position_rate_hz: Annotated[Number, Field(gt=0, le=1000)] = Field(
        50.0, description="Position queries of the stage per second."
    )
    step: Annotated[tuple[Step, ...], Field(min_length=1, max_length=1000)] = Field(description="the steps, [[step]].")

    @model_validator(mode="after")
    def _alike(self) -> Self:
        if self.step[-1].to_N is not None:
            limit = "of the last step is not where a cycle can begin"
            raise refused("step", limit, value=self.step[-1].to_N, remedy="end with a step to_mm, as back to 0")
        if len({step.unit for step in self.step}) > 1:
            raise refused("step", "must all be in deg, or all in mm")
        if self.slow_share is not None and self.slow_cycles == 0:
            raise refused("slow_share", "has no use without slow_cycles", value=self.slow_share)
        if self.shortest_s > LONGEST_S:
            days = self.shortest_s / 86_400.0
            raise refused("cycles", f"take {days:.3g} days; a protocol takes a week at most", value=self.cycles)
        return self

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of its moves."""
        return self.step[0].unit

    @property
    def reach(self) -> float:
        """Farthest that it goes from zero, in its unit."""
        return max(abs(step.target) for step in self.step if step.to_N is None)

    @property
    def forces_N(self) -> tuple[float, ...]:
        """Forces that it presses to."""
        return tuple(step.to_N for step in self.step if step.to_N is not None)

    @property
    def all_cycles(self) -> int:
        """Cycles at full velocity, and slow ones."""
        return self.cycles + self.slow_cycles

    @property
    def fastest(self) -> float:
        """Its highest velocity, in its unit per s."""
        return max(step.velocity for step in self.step)

    def steps_of(self, cycle: int) -> tuple[Step, ...]:
        """Steps of a cycle, which counts from 1; slow cycles come after the others."""
        return self.step if cycle <= self.cycles else tuple(step.slowed(self._share) for step in self.step)

    @property
    def shortest_s(self) -> float:
        """How long it takes with a stage that is at its velocity at once."""
        here, way_s = self.step[-1].target, 0.0
        for step in (one for one in self.step if one.to_N is None):
            way_s += abs(step.target - here) / step.velocity
            here = step.target
        holds_s = self.all_cycles * sum(step.hold_s for step in self.step)
        return 2.0 * self.rest_s + holds_s + way_s * (self.cycles + self.slow_cycles / self._share)

    @property
    def _share(self) -> float:
        return self.slow_share or SLOW_SHARE


def load_protocol(path: Path) -> Protocol:
    """Protocol of a file; `BenchError` if it cannot be read or is invalid."""
    return load_table(path, Protocol)
