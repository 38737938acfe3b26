"""Stepper motors on a board with GRBL 1.1, as in small mills and on bare Arduinos with a CNC shield.

A move is a jog in machine coordinates, which does not change the controller's modal state and can be cancelled at any
time by a single byte. The reply to ``?`` comes at once, even while the axis moves. The controller counts steps without
feedback: after power-up, or after a reset caused by opening its port, its position is unknown until the axis is homed
or the current position is defined. Commands, settings and codes: Grbl v1.1 wiki, "Commands", "Jogging", "Configuration"
and "Interface".

Public name: `GrblStage`.
"""

import re
from typing import Any

from solen.bench.clock import Clock
from solen.bench.gcode import AXES, GcodeStage
from solen.bench.link import Link

CANCEL, STATUS = b"\x85", b"?"
MAX_START_DELAY_S = 0.25
"""Longest time in s from a command to the beginning of the move."""
AT_REST = {"Idle", "Alarm", "Check", "Sleep"}
ERRORS = {
    5: "homing is not enabled ($22)",
    8: "the controller is not idle",
    9: "the controller is locked after an alarm",
    15: "the target is outside the soft limits ($130 to $132)",
    16: "this jog command is not supported",
    22: "the feed rate is missing",
}
"""Meanings of the controller's error codes; other errors are reported by number."""
_STATUS = re.compile(r"<(\w+)(?::\d)?\|(?:.*\|)?MPos:([-\d.,]+)")
_SETTING = re.compile(r"\$(\d+)=([-\d.]+)")


class GrblStage(GcodeStage):
    """One axis of a controller; ``$100`` to ``$102`` set its steps per unit.

    The controller must report machine positions.
    """

    firmware, boot_s = "GRBL", 5.0

    def __init__(self, link: Link, clock: Clock, **options: Any) -> None:
        super().__init__(link, clock, **options)
        self._axis_index = AXES.index(self._axis)
        self._zero: float | None = None
        self._target, self._begun_s = 0.0, 0.0
        self._first_reply(self._status)
        self._replies.discard()
        self.identity = next((line for line in self._command("$I") if line.startswith("[VER:")), "")
        if not self.identity.startswith("[VER:1.1"):
            limit = f"has version {self.identity!r}; GRBL 1.1 is needed"
            raise self._bench_error(limit, "install GRBL 1.1 on the board")
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
            return "It has no reference switch ($22=0)."
        return f"It moves to its limit switch, by up to {self._setting(130 + self._axis_index):g} {self.unit}."

    def reference(self) -> None:
        """Move to the limit switch, unless the zero is known."""
        if self.referenced:
            return
        self._command("$H", self._home_s)
        self._zero = 0.0

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
        state, machine_position = self._status()
        if state == "Alarm":  # it waits for homing
            self._command("$X")
        self._zero = machine_position - position

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        if self._zero is None:
            raise self._bench_error("has no zero", "reference it first")
        setting = 110 + self._axis_index
        highest = self._setting(setting) / 60.0
        if velocity > highest:
            limit = f"the velocity {velocity:g} is above its maximum, {highest:g} {self.unit}/s (${setting})"
            raise self._bench_error(limit, "reduce the velocity")
        self._target = target + self._zero
        self._begun_s = self._clock.now_s()
        self._command(f"$J=G21 G90 G53 {self._axis}{self._target:.4f} F{60.0 * velocity:.3f}")

    def position(self) -> float:
        """Return the position of the axis in deg or mm, computed from the steps sent to its motor."""
        return self._status()[1] - (self._zero or 0.0)

    def on_target(self) -> bool:
        """Whether the axis is at rest at its target; raise `BenchError` if it is at rest elsewhere."""
        state, machine_position = self._status()
        if state not in AT_REST:
            return False
        step = 1.0 / max(self._setting(100 + self._axis_index), 1e-9)
        if state != "Alarm" and abs(machine_position - self._target) <= 0.5 * step + 2e-3:
            return True
        if state == "Alarm" or self._clock.now_s() > self._begun_s + MAX_START_DELAY_S:
            limit = f"stopped at {machine_position:g} instead of {self._target:g} (state {state})"
            raise self._bench_error(limit, "check whether a limit switch or the reset button stopped it")
        return False

    def stop(self) -> None:
        """Stop with the configured deceleration of the axis; the remaining motion is discarded."""
        self._link.write(CANCEL)
        self._replies.discard()
        self._wait_for_rest(lambda: self._status()[0] in AT_REST)

    def _status(self) -> tuple[str, float]:
        """Return state and machine position."""
        self._send(STATUS)
        for _ in range(10):
            line = self._replies.text().strip()
            if line.startswith("ALARM:"):
                raise self._bench_error(f"reported {line}", "check the stage")
            if line.startswith("<"):
                match = _STATUS.match(line)
                positions = match[2].split(",") if match else []
                if match is None or len(positions) <= self._axis_index:
                    limit = f"replied {line!r}, without the machine position of the axis"
                    raise self._bench_error(limit, "set $10=1 on the controller")
                self._replies.pending = False
                return match[1], float(positions[self._axis_index])
        limit = f"replied {line[:40]!r}, which is not a state"
        raise self._bench_error(limit, "check that the controller runs GRBL and that the baud rate is correct")

    def _ends(self, line: str, text: str) -> bool:
        """Whether a line ends a reply; raise `BenchError` if the line is an error message."""
        if line.startswith(("error:", "ALARM:")):
            raise self._bench_error(f"{text}: {_meaning(line)}", "see the GRBL wiki")
        return line == "ok"

    def _setting(self, number: int) -> float:
        return self._settings.get(number, 0.0)


def _meaning(line: str) -> str:
    kind, _, code = line.partition(":")
    meaning = ERRORS.get(int(code), "") if kind == "error" and code.isdigit() else ""
    return f"{line}, {meaning}" if meaning else line
