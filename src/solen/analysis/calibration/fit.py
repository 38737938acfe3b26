"""A calibration of ways and samples: curves, and the covariance of a reading about them with its parts.

The idea: every sample is held against the mean of the *other* cycles, so that its distance is that of a reading of a new
cycle. The mean of these distances' products, over neighbouring angles, is the covariance of a reading that has not been
seen. What changes from sample to sample is the noise of a reading; the rest stays for a cycle: how cycles repeat, and
the error of the mean. That rest is known by a few cycles only, so readings follow a t distribution whose degrees of
freedom are those of the parts by their shares (Satterthwaite 1946). Of several prints, the scatter of their mean curves
comes on top, with as many degrees of freedom as prints less one.

The interface: `calibrated` of one `Training`, `pooled` of several, both a `Calibration`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from solen.analysis.calibration.training import Samples, Training, mean_curves
from solen.errors import DataError
from solen.recording.model import FloatArray

_WIDTHS = (0.05, 0.1, 0.2, 1.0)  # of the range, to each side, over which products are averaged
_LEAST_SAMPLES = 30.0
_MOST_CYCLES = 60  # whose samples are held against the others
_HELD = 4.0  # times the usual number of samples that an angle counts for, however long it is held
_FLOOR = 1e-9  # of the squared range: no reading is better known
_ENDLESS = 1e9


@dataclass(frozen=True)
class Calibration:
    """Curves and covariances, left before right everywhere.

    Attributes
    ----------
    angle_deg
        (g,), ascending.
    curves_V
        (2, g, 2): rising, falling.
    noise, repeat, between
        Covariances in V² of the noise of a reading, of a new cycle, and of a new print, (g, 2, 2).
    samples
        Samples that the covariances at each angle rest on, (g,).
    cycles, prints
        How many there were.
    freedom
        Degrees of freedom of `repeat` and of `between`.
    rails_V
        As in `Training`.
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

    @property
    def total(self) -> FloatArray:
        """Covariance of a new reading, (g, 2, 2)."""
        return self.noise + self.repeat + self.between

    def total_freedom(self) -> FloatArray:
        """Degrees of freedom of `total`, (g,)."""
        precision = np.linalg.inv(self.total)
        shares = [np.einsum("gij,gji->g", precision, part) / 2.0 for part in (self.noise, self.repeat, self.between)]
        known = [self.samples, np.full(self.samples.shape, float(self.freedom[0]))]
        known.append(np.full(self.samples.shape, float(self.freedom[1])))
        inverse = sum(
            np.where(share > 0.0, share**2 / np.maximum(by, 1.0), 0.0) for share, by in zip(shares, known, strict=True)
        )
        return np.asarray(np.minimum(1.0 / np.maximum(inverse, 1.0 / _ENDLESS), _ENDLESS))

    def hysteresis_V(self) -> FloatArray:
        """Rising less falling, (g, 2)."""
        return np.asarray(self.curves_V[0] - self.curves_V[1])


def at_angles(angle_deg: FloatArray, curves_V: FloatArray, where: FloatArray) -> FloatArray:
    """Curves (2, g, 2) at other angles (n,), (2, n, 2): monotone wherever their points are (Fritsch and Carlson)."""
    return np.asarray(PchipInterpolator(angle_deg, curves_V, axis=1)(where))


def calibrated(training: Training) -> Calibration:
    """Calibration of one sensor.

    Raises
    ------
    DataError
        With a single cycle, or with too few samples to know how they scatter.
    """
    cycles = training.cycles
    if cycles < 2:
        raise DataError(f"sensor {training.label}", limit="has a single cycle", remedy="use at least two")
    chosen = np.unique(np.linspace(0, cycles - 1, min(cycles, _MOST_CYCLES)).round().astype(int))
    products, steps = np.zeros((0, 4)), np.zeros((0, 4))
    for cycle in chosen:
        own = training.samples.part(training.samples.cycle == cycle)
        rest = _apart(training, int(cycle), own)
        products = np.vstack([products, np.column_stack([own.angle_deg, _squares(rest)])])
        moved = np.flatnonzero(own.follows[1:]) + 1
        steps = np.vstack([steps, np.column_stack([own.angle_deg[moved], 0.5 * _squares(rest[moved] - rest[moved - 1])])])
    if len(steps) < _LEAST_SAMPLES:
        limit = f"has {len(steps)} samples in the cycles that are used, too few to know how they scatter"
        raise DataError(f"sensor {training.label}", limit=limit, remedy="sample faster, or record more cycles")
    floor = _FLOOR * float(np.nanmax(np.ptp(training.curves_V(), axis=1))) ** 2 * np.eye(2)
    total, count = _smooth(products, training.angle_deg)
    noise, _ = _smooth(steps, training.angle_deg)
    n = float(cycles)
    repeat = _positive(total - noise) * (n * n - 1.0) / (n * n)  # left out, a cycle lacks its share in the mean
    return Calibration(
        angle_deg=training.angle_deg,
        curves_V=training.curves_V(),
        noise=noise + floor,
        repeat=repeat,
        between=np.zeros_like(repeat),
        samples=count,
        cycles=cycles,
        prints=1,
        freedom=(cycles - 1, 0),
        rails_V=training.rails_V,
    )


