"""Common base of boards that execute G-code: an axis is named by a letter, and the reply to a line ends in ``ok``.

Public name: `GcodeStage`.
"""

from abc import abstractmethod
from collections.abc import Callable
from typing import ClassVar, Literal, TypeVar

from solen.bench.clock import Clock
from solen.bench.line_stage import LineStage
from solen.bench.link import Link
from solen.errors import BenchError

AXES = "XYZ"
BOOT_POLL_S = 0.05
_Reply = TypeVar("_Reply")


class GcodeStage(LineStage):
    """One axis of a board.

    Parameters
    ----------
    link, clock
        Line to the board, and the clock used for time-outs.
    unit
        Unit for which the steps per unit of the axis are configured; G-code writes mm for either unit.
    axis
        Letter of the axis.
    timeout_s, home_s
        Time limits in s for a reply and for homing.

    Raises
    ------
    BenchError
        If the board does not reply, or has another firmware.
    """

    firmware: ClassVar[str]
    boot_s: ClassVar[float]
    """Longest time in s for which a board stays silent after the opening of its port has reset it."""

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        unit: Literal["deg", "mm"] = "deg",
        axis: str = "X",
        timeout_s: float = 1.0,
        home_s: float = 120.0,
    ) -> None:
        if axis not in AXES:
            raise BenchError("axis", value=axis, limit="must be X, Y or Z")
        super().__init__(f"{self.firmware} axis {axis} at {link.name}", link, clock, timeout_s)
        self.unit: Literal["deg", "mm"] = unit
        self._axis, self._home_s = axis, home_s

    @abstractmethod
    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends the reply to a command; raise `BenchError` if the board rejects the command."""

    def _first_reply(self, query: Callable[[], _Reply]) -> _Reply:
        """Repeat a query until the board has booted and replies; earlier input is discarded."""
        due = self._clock.now_s() + self.boot_s
        while True:
            self._replies.discard()
            try:
                return query()
            except BenchError:
                if self._clock.now_s() > due:
                    raise
            self._clock.sleep(BOOT_POLL_S)

    def _command(self, text: str, timeout_s: float = 0.0) -> list[str]:
        """Send a line and return the lines before the end of the reply; raise `BenchError` if it is rejected."""
        self._send(f"{text}\n".encode("ascii"))
        lines: list[str] = []
        due = self._clock.now_s() + timeout_s
        while True:
            try:
                line = self._replies.text().strip()
            except BenchError:
                if self._clock.now_s() >= due:
                    raise
                continue
            if self._ends(line, text):
                self._replies.pending = False
                return lines
            lines.append(line)
