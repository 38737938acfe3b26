"""Timing of the stage: uncertainty due to slow lines and coarse clocks, and its contribution to hysteresis.

A stage answers a position query with a delay, and the time of its measurement within this delay is unknown. A query is
stamped twice, when it is sent and when it is answered; the middle is assumed, with an error of at most half the round
trip. The clock's resolution is treated likewise: an event stamped t occurred up to one step later. A time error shifts
the rising branch against the falling one by speed times error, as hysteresis does; at a single speed the two cannot be
separated. A recording therefore states its timing uncertainty, and an analysis of hysteresis can state the possible
contribution of timing.

Public names: `Looks`, `came_by`, `exchanges`, `Timing`, `STAGE` and `EXCHANGE`.
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
"""Part of the run; times of the query and of its answer, and the position in the answer."""
EXCHANGE = np.dtype([("part", "<u2"), ("sent_s", "<f8"), ("t_s", "<f8"), ("device_s", "<f8")])
"""Part; times of query and answer of a sampler's clock, and its reading, NaN for none."""
MOVED = 1e-3
"""Fraction of the range by which the stage moves from query to query while it counts as moving."""
STARTED_S = 2.0
"""Time in s after the start of a sampler within which a record belongs to that start."""
NOTABLE = 0.005
"""Fraction of the range that timing may add to a hysteresis without a warning."""


@dataclass(frozen=True, eq=False)
class Looks:
    """Positions of a stage at times of the run.

    Attributes
    ----------
    part
        Part of the run, (n,).
    time_s
        Middle of query and answer, (n,).
    bound_s
        Bound on the error of this time in either direction, (n,).
    position
        Position in the stage's unit, (n,).
    """

    part: FloatArray
    time_s: FloatArray
    bound_s: FloatArray
    position: FloatArray

    @classmethod
    def of(cls, stage: Rows, resolution_s: float) -> "Looks":
        """Return the position queries of a journal's rows.

        Journals of version 1 contain only the time of the answer.
        """
        came = stage["t_s"]
        sent = stage["sent_s"] if "sent_s" in (stage.dtype.names or ()) else came
        half = 0.5 * (came - sent + resolution_s)
        return cls(stage["part"].astype(float), sent + half, half, stage["position"])

    def at(self, time_s: FloatArray) -> FloatArray:
        """Interpolate the position at ascending times, with a monotone cubic between queries; NaN if unknown.

        During acceleration, linear interpolation between queries 20 ms apart errs by up to 0.01 deg, always in the same
        direction; a monotone cubic errs by a quarter of that, without overshoot.
        """
        known = np.isfinite(self.position)
        if not known.any() or len(time_s) == 0:
            return np.full(len(time_s), np.nan)
        if not known.all():
            return self._at_known(time_s, known)
        first, last = np.searchsorted(self.time_s, time_s[[0, -1]])
        near = slice(max(int(first) - 3, 0), int(last) + 3)
        at, place, times = np.unique(self.time_s[near], return_inverse=True, return_counts=True)
        position = np.bincount(place, self.position[near]) / times  # a coarse clock gives several the same stamp
        if len(at) < 2:
            return np.full(len(time_s), position[0])
        return np.asarray(PchipInterpolator(at, position)(np.clip(time_s, at[0], at[-1])))

    def _at_known(self, time_s: FloatArray, known: BoolArray) -> FloatArray:
        """Interpolate between queries on both sides that have a known position; NaN elsewhere."""
        kept = Looks(self.part[known], self.time_s[known], self.bound_s[known], self.position[known])
        after = np.clip(np.searchsorted(self.time_s, time_s), 0, len(known) - 1)
        beside = known[after] & known[np.maximum(after - 1, 0)]
        return np.where(beside, kept.at(time_s), np.nan)


def came_by(came: Rows, journaled: JournalContent) -> FloatArray:
    """Return the latest times of the run at which a sampler's rows arrived: one clock step later than their stamps."""
    return np.asarray(came["t_s"] + journaled.header.get("clock_resolution_s", 0.0))


def exchanges(journaled: JournalContent, part: int, came_s: FloatArray) -> FloatArray:
    """Return the clock comparisons (K, 3) of a part for `fit_clock`, given the times at which samples arrived."""
    rows = journaled.streams.get("exchange", np.zeros(0, EXCHANGE))
    at_start = (rows["device_s"] == 0.0) & (came_s[0] - rows["t_s"] < STARTED_S)
    held = (rows["part"] == part) & (rows["t_s"] <= came_s[-1]) & ((rows["t_s"] >= came_s[0]) | at_start)
    kept = rows[held]
    return np.stack([kept["sent_s"], came_by(kept, journaled), kept["device_s"]], axis=1)