def _apart(training: Training, cycle: int, own: Samples) -> FloatArray:
    """Distance of a cycle's samples from the mean of the others, (n, 2)."""
    others = mean_curves(np.delete(training.cycles_V, cycle, axis=0))
    held = np.isfinite(others).all(axis=(0, 2))
    angle = training.angle_deg[held]
    curves = at_angles(angle, others[:, held], np.clip(own.angle_deg, angle[0], angle[-1]))
    return np.asarray(own.volts - curves[own.way, np.arange(own.angle_deg.size)])


def _squares(rest: FloatArray) -> FloatArray:
    """Products of (n, 2): left with left, left with right, right with right."""
    return np.column_stack([rest[:, 0] ** 2, rest[:, 0] * rest[:, 1], rest[:, 1] ** 2])


def _smooth(rows: FloatArray, grid: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean covariance about each angle, (g, 2, 2), and how many samples it rests on, (g,).

    ``rows`` are an angle and three products. The mean is weighted by a triangle as narrow as samples allow.
    """
    place = np.clip(np.rint((rows[:, 0] - grid[0]) / (grid[1] - grid[0])).astype(int), 0, grid.size - 1)
    count = np.bincount(place, minlength=grid.size).astype(float)
    sums = np.column_stack([np.bincount(place, one, grid.size) for one in rows[:, 1:].T])
    most = _HELD * float(np.median(count[count > 0.0]))
    weight = np.minimum(1.0, most / np.maximum(count, 1.0))
    sums, count = sums * weight[:, None], count * weight
    found, used = np.full((grid.size, 3), np.nan), np.zeros(grid.size)
    reach = float(np.ptp(grid))
    for width in _WIDTHS:
        near = np.maximum(0.0, 1.0 - np.abs(grid[:, None] - grid) / (width * reach + 1e-12))
        if width == _WIDTHS[-1]:
            near = np.ones_like(near)
        total = near @ count
        enough = ~np.isfinite(found[:, 0]) & ((total >= _LEAST_SAMPLES) | (width == _WIDTHS[-1]))
        found[enough] = (near @ sums)[enough] / total[enough, None]
        used[enough] = total[enough]
    return found[:, [0, 1, 1, 2]].reshape(-1, 2, 2), used


def _positive(matrices: FloatArray) -> FloatArray:
    """Nearest matrices without a negative variance."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray(np.einsum("gij,gj,gkj->gik", vectors, np.maximum(values, 0.0), vectors))


def pooled(trainings: Sequence[Training]) -> Calibration:
    """One calibration of several prints, for a print that is not among them.

    Raises
    ------
    DataError
        With a single print, or where their angles have too little in common.
    """
    if len(trainings) < 2:
        raise DataError("pooled calibration", value=len(trainings), limit="needs at least two prints")
    return mean_of([calibrated(one) for one in trainings])


def mean_of(ones: Sequence[Calibration]) -> Calibration:
    """Pooled calibration of those of several prints; the scatter of prints is that of their mean curves."""
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
    """Angles that all grids hold, and their places in each."""
    keys = [{round(float(angle), 9): place for place, angle in enumerate(grid)} for grid in grids]
    shared = sorted(set.intersection(*(set(one) for one in keys)))
    if len(shared) < 5:
        limit = f"have {len(shared)} angles of their grids in common"
        raise DataError("the prints", limit=limit, remedy="give all the same --step-deg, and the same range")
    return np.array(shared), [[one[angle] for angle in shared] for one in keys]


def _between(curves: FloatArray) -> FloatArray:
    """Covariance of prints' curves (p, g, 2), (g, 2, 2), drawn towards equal variances.

    So few prints hardly tell a correlation, and two tell none: the mean variance gets a share of 1/(p − 1).
    """
    apart = curves - curves.mean(axis=0)
    found = np.einsum("pgi,pgj->gij", apart, apart) / (len(curves) - 1)
    share = 1.0 / (len(curves) - 1)
    level = np.trace(found, axis1=1, axis2=2) / 2.0
    return np.asarray((1.0 - share) * found + share * level[:, None, None] * np.eye(2))
