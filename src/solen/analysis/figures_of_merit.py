"""Figures of merit of a response, as in the datasheets of sensors, each with its definition.

They are computed from the half-cycles on the angle grid, with one value per cycle where possible; the uncertainty of a
figure is then the standard deviation of these values divided by the square root of their number. It applies to the one
sensor that was measured: the cycles do not show the variation between prints. The definitions are those for process
instruments (ANSI/ISA-51.1): independent linearity is the largest deviation from the straight line that minimises this
deviation, and hysteresis is the largest difference between the directions. Full scale is the range of the mean curve.

Public names: `receiver_response`, `swing`, `line_slopes` and `line_fit`.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.analysis.response import Curve, Passes, mean_curve
from solen.arrays import BoolArray, FloatArray, flag_runs
from solen.plane import deviation_from_line
from solen.recording.stimulus import NEAR_ZERO_DEG

_END = 0.1  # fraction of the range: ends that give the swing, and window that gives the hysteresis
_MIN_POINTS = 3
_ROUNDING = 1e-9  # noise below this fraction of full scale is rounding error


class Estimate(NamedTuple):
    """A value and its standard uncertainty; NaN if undefined."""

    value: float
    u: float

    @property
    def resolved(self) -> bool:
        """Whether the value differs from 0 by more than three standard uncertainties."""
        return math.isfinite(self.value) and not abs(self.value) <= 3.0 * self.u


_UNKNOWN = Estimate(math.nan, math.nan)


class ReceiverResponse(Curve):
    """Response of a receiver and its figures of merit; NaN for undefined values.

    Attributes
    ----------
    angle_deg
        Angles of the curves, (g,).
    rising, falling
        Mean curve in each direction.
    range_V, u_range_V
        Full scale: the largest minus the smallest value of the mean curve, which noise increases.
    swing_V, u_swing_V
        Mean over the upper tenth of the angles minus mean over the lower tenth; signed.
    sensitivity_V_per_deg, u_sensitivity_V_per_deg
        Slope of the least-squares line over all angles.
    sensitivity_near_zero_V_per_deg, u_sensitivity_near_zero_V_per_deg
        Slope near 0, within `SensorResponse.near_zero_deg`.
    independent_linearity_percent
        Largest deviation of the mean curve from the line that minimises this deviation, relative to full scale.
    linearity_percent
        Largest deviation from the least-squares line, relative to full scale.
    hysteresis_V, u_hysteresis_V, hysteresis_percent
        Largest difference of the directions, averaged over a tenth of the range; also in per cent of full scale.
    hysteresis_angle_deg
        Midpoint of that tenth.
    hysteresis_point_V
        Largest difference at a single angle, which noise increases.
    mean_hysteresis_V, u_mean_hysteresis_V
        Mean of rising minus falling over all angles; signed.
    repeatability_V, repeatability_percent
        Standard deviation over cycles at the same angle and in the same direction, pooled.
    drift_V_per_min, u_drift_V_per_min, drift_V_per_cycle, u_drift_V_per_cycle
        Slope of the mean levels of the cycles, against time and against the cycle number.
    noise_V
        Standard deviation of a reading.
    snr, snr_dB
        Ratio of the range to the noise.
    resolution_deg, resolution_near_zero_deg
        Ratio of the noise to the sensitivity.
    clipped_samples
        Number of clipped samples.
    clipped_angles_deg
        First and last angle of each interval in which a half-cycle is clipped, so that there is no mean.
    """

    angle_deg: FloatArray
    rising: Curve
    falling: Curve
    range_V: float
    u_range_V: float
    swing_V: float
    u_swing_V: float
    sensitivity_V_per_deg: float
    u_sensitivity_V_per_deg: float
    sensitivity_near_zero_V_per_deg: float
    u_sensitivity_near_zero_V_per_deg: float
    independent_linearity_percent: float
    linearity_percent: float
    hysteresis_V: float
    u_hysteresis_V: float
    hysteresis_percent: float
    hysteresis_angle_deg: float
    hysteresis_point_V: float
    mean_hysteresis_V: float
    u_mean_hysteresis_V: float
    repeatability_V: float
    repeatability_percent: float
    drift_V_per_min: float
    u_drift_V_per_min: float
    drift_V_per_cycle: float
    u_drift_V_per_cycle: float
    noise_V: float
    snr: float
    snr_dB: float
    resolution_deg: float
    resolution_near_zero_deg: float
    clipped_samples: int
    clipped_angles_deg: tuple[tuple[float, float], ...]


def over_cycles(values: FloatArray) -> Estimate:
    """Return the mean of one value per cycle, and its uncertainty from their scatter; NaN for a single cycle."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return _UNKNOWN
    u = float(np.std(finite, ddof=1) / math.sqrt(finite.size)) if finite.size > 1 else math.nan
    return Estimate(float(finite.mean()), u)


