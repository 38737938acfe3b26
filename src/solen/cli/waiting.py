"""Progress messages of a command on stderr, so that no wait longer than two seconds is silent.

A thread monitors the elapsed time and the functions that numba compiles. On a terminal with a progress bar, only the
text of the bar changes.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

CHECK_INTERVAL_S, FIRST_LINE_S, MIN_INTERVAL_S, INTERVAL_FRACTION = 0.2, 1.5, 10.0, 0.2
"""Interval between checks, time of the first line, and shortest interval between further lines, in s; the last value is
the interval between further lines as a fraction of the elapsed time, if that is longer.
"""
COMPILING_INTERVAL_S = 2.0
"""Interval between lines while the tracer is compiled."""
COMPILING = "compiling the tracer for this computer, once; it takes a minute or less, and later runs start at once"
INTERACTIVE = {"studio", "watch", "jog", "completion"}
"""Commands that wait for the user or for readings, and print continually."""
LIVE_SOURCES = ("-", ".journal")
"""Sources, or their suffixes, for which `solen bench decode` prints as readings arrive; a recording is decoded all at
once.
"""


class CommandProgress:
    """Progress of a command since it began, and the messages about it.

    Attributes
    ----------
    done
        Completed fraction, up to 1; None if the command does not report it.
    describe
        Function that changes the text of a progress bar on the terminal; None without one.
    compiled
        Number of functions of the tracer that were compiled, or are being compiled.
    function
        The function that is being compiled; empty if there is none.
    """

    def __init__(self) -> None:
        self.done: float | None = None
        self.describe: Callable[[str], None] | None = None
        self.compiled, self.function = 0, ""
        self._compiling_reported, self._functions_reported, self._due_s = False, 0, FIRST_LINE_S

    def message(self, elapsed_s: float) -> str | None:
        """Return the message that is due after the elapsed time, if any."""
        if self.compiled and not self._compiling_reported:
            self._compiling_reported, self._due_s = True, elapsed_s + COMPILING_INTERVAL_S
            return f"{COMPILING}: {self._functions()}"
        if elapsed_s < self._due_s:
            return None
        if self.function or self.compiled > self._functions_reported:
            self._due_s = elapsed_s + max(COMPILING_INTERVAL_S, INTERVAL_FRACTION * elapsed_s)
            return f"compiling, {elapsed_s:.0f} s: {self._functions()}"
        self._due_s = elapsed_s + max(MIN_INTERVAL_S, INTERVAL_FRACTION * elapsed_s)
        parts = [f"{elapsed_s:.0f} s"]
        if self.done:
            parts.append(f"{100.0 * self.done:.0f} % done")
        return f"working, {', '.join(parts)}"

    def _functions(self) -> str:
        """Return the number of compiled functions, and the one being compiled."""
        self._functions_reported = self.compiled
        count = f"{self.compiled} function{'' if self.compiled == 1 else 's'}"
        return f"{count}, now {self.function}" if self.function else count


CURRENT = CommandProgress()
"""Progress of the running command."""


@contextmanager
def progress_messages(command: str) -> Iterator[None]:
    """Report long waits on stderr, from a thread that ends with the command."""
    stop, begun = threading.Event(), time.monotonic()

    def watch() -> None:
        listening = False
        while not stop.wait(CHECK_INTERVAL_S):
            listening = listening or _listen()
            message = CURRENT.message(time.monotonic() - begun)
            if message is not None and CURRENT.describe is not None:
                CURRENT.describe(message if message.startswith("compiling") else command)
            elif message is not None:
                sys.stderr.write(f"{command}: {message}\n")
                sys.stderr.flush()

    thread = threading.Thread(target=watch, name="solen-waiting", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def is_silent(arguments: list[str]) -> bool:
    """Return whether a command line reports no progress because it is quiet or prints continually."""
    has_own_line = "run" in arguments[1:2] and arguments[0] == "bench" and sys.stderr.isatty()
    live = "decode" in arguments[1:2] and any(word.endswith(LIVE_SOURCES) for word in arguments)
    return not arguments or "--quiet" in arguments or has_own_line or live or bool(INTERACTIVE & set(arguments[:2]))


def _listen() -> bool:
    """Count the functions that numba compiles from now on; return False while numba is not loaded."""
    events: Any = sys.modules.get("numba.core.event")
    if events is None or not hasattr(events, "register"):
        return False
    depth = 0

    class CompileListener(events.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            nonlocal depth
            depth += 1
            CURRENT.compiled += 1
            CURRENT.function = event.data["dispatcher"].py_func.__name__

        def on_end(self, _: object) -> None:
            nonlocal depth
            depth -= 1
            CURRENT.function = CURRENT.function if depth else ""

    events.register("numba:compile", CompileListener())
    return True
