"""Destinations of decoded angles: datagrams, a serial line, or a stream of the Lab Streaming Layer.

Each CSV row is sent as soon as it is decoded, so that a control loop, a robot or another recorder receives the angle
after a short delay. Decoding continues even if nothing receives the rows. The rows of a recorded file, which are
available at once, are sent at the pace of their times.

Public names: `outlet` and `Paced`.
"""

import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol
from urllib.parse import urlsplit

from solen.bench.clock import Clock
from solen.errors import BenchError, SpecError
from solen.extras import need
from solen.recording.numbers import is_number

BAUD = 115_200
_BAND_68 = re.compile(r"(?:.*_)?(?:low|high)68_[^_]+")
_LIMIT = "must be udp://HOST:PORT, serial:PORT@BAUD or lsl:NAME"


class Outlet(Protocol):
    """Destination to which rows are written as to a text file."""

    def write(self, text: str, /) -> object:
        """Send rows; the header comes first, in a separate call."""

    def flush(self) -> None:
        """Do nothing: no row is buffered."""


class _RowOutlet:
    """An outlet that sends each row by a function."""

    def __init__(self, send: Any) -> None:
        self._send = send

    def write(self, text: str) -> None:
        for row in text.splitlines():
            if row:
                self._send(row)

    def flush(self) -> None:
        """Do nothing: no row is buffered."""


class Paced:
    """An outlet that sends rows in real time, by the time in their first column.

    Parameters
    ----------
    outlet
        Destination of the rows.
    clock
        Clock used for waiting.
    """

    def __init__(self, outlet: Outlet, clock: Clock) -> None:
        self._outlet, self._clock = outlet, clock
        self._offset_s: float | None = None

    def write(self, text: str) -> None:
        """Send each row when it is due."""
        for row in text.splitlines(keepends=True):
            self._wait(row.partition(",")[0])
            self._outlet.write(row)

    def flush(self) -> None:
        """Flush the outlet."""
        self._outlet.flush()

    def _wait(self, cell: str) -> None:
        if not is_number(cell):  # the header, or a row without a time
            return
        if self._offset_s is None:
            self._offset_s = self._clock.now_s() - float(cell)
        remaining_s = self._offset_s + float(cell) - self._clock.now_s()
        if remaining_s > 0.0:
            self._clock.sleep(remaining_s)


@contextmanager
def outlet(destination: str) -> Iterator[Outlet]:
    """Yield the outlet to a destination, which is closed on leaving the block.

    Raises
    ------
    SpecError, BenchError
        If the destination is invalid, or the outlet cannot be opened.
    """
    kind, _, rest = destination.partition(":")
    open_outlet = {"udp": _udp, "serial": _serial, "lsl": _lsl}.get(kind)
    if open_outlet is None or not rest:
        raise SpecError("--send", value=destination, limit=_LIMIT)
    with open_outlet(destination, rest) as opened:
        yield opened


@contextmanager
def _udp(destination: str, rest: str) -> Iterator[Outlet]:  # noqa: ARG001  the complete destination is a URL
    """Yield an outlet that sends a datagram for each row."""
    try:
        parts = urlsplit(destination)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise SpecError("--send", value=destination, limit=_LIMIT)
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as bad:
        raise BenchError(destination, limit=f"cannot be reached: {bad}", remedy="check the name of the host") from None
    with socket.socket(family, kind, protocol) as sender:

        def send(row: str) -> None:
            try:
                sender.sendto(row.encode("ascii"), address)
            except ConnectionError:  # reported by Windows and macOS if no receiver listens yet
                return
            except OSError as bad:
                raise BenchError(destination, limit=f"cannot be sent to: {bad}", remedy="check the network") from None

        yield _RowOutlet(send)


@contextmanager
def _serial(destination: str, rest: str) -> Iterator[Outlet]:
    """Yield an outlet that sends a line for each row."""
    from solen.bench.link import open_link

    port, _, baud = rest.partition("@")
    if baud and not baud.isdigit():
        raise SpecError("--send", value=destination, limit=_LIMIT)
    link = open_link(port, baud=int(baud or BAUD))
    try:
        yield _RowOutlet(lambda row: link.write(f"{row}\n".encode("ascii")))
    finally:
        link.close()


@contextmanager
def _lsl(destination: str, rest: str) -> Iterator[Outlet]:
    """Yield an outlet that sends a sample for each row: the time, and each value with its 95 % band."""
    need("pylsl", what=destination, error=BenchError)
    import pylsl

    streams: list[Any] = []
    header: list[str] = []

    def open_stream(names: list[str]) -> Any:
        info = pylsl.StreamInfo(rest, "Angle", len(names), pylsl.IRREGULAR_RATE, pylsl.cf_double64, f"solen-{rest}")
        channels = info.desc().append_child("channels")
        for name in names:
            channels.append_child("channel").append_child_value("label", name)
        return pylsl.StreamOutlet(info)

    def send(row: str) -> None:
        cells = row.split(",")
        if not streams:
            header.extend(cells)
            streams.append(open_stream(_sent_columns(header)))
            return
        values = dict(zip(header, cells, strict=False))
        sample = [float(values[name] or "nan") for name in _sent_columns(header)]
        streams[0].push_sample(sample, pylsl.local_clock())

    yield _RowOutlet(send)


def _sent_columns(header: list[str]) -> list[str]:
    """Return the columns that are sent: those up to the last 95 % band, without the 68 % bands."""
    last = max(index for index, name in enumerate(header) if "high95_" in name)
    return [name for name in header[: last + 1] if not _BAND_68.fullmatch(name)]
