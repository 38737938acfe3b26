"""The protocol: the motion of the stage, as data.

A protocol is a repeated list of steps, each with a target, a velocity and a rest. A step in degrees is for a rotation
stage, one in mm for a linear stage; the rig states which stage moves and what it moves. A step to a force moves a
linear stage until a load cell reads this force. Several motions are named, ``to_deg = {neck = 3.0, trunk = -5.0}``, and
move together; a `Grid` visits every combination of their positions.

Public names: `Protocol`, `Step` and `load_protocol`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self, TypeVar

import numpy as np
from pydantic import Field, model_validator

from solen.arrays import FloatArray
from solen.bench.tables import BenchTable, load_table
from solen.spec.strict import NotNegative, Number, Positive, Text, refused, reported_as

MAX_DURATION_S = 7 * 86_400.0
"""Longest duration of a protocol in s: more than a week is probably a typing error."""

SLOW_SHARE = 1.0 / 3.0
"""Velocity of slow cycles as a fraction of that of the others."""


MAX_STATES = 100_000
"""Largest number of states that a grid may visit."""
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53)
"""Bases of the Halton sequence, one for each motion."""
Turn = Annotated[Number, Field(ge=-360, le=360)]
Shift = Annotated[Number, Field(ge=-1000, le=1000)]
T = TypeVar("T")
OfMotions = Annotated[dict[Text, T], Field(min_length=1, max_length=16)]
_PLACE = reported_as("must be a number up to 360 deg or 1000 mm, or one for each motion: {neck = 3.0, trunk = -5.0}")


class Step(BenchTable):
    """One move and the rest after it."""

    table: ClassVar[str] = "step"

    to_deg: Annotated[Turn | OfMotions[Turn], _PLACE] | None = Field(
        None, description="Angle to turn to, in degrees; with several motions, by name: the others stay."
    )
    to_mm: Annotated[Shift | OfMotions[Shift], _PLACE] | None = Field(
        None, description="Position to move to, in mm; with several motions, by name: the others stay."
    )
    to_N: Positive | None = Field(None, description="Force to press to, in N, measured by the rig's load cell.")
    velocity_deg_per_s: Positive | None = Field(None, description="Speed in degrees per second.")
    velocity_mm_per_s: Positive | None = Field(None, description="Speed in mm per second.")
    hold_s: NotNegative = Field(0.0, description="Time to stay at the target, in s.")

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        if self.to_mm is not None and self.to_N is not None:
            raise refused("to_N", "cannot be combined with to_mm", value=self.to_N, remedy="use only one of them")
        place = self.to_N if self.to_mm is None else self.to_mm
        units = (self.to_deg, self.velocity_deg_per_s), (place, self.velocity_mm_per_s)
        stated = sorted([value is not None for value in unit] for unit in units)
        if stated != [[False, False], [True, True]]:
            remedy = "use to_deg with velocity_deg_per_s, or to_mm or to_N with velocity_mm_per_s"
            raise refused("", "must state a target and a speed, in one unit", remedy=remedy)
        return self

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of the move."""
        return "mm" if self.to_deg is None else "deg"

    @property
    def targets(self) -> dict[str, float]:
        """Target in the step's unit, by motion.

        A single motion has no name, and a force, whose position is unknown, is NaN.
        """
        if self.to_N is not None:
            return {"": math.nan}
        place = self.to_deg if self.to_mm is None else self.to_mm
        return dict(place) if isinstance(place, dict) else {"": place or 0.0}

    @property
    def farthest(self) -> float:
        """Largest distance from zero of a target."""
        return max(map(abs, self.targets.values()))

    @property
    def velocity(self) -> float:
        """Velocity in the unit of the motion per s."""
        return self.velocity_mm_per_s or self.velocity_deg_per_s or 0.0

    def slowed(self, share: float) -> Self:
        """Return the step at a fraction of its velocity."""
        key = "velocity_deg_per_s" if self.unit == "deg" else "velocity_mm_per_s"
        return self.model_copy(update={key: share * self.velocity})


