"""Stepper motors on a board with Marlin, the firmware of many 3D printers.

The reply ``ok`` to a command comes as soon as the command is queued, long before the motor arrives; that to ``M400``
comes when all motion has ended. In between Marlin reports the target, not the position; the position is therefore known
only at rest, as for a stage turned by hand. ``M410`` stops at once and loses the step count. Commands: Marlin's G-code
reference, G1, G28, G90, G92, M114, M115, M400, M410.

Public name: `MarlinStage`.
"""

import math
import re
from typing import Any

from solen.bench.clock import Clock
from solen.bench.gcode import GcodeStage
from solen.bench.link import Link


class MarlinStage(GcodeStage):
    """One axis of a board; ``M92`` sets its steps per unit.

    Raises `BenchError` also if the firmware has no ``EMERGENCY_PARSER``, without which nothing could stop a move.
    """

    firmware, boot_s, patience_s = "Marlin", 8.0, 30.0

    def __init__(self, link: Link, clock: Clock, *, timeout_s: float = 2.0, **options: Any) -> None:
        super().__init__(link, clock, timeout_s=timeout_s, **options)
        self.referenced, self._pending, self._target = False, 0, 0.0
        self.identity = " ".join(self._first_reply(lambda: self._command("M115")))
        self._check_identity(self.identity)
        self._command("G90")

    @property
    def search(self) -> str:
        """Description of the homing move, whose range Marlin does not report."""
        return f"It moves to the limit switch of its {self._axis} axis, over an unknown distance."

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
            raise self._bench_error("has no zero", "reference it first")
        self._command(f"G1 {self._axis}{target:.4f} F{60.0 * velocity:.3f}")
        self._send(b"M400\n")
        self._pending, self._target = 1, target

    def position(self) -> float:
        """Return the position in deg or mm, computed from the steps sent to the motor; NaN while the axis moves."""
        if not self._settled():
            return math.nan
        text = " ".join(self._command("M114"))
        match = re.search(rf"\b{self._axis}:(-?[\d.]+)", text)
        if match is None:
            limit = f"replied {text!r} to M114"
            raise self._bench_error(limit, "check that the board runs Marlin and that the baud rate is correct")
        return float(match[1])

    def on_target(self) -> bool:
        """Whether the axis is at rest at its target; raise `BenchError` if it is at rest elsewhere."""
        if not self._settled():
            return False
        if abs((position := self.position()) - self._target) > 0.01:
            limit = f"stopped at {position:g} instead of {self._target:g}"
            raise self._bench_error(limit, "check whether a soft endstop (M211) stopped it")
        return True

    def stop(self) -> None:
        """Stop at once; if the axis moved, its zero is lost."""
        moved = not self._settled()
        self._link.write(b"M410\n")
        self._pending += 1
        self._wait_for_rest(self._settled)
        self.referenced = self.referenced and not moved

    def _check_identity(self, text: str) -> None:
        if "FIRMWARE_NAME:Marlin" not in text:
            raise self._bench_error(f"replied {text[:60]!r} to M115, which is not Marlin", "check the port")
        if "Cap:EMERGENCY_PARSER:0" in text:
            limit = "has no EMERGENCY_PARSER: M410 would wait for M400, and nothing could stop a move"
            raise self._bench_error(limit, "build the firmware with EMERGENCY_PARSER")

    def _settled(self) -> bool:
        """Whether all replies to M400 and M410 have arrived."""
        while self._pending and (line := self._replies.available_text()) is not None:
            self._pending -= self._ends(line, "M400")
        return not self._pending

    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends a reply; raise `BenchError` if it is an error message."""
        if line.startswith("Error:") or "Unknown command" in line:
            raise self._bench_error(f"{text}: {line}", "see the display of the board, and reset it")
        return line == "ok" or line.startswith("ok ")