@dataclass(frozen=True)
class Timing:
    """Timing uncertainty from a recording's clocks and lines; its file stores the `attributes`.

    Attributes
    ----------
    clock_resolution_s
        Step of the run's clock.
    look_interval_s, look_jitter_s
        Median, and standard deviation, of the time from query to query while the stage moves.
    look_round_trip_s
        Mean time from query to answer while it moves; None if it was not recorded.
    sampler_bound_s
        Bound on the error of the sampler's clock on the run's clock; None if unknown.
    between_looks_s
        Interpolation error between queries while the stage moves, as a time at its speed: a quarter of the root mean
        square deviation of every second query from a curve through the others.
    timing_bound_s
        Bound on the time between an angle and its reading, in either direction: the sum of half the round trip, half
        the clock's step, the sampler's bound and the interpolation error. The rising and the falling branch differ by
        twice this bound times the speed.
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
        """Compute the timing from a stage's rows and the lines of the sampler's clock."""
        looks = Looks.of(stage, resolution_s)
        within, moving = _steps(looks.part, looks.position)
        moving = moving if moving.any() else within
        between = _between(looks, moving)
        intervals, bounds = np.diff(looks.time_s)[moving], looks.bound_s[1:][moving]
        known = [line.bound_s for line in lines if line.bound_s is not None]
        sampler = max(known) if known else None
        look = float(bounds.mean()) if len(bounds) else 0.0
        stamped = "sent_s" in (stage.dtype.names or ())
        return cls(
            clock_resolution_s=resolution_s,
            look_interval_s=float(np.median(intervals)) if len(intervals) else math.nan,
            look_jitter_s=float(np.std(intervals)) if len(intervals) else math.nan,
            look_round_trip_s=max(0.0, 2.0 * look - resolution_s) if stamped else None,
            sampler_bound_s=sampler,
            between_looks_s=between,
            timing_bound_s=look + between + (sampler or 0.0),
        )

    @property
    def attributes(self) -> dict[str, float]:
        """Return the numbers by name."""
        return {key: value for key, value in asdict(self).items() if value is not None and math.isfinite(value)}

    def remark(self, speed: float, reach: float, unit: str) -> Caution | None:
        """State the contribution of timing to a hysteresis at a speed, if it is a notable fraction of the range."""
        adds = 2.0 * speed * self.timing_bound_s
        if not reach > 0.0 or adds <= NOTABLE * reach:
            return None
        trip = (
            ""
            if self.look_round_trip_s is None
            else (f" (a position query takes {1e3 * self.look_round_trip_s:.3g} ms)")
        )
        return warning(
            f"angles and readings may be {1e3 * self.timing_bound_s:.3g} ms apart{trip}: at {speed:g} {unit}/s that "
            f"adds up to {adds:.2g} {unit}, {100.0 * adds / reach:.2g} % of full scale, to a hysteresis"
        )


def _between(looks: Looks, moving: BoolArray) -> float:
    """Return the interpolation error between queries while the stage moves, as a time.

    Half the queries deviate by 4 times it.
    """
    even = Looks(looks.part[::2], looks.time_s[::2], looks.bound_s[::2], looks.position[::2])
    odd = moving[: len(moving) // 2 * 2 : 2]
    way, lasted = np.abs(np.diff(looks.position))[moving].sum(), np.diff(looks.time_s)[moving].sum()
    if not (odd.any() and way > 0.0 and lasted > 0.0):
        return 0.0
    missed = looks.position[1::2][: len(odd)] - even.at(looks.time_s[1::2][: len(odd)])
    return float(0.25 * np.sqrt(np.nanmean(missed[odd] ** 2)) * lasted / way)


def _steps(part: FloatArray, position: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Return which steps (n - 1,) from query to query are known, and during which of these the stage moves."""
    steps = np.abs(np.diff(position))
    within = (np.diff(part) == 0.0) & np.isfinite(steps)
    return within, within & (steps > MOVED * reach_of(position))


def known_at_rest_alone(stage: Rows) -> bool:
    """Whether a stage did not know its position while it moved.

    Its readings are of stops, which no time error shifts.
    """
    unknown = bool(np.isnan(stage["position"]).any())
    return unknown and not _steps(stage["part"].astype(float), stage["position"])[1].any()


def reach_of(position: FloatArray) -> float:
    """Return the range from the lowest to the highest known position; 0 if none is known."""
    known = position[np.isfinite(position)]
    return float(np.ptp(known)) if len(known) else 0.0
