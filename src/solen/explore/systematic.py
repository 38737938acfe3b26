"""Systematic deviations of a printer, separated from those of single prints with Gaussian processes along the outline.

The deviation of a print is the sum of the effect of its drawing (from the print model), deviations common to all prints
(uniform overgrowth, size, and a form along the outline), individual deviations, and errors of the image: pose, scale,
shift of all edges, noise. All but the first are normally distributed with known standard deviations. The common part
therefore follows from all prints jointly by linear algebra (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes
for Machine Learning, 2006, chapter 2). The standard deviation and correlation length of the forms are unknown; they are
marginalised over a grid with the marginal likelihood of the images as weight. Quantities that the images do not resolve
stay at their prior means. A correction by the mean is therefore damped: strongly if a single image shows little more
than noise, and less and less as further prints agree.

Public names: `Prior`, `infer_systematic`, `MeasuredPrint` and `Systematic`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from solen.arrays import FloatArray
from solen.explore.contour import Contour, ContourDeviations
from solen.metrology.print_fit import U_SCALE

FORM_SDS_UM = np.geomspace(0.1, 30.0, 7)
"""Candidate standard deviations of the common form."""
CORRELATION_LENGTHS_MM = (0.12, 0.25, 0.5, 1.0)
"""Candidate correlation lengths of forms."""
PIXEL_LENGTH_MM = 0.1
"""Correlation length of the effects of pixels on an edge."""
REPEAT_FACTORS = ((0.4, 0.25), (1.0, 0.5), (2.5, 0.25))
"""Pairs of a factor on the specified difference between prints, which is known within a factor of 2, and a weight."""
MODEL_ERROR_FACTORS = ((0.3, 0.4), (0.8, 0.4), (1.5, 0.2))
"""Pairs of a factor on the expected error of modelled pixel effects, and a weight."""
U_POSE = 0.1
"""Standard deviations of the priors of rotation (rad) and shift (mm), which are practically flat."""
MIN_WEIGHT = 1e-4
"""Weight below which a grid point is omitted."""
OVERGROWTH, SIZE, BLUR = -3, -2, -1
"""Indices in a state, after the form, of the overgrowth (µm), the size (factor − 1) and the blur (in u)."""


@dataclass(frozen=True, eq=False)
class MeasuredPrint:
    """A measured print and the modelled effect of its drawing on each piece of the contour, in µm.

    ``per_blur_um`` is the change of that effect if the blur is wider by its standard uncertainty, ``u_model_um`` the
    standard uncertainty of the model, whose error is common to all prints of one ``drawing``.
    """

    deviations: ContourDeviations
    drawing: int
    effect_um: FloatArray
    per_blur_um: FloatArray
    u_model_um: FloatArray


@dataclass(frozen=True)
class Prior:
    """Prior means and uncertainties; ``blur`` is that of the process minus that of the model, in units of its u."""

    overgrowth_um: float
    u_overgrowth_um: float
    shrinkage_percent: float
    u_shrinkage_percent: float
    repeat_um: float
    blur: float = 0.0


@dataclass(frozen=True, eq=False)
class Systematic:
    """The common deviations of all prints of a design, at lengths (n,) along its front.

    A state is the deviation (n,) in µm of prints of the first drawing, including overgrowth and size, followed by the
    overgrowth, the size and the blur. Its distribution is a weighted mixture of normal distributions.

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
    error_factors
        Factor (H,) on the expected error of modelled pixel effects.
    log_evidence
        Log marginal likelihood of all images, up to a constant.
    """

    contour: Contour
    arc_mm: FloatArray
    weights: FloatArray
    means: FloatArray
    covariances: FloatArray
    repeats_um: FloatArray
    lengths_mm: FloatArray
    error_factors: FloatArray
    log_evidence: float

    @property
    def mean(self) -> FloatArray:
        """Mean state (n + 3,)."""
        return np.asarray(self.weights @ self.means)

    @property
    def u(self) -> FloatArray:
        """Standard uncertainties (n + 3,) of the state."""
        variances = np.diagonal(self.covariances, axis1=1, axis2=2) + (self.means - self.mean) ** 2
        return np.asarray(np.sqrt(self.weights @ variances))

    @property
    def repeat_um(self) -> float:
        """Mean standard deviation of the individual form of a print."""
        return float(self.weights @ self.repeats_um)

    def samples(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return random states (count, n + 3), individual forms of a further print (count, n), and error factors.

        The factors (count,) scale the error of modelled pixel effects.
        """
        component = rng.choice(len(self.weights), count, p=self.weights)
        states = np.empty((count, self.means.shape[1]))
        forms = np.empty((count, len(self.arc_mm)))
        for h in np.unique(component):
            chosen = component == h
            states[chosen] = rng.multivariate_normal(self.means[h], self.covariances[h], chosen.sum(), method="eigh")
            unit = _individual_covariance(self.contour, self.arc_mm, self.arc_mm, self.lengths_mm[h])
            covariance = self.repeats_um[h] ** 2 * unit
            forms[chosen] = rng.multivariate_normal(np.zeros(len(unit)), covariance, chosen.sum(), method="eigh")
        return states, forms, self.error_factors[component]


