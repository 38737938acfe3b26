"""The time of a run: real time, or a simulated time that passes only while something waits.

No part of the bench asks the system for the time or sleeps directly, but uses the clock that is passed to it. With a
`SimulatedClock` a protocol of a minute runs as fast as its values can be computed, and always with the same result.

The readings of a clock that advances in steps are late by up to one step, `Clock.resolution_s`, which every recording
stores.

Public names: `Clock`, `WallClock` and `SimulatedClock`.
"""

import time
from collections.abc import Callable
from typing import Protocol

from solen.errors import BenchError


class Clock(Protocol):
    """Monotonic seconds since an arbitrary origin, and a function that waits."""

    def now_s(self) -> float:
        """Return the seconds since the clock's origin."""

    def sleep(self, duration_s: float) -> None:
        """Wait."""

    @property
    def resolution_s(self) -> float:
        """Step of the clock in s: an event stamped t occurred between t and t plus this step."""


class WallClock:
    """The computer's finest monotonic clock, which counts from its creation.

    Parameters
    ----------
    at_s
        Initial reading of the clock.
    source
        Function that returns monotonic seconds. `time.perf_counter` is the finest on every system; `time.monotonic`
        advances in steps of 15.6 ms on Windows before Python 3.13.
    """

    def __init__(self, at_s: float = 0.0, source: Callable[[], float] = time.perf_counter) -> None:
        self._source = source
        self.resolution_s = step_of(source)
        self._origin = source() - at_s

    def now_s(self) -> float:
        """Return the seconds since the clock's origin."""
        return self._source() - self._origin

    def sleep(self, duration_s: float) -> None:
        """Wait."""
        time.sleep(max(0.0, duration_s))


class SimulatedClock:
    """A simulated time that passes only in `sleep`, without delay."""

    resolution_s = 0.0

    def __init__(self, at_s: float = 0.0) -> None:
        self._at_s = at_s

    def now_s(self) -> float:
        """Return the seconds since the clock's origin."""
        return self._at_s

    def sleep(self, duration_s: float) -> None:
        """Advance the simulated time without waiting."""
        if duration_s < 0.0:
            raise BenchError("time to wait", value=duration_s, limit="must not be negative")
        self._at_s += duration_s


def step_of(source: Callable[[], float], steps: int = 5) -> float:
    """Return the step of a clock in s: the smallest of the first few changes of its reading."""
    smallest, before = float("inf"), source()
    while steps:
        now = source()
        if now > before:
            smallest, before, steps = min(smallest, now - before), now, steps - 1
    return smallest
