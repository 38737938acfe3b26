"""Stepper motors on a board with GRBL 1.1, as in small mills and on bare Arduinos with a CNC shield.

A move is a jog in machine coordinates, which does not change the controller's modal state and can be cancelled at any
time by a single byte. ``?`` is answered at once, even while the axis moves. The controller counts steps without
feedback: after power-up, or after a reset caused by opening its port, its position is unknown, and a run begins by
homing or by defining the current position. Commands, settings and codes: Grbl v1.1 wiki, "Commands", "Jogging",
"Configuration" and "Interface".

Public name: `GrblStage`.
"""

import re
from typing import Any

from solen.bench.clock import Clock
from solen.bench.gcode import AXES, GcodeStage
from solen.bench.link import Link

CANCEL, STATUS = b"\x85", b"?"
BEGINS_S = 0.25
"""Time in s after a command during which the move may not have begun yet."""
AT_REST = {"Idle", "Alarm", "Check", "Sleep"}
ERRORS = {
    5: "homing is not enabled ($22)",
    8: "it is not idle",
    9: "it is locked after an alarm",
    15: "the target is outside its soft limits ($130 to $132)",
    16: "it does not support this jog command",
    22: "no feed rate",
}
"""Meanings of the controller error codes; other errors are reported by number."""
_STATUS = re.compile(r"<(\w+)(?::\d)?\|(?:.*\|)?MPos:([-\d.,]+)")
_SETTING = re.compile(r"\$(\d+)=([-\d.]+)")


class GrblStage(GcodeStage):
    """One axis of a controller; ``$100`` to ``$102`` set its steps per unit.

    The controller must report machine positions.
    """

    firmware, wakes_s = "GRBL", 5.0

    def __init__(self, link: Link, clock: Clock, **more: Any) -> None:
        super().__init__(link, clock, **more)
        self._place = AXES.index(self._axis)
        self._zero: float | None = None
        self._target, self._begun_s = 0.0, 0.0
        self._awake(self._status)
        self._lines.forget()
        self.identity = next((line for line in self._command("$I") if line.startswith("[VER:")), "")
        if not self.identity.startswith("[VER:1.1"):
            raise self._refusal(f"answered {self.identity!r} as its version", "GRBL 1.1 is needed")
        self._settings = {
            int(number): float(value) for line in self._command("$$") for number, value in _SETTING.findall(line)
        }

    @property
    def referenced(self) -> bool:
        """Whether the zero has been set or found since the controller was connected."""
        return self._zero is not None

    @property
    def search(self) -> str:
        """Description of the homing move and its range."""
        if not self._setting(22):
            return "It has no switch that marks its zero ($22=0)."
        return f"It moves to its limit switch, by up to {self._setting(130 + self._place):g} {self.unit}."

    def reference(self) -> None:
        """Move to the limit switch, unless the zero is known."""
        if self.referenced:
            return
        self._command("$H", self._home_s)
        self._zero = 0.0

    def set_position(self, position: float) -> None:
        """Define the current position as the specified value without moving."""
        state, at = self._status()
        if state == "Alarm":  # it waits for homing
            self._command("$X")
        self._zero = at - position

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        if self._zero is None:
            raise self._refusal("does not know its zero", "reference it first")
        highest = self._setting(110 + self._place) / 60.0
        if velocity > highest:
            limit = f"{velocity:g} {self.unit}/s is above its highest velocity, {highest:g} (${110 + self._place})"
            raise self._refusal(limit, "move more slowly")
        self._target = target + self._zero
        self._begun_s = self._clock.now_s()
        self._command(f"$J=G21 G90 G53 {self._axis}{self._target:.4f} F{60.0 * velocity:.3f}")

    def position(self) -> float:
        """Return the position of the axis in deg or mm, computed from the steps sent to its motor."""
        return self._status()[1] - (self._zero or 0.0)

    def on_target(self) -> bool:
        """Whether the axis has come to rest at its target; raise `BenchError` if it rests elsewhere."""
        state, at = self._status()
        if state not in AT_REST:
            return False
        step = 1.0 / max(self._setting(100 + self._place), 1e-9)
        if state != "Alarm" and abs(at - self._target) <= 0.5 * step + 2e-3:
            return True
        if state == "Alarm" or self._clock.now_s() > self._begun_s + BEGINS_S:
            limit = f"rests at {at:g}, but was sent to {self._target:g} (state {state})"
            raise self._refusal(limit, "check whether a limit switch or the reset button stopped it")
        return False

    def stop(self) -> None:
        """Stop with the configured deceleration of the axis; the remaining motion is discarded."""
        self._link.write(CANCEL)
        self._lines.forget()
        self._come_to_rest(lambda: self._status()[0] in AT_REST)

    def _status(self) -> tuple[str, float]:
        """Return state and machine position."""
        self._send(STATUS)
        for _ in range(10):
            line = self._lines.next().strip()
            if line.startswith("ALARM:"):
                raise self._refusal(f"raised {line}", "check the stage")
            if line.startswith("<"):
                match = _STATUS.match(line)
                places = match[2].split(",") if match else []
                if match is None or len(places) <= self._place:
                    raise self._refusal(f"answered {line!r}", "let it report machine positions: $10=1")
                self._lines.owed = False
                return match[1], float(places[self._place])
        raise self._refusal(
            f"answered {line[:40]!r}, which is not a state",
            "check that the controller runs GRBL and that the baud rate is correct",
        )

    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends an answer; raise `BenchError` if the line is an error message."""
        if line.startswith(("error:", "ALARM:")):
            raise self._refusal(f"{text}: {_meaning(line)}", "see the wiki of GRBL")
        return line == "ok"

    def _setting(self, number: int) -> float:
        return self._settings.get(number, 0.0)


def _meaning(line: str) -> str:
    kind, _, code = line.partition(":")
    known = ERRORS.get(int(code), "") if kind == "error" and code.isdigit() else ""
    return f"{line}, {known}" if known else line