def receiver_response(
    passes: Passes, noise_V: float, clipped_samples: int = 0, near_zero: float = NEAR_ZERO_DEG
) -> ReceiverResponse:
    """Compute the curves and figures of merit of a receiver.

    Parameters
    ----------
    passes
        Half-cycles of the receiver; the last axis has length 1.
    noise_V
        Standard deviation of a single reading.
    clipped_samples
        Number of clipped samples.
    near_zero
        Half-width of the range about 0 in which the sensitivity near zero is computed.
    """
    volts, angle = np.where(passes.clipped, np.nan, passes.volts)[..., 0], passes.angle_deg
    both, rising, falling = (mean_curve(passes, direction) for direction in (None, 0, 1))
    cycles = volts.mean(axis=1)  # NaN if an angle is missing in one direction, because the other alone would be biased
    scale = _range(both.mean_V)
    percent = 100.0 / scale if scale > 0.0 else math.nan
    near = line_slopes(angle, cycles, np.abs(angle) <= near_zero + 1e-9)
    slope = line_slopes(angle, cycles, np.isfinite(both.mean_V))
    level_V = levels(cycles)
    independent, about_line = _linearity(angle, both.mean_V)
    hysteresis, hysteresis_deg, point_V, mean_hysteresis = hysteresis_of(angle, volts[:, 0] - volts[:, 1])
    repeatability = _repeatability(volts)
    drift, by_cycle = line_fit(passes.middle_s / 60.0, level_V), line_fit(np.arange(float(level_V.size)), level_V)
    swing_V = swing(angle, cycles)
    noise_V = noise_V if noise_V > _ROUNDING * scale else 0.0
    snr = scale / noise_V if noise_V > 0.0 else math.nan
    return ReceiverResponse(
        **vars(both),
        angle_deg=angle,
        rising=rising,
        falling=falling,
        range_V=scale,
        u_range_V=_u_of_range(both),
        swing_V=swing_V.value,
        u_swing_V=swing_V.u,
        sensitivity_V_per_deg=slope.value,
        u_sensitivity_V_per_deg=slope.u,
        sensitivity_near_zero_V_per_deg=near.value,
        u_sensitivity_near_zero_V_per_deg=near.u,
        independent_linearity_percent=percent * independent,
        linearity_percent=percent * about_line,
        hysteresis_V=hysteresis.value,
        u_hysteresis_V=hysteresis.u,
        hysteresis_percent=percent * hysteresis.value,
        hysteresis_angle_deg=hysteresis_deg,
        hysteresis_point_V=point_V,
        mean_hysteresis_V=mean_hysteresis.value,
        u_mean_hysteresis_V=mean_hysteresis.u,
        repeatability_V=repeatability,
        repeatability_percent=percent * repeatability,
        drift_V_per_min=drift.value,
        u_drift_V_per_min=drift.u,
        drift_V_per_cycle=by_cycle.value,
        u_drift_V_per_cycle=by_cycle.u,
        noise_V=noise_V,
        snr=snr,
        snr_dB=20.0 * math.log10(snr) if snr > 0.0 else math.nan,
        resolution_deg=_resolution(noise_V, slope),
        resolution_near_zero_deg=_resolution(noise_V, near),
        clipped_samples=clipped_samples,
        clipped_angles_deg=_hidden_intervals(angle, np.asarray(passes.clipped[..., 0].any(axis=(0, 1)))),
    )


def _hidden_intervals(angle_deg: FloatArray, hidden: BoolArray) -> tuple[tuple[float, float], ...]:
    """Return the first and last angle of each hidden interval."""
    return tuple((float(angle_deg[first]), float(angle_deg[stop - 1])) for first, stop in flag_runs(hidden))


def levels(cycles: FloatArray) -> FloatArray:
    """Return the mean level of each cycle over the angles common to all cycles, (cycles,)."""
    common = np.isfinite(cycles).all(axis=0)
    return cycles[:, common].mean(axis=1) if common.any() else np.full(len(cycles), np.nan)


def _range(mean: FloatArray) -> float:
    finite = mean[np.isfinite(mean)]
    return float(np.ptp(finite)) if finite.size else math.nan


def _u_of_range(curve: Curve) -> float:
    """Return the uncertainty of the largest mean minus the smallest mean."""
    if not np.isfinite(curve.mean_V).any():
        return math.nan
    extremes = [int(np.nanargmax(curve.mean_V)), int(np.nanargmin(curve.mean_V))]
    return float(np.sqrt(sum(curve.sd_V[index] ** 2 / curve.ways[index] for index in extremes)))


