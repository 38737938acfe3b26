"""Roles of instruments: one interface for each, real or simulated.

The idea: a protocol runs on roles. A real and a simulated instrument implement the same interface, and only the
rig file chooses between them.

The interface: `Stage`, `Homes`, `EmitterBoard`, `KeepsTime`, `Daq`, `Meter`; `Sampler` is any of the last.
Every call raises `BenchError` if the instrument does not do what is requested.
"""

from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from solen.bench.daq import DaqLosses, Samples, Setup
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.meter import MeterLosses, Reading


class Stage(Protocol):
    """One motion axis with known position; positions and velocities in its own unit."""

    name: str

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of its positions."""

    def reference(self) -> None:
        """Find the zero, unless it is known; returns when it is found. A stage that moves to find it is a `Homes`."""

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity; `on_target` says when it has arrived."""

    def position(self) -> float:
        """Where it is."""

    def on_target(self) -> bool:
        """Whether it has come to rest where it was sent."""

    def stop(self) -> None:
        """Stop at once."""

    def close(self) -> None:
        """Stop and release the instrument."""


class Homes(Protocol):
    """A stage that moves to find its zero, and says so before."""

    name: str

    @property
    def referenced(self) -> bool:
        """Whether it knows where zero is."""

    @property
    def search(self) -> str:
        """A sentence: how far it may move to find its zero."""

    def reference(self) -> None:
        """Find the zero."""

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""


class EmitterBoard(Protocol):
    """Instrument that lights the emitters in turn and samples the receivers, period after period.

    Attributes
    ----------
    layout
        How many emitters and receivers it has.
    period_s
        From one period to the next.
    """

    name: str
    layout: Layout
    period_s: float

    @property
    def volts_per_count(self) -> float:
        """Size of one count in V, or in the unit of the rig's receivers."""

    @property
    def losses(self) -> Losses:
        """Losses so far."""

    def start(self) -> None:
        """Begin to light and to sample."""

    def read(self) -> Periods:
        """Periods that came since the last call."""

    def stop(self) -> None:
        """Emitters off, no more samples."""

    def close(self) -> None:
        """Stop and release the instrument."""


@runtime_checkable
class KeepsTime(Protocol):
    """A board that can be asked for its time, so that more is known than what listening shows."""

    def time_s(self) -> float | None:
        """Its current time in s, as it stamps periods; NaN if its answer lacks it, None without an answer."""


@runtime_checkable
class Daq(Protocol):
    """Instrument that samples voltages at a rate.

    Attributes
    ----------
    setup
        Its settings.
    rate_hz, switch_hz
        Samples of each channel, and pulses of its counters, per second, as the instrument has them by its own clock.
    convert_s
        From one channel's sample to the next channel's.
    """

    name: str
    setup: Setup
    rate_hz: float
    switch_hz: float
    convert_s: float

    @property
    def coefficients(self) -> NDArray[np.float64]:
        """Volts = Σ c[k] countsᵏ of each channel, shape (channels, order + 1)."""

    @property
    def losses(self) -> DaqLosses:
        """Losses so far."""

    def start(self) -> None:
        """Begin to sample, and to light the emitters, where it does."""

    def read(self) -> Samples:
        """Samples since the last call."""

    def stop(self) -> None:
        """Emitters off, where it lights them; no more samples."""

    def close(self) -> None:
        """Stop and release the instrument."""


@runtime_checkable
class Meter(Protocol):
    """Instrument that takes readings at its own pace; it does not drive emitters.

    Attributes
    ----------
    inputs, unit
        Number of inputs, and the unit of their readings.
    switched
        Whether readings distinguish on and off; otherwise light is steady.
    """

    name: str
    inputs: int
    unit: str
    switched: bool

    @property
    def losses(self) -> MeterLosses:
        """Missing readings."""

    def start(self) -> None:
        """Begin to measure."""

    def read(self) -> list[Reading]:
        """Readings since the last call."""

    def stop(self) -> None:
        """Measure no more."""

    def close(self) -> None:
        """Stop and release the instruments."""


Sampler = EmitterBoard | Daq | Meter
