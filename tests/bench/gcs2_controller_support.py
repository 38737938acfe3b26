"""A GCS 2.0 controller with a simulated axis, like a C-863 Mercury.

It handles lines, single characters that are executed at once, and an error code that is kept until it is queried. It
was written from the manual (PI, MS249E, chapter 8), not from the driver.
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
        Clock of the axis.
    stage
        Name of the stage for which it is configured.
    low, high
        Limits of the position.
    highest_velocity
        Highest velocity that it accepts.
    address
        Address if several controllers share a line; lines for other addresses are ignored.
    reference_s
        Duration of the reference move.
    offset
        Position of the axis when the controller is switched on.
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
    _line: bytes = b""
    _ready_s: float = 0.0

    def __post_init__(self) -> None:
        self._axis = Axis(self.acceleration, self.offset)

    @property
    def axis(self) -> Axis:
        """The axis, which knows the true position."""
        return self._axis

    def reply(self, data: bytes) -> bytes:
        """Return the reply to some bytes; an incomplete line is kept."""
        reply = b""
        for byte in data:
            if byte in {_STOP, _MOTION, _READY}:
                reply += self._single_character(byte, self._line)
                self._line = b""
            elif byte == 10:
                line, self._line = self._line, b""
                reply += self._reply_line(line.decode("ascii", "replace"))
            else:
                self._line += bytes([byte])
        return reply

    def stall(self) -> None:
        """Stop the axis and switch its servo off, as if it were blocked."""
        self._axis.halt(self.clock.now_s())
        self.servo, self.error = False, 1024

    def _single_character(self, byte: int, address: bytes) -> bytes:
        addressed = self._addressed(address.decode("ascii", "replace"))
        if addressed is None:
            return b""
        prefix = addressed[1]
        now = self.clock.now_s()
        if byte == _STOP:
            self._axis.halt(now)
            self._ready_s = min(self._ready_s, now)
            self.error = 10
            return b""
        if byte == _READY:
            return prefix.encode() + (b"\xb1" if now >= self._ready_s else b"\xb0") + b"\n"
        return f"{prefix}{int(self._axis.moving(now))}\n".encode()

    def _addressed(self, line: str) -> tuple[str, str] | None:
        """Return the line without its address, and the prefix of the reply; None for another address."""
        head, _, rest = line.partition(" ")
        if not head.isdigit():
            return (line, "") if self.address in {None, 1} else None
        return (rest, f"0 {head} ") if int(head) == (self.address or 1) else None

    def _reply_line(self, text: str) -> bytes:
        addressed = self._addressed(text)
        words = [] if addressed is None else addressed[0].split()
        if addressed is None or not words:
            return b""
        name = words[0].upper()
        if name == "*IDN?":
            reply = IDENTITY
        elif name == "ERR?":
            reply, self.error = str(self.error), 0
        elif name == "HLP?":
            reply = "The following commands are valid: \n*IDN? \nERR?"
        elif name in self._queries:
            value = self._query(words[1:], self._queries[name])
            if value is None:
                return b""
            reply = value
        else:
            self._execute(name, words[1:])
            return b""
        return f"{addressed[1]}{reply}\n".encode()

    @property
    def _queries(self) -> dict[str, Callable[[], str]]:
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

    def _query(self, words: list[str], value: Callable[[], str]) -> str | None:
        if words and words != ["1"]:
            self.error = 15
            return None
        return f"1={value()}"

    def _execute(self, name: str, words: list[str]) -> None:
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
