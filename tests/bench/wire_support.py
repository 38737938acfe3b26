"""Wires to simulated instruments: within the program, and behind a socket, with the faults that real ones have.

The interface: `Answers` is what a simulated instrument is; `Wire` a `Link` straight to one, on any clock; `Served`
serves one on a loopback socket, for a driver that opens it as pyserial's ``socket://``. `Faults` go wrong on purpose.
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


class Answers(Protocol):
    """Bytes in, bytes out; called with none it says what it says by itself."""

    def answer(self, data: bytes) -> bytes:
        """What it says to bytes that came."""


@dataclass
class Faults:
    """What goes wrong on a wire.

    Attributes
    ----------
    deaf
        Nothing is answered any more.
    gone
        The line is gone, as when a plug is pulled.
    garbage
        Bytes that come before the next answer, once.
    lost
        How many bytes at the beginning of the next answer are lost, once.
    """

    deaf: bool = False
    gone: bool = False
    garbage: bytes = b""
    lost: int = 0

    def on(self, answer: bytes) -> bytes:
        """What arrives of an answer."""
        if self.deaf:
            return b""
        if not answer:
            return answer
        answer, self.lost = answer[self.lost :], max(0, self.lost - len(answer))
        answer, self.garbage = self.garbage + answer, b""
        return answer


@dataclass
class Wire:
    """A link straight to a simulated instrument; waiting for bytes that do not come passes the clock's time."""

    instrument: Answers
    clock: Clock
    name: str = "simulated"
    faults: Faults = field(default_factory=Faults)
    sent: list[bytes] = field(default_factory=list)
    _coming: bytearray = field(default_factory=bytearray)

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._check()
        self.sent.append(data)
        self._coming += self.faults.on(self.instrument.answer(data))

    def read(self, most: int, timeout_s: float) -> bytes:
        """What has come, up to ``most`` bytes."""
        self._check()
        self._coming += self.faults.on(self.instrument.answer(b""))
        if not self._coming and timeout_s > 0.0:
            self.clock.sleep(timeout_s)
            self._coming += self.faults.on(self.instrument.answer(b""))
        data = bytes(self._coming[:most])
        del self._coming[:most]
        return data

    def close(self) -> None:
        """Nothing to let go of."""

    def _check(self) -> None:
        if self.faults.gone:
            raise BenchError(self.name, limit="the line is disconnected", remedy="check the cable and the power")


class Served:
    """A simulated instrument behind a loopback socket. Use it in a ``with`` statement; `url` is what a driver opens."""

    def __init__(self, instrument: Answers, faults: Faults | None = None) -> None:
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
                    self._talk(peer)

    def _talk(self, peer: socket.socket) -> None:
        while not self._ended.is_set() and not self.faults.gone:
            ready = select.select([peer], [], [], 0.002)[0]
            data = peer.recv(4096) if ready else b""
            if ready and not data:
                return
            if answer := self.faults.on(self._instrument.answer(data)):
                peer.sendall(answer)
