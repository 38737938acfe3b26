"""Stages of Zaber: one axis of a controller, or of a device with its own, with the Zaber ASCII protocol.

Each command is a line that begins with a slash, device and axis. Each is answered by one line that states whether it
was accepted, whether the axis is idle, and a warning. Positions are in microsteps, whose size depends on the device;
velocities are in microsteps per second times 1.6384. Commands, warnings and units: Zaber ASCII Protocol Manual.

Public name: `ZaberStage`.
"""

import re
from dataclasses import dataclass
from typing import Literal

from solen.bench.clock import Clock
from solen.bench.line_stage import LineStage
from solen.bench.link import Link

SPEED = 1.6384
"""Value of ``maxspeed`` for one microstep per second."""
UNREFERENCED = {"WR", "WH"}
WARNINGS = {
    "FD": "its driver is off",
    "FQ": "its encoder is faulty",
    "FS": "it stalled and stopped",
    "FT": "it is overheated",
    "FB": "it was stopped at its limit",
    "FE": "it found an end other than its limit",
}
"""Meaning of the axis's faults; others are shown by their letters."""
_REPLY = re.compile(r"@(\d+) (\d+) (OK|RJ) (IDLE|BUSY) (--|[A-Z]{2})(?: ([^:]*))?(?::[0-9A-F]{2})?$")


@dataclass(frozen=True)
class Reply:
    """Whether the axis is at rest, its warning (``--`` for none), and the data of an answer."""

    idle: bool
    warning: str
    data: str


class ZaberStage(LineStage):
    """One axis.

    Parameters
    ----------
    link, clock
        Line to the device, and the clock that time-outs follow.
    steps_per_unit
        Microsteps per deg or mm, by the device's specifications.
    unit
        Unit of its positions.
    axis, address
        The number of the axis, and that of the device.
    answer_s, home_s
        Longest duration of an answer, and of homing.

    Raises
    ------
    BenchError
        If the device does not answer, rejects a command, or warns of a fault.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        steps_per_unit: float,
        unit: Literal["deg", "mm"] = "deg",
        axis: str = "1",
        address: int = 1,
        answer_s: float = 1.0,
        home_s: float = 120.0,
    ) -> None:
        super().__init__(f"Zaber device {address} axis {axis} at {link.name}", link, clock, answer_s)
        self.unit, self._home_s = unit, home_s
        self._to, self._per_unit = (address, axis), steps_per_unit
        self._velocity: float | None = None
        self._target = 0
        self._lines.forget()
        self.limits = self._limit("min"), self._limit("max")

    @property
    def referenced(self) -> bool:
        """Whether the device knows the zero position."""
        return self._ask("get pos").warning not in UNREFERENCED

    @property
    def search(self) -> str:
        """Range of the move that finds the zero."""
        low, high = self.limits
        return f"It moves to its home sensor, by up to {high - low:g} {self.unit}."

    def reference(self) -> None:
        """Move to the home sensor, unless the zero is known."""
        if self.referenced:
            return
        self._ask("home")
        self._come_home(lambda: self._ask("get pos").idle, self._home_s)
        self._check(self._ask("get pos"))

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
        self._ask(f"set pos {self._steps(position)}")

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        if velocity != self._velocity:
            self._ask(f"set maxspeed {round(SPEED * velocity * self._per_unit)}")
            self._velocity = velocity
        self._target = self._steps(target)
        self._ask(f"move abs {self._target}")

    def position(self) -> float:
        """Return the position of the axis in deg or mm."""
        return float(self._ask("get pos").data) / self._per_unit

    def on_target(self) -> bool:
        """Whether the axis has come to rest at its target.

        Raises `BenchError` if it rests elsewhere or warns of a fault.
        """
        reply = self._ask("get pos")
        if not reply.idle:
            return False
        self._check(reply)
        if abs(float(reply.data) - self._target) > max(2.0, 1e-3 * self._per_unit):
            raise self._refusal(
                f"rests at {reply.data} microsteps, but was sent to {self._target}", "check whether its knob turned it"
            )
        return True

    def stop(self) -> None:
        """Stop with the axis' deceleration."""
        self._cut_in(self._line("stop"))
        self._ask("stop")
        self._come_to_rest(lambda: self._ask("get pos").idle)

    def _steps(self, position: float) -> int:
        return round(position * self._per_unit)

    def _limit(self, end: str) -> float:
        return float(self._ask(f"get limit.{end}").data) / self._per_unit

    def _ask(self, text: str) -> Reply:
        """Return the answer to a command; unsolicited alerts and remarks of the device are ignored."""
        self._send(self._line(text))
        while (line := self._lines.next().strip())[:1] in {"!", "#"}:
            pass
        match = _REPLY.match(line)
        if match is None or (int(match[1]), match[2]) != self._to:
            raise self._refusal(
                f"answered {line!r} to {text}", "check the address, the axis and the baud rate (115200)"
            )
        self._lines.owed = False
        if match[3] == "RJ":
            raise self._refusal(f"{text}: refused, {match[6]}", "see the protocol's manual")
        return Reply(match[4] == "IDLE", match[5], match[6] or "")

    def _line(self, text: str) -> bytes:
        address, axis = self._to
        return f"/{address} {axis} {text}\n".encode("ascii")

    def _check(self, reply: Reply) -> None:
        if reply.warning.startswith("F"):
            meaning = WARNINGS.get(reply.warning, "see the protocol's manual")
            raise self._refusal(f"warns of {reply.warning}: {meaning}", "check that it is free to move")
