"""Meters: instruments that measure the receivers and return a reading for each query, with switched or steady light.

A multimeter or an oscilloscope samples at its own pace. A thread queries one reading after another and timestamps query
and reply; the measurement took place between these two times, which are recorded. Readings are queued until the run
fetches them.

Public names: `Reading` and `PolledMeter`.
"""

import threading
from abc import ABC, abstractmethod
from dataclasses import dataclass
from queue import Empty, SimpleQueue

import numpy as np

from solen.arrays import BoolArray, FloatArray
from solen.bench.clock import Clock
from solen.errors import BenchError, DataError, SolenError

STOPS_S = 10.0
"""Longest time in s until a reading in progress ends."""
MAX_FAILED = 5
"""Number of consecutive failed readings that end the run."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Simultaneous readings of all inputs.

    Attributes
    ----------
    sent_s, t_s
        Times of query and reply, by the clock of the run.
    on, off
        Values of each input with the emitters on and off; NaN if unknown.
    clipped
        Whether each input was at a limit of its range.
    """

    sent_s: float
    t_s: float
    on: FloatArray
    off: FloatArray
    clipped: BoolArray


@dataclass
class MeterLosses:
    """Number of failed readings."""

    unreadable: int = 0


class PolledMeter(ABC):
    """A `Meter` that its own thread polls continuously.

    Parameters
    ----------
    name, clock
        Name of the meter, and clock of the run.
    inputs, unit
        Number of inputs, and the unit of their readings.
    switched
        Whether readings with the emitters off are known.
    """

    silent_s = 20.0
    no_watchdog = "solen does not switch the emitters: they stay on after the run"

    def __init__(self, name: str, clock: Clock, *, inputs: int, unit: str, switched: bool) -> None:
        self.name, self.inputs, self.unit, self.switched = name, inputs, unit, switched
        self.losses = MeterLosses()
        self._clock = clock
        self._queue: SimpleQueue[Reading] = SimpleQueue()
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._fault: SolenError | None = None

    @abstractmethod
    def measure(self) -> Reading:
        """Return a new reading; raise `DataError` if the measurement is unusable."""

    @abstractmethod
    def release(self) -> None:
        """Release the instruments."""

    def start(self) -> None:
        """Start polling."""
        self._queue, self._fault = SimpleQueue(), None
        self._ended.clear()
        self._thread = threading.Thread(target=self._poll, daemon=True)
        self._thread.start()

    def read(self) -> list[Reading]:
        """Return the readings since the last call; if there are none, raise any error that ended the polling."""
        readings, fault = [], self._fault  # the fault first: all earlier readings are then in the queue
        while True:
            try:
                readings.append(self._queue.get_nowait())
            except Empty:
                break
        if fault is not None and not readings:
            raise fault
        return readings

    def stop(self) -> None:
        """Stop polling."""
        self._ended.set()
        thread, self._thread = self._thread, None
        if thread is not None:
            thread.join(STOPS_S)
            if thread.is_alive():
                limit = f"has not completed a reading within {STOPS_S:g} s"
                raise BenchError(self.name, limit=limit, remedy="check that it is connected")

    def close(self) -> None:
        """Stop polling, and release the instruments."""
        try:
            self.stop()
        finally:
            self.release()

    def _poll(self) -> None:
        failed = 0
        while not self._ended.is_set():
            try:
                self._queue.put(self.measure())
                failed = 0
            except SolenError as bad:
                failed += 1
                self.losses.unreadable += 1
                if not isinstance(bad, DataError) or failed >= MAX_FAILED:
                    self._fault = bad
                    return
            except Exception as bad:  # otherwise the thread would end silently
                reason = " ".join(f"{type(bad).__name__}: {bad}".split())
                self._fault = BenchError(self.name, limit=f"cannot be read: {reason}")
                return


def steady_reading(sent_s: float, t_s: float, values: FloatArray, clipped: BoolArray) -> Reading:
    """Return a reading in steady light."""
    return Reading(sent_s, t_s, values, np.full(len(values), np.nan), clipped)
