"""Requests to end a run, by Ctrl-C, a signal or a closed terminal, all of which are handled alike.

Any request must leave the emitters off and the stage at rest. The first request raises `Ended`, a `KeyboardInterrupt`,
in the main thread; later requests are ignored, because they could interrupt the shutdown. Within `uninterrupted` a
request is delayed until the body is done. SIGKILL and a power cut cannot be caught.

Public names: `ended_by_signals`, `uninterrupted`, `ignore_signals` and `Ended`.
"""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""Signals to catch, if the system has them; SIGBREAK is Ctrl-Break on Windows, SIGHUP a closed terminal."""
CLOSING_S = 4.5
"""Time limit in s for the shutdown: Windows terminates a program 5 s after its console was closed."""


class Ended(KeyboardInterrupt):
    """A request to end: the message states what is kept; ``exit_code`` is the shell's exit code for the signal."""

    def __init__(self, line: str, exit_code: int = 130) -> None:
        super().__init__(line)
        self.exit_code = exit_code


@dataclass
class _State:
    """Depth of nested `uninterrupted` blocks, whether `Ended` has been raised, and the signal that is delayed."""

    delaying: int = 0
    ended: bool = False
    delayed: int | None = None


_STATE = _State()


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Raise `Ended` on the first request while the body runs; outside the main thread this has no effect."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    _STATE.delaying, _STATE.ended, _STATE.delayed = 0, False, None
    numbers = [getattr(signal, name) for name in NAMES if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in numbers:
            if before[number] is not signal.SIG_IGN:  # nohup ignores SIGHUP
                signal.signal(number, _handle)
        with _console_events():
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ignore_signals() -> None:
    """Ignore all further requests, for a program that is about to end and still has something to print."""
    for name in NAMES:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Delay requests until the body is done; they are lost only if the body raises an error."""
    _STATE.delaying += 1
    try:
        yield
    finally:
        _STATE.delaying -= 1
    if _STATE.delayed is not None and _STATE.delaying == 0:
        _end(_STATE.delayed)


def _handle(number: int, frame: FrameType | None) -> None:  # noqa: ARG001  a handler's arguments
    if _STATE.ended:
        return
    if _STATE.delaying:
        _STATE.delayed = number
        return
    _end(number)


def _end(number: int) -> None:
    _STATE.ended, _STATE.delayed = True, None
    raise Ended(f"ended by {signal.Signals(number).name}", 128 + number)


@contextmanager
def _console_events() -> Iterator[None]:
    """On Windows, interrupt the main thread if the console is closed, and delay the closing until the body is done."""
    if sys.platform != "win32":
        yield
        return
    import ctypes

    done = threading.Event()

    @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_uint)
    def handle(event: int) -> int:
        if event in {0, 1}:  # Ctrl-C and Ctrl-Break are also sent as signals
            return 0
        signal.raise_signal(signal.SIGTERM)
        done.wait(CLOSING_S)
        return 1

    ctypes.windll.kernel32.SetConsoleCtrlHandler(handle, 1)
    try:
        yield
    finally:
        done.set()
        ctypes.windll.kernel32.SetConsoleCtrlHandler(handle, 0)
