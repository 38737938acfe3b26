"""Roles of instruments, with an interface for each.

A real and a simulated instrument implement the same interface; only the rig file determines which is used.

Public names: `Stage`, `HomingStage`, `EmitterBoard`, `ClockedBoard`, `Daq`, `Meter` and `Sampler`. Every call raises
`BenchError` if the instrument does not do what is requested.
"""

from typing import Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from solen.bench.daq import DaqLosses, Samples, Setup
from solen.bench.frames import Layout, Losses, Periods
from solen.bench.meter import MeterLosses, Reading


class Stage(Protocol):
    """An axis of motion with a known position; positions and velocities are in its unit."""

    name: str

    @property
    def unit(self) -> Literal["deg", "mm"]:
        """Unit of its positions."""

    def reference(self) -> None:
        """Find the zero, unless it is known, and return when it is found; a `HomingStage` moves for this."""

    def begin_move(self, target: float, velocity: float) -> None:
        """Begin to move to a position at a velocity; `on_target` reports when it has arrived."""

    def position(self) -> float:
        """Return the position."""

    def on_target(self) -> bool:
        """Whether the stage is at rest at its target."""

    def stop(self) -> None:
        """Stop at once."""

    def close(self) -> None:
        """Stop and release the instrument."""


class HomingStage(Protocol):
    """A stage that moves to find its zero."""

    name: str

    @property
    def referenced(self) -> bool:
        """Whether the stage has a zero."""

    @property
    def search(self) -> str:
        """Sentence for the operator: the homing move and its range."""

    def reference(self) -> None:
        """Find the zero."""

    def set_position(self, position: float) -> None:
        """Define the current position as a given value; nothing moves."""


class EmitterBoard(Protocol):
    """Instrument that in each period switches the emitters on one after the other and samples the receivers.

    Attributes
    ----------
    layout
        Numbers of emitters and of receivers.
    period_s
        Duration of a period in s.
    """

    name: str
    layout: Layout
    period_s: float

    @property
    def volts_per_count(self) -> float:
        """Size of one count in V, or in the unit of the receiver signals."""

    @property
    def losses(self) -> Losses:
        """Counts of lost data since the start."""

    def start(self) -> None:
        """Start switching the emitters and sampling."""

    def read(self) -> Periods:
        """Return the periods that arrived since the last call."""

    def stop(self) -> None:
        """Switch the emitters off and stop sampling."""

    def close(self) -> None:
        """Stop and release the instrument."""


@runtime_checkable
class ClockedBoard(Protocol):
    """A board whose clock can be queried, which bounds the error of its times better than arrivals alone."""

    def time_s(self) -> float | None:
        """Return the time in s of the clock that stamps periods; NaN if the reply has no time, None without a reply."""


@runtime_checkable
class Daq(Protocol):
    """DAQ device: an instrument that samples voltages at a fixed rate.

    Attributes
    ----------
    setup
        Its settings.
    rate_hz, switch_hz
        Sampling rate of each channel, and switching frequency of each emitter, by the device's own clock.
    convert_s
        Interval between the samples of successive channels in s.
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
        """Counts of lost data since the start."""

    def start(self) -> None:
        """Start sampling, and switching the emitters if the device drives them."""

    def read(self) -> Samples:
        """Return the samples since the last call."""

    def stop(self) -> None:
        """Switch the emitters off if the device drives them, and stop sampling."""

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
        Whether readings distinguish on and off; otherwise the light is steady.
    """

    name: str
    inputs: int
    unit: str
    switched: bool

    @property
    def losses(self) -> MeterLosses:
        """Failed readings since the meter was opened."""

    def start(self) -> None:
        """Start measuring."""

    def read(self) -> list[Reading]:
        """Return the readings since the last call."""

    def stop(self) -> None:
        """Stop measuring."""

    def close(self) -> None:
        """Stop and release the instruments."""


Sampler = EmitterBoard | Daq | Meter
