"""A stage turned by hand from stop to stop: the program prompts, the operator turns it and presses Enter.

The idea: while the stage is turned its position is unknown, so readings of that time have no angle and are left
out. At a stop it is at the position of the protocol, or at the one read from its scale, which the operator may type
before Enter. Between stops the operator may take any time; emitters remain driven and sampled.

The interface: `HandStage`, a `Stage`.
"""

import math
import sys
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Literal

from solen.errors import BenchError

PATIENCE_S = 3600.0
"""Longest time that a person may take for a move."""


def _said(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def _typed() -> str:
    return sys.stdin.readline()


class HandStage:
    """A stage without a motor.

    Parameters
    ----------
    unit
        Unit of its positions.
    say
        Shows a line to the operator; default: stderr.
    answer
        Waits for a line of theirs, and gives it with its end; empty if nobody can answer any more. Default: stdin.
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
        """Always true: the operator knows where its zero is."""

    def begin_move(self, target: float, velocity: float) -> None:  # noqa: ARG002  a hand has its own
        """Ask for a move; a target that it has already reached needs no move."""
        if target == self._position:
            return
        self._target, self._position = target, math.nan
        self._say(f"Move the stage to {target:+g} {self.unit}, then press Enter (or type its actual position).")
        self._ask()

    def position(self) -> float:
        """Its position; NaN while it is moved, and before the first move."""
        return self._position

    def on_target(self) -> bool:
        """Whether the operator has confirmed that it rests."""
        if math.isfinite(self._position):
            return True
        try:
            question, line = self._answers.get_nowait()
        except Empty:
            return False
        if question != self._question:
            return False
        if not line:
            raise BenchError(self.name, limit="nobody answers: the input has ended", remedy="run it at a terminal")
        self._take(line.strip())
        return math.isfinite(self._position)

    def stop(self) -> None:
        """Nothing moves by itself; a hand that is at it is no longer waited for, and what is typed now is dropped."""
        with self._lock:
            self._question += 1

    def close(self) -> None:
        """Do nothing: no port is open."""

    def _take(self, text: str) -> None:
        """The target for Enter alone, or what was typed; asks again until it is a number."""
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
        """Wait for a line, unless a wait is already under way: two prompts need only one answer."""
        with self._lock:
            self._question += 1
            waiting, self._waiting = self._waiting, True
        if not waiting:
            threading.Thread(target=self._hear, daemon=True).start()

    def _hear(self) -> None:
        """Assign a line to the question that it answers: the last one when it arrived."""
        line = self._answer()
        with self._lock:
            self._waiting = False
            self._answers.put((self._question, line))
