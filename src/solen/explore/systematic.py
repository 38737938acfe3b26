"""Systematic deviations of a printer, separated from those of single prints with Gaussian processes along the outline.

The deviation of a print is the sum of the effect of its drawing (from the print model), deviations common to all prints
(uniform overgrowth, size, and a form along the outline), individual deviations, and errors of the image: pose, scale,
shift of all edges, noise. All but the first are normal with a stated standard deviation. The common part therefore
follows from all prints jointly by linear algebra (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine
Learning, 2006, chapter 2). The size and correlation length of the forms are unknown; they are marginalised over a grid
with the marginal likelihood of the images as weight. Unresolved quantities stay at their prior, 0, so that a
correction by the mean is damped automatically: strongly if a single image shows little beyond noise, and increasingly
less as prints agree.

Public names: `Known`, `learnt`, `Print` and `Systematic`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from solen.arrays import FloatArray
from solen.explore.contour import Contour, Rows
from solen.metrology.print_fit import U_SCALE

FORMS_UM = np.geomspace(0.1, 30.0, 7)
"""Candidate standard deviations of the common form."""
LENGTHS_MM = (0.12, 0.25, 0.5, 1.0)
"""Candidate correlation lengths of forms."""
PIXELS_MM = 0.1
"""Correlation length of pixel effects on an edge."""
REPEATS = ((0.4, 0.25), (1.0, 0.5), (2.5, 0.25))
"""Factors on the usual difference between prints, and their weights: known within a factor of 2."""
MISSED = ((0.3, 0.4), (0.8, 0.4), (1.5, 0.2))
"""Factors on the model's usual error of pixel effects, and their weights."""
U_POSE = 0.1
"""Standard deviations of the priors of rotation (rad) and shift (mm), practically flat."""
SLIGHT = 1e-4
"""Grid points with a smaller weight are omitted."""
OVERGROWTH, SIZE, BLUR = -3, -2, -1
"""Indices in a state, after the form, of the overgrowth (µm), the size (factor − 1) and the blur (in u)."""


@dataclass(frozen=True, eq=False)
class Print:
    """A measured print and the modelled effect of its drawing, for the rows of its image, in µm.

    ``by_blur_um`` is the change of that effect if the blur is wider by its standard uncertainty, ``missed_um`` the
    standard uncertainty of the model, common to all prints of one ``drawing``.
    """

    rows: Rows
    drawing: int
    drawn_um: FloatArray
    by_blur_um: FloatArray
    missed_um: FloatArray


@dataclass(frozen=True)
class Known:
    """Priors before a print is measured; ``blur`` is that of the process minus that of the model, in units of its u."""

    overgrowth_um: float
    u_overgrowth_um: float
    shrinkage_percent: float
    u_shrinkage_percent: float
    repeat_um: float
    blur: float = 0.0


