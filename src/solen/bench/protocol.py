"""The protocol: the motion of the stage, as data.

A protocol is a repeated list of steps, each with a target, a velocity and a hold time. A step in degrees is for a
rotation stage, one in mm for a linear stage; the rig specifies which stage moves and what it moves. A step to a force
moves a linear stage until a load cell reads this force. Several motions are named, ``to_deg = {neck = 3.0, trunk =
-5.0}``, and move together; a `Grid` visits every combination of their positions.

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
"""Longest duration of a protocol in s; a longer one is probably a typing error."""
SLOW_FRACTION = 1.0 / 3.0
"""Default velocity of the slow cycles, as a fraction of that of the others."""
MAX_STATES = 100_000
"""Largest number of states that a grid may visit."""
PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53)
"""Bases of the Halton sequence, one for each motion."""
Angle = Annotated[Number, Field(ge=-360, le=360)]
Shift = Annotated[Number, Field(ge=-1000, le=1000)]
T = TypeVar("T")
ByMotion = Annotated[dict[Text, T], Field(min_length=1, max_length=16)]
_POSITION = reported_as(
    "must be within ±360 deg or ±1000 mm: one number, or one for each motion, {neck = 3.0, trunk = -5.0}"
)


class Step(BenchTable):
    """A move and the hold after it."""

    table: ClassVar[str] = "step"

    to_deg: Annotated[Angle | ByMotion[Angle], _POSITION] | None = Field(
        None,
        description="Target angle, in degrees; with several motions, keyed by motion; motions without a target stay.",
    )
    to_mm: Annotated[Shift | ByMotion[Shift], _POSITION] | None = Field(
        None,
        description="Target position, in mm; with several motions, keyed by motion; motions without a target stay.",
    )
    to_N: Positive | None = Field(None, description="Target force, in N, measured by the rig's load cell.")
    velocity_deg_per_s: Positive | None = Field(None, description="Velocity, in degrees per second.")
    velocity_mm_per_s: Positive | None = Field(None, description="Velocity, in mm per second.")
    hold_s: NotNegative = Field(0.0, description="Time to stay at the target, in s.")

    @model_validator(mode="after")
    def _check_unit(self) -> Self:
        if self.to_mm is not None and self.to_N is not None:
            raise refused("to_N", "cannot be combined with to_mm", value=self.to_N, remedy="use only one of them")
        linear = self.to_N if self.to_mm is None else self.to_mm
        units = (self.to_deg, self.velocity_deg_per_s), (linear, self.velocity_mm_per_s)
        given = sorted([value is not None for value in unit] for unit in units)
        if given != [[False, False], [True, True]]:
            remedy = "use to_deg with velocity_deg_per_s, or to_mm or to_N with velocity_mm_per_s"
            raise refused("", "must have a target and a velocity in the same unit", remedy=remedy)
        return self

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of the move."""
        return "mm" if self.to_deg is None else "deg"

    @property
    def targets(self) -> dict[str, float]:
        """Target in the step's unit, keyed by motion.

        A single motion has no name. The target of a step to a force, whose position is unknown, is NaN.
        """
        if self.to_N is not None:
            return {"": math.nan}
        target = self.to_deg if self.to_mm is None else self.to_mm
        return dict(target) if isinstance(target, dict) else {"": target or 0.0}

    @property
    def farthest(self) -> float:
        """Largest distance of a target from zero."""
        return max(map(abs, self.targets.values()))

    @property
    def velocity(self) -> float:
        """Velocity, in the step's unit per s."""
        return self.velocity_mm_per_s or self.velocity_deg_per_s or 0.0

    def slowed(self, fraction: float) -> Self:
        """Return the step at a fraction of its velocity."""
        key = "velocity_deg_per_s" if self.unit == "deg" else "velocity_mm_per_s"
        return self.model_copy(update={key: fraction * self.velocity})


