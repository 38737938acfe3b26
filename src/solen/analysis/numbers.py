"""Numbers of a response: what a sensor's maker quotes, each with its definition.

The idea: everything is taken from the ways over the grid, one number for each cycle wherever that can be, so that the
cycles' own scatter gives the uncertainty: standard deviation over cycles, divided by the root of their number. These
are descriptions of one sensor; cycles are no replicates of a print. Definitions follow the vocabulary of process
instruments (ANSI/ISA-51.1): independent linearity is the largest deviation from the straight line for which that is
least; hysteresis the largest difference of both directions. Full scale is the range of the mean curve.

The interface: `receiver_numbers` of a receiver's passes; `swing`, `drift` and `line_fit` on their own.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from solen.analysis.response import Passes, curve
from solen.arrays import FloatArray

NEAR_ZERO_DEG = 0.5
"""Angles about 0 over which the sensitivity near zero is taken."""
_END = 0.1  # share of the range at each end whose mean is the swing's level
_LEAST_POINTS = 3
_ROUNDING = 1e-9  # of full scale: what is smaller is not noise


@dataclass(frozen=True)
class Estimate:
    """A value and its standard uncertainty; NaN where there is none."""

    value: float
    u: float

    @property
    def resolved(self) -> bool:
        """Whether it differs from 0 by more than three uncertainties."""
        return math.isfinite(self.value) and not abs(self.value) <= 3.0 * self.u


def over_cycles(values: FloatArray) -> Estimate:
    """Mean of one number a cycle and its uncertainty by their scatter; without one for a single cycle."""
    held = values[np.isfinite(values)]
    if not held.size:
        return Estimate(math.nan, math.nan)
    u = float(np.std(held, ddof=1) / math.sqrt(held.size)) if held.size > 1 else math.nan
    return Estimate(float(held.mean()), u)


def receiver_numbers(found: Passes, noise_V: float) -> dict[str, Any]:
    """Numbers of one receiver.

    Parameters
    ----------
    found
        Its passes: the last axis has one entry.
    noise_V
        Standard deviation of a single reading.

    Returns
    -------
    dict
        NaN where a number cannot be had.
    """
    volts, clipped = np.where(found.clipped, np.nan, found.volts)[..., 0], found.clipped[..., 0]
    angle = found.angle_deg
    whole = curve(found.volts[..., 0].reshape(-1, angle.size), clipped.reshape(-1, angle.size))
    scale = _reach(whole.mean_V)
    cycle = _mean(volts, 1)
    zero = line_slopes(angle, cycle, np.abs(angle) <= NEAR_ZERO_DEG + 1e-9)
    full = line_slopes(angle, cycle, np.isfinite(whole.mean_V))
    return {
        "range_V": scale,
        "u_range_V": _u_of_range(whole.mean_V, whole.sd_V, whole.count),
        **_named("swing_V", swing(angle, cycle)),
        **_named("sensitivity_V_per_deg", full),
        **_named("sensitivity_near_zero_V_per_deg", zero),
        **_linearity(angle, whole.mean_V, scale),
        **_hysteresis(angle, volts, scale),
        **_repeatability(volts, scale),
        **_drift(found.middle_s, cycle),
        **_noise_numbers(noise_V, scale, full, zero),
    }


def _named(name: str, found: Estimate) -> dict[str, float]:
    return {name: found.value, f"u_{name}": found.u}


def _mean(values: FloatArray, axis: int) -> FloatArray:
    """Mean over an axis of what there is; NaN where one is missing would bias, so all must be there."""
    return np.asarray(values.mean(axis=axis))


def _reach(mean: FloatArray) -> float:
    held = mean[np.isfinite(mean)]
    return float(np.ptp(held)) if held.size else math.nan


def _u_of_range(mean: FloatArray, sd: FloatArray, count: FloatArray | Any) -> float:
    """Uncertainty of the largest mean less the smallest."""
    if not np.isfinite(mean).any():
        return math.nan
    places = [int(np.nanargmax(mean)), int(np.nanargmin(mean))]
    return float(np.sqrt(sum(sd[place] ** 2 / count[place] for place in places)))


def swing(angle_deg: FloatArray, cycle_V: FloatArray) -> Estimate:
    """Voltage at the upper end of the angles less that at the lower: means over the outer tenth of each cycle.

    Unlike the range it does not grow with noise, and it has a sign.
    """
    reach = float(np.ptp(angle_deg))
    upper = cycle_V[:, angle_deg >= angle_deg[-1] - _END * reach - 1e-9]
    lower = cycle_V[:, angle_deg <= angle_deg[0] + _END * reach + 1e-9]
    with np.errstate(invalid="ignore"):
        return over_cycles(_held_mean(upper) - _held_mean(lower))


def _held_mean(values: FloatArray) -> FloatArray:
    count = np.isfinite(values).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nansum(values, axis=1) / np.where(count > 0, count, np.nan))


def line_slopes(angle_deg: FloatArray, cycle_V: FloatArray, where: FloatArray | Any) -> Estimate:
    """Slope of the least-squares line of each cycle over some angles."""
    return over_cycles(np.array([_slope(angle_deg, row, where) for row in cycle_V]))


def _slope(angle_deg: FloatArray, row: FloatArray, where: FloatArray | Any) -> float:
    held = where & np.isfinite(row)
    if held.sum() < _LEAST_POINTS:
        return math.nan
    x = angle_deg[held] - angle_deg[held].mean()
    return float(x @ row[held] / (x @ x))


def _linearity(angle_deg: FloatArray, mean: FloatArray, scale: float) -> dict[str, float]:
    """Largest deviation of the mean curve from straight lines, in per cent of full scale."""
    held = np.isfinite(mean)
    x, y = angle_deg[held], mean[held]
    if x.size < _LEAST_POINTS or not scale > 0.0:
        return {"independent_linearity_percent_fs": math.nan, "linearity_percent_fs": math.nan}
    slope = _slope(x, y, np.ones(x.size, dtype=bool))
    apart = y - y.mean() - slope * (x - x.mean())
    return {
        "independent_linearity_percent_fs": 100.0 * _least_deviation(x, y) / scale,
        "linearity_percent_fs": 100.0 * float(np.abs(apart).max()) / scale,
    }


def _least_deviation(x: FloatArray, y: FloatArray) -> float:
    """Half the least height of a band of straight lines about points: one of its sides lies on the convex hull."""
    upper, lower = _chain(x, y, 1.0), _chain(x, y, -1.0)
    heights = [
        float(np.ptp(y - (y[b] - y[a]) / (x[b] - x[a]) * x)) for chain in (upper, lower) for a, b in pairwise(chain)
    ]
    return 0.5 * min(heights)


def _chain(x: FloatArray, y: FloatArray, side: float) -> list[int]:
    """Upper (1) or lower (−1) side of the convex hull, from left to right."""
    found: list[int] = []
    for place in range(x.size):
        while len(found) > 1:
            a, b = found[-2], found[-1]
            turn = (x[b] - x[a]) * (y[place] - y[a]) - (y[b] - y[a]) * (x[place] - x[a])
            if side * turn < 0.0:
                break
            found.pop()
        found.append(place)
    return found


def _hysteresis(angle_deg: FloatArray, volts: FloatArray, scale: float) -> dict[str, float]:
    """Rising less falling at one angle: largest of its means over a tenth of the range, and mean over all angles.

    At a single point of the grid the largest of many noisy differences is mostly noise; that value is given apart.
    """
    apart = volts[:, 0] - volts[:, 1]
    held = np.isfinite(apart).all(axis=0)
    names = ("hysteresis_V", "u_hysteresis_V", "hysteresis_angle_deg", "hysteresis_percent_fs", "hysteresis_point_V")
    if not held.any():
        return dict.fromkeys((*names, "mean_hysteresis_V", "u_mean_hysteresis_V"), math.nan)
    angles, kept = angle_deg[held], apart[:, held]
    width = max(1, round(_END * angle_deg.size))
    local = _windows(kept, min(width, angles.size))
    place = int(np.argmax(np.abs(local.mean(axis=0))))
    largest = abs(float(local[:, place].mean()))
    values = (
        largest,
        _pooled_u(local),
        float(_windows(angles[None, :], min(width, angles.size))[0, place]),
        100.0 * largest / scale if scale > 0.0 else math.nan,
        float(np.abs(kept.mean(axis=0)).max()),
    )
    return {**dict(zip(names, values, strict=True)), **_named("mean_hysteresis_V", over_cycles(kept.mean(axis=1)))}


def _pooled_u(rows: FloatArray) -> float:
    """Uncertainty of a mean over rows, one for all columns: that of a single one is known by a few cycles only."""
    return math.sqrt(float(rows.var(axis=0, ddof=1).mean()) / len(rows)) if len(rows) > 1 else math.nan


def _windows(rows: FloatArray, width: int) -> FloatArray:
    """Mean of each row over every stretch of so many columns."""
    total = np.cumsum(np.pad(rows, ((0, 0), (1, 0))), axis=1)
    return np.asarray((total[:, width:] - total[:, :-width]) / width)


def _repeatability(volts: FloatArray, scale: float) -> dict[str, float]:
    """Standard deviation over cycles at one angle and in one direction, pooled over both."""
    if volts.shape[0] < 2:
        return {"repeatability_sd_V": math.nan, "repeatability_percent_fs": math.nan}
    variance = volts.var(axis=0, ddof=1)
    held = variance[np.isfinite(variance)]
    sd = math.sqrt(float(held.mean())) if held.size else math.nan
    return {"repeatability_sd_V": sd, "repeatability_percent_fs": 100.0 * sd / scale if scale > 0.0 else math.nan}


def _drift(middle_s: FloatArray, cycle: FloatArray) -> dict[str, float]:
    """Slope of the cycles' mean levels over time and over their number."""
    common = np.isfinite(cycle).all(axis=0)
    level = cycle[:, common].mean(axis=1) if common.any() else np.full(len(cycle), np.nan)
    by_minute = line_fit(middle_s / 60.0, level)
    by_cycle = line_fit(np.arange(len(level), dtype=np.float64), level)
    return {**_named("drift_V_per_min", by_minute), **_named("drift_V_per_cycle", by_cycle)}


