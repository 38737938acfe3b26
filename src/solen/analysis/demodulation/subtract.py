"""On minus off: the reading of each "on" slot without the simultaneous ambient light.

The ambient light at the time of an "on" slot is interpolated linearly between the "off" slots before and after it; if
both are equally distant, this is their mean. Constant light and light that changes at a constant rate are removed
exactly, for every emitter in a sequence. With only one "off" slot (one-sided), only constant light is removed.

The uncertainty of a reading is estimated from the "off" slots themselves: the deviation of each slot from the line
between its neighbours contains the noise of a slot and the ambient light that is too fast to subtract.

Public names: `subtract`, `Demodulated` and `Counts`.
"""

from dataclasses import dataclass

import numpy as np

from solen.analysis.demodulation.rejection import Kernel
from solen.analysis.demodulation.slots import OFF, Slots
from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray
from solen.errors import DataError

MAX_DISTANCE = 1.5
"""Time to an "off" slot, relative to the median for the emitter, above which a nearer "off" slot must be missing."""


@dataclass(frozen=True)
class Counts:
    """Counts of "on" slots, used and rejected; ``readings`` and ``missing`` are keyed by emitter.

    ``missing`` slots of a regular sequence are not in the recording, ``without_off`` slots have no "off" slot nearby
    and give no reading, ``one_sided`` slots have an "off" slot on one side only, ``emptied`` slots contain no sample
    after settling, and ``clipped`` readings contain a sample at a limit in any channel.
    """

    readings: dict[int, int]
    missing: dict[int, int]
    without_off: int
    one_sided: int
    emptied: int
    clipped: int


@dataclass(frozen=True, eq=False)
class Demodulated:
    """M readings of C channels, in time order.

    Attributes
    ----------
    time_s, emitter, slot
        Time, emitter and index of the "on" slot of each reading, (M,).
    signal, u
        On minus ambient, (M, C), negative if light lowers the voltage, and its standard uncertainty.
    ambient
        Subtracted value, (M, C): the voltage with the emitter off.
    one_sided
        Whether only one "off" slot was nearby, (M,).
    clipped
        Whether a sample in the "on" slot or in its "off" slots was at a limit, (M, C).
    slot_sd
        Noise of a slot, (C,), from which the uncertainties follow; NaN with fewer than three "off" slots.
    period_s
        Median time between readings of one emitter; NaN with fewer than two.
    counts
        Missing data.
    """

    time_s: FloatArray
    emitter: IntArray
    slot: IndexArray
    signal: FloatArray
    u: FloatArray
    ambient: FloatArray
    one_sided: BoolArray
    clipped: BoolArray
    slot_sd: FloatArray
    period_s: float
    counts: Counts

    @property
    def emitters(self) -> tuple[int, ...]:
        """Emitter numbers."""
        return tuple(np.unique(self.emitter).tolist())

    def of(self, emitter: int) -> BoolArray:
        """Return whether each reading belongs to an emitter, (M,)."""
        return np.asarray(self.emitter == emitter)


def _drifts(slots: Slots, before: IntArray, after: IntArray, one_sided: BoolArray, off_sd: FloatArray) -> FloatArray:
    """Return the RMS change of ambient light between an "off" slot and the next reading, (C,), corrected for noise.

    It is half of the change between the "off" slots before and after a reading.
    """
    two_sided = ~one_sided
    if not two_sided.any():
        return np.zeros(slots.mean.shape[1])
    steps = slots.mean[after[two_sided]] - slots.mean[before[two_sided]]
    known = np.isfinite(steps)
    mean = (np.where(known, steps, 0.0) ** 2).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.asarray(0.5 * np.sqrt(np.maximum(mean - 2.0 * np.nan_to_num(off_sd) ** 2, 0.0)))


def subtract(slots: Slots, kernel: Kernel = "two-sided") -> Demodulated:
    """Subtract the ambient light and return the readings of all "on" slots.

    Parameters
    ----------
    slots
        Slots in time order.
    kernel
        ``two-sided``: the "off" slots before and after; ``one-sided``: only the "off" slot before, for comparison.

    Raises
    ------
    DataError
        If there is no "on" slot or no "off" slot.
    """
    on, off = np.flatnonzero(slots.state > OFF), np.flatnonzero(slots.state == OFF)
    if not on.size or not off.size:
        limit = (
            f"requires slots with an emitter on and slots with all emitters off, but there are {on.size} on slots and "
            f"{off.size} off slots"
        )
        remedy = "use a shorter settling time" if slots.emptied else "record both on slots and off slots"
        raise DataError("demodulation", limit=limit, remedy=remedy)
    before, after, near = _neighbours(slots, on, off)
    if kernel == "one-sided":
        near = near & np.array([True, False])
    kept = near.any(axis=1)
    on, before, after, near = on[kept], before[kept], after[kept], near[kept]
    weight = _weight_of_after(slots.time_s, on, before, after, near)[:, None]
    ambient = (1.0 - weight) * slots.mean[before] + weight * slots.mean[after]
    off_sd = slot_sd(slots)
    u = np.sqrt(on_sd(slots, off_sd, slots.state[on]) ** 2 + ((1.0 - weight) ** 2 + weight**2) * off_sd**2)
    one_sided = np.logical_not(near.all(axis=1))
    u = np.where(one_sided[:, None], np.hypot(u, _drifts(slots, before, after, one_sided, off_sd)), u)
    clipped = slots.clipped[on] | (slots.clipped[before] & (weight < 1.0)) | (slots.clipped[after] & (weight > 0.0))
    emitter = slots.state[on]
    emitters, readings = np.unique(emitter, return_counts=True)
    periods, missing = _periods(slots)
    counts = Counts(
        readings=dict(zip(emitters.tolist(), readings.tolist(), strict=True)),
        missing=missing,
        without_off=int(np.sum(~kept)),
        one_sided=0 if kernel == "one-sided" else int(one_sided.sum()),
        emptied=slots.emptied,
        clipped=int(np.sum(clipped.any(axis=1))),
    )
    return Demodulated(
        time_s=slots.time_s[on],
        emitter=emitter,
        slot=on,
        signal=slots.mean[on] - ambient,
        u=np.where(np.isfinite(ambient), u, np.nan),
        ambient=ambient,
        one_sided=one_sided,
        clipped=clipped,
        slot_sd=off_sd,
        period_s=float(np.median(periods)) if periods.size else float("nan"),
        counts=counts,
    )


