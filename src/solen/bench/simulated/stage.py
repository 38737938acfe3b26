"""A simulated stage: it moves with its velocity and its acceleration straight to its target.

A move is a trapezoid in velocity (a triangle if the distance is too short for the full velocity). The position at any
time therefore is a closed formula, without time steps, evaluated for many times at once.

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
        Initial and final position, in the axis' unit.
    velocity, acceleration
        Its highest velocity and its acceleration, per s and per s².
    """

    begin_s: float
    start: float
    target: float
    velocity: float
    acceleration: float

    @cached_property
    def ramp_s(self) -> float:
        """Duration of the acceleration, and of the deceleration."""
        way = abs(self.target - self.start)
        return min(self.velocity / self.acceleration, math.sqrt(way / self.acceleration))

    @cached_property
    def end_s(self) -> float:
        """Time at which the move ends."""
        ramp = self.ramp_s
        if ramp == 0.0:
            return self.begin_s
        way = abs(self.target - self.start)
        return self.begin_s + ramp + way / (self.acceleration * ramp)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return positions at times, shape as given; before the move the start, after it the target."""
        ramp, total = self.ramp_s, self.end_s - self.begin_s
        since = np.clip(time_s - self.begin_s, 0.0, total)
        left = total - since
        # acceleration, constant velocity, deceleration: the distance from the start, or to the target
        up = 0.5 * self.acceleration * np.minimum(since, ramp) ** 2
        down = 0.5 * self.acceleration * np.minimum(left, ramp) ** 2
        way = abs(self.target - self.start)
        steady = self.acceleration * ramp * np.clip(since - ramp, 0.0, max(total - 2.0 * ramp, 0.0))
        gone = np.where(left < ramp, way - down, up + steady)
        return self.start + math.copysign(1.0, self.target - self.start) * gone

    def where(self, time_s: float) -> float:
        """Return the position at one time, without the cost of arrays: a stage is read fifty times a second."""
        ramp, total = self.ramp_s, self.end_s - self.begin_s
        since = min(max(time_s - self.begin_s, 0.0), total)
        left = total - since
        if left < ramp:
            gone = abs(self.target - self.start) - 0.5 * self.acceleration * left**2
        else:
            steady = self.acceleration * ramp * min(max(since - ramp, 0.0), max(total - 2.0 * ramp, 0.0))
            gone = 0.5 * self.acceleration * min(since, ramp) ** 2 + steady
        return self.start + math.copysign(1.0, self.target - self.start) * gone


@dataclass
class Axis:
    """Position of an axis as a sequence of moves.

    Attributes
    ----------
    acceleration
        Acceleration of all its moves, per s².
    rest
        Position before its first move.
    """

    acceleration: float
    rest: float = 0.0
    moves: list[Move] = field(default_factory=list)

    def send(self, at_s: float, target: float, velocity: float) -> Move:
        """Begin a move now, aborting any earlier one."""
        start = self.at(at_s)
        self.halt(at_s)
        move = Move(at_s, start, target, velocity, self.acceleration)
        self.moves.append(move)
        return move

    def halt(self, at_s: float) -> None:
        """Stop the motion immediately."""
        if self.moves and self.moves[-1].end_s > at_s:
            self.moves.append(Move(at_s, here := self.at(at_s), here, 1.0, self.acceleration))

    def moving(self, at_s: float) -> bool:
        """Whether it moves."""
        return bool(self.moves) and self.moves[-1].begin_s <= at_s < self.moves[-1].end_s

    def at(self, at_s: float) -> float:
        """Return the position at a time."""
        place = max(bisect_right(self.moves, at_s, key=_begin) - 1, 0)
        return self.moves[place].where(at_s) if self.moves else self.rest

    def positions(self, time_s: FloatArray) -> FloatArray:
        """Return the positions at ascending times, shape (N,)."""
        found = np.full(len(time_s), self.rest)
        if len(time_s) == 0 or not self.moves:
            return found
        first = max(bisect_right(self.moves, time_s[0], key=_begin) - 1, 0)
        moves = self.moves[first : bisect_right(self.moves, time_s[-1], key=_begin)]
        begins = np.searchsorted(time_s, [move.begin_s for move in moves]).tolist()
        for move, begin, end in zip(moves, begins, [*begins[1:], len(time_s)], strict=False):
            found[begin:end] = move.at(time_s[begin:end])
        return found


def _begin(move: Move) -> float:
    return move.begin_s


class SimulatedStage:
    """A simulated `Stage`.

    Attributes
    ----------
    axis
        Its position at any time.
    """

    def __init__(self, clock: Clock, unit: Literal["deg", "mm"] = "deg", name: str = "simulated stage") -> None:
        self.name = name
        self.unit: Literal["deg", "mm"] = unit
        self.axis = Axis(ACCELERATION[unit])
        self._clock = clock

    def reference(self) -> None:
        """Do nothing: its zero is always known."""

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move; raise `BenchError` beyond its limits."""
        low, high = LIMITS[self.unit]
        if not low <= target <= high:
            limit = f"{target:g} {self.unit} is outside its limits {low:g} to {high:g}"
            raise BenchError(self.name, limit=limit, remedy="move less far")
        if velocity > MAX_SPEED[self.unit]:
            limit = f"{velocity:g} {self.unit}/s is above its highest velocity, {MAX_SPEED[self.unit]:g}"
            raise BenchError(self.name, limit=limit, remedy="move more slowly")
        self.axis.send(self._clock.now_s(), target, velocity)

    def position(self) -> float:
        """Return the position."""
        return self.axis.at(self._clock.now_s())

    def on_target(self) -> bool:
        """Whether it is at its target."""
        return not self.axis.moving(self._clock.now_s())

    def stop(self) -> None:
        """Stop the motion."""
        self.axis.halt(self._clock.now_s())

    def close(self) -> None:
        """Stop the motion."""
        self.stop()
