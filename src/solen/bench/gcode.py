"""Common base of boards that execute G-code: each axis is named by a letter, and each line is answered with ``ok``.

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
        Line to the board, and the clock used for time-outs.
    unit
        Unit of the axis, for which its steps per unit are configured; G-code writes mm for either unit.
    axis
        Letter of the axis.
    answer_s, home_s
        Time limits in s for an answer and for homing.

    Raises
    ------
    BenchError
        If the board does not answer, or answers unlike its firmware.
    """

    firmware: ClassVar[str]
    wakes_s: ClassVar[float]
    """Time in s for which a board may stay silent after opening its port has reset it."""

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
        """Whether a line ends the answer to a command; raise `BenchError` if the board rejects the command."""

    def _awake(self, ask: Callable[[], _Said]) -> _Said:
        """Return the board's answer as soon as it arrives; earlier input is discarded."""
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
        """Send a line and return the lines before the end of the answer; raise `BenchError` if it is rejected."""
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