def slot_sd(slots: Slots, block: int = 1) -> FloatArray:
    """Return the noise of an "off" slot, (C,); NaN with fewer than three "off" slots.

    It follows from the deviation of each slot from the line between its neighbours. With a ``block``, it follows from
    the means of this many successive deviations, and excludes flicker with whole periods in a block. For independent
    slots, the standard deviation of such a mean is the slot noise divided by the block length.
    """
    off = np.flatnonzero(slots.state == OFF)
    if off.size < 3:
        return np.full(slots.mean.shape[1], np.nan)
    time, mean = slots.time_s[off], slots.mean[off]
    weight = ((time[1:-1] - time[:-2]) / (time[2:] - time[:-2]))[:, None]
    deviation = mean[1:-1] - (1.0 - weight) * mean[:-2] - weight * mean[2:]
    if block == 1:
        squares = deviation**2 / (1.0 + weight**2 + (1.0 - weight) ** 2)
    else:
        blocks = len(deviation) // block
        squares = (block * deviation[: blocks * block].reshape(blocks, block, -1).mean(axis=1)) ** 2
    finite = np.isfinite(squares)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.where(finite, squares, 0.0).sum(axis=0) / finite.sum(axis=0)))


def _neighbours(slots: Slots, on: IndexArray, off: IndexArray) -> tuple[IndexArray, IndexArray, BoolArray]:
    """Return the nearest "off" slots before and after each "on" slot, and whether they exist and are near, (M, 2)."""
    following = np.searchsorted(off, on)
    before, after = off[np.maximum(following - 1, 0)], off[np.minimum(following, off.size - 1)]
    near = np.stack([following > 0, following < off.size], axis=1)
    distance = np.stack([slots.time_s[on] - slots.time_s[before], slots.time_s[after] - slots.time_s[on]], axis=1)
    for emitter in np.unique(slots.state[on]):
        rows = slots.state[on] == emitter
        for side in (0, 1):
            existing = rows & near[:, side]
            if existing.any():
                near[rows, side] &= distance[rows, side] <= MAX_DISTANCE * np.median(distance[existing, side])
    return before, after, near


def _weight_of_after(
    time_s: FloatArray, on: IndexArray, before: IndexArray, after: IndexArray, near: BoolArray
) -> FloatArray:
    """Return the weight of the "off" slot after each "on" slot, (M,): linear in time, or 0 or 1 if only one is near."""
    both = near.all(axis=1)
    span = np.where(both, time_s[after] - time_s[before], 1.0)
    return np.where(both, (time_s[on] - time_s[before]) / span, np.where(near[:, 1], 1.0, 0.0))


def on_sd(slots: Slots, off_sd: FloatArray, emitter: IntArray) -> FloatArray:
    """Return the noise of "on" slots (M, C) of emitters (M,).

    It is the larger of the noise of an "off" slot and the noise of the samples divided by the square root of their
    number, because an illuminated receiver has more shot noise than a receiver in the dark.
    """
    sd = np.broadcast_to(off_sd, (len(emitter), len(off_sd))).copy()
    for state, scatter in slots.scatter.items():
        if state != OFF:
            rows = emitter == state
            sd[rows] = np.fmax(sd[rows], scatter / np.sqrt(np.median(slots.samples[slots.state == state])))
    return sd


def _periods(slots: Slots) -> tuple[FloatArray, dict[int, int]]:
    """Return the median period of each emitter with several slots, and the number of missing slots of each emitter."""
    periods, missing = [], {}
    for emitter in np.unique(slots.state[slots.state > OFF]).tolist():
        steps = np.diff(slots.time_s[slots.state == emitter])
        missing[int(emitter)] = 0
        if steps.size:
            period = float(np.median(steps))
            periods.append(period)
            missing[int(emitter)] = int(np.sum(np.maximum(np.rint(steps / period) - 1, 0)))
    return np.array(periods), missing