def line_fit(x: FloatArray, y: FloatArray) -> Estimate:
    """Slope of a straight line by least squares, with its standard uncertainty from the residuals (n − 2)."""
    if x.size < _LEAST_POINTS or not np.isfinite(y).all():
        return Estimate(math.nan, math.nan)
    away = x - x.mean()
    slope = float(away @ y / (away @ away))
    rest = y - y.mean() - slope * away
    return Estimate(slope, math.sqrt(float(rest @ rest) / (x.size - 2) / float(away @ away)))


def _noise_numbers(noise_V: float, scale: float, full: Estimate, zero: Estimate) -> dict[str, float]:
    noise_V = noise_V if noise_V > _ROUNDING * scale else 0.0
    ratio = scale / noise_V if noise_V > 0.0 else math.nan
    return {
        "noise_V": noise_V,
        "snr": ratio,
        "snr_dB": 20.0 * math.log10(ratio) if ratio > 0.0 else math.nan,
        "resolution_deg": _per(noise_V, full),
        "resolution_near_zero_deg": _per(noise_V, zero),
    }


def _per(noise_V: float, slope: Estimate) -> float:
    """Angle that one standard deviation of a reading stands for; none where the slope is not resolved."""
    return noise_V / abs(slope.value) if slope.resolved and slope.value else math.nan
