"""The time of a run: that of the wall, or a simulated one that passes only while something waits.

The idea: nothing on the bench asks the system for the time or sleeps by itself; it is given a clock. With a
`SimulatedClock` a protocol of a minute runs as fast as its numbers can be computed, and twice the same.

The interface: `Clock`; `WallClock`, `SimulatedClock`.
"""

import time
from typing import Protocol

from solen.errors import BenchError


class Clock(Protocol):
    """Seconds since some beginning, never going back, and a way to wait."""

    def now_s(self) -> float:
        """Seconds since the clock's beginning."""

    def sleep(self, duration_s: float) -> None:
        """Wait."""


class WallClock:
    """The computer's own time, counted from what it is when the clock is made."""

    def __init__(self, at_s: float = 0.0) -> None:
        self._begun = time.monotonic() - at_s

    def now_s(self) -> float:
        """Seconds since the clock's beginning."""
        return time.monotonic() - self._begun

    def sleep(self, duration_s: float) -> None:
        """Wait."""
        time.sleep(max(0.0, duration_s))


class SimulatedClock:
    """A time that passes only in `sleep`, and then at once."""

    def __init__(self, at_s: float = 0.0) -> None:
        self._at_s = at_s

    def now_s(self) -> float:
        """Seconds since the clock's beginning."""
        return self._at_s

    def sleep(self, duration_s: float) -> None:
        """Pass the time at once."""
        if duration_s < 0.0:
            raise BenchError("time to wait", value=duration_s, limit="must not be negative")
        self._at_s += duration_s