class Grid(BenchTable):
    """Every combination of positions of several motions, and further states.

    One motion moves at a time. The scattered states between the positions of the grid show what its combinations
    cannot show.
    """

    table: ClassVar[str] = "grid"

    to_deg: OfMotions[tuple[Turn, ...]] | None = Field(
        None, description="Positions of each motion by name, in degrees."
    )
    to_mm: OfMotions[tuple[Shift, ...]] | None = Field(
        None, description="Positions of each linear stage's motion by name, in mm."
    )
    scatter: Annotated[int, Field(strict=True, ge=0, le=MAX_STATES)] = Field(
        0,
        description="Number of states spread evenly over the ranges of the positions, visited after the combinations.",
    )
    velocity_deg_per_s: Positive | None = Field(None, description="Speed in degrees per second.")
    velocity_mm_per_s: Positive | None = Field(None, description="Speed in mm per second.")
    hold_s: Positive = Field(0.5, description="Time to stay at each state, in s.")

    @model_validator(mode="after")
    def _has_places(self) -> Self:
        if (self.to_deg is None) == (self.to_mm is None):
            raise refused("", "must state either to_deg or to_mm")
        for name, places in self._places.items():
            if not places:
                raise refused(f"to_{self._unit}.{name}", "must be a list of positions")
        if (states := math.prod(map(len, self._places.values()))) > MAX_STATES:
            raise refused("", f"has {states} combinations; a protocol visits at most {MAX_STATES}")
        _ = self.steps[:1]  # a step rejects missing keys
        return self

    @property
    def _unit(self) -> str:
        return "deg" if self.to_mm is None else "mm"

    @property
    def _places(self) -> Mapping[str, tuple[float, ...]]:
        return self.to_deg or self.to_mm or {}

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Return a step to each combination, reversing every motion along its path, and to each scattered state."""
        speeds = {key: value for key in ("velocity_deg_per_s", "velocity_mm_per_s") if (value := getattr(self, key))}
        rest = speeds | {"hold_s": self.hold_s}
        combinations = there_and_back(self._places)
        scattered = _scattered(self._places, self.scatter, combinations[-1])
        return tuple(Step(**{f"to_{self._unit}": state}, **rest) for state in (*combinations, *scattered))


def there_and_back(places: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Return every combination of positions by motion; neighbours differ in one motion by one position."""
    if not places:
        return [{}]
    name, inner = next(iter(places)), there_and_back(dict(list(places.items())[1:]))
    ways = (inner if number % 2 == 0 else inner[::-1] for number in range(len(places[name])))
    return [{name: place} | state for place, way in zip(places[name], ways, strict=True) for state in way]


def _scattered(
    places: Mapping[str, Sequence[float]], count: int, begin: Mapping[str, float]
) -> Iterator[dict[str, float]]:
    """Return states of a Halton sequence over the ranges of positions, each the nearest one to the previous state."""
    low, high = (np.array([end(place) for place in places.values()]) for end in (min, max))
    left = low + (high - low) * _halton(count, len(places))
    here = np.array(list(begin.values()))
    while len(left):
        next_one = int(np.argmin(np.abs((left - here) / np.maximum(high - low, 1e-9)).max(axis=1)))
        here, left = left[next_one], np.delete(left, next_one, axis=0)
        yield dict(zip(places, np.round(here, 4).tolist(), strict=True))


def _halton(count: int, dimensions: int) -> FloatArray:
    """Return the first points (count, dimensions) of the Halton sequence, evenly spread over the unit cube."""
    found = np.zeros((count, dimensions))
    for column, base in enumerate(PRIMES[:dimensions]):
        number, share = np.arange(1, count + 1), 1.0
        while number.any():
            share /= base
            found[:, column] += share * (number % base)
            number = number // base
    return found


