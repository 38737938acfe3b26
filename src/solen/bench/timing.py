"""Timing of the stage: the uncertainty due to slow lines and coarse clocks, and its contribution to hysteresis.

A stage replies to a position query with a delay, and it is unknown when during this delay the position was measured.
Query and reply are timestamped; the midpoint is assumed, with an error of at most half the round trip. The clock's
resolution is treated likewise: an event stamped t occurred up to one step later. A time error shifts the rising and the
falling branch in opposite directions, each by speed times error, as hysteresis does; at a single speed the two effects
cannot be determined separately. The timing uncertainty is therefore recorded, and an analysis of hysteresis can report
how much timing may contribute.

Public names: `Positions`, `latest_arrival_s`, `exchanges`, `Timing`, `STAGE` and `EXCHANGE`.
"""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from solen.arrays import BoolArray, FloatArray
from solen.bench.clock_fit import ClockLine
from solen.bench.journal_content import JournalContent, Rows
from solen.ranks import Caution, warning

STAGE = np.dtype([("part", "<u2"), ("sent_s", "<f8"), ("t_s", "<f8"), ("position", "<f8")])
"""Type of the row of a position query: part of the run, times of query and reply, and the position in the reply."""
EXCHANGE = np.dtype([("part", "<u2"), ("sent_s", "<f8"), ("t_s", "<f8"), ("device_s", "<f8")])
"""Type of the row of a clock query: part of the run, times of query and reply, time in the reply (NaN: none)."""
MIN_MOVE = 1e-3
"""Change of the position between two queries, as a fraction of the range, above which the stage counts as moving."""
START_S = 2.0
"""Longest time in s from the start of a sampler to its first samples."""
MAX_CONTRIBUTION = 0.005
"""Contribution of timing to hysteresis, as a fraction of the range, above which a warning is given."""


@dataclass(frozen=True, eq=False)
class Positions:
    """Recorded positions of a stage.

    Attributes
    ----------
    part
        Part of the run, (n,).
    time_s
        Time by the clock of the run: the midpoint of query and reply, (n,).
    bound_s
        Bound on the error of this time in either direction, (n,).
    position
        Position in the unit of the stage, (n,).
    """

    part: FloatArray
    time_s: FloatArray
    bound_s: FloatArray
    position: FloatArray

    @classmethod
    def of(cls, stage: Rows, resolution_s: float) -> "Positions":
        """Return the positions in the rows of a journal; a journal of version 1 contains only reply times."""
        reply = stage["t_s"]
        sent = stage["sent_s"] if "sent_s" in (stage.dtype.names or ()) else reply
        half = 0.5 * (reply - sent + resolution_s)
        return cls(stage["part"].astype(float), sent + half, half, stage["position"])

    def at(self, time_s: FloatArray) -> FloatArray:
        """Interpolate the position at ascending times by a monotone cubic; NaN if unknown.

        During acceleration, linear interpolation between queries 20 ms apart would have an error of up to 0.01 deg,
        always in the same direction; that of a monotone cubic is a quarter of this, without overshoot.
        """
        known = np.isfinite(self.position)
        if not known.any() or len(time_s) == 0:
            return np.full(len(time_s), np.nan)
        if not known.all():
            return self._at_known(time_s, known)
        first, last = np.searchsorted(self.time_s, time_s[[0, -1]])
        near = slice(max(int(first) - 3, 0), int(last) + 3)
        # a coarse clock gives several queries the same time
        known_s, index, counts = np.unique(self.time_s[near], return_inverse=True, return_counts=True)
        position = np.bincount(index, self.position[near]) / counts
        if len(known_s) < 2:
            return np.full(len(time_s), position[0])
        return np.asarray(PchipInterpolator(known_s, position)(np.clip(time_s, known_s[0], known_s[-1])))

    def _at_known(self, time_s: FloatArray, known: BoolArray) -> FloatArray:
        """Interpolate where the positions before and after a time are known; NaN elsewhere."""
        kept = Positions(self.part[known], self.time_s[known], self.bound_s[known], self.position[known])
        after = np.clip(np.searchsorted(self.time_s, time_s), 0, len(known) - 1)
        between_known = known[after] & known[np.maximum(after - 1, 0)]
        return np.where(between_known, kept.at(time_s), np.nan)


def latest_arrival_s(rows: Rows, journal: JournalContent) -> FloatArray:
    """Return the latest times at which rows can have arrived: one step of the run's clock later than their stamps."""
    return np.asarray(rows["t_s"] + journal.header.get("clock_resolution_s", 0.0))


def exchanges(journal: JournalContent, part: int, arrival_s: FloatArray) -> FloatArray:
    """Return the exchanges (K, 3) of a part for `fit_clock`, between the arrivals of the first and the last samples."""
    rows = journal.streams.get("exchange", np.zeros(0, EXCHANGE))
    at_start = (rows["device_s"] == 0.0) & (arrival_s[0] - rows["t_s"] < START_S)
    during = (rows["t_s"] <= arrival_s[-1]) & ((rows["t_s"] >= arrival_s[0]) | at_start)
    kept = rows[(rows["part"] == part) & during]
    return np.stack([kept["sent_s"], latest_arrival_s(kept, journal), kept["device_s"]], axis=1)


