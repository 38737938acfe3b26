"""Estimation of a calibration from sweeps and samples: curves, and covariance components of a reading about them.

Every sample is compared with the mean of the *other* cycles, so its deviation is that of a reading in a new cycle. The
products of these deviations, averaged over neighbouring angles, are the covariance of a reading in a new cycle. The
variation from sample to sample is the noise of a reading. The remainder is constant over a cycle: it combines the cycle
repeatability and the error of the mean. It is estimated from a few cycles only, so readings follow a t distribution
whose degrees of freedom combine those of the components (Satterthwaite 1946). For several prints, the covariance of
their mean curves is added; its degrees of freedom are the number of prints minus one.

Public names: `calibrated`, `Calibration` and `pooled`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from solen.analysis.calibration.force_smoothing import OUT
from solen.analysis.calibration.training import Samples, Training, mean_curves
from solen.arrays import FloatArray, rows_of
from solen.errors import DataError

_WIDTHS = (0.05, 0.1, 0.2, 1.0)  # fraction of the range, on each side, over which products are averaged
_MIN_SAMPLES = 30.0
_MAX_CYCLES = 60  # largest number of cycles that are compared with the others
_MAX_WEIGHT = 4.0  # largest weight of an angle with a long hold, in units of the usual number of samples
_FLOOR = 1e-9  # smallest variance, relative to the squared range
_ENDLESS = 1e9
_MIN_FREEDOM = 2.0
_MIN_SHARE = 1e-6


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
        As in `Training`.
    u_scale, u_line_deg
        Standard uncertainties common to all stimulus readings: of their scale, and from their non-linearity. The
        scatter does not show them. They are 0 if the calibration is to agree with those readings.
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
        """Standard uncertainty at each angle that is common to all stimulus readings, (g,); zero without a load."""
        line = np.where(self.angle_deg == 0.0, 0.0, self.u_line_deg)
        return np.hypot(self.u_scale * self.angle_deg, line)

    @property
    def shared(self) -> FloatArray:
        """Covariance due to stimulus errors that are common to all readings, along the curve, (g, 2, 2)."""
        slope = self._slope
        variance = self.u_shared_deg[:, None, None] ** 2
        return np.asarray(variance * slope[:, :, None] * slope[:, None, :])

    def widened(self) -> "Calibration":
        """Extend the calibration linearly at both ends by the possible stimulus error, if there is one."""
        u = self.u_shared_deg[[0, -1]]
        ends = [end for end, off in zip((0, -1), u, strict=True) if off > 0.0]
        if not ends:
            return self
        places = np.arange(self.angle_deg.size)
        order = np.concatenate([[0] * (0 in ends), places, [-1] * (-1 in ends)]).astype(int)
        angle, curves = self.angle_deg[order].copy(), self.curves_V[:, order].copy()
        for end in ends:
            beyond = OUT * u[end] * (1.0 if end else -1.0)
            curves[:, end] += beyond * self._slope[end]
            angle[end] += beyond
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
        angle variance. A prediction of two variables with an estimated covariance then has one degree of freedom less
        and a larger scale (Hotelling 1931).
        """
        total = self.total + self.shared
        slope = self._slope
        toward = np.linalg.solve(total, slope[..., None])[..., 0]
        size = np.maximum((toward * slope).sum(axis=1), 1e-300)
        inverse = np.full(self.angle_deg.shape, 1.0 / _ENDLESS)
        known = (self.samples, np.array(float(self.freedom[0])), np.array(float(self.freedom[1])))
        for part, by in zip((self.noise, self.repeat, self.between), known, strict=True):
            share = np.einsum("gi,gij,gj->g", toward, part, toward) / size
            inverse += share**2 / np.maximum(by, 1.0)
        freedom = np.maximum(1.0 / inverse, _MIN_FREEDOM)
        return total * (freedom / (freedom - 1.0))[:, None, None], freedom - 1.0


def at_angles(angle_deg: FloatArray, curves_V: FloatArray, where: FloatArray) -> FloatArray:
    """Return the curves (2, g, 2) interpolated at angles (n,), monotonic between monotonic points (Fritsch and Carlson)."""
    return np.asarray(PchipInterpolator(angle_deg, curves_V, axis=1)(where))


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
    chosen = np.unique(np.linspace(0, cycles - 1, min(cycles, _MAX_CYCLES)).round().astype(int))
    products, steps = np.zeros((0, 4)), np.zeros((0, 4))
    for cycle in chosen:
        rows = rows_of(training.samples, training.samples.cycle == cycle)
        rest = _deviations(training, int(cycle), rows)
        products = np.vstack([products, np.column_stack([rows.angle_deg, _squares(rest)])])
        moved = np.flatnonzero(rows.follows[1:]) + 1
        steps = np.vstack(
            [steps, np.column_stack([rows.angle_deg[moved], 0.5 * _squares(rest[moved] - rest[moved - 1])])]
        )
    if len(steps) < _MIN_SAMPLES:
        limit = f"has only {len(steps)} samples in the cycles used, too few to estimate their scatter"
        raise DataError(f"sensor {training.label}", limit=limit, remedy="sample faster, or record more cycles")
    floor = _FLOOR * float(np.nanmax(np.ptp(training.curves_V(), axis=1))) ** 2 * np.eye(2)
    total, count = _smooth(products, training.angle_deg)
    noise, rest_of_it = _split(_smooth(steps, training.angle_deg)[0], total + floor)
    n = float(cycles)
    repeat = rest_of_it * (n * n - 1.0) / (n * n)  # the mean of the other cycles does not contain the cycle left out
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


