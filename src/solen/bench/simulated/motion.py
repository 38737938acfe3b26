"""How a simulated stage moves: at its velocity, with its acceleration, straight to where it is sent.

The idea: a move is a trapezoid in velocity (a triangle where the way is too short for the full velocity), so that the
position at any time is a closed formula: no steps of time, and many times at once.

The interface: `Move` is one move; `Axis` is where an axis is, move after move.
"""

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Move:
    """One move from rest to rest.

    Attributes
    ----------
    begin_s
        When it begins.
    start, target
        From where to where, in the axis' unit.
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
        """Time of speeding up, and of slowing down."""
        way = abs(self.target - self.start)
        return min(self.velocity / self.acceleration, math.sqrt(way / self.acceleration))

    @cached_property
    def end_s(self) -> float:
        """When it is there."""
        ramp = self.ramp_s
        if ramp == 0.0:
            return self.begin_s
        way = abs(self.target - self.start)
        return self.begin_s + ramp + way / (self.acceleration * ramp)

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions at times, shape as given; before it begins the start, after it ends the target."""
        ramp, total = self.ramp_s, self.end_s - self.begin_s
        since = np.clip(time_s - self.begin_s, 0.0, total)
        left = total - since
        # speeding up, at speed, slowing down: the way from the start, or to the target
        up = 0.5 * self.acceleration * np.minimum(since, ramp) ** 2
        down = 0.5 * self.acceleration * np.minimum(left, ramp) ** 2
        way = abs(self.target - self.start)
        steady = self.acceleration * ramp * np.clip(since - ramp, 0.0, max(total - 2.0 * ramp, 0.0))
        gone = np.where(left < ramp, way - down, up + steady)
        return self.start + math.copysign(1.0, self.target - self.start) * gone

    def where(self, time_s: float) -> float:
        """The same at one time, without the cost of arrays: a stage is looked at fifty times a second."""
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
    """Where an axis is: its moves one after the other.

    Attributes
    ----------
    acceleration
        Of all its moves, per s².
    rest
        Where it is before its first move.
    """

    acceleration: float
    rest: float = 0.0
    moves: list[Move] = field(default_factory=list)

    def send(self, at_s: float, target: float, velocity: float) -> Move:
        """Begin a move now; what was under way is left where it is."""
        start = self.at(at_s)
        self.halt(at_s)
        move = Move(at_s, start, target, velocity, self.acceleration)
        self.moves.append(move)
        return move

    def halt(self, at_s: float) -> None:
        """Stand still from now on."""
        if self.moves and self.moves[-1].end_s > at_s:
            self.moves.append(Move(at_s, here := self.at(at_s), here, 1.0, self.acceleration))

    def moving(self, at_s: float) -> bool:
        """Whether it moves."""
        return bool(self.moves) and self.moves[-1].begin_s <= at_s < self.moves[-1].end_s

    def at(self, at_s: float) -> float:
        """Position at a time."""
        place = max(bisect_right(self.moves, at_s, key=_begin) - 1, 0)
        return self.moves[place].where(at_s) if self.moves else self.rest

    def positions(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions at ascending times, shape (N,)."""
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