def swing(angle_deg: FloatArray, cycle_V: FloatArray) -> Estimate:
    """Return the voltage at the largest minus that at the smallest angles, each averaged over a tenth of the range.

    Unlike the range, the swing is not increased by noise, and it has a sign.
    """
    reach = float(np.ptp(angle_deg))
    upper = cycle_V[:, angle_deg >= angle_deg[-1] - _END * reach - 1e-9]
    lower = cycle_V[:, angle_deg <= angle_deg[0] + _END * reach + 1e-9]
    with np.errstate(invalid="ignore"):
        return over_cycles(_finite_mean(upper) - _finite_mean(lower))


def _finite_mean(values: FloatArray) -> FloatArray:
    count = np.isfinite(values).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.nansum(values, axis=1) / np.where(count > 0, count, np.nan))


def line_slopes(angle_deg: FloatArray, cycle_V: FloatArray, where: BoolArray) -> Estimate:
    """Return the slope of the least-squares line of each cycle over the specified angles."""
    return over_cycles(np.array([_slope(angle_deg, row, where) for row in cycle_V]))


def _slope(angle_deg: FloatArray, row: FloatArray, where: BoolArray) -> float:
    used = where & np.isfinite(row)
    if used.sum() < _MIN_POINTS:
        return math.nan
    weights = _weights(angle_deg[used])
    x = angle_deg[used] - weights @ angle_deg[used]
    return float((weights * x) @ row[used] / ((weights * x) @ x))


def _weights(angle_deg: FloatArray) -> FloatArray:
    """Return the weight of each grid point: half at both ends, where its cell extends to one side only."""
    weights = np.ones(angle_deg.size)
    weights[[0, -1]] = 0.5
    return np.asarray(weights / weights.sum())


def _linearity(angle_deg: FloatArray, mean: FloatArray) -> tuple[float, float]:
    """Return the largest deviation in V of a curve from the best line for it, and from the least-squares line."""
    finite = np.isfinite(mean)
    x, y = angle_deg[finite], mean[finite]
    if x.size < _MIN_POINTS:
        return math.nan, math.nan
    slope = _slope(x, y, np.ones(x.size, dtype=bool))
    weights = _weights(x)
    residual = y - weights @ y - slope * (x - weights @ x)
    return deviation_from_line(x, y), float(np.abs(residual).max())


def hysteresis_of(angle_deg: FloatArray, difference: FloatArray) -> tuple[Estimate, float, float, Estimate]:
    """Return the figures of hysteresis from the differences, rising minus falling, of all cycles (cycles, g).

    They are the largest absolute mean over a tenth of the range and the midpoint of that tenth, the largest mean at a
    single grid point, and the mean over all grid points. The largest of many noisy differences at single points is
    mostly noise; it is therefore reported separately.
    """
    known = np.isfinite(difference).all(axis=0)
    if not known.any():
        return _UNKNOWN, math.nan, math.nan, _UNKNOWN
    angles, kept = angle_deg[known], difference[:, known]
    width = min(max(1, round(_END * angle_deg.size)), angles.size)
    local = _window_means(kept, width)
    window = int(np.argmax(np.abs(local.mean(axis=0))))
    largest = Estimate(abs(float(local[:, window].mean())), _pooled_u(local))
    middle = float(_window_means(angles[None, :], width)[0, window])
    return largest, middle, float(np.abs(kept.mean(axis=0)).max()), over_cycles(kept.mean(axis=1))


def _pooled_u(rows: FloatArray) -> float:
    """Return the uncertainty of a mean over cycles (rows), pooled over columns, because there are only a few cycles."""
    return math.sqrt(float(rows.var(axis=0, ddof=1).mean()) / len(rows)) if len(rows) > 1 else math.nan


def _window_means(rows: FloatArray, width: int) -> FloatArray:
    """Return the mean of each row over every window with this number of columns."""
    total = np.cumsum(np.pad(rows, ((0, 0), (1, 0))), axis=1)
    return np.asarray((total[:, width:] - total[:, :-width]) / width)


def _repeatability(volts: FloatArray) -> float:
    """Return the standard deviation over cycles at the same angle and direction, pooled over angles and directions."""
    if volts.shape[0] < 2:
        return math.nan
    variance = volts.var(axis=0, ddof=1)
    finite = variance[np.isfinite(variance)]
    return math.sqrt(float(finite.mean())) if finite.size else math.nan


def line_fit(x: FloatArray, y: FloatArray) -> Estimate:
    """Return the slope of a least-squares line with its standard uncertainty (n − 2 degrees of freedom)."""
    if x.size < _MIN_POINTS or not np.isfinite(y).all():
        return _UNKNOWN
    centred = x - x.mean()
    squares = float(centred @ centred)
    slope = float(centred @ y) / squares
    residual = y - y.mean() - slope * centred
    return Estimate(slope, math.sqrt(float(residual @ residual) / (x.size - 2) / squares))


def _resolution(noise_V: float, slope: Estimate) -> float:
    """Return the angle equivalent to one standard deviation of a reading, or NaN if the slope is not resolved."""
    return noise_V / abs(slope.value) if slope.resolved and slope.value else math.nan
