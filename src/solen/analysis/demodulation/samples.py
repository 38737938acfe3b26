"""Samples of several channels, and the state of the emitters at each: what slots are made of."""

from dataclasses import dataclass

from solen.analysis.demodulation.clock import Clock
from solen.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class Samples:
    """N samples of C channels.

    Attributes
    ----------
    time_s, values
        Shapes (N,) and (N, C).
    names, units
        Of the channels; a unit is empty where none is known.
    state
        Shape (N,), as `solen.analysis.demodulation.slots` numbers states.
    settle_s
        Time after a switch that is left out.
    clock
        Where the states were found in the waveform; None where they were recorded.
    """

    time_s: FloatArray
    values: FloatArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    state: IntArray
    settle_s: float
    clock: Clock | None
