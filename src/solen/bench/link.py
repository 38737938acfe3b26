"""A line to an instrument: bytes out, bytes in, with time-outs.

A driver defines the commands, and a link transports them. The same driver therefore works with a serial port, with a
simulated controller behind a socket, and with a scripted dialogue.

Public names: `Link`, `open_link` and `MessageReader`.
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
    """A serial port or a socket, opened with pyserial."""

    def __init__(self, port: Any, name: str) -> None:
        self.name = name
        self._port = port

    def write(self, data: bytes) -> None:
        """Send bytes; raise `BenchError` if the line is disconnected."""
        self._translated(self._port.write, data)

    def read(self, most: int, timeout_s: float) -> bytes:
        """Return up to ``most`` received bytes; wait for the first, and return none after the time-out."""
        return bytes(self._translated(self._read, most, timeout_s))

    def close(self) -> None:
        """Close the line."""
        socket = getattr(self._port, "_socket", None)
        self._port.close()
        if socket is not None:
            socket.close()  # pyserial leaves it open if the peer has disconnected

    def _read(self, most: int, timeout_s: float) -> bytes:
        self._port.timeout = timeout_s
        first = bytes(self._port.read(1))
        if not first:
            return first
        self._port.timeout = 0.0
        return first + bytes(self._port.read(most - 1))

    def _translated(self, call: Any, *arguments: Any) -> Any:
        """Call a function, and convert its errors to `BenchError`."""
        import serial

        try:
            return call(*arguments)
        except (serial.SerialException, OSError) as bad:
            limit = f"the line is disconnected: {bad}"
            raise BenchError(self.name, limit=limit, remedy="check the cable and the power") from None


def open_link(name: str, *, baud: int = 115_200) -> SerialLink:
    """Open a serial port or a socket by its name in pyserial.

    Raises `BenchError` if pyserial is not installed, or there is no such port.
    """
    need("serial", what=name, error=BenchError)
    import serial

    try:
        port = serial.serial_for_url(name, baudrate=baud, timeout=1.0, write_timeout=2.0)
    except (serial.SerialException, OSError, ValueError) as bad:
        raise BenchError(name, limit=f"cannot be opened: {bad}", remedy=_known_ports()) from None
    return SerialLink(port, name)


def _known_ports() -> str:
    from serial.tools import list_ports

    ports = ", ".join(port.device for port in list_ports.comports())
    return f"use one of {ports}" if ports else "connect the instrument: no serial port was found"


Split = Callable[[bytes], tuple[bytes, bytes] | None]
"""Function that returns the first complete message in received bytes, and the bytes after it; None without one."""


def split_line(data: bytes) -> tuple[bytes, bytes] | None:
    """Return the first line without its end, and the remaining bytes; None if no line is complete."""
    line, end, rest = data.partition(b"\n")
    return (line, rest) if end else None


class MessageReader:
    """A reader of the messages from a link: lines by default, without their ends, or what `split` splits off."""

    def __init__(self, link: Link, clock: Clock, *, timeout_s: float = 1.0, split: Split = split_line) -> None:
        self._link = link
        self._clock = clock
        self._timeout_s = timeout_s
        self._split = split
        self._buffer = b""
        self.pending = False
        """Whether the reply to an earlier query has not been read; it may still arrive and be mistaken for another."""

    def text(self) -> str:
        """Return the next message as text; raise `BenchError` after a time-out, or if it is not ASCII text."""
        message = self.message()
        try:
            return message.decode("ascii")
        except UnicodeDecodeError:
            limit = f"replied {message[:40]!r}, which is not text"
            raise BenchError(self._link.name, limit=limit, remedy="check the baud rate") from None

    def message(self) -> bytes:
        """Return the next message; raise `BenchError` after a time-out."""
        due = self._clock.now_s() + self._timeout_s
        while (parts := self._split(self._buffer)) is None:
            remaining_s = due - self._clock.now_s()
            if remaining_s <= 0.0:
                received = f"only {self._buffer!r}" if self._buffer else "nothing"
                limit = f"no reply within {self._timeout_s:g} s ({received} was received)"
                raise BenchError(self._link.name, limit=limit, remedy="check the cable, the power and the baud rate")
            self._buffer += self._link.read(4096, remaining_s)
        message, self._buffer = parts
        return message

    def available_text(self) -> str | None:
        """Return the next message as text, without white space at its ends, if it has arrived; otherwise None."""
        self._buffer += self._link.read(4096, 0.0)
        return None if self._split(self._buffer) is None else self.text().strip()

    def discard(self) -> None:
        """Discard all bytes that have arrived."""
        while self._link.read(4096, 0.0):
            pass
        self._buffer, self.pending = b"", False

    def discard_until_silent(self) -> None:
        """Discard all bytes that arrive until the line is silent for the time limit of a reply."""
        due = self._clock.now_s() + 2.0 * self._timeout_s
        while self._link.read(4096, self._timeout_s) and self._clock.now_s() < due:
            pass
        self.discard()
