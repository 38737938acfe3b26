"""Means of readings over whole mains periods, which remove flicker that the subtraction does not remove.

Lamps flicker at twice the mains frequency. At 200 readings per second, flicker of 100 Hz alternates from one reading to
the next. The mean of four readings, i.e. over one period of 50 Hz, removes all harmonics of 50 Hz except multiples of
200 Hz. Averaging is a filter: it is applied only on request, the blocks do not overlap, and the result reports their
size.
"""

import math
from dataclasses import dataclass

import numpy as np

from solen.analysis.demodulation.slots import OFF, Slots
from solen.analysis.demodulation.subtract import Demodulated, on_sd, slot_sd
from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray
from solen.errors import DataError

MAX_READINGS = 1000
MAX_DEVIATION = 0.02
"""Largest deviation of a block from an integer number of mains periods, in periods."""


@dataclass(frozen=True, eq=False)
class Averaged:
    """Means of the readings in each of B blocks, with fields as in `solen.analysis.demodulation.subtract.Demodulated`.

    ``blocks`` contains the indices of the readings in each block, (B, readings); ``omitted`` is the number of readings
    that belong to no complete block.
    """

    time_s: FloatArray
    emitter: IntArray
    blocks: IndexArray
    signal: FloatArray
    u: FloatArray
    ambient: FloatArray
    clipped: BoolArray
    readings: int
    omitted: int


def readings_per_mains(period_s: float, mains_hz: float) -> int:
    """Return the smallest number of readings that spans whole mains periods; raise `DataError` if none up to 1000."""
    if not math.isfinite(period_s):
        limit = "requires at least two readings from an emitter"
        raise DataError("mains_hz", value=mains_hz, limit=limit, remedy="omit it")
    for readings in range(1, MAX_READINGS + 1):
        periods = readings * period_s * mains_hz
        if periods >= 1.0 - MAX_DEVIATION and abs(periods - round(periods)) <= MAX_DEVIATION:
            return readings
    limit = f"no number of readings every {1e3 * period_s:.4g} ms spans whole mains periods"
    raise DataError("mains_hz", value=mains_hz, limit=limit, remedy="omit it")


def averaged(result: Demodulated, slots: Slots, readings: int) -> Averaged:
    """Average blocks of successive readings from each emitter; blocks with a missing reading are omitted.

    ``slots`` are the slots of these readings. Flicker that averaging removes does not contribute to the uncertainty.
    """
    parts = [_blocks(result, emitter, readings) for emitter in result.emitters]
    blocks = np.concatenate([np.empty((0, readings), dtype=np.intp), *parts])
    blocks = blocks[np.argsort(result.time_s[blocks].mean(axis=1), kind="stable")]
    u = _u(result, slots, result.emitter[blocks[:, 0]], readings)
    return Averaged(
        time_s=result.time_s[blocks].mean(axis=1),
        emitter=result.emitter[blocks[:, 0]],
        blocks=blocks,
        signal=result.signal[blocks].mean(axis=1),
        u=np.where(np.isfinite(result.signal[blocks]).all(axis=1), u, np.nan),
        ambient=result.ambient[blocks].mean(axis=1),
        clipped=result.clipped[blocks].any(axis=1),
        readings=readings,
        omitted=len(result.time_s) - blocks.size,
    )


def _u(result: Demodulated, slots: Slots, emitter: IntArray, readings: int) -> FloatArray:
    """Return the uncertainty of the means; with one emitter, successive readings share the "off" slot between them."""
    off = slots.time_s[slots.state == OFF]
    per_period = max(1, round(result.period_s / float(np.median(np.diff(off))))) if off.size > 1 else 1
    off_sd = slot_sd(slots, readings * per_period)
    shared = len(result.emitters) == 1
    off_weight = (readings - 0.5) / readings**2 if shared else 0.5 / readings
    return np.asarray(np.sqrt(on_sd(slots, off_sd, emitter) ** 2 / readings + off_weight * off_sd**2))


def _blocks(result: Demodulated, emitter: int, readings: int) -> IndexArray:
    """Return the indices (B, readings) of an emitter's readings in blocks without a missing reading."""
    indices = np.flatnonzero(result.of(emitter))
    if not indices.size or not math.isfinite(result.period_s):
        return np.empty((0, readings), dtype=np.intp)
    steps = np.rint(np.diff(result.time_s[indices]) / result.period_s).astype(np.int64)
    run = np.concatenate([[0], np.cumsum(steps != 1)])
    first = np.flatnonzero(np.diff(run, prepend=-1))
    position = np.arange(len(indices)) - first[run]
    length = np.bincount(run)
    usable = position < (length // readings * readings)[run]
    return np.asarray(indices[usable].reshape(-1, readings))
