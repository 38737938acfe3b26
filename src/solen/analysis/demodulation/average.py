"""Means of readings over whole mains periods, which remove flicker that the subtraction does not remove.

Lamps flicker at twice the mains frequency. At 200 readings per second, 100 Hz alternates from one reading to the next.
The mean of four readings, one period of 50 Hz, removes it and all its multiples, except for multiples of 200 Hz. This
is a filter: it is applied only on request, blocks do not overlap, and the result reports their size.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.analysis.demodulation.slots import OFF, Slots
from solen.analysis.demodulation.subtract import Demodulated, on_sd, slot_sd
from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray
from solen.errors import DataError

MAX_READINGS = 1000
NEAR = 0.02
"""Largest deviation of a block from a whole number of mains periods, as a fraction of one period."""


@dataclass(frozen=True, eq=False)
class Averaged:
    """Means of blocks of readings, like `Demodulated`; ``left_out`` readings belong to no complete block.

    ``places`` contains the indices of the readings in each block, (B, readings).
    """

    time_s: FloatArray
    emitter: IntArray
    places: IndexArray
    signal: FloatArray
    u: FloatArray
    ambient: FloatArray
    clipped: BoolArray
    readings: int
    left_out: int


def readings_per_mains(period_s: float, mains_hz: float) -> int:
    """Return the smallest number of readings that spans whole mains periods; raise `DataError` if no number up to 1000 does."""
    if not math.isfinite(period_s):
        raise DataError(
            "mains", value=mains_hz, limit="requires at least two readings from an emitter", remedy="omit it"
        )
    for readings in range(1, MAX_READINGS + 1):
        periods = readings * period_s * mains_hz
        if periods >= 1.0 - NEAR and abs(periods - round(periods)) <= NEAR:
            return readings
    limit = f"no number of readings every {1e3 * period_s:.4g} ms spans whole mains periods"
    raise DataError("mains", value=mains_hz, limit=limit, remedy="omit it")


def averaged(result: Demodulated, slots: Slots, readings: int) -> Averaged:
    """Average blocks of successive readings from each emitter; blocks with a missing reading are omitted.

    ``slots`` are the slots of these readings. Flicker that averaging removes does not contribute to the uncertainty.
    """
    parts = [_of_emitter(result, emitter, readings) for emitter in result.emitters]
    places = np.concatenate([np.empty((0, readings), dtype=np.intp), *parts])
    places = places[np.argsort(result.time_s[places].mean(axis=1), kind="stable")]
    u = _u(result, slots, result.emitter[places[:, 0]], readings)
    return Averaged(
        time_s=result.time_s[places].mean(axis=1),
        emitter=result.emitter[places[:, 0]],
        places=places,
        signal=result.signal[places].mean(axis=1),
        u=np.where(np.isfinite(result.signal[places]).all(axis=1), u, np.nan),
        ambient=result.ambient[places].mean(axis=1),
        clipped=result.clipped[places].any(axis=1),
        readings=readings,
        left_out=len(result.time_s) - places.size,
    )


def _u(result: Demodulated, slots: Slots, emitter: IntArray, readings: int) -> FloatArray:
    """Return the uncertainty of the means; with one emitter, successive readings share the "off" slot between them."""
    off = slots.time_s[slots.state == OFF]
    per_period = max(1, round(result.period_s / float(np.median(np.diff(off))))) if off.size > 1 else 1
    off_sd = slot_sd(slots, readings * per_period)
    shared = len(result.emitters) == 1
    of_off = (readings - 0.5) / readings**2 if shared else 0.5 / readings
    return np.asarray(np.sqrt(on_sd(slots, off_sd, emitter) ** 2 / readings + of_off * off_sd**2))


def _of_emitter(result: Demodulated, emitter: int, readings: int) -> IndexArray:
    """Return the indices (B, readings) of blocks without a gap, i.e. with consecutive numbers on the emitter's clock."""
    places = np.flatnonzero(result.of(emitter))
    if not places.size or not math.isfinite(result.period_s):
        return np.empty((0, readings), dtype=np.intp)
    steps = np.rint(np.diff(result.time_s[places]) / result.period_s).astype(np.int64)
    run = np.concatenate([[0], np.cumsum(steps != 1)])
    first = np.flatnonzero(np.diff(run, prepend=-1))
    inside = np.arange(len(places)) - first[run]
    length = np.bincount(run)
    usable = inside < (length // readings * readings)[run]
    return np.asarray(places[usable].reshape(-1, readings))
