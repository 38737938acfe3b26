"""Common base of stages at the end of a line: stopping, homing and closing with time-outs.

Public name: `LineStage`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable

from solen.bench.clock import Clock
from solen.bench.link import Link, MessageReader, Split, split_line
from solen.errors import BenchError

STOP_TIMEOUT_S, STOP_POLL_S, HOMING_POLL_S = 2.0, 0.01, 0.05


class LineStage(ABC):
    """Base of a stage that is controlled over a link.

    Parameters
    ----------
    name
        Name of the stage, including that of its link.
    link, clock
        Line to the stage, and the clock used for time-outs.
    timeout_s
        Time limit in s for a reply.
    split
        Splits the first complete message off the received bytes.
    """

    def __init__(self, name: str, link: Link, clock: Clock, timeout_s: float = 1.0, split: Split = split_line) -> None:
        self.name = name
        self._link, self._clock = link, clock
        self._replies = MessageReader(link, clock, timeout_s=timeout_s, split=split)

    @abstractmethod
    def stop(self) -> None:
        """Stop at once; the remaining motion, and a late reply to an earlier query, are discarded."""

    def close(self) -> None:
        """Stop and close the line."""
        try:
            self.stop()
        finally:
            self._link.close()

    def _send(self, data: bytes) -> None:
        """Send bytes, after discarding late replies to earlier queries."""
        if self._replies.pending:
            self._replies.discard()
        self._replies.pending = True
        self._link.write(data)

    def _stop_pending_query(self, stop: bytes) -> None:
        """After an interrupted query, as by Ctrl-C, send a stop and discard all input until the line is silent."""
        if self._replies.pending:
            self._link.write(stop)
            self._replies.discard_until_silent()

    def _wait(self, done: Callable[[], bool], timeout_s: float, poll_s: float) -> bool:
        """Poll until a condition is true; return False after a time-out."""
        due = self._clock.now_s() + timeout_s
        while not done():
            if self._clock.now_s() > due:
                return False
            self._clock.sleep(poll_s)
        return True

    def _wait_for_rest(self, at_rest: Callable[[], bool]) -> None:
        """Wait until the stage is at rest after a stop; raise `BenchError` if it keeps moving."""
        if not self._wait(at_rest, STOP_TIMEOUT_S, STOP_POLL_S):
            raise self._bench_error("does not stop", "switch its supply off")

    def _wait_for_homing(self, homed: Callable[[], bool], timeout_s: float) -> None:
        """Wait for the end of homing; after a time-out, stop the stage and raise `BenchError`."""
        if not self._wait(homed, timeout_s, HOMING_POLL_S):
            self.stop()
            limit = f"has found no reference within {timeout_s:g} s"
            raise self._bench_error(limit, "check that the stage is free to move")

    def _bench_error(self, limit: str, remedy: str) -> BenchError:
        return BenchError(self.name, limit=limit, remedy=remedy)
