"""A line to an instrument: bytes out, bytes in, and a limit to how long one waits.

The idea: a driver knows what to say, a link how it gets there. Drivers are given a link, so that the same driver speaks
to a serial port, to a controller that is simulated behind a socket, and to a written-down conversation.

The interface: `Link`; `open_link` makes one of a name such as ``COM3``, ``/dev/ttyUSB0`` or ``socket://127.0.0.1:5000``
(pyserial's names; extra ``bench``). `Lines` reads whole lines from a link, or messages that end otherwise.
"""

from collections.abc import Callable
from typing import Any, Protocol

from solen.bench.clock import Clock
from solen.errors import BenchError
from solen.extras import need


class Link(Protocol):
    """Bytes to and from one instrument."""

    name: str

    def write(self, data: bytes) -> None:
        """Send bytes; `BenchError` if the line is gone."""

    def read(self, most: int, timeout_s: float) -> bytes:
        """Bytes received, up to ``most``; waits for the first, none after the time is up."""

    def close(self) -> None:
        """Close the line."""


class SerialLink:
    """A line by pyserial: a serial port, or a socket."""

    def __init__(self, port: Any, name: str) -> None:
        self.name = name
        self._port = port

    def write(self, data: bytes) -> None:
        """Send bytes; `BenchError` if the line is gone."""
        self._tried(self._port.write, data)

    def read(self, most: int, timeout_s: float) -> bytes:
        """Bytes received, up to ``most``; waits for the first, none after the time is up."""
        return bytes(self._tried(self._read, most, timeout_s))

    def close(self) -> None:
        """Close the line."""
        socket = getattr(self._port, "_socket", None)
        self._port.close()
        if socket is not None:
            socket.close()  # pyserial leaves it open where the other side is gone

    def _read(self, most: int, timeout_s: float) -> bytes:
        self._port.timeout = timeout_s
        first = bytes(self._port.read(1))
        if not first:
            return first
        self._port.timeout = 0.0
        return first + bytes(self._port.read(most - 1))

    def _tried(self, call: Any, *given: Any) -> Any:
        import serial

        try:
            return call(*given)
        except (serial.SerialException, OSError) as bad:
            raise BenchError(self.name, limit=f"the line is gone: {bad}", remedy="check cable and power") from None


def open_link(name: str, *, baud: int = 115_200) -> SerialLink:
    """Serial port by its name in pyserial; `BenchError` if pyserial is not installed, or there is no such port."""
    need("serial", what=name, error=BenchError)
    import serial

    try:
        port = serial.serial_for_url(name, baudrate=baud, timeout=1.0, write_timeout=2.0)
    except (serial.SerialException, OSError, ValueError) as bad:
        raise BenchError(name, limit=f"cannot be opened: {bad}", remedy=_ports()) from None
    return SerialLink(port, name)


def _ports() -> str:
    from serial.tools import list_ports

    ports = ", ".join(port.device for port in list_ports.comports())
    return f"there are {ports}" if ports else "there is no serial port"


Cut = Callable[[bytes], tuple[bytes, bytes] | None]
"""The first whole message of what came, and the rest; None if none is whole."""


def line_of(data: bytes) -> tuple[bytes, bytes] | None:
    """The first line without its end, and the rest."""
    line, end, rest = data.partition(b"\n")
    return (line, rest) if end else None


class Lines:
    """Lines from a link, without their ends; further bytes are kept for the next call. `cut` splits other messages."""

    def __init__(self, link: Link, clock: Clock, *, timeout_s: float = 1.0, cut: Cut = line_of) -> None:
        self._link = link
        self._clock = clock
        self._timeout_s = timeout_s
        self._cut = cut
        self._waiting = b""
        self.owed = False
        """Whether something was sent whose answer was not taken, so that it may come yet, as if it were another's."""

    def next(self) -> str:
        """One line; `BenchError` if none came in time, or what came is not text."""
        line = self.next_bytes()
        try:
            return line.decode("ascii")
        except UnicodeDecodeError:
            limit = f"answered {line[:40]!r}, which is not text"
            raise BenchError(self._link.name, limit=limit, remedy="check the baud rate") from None

    def next_bytes(self) -> bytes:
        """One line as it came; `BenchError` if none came in time."""
        due = self._clock.now_s() + self._timeout_s
        while (found := self._cut(self._waiting)) is None:
            left = due - self._clock.now_s()
            if left <= 0.0:
                came = f"only {self._waiting!r} came" if self._waiting else "nothing came"
                limit = f"no answer within {self._timeout_s:g} s ({came})"
                raise BenchError(self._link.name, limit=limit, remedy="check cable, power and baud rate")
            self._waiting += self._link.read(4096, left)
        line, self._waiting = found
        return line

    def there(self) -> str | None:
        """A line that has come already; None if none is whole."""
        self._waiting += self._link.read(4096, 0.0)
        return None if self._cut(self._waiting) is None else self.next().strip()

    def forget(self) -> bytes:
        """Drop what came and was not asked for, and give it."""
        dropped = self._waiting
        while came := self._link.read(4096, 0.0):
            dropped += came
        self._waiting, self.owed = b"", False
        return dropped

    def settle(self) -> None:
        """Drop what came and what may come yet: nothing does once the line was silent for an answer's time."""
        due = self._clock.now_s() + 2.0 * self._timeout_s
        while self._link.read(4096, self._timeout_s) and self._clock.now_s() < due:
            pass
        self.forget()
