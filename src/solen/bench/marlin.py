"""Stepper motors on a board with Marlin, the firmware of many 3D printers.

The idea: a command is answered by ``ok`` as soon as it is taken in, long before the motor is there; ``M400`` when all
motion has ended. In between Marlin states where it is going to be, not where it is, so that a position is
known at rest only, as of a stage turned by hand. ``M410`` stops at once, and with it the count of steps is lost.
Commands: Marlin's G-code reference, G1, G28, G90, G92, M114, M115, M400, M410, M503.

The interface: `MarlinStage`, a `Stage` that `solen.bench.roles.Homes`.
"""

import math
import re
from typing import Literal

from solen.bench.clock import Clock
from solen.bench.line_stage import LineStage
from solen.bench.link import Link
from solen.errors import BenchError

WAKES_S = 8.0
"""A board that is reset as its port is opened answers after some seconds."""
AXES = "XYZ"


class MarlinStage(LineStage):
    """One axis of a board.

    Parameters
    ----------
    link, clock
        Line to the board, and the clock that time-outs follow.
    unit
        Of the axis, as its steps per unit are configured (``M92``): Marlin calls both mm.
    axis
        Its letter.
    answer_s, home_s
        How long an answer, and homing, may take.

    Raises
    ------
    BenchError
        Where the board does not answer, is no Marlin, or could not stop a move (no ``EMERGENCY_PARSER``).
    """

    patience_s = 30.0

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        unit: Literal["deg", "mm"] = "deg",
        axis: str = "X",
        answer_s: float = 2.0,
        home_s: float = 120.0,
    ) -> None:
        if axis not in AXES:
            raise BenchError("axis", value=axis, limit="must be X, Y or Z")
        super().__init__(f"Marlin axis {axis} at {link.name}", link, clock, answer_s)
        self.unit: Literal["deg", "mm"] = unit
        self._axis, self._home_s = axis, home_s
        self.referenced, self._owed, self._target = False, 0, 0.0
        self.identity = self._wake()
        self._command("G90")

    @property
    def search(self) -> str:
        """Marlin does not say how far."""
        return f"It drives to the switch of its {self._axis} axis, as far as that is."

    def reference(self) -> None:
        """Drive to the limit switch, unless its zero is known."""
        if not self.referenced:
            self._command(f"G28 {self._axis}", self._home_s)
            self.referenced = True

    def set_position(self, position: float) -> None:
        """Take where it stands for a position; nothing moves."""
        self._command(f"G92 {self._axis}{position:.4f}")
        self.referenced = True

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        if not self.referenced:
            raise self._refusal("does not know its zero", "reference it first")
        self._command(f"G1 {self._axis}{target:.4f} F{60.0 * velocity:.3f}")
        self._send(b"M400\n")
        self._owed, self._target = 1, target

    def position(self) -> float:
        """Where it is at rest, in deg or mm, by the steps that were sent to its motor; NaN while it moves."""
        if not self._settled():
            return math.nan
        text = " ".join(self._command("M114"))
        found = re.search(rf"\b{self._axis}:(-?[\d.]+)", text)
        if found is None:
            raise self._refusal(f"answered {text!r} to M114", "is it Marlin? check the baud rate")
        return float(found[1])

    def on_target(self) -> bool:
        """Whether it has come to rest where it was sent; `BenchError` where its own limits kept it from there."""
        if not self._settled():
            return False
        if abs((at := self.position()) - self._target) > 0.01:
            raise self._refusal(f"rests at {at:g}, sent to {self._target:g}", "do its soft endstops (M211) stop it?")
        return True

    def stop(self) -> None:
        """Stop at once; if it moved, its zero is lost."""
        moved = not self._settled()
        self._link.write(b"M410\n")
        self._owed += 1
        self._come_to_rest(self._settled)
        self.referenced = self.referenced and not moved

    def _wake(self) -> str:
        """Its name, when it answers: opening the port resets most boards, and what came before is of no use."""
        due = self._clock.now_s() + WAKES_S
        while True:
            self._lines.forget()
            try:
                text = " ".join(self._command("M115"))
            except BenchError:
                if self._clock.now_s() > due:
                    raise
                continue
            if "FIRMWARE_NAME:Marlin" not in text:
                raise self._refusal(f"answered {text[:60]!r} as its name", "it is not Marlin")
            if "Cap:EMERGENCY_PARSER:0" in text:
                limit = "has no EMERGENCY_PARSER: M410 would wait behind M400, and nothing could stop a move"
                raise self._refusal(limit, "build its firmware with EMERGENCY_PARSER")
            return text

    def _settled(self) -> bool:
        """Whether nothing is owed any more, with what has come."""
        while self._owed and (line := self._lines.there()) is not None:
            self._owed -= self._ends(line, "M400")
        return not self._owed

    def _command(self, text: str, timeout_s: float = 0.0) -> list[str]:
        """Send a line; what is answered before ``ok``. `BenchError` with the board's reason."""
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
                return lines
            lines.append(line)

    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends an answer; `BenchError` where it is the board's reason against it."""
        if line.startswith("Error:") or "Unknown command" in line:
            raise self._refusal(f"{text}: {line}", "see the board's display, and reset it")
        return line == "ok" or line.startswith("ok ")