class Grid(BenchTable):
    """Every combination of positions of several motions, and further states scattered between them.

    Between combinations, one motion moves at a time. The scattered states show how the response varies between the
    positions of the grid.
    """

    table: ClassVar[str] = "grid"

    to_deg: ByMotion[tuple[Angle, ...]] | None = Field(
        None, description="Positions of each motion, in degrees, keyed by motion."
    )
    to_mm: ByMotion[tuple[Shift, ...]] | None = Field(
        None, description="Positions of each motion by a linear stage, in mm, keyed by motion."
    )
    scatter: Annotated[int, Field(strict=True, ge=0, le=MAX_STATES)] = Field(
        0,
        description="Number of states spread evenly over the ranges of the positions, visited after the combinations.",
    )
    velocity_deg_per_s: Positive | None = Field(None, description="Velocity, in degrees per second.")
    velocity_mm_per_s: Positive | None = Field(None, description="Velocity, in mm per second.")
    hold_s: Positive = Field(0.5, description="Time to stay at each state, in s.")

    @model_validator(mode="after")
    def _check_positions(self) -> Self:
        if (self.to_deg is None) == (self.to_mm is None):
            raise refused("", "must have either to_deg or to_mm")
        for motion, positions in self._positions.items():
            if not positions:
                raise refused(f"to_{self._unit}.{motion}", "must be a list of positions")
        if (states := math.prod(map(len, self._positions.values()))) > MAX_STATES:
            raise refused("", f"has {states} combinations; at most {MAX_STATES} are possible")
        _ = self.steps[:1]  # a step rejects missing keys
        return self

    @property
    def _unit(self) -> str:
        return "deg" if self.to_mm is None else "mm"

    @property
    def _positions(self) -> Mapping[str, tuple[float, ...]]:
        return self.to_deg or self.to_mm or {}

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Steps to the combinations, in boustrophedon order, and to the scattered states."""
        keys = ("velocity_deg_per_s", "velocity_mm_per_s", "hold_s")
        common = {key: value for key in keys if (value := getattr(self, key))}
        combinations = boustrophedon(self._positions)
        scattered = _scattered(self._positions, self.scatter, combinations[-1])
        return tuple(Step(**{f"to_{self._unit}": state}, **common) for state in (*combinations, *scattered))


def boustrophedon(positions: Mapping[str, Sequence[float]]) -> list[dict[str, float]]:
    """Return every combination of positions, keyed by motion, in an order in which one motion moves at a time."""
    if not positions:
        return [{}]
    motion, inner = next(iter(positions)), boustrophedon(dict(list(positions.items())[1:]))
    paths = (inner if index % 2 == 0 else inner[::-1] for index in range(len(positions[motion])))
    return [
        {motion: position} | state for position, path in zip(positions[motion], paths, strict=True) for state in path
    ]


def _scattered(
    positions: Mapping[str, Sequence[float]], count: int, begin: Mapping[str, float]
) -> Iterator[dict[str, float]]:
    """Yield states of a Halton sequence over the ranges of positions, in an order with short moves."""
    low, high = (np.array([end(values) for values in positions.values()]) for end in (min, max))
    remaining = low + (high - low) * _halton(count, len(positions))
    state = np.array(list(begin.values()))
    while len(remaining):
        nearest = int(np.argmin(np.abs((remaining - state) / np.maximum(high - low, 1e-9)).max(axis=1)))
        state, remaining = remaining[nearest], np.delete(remaining, nearest, axis=0)
        yield dict(zip(positions, np.round(state, 4).tolist(), strict=True))


def _halton(count: int, dimensions: int) -> FloatArray:
    """Return the first points (count, dimensions) of the Halton sequence, evenly spread over the unit cube."""
    points = np.zeros((count, dimensions))
    for column, base in enumerate(PRIMES[:dimensions]):
        number, weight = np.arange(1, count + 1), 1.0
        while number.any():
            weight /= base
            points[:, column] += weight * (number % base)
            number = number // base
    return points


class Protocol(BenchTable):
    """Steps, the number of their repetitions, and the rest before and after them."""

    name: Text = Field(description="name of the protocol.")
    cycles: Annotated[int, Field(strict=True, ge=1, le=100_000)] = Field(
        1, description="Number of repetitions of the steps."
    )
    rest_s: NotNegative = Field(1.0, description="Rest before the first cycle and after the last, in s.")
    slow_cycles: Annotated[int, Field(strict=True, ge=0, le=100_000)] = Field(
        0,
        description="Further cycles at a lower velocity: they distinguish a lag in time from hysteresis.",
    )
    slow_share: Annotated[Number, Field(gt=0, lt=1)] | None = Field(
        None, description="Velocity of the slow cycles, as a fraction of that of the others; default: a third."
    )
    position_rate_hz: Annotated[Number, Field(gt=0, le=1000)] = Field(
        50.0, description="Position queries of the stage per second."
    )
    grid: Grid | None = Field(None, description="Positions of several motions, [grid], visited before the steps.")
    step: Annotated[tuple[Step, ...], Field(max_length=1000)] = Field((), description="The steps, [[step]].")

    @model_validator(mode="after")
    def _check_steps(self) -> Self:
        if not self.steps:
            raise refused("step", "is missing: a protocol has at least one", remedy="add [[step]] or [grid]")
        last = self.steps[-1]
        if last.to_N is not None:
            limit = "the last step must be to a position, at which the next cycle begins"
            raise refused("step.to_N", limit, value=last.to_N, remedy="end with a step to_mm, for example back to 0")
        if len({step.unit for step in self.steps}) > 1:
            raise refused("step", "must all be in deg, or all in mm")
        if len({"" in step.targets for step in self.steps}) > 1:
            raise refused("step", "must either all name motions, or all name none")
        if self.slow_share is not None and self.slow_cycles == 0:
            raise refused("slow_share", "requires slow_cycles", value=self.slow_share, remedy="omit it")
        if self.shortest_s > MAX_DURATION_S:
            days = self.shortest_s / 86_400.0
            raise refused("cycles", f"take {days:.3g} days; a protocol may take a week at most", value=self.cycles)
        return self

    @cached_property
    def steps(self) -> tuple[Step, ...]:
        """Steps of a cycle at full velocity: those of the grid, then the others."""
        return (*(() if self.grid is None else self.grid.steps), *self.step)

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of its moves."""
        return self.steps[0].unit

    @property
    def farthest(self) -> float:
        """Largest distance of a target position from zero, in its unit."""
        return max(step.farthest for step in self.steps if step.to_N is None)

    @cached_property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """Lowest and highest target position of each motion; a single motion has no name."""
        targets: dict[str, list[float]] = {}
        for step in (step for step in self.steps if step.to_N is None):
            for motion, target in step.targets.items():
                targets.setdefault(motion, []).append(target)
        return {motion: (min(values), max(values)) for motion, values in targets.items()}

    @property
    def forces_N(self) -> tuple[float, ...]:
        """Target forces of its steps in N."""
        return tuple(step.to_N for step in self.steps if step.to_N is not None)

    @property
    def all_cycles(self) -> int:
        """Number of cycles at full velocity and slow cycles."""
        return self.cycles + self.slow_cycles

    @property
    def fastest(self) -> float:
        """Highest velocity, in its unit per s."""
        return max(step.velocity for step in self.steps)

    def steps_of(self, cycle: int) -> tuple[Step, ...]:
        """Return the steps of a cycle, counted from 1; slow cycles come after the others."""
        return self.steps if cycle <= self.cycles else tuple(step.slowed(self._slow_fraction) for step in self.steps)

    @property
    def shortest_s(self) -> float:
        """Shortest duration in s, for a stage that accelerates at once."""
        position, moves_s = self.steps[-1].targets, 0.0
        for step in (step for step in self.steps if step.to_N is None):
            distance = max(abs(target - position.get(motion, target)) for motion, target in step.targets.items())
            moves_s += distance / step.velocity
            position = position | step.targets
        holds_s = self.all_cycles * sum(step.hold_s for step in self.steps)
        return 2.0 * self.rest_s + holds_s + moves_s * (self.cycles + self.slow_cycles / self._slow_fraction)

    @property
    def _slow_fraction(self) -> float:
        return self.slow_share or SLOW_FRACTION


def load_protocol(path: Path) -> Protocol:
    """Read a protocol from a file; raise `BenchError` if it cannot be read or is invalid."""
    return load_table(path, Protocol)
