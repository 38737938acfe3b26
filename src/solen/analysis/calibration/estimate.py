"""Estimation of a calibration from sweeps and samples: curves, and covariance components of a reading about them.

Every sample is compared with the mean of the *other* cycles, so that its deviation is that of a reading in a new cycle.
The products of these deviations, averaged over neighbouring angles, give the covariance of such a reading. Its part
that varies from sample to sample is the noise of a reading. The remainder is constant over a cycle: it combines the
repeatability of the cycles with the error of their mean. Because it is estimated from a few cycles, readings follow a t
distribution, whose degrees of freedom combine those of the components (Satterthwaite 1946). For several prints, the
covariance of their mean curves is added, with one degree of freedom less than the number of prints.

Public names: `calibrated`, `Calibration` and `pooled`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from solen.analysis.calibration.force_smoothing import EXTENSION
from solen.analysis.calibration.training import Samples, Training, mean_curves
from solen.arrays import FloatArray, rows_of
from solen.errors import DataError

_WIDTHS = (0.05, 0.1, 0.2, 1.0)  # fractions of the range, on each side, over which products are averaged
_MIN_SAMPLES = 30.0
_MAX_CYCLES = 60  # largest number of cycles that are compared with the others
_MAX_WEIGHT = 4.0  # largest weight of an angle with a long hold, relative to the median number of samples
_MIN_VARIANCE = 1e-9  # relative to the squared range
_MIN_FREEDOM, _MAX_FREEDOM = 2.0, 1e9
_MIN_FRACTION = 1e-6  # of the noise, and of the remainder, in the total covariance


@dataclass(frozen=True, eq=False)
class Calibration:
    """Curves and covariances of a calibration; the left receiver always comes before the right receiver.

    Attributes
    ----------
    angle_deg
        Angles, ascending, (g,).
    curves_V
        Voltages, (2, g, 2); the first axis is rising, falling.
    noise, repeat, between
        Covariances in V² of the noise of a reading, of a new cycle, and of a new print, (g, 2, 2).
    samples
        Number of samples from which the covariances at each angle are estimated, (g,).
    cycles, prints
        Number of cycles and of prints.
    freedom
        Degrees of freedom of `repeat` and of `between`.
    rails_V
        Lowest and highest voltage at which samples of the left and of the right receiver were clipped, (2, 2); NaN if
        none were clipped.
    u_scale, u_line_deg
        Standard uncertainties common to all readings of the stimulus: relative, of their scale, and due to their
        non-linearity. The scatter does not show them. They are 0 if decoded values are relative to these readings.
    """

    angle_deg: FloatArray
    curves_V: FloatArray
    noise: FloatArray
    repeat: FloatArray
    between: FloatArray
    samples: FloatArray
    cycles: int
    prints: int
    freedom: tuple[int, int]
    rails_V: FloatArray
    u_scale: float = 0.0
    u_line_deg: float = 0.0

    @property
    def u_shared_deg(self) -> FloatArray:
        """Standard uncertainty at each angle common to all readings of the stimulus, (g,); zero without a load."""
        line = np.where(self.angle_deg == 0.0, 0.0, self.u_line_deg)
        return np.hypot(self.u_scale * self.angle_deg, line)

    @property
    def shared(self) -> FloatArray:
        """Covariance due to stimulus errors that are common to all readings, along the curve, (g, 2, 2)."""
        slope = self._slope
        variance = self.u_shared_deg[:, None, None] ** 2
        return np.asarray(variance * slope[:, :, None] * slope[:, None, :])

    def widened(self) -> "Calibration":
        """Extend the calibration linearly at both ends by the largest likely stimulus error, if there is one."""
        u = self.u_shared_deg
        ends = [end for end in (0, -1) if u[end] > 0.0]
        if not ends:
            return self
        indices = np.arange(self.angle_deg.size)
        order = np.concatenate([[0] * (0 in ends), indices, [-1] * (-1 in ends)]).astype(int)
        angle, curves = self.angle_deg[order].copy(), self.curves_V[:, order].copy()
        for end in ends:
            extension = EXTENSION * u[end] * (1.0 if end else -1.0)
            curves[:, end] += extension * self._slope[end]
            angle[end] += extension
        rows = {name: getattr(self, name)[order] for name in ("noise", "repeat", "between", "samples")}
        return replace(self, angle_deg=angle, curves_V=curves, **rows)

    @property
    def _slope(self) -> FloatArray:
        return np.asarray(np.gradient(self.curves_V.mean(axis=0), self.angle_deg, axis=0))

    @property
    def total(self) -> FloatArray:
        """Covariance of a new reading, (g, 2, 2)."""
        return self.noise + self.repeat + self.between

    def t_distribution(self) -> tuple[FloatArray, FloatArray]:
        """Return the scale (g, 2, 2) and degrees of freedom (g,) of the t distribution of a new reading.

        The degrees of freedom of the sum follow Satterthwaite, with the components weighted by their fractions of the
        variance of the decoded angle. Because the covariance of two variables is estimated, a prediction has one degree
        of freedom less and a larger scale (Hotelling 1931).
        """
        total = self.total + self.shared
        slope = self._slope
        weight = np.linalg.solve(total, slope[..., None])[..., 0]
        information = np.maximum((weight * slope).sum(axis=1), 1e-300)
        inverse = np.full(self.angle_deg.shape, 1.0 / _MAX_FREEDOM)
        freedoms = (self.samples, np.array(float(self.freedom[0])), np.array(float(self.freedom[1])))
        for covariance, its_freedom in zip((self.noise, self.repeat, self.between), freedoms, strict=True):
            fraction = np.einsum("gi,gij,gj->g", weight, covariance, weight) / information
            inverse += fraction**2 / np.maximum(its_freedom, 1.0)
        freedom = np.maximum(1.0 / inverse, _MIN_FREEDOM)
        return total * (freedom / (freedom - 1.0))[:, None, None], freedom - 1.0


def at_angles(grid_deg: FloatArray, curves_V: FloatArray, angle_deg: FloatArray) -> FloatArray:
    """Return curves (2, g, 2) at other angles (n,), by monotonicity-preserving interpolation (Fritsch and Carlson)."""
    return np.asarray(PchipInterpolator(grid_deg, curves_V, axis=1)(angle_deg))


def calibrated(training: Training) -> Calibration:
    """Estimate the calibration of one sensor.

    Raises
    ------
    DataError
        If there is a single cycle, or too few samples to estimate their scatter.
    """
    cycles = training.cycles
    if cycles < 2:
        raise DataError(f"sensor {training.label}", limit="has only one cycle", remedy="use at least two")
    used = np.unique(np.linspace(0, cycles - 1, min(cycles, _MAX_CYCLES)).round().astype(int))
    products, steps = [], []
    for cycle in used.tolist():
        samples = rows_of(training.samples, training.samples.cycle == cycle)
        deviation = _deviations(training, cycle, samples)
        products.append(np.column_stack([samples.angle_deg, _products(deviation)]))
        later = np.flatnonzero(samples.follows[1:]) + 1
        differences = deviation[later] - deviation[later - 1]
        steps.append(np.column_stack([samples.angle_deg[later], 0.5 * _products(differences)]))
    step_rows = np.vstack(steps)
    if len(step_rows) < _MIN_SAMPLES:
        limit = f"has only {len(step_rows)} samples in the cycles used, too few to estimate their scatter"
        raise DataError(f"sensor {training.label}", limit=limit, remedy="sample faster, or record more cycles")
    min_variance = _MIN_VARIANCE * float(np.nanmax(np.ptp(training.curves_V(), axis=1))) ** 2 * np.eye(2)
    total, count = _smooth(np.vstack(products), training.angle_deg)
    noise, remainder = _split(_smooth(step_rows, training.angle_deg)[0], total + min_variance)
    n = float(cycles)
    # a deviation from the mean of n - 1 cycles has 1 + 1/(n - 1) times a cycle's variance, from that of n 1 + 1/n times
    repeat = remainder * (n * n - 1.0) / (n * n)
    return Calibration(
        angle_deg=training.angle_deg,
        curves_V=training.curves_V(),
        noise=noise,
        repeat=_shrunk(repeat, 1.0 / (n - 1.0) ** 2),
        between=np.zeros_like(repeat),
        samples=count,
        cycles=cycles,
        prints=1,
        freedom=(cycles - 1, 0),
        rails_V=training.rails_V,
    )


def _deviations(training: Training, cycle: int, samples: Samples) -> FloatArray:
    """Return the deviations of a cycle's samples from the mean of the other cycles, (n, 2)."""
    others = mean_curves(np.delete(training.cycles_V, cycle, axis=0))
    known = np.isfinite(others).all(axis=(0, 2))
    angle = training.angle_deg[known]
    curves = at_angles(angle, others[:, known], np.clip(samples.angle_deg, angle[0], angle[-1]))
    return np.asarray(samples.volts - curves[samples.direction, np.arange(samples.angle_deg.size)])


