"""Common part of boards that execute G-code: an axis named by a letter, and lines that are answered with ``ok``.

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
AGAIN_S = 0.05
_Said = TypeVar("_Said")


class GcodeStage(LineStage):
    """One axis of a board.

    Parameters
    ----------
    link, clock
        Line to the board, and the clock that time-outs follow.
    unit
        Unit of the axis, for which its steps per unit are configured: G-code uses mm for both.
    axis
        Letter of the axis.
    answer_s, home_s
        Longest duration of an answer, and of homing.

    Raises
    ------
    BenchError
        If the board does not answer, or the answer is not one of its firmware.
    """

    firmware: ClassVar[str]
    wakes_s: ClassVar[float]
    """Time in s for which a board may not answer because opening its port reset it."""

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        unit: Literal["deg", "mm"] = "deg",
        axis: str = "X",
        answer_s: float = 1.0,
        home_s: float = 120.0,
    ) -> None:
        if axis not in AXES:
            raise BenchError("axis", value=axis, limit="must be X, Y or Z")
        super().__init__(f"{self.firmware} axis {axis} at {link.name}", link, clock, answer_s)
        self.unit: Literal["deg", "mm"] = unit
        self._axis, self._home_s = axis, home_s

    @abstractmethod
    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends the answer to a text; `BenchError` if it is the board's reason against it."""

    def _awake(self, ask: Callable[[], _Said]) -> _Said:
        """Its answer, as soon as it comes; earlier input is discarded."""
        due = self._clock.now_s() + self.wakes_s
        while True:
            self._lines.forget()
            try:
                return ask()
            except BenchError:
                if self._clock.now_s() > due:
                    raise
            self._clock.sleep(AGAIN_S)

    def _command(self, text: str, timeout_s: float = 0.0) -> list[str]:
        """Send a line; what is answered before its end. `BenchError` with the board's reason."""
        self._send(f"{text}\n".encode("ascii"))
        lines: list[str] = []
        due = self._clock.now_s() + timeout_s
        while True:
            try:
                line = self._lines.next().strip()
            except BenchError:
                if self._clock.now_s() >= due:
                    raise
                continue
            if self._ends(line, text):
                self._lines.owed = False
                return lines
            lines.append(line)
