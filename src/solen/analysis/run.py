"""One recording of a sensor with its motion and the cycles that count.

The interface: `Run`.
"""

from dataclasses import field

from solen.analysis.motion import Motion
from solen.analysis.signals import Signals
from solen.arrays import BoolArray
from solen.ranks import Caution
from solen.results import HIDDEN, Result, reported


class Run(Result):
    """One recording.

    Attributes
    ----------
    signals
        The recorded signals.
    motion
        Its ramps, holds and cycles.
    used
        Places of the cycles that response and figures of merit rest on: those at the speed of most.
    timed
        Places of all that timing is known from: those of other speeds, too.
    clipped
        Which samples are clipped, (n, m).
    warnings
        Clipping.
    """

    signals: Signals = field(metadata=HIDDEN)
    motion: Motion
    used: tuple[int, ...]
    timed: tuple[int, ...]
    clipped: BoolArray = field(metadata=HIDDEN)
    warnings: tuple[Caution, ...] = field(metadata=HIDDEN)

    @reported
    def file(self) -> str:
        """Name of the recording's file."""
        return self.signals.source
