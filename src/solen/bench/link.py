"""A line to an instrument: bytes out, bytes in, and a limit on the waiting time.

A driver knows the commands, a link transports them. Drivers are given a link; the same driver therefore speaks to a
serial port, to a controller that is simulated behind a socket, and to a scripted conversation.

Public names: `Link`, `open_link` and `Lines`.
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
        """Send bytes; raise `BenchError` if the line is disconnected."""

    def read(self, most: int, timeout_s: float) -> bytes:
        """Return up to ``most`` received bytes; wait for the first, and return none after the time-out."""

    def close(self) -> None:
        """Close the line."""


class SerialLink:
    """A line opened with pyserial: a serial port, or a socket."""

    def __init__(self, port: Any, name: str) -> None:
        self.name = name
        self._port = port

    def write(self, data: bytes) -> None:
        """Send bytes; raise `BenchError` if the line is disconnected."""
        self._tried(self._port.write, data)

    def read(self, most: int, timeout_s: float) -> bytes:
        """Return up to ``most`` received bytes; wait for the first, and return none after the time-out."""
        return bytes(self._tried(self._read, most, timeout_s))

    def close(self) -> None:
        """Close the line."""
        socket = getattr(self._port, "_socket", None)
        self._port.close()
        if socket is not None:
            socket.close()  # pyserial leaves it open if the other side is disconnected

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
            raise BenchError(
                self.name, limit=f"the line is disconnected: {bad}", remedy="check the cable and the power"
            ) from None


def open_link(name: str, *, baud: int = 115_200) -> SerialLink:
    """Open a serial port by its name in pyserial.

    Raises `BenchError` if pyserial is not installed, or there is no such port.
    """
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
"""Splits off the first complete message of the bytes; returns it and the remaining bytes, or None if none is
complete.
"""


def line_of(data: bytes) -> tuple[bytes, bytes] | None:
    """Return the first line without its end, and the remaining bytes."""
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
        """Whether the answer to an earlier command was not read and may still arrive, where it could be mistaken for
        the answer to another one.
        """

    def next(self) -> str:
        """Return one line; raise `BenchError` if none arrived in time, or it is not text."""
        line = self.next_bytes()
        try:
            return line.decode("ascii")
        except UnicodeDecodeError:
            limit = f"answered {line[:40]!r}, which is not text"
            raise BenchError(self._link.name, limit=limit, remedy="check the baud rate") from None

    def next_bytes(self) -> bytes:
        """Return one line as bytes; raise `BenchError` if none arrived in time."""
        due = self._clock.now_s() + self._timeout_s
        while (found := self._cut(self._waiting)) is None:
            left = due - self._clock.now_s()
            if left <= 0.0:
                came = f"only {self._waiting!r} came" if self._waiting else "nothing came"
                limit = f"no answer within {self._timeout_s:g} s ({came})"
                raise BenchError(self._link.name, limit=limit, remedy="check the cable, the power and the baud rate")
            self._waiting += self._link.read(4096, left)
        line, self._waiting = found
        return line

    def there(self) -> str | None:
        """Return a line that has arrived already; None if none is complete."""
        self._waiting += self._link.read(4096, 0.0)
        return None if self._cut(self._waiting) is None else self.next().strip()

    def forget(self) -> bytes:
        """Discard input that was not requested, and return it."""
        dropped = self._waiting
        while came := self._link.read(4096, 0.0):
            dropped += came
        self._waiting, self.owed = b"", False
        return dropped

    def settle(self) -> None:
        """Discard input that has arrived or still arrives, until the line is silent for the duration of an answer."""
        due = self._clock.now_s() + 2.0 * self._timeout_s
        while self._link.read(4096, self._timeout_s) and self._clock.now_s() < due:
            pass
        self.forget()
