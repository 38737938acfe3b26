"""Progress messages of a command on stderr, terminal or not, so that no wait over two seconds is silent.

A thread watches the time and the functions that numba compiles. On a terminal, a progress bar shows the rest.
"""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

LOOK_S, FIRST_S, AGAIN_S, LATER = 0.2, 1.5, 10.0, 0.2
"""Interval between checks, time of the first line and interval to further ones, at least a fifth of the elapsed
time.
"""
COMPILING_S = 2.0
"""Interval between lines while the tracer is compiled."""
COMPILING = "compiling the tracer for this computer, once; it takes a minute or less, and later runs start at once"
INTERACTIVE = {"studio", "watch", "jog", "completion"}
"""Commands that wait for the user or for readings, and print as they go."""
LIVE = ("-", ".journal")
"""Sources, or their suffixes, for which `solen bench decode` prints as readings arrive; a recording is decoded at
once.
"""


class Waiting:
    """Progress and messages since a command began.

    Attributes
    ----------
    done
        Fraction that the command reports, up to 1; None if it reports none.
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
        self._said_compiling, self._said, self._due_s = False, 0, FIRST_S

    def words(self, elapsed_s: float) -> str | None:
        """Return the message that is due after the elapsed time, if any."""
        if self.compiled and not self._said_compiling:
            self._said_compiling, self._due_s = True, elapsed_s + COMPILING_S
            return f"{COMPILING}: {self._functions()}"
        if elapsed_s < self._due_s:
            return None
        if self.function or self.compiled > self._said:
            self._due_s = elapsed_s + max(COMPILING_S, LATER * elapsed_s)
            return f"compiling, {elapsed_s:.0f} s: {self._functions()}"
        self._due_s = elapsed_s + max(AGAIN_S, LATER * elapsed_s)
        parts = [f"{elapsed_s:.0f} s"]
        if self.done:
            parts.append(f"{100.0 * self.done:.0f} % done")
        return f"working, {', '.join(parts)}"

    def _functions(self) -> str:
        """Return the number of compiled functions, and the one being compiled."""
        self._said = self.compiled
        many = f"{self.compiled} functions"
        return f"{many}, now {self.function}" if self.function else many


NOW = Waiting()
"""Progress of the running command."""


@contextmanager
def progress_messages(command: str) -> Iterator[None]:
    """Report long waits on stderr, from a thread that ends with the command."""
    stop, begun = threading.Event(), time.monotonic()

    def look() -> None:
        heard = False
        while not stop.wait(LOOK_S):
            heard = heard or _listen()
            words = NOW.words(time.monotonic() - begun)
            if words is not None and NOW.describe is not None:
                NOW.describe(words if words.startswith("compiling") else command)
            elif words is not None:
                sys.stderr.write(f"{command}: {words}\n")
                sys.stderr.flush()

    thread = threading.Thread(target=look, name="solen-waiting", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()


def is_silent(arguments: list[str]) -> bool:
    """Return whether no progress is reported for a command line: it is quiet, or prints as it goes."""
    shows = "run" in arguments[1:2] and arguments[0] == "bench" and sys.stderr.isatty()  # has a line of its own
    live = "decode" in arguments[1:2] and any(word.endswith(LIVE) for word in arguments)
    return not arguments or "--quiet" in arguments or shows or live or bool(INTERACTIVE & set(arguments[:2]))


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
            NOW.compiled += 1
            NOW.function = event.data["dispatcher"].py_func.__name__

        def on_end(self, _: object) -> None:
            nonlocal depth
            depth -= 1
            NOW.function = NOW.function if depth else ""

    events.register("numba:compile", CompileListener())
    return True
