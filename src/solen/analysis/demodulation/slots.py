"""Slots: runs of samples with a constant emitter state.

A slot ends when the state changes or samples are missing. The first samples of a slot, which may still be settling, are
dropped; the remaining samples of each channel are averaged.

Public name: `slots_of`.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray, IntArray
from solen.errors import DataError

OFF, DROPPED = 0, -1
"""States of samples with all emitters off, and of samples not to be used; otherwise the number of the emitter, from 1,
that is on.
"""
MAX_STEP = 1.5
"""Time step, relative to the median step, above which samples are missing."""


@dataclass(frozen=True, eq=False)
class Slots:
    """K slots of C channels.

    Attributes
    ----------
    time_s, state
        Mean time of the averaged samples, and the state, both (K,).
    mean
        Mean of each channel, (K, C); NaN if a channel has no sample.
    scatter
        Noise of a sample, (C,), keyed by state, from differences between neighbours inside slots. Empty if slots are
        single samples.
    samples
        Number of samples averaged in the channel with the most samples, (K,).
    clipped
        Whether a sample in the slot was at a limit, (K, C).
    emptied
        Number of slots that contain no sample after settling.
    """

    time_s: FloatArray
    state: IntArray
    mean: FloatArray
    scatter: dict[int, FloatArray]
    samples: IntArray
    clipped: BoolArray
    emptied: int = 0


def slots_of(
    time_s: FloatArray,
    values: FloatArray,
    state: IntArray,
    *,
    settle_s: float = 0.0,
    limits: tuple[FloatArray, FloatArray] | None = None,
    clipped: BoolArray | None = None,
    gap_s: float | None = None,
) -> Slots:
    """Group samples into slots.

    Parameters
    ----------
    time_s
        Times, ascending, (N,).
    values
        Values (N, C); NaN if a channel has no sample.
    state
        States (N,): `OFF`, the number of the emitter that is on, or `DROPPED`.
    settle_s
        Time from a slot's first sample during which samples are omitted.
    limits
        Lowest and highest value of each channel, both (C,); samples at a limit are treated as clipped.
    clipped
        Which samples are clipped, (N, C), as an alternative to limits.
    gap_s
        Gap between samples of the same state that separates two slots; by default one and a half median steps. A longer
        gap may be specified if every phase lasts longer, so that the gap cannot hide a change of state.

    Raises
    ------
    DataError
        If times are not ascending or there are no samples.
    """
    _check(time_s, values, state)
    begins = _begins(time_s, state, gap_s)
    at_limit = at_limits(values, limits) if clipped is None else clipped
    if begins.all():
        return _single(time_s, values, state, settle_s, at_limit)
    slot = np.cumsum(begins) - 1
    starts = np.flatnonzero(begins)
    used = state != DROPPED
    if settle_s > 0.0:
        used &= time_s - time_s[starts][slot] >= settle_s * (1.0 - 1e-9)
    kept = np.add.reduceat(used.astype(np.int64), starts)
    valid = np.isfinite(values) & used[:, None]
    counts = np.add.reduceat(valid.astype(np.int64), starts, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.add.reduceat(np.where(valid, values, 0.0), starts, axis=0) / counts
        middle = np.add.reduceat(np.where(used, time_s, 0.0), starts) / kept
    at_limit = at_limit & used[:, None]
    filled, states = kept > 0, state[starts]
    return Slots(
        time_s=middle[filled],
        state=states[filled],
        mean=mean[filled],
        scatter=_scatter(values, valid, slot, states) if kept.max() > 1 else {},
        samples=counts.max(axis=1)[filled],
        clipped=np.asarray(np.logical_or.reduceat(at_limit, starts, axis=0)[filled]),
        emptied=int(np.sum((states != DROPPED) & ~filled)),
    )


def _single(time_s: FloatArray, values: FloatArray, state: IntArray, settle_s: float, at_limit: BoolArray) -> Slots:
    """Return slots of one sample each; there are none if samples are discarded for settling."""
    filled = (state != DROPPED) & (settle_s <= 0.0)
    rows = slice(None) if filled.all() else filled  # a slice copies nothing
    mean = values[rows]
    finite = np.isfinite(mean)
    return Slots(
        time_s=time_s[rows],
        state=state[rows],
        mean=mean if finite.all() else np.where(finite, mean, np.nan),
        scatter={},
        samples=np.ones(len(mean), dtype=np.int64),
        clipped=at_limit[rows],
        emptied=int(np.sum((state != DROPPED) & ~filled)),
    )


def _check(time_s: FloatArray, values: FloatArray, state: IntArray) -> None:
    if values.ndim != 2 or not len(time_s) == len(values) == len(state) or not len(time_s):
        shapes = f"have shapes {np.shape(time_s)}, {np.shape(values)}, {np.shape(state)}"
        limit = f"{shapes}, but must be times (N,), values (N, C) and states (N,) of at least one sample"
        raise DataError("samples", limit=limit)
    back = np.flatnonzero(~(np.diff(time_s) > 0.0))
    if back.size or not np.isfinite(time_s).all():
        row = int(back[0]) + 1 if back.size else int(np.flatnonzero(~np.isfinite(time_s))[0])
        limit = "must be later than the previous time"
        raise DataError(f"time of sample {row + 1}", value=float(time_s[row]), limit=limit)


def _begins(time_s: FloatArray, state: IntArray, gap_s: float | None) -> BoolArray:
    """Return whether each sample begins a slot, after a change of state or a gap in time."""
    steps = np.diff(time_s)
    max_step = MAX_STEP * float(np.median(steps)) if steps.size else 0.0
    return np.concatenate([[True], (np.diff(state) != 0) | (steps > max(max_step, gap_s or 0.0))])


def at_limits(values: FloatArray, limits: tuple[FloatArray, FloatArray] | None) -> BoolArray:
    """Return which samples (N, C) are at or outside a limit of their channel."""
    if limits is None:
        return np.broadcast_to(np.False_, values.shape)
    low, high = limits
    with np.errstate(invalid="ignore"):
        return np.asarray((values <= low) | (values >= high))


def _scatter(values: FloatArray, valid: BoolArray, slot: IndexArray, states: IntArray) -> dict[int, FloatArray]:
    """Return the noise of a sample, keyed by state, from differences inside slots, which cancel slow changes."""
    inside = slot[1:] == slot[:-1]
    both_valid = valid[1:] & valid[:-1] & inside[:, None]
    squares = np.where(both_valid, np.diff(np.where(valid, values, 0.0), axis=0), 0.0) ** 2
    scatter = {}
    for state in np.unique(states[states != DROPPED]).tolist():
        rows = states[slot[1:]] == state
        with np.errstate(invalid="ignore", divide="ignore"):
            scatter[int(state)] = np.sqrt(0.5 * squares[rows].sum(axis=0) / both_valid[rows].sum(axis=0))
    return scatter