@dataclass(frozen=True)
class Timing:
    """Timing uncertainty due to the clocks and lines of a run; the recording stores its `attributes`.

    Attributes
    ----------
    clock_resolution_s
        Step of the run's clock.
    look_interval_s, look_jitter_s
        Median and standard deviation of the time from query to query while the stage moves.
    look_round_trip_s
        Mean time from query to reply while the stage moves; None if it was not recorded.
    sampler_bound_s
        Bound on the error of the line from the sampler's clock to the run's clock; None if unknown.
    between_looks_s
        Interpolation error between queries while the stage moves, divided by its speed: a quarter of the RMS deviation
        of every second query from a curve through the others.
    timing_bound_s
        Bound on the time between an angle and its reading, in either direction: the sum of half the round trip, half
        the clock's step, the sampler's bound and the interpolation error. Timing can separate the rising and the
        falling branch by at most twice this bound times the speed.
    """

    clock_resolution_s: float
    look_interval_s: float
    look_jitter_s: float
    look_round_trip_s: float | None
    sampler_bound_s: float | None
    between_looks_s: float
    timing_bound_s: float

    @classmethod
    def of(cls, stage: Rows, resolution_s: float, lines: Iterable[ClockLine]) -> "Timing":
        """Compute the timing from the rows of a stage and the lines of the sampler's clock."""
        positions = Positions.of(stage, resolution_s)
        known, moving = _steps(positions.part, positions.position)
        moving = moving if moving.any() else known
        interpolation = _interpolation_error_s(positions, moving)
        intervals, bounds = np.diff(positions.time_s)[moving], positions.bound_s[1:][moving]
        line_bounds = [line.bound_s for line in lines if line.bound_s is not None]
        sampler = max(line_bounds) if line_bounds else None
        query = float(bounds.mean()) if len(bounds) else 0.0
        has_round_trip = "sent_s" in (stage.dtype.names or ())
        return cls(
            clock_resolution_s=resolution_s,
            look_interval_s=float(np.median(intervals)) if len(intervals) else math.nan,
            look_jitter_s=float(np.std(intervals)) if len(intervals) else math.nan,
            look_round_trip_s=max(0.0, 2.0 * query - resolution_s) if has_round_trip else None,
            sampler_bound_s=sampler,
            between_looks_s=interpolation,
            timing_bound_s=query + interpolation + (sampler or 0.0),
        )

    @property
    def attributes(self) -> dict[str, float]:
        """The finite values, keyed by name."""
        return {key: value for key, value in asdict(self).items() if value is not None and math.isfinite(value)}

    def caution(self, speed: float, full_scale: float, unit: str) -> Caution | None:
        """Return a warning if timing can contribute notably to hysteresis at a speed."""
        contribution = 2.0 * speed * self.timing_bound_s
        if not full_scale > 0.0 or contribution <= MAX_CONTRIBUTION * full_scale:
            return None
        query = ""
        if self.look_round_trip_s is not None:
            query = f" (a position query takes {1e3 * self.look_round_trip_s:.3g} ms)"
        return warning(
            f"angles and readings may be {1e3 * self.timing_bound_s:.3g} ms apart{query}: at {speed:g} {unit}/s timing "
            f"contributes up to {contribution:.2g} {unit}, {100.0 * contribution / full_scale:.2g} % of full scale, "
            "to hysteresis"
        )


def _interpolation_error_s(positions: Positions, moving: BoolArray) -> float:
    """Return the error of interpolating the position of the moving stage between queries, divided by the stage speed.

    It is estimated as a quarter of the error if every other query is omitted and interpolated from its neighbours.
    """
    even = Positions(positions.part[::2], positions.time_s[::2], positions.bound_s[::2], positions.position[::2])
    odd_moving = moving[: len(moving) // 2 * 2 : 2]
    distance = np.abs(np.diff(positions.position))[moving].sum()
    duration_s = np.diff(positions.time_s)[moving].sum()
    if not (odd_moving.any() and distance > 0.0 and duration_s > 0.0):
        return 0.0
    odd = slice(1, 2 * len(odd_moving), 2)
    error = positions.position[odd] - even.at(positions.time_s[odd])
    return float(0.25 * np.sqrt(np.nanmean(error[odd_moving] ** 2)) * duration_s / distance)


def _steps(part: FloatArray, position: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return which steps (n - 1,) from query to query are known, and during which of these the stage moves."""
    steps = np.abs(np.diff(position))
    known = (np.diff(part) == 0.0) & np.isfinite(steps)
    return known, known & (steps > MIN_MOVE * full_scale_of(position))


def known_only_at_rest(stage: Rows) -> bool:
    """Whether the position of a stage is unknown while it moves; its readings at rest are unaffected by time errors."""
    unknown = bool(np.isnan(stage["position"]).any())
    return unknown and not _steps(stage["part"].astype(float), stage["position"])[1].any()


def full_scale_of(position: FloatArray) -> float:
    """Return the range from the lowest to the highest known position; 0 if none is known."""
    known = position[np.isfinite(position)]
    return float(np.ptp(known)) if len(known) else 0.0