@dataclass(frozen=True, eq=False)
class Systematic:
    """The common deviations of all prints of a design, at lengths (n,) along its front.

    A state is the deviation (n,) in µm of prints of the first drawing, including overgrowth and size, followed by these
    two separately and by the blur. Its distribution is a weighted mixture of normal distributions.

    Attributes
    ----------
    arc_mm
        Lengths (n,).
    weights, means, covariances
        Arrays of shapes (H,), (H, n + 3) and (H, n + 3, n + 3).
    repeats_um
        Standard deviation (H,) of the individual form of a print.
    lengths_mm
        Correlation length (H,) of that form.
    missed
        Factor (H,) on the model's usual error of pixel effects.
    log_evidence
        Logarithm of the marginal likelihood of all images, up to a constant.
    """

    contour: Contour
    arc_mm: FloatArray
    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    repeats_um: FloatArray
    lengths_mm: FloatArray
    missed: FloatArray
    log_evidence: float

    @property
    def mean(self) -> FloatArray:
        """Mean state (n + 3,)."""
        return np.asarray(self.weights @ self.means)

    @property
    def u(self) -> FloatArray:
        """Standard uncertainties (n + 3,) of the state."""
        spread = np.diagonal(self.covariances, axis1=1, axis2=2) + (self.means - self.mean) ** 2
        return np.asarray(np.sqrt(self.weights @ spread))

    @property
    def repeat_um(self) -> float:
        """Mean size of the individual form of a print."""
        return float(self.weights @ self.repeats_um)

    def drawn(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw random states (count, n + 3), individual forms of a further print (count, n), and factors.

        The factors (count,) scale the model's error of pixel effects.
        """
        which = rng.choice(len(self.weights), count, p=self.weights)
        states = np.empty((count, self.means.shape[1]))
        alone = np.empty((count, len(self.arc_mm)))
        for kind in np.unique(which):
            mine = which == kind
            states[mine] = rng.multivariate_normal(self.means[kind], self.covariances[kind], mine.sum(), method="eigh")
            once = self.repeats_um[kind] ** 2 * _alone(self.contour, self.arc_mm, self.arc_mm, self.lengths_mm[kind])
            alone[mine] = rng.multivariate_normal(np.zeros(len(once)), once, mine.sum(), method="eigh")
        return states, alone, self.missed[which]


def learnt(contour: Contour, prints: Sequence[Print], known: Known, arc_mm: FloatArray) -> Systematic:
    """Return the common deviations of prints of known drawings, at lengths (n,) along the front."""
    problem = _Problem(contour, prints, known, arc_mm)
    grid = [
        (form, length, factor * known.repeat_um, missed, weight * share)
        for length in LENGTHS_MM
        for form in FORMS_UM.tolist()
        for factor, weight in REPEATS
        for missed, share in MISSED
    ]
    logs = np.array([problem.log_evidence(*kind[:4]) + math.log(kind[4]) for kind in grid])
    weights = np.exp(logs - logs.max())
    total = float(weights.sum())
    kept = np.flatnonzero(weights > SLIGHT * total)
    states = [problem.state(*grid[place][:4]) for place in kept]
    return Systematic(
        contour,
        arc_mm,
        weights[kept] / weights[kept].sum(),
        np.array([mean for mean, _ in states]),
        np.array([covariance for _, covariance in states]),
        np.array([grid[place][2] for place in kept]),
        np.array([grid[place][1] for place in kept]),
        np.array([grid[place][3] for place in kept]),
        float(logs.max()) + math.log(total),
    )


class _Problem:
    """Rows of all prints, and the covariances between them and the state."""

    def __init__(self, contour: Contour, prints: Sequence[Print], known: Known, arc_mm: FloatArray) -> None:
        self.contour, self.known, self.at = contour, known, arc_mm
        self.arc = np.concatenate([one.rows.arc_mm for one in prints])
        self.which = np.repeat(np.arange(len(prints)), [len(one.rows.arc_mm) for one in prints])
        self.size, self.size_at = 1e3 * contour.by_size(self.arc), 1e3 * contour.by_size(arc_mm)
        self.blur = np.concatenate([one.by_blur_um for one in prints])
        self.before = (known.overgrowth_um, -0.01 * known.shrinkage_percent)
        self.u = (known.u_overgrowth_um, 0.01 * known.u_shrinkage_percent)
        away = np.concatenate([one.rows.deviation_um - one.drawn_um for one in prints])
        self.off = away - self.before[0] - self.before[1] * self.size - known.blur * self.blur
        self.columns = self._of_images(prints)
        self.noise = np.concatenate([one.rows.u_um for one in prints]) ** 2
        same = self.which[:, None] == self.which[None, :]
        steady = self.u[0] ** 2 + self.u[1] ** 2 * np.outer(self.size, self.size) + np.outer(self.blur, self.blur)
        by = np.array([one.drawing for one in prints])[self.which]
        missed = np.concatenate([one.missed_um for one in prints])
        self.missed = (by[:, None] == by[None, :]) * of_pixels(self.arc, missed)
        self.fixed = np.diag(self.noise) + self.columns @ self.columns.T + steady
        self.kernels = {length: _matern(self.arc, self.arc, length) for length in LENGTHS_MM}
        self.same = {length: same * _alone(contour, self.arc, self.arc, length) for length in LENGTHS_MM}

    def _of_images(self, prints: Sequence[Print]) -> FloatArray:
        """Return the effects (N, K) of each image's pose, scale error and edge shift, per standard uncertainty."""
        rigid, columns = self.contour.by_rigid(self.arc), []
        for number in range(len(prints)):
            columns += [U_POSE * 1e3 * column * (self.which == number) for column in rigid.T]
        scales = [(one.rows.um_per_px, one.rows.u_um_per_px) for one in prints]
        for um_per_px, u_um_per_px in dict.fromkeys(scales):
            of_it = np.array([scale == (um_per_px, u_um_per_px) for scale in scales])[self.which]
            u = U_SCALE if u_um_per_px is None else u_um_per_px / um_per_px
            columns += [u * self.size * of_it, prints[scales.index((um_per_px, u_um_per_px))].rows.bias_um * of_it]
        return np.column_stack(columns)

    def _factor(self, form: float, length: float, repeat: float, missed: float) -> tuple[FloatArray, bool]:
        covariance = self.fixed + form**2 * self.kernels[length] + repeat**2 * self.same[length]
        covariance += missed**2 * self.missed
        factor, lower = cho_factor(covariance, lower=True)
        return np.asarray(factor), lower

    def log_evidence(self, form: float, length: float, repeat: float, missed: float) -> float:
        """Return the logarithm of the likelihood of all rows, up to a constant."""
        factor = self._factor(form, length, repeat, missed)
        return float(-0.5 * self.off @ cho_solve(factor, self.off) - np.log(np.diag(factor[0])).sum())

    def state(self, form: float, length: float, repeat: float, missed: float) -> tuple[FloatArray, FloatArray]:
        """Return the mean and covariance of the state."""
        factor = self._factor(form, length, repeat, missed)
        u_grown, u_size = self.u
        ones, at_ones = np.ones(len(self.arc)), np.ones(len(self.at))
        front = form**2 * _matern(self.at, self.arc, length)
        front = front + u_grown**2 + u_size**2 * np.outer(self.size_at, self.size)
        cross = np.vstack([front, u_grown**2 * ones, u_size**2 * self.size, self.blur])
        n = len(self.at)
        prior = np.zeros((n + 3, n + 3))
        prior[:n, :n] = form**2 * _matern(self.at, self.at, length)
        prior[:n, :n] += u_grown**2 + u_size**2 * np.outer(self.size_at, self.size_at)
        prior[:n, OVERGROWTH] = prior[OVERGROWTH, :n] = u_grown**2 * at_ones
        prior[:n, SIZE] = prior[SIZE, :n] = u_size**2 * self.size_at
        prior[OVERGROWTH, OVERGROWTH], prior[SIZE, SIZE], prior[BLUR, BLUR] = u_grown**2, u_size**2, 1.0
        mean = cross @ cho_solve(factor, self.off)
        mean[:n] += self.before[0] + self.before[1] * self.size_at
        mean[OVERGROWTH] += self.before[0]
        mean[SIZE] += self.before[1]
        mean[BLUR] += self.known.blur
        return mean, prior - cross @ cho_solve(factor, cross.T)


def of_pixels(arc_mm: FloatArray, missed_um: FloatArray) -> FloatArray:
    """Return the covariance of the model's error of a drawing's pixel effects, at lengths along the outline."""
    return np.asarray(np.outer(missed_um, missed_um) * _matern(arc_mm, arc_mm, PIXELS_MM))


def _matern(one: FloatArray, other: FloatArray, length: float) -> FloatArray:
    """Return the Matérn correlation (ν = 5/2) of smooth forms at lengths along the outline."""
    apart = math.sqrt(5.0) * np.abs(one[:, None] - other[None, :]) / length
    return np.asarray((1.0 + apart + apart**2 / 3.0) * np.exp(-apart))


def _alone(contour: Contour, one: FloatArray, other: FloatArray, length: float) -> FloatArray:
    """Return the covariance of individual deviations, each of unit size: form, uniform growth, and size at the ends."""
    half_mm = 0.5 * contour.nominal.width_mm
    sizes = np.outer(contour.by_size(one), contour.by_size(other)) / half_mm**2
    return np.asarray(_matern(one, other, length) + 1.0 + sizes)
