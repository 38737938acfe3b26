"""A controller that speaks GCS 2.0 and has a simulated axis, for trying drivers and protocols without a stage.

The idea: bytes in, bytes out, as on the wire of the C-863 Mercury: lines, single characters that are answered at once,
one error that waits to be asked for. It was written after the manual (PI, MS249E, chapter 8), not after the driver.

The interface: `Gcs2Controller.answer`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

from solen.bench.clock import Clock
from solen.bench.simulated.stage import Axis

IDENTITY = "(c)2015 Physik Instrumente (PI) GmbH & Co. KG, C-863.12, 0, 1.2.1.0 (simulated)"
_STOP, _MOTION, _READY = 24, 5, 7
_SETTLING_S = 0.05


@dataclass
class Gcs2Controller:
    """A simulated controller with one axis.

    Attributes
    ----------
    clock
        Whose time the axis moves by.
    stage
        Name of the stage that it is set up for.
    low, high
        Limits of the position.
    highest_velocity
        Above it a velocity is refused.
    address
        Its number where several share a line; lines for others are passed over.
    reference_s
        How long finding the reference takes.
    offset
        Where the axis stands when it is switched on, away from its reference.
    """

    clock: Clock
    stage: str = "M-060.DG"
    low: float = -180.0
    high: float = 180.0
    highest_velocity: float = 20.0
    acceleration: float = 100.0
    address: int | None = None
    reference_s: float = 0.5
    offset: float = 1.7
    servo: bool = False
    referenced: bool = False
    reference_on: bool = True
    velocity: float = 10.0
    error: int = 0
    _axis: Axis = field(init=False)
    _waiting: bytes = b""
    _ready_s: float = 0.0

    def __post_init__(self) -> None:
        self._axis = Axis(self.acceleration, self.offset)

    @property
    def axis(self) -> Axis:
        """The axis, for who wants to know where it really is."""
        return self._axis

    def answer(self, data: bytes) -> bytes:
        """What it says to bytes that came; what is no whole line waits for more."""
        answers = b""
        for byte in data:
            if byte in {_STOP, _MOTION, _READY}:
                answers += self._single(byte, self._waiting)
                self._waiting = b""
            elif byte == 10:
                line, self._waiting = self._waiting, b""
                answers += self._line(line.decode("ascii", "replace"))
            else:
                self._waiting += bytes([byte])
        return answers

    def stall(self) -> None:
        """The axis does not follow any more: its servo goes off, as when something blocks it."""
        self._axis.halt(self.clock.now_s())
        self.servo, self.error = False, 1024

    def _single(self, byte: int, before: bytes) -> bytes:
        prefix = self._own(before.decode("ascii", "replace"))
        if prefix is None:
            return b""
        now = self.clock.now_s()
        if byte == _STOP:
            self._axis.halt(now)
            self._ready_s = min(self._ready_s, now)
            self.error = 10
            return b""
        if byte == _READY:
            return prefix[1].encode() + (b"\xb1" if now >= self._ready_s else b"\xb0") + b"\n"
        return f"{prefix[1]}{int(self._axis.moving(now))}\n".encode()

    def _own(self, line: str) -> tuple[str, str] | None:
        """The line without its address, and what begins the answer; None where another is meant."""
        head, _, rest = line.partition(" ")
        if not head.isdigit():
            return (line, "") if self.address in {None, 1} else None
        return (rest, f"0 {head} ") if int(head) == (self.address or 1) else None

    def _line(self, text: str) -> bytes:
        own = self._own(text)
        if own is None:
            return b""
        words = own[0].split()
        if not words:
            return b""
        name = words[0].upper()
        if name == "*IDN?":
            answer = IDENTITY
        elif name == "ERR?":
            answer, self.error = str(self.error), 0
        elif name == "HLP?":
            answer = "The following commands are valid: \n*IDN? \nERR?"
        elif name in self._questions:
            value = self._asked(words[1:], self._questions[name])
            if value is None:
                return b""
            answer = value
        else:
            self._obey(name, words[1:])
            return b""
        return f"{own[1]}{answer}\n".encode()

    @property
    def _questions(self) -> dict[str, Callable[[], str]]:
        now = self.clock.now_s()
        settled = not self._axis.moves or now >= self._axis.moves[-1].end_s + _SETTLING_S
        return {
            "CST?": lambda: self.stage,
            "SVO?": lambda: str(int(self.servo)),
            "FRF?": lambda: str(int(self.referenced and now >= self._ready_s)),
            "TMN?": lambda: f"{self.low:.7f}",
            "TMX?": lambda: f"{self.high:.7f}",
            "VEL?": lambda: f"{self.velocity:.7f}",
            "POS?": lambda: f"{self._axis.at(now):.7f}",
            "ONT?": lambda: str(int(self.servo and settled)),
        }

    def _asked(self, words: list[str], value: Callable[[], str]) -> str | None:
        if words and words != ["1"]:
            self.error = 15
            return None
        return f"1={value()}"

    def _obey(self, name: str, words: list[str]) -> None:
        if name not in {"SVO", "FRF", "VEL", "MOV", "HLT", "STP", "RON", "POS"}:
            self.error = 2
        elif name in {"HLT", "STP"}:
            self._axis.halt(self.clock.now_s())
            self.error = 10
        elif not words or words[0] != "1":
            self.error = 15
        elif name == "FRF":
            self._find_reference()
        elif len(words) != 2:
            self.error = 24
        else:
            self._set(name, words[1])

    def _set(self, name: str, text: str) -> None:
        try:
            value = float(text)
        except ValueError:
            self.error = 25
            return
        if name == "SVO":
            self.servo = value != 0.0
        elif name == "RON":
            self.reference_on = value != 0.0
        elif name == "POS" and not self.reference_on:
            self._axis, self.referenced = Axis(self.acceleration, value), True
        elif name == "VEL":
            if not 0.0 <= value <= self.highest_velocity:
                self.error = 8
                return
            self.velocity = value
        elif not (self.servo and self.referenced):
            self.error = 5
        elif not self.low <= value <= self.high:
            self.error = 7
        else:
            self._axis.send(self.clock.now_s(), value, self.velocity)

    def _find_reference(self) -> None:
        if not self.servo:
            self.error = 5
            return
        now = self.clock.now_s()
        self._axis = Axis(self.acceleration, 0.0)
        self.referenced, self._ready_s = True, now + self.reference_s
