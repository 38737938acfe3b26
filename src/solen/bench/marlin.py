"""Stepper motors on a board with Marlin, the firmware of many 3D printers.

A command is answered with ``ok`` as soon as it is queued, long before the motor arrives; ``M400`` is answered when all
motion has ended. In between Marlin reports the target, not the position; the position therefore is known only at rest,
as for a stage turned by hand. ``M410`` stops at once and loses the step count. Commands: Marlin's G-code reference, G1,
G28, G90, G92, M114, M115, M400, M410, M503.

Public name: `MarlinStage`.
"""

import math
import re
from typing import Any

from solen.bench.clock import Clock
from solen.bench.gcode import GcodeStage
from solen.bench.link import Link


class MarlinStage(GcodeStage):
    """One axis of a board, whose step is configured by ``M92``.

    Raises `BenchError` also if nothing could stop a move (no ``EMERGENCY_PARSER``).
    """

    firmware, wakes_s, patience_s = "Marlin", 8.0, 30.0

    def __init__(self, link: Link, clock: Clock, *, answer_s: float = 2.0, **more: Any) -> None:
        super().__init__(link, clock, answer_s=answer_s, **more)
        self.referenced, self._owed, self._target = False, 0, 0.0
        self.identity = " ".join(self._awake(lambda: self._command("M115")))
        self._check_identity(self.identity)
        self._command("G90")

    @property
    def search(self) -> str:
        """Range of the move that finds the zero, which Marlin does not report."""
        return f"It moves to the switch of its {self._axis} axis, over an unknown distance."

    def reference(self) -> None:
        """Move to the limit switch, unless the zero is known."""
        if not self.referenced:
            self._command(f"G28 {self._axis}", self._home_s)
            self.referenced = True

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
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
        """Return the position at rest in deg or mm, computed from the steps that were sent to the motor.

        The result is NaN while it moves.
        """
        if not self._settled():
            return math.nan
        text = " ".join(self._command("M114"))
        match = re.search(rf"\b{self._axis}:(-?[\d.]+)", text)
        if match is None:
            raise self._refusal(f"answered {text!r} to M114", "check that it runs Marlin, and the baud rate")
        return float(match[1])

    def on_target(self) -> bool:
        """Whether the axis has come to rest at the target; raise `BenchError` if its limits prevented that."""
        if not self._settled():
            return False
        if abs((at := self.position()) - self._target) > 0.01:
            raise self._refusal(
                f"rests at {at:g}, but was sent to {self._target:g}", "check whether its soft endstops (M211) stop it"
            )
        return True

    def stop(self) -> None:
        """Stop at once; if the axis moved, its zero is lost."""
        moved = not self._settled()
        self._link.write(b"M410\n")
        self._owed += 1
        self._come_to_rest(self._settled)
        self.referenced = self.referenced and not moved

    def _check_identity(self, text: str) -> None:
        if "FIRMWARE_NAME:Marlin" not in text:
            raise self._refusal(f"answered {text[:60]!r} as its name", "it is not Marlin")
        if "Cap:EMERGENCY_PARSER:0" in text:
            limit = "has no EMERGENCY_PARSER: M410 would wait behind M400, and nothing could stop a move"
            raise self._refusal(limit, "build its firmware with EMERGENCY_PARSER")

    def _settled(self) -> bool:
        """Whether no answer is outstanding any more, after reading the input."""
        while self._owed and (line := self._lines.there()) is not None:
            self._owed -= self._ends(line, "M400")
        return not self._owed

    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends an answer; raise `BenchError` if it is an error of the board."""
        if line.startswith("Error:") or "Unknown command" in line:
            raise self._refusal(f"{text}: {line}", "see the board's display, and reset it")
        return line == "ok" or line.startswith("ok ")
