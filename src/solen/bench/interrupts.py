"""Ending a run from outside by Ctrl-C, a signal or a closed terminal, which are all treated alike.

Any request to end must leave the emitters off and the stage at rest. The first request raises `Ended`, a
`KeyboardInterrupt`, in the main thread; later requests are ignored, because they could interrupt the shutdown. Within
`uninterrupted` a request waits until the work is done. SIGKILL and a power cut cannot be caught.

Public names: `ended_by_signals`, `uninterrupted`, `pass_over` and `Ended`.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""Signals to catch where the system has them; SIGBREAK is Ctrl-Break on Windows, SIGHUP a closed terminal."""
CLOSING_S = 4.5
"""Time limit in s for closing: Windows terminates a program 5 s after its console was closed."""


class Ended(KeyboardInterrupt):
    """A request to end: the message says what is kept; ``exit_code`` is the shell's exit code for the signal."""

    def __init__(self, line: str, exit_code: int = 130) -> None:
        super().__init__(line)
        self.exit_code = exit_code


@dataclass
class _State:
    """The request, and whether it may be raised now."""

    held: int = 0
    ended: bool = False
    waiting: int | None = None


_STATE = _State()


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Convert requests to end into `Ended` while the body runs; outside the main thread this has no effect."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _STATE.held, _STATE.ended, _STATE.waiting = 0, False, None
    numbers = [getattr(signal, name) for name in NAMES if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in numbers:
            if before[number] is not signal.SIG_IGN:  # nohup means it
                signal.signal(number, _handle)
        with _console_watched():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def pass_over() -> None:
    """Ignore all further requests, for a program that is about to end and still has something to report."""
    for name in NAMES:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay requests until the body is done; they are lost only if the body raises an error."""
    _STATE.held += 1
    try:
        yield
    finally:
        _STATE.held -= 1
    if _STATE.waiting is not None and _STATE.held == 0:
        _end(_STATE.waiting)


def _handle(number: int, frame: FrameType | None) -> None:  # noqa: ARG001  a handler's arguments
    if _STATE.ended:
        return
    if _STATE.held:
        _STATE.waiting = number
        return
    _end(number)


def _end(number: int) -> None:
    _STATE.ended, _STATE.waiting = True, None
    raise Ended(f"ended by {signal.Signals(number).name}", 128 + number)


@contextmanager
def _console_watched() -> Iterator[None]:
    """On Windows, interrupt the main thread if the console is closed, and keep the console until the body is done."""
    if sys.platform != "win32":
        yield
        return
    import ctypes

    done = threading.Event()

    @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)
    def closed(event: int) -> int:
        if event in {0, 1}:  # Ctrl-C and Ctrl-Break come as signals
            return 0
        signal.raise_signal(signal.SIGTERM)
        done.wait(CLOSING_S)
        return 1

    ctypes.windll.kernel32.SetConsoleCtrlHandler(closed, 1)
    try:
        yield
    finally:
        done.set()
        ctypes.windll.kernel32.SetConsoleCtrlHandler(closed, 0)