def infer_systematic(contour: Contour, prints: Sequence[MeasuredPrint], prior: Prior, arc_mm: FloatArray) -> Systematic:
    """Return the common deviations of prints of known drawings, at lengths (n,) along the front."""
    problem = _Problem(contour, prints, prior, arc_mm)
    grid = [
        (form, length, repeat_factor * prior.repeat_um, error_factor, repeat_weight * error_weight)
        for length in CORRELATION_LENGTHS_MM
        for form in FORM_SDS_UM.tolist()
        for repeat_factor, repeat_weight in REPEAT_FACTORS
        for error_factor, error_weight in MODEL_ERROR_FACTORS
    ]
    logs = np.array([problem.log_evidence(*point[:4]) + math.log(point[4]) for point in grid])
    weights = np.exp(logs - logs.max())
    total = float(weights.sum())
    kept = np.flatnonzero(weights > MIN_WEIGHT * total)
    states = [problem.state(*grid[h][:4]) for h in kept]
    return Systematic(
        contour,
        arc_mm,
        weights[kept] / weights[kept].sum(),
        np.array([mean for mean, _ in states]),
        np.array([covariance for _, covariance in states]),
        np.array([grid[h][2] for h in kept]),
        np.array([grid[h][1] for h in kept]),
        np.array([grid[h][3] for h in kept]),
        float(logs.max()) + math.log(total),
    )