def _products(deviation: FloatArray) -> FloatArray:
    """Return the products of the two columns of (n, 2): left·left, left·right, right·right."""
    left, right = deviation.T
    return np.column_stack([left**2, left * right, right**2])


def _smooth(rows: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean covariance about each angle, (g, 2, 2), and the effective number of samples used for it, (g,).

    Each of ``rows`` contains an angle and three products. The kernel is a triangle that is as narrow as the number of
    samples allows.
    """
    node = np.clip(np.rint((rows[:, 0] - grid[0]) / (grid[1] - grid[0])).astype(int), 0, grid.size - 1)
    count = np.bincount(node, minlength=grid.size).astype(float)
    sums = np.column_stack([np.bincount(node, column, grid.size) for column in rows[:, 1:].T])
    max_count = _MAX_WEIGHT * float(np.median(count[count > 0.0]))
    weight = np.minimum(1.0, max_count / np.maximum(count, 1.0))
    sums, count = sums * weight[:, None], count * weight
    smooth, used = np.full((grid.size, 3), np.nan), np.zeros(grid.size)
    reach = float(np.ptp(grid))
    for width in _WIDTHS:
        kernel = np.maximum(0.0, 1.0 - np.abs(grid[:, None] - grid) / (width * reach + 1e-12))
        if width == _WIDTHS[-1]:
            kernel = np.ones_like(kernel)
        total = kernel @ count
        enough = ~np.isfinite(smooth[:, 0]) & ((total >= _MIN_SAMPLES) | (width == _WIDTHS[-1]))
        smooth[enough] = (kernel @ sums)[enough] / total[enough, None]
        used[enough] = total[enough]
    return smooth[:, [0, 1, 1, 2]].reshape(-1, 2, 2), used


def _split(component: FloatArray, total: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split the total into a component, limited to the total in every direction, and the remainder, both (g, 2, 2)."""
    root = np.linalg.cholesky(total)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ component @ inverse.swapaxes(1, 2))
    axes = root @ vectors
    fraction = np.clip(values, _MIN_FRACTION, 1.0 - _MIN_FRACTION)[:, None, :]
    return (axes * fraction) @ axes.swapaxes(1, 2), (axes * (1.0 - fraction)) @ axes.swapaxes(1, 2)


