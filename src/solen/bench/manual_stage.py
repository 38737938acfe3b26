"""A stage turned by hand from stop to stop: the program prompts, and the operator turns it and presses Enter.

The position is unknown while the stage is turned; readings of that time have no angle and are omitted. At a stop it is
at the position of the protocol, or at the one read from its scale, which the operator may type before Enter. The
operator may take any time between stops; the emitters remain driven and sampled.

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
"""Longest time in s that a person may take for a move."""


def _said(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def _typed() -> str:
    return sys.stdin.readline()


class ManualStage:
    """A stage without a motor.

    Parameters
    ----------
    unit
        Unit of its positions.
    say
        Shows a line to the operator; by default on stderr.
    answer
        Waits for a line from the operator and returns it with its line end; empty if the input has ended. By default
        reads stdin.
    """

    patience_s = PATIENCE_S

    def __init__(
        self,
        unit: Literal["deg", "mm"] = "deg",
        say: Callable[[str], object] = _said,
        answer: Callable[[], str] = _typed,
    ) -> None:
        self.name, self.unit = "stage turned by hand", unit
        self._say, self._answer = say, answer
        self._answers: SimpleQueue[tuple[int, str]] = SimpleQueue()
        self._lock, self._question, self._waiting = threading.Lock(), 0, False
        self._target, self._position = math.nan, math.nan

    def reference(self) -> None:
        """Do nothing: the operator knows where the zero is."""

    def begin_move(self, target: float, velocity: float) -> None:  # noqa: ARG002  the operator chooses the velocity
        """Prompt for a move; none is needed if the stage is at the target already."""
        if target == self._position:
            return
        self._target, self._position = target, math.nan
        self._say(f"Move the stage to {target:+g} {self.unit}, then press Enter (or type its actual position).")
        self._ask()

    def position(self) -> float:
        """Return the position; NaN while the stage is moved, and before the first move."""
        return self._position

    def on_target(self) -> bool:
        """Whether the operator has confirmed that the stage is at rest."""
        if math.isfinite(self._position):
            return True
        try:
            question, line = self._answers.get_nowait()
        except Empty:
            return False
        if question != self._question:
            return False
        if not line:
            raise BenchError(
                self.name, limit="is not answered: the input has ended", remedy="start the run in a terminal"
            )
        self._take(line.strip())
        return math.isfinite(self._position)

    def stop(self) -> None:
        """End the wait for the operator, and discard what is typed now; nothing moves by itself."""
        with self._lock:
            self._question += 1

    def close(self) -> None:
        """Do nothing: no port is open."""

    def _take(self, text: str) -> None:
        """Return the target for Enter alone, or the typed number; prompt again until it is a number."""
        try:
            position = float(text.replace(",", ".")) if text else self._target
        except ValueError:
            position = math.nan
        if math.isfinite(position):
            self._position = position
        else:
            self._say(f"{text!r} is not a position in {self.unit}; press Enter, or type a number.")
            self._ask()

    def _ask(self) -> None:
        """Wait for a line, unless a wait is already in progress: two prompts need only one answer."""
        with self._lock:
            self._question += 1
            waiting, self._waiting = self._waiting, True
        if not waiting:
            threading.Thread(target=self._hear, daemon=True).start()

    def _hear(self) -> None:
        """Assign a line to the prompt that it answers: the last one when it arrived."""
        line = self._answer()
        with self._lock:
            self._waiting = False
            self._answers.put((self._question, line))