class _Problem:
    """Measured deviations of all prints, and the covariances between them and the state."""

    def __init__(self, contour: Contour, prints: Sequence[MeasuredPrint], prior: Prior, arc_mm: FloatArray) -> None:
        self.contour, self.prior, self.state_arc = contour, prior, arc_mm
        self.arc = np.concatenate([print_.deviations.arc_mm for print_ in prints])
        self.print_of = np.repeat(np.arange(len(prints)), [len(print_.deviations.arc_mm) for print_ in prints])
        self.size, self.state_size = 1e3 * contour.by_size(self.arc), 1e3 * contour.by_size(arc_mm)
        self.blur = np.concatenate([print_.per_blur_um for print_ in prints])
        self.means = (prior.overgrowth_um, -0.01 * prior.shrinkage_percent)
        self.u = (prior.u_overgrowth_um, 0.01 * prior.u_shrinkage_percent)
        observed = np.concatenate([print_.deviations.deviation_um - print_.effect_um for print_ in prints])
        self.residual = observed - self.means[0] - self.means[1] * self.size - prior.blur * self.blur
        image_effects = self._image_effects(prints)
        noise = np.concatenate([print_.deviations.u_um for print_ in prints]) ** 2
        common = self.u[0] ** 2 + self.u[1] ** 2 * np.outer(self.size, self.size) + np.outer(self.blur, self.blur)
        self.fixed = np.diag(noise) + image_effects @ image_effects.T + common
        drawing = np.array([print_.drawing for print_ in prints])[self.print_of]
        u_model = np.concatenate([print_.u_model_um for print_ in prints])
        self.model_error = (drawing[:, None] == drawing[None, :]) * pixel_covariance(self.arc, u_model)
        self.common_form = {length: _matern(self.arc, self.arc, length) for length in CORRELATION_LENGTHS_MM}
        same_print = self.print_of[:, None] == self.print_of[None, :]
        self.individual_form = {
            length: same_print * _individual_covariance(contour, self.arc, self.arc, length)
            for length in CORRELATION_LENGTHS_MM
        }

    def _image_effects(self, prints: Sequence[MeasuredPrint]) -> FloatArray:
        """Return the effects (N, K) of each image's pose, scale error and edge shift, per standard uncertainty."""
        rigid, columns = self.contour.by_rigid(self.arc), []
        for number in range(len(prints)):
            columns += [U_POSE * 1e3 * column * (self.print_of == number) for column in rigid.T]
        scales = [(print_.deviations.um_per_px, print_.deviations.u_um_per_px) for print_ in prints]
        for scale in dict.fromkeys(scales):
            um_per_px, u_um_per_px = scale
            affected = np.array([other == scale for other in scales])[self.print_of]
            u = U_SCALE if u_um_per_px is None else u_um_per_px / um_per_px
            bias_um = prints[scales.index(scale)].deviations.bias_um
            columns += [u * self.size * affected, bias_um * affected]
        return np.column_stack(columns)

    def _factor(self, form: float, length: float, repeat: float, error_factor: float) -> tuple[FloatArray, bool]:
        covariance = self.fixed + form**2 * self.common_form[length] + repeat**2 * self.individual_form[length]
        covariance += error_factor**2 * self.model_error
        factor, lower = cho_factor(covariance, lower=True)
        return np.asarray(factor), lower

    def log_evidence(self, form: float, length: float, repeat: float, error_factor: float) -> float:
        """Return the log-likelihood of all measurements, up to a constant."""
        factor = self._factor(form, length, repeat, error_factor)
        return float(-0.5 * self.residual @ cho_solve(factor, self.residual) - np.log(np.diag(factor[0])).sum())

    def state(self, form: float, length: float, repeat: float, error_factor: float) -> tuple[FloatArray, FloatArray]:
        """Return the mean and covariance of the state."""
        factor = self._factor(form, length, repeat, error_factor)
        u_growth, u_size = self.u
        n = len(self.state_arc)
        front = form**2 * _matern(self.state_arc, self.arc, length)
        front = front + u_growth**2 + u_size**2 * np.outer(self.state_size, self.size)
        cross = np.vstack([front, u_growth**2 * np.ones(len(self.arc)), u_size**2 * self.size, self.blur])
        prior = np.zeros((n + 3, n + 3))
        prior[:n, :n] = form**2 * _matern(self.state_arc, self.state_arc, length)
        prior[:n, :n] += u_growth**2 + u_size**2 * np.outer(self.state_size, self.state_size)
        prior[:n, OVERGROWTH] = prior[OVERGROWTH, :n] = u_growth**2
        prior[:n, SIZE] = prior[SIZE, :n] = u_size**2 * self.state_size
        prior[OVERGROWTH, OVERGROWTH], prior[SIZE, SIZE], prior[BLUR, BLUR] = u_growth**2, u_size**2, 1.0
        mean = cross @ cho_solve(factor, self.residual)
        mean[:n] += self.means[0] + self.means[1] * self.state_size
        mean[OVERGROWTH] += self.means[0]
        mean[SIZE] += self.means[1]
        mean[BLUR] += self.prior.blur
        return mean, prior - cross @ cho_solve(factor, cross.T)


def pixel_covariance(arc_mm: FloatArray, u_um: FloatArray) -> FloatArray:
    """Return the covariance of the errors of modelled pixel effects at lengths along the outline."""
    return np.asarray(np.outer(u_um, u_um) * _matern(arc_mm, arc_mm, PIXEL_LENGTH_MM))


def _matern(first: FloatArray, second: FloatArray, length: float) -> FloatArray:
    """Return the Matérn correlation (ν = 5/2) of smooth forms at lengths along the outline."""
    distance = math.sqrt(5.0) * np.abs(first[:, None] - second[None, :]) / length
    return np.asarray((1.0 + distance + distance**2 / 3.0) * np.exp(-distance))


def _individual_covariance(contour: Contour, first: FloatArray, second: FloatArray, length: float) -> FloatArray:
    """Return the covariance of individual deviations: form, uniform growth, and size, each with unit variance.

    The variance due to size is that at the ends of the lens.
    """
    half_mm = 0.5 * contour.nominal.width_mm
    sizes = np.outer(contour.by_size(first), contour.by_size(second)) / half_mm**2
    return np.asarray(_matern(first, second, length) + 1.0 + sizes)