def _deviations(training: Training, cycle: int, own: Samples) -> FloatArray:
    """Return the difference of a cycle's samples from the mean of the other cycles, (n, 2)."""
    others = mean_curves(np.delete(training.cycles_V, cycle, axis=0))
    held = np.isfinite(others).all(axis=(0, 2))
    angle = training.angle_deg[held]
    curves = at_angles(angle, others[:, held], np.clip(own.angle_deg, angle[0], angle[-1]))
    return np.asarray(own.volts - curves[own.way, np.arange(own.angle_deg.size)])


def _squares(rest: FloatArray) -> FloatArray:
    """Return the products of the two columns of (n, 2): left·left, left·right, right·right."""
    return np.column_stack([rest[:, 0] ** 2, rest[:, 0] * rest[:, 1], rest[:, 1] ** 2])


def _smooth(rows: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean covariance about each angle, (g, 2, 2), and the effective number of samples used for it, (g,).

    Each of ``rows`` contains an angle and three products. The weights are a triangle that is as narrow as the number of
    samples allows.
    """
    place = np.clip(np.rint((rows[:, 0] - grid[0]) / (grid[1] - grid[0])).astype(int), 0, grid.size - 1)
    count = np.bincount(place, minlength=grid.size).astype(float)
    sums = np.column_stack([np.bincount(place, one, grid.size) for one in rows[:, 1:].T])
    most = _MAX_WEIGHT * float(np.median(count[count > 0.0]))
    weight = np.minimum(1.0, most / np.maximum(count, 1.0))
    sums, count = sums * weight[:, None], count * weight
    smooth, used = np.full((grid.size, 3), np.nan), np.zeros(grid.size)
    reach = float(np.ptp(grid))
    for width in _WIDTHS:
        near = np.maximum(0.0, 1.0 - np.abs(grid[:, None] - grid) / (width * reach + 1e-12))
        if width == _WIDTHS[-1]:
            near = np.ones_like(near)
        total = near @ count
        enough = ~np.isfinite(smooth[:, 0]) & ((total >= _MIN_SAMPLES) | (width == _WIDTHS[-1]))
        smooth[enough] = (near @ sums)[enough] / total[enough, None]
        used[enough] = total[enough]
    return smooth[:, [0, 1, 1, 2]].reshape(-1, 2, 2), used


def _split(part: FloatArray, whole: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Split the total into a component, limited to the total in every direction, and the remainder, both (g, 2, 2)."""
    root = np.linalg.cholesky(whole)
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ part @ inverse.swapaxes(1, 2))
    axes = root @ vectors
    share = np.clip(values, _MIN_SHARE, 1.0 - _MIN_SHARE)[:, None, :]
    return (axes * share) @ axes.swapaxes(1, 2), (axes * (1.0 - share)) @ axes.swapaxes(1, 2)


def pooled(ones: Sequence[Calibration]) -> Calibration:
    """Pool the calibrations of several prints into one, for use with another print.

    The covariance between prints is the covariance of their mean curves.

    Raises
    ------
    DataError
        If there is a single print, or the prints have too few angles in common.
    """
    if len(ones) < 2:
        raise DataError("pooled calibration", value=len(ones), limit="requires at least two prints")
    grid, places = _common([one.angle_deg for one in ones])
    curves = np.array([one.curves_V[:, place] for one, place in zip(ones, places, strict=True)])
    noise, repeat = (
        np.mean([getattr(one, name)[place] for one, place in zip(ones, places, strict=True)], axis=0)
        for name in ("noise", "repeat")
    )
    rails = np.array([one.rails_V for one in ones])
    known = np.isfinite(rails).all(axis=0)
    return Calibration(
        angle_deg=grid,
        curves_V=curves.mean(axis=0),
        noise=noise,
        repeat=repeat,
        between=_between(curves.mean(axis=1)) * (1.0 + 1.0 / len(ones)),
        samples=np.sum([one.samples[place] for one, place in zip(ones, places, strict=True)], axis=0),
        cycles=sum(one.cycles for one in ones),
        prints=len(ones),
        freedom=(sum(one.freedom[0] for one in ones), len(ones) - 1),
        rails_V=np.where(known, np.nan_to_num(rails).mean(axis=0), np.nan),
    )


def _common(grids: Sequence[FloatArray]) -> tuple[FloatArray, list[list[int]]]:
    """Return the angles common to all grids, and their indices in each grid."""
    keys = [{round(float(angle), 9): place for place, angle in enumerate(grid)} for grid in grids]
    shared = sorted(set.intersection(*(set(key) for key in keys)))
    if len(shared) < 5:
        limit = f"have only {len(shared)} grid angles in common"
        raise DataError("the prints", limit=limit, remedy="use the same --step-deg and the same range for all of them")
    return np.array(shared), [[key[angle] for angle in shared] for key in keys]


def _between(curves: FloatArray) -> FloatArray:
    """Return the covariance (g, 2, 2) between the curves (p, g, 2) of several prints."""
    apart = curves - curves.mean(axis=0)
    found = np.einsum("pgi,pgj->gij", apart, apart) / (len(curves) - 1)
    return _shrunk(found, 1.0 / (len(curves) - 1))


def _shrunk(covariance: FloatArray, share: float) -> FloatArray:
    """Return the covariances shrunk towards equal variances, because a few cycles or prints hardly determine a correlation."""
    level = np.trace(covariance, axis1=1, axis2=2) / 2.0
    return np.asarray((1.0 - share) * covariance + share * level[:, None, None] * np.eye(2))
