"""Destinations of decoded angles: datagrams, a serial line, or a stream of the Lab Streaming Layer.

Each row of CSV is passed on as soon as it is decoded, and a control loop, a robot or another recorder receives the
angle after a short delay. A missing receiver does not stop the decoding. Rows of a recorded file are available at once;
they are sent at the pace of their times, as they were recorded.

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
_OTHER_BAND = re.compile(r"(?:.*_)?(?:low|high)68_[^_]+")
_LIMIT = "must be udp://HOST:PORT, serial:PORT@BAUD or lsl:NAME"


class Outlet(Protocol):
    """Destination to which rows are written as to a text file."""

    def write(self, text: str, /) -> object:
        """Pass rows on; the header comes first, in a separate call."""

    def flush(self) -> None:
        """Do nothing: no row is buffered."""


class _Rows:
    def __init__(self, send: Any) -> None:
        self._send = send

    def write(self, text: str) -> None:
        for row in text.splitlines():
            if row:
                self._send(row)

    def flush(self) -> None:
        """Do nothing: no row is buffered."""


class Paced:
    """An outlet that passes rows on in real time, according to the time in their first column.

    Parameters
    ----------
    outlet
        Destination of the rows.
    clock
        Clock used for waiting.
    """

    def __init__(self, outlet: Outlet, clock: Clock) -> None:
        self._outlet, self._clock = outlet, clock
        self._ahead_s: float | None = None

    def write(self, text: str) -> None:
        """Wait for each row, and pass it on."""
        for row in text.splitlines(keepends=True):
            self._wait(row.partition(",")[0])
            self._outlet.write(row)

    def flush(self) -> None:
        """Do nothing: no row is buffered."""
        self._outlet.flush()

    def _wait(self, cell: str) -> None:
        if not is_number(cell):  # the header, or a reading without a time
            return
        if self._ahead_s is None:
            self._ahead_s = self._clock.now_s() - float(cell)
        due_s = self._ahead_s + float(cell) - self._clock.now_s()
        if due_s > 0.0:
            self._clock.sleep(due_s)


@contextmanager
def outlet(where: str) -> Iterator[Outlet]:
    """An outlet that is closed on leaving the block.

    Raises
    ------
    SpecError, BenchError
        If the name is invalid, or the outlet cannot be opened.
    """
    kind, _, rest = where.partition(":")
    opened = {"udp": _udp, "serial": _serial, "lsl": _lsl}.get(kind)
    if opened is None or not rest:
        raise SpecError("--send", value=where, limit=_LIMIT)
    with opened(where, rest) as found:
        yield found


@contextmanager
def _udp(where: str, rest: str) -> Iterator[Outlet]:  # noqa: ARG001  the complete name is a URL
    """Outlet of one datagram per row."""
    try:
        parts = urlsplit(where)
        host, port = parts.hostname, parts.port
    except ValueError:
        host = port = None
    if not host or not port:
        raise SpecError("--send", value=where, limit=_LIMIT)
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as bad:
        raise BenchError(where, limit=f"cannot be reached: {bad}", remedy="check the name of the host") from None
    with socket.socket(family, kind, protocol) as sender:

        def send(row: str) -> None:
            try:
                sender.sendto(row.encode("ascii"), address)
            except ConnectionError:  # no receiver listens yet: Windows and macOS report it
                return
            except OSError as bad:
                raise BenchError(where, limit=f"cannot be sent to: {bad}", remedy="check the network") from None

        yield _Rows(send)


@contextmanager
def _serial(where: str, rest: str) -> Iterator[Outlet]:
    """Outlet of one line per row."""
    from solen.bench.link import open_link

    port, _, baud = rest.partition("@")
    if baud and not baud.isdigit():
        raise SpecError("--send", value=where, limit=_LIMIT)
    link = open_link(port, baud=int(baud or BAUD))
    try:
        yield _Rows(lambda row: link.write(f"{row}\n".encode("ascii")))
    finally:
        link.close()


@contextmanager
def _lsl(where: str, rest: str) -> Iterator[Outlet]:
    """Outlet of one sample per row, stamped when it is sent: the time, and each value with its 95 % band."""
    need("pylsl", what=where, error=BenchError)
    import pylsl

    streams: list[Any] = []
    header: list[str] = []

    def opened(names: list[str]) -> Any:
        kind = pylsl.IRREGULAR_RATE, pylsl.cf_double64
        info = pylsl.StreamInfo(rest, "Angle", len(names), *kind, f"solen-{rest}")
        channels = info.desc().append_child("channels")
        for name in names:
            channels.append_child("channel").append_child_value("label", name)
        return pylsl.StreamOutlet(info)

    def send(row: str) -> None:
        cells = row.split(",")
        if not streams:
            header.extend(cells)
            streams.append(opened(_sent(header)))
            return
        values = dict(zip(header, cells, strict=False))
        streams[0].push_sample([float(values[name] or "nan") for name in _sent(header)], pylsl.local_clock())

    yield _Rows(send)


def _sent(header: list[str]) -> list[str]:
    """Return the columns of numbers that are sent, up to the last band, without the 68 % bands."""
    last = max(place for place, name in enumerate(header) if "high95_" in name)
    return [name for name in header[: last + 1] if not _OTHER_BAND.fullmatch(name)]
