"""Lines to simulated instruments, within the program or over a socket, with the faults of real lines.

`Instrument` is the interface of a simulated instrument; `Wire` is a `Link` to one, on any clock; `Served` serves one on
a loopback socket, for a driver that opens it as pyserial's ``socket://``. `Faults` are injected into either.
"""

import contextlib
import select
import socket
import threading
from dataclasses import dataclass, field
from types import TracebackType
from typing import Protocol, Self

from solen.bench.clock import Clock
from solen.errors import BenchError


class Instrument(Protocol):
    """A simulated instrument: bytes in, bytes out."""

    def reply(self, data: bytes) -> bytes:
        """Return the reply to some bytes, and whatever the instrument sends unsolicited."""


@dataclass
class Faults:
    """Faults of a line.

    Attributes
    ----------
    deaf
        No more replies arrive.
    disconnected
        The line is disconnected, as by an unplugged cable.
    garbage
        Bytes that arrive once, before the next reply.
    lost
        Number of bytes at the beginning of the next reply that are lost once.
    """

    deaf: bool = False
    disconnected: bool = False
    garbage: bytes = b""
    lost: int = 0

    def apply(self, reply: bytes) -> bytes:
        """Return what arrives of a reply."""
        if self.deaf:
            return b""
        if not reply:
            return reply
        reply, self.lost = reply[self.lost :], max(0, self.lost - len(reply))
        reply, self.garbage = self.garbage + reply, b""
        return reply


@dataclass
class Wire:
    """A link directly to a simulated instrument; a time-out passes on the clock, which may be simulated."""

    instrument: Instrument
    clock: Clock
    name: str = "simulated"
    faults: Faults = field(default_factory=Faults)
    sent: list[bytes] = field(default_factory=list)
    _received: bytearray = field(default_factory=bytearray)

    def write(self, data: bytes) -> None:
        self._check()
        self.sent.append(data)
        self._received += self.faults.apply(self.instrument.reply(data))

    def read(self, most: int, timeout_s: float) -> bytes:
        self._check()
        self._received += self.faults.apply(self.instrument.reply(b""))
        if not self._received and timeout_s > 0.0:
            self.clock.sleep(timeout_s)
            self._received += self.faults.apply(self.instrument.reply(b""))
        data = bytes(self._received[:most])
        del self._received[:most]
        return data

    def close(self) -> None:
        pass

    def _check(self) -> None:
        if self.faults.disconnected:
            raise BenchError(self.name, limit="the line is disconnected", remedy="check the cable and the power")


class Served:
    """A simulated instrument on a loopback socket, in a ``with`` statement; a driver opens its `url`."""

    def __init__(self, instrument: Instrument, faults: Faults | None = None) -> None:
        self.faults = faults or Faults()
        self._instrument = instrument
        self._ended = threading.Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join(5.0)
        self._listening.close()

    def _serve(self) -> None:
        while not self._ended.is_set():
            if select.select([self._listening], [], [], 0.05)[0]:
                peer, _ = self._listening.accept()
                with peer, contextlib.suppress(OSError):
                    self._serve_peer(peer)

    def _serve_peer(self, peer: socket.socket) -> None:
        while not self._ended.is_set() and not self.faults.disconnected:
            ready = select.select([peer], [], [], 0.002)[0]
            data = peer.recv(4096) if ready else b""
            if ready and not data:
                return
            if reply := self.faults.apply(self._instrument.reply(data)):
                peer.sendall(reply)
