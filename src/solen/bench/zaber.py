"""Stages of Zaber: one axis of a controller, or of a device with a built-in one, with the Zaber ASCII protocol.

A command is a line that begins with a slash, device and axis. The reply is one line that states whether the command was
accepted, whether the axis is idle, and a warning. Positions are in microsteps, whose size depends on the device;
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
FAULTS = {
    "FD": "the driver is off",
    "FQ": "the encoder is faulty",
    "FS": "the axis stalled and stopped",
    "FT": "the driver is overheated",
    "FB": "a limit switch stopped the axis",
    "FE": "a limit was found at an unexpected position",
}
"""Meanings of the warnings that are faults; other faults are reported by their letters."""
_REPLY = re.compile(r"@(\d+) (\d+) (OK|RJ) (IDLE|BUSY) (--|[A-Z]{2})(?: ([^:]*))?(?::[0-9A-F]{2})?$")


@dataclass(frozen=True)
class Reply:
    """A reply: whether the axis is at rest, its warning (``--`` for none), and the data."""

    idle: bool
    warning: str
    data: str


class ZaberStage(LineStage):
    """One axis.

    Parameters
    ----------
    link, clock
        Line to the device, and the clock used for time-outs.
    steps_per_unit
        Microsteps per deg or mm, from the specifications of the device.
    unit
        Unit of the positions.
    axis, address
        Number of the axis, and number of the device.
    timeout_s, home_s
        Time limits in s for a reply and for homing.

    Raises
    ------
    BenchError
        If the device does not reply, rejects a command, or reports a fault.
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
        timeout_s: float = 1.0,
        home_s: float = 120.0,
    ) -> None:
        super().__init__(f"Zaber device {address} axis {axis} at {link.name}", link, clock, timeout_s)
        self.unit, self._home_s = unit, home_s
        self._address, self._per_unit = (address, axis), steps_per_unit
        self._velocity: float | None = None
        self._target = 0
        self._replies.discard()
        self.limits = self._limit("min"), self._limit("max")

    @property
    def referenced(self) -> bool:
        """Whether the device knows the zero position."""
        return self._query("get pos").warning not in UNREFERENCED

    @property
    def search(self) -> str:
        """Description of the homing move and its range."""
        low, high = self.limits
        return f"It moves to its home sensor, by up to {high - low:g} {self.unit}."

    def reference(self) -> None:
        """Move to the home sensor, unless the zero is known."""
        if self.referenced:
            return
        self._query("home")
        self._wait_for_homing(lambda: self._query("get pos").idle, self._home_s)
        self._check(self._query("get pos"))

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
        self._query(f"set pos {self._steps(position)}")

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        if velocity != self._velocity:
            self._query(f"set maxspeed {round(SPEED * velocity * self._per_unit)}")
            self._velocity = velocity
        self._target = self._steps(target)
        self._query(f"move abs {self._target}")

    def position(self) -> float:
        """Return the position of the axis in deg or mm."""
        return float(self._query("get pos").data) / self._per_unit

    def on_target(self) -> bool:
        """Whether the axis is at rest at its target.

        Raises `BenchError` if it is at rest elsewhere or reports a fault.
        """
        reply = self._query("get pos")
        if not reply.idle:
            return False
        self._check(reply)
        if abs(float(reply.data) - self._target) > max(2.0, 1e-3 * self._per_unit):
            limit = f"stopped at {reply.data} instead of {self._target} microsteps"
            raise self._bench_error(limit, "check whether its knob was turned")
        return True

    def stop(self) -> None:
        """Stop with the deceleration configured in the device."""
        self._stop_pending_query(self._line("stop"))
        self._query("stop")
        self._wait_for_rest(lambda: self._query("get pos").idle)

    def _steps(self, position: float) -> int:
        return round(position * self._per_unit)

    def _limit(self, end: str) -> float:
        return float(self._query(f"get limit.{end}").data) / self._per_unit

    def _query(self, text: str) -> Reply:
        """Return the reply to a command; unsolicited alerts and information messages are ignored."""
        self._send(self._line(text))
        while (line := self._replies.text().strip())[:1] in {"!", "#"}:
            pass
        match = _REPLY.match(line)
        if match is None or (int(match[1]), match[2]) != self._address:
            remedy = "check the address, the axis and the baud rate (115200)"
            raise self._bench_error(f"replied {line!r} to {text}", remedy)
        self._replies.pending = False
        if match[3] == "RJ":
            raise self._bench_error(f"{text}: rejected, {match[6]}", "see the protocol manual")
        return Reply(match[4] == "IDLE", match[5], match[6] or "")

    def _line(self, text: str) -> bytes:
        address, axis = self._address
        return f"/{address} {axis} {text}\n".encode("ascii")

    def _check(self, reply: Reply) -> None:
        if reply.warning.startswith("F"):
            meaning = FAULTS.get(reply.warning, "see the protocol manual")
            raise self._bench_error(f"reports fault {reply.warning}, {meaning}", "check that it is free to move")