def pooled(calibrations: Sequence[Calibration]) -> Calibration:
    """Pool the calibrations of several prints into one, for use with another print.

    The covariance between prints is the covariance of their mean curves.

    Raises
    ------
    DataError
        If there is a single print, or the prints have too few angles in common.
    """
    count = len(calibrations)
    if count < 2:
        limit = f"requires at least two prints, but there is {count}"
        raise DataError("pooled calibration", limit=limit, remedy="add recordings of other prints")
    grid, indices = _common([calibration.angle_deg for calibration in calibrations])
    pairs = list(zip(calibrations, indices, strict=True))
    curves = np.array([calibration.curves_V[:, index] for calibration, index in pairs])
    rails = np.array([calibration.rails_V for calibration in calibrations])
    known = np.isfinite(rails).all(axis=0)
    return Calibration(
        angle_deg=grid,
        curves_V=curves.mean(axis=0),
        noise=np.mean([calibration.noise[index] for calibration, index in pairs], axis=0),
        repeat=np.mean([calibration.repeat[index] for calibration, index in pairs], axis=0),
        between=_between(curves.mean(axis=1)) * (1.0 + 1.0 / count),
        samples=np.sum([calibration.samples[index] for calibration, index in pairs], axis=0),
        cycles=sum(calibration.cycles for calibration in calibrations),
        prints=count,
        freedom=(sum(calibration.freedom[0] for calibration in calibrations), count - 1),
        rails_V=np.where(known, np.nan_to_num(rails).mean(axis=0), np.nan),
    )


def _common(grids: Sequence[FloatArray]) -> tuple[FloatArray, list[list[int]]]:
    """Return the angles common to all grids, and their indices in each grid."""
    keys = [{round(float(angle), 9): index for index, angle in enumerate(grid)} for grid in grids]
    shared = sorted(set.intersection(*(set(key) for key in keys)))
    if len(shared) < 5:
        limit = f"have only {len(shared)} grid angles in common"
        raise DataError("the prints", limit=limit, remedy="use the same --step-deg and the same range for all of them")
    return np.array(shared), [[key[angle] for angle in shared] for key in keys]


def _between(curves: FloatArray) -> FloatArray:
    """Return the covariance (g, 2, 2) between the curves (p, g, 2) of several prints."""
    deviation = curves - curves.mean(axis=0)
    covariance = np.einsum("pgi,pgj->gij", deviation, deviation) / (len(curves) - 1)
    return _shrunk(covariance, 1.0 / (len(curves) - 1))


def _shrunk(covariance: FloatArray, weight: float) -> FloatArray:
    """Return covariances shrunk towards equal variances, because few cycles or prints determine no correlation."""
    variance = np.trace(covariance, axis1=1, axis2=2) / 2.0
    return np.asarray((1.0 - weight) * covariance + weight * variance[:, None, None] * np.eye(2))
