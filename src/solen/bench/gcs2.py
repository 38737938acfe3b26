"""Motorised stages of Physik Instrumente: one axis of a controller with the GCS 2.0 protocol, for example a C-863.

GCS consists of text lines. A command has no reply; ``ERR?`` is therefore sent after each command. The reply to a query
is one or more lines, each of which ends in a space except the last. Single characters (#5, #7, #24) are executed at
once, even while the axis moves. Syntax, addresses and error codes: PI, C-863.12 Mercury Controller User Manual MS249E,
chapter 8.

Public names: `Gcs2Stage` and `STAGES`.
"""

from typing import Literal

from solen.bench.clock import Clock
from solen.bench.line_stage import LineStage
from solen.bench.link import Link
from solen.errors import BenchError

Unit = Literal["deg", "mm"]

ERRORS = {
    1: "the command's parameters are wrong",
    2: "unknown command",
    3: "the command is too long",
    5: "the move requires a reference and an active servo",
    7: "the position is out of limits",
    8: "the velocity is out of limits",
    10: "stopped by command",
    15: "there is no such axis",
    16: "there is no such stage",
    17: "a parameter is out of range",
    23: "there is no such axis",
    24: "the number of parameters is wrong",
    25: "a parameter is not a number",
    26: "a parameter is missing",
    45: "referencing failed",
    49: "the move to the limit switch failed",
    54: "unknown parameter",
    89: "not allowed in this mode of motion",
    1024: "motion error: the axis did not follow, and its servo is off",
}
"""Meanings of the controller's error codes; other errors are reported by number."""
STOPPED = 10
STOP_ALL, MOVING, READY = b"\x18", b"\x05", b"\x07"
_READY, _BUSY = b"\xb1", b"\xb0"


STAGES: dict[str, Unit] = {"M-060.DG": "deg", "M-111.1DG": "mm"}
"""PI stages, with the unit in which each moves."""


def unit_of(stage: str, unit: Unit | None) -> Unit:
    """Return a given unit, or that in `STAGES`; raise `BenchError` if neither is known, or if they differ."""
    known = STAGES.get(stage)
    if unit is None and known is None:
        limit = f"has an unknown unit; only those of {', '.join(STAGES)} are known"
        raise BenchError("stage", value=stage, limit=limit, remedy='set its unit to "deg" or "mm"')
    if unit is not None and known is not None and unit != known:
        raise BenchError("unit", value=unit, limit=f"must be {known}, the unit of {stage}")
    return unit or known or "deg"


