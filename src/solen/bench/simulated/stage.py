"""A simulated stage, which moves to its target with a trapezoidal velocity profile.

The profile is a triangle if the distance is too short for the full velocity. The position at any time is a closed-form
expression, evaluated for many times at once without time steps.

Public names: `SimulatedStage`, `Axis` and `Move`.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from solen.arrays import FloatArray
from solen.bench.clock import Clock
from solen.errors import BenchError

LIMITS = {"deg": (-180.0, 180.0), "mm": (-7.5, 7.5)}
MAX_SPEED = {"deg": 20.0, "mm": 10.0}
ACCELERATION = {"deg": 200.0, "mm": 50.0}


@dataclass(frozen=True)
class Move:
    """One move from rest to rest.

    Attributes
    ----------
    begin_s
        Time at which it begins.
    start, target
        Initial and final position, in the unit of the axis.
    velocity, acceleration
        Highest velocity and acceleration, per s and per s².
    """

    begin_s: float
    start: float
    target: float
    velocity: float
    acceleration: float

    @cached_property
    def ramp_s(self) -> float:
        """Duration of the acceleration, and of the deceleration."""
        return min(self.velocity / self.acceleration, math.sqrt(self.distance / self.acceleration))

    @property
    def distance(self) -> float:
        """Distance from start to target."""
        return abs(self.target - self.start)

    @cached_property
    def end_s(self) -> float:
        """Time at which the move ends."""
        ramp = self.ramp_s
        if ramp == 0.0:
            return self.begin_s
        return self.begin_s + ramp + self.distance / (self.acceleration * ramp)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return positions at times (N,); before the move the start, after it the target."""
        ramp, total = self.ramp_s, self.end_s - self.begin_s
        elapsed = np.clip(time_s - self.begin_s, 0.0, total)
        remaining = total - elapsed
        accelerated = 0.5 * self.acceleration * np.minimum(elapsed, ramp) ** 2
        uniform = self.acceleration * ramp * np.clip(elapsed - ramp, 0.0, max(total - 2.0 * ramp, 0.0))
        decelerated = 0.5 * self.acceleration * np.minimum(remaining, ramp) ** 2
        moved = np.where(remaining < ramp, self.distance - decelerated, accelerated + uniform)
        return self.start + math.copysign(1.0, self.target - self.start) * moved

    def at_time(self, time_s: float) -> float:
        """Return the position at one time, without the overhead of arrays: a stage is queried 50 times a second."""
        ramp, total = self.ramp_s, self.end_s - self.begin_s
        elapsed = min(max(time_s - self.begin_s, 0.0), total)
        remaining = total - elapsed
        if remaining < ramp:
            moved = self.distance - 0.5 * self.acceleration * remaining**2
        else:
            uniform = self.acceleration * ramp * min(max(elapsed - ramp, 0.0), max(total - 2.0 * ramp, 0.0))
            moved = 0.5 * self.acceleration * min(elapsed, ramp) ** 2 + uniform
        return self.start + math.copysign(1.0, self.target - self.start) * moved


@dataclass
class Axis:
    """Position of an axis as a sequence of moves.

    Attributes
    ----------
    acceleration
        Acceleration of all moves, per s².
    initial
        Position before the first move.
    """

    acceleration: float
    initial: float = 0.0
    moves: list[Move] = field(default_factory=list)

    def send(self, at_s: float, target: float, velocity: float) -> Move:
        """Begin a move; one that is in progress is aborted."""
        start = self.at(at_s)
        self.halt(at_s)
        move = Move(at_s, start, target, velocity, self.acceleration)
        self.moves.append(move)
        return move

    def halt(self, at_s: float) -> None:
        """Stop at once, without deceleration."""
        if self.moves and self.moves[-1].end_s > at_s:
            position = self.at(at_s)
            self.moves.append(Move(at_s, position, position, 1.0, self.acceleration))

    def moving(self, at_s: float) -> bool:
        """Whether it moves."""
        return bool(self.moves) and self.moves[-1].begin_s <= at_s < self.moves[-1].end_s

    def at(self, at_s: float) -> float:
        """Return the position at a time."""
        index = max(bisect_right(self.moves, at_s, key=_begin) - 1, 0)
        return self.moves[index].at_time(at_s) if self.moves else self.initial

    def positions(self, time_s: FloatArray) -> FloatArray:
        """Return the positions at ascending times, shape (N,)."""
        positions = np.full(len(time_s), self.initial)
        if len(time_s) == 0 or not self.moves:
            return positions
        first = max(bisect_right(self.moves, time_s[0], key=_begin) - 1, 0)
        moves = self.moves[first : bisect_right(self.moves, time_s[-1], key=_begin)]
        begins = np.searchsorted(time_s, [move.begin_s for move in moves]).tolist()
        for move, begin, end in zip(moves, begins, [*begins[1:], len(time_s)], strict=False):
            positions[begin:end] = move.at(time_s[begin:end])
        return positions


def _begin(move: Move) -> float:
    return move.begin_s


class SimulatedStage:
    """A simulated `Stage`.

    Attributes
    ----------
    axis
        Its motion.
    """

    def __init__(self, clock: Clock, unit: Literal["deg", "mm"] = "deg", name: str = "simulated stage") -> None:
        self.name = name
        self.unit: Literal["deg", "mm"] = unit
        self.axis = Axis(ACCELERATION[unit])
        self._clock = clock

    def reference(self) -> None:
        """Do nothing: it always has a zero."""

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move; raise `BenchError` if target or velocity are outside the limits."""
        low, high = LIMITS[self.unit]
        if not low <= target <= high:
            limit = f"is outside the limits of the stage, {low:g} to {high:g} {self.unit}"
            raise BenchError(f"{self.name}: target", value=target, limit=limit, remedy="choose a target within them")
        if velocity > MAX_SPEED[self.unit]:
            limit = f"is above the maximum of the stage, {MAX_SPEED[self.unit]:g} {self.unit}/s"
            raise BenchError(f"{self.name}: velocity", value=velocity, limit=limit, remedy="reduce the velocity")
        self.axis.send(self._clock.now_s(), target, velocity)

    def position(self) -> float:
        """Return the position."""
        return self.axis.at(self._clock.now_s())

    def on_target(self) -> bool:
        """Whether it is at rest."""
        return not self.axis.moving(self._clock.now_s())

    def stop(self) -> None:
        """Stop the motion."""
        self.axis.halt(self._clock.now_s())

    def close(self) -> None:
        """Stop the motion."""
        self.stop()
