"""Motorised stages of Physik Instrumente: one axis of a controller that speaks GCS 2.0, such as the C-863 Mercury.

GCS consists of text lines. A command is not answered, so ``ERR?`` is sent after each command; a query is answered by
one or more lines, each of which ends in a space except the last. Single characters (#5, #7, #24) are answered at once,
even while the axis moves. Syntax, addresses and error codes: PI, C-863.12 Mercury Controller User Manual MS249E,
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
"""Meanings of the controller error codes; other errors are reported by number."""
STOPPED = 10
STOP_ALL, MOVING, READY = b"\x18", b"\x05", b"\x07"
_READY, _BUSY = b"\xb1", b"\xb0"


STAGES: dict[str, Unit] = {"M-060.DG": "deg", "M-111.1DG": "mm"}
"""PI stages, with the unit of motion of each."""


def unit_of(stage: str, unit: Unit | None) -> Unit:
    """Return the specified unit or that in `STAGES`; raise `BenchError` if both are missing or they differ."""
    known = STAGES.get(stage)
    if unit is None and known is None:
        limit = f"is a stage whose unit is not known; known are {', '.join(STAGES)}"
        raise BenchError("stage", value=stage, limit=limit, remedy='state its unit = "deg" or "mm"')
    if unit is not None and known is not None and unit != known:
        raise BenchError("unit", value=unit, limit=f"{stage} moves in {known}")
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
        Unit of the positions; by default the unit that `STAGES` lists for the stage.
    axis, address
        Name of the axis, and address of the controller if several controllers share a line.
    answer_s, reference_s
        Time limits in s for an answer and for the reference search.

    Raises
    ------
    BenchError
        If the controller does not answer, is not a PI controller, reports an error or is configured for another stage.
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
        answer_s: float = 1.0,
        reference_s: float = 60.0,
    ) -> None:
        super().__init__(f"{stage} at {link.name}", link, clock, answer_s)
        self.unit: Unit = unit_of(stage, unit)
        self._axis = axis
        self._to = "" if address is None else f"{address} "
        self._reference_s = reference_s
        self._velocity: float | None = None
        self._connect(stage)

    def _connect(self, stage: str) -> None:
        self._lines.forget()
        self._error()  # an earlier error may be pending
        self.identity = self.ask("*IDN?")[0]
        if "physik instrumente" not in self.identity.lower():
            raise self._refusal(f"answered {self.identity!r} as its name", "it is not a controller of PI")
        configured = self._value("CST?")
        if configured != stage:
            remedy = f"configure it (PIMikroMove), or name {configured} in the rig file"
            raise self._refusal(f"the controller is set up for {configured}, not {stage}", remedy)
        self.command(f"SVO {self._axis} 1")
        self.limits = float(self._value("TMN?")), float(self._value("TMX?"))

    @property
    def referenced(self) -> bool:
        """Whether the controller knows the zero position."""
        return self._value("FRF?") == "1"

    @property
    def search(self) -> str:
        """Description of the reference move and its range; the position of the switch is unknown."""
        low, high = self.limits
        return f"It moves to its reference switch, by up to {high - low:g} {self.unit} in either direction."

    def set_position(self, position: float) -> None:
        """Define the current position as the specified value without moving."""
        self.command(f"RON {self._axis} 0")
        self.command(f"POS {self._axis} {position:.6f}")

    def reference(self) -> None:
        """Move to the reference switch, unless the axis has been referenced since the controller was switched on."""
        if self.referenced:
            return
        self.command(f"FRF {self._axis}")
        self._come_home(self._ready, self._reference_s)
        self._check("FRF")
        if not self.referenced:
            raise self._refusal("found no reference", "check that the stage is free to move")

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity, in deg and deg/s or mm and mm/s."""
        low, high = self.limits
        if not low <= target <= high:
            raise self._refusal(f"{target:g} {self.unit} is outside its limits {low:g} to {high:g}", "move less far")
        if velocity != self._velocity:
            self.command(f"VEL {self._axis} {velocity:.6f}")
            self._velocity = velocity
        self.command(f"MOV {self._axis} {target:.6f}")

    def position(self) -> float:
        """Return the position of the axis in deg or mm."""
        return float(self._value("POS?"))

    def on_target(self) -> bool:
        """Whether the axis has come to rest at its target; raise `BenchError` if the controller stopped the move."""
        if self._value("ONT?") == "1":
            return True
        if self._moving():
            return False
        self._check("MOV")
        return self._value("ONT?") == "1"

    def stop(self) -> None:
        """Stop at once; the controller reports the stop as an error, which is cleared."""
        self._cut_in(self._to.encode() + STOP_ALL)
        self._say(STOP_ALL)
        code = self._error()
        if code not in {0, STOPPED}:
            raise self._refusal(_meaning(code), "check the stage")
        self._come_to_rest(lambda: not self._moving())

    def command(self, text: str) -> None:
        """Send a command and check that it was accepted; raise `BenchError` with the controller's reason if not."""
        self._say(f"{text}\n".encode("ascii"))
        self._check(text)

    def ask(self, text: str) -> list[str]:
        """Return the lines that answer a query, without addresses and without the spaces that join the lines."""
        self._say(f"{text}\n".encode("ascii"))
        lines = [self._lines.next()]
        while lines[-1].endswith(" "):
            lines.append(self._lines.next())
        self._lines.owed = False
        lines = [line.strip() for line in lines]
        prefix = f"0 {self._to}"
        return [line.removeprefix(prefix) if self._to else line for line in lines]

    def _say(self, data: bytes) -> None:
        self._send(self._to.encode() + data)

    def _value(self, question: str) -> str:
        """Return the value of this axis from the answer to a query."""
        answer = self.ask(f"{question} {self._axis}")
        for line in answer:
            name, sign, value = line.partition("=")
            if sign and name.strip() == self._axis:
                return value.strip()
        raise self._refusal(f"answered {answer[0]!r} to {question}", "check the name of the axis")

    def _error(self) -> int:
        answer = self.ask("ERR?")[0]
        try:
            return int(answer)
        except ValueError:
            raise self._refusal(f"answered {answer!r} to ERR?", "check the baud rate") from None

    def _check(self, text: str) -> None:
        if (code := self._error()) != 0:
            raise self._refusal(f"{text}: {_meaning(code)}", "see the controller's manual")

    def _moving(self) -> bool:
        self._say(MOVING)
        answer = self._lines.next().strip().removeprefix(f"0 {self._to}" if self._to else "")
        self._lines.owed = False
        try:
            return int(answer, 16) != 0
        except ValueError:
            raise self._refusal(f"answered {answer!r} to #5", "check the baud rate") from None

    def _ready(self) -> bool:
        self._say(READY)
        answer = self._lines.next_bytes().strip()
        self._lines.owed = False
        if answer[-1:] not in {_READY, _BUSY}:
            raise self._refusal(f"answered {answer!r} to #7", "check the baud rate")
        return answer[-1:] == _READY


def _meaning(code: int) -> str:
    return f"error {code}, {ERRORS[code]}" if code in ERRORS else f"error {code}"
