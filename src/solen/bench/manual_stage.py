"""A stage turned by hand from stop to stop: the program prompts, and the operator turns it and presses Enter.

The position is unknown while the stage is turned; readings from that time have no angle and are omitted. At a stop the
stage is at the position in the protocol, or at the position that the operator reads from the scale and types before
Enter. The emitters remain driven and sampled however long the operator takes.

Public name: `ManualStage`.
"""

import math
import sys
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Literal

from solen.errors import BenchError

PATIENCE_S = 3600.0
"""Longest time in s that the operator may take for a move."""


def _show_on_stderr(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def _read_stdin() -> str:
    return sys.stdin.readline()


class ManualStage:
    """A stage without a motor.

    Parameters
    ----------
    unit
        Unit of its positions.
    show
        Shows a line to the operator; by default on stderr.
    read
        Waits for a line from the operator and returns it with its line end, or an empty string if the input has ended;
        by default from stdin.
    """

    patience_s = PATIENCE_S

    def __init__(
        self,
        unit: Literal["deg", "mm"] = "deg",
        show: Callable[[str], object] = _show_on_stderr,
        read: Callable[[], str] = _read_stdin,
    ) -> None:
        self.name, self.unit = "stage turned by hand", unit
        self._show, self._read = show, read
        self._replies: SimpleQueue[tuple[int, str]] = SimpleQueue()
        self._lock, self._prompt, self._waiting = threading.Lock(), 0, False
        self._target, self._position = math.nan, math.nan

    def reference(self) -> None:
        """Do nothing: the operator knows where the zero is."""

    def begin_move(self, target: float, velocity: float) -> None:  # noqa: ARG002  the operator chooses the velocity
        """Prompt for a move, unless the stage is already at the target."""
        if target == self._position:
            return
        self._target, self._position = target, math.nan
        self._show(f"Move the stage to {target:+g} {self.unit}, then press Enter (or type its actual position).")
        self._wait_for_line()

    def position(self) -> float:
        """Return the position; NaN while the stage is moved, and before the first move."""
        return self._position

    def on_target(self) -> bool:
        """Whether the operator has confirmed that the stage is at rest."""
        if math.isfinite(self._position):
            return True
        try:
            prompt, line = self._replies.get_nowait()
        except Empty:
            return False
        if prompt != self._prompt:
            return False
        if not line:
            limit = "the operator cannot reply: the input has ended"
            raise BenchError(self.name, limit=limit, remedy="start the run in a terminal")
        self._set_position(line.strip())
        return math.isfinite(self._position)

    def stop(self) -> None:
        """End the wait for the operator, and discard a reply to the last prompt; nothing moves by itself."""
        with self._lock:
            self._prompt += 1

    def close(self) -> None:
        """Do nothing: no port is open."""

    def _set_position(self, text: str) -> None:
        """Set the position to the target after Enter alone, or to the typed number; prompt again if it is no number."""
        try:
            position = float(text.replace(",", ".")) if text else self._target
        except ValueError:
            position = math.nan
        if math.isfinite(position):
            self._position = position
        else:
            self._show(f"{text!r} is not a position in {self.unit}; press Enter, or type a number.")
            self._wait_for_line()

    def _wait_for_line(self) -> None:
        """Start to wait for a line, unless a wait is already in progress."""
        with self._lock:
            self._prompt += 1
            waiting, self._waiting = self._waiting, True
        if not waiting:
            threading.Thread(target=self._queue_line, daemon=True).start()

    def _queue_line(self) -> None:
        """Read a line, and queue it as the reply to the latest prompt."""
        line = self._read()
        with self._lock:
            self._waiting = False
            self._replies.put((self._prompt, line))
