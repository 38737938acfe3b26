"""A recording of a sensor with its motion and the cycles used.

Public name: `Run`.
"""

from dataclasses import field

from solen.analysis.motion import Motion
from solen.analysis.signals import Signals
from solen.arrays import BoolArray
from solen.ranks import Caution
from solen.results import HIDDEN, Result, reported


class Run(Result):
    """A recording of a sensor.

    Attributes
    ----------
    signals
        The recorded signals.
    motion
        Ramps, holds and cycles of the recorded motion.
    used
        Indices of the cycles used for the response and its figures of merit, all at the speed of most cycles.
    timed
        Indices of the cycles used for timing, including those at other speeds.
    clipped
        Whether each sample is clipped, (n, m).
    warnings
        Warnings about clipping.
    """

    signals: Signals = field(metadata=HIDDEN)
    motion: Motion
    used: tuple[int, ...]
    timed: tuple[int, ...]
    clipped: BoolArray = field(metadata=HIDDEN)
    warnings: tuple[Caution, ...] = field(metadata=HIDDEN)

    @reported
    def file(self) -> str:
        """File name of the recording."""
        return self.signals.source
