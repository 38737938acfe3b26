"""Common part of stages at the end of a line: a stop that is waited for, and a line that is closed whatever happens.

Public name: `LineStage`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

from solen.bench.clock import Clock
from solen.bench.link import Cut, Lines, Link, line_of
from solen.errors import BenchError

STOPS_S, STOP_LOOK_S, HOME_LOOK_S = 2.0, 0.01, 0.05


class LineStage(ABC):
    """Base of a stage that is controlled over a link.

    Parameters
    ----------
    name
        Name of the stage, with that of its link.
    link, clock
        Line to the stage, and the clock that time-outs follow.
    answer_s
        Longest duration of an answer.
    cut
        Splits off an answer that is not a line.
    """

    def __init__(self, name: str, link: Link, clock: Clock, answer_s: float = 1.0, cut: Cut = line_of) -> None:
        self.name = name
        self._link, self._clock = link, clock
        self._lines = Lines(link, clock, timeout_s=answer_s, cut=cut)

    @abstractmethod
    def stop(self) -> None:
        """Stop at once; the remaining motion, and a late answer to an earlier question, are discarded."""

    def close(self) -> None:
        """Stop and close the line."""
        try:
            self.stop()
        finally:
            self._link.close()

    def _send(self, data: bytes) -> None:
        """Send bytes, after discarding late answers to earlier questions."""
        if self._lines.owed:
            self._lines.forget()
        self._lines.owed = True
        self._link.write(data)

    def _cut_in(self, stop: bytes) -> None:
        """After an interrupted query, as by Ctrl-C: send a stop first, then discard pending input."""
        if self._lines.owed:
            self._link.write(stop)
            self._lines.settle()

    def _came_true(self, done: Callable[[], bool], within_s: float, every_s: float) -> bool:
        """Poll until a condition is true; return False after a time-out."""
        due = self._clock.now_s() + within_s
        while not done():
            if self._clock.now_s() > due:
                return False
            self._clock.sleep(every_s)
        return True

    def _come_to_rest(self, resting: Callable[[], bool]) -> None:
        """Wait for rest after a stop; raise `BenchError` if the stage keeps moving."""
        if not self._came_true(resting, STOPS_S, STOP_LOOK_S):
            raise self._refusal("does not stop", "cut its supply")

    def _come_home(self, there: Callable[[], bool], within_s: float) -> None:
        """Wait for the end of homing; after a time-out, stop it and raise `BenchError`."""
        if not self._came_true(there, within_s, HOME_LOOK_S):
            self.stop()
            raise self._refusal(f"no reference found within {within_s:g} s", "check that the stage is free to move")

    def _refusal(self, limit: str, remedy: str) -> BenchError:
        return BenchError(self.name, limit=limit, remedy=remedy)