class Protocol(BenchTable):
    """Steps, the number of their repetitions, and the rest before and after them."""

    name: Text = Field(description="name of the protocol.")
    cycles: Annotated[int, Field(strict=True, ge=1, le=100_000)] = Field(
        1, description="Number of repetitions of the steps."
    )
    rest_s: NotNegative = Field(1.0, description="Rest before the first cycle and after the last, in s.")
    slow_cycles: Annotated[int, Field(strict=True, ge=0, le=100_000)] = Field(
        0,
        description="Further cycles at a lower velocity: a difference between the two is due to time, not hysteresis.",
    )
    slow_share: Annotated[Number, Field(gt=0, lt=1)] | None = Field(
        None, description="Velocity of the slow cycles, as a fraction of that of the others; default: a third."
    )
    position_rate_hz: Annotated[Number, Field(gt=0, le=1000)] = Field(
        50.0, description="Position queries of the stage per second."
    )
    grid: Grid | None = Field(None, description="positions of several motions, [grid], visited before the steps.")
    step: Annotated[tuple[Step, ...], Field(max_length=1000)] = Field((), description="the steps, [[step]].")

    @model_validator(mode="after")
    def _alike(self) -> Self:
        if not self.steps:
            raise refused("step", "missing: the target", remedy="add [[step]] or [grid]")
        if self.steps[-1].to_N is not None:
            limit = "of the last step is not a position from which a cycle can begin"
            raise refused(
                "step", limit, value=self.steps[-1].to_N, remedy="end with a step to_mm, for example back to 0"
            )
        if len({step.unit for step in self.steps}) > 1:
            raise refused("step", "must all be in deg, or all in mm")
        if len({"" in step.targets for step in self.steps}) > 1:
            raise refused("step", "must all name motions, or none may name one")
        if self.slow_share is not None and self.slow_cycles == 0:
            raise refused("slow_share", "does not apply without slow_cycles", value=self.slow_share)
        if self.shortest_s > MAX_DURATION_S:
            days = self.shortest_s / 86_400.0
            raise refused("cycles", f"take {days:.3g} days; a protocol may take a week at most", value=self.cycles)
        return self

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Return the steps of a cycle at full velocity: those of the grid, then the others."""
        return (*(() if self.grid is None else self.grid.steps), *self.step)

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of its moves."""
        return self.steps[0].unit

    @property
    def reach(self) -> float:
        """Largest distance from zero, in its unit."""
        return max(step.farthest for step in self.steps if step.to_N is None)

    @cached_property
    def places(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest position of each motion; a single motion has no name, and forces have no positions."""
        found: dict[str, list[float]] = {}
        for step in (step for step in self.steps if step.to_N is None):
            for name, place in step.targets.items():
                found.setdefault(name, []).append(place)
        return {name: (min(places), max(places)) for name, places in found.items()}

    @property
    def forces_N(self) -> tuple[float, ...]:
        """Forces of its steps in N."""
        return tuple(step.to_N for step in self.steps if step.to_N is not None)

    @property
    def all_cycles(self) -> int:
        """Number of all cycles, at full velocity and slow."""
        return self.cycles + self.slow_cycles

    @property
    def fastest(self) -> float:
        """Highest velocity, in its unit per s."""
        return max(step.velocity for step in self.steps)

    def steps_of(self, cycle: int) -> tuple[Step, ...]:
        """Return the steps of a cycle, counted from 1; slow cycles come after the others."""
        return self.steps if cycle <= self.cycles else tuple(step.slowed(self._share) for step in self.steps)

    @property
    def shortest_s(self) -> float:
        """Shortest duration in s, for a stage that accelerates at once."""
        here, way_s = self.steps[-1].targets, 0.0
        for step in (step for step in self.steps if step.to_N is None):
            way_s += max(abs(to - here.get(name, to)) for name, to in step.targets.items()) / step.velocity
            here = here | step.targets
        holds_s = self.all_cycles * sum(step.hold_s for step in self.steps)
        return 2.0 * self.rest_s + holds_s + way_s * (self.cycles + self.slow_cycles / self._share)

    @property
    def _share(self) -> float:
        return self.slow_share or SLOW_SHARE


def load_protocol(path: Path) -> Protocol:
    """Read the protocol of a file; raise `BenchError` if it cannot be read or is invalid."""
    return load_table(path, Protocol)