class Gcs2Stage(LineStage):
    """One axis of a controller.

    Parameters
    ----------
    link
        Line to the controller.
    clock
        Clock used for time-outs.
    stage
        Name of the stage on that axis; the controller must be configured for this stage.
    unit
        Unit of the positions; by default the unit in `STAGES`.
    axis, address
        Name of the axis, and address of the controller if several controllers share a line.
    timeout_s, reference_s
        Time limits in s for a reply and for the reference move.

    Raises
    ------
    BenchError
        If the controller does not reply, is not a PI controller, reports an error or is configured for another stage.
    """

    def __init__(
        self,
        link: Link,
        clock: Clock,
        *,
        stage: str,
        unit: Unit | None = None,
        axis: str = "1",
        address: int | None = None,
        timeout_s: float = 1.0,
        reference_s: float = 60.0,
    ) -> None:
        super().__init__(f"{stage} at {link.name}", link, clock, timeout_s)
        self.unit: Unit = unit_of(stage, unit)
        self._axis = axis
        self._address = "" if address is None else f"{address} "
        self._reference_s = reference_s
        self._velocity: float | None = None
        self._connect(stage)

    def _connect(self, stage: str) -> None:
        self._replies.discard()
        self._error_code()  # an earlier error may be pending
        self.identity = self.query("*IDN?")[0]
        if "physik instrumente" not in self.identity.lower():
            limit = f"replied {self.identity!r} to *IDN?, not as a controller of PI"
            raise self._bench_error(limit, "check the port")
        configured = self._value("CST?")
        if configured != stage:
            remedy = f"configure the controller with PIMikroMove, or set stage.model to {configured}"
            raise self._bench_error(f"the controller is configured for {configured}, not {stage}", remedy)
        self.command(f"SVO {self._axis} 1")
        self.limits = float(self._value("TMN?")), float(self._value("TMX?"))

    @property
    def referenced(self) -> bool:
        """Whether the controller knows the zero position."""
        return self._value("FRF?") == "1"

    @property
    def search(self) -> str:
        """Description of the reference move and its range."""
        low, high = self.limits
        return f"It moves to its reference switch, by up to {high - low:g} {self.unit} in either direction."

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""
        self.command(f"RON {self._axis} 0")
        self.command(f"POS {self._axis} {position:.6f}")

    def reference(self) -> None:
        """Move to the reference switch, unless the axis has been referenced since the controller was switched on."""
        if self.referenced:
            return
        self.command(f"FRF {self._axis}")
        self._wait_for_homing(self._ready, self._reference_s)
        self._check("FRF")
        if not self.referenced:
            raise self._bench_error("found no reference", "check that the stage is free to move")

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        low, high = self.limits
        if not low <= target <= high:
            limit = f"the target {target:g} is outside the limits of the stage, {low:g} to {high:g} {self.unit}"
            raise self._bench_error(limit, "choose a target within the limits")
        if velocity != self._velocity:
            self.command(f"VEL {self._axis} {velocity:.6f}")
            self._velocity = velocity
        self.command(f"MOV {self._axis} {target:.6f}")

    def position(self) -> float:
        """Return the position of the axis in deg or mm."""
        return float(self._value("POS?"))

    def on_target(self) -> bool:
        """Whether the axis is at rest at its target; raise `BenchError` if the controller stopped the move."""
        if self._value("ONT?") == "1":
            return True
        if self._moving():
            return False
        self._check("MOV")
        return self._value("ONT?") == "1"

    def stop(self) -> None:
        """Stop at once; the controller reports the stop as an error, which is cleared."""
        self._stop_pending_query(self._address.encode() + STOP_ALL)
        self._send_to_address(STOP_ALL)
        code = self._error_code()
        if code not in {0, STOPPED}:
            raise self._bench_error(_meaning(code), "check the stage")
        self._wait_for_rest(lambda: not self._moving())

    def command(self, text: str) -> None:
        """Send a command; raise `BenchError` with the controller's reason if it is rejected."""
        self._send_to_address(f"{text}\n".encode("ascii"))
        self._check(text)

    def query(self, text: str) -> list[str]:
        """Return the lines of the reply to a query, without addresses and white space at their ends."""
        self._send_to_address(f"{text}\n".encode("ascii"))
        lines = [self._replies.text()]
        while lines[-1].endswith(" "):
            lines.append(self._replies.text())
        self._replies.pending = False
        return [self._without_address(line) for line in lines]

    def _send_to_address(self, data: bytes) -> None:
        self._send(self._address.encode() + data)

    def _without_address(self, line: str) -> str:
        return line.strip().removeprefix(f"0 {self._address}" if self._address else "")

    def _value(self, query: str) -> str:
        """Return the value of this axis from the reply to a query."""
        reply = self.query(f"{query} {self._axis}")
        for line in reply:
            name, sign, value = line.partition("=")
            if sign and name.strip() == self._axis:
                return value.strip()
        raise self._bench_error(f"replied {reply[0]!r} to {query}", "check the name of the axis")

    def _error_code(self) -> int:
        reply = self.query("ERR?")[0]
        try:
            return int(reply)
        except ValueError:
            raise self._bench_error(f"replied {reply!r} to ERR?", "check the baud rate") from None

    def _check(self, command: str) -> None:
        if (code := self._error_code()) != 0:
            raise self._bench_error(f"{command}: {_meaning(code)}", "see the manual of the controller")

    def _moving(self) -> bool:
        self._send_to_address(MOVING)
        reply = self._without_address(self._replies.text())
        self._replies.pending = False
        try:
            return int(reply, 16) != 0
        except ValueError:
            raise self._bench_error(f"replied {reply!r} to #5", "check the baud rate") from None

    def _ready(self) -> bool:
        self._send_to_address(READY)
        reply = self._replies.message().strip()
        self._replies.pending = False
        if reply[-1:] not in {_READY, _BUSY}:
            raise self._bench_error(f"replied {reply!r} to #7", "check the baud rate")
        return reply[-1:] == _READY


def _meaning(code: int) -> str:
    return f"error {code}, {ERRORS[code]}" if code in ERRORS else f"error {code}"
