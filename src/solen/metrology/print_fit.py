"""Size and form of a print: pose, scale, shrinkage and uniform overgrowth fitted jointly.

Three effects change the apparent size of an entire print. A wrong scale and shrinkage multiply all lengths and cannot
be separated in an image; their priors decide how the factor is divided. Overgrowth, the usual fault of projection
printing, moves every wall outwards by the same distance. From the front alone, it is strongly correlated with a size
factor (fully for a circle), but the walls behind the front separate the two. Front and walls are therefore fitted
jointly, all five parameters at once, with the form error of the print, of unknown magnitude, as residual.

Form errors of neighbouring points are correlated, so N points are equivalent to m independent values: with a form error
of standard deviation σ, the log-likelihood is -m ln σ - (m/N) Σ d²/2σ². Deviations are linear in the five
parameters near the best fit, so the integral over these is exact, and the integral over σ is computed on a grid with a
prior about the usual form error. The result is the marginal likelihood of the design (A. Gelman and others, Bayesian
Data Analysis, chapters 7 and 14). The same prior gives the probability that a print of this design deviates by at
least as much: an absolute test.

Public names: `fit_print`, `TracedOutline`, `PrintFit` and `PrintPriors`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.special import ndtri
from scipy.stats import chi2

from solen.arrays import BoolArray, FloatArray
from solen.metrology.edge import Edge
from solen.metrology.nominal import END_MM, NominalFront
from solen.metrology.pose import Pose
from solen.metrology.registration import CONVERGED_MM, MAX_ITERATIONS, correlations, huber, motion_jacobian, rotated
from solen.results import HIDDEN
from solen.spec.strict import Finite, Options

U_SCALE = 0.03
"""Relative standard uncertainty assumed for a scale without a specified uncertainty."""
EDGE_BIAS_PX = 0.05
"""Edge shift due to non-uniform illumination and the camera's tone curve: systematic, and not visible in the
scatter.
"""
FORM_FACTOR = 2.0
"""Factor that corresponds to one standard deviation of the prior of a print's form error."""
ABSORBED_VALUES = 8.0
"""The five fitted parameters absorb slowly varying form errors, so the residual looks less correlated than they are. m
values are therefore treated as m²/(m + 8); by simulation, intervals then cover form errors with correlation lengths of
0.15 to 0.6 mm.
"""
U_MOTION = 10.0
"""Prior standard deviation of a rotation (rad) and a shift (mm): wide enough to have no effect, and equal for all
designs.
"""
_FORMS_MM = np.geomspace(1e-6, 1.0, 121)  # magnitudes of the form error to integrate over
_QUANTILES = ndtri((np.arange(31) + 0.5) / 31)  # equally probable values of a normal distribution


class PrintPriors(Options):
    """Priors of a print's size and form."""

    shrinkage_percent: Annotated[Finite, Field(ge=-20, le=20)] = 0.0
    """Expected shrinkage that remains after any compensation, %."""
    u_shrinkage_percent: Annotated[Finite, Field(gt=0, le=20)] = 2.0
    """Standard uncertainty of the expected shrinkage, %."""
    overgrowth_um: Annotated[Finite, Field(ge=-1000, le=1000)] = 0.0
    """Expected uniform overgrowth of all walls, µm."""
    u_overgrowth_um: Annotated[Finite, Field(gt=0, le=1000)] = 50.0
    """Standard uncertainty of the expected overgrowth, µm."""
    form_um: Annotated[Finite, Field(gt=0, le=1000)] = 2.0
    """Usual RMS deviation of a print of the right design after its size is corrected, µm."""


@dataclass(frozen=True, eq=False)
class TracedOutline:
    """A print's outline in an image: points (N, 2) of the front and of its walls, and the image scale."""

    front_px: FloatArray
    walls_px: tuple[FloatArray | None, ...]
    pose: Pose
    u_scale: float | None

    @classmethod
    def of(cls, edge: Edge, walls: Sequence[Edge | None], pose: Pose, u_scale: float | None) -> "TracedOutline":
        """Return the outline from measured edges; None stands for a wall that is not visible."""
        wall_points = tuple(None if wall is None else wall.measured[0] for wall in walls)
        return cls(edge.measured[0], wall_points, pose, u_scale)

    @property
    def u_factor(self) -> float:
        """Relative standard uncertainty of the scale, an assumed value if none is specified."""
        return U_SCALE if self.u_scale is None else self.u_scale


@dataclass(frozen=True)
class PrintFit:
    """Size, overgrowth and form error of a print, from a fit of its outline to one design.

    Attributes
    ----------
    overgrowth_um, u_overgrowth_um
        Uniform displacement of all walls outwards.
    size_factor, u_size_factor
        Size of the outline relative to the design, at the image's scale and without overgrowth.
    scale_factor, u_scale_factor
        Ratio of true to specified pixel size.
    shrinkage_percent, u_shrinkage_percent
        Shrinkage of the print; their priors determine how the size factor is divided between scale and shrinkage.
    form_um
        RMS deviation that rotation, shift, size and overgrowth do not explain.
    p_form
        Probability that a print of this design deviates by at least as much, given the usual form error.
    independent_values
        Number of independent values among the deviations.
    walls
        Number of walls used; without them, overgrowth and size are strongly correlated.
    log_evidence
        Logarithm of the design's marginal likelihood up to a constant, for a given number of independent values.
    on_front
        Shape (N,): which of the front's points are on the front, not on a corner or a wall; all if the size is too
        uncertain to locate the corners.
    motion
        Rotation (rad) and shift along x and z (mm) that register the outline to the design, without its size.
    by_scale_um
        Signed error of the overgrowth due to one standard uncertainty of the scale, part of ``u_overgrowth_um``.
    """

    overgrowth_um: float
    u_overgrowth_um: float
    size_factor: float
    u_size_factor: float
    scale_factor: float
    u_scale_factor: float
    shrinkage_percent: float
    u_shrinkage_percent: float
    form_um: float
    p_form: float
    independent_values: float
    walls: int
    log_evidence: float = field(metadata=HIDDEN)
    on_front: BoolArray = field(metadata=HIDDEN, repr=False)
    motion: tuple[float, float, float] = field(metadata=HIDDEN, repr=False)
    by_scale_um: float = field(metadata=HIDDEN)


def fit_print(
    traced: TracedOutline, nominal: NominalFront, priors: PrintPriors = PrintPriors(), independent: float | None = None
) -> PrintFit:
    """Fit pose, size and overgrowth of an outline to a design.

    Parameters
    ----------
    traced
        The outline, with a pose that is accurate to about a tenth of the lens's width.
    nominal
        The design.
    priors
        Priors.
    independent
        Number of independent values to assume, as when designs are compared; by default that of the residual.
    """
    problem = _Problem(traced, nominal, priors)
    fit = problem.solved()
    count = fit.independent() if independent is None else independent
    posterior = _Posterior.of(problem, fit, count)
    return _print_fit(problem, fit, posterior, count)


@dataclass(frozen=True, eq=False)
class _Placed:
    """Moved and resized outline: residuals (N,) in mm, derivatives (N, 5), weights, and masks of the used points."""

    values: FloatArray
    residual: FloatArray
    jacobian: FloatArray
    weights: FloatArray
    pieces: tuple[BoolArray, ...]

    @property
    def mean_square(self) -> float:
        return float(np.mean(self.weights * self.residual**2))

    @property
    def normal(self) -> FloatArray:
        return np.asarray(self.jacobian.T @ (self.weights[:, None] * self.jacobian) / len(self.residual))

    @property
    def gradient(self) -> FloatArray:
        return np.asarray(self.jacobian.T @ (self.weights * self.residual) / len(self.residual))

    def independent(self) -> float:
        """Return the number of independent residuals, N over 1 + 2 Σ ρ_k; front and walls share the ρ_k."""
        ends = np.cumsum([int(piece.sum()) for piece in self.pieces])
        rho = correlations(np.split(self.residual, ends[:-1]))
        count = len(self.residual) / (1.0 + 2.0 * float(np.sum(rho)))
        return max(count**2 / (count + ABSORBED_VALUES), 1.0)


class _Problem:
    """Fit of rotation, shift along x and z, logarithm of the size factor, and overgrowth (mm) of an outline."""

    def __init__(self, traced: TracedOutline, nominal: NominalFront, priors: PrintPriors) -> None:
        self.traced, self.nominal, self.priors = traced, nominal, priors
        walls = zip(traced.walls_px, nominal.walls, strict=False)
        self.walls = [(points, wall) for points, wall in walls if points is not None and len(points)]
        self._points = [
            traced.pose.to_mm(points) for points in (traced.front_px, *(points for points, _ in self.walls))
        ]
        u_size = math.hypot(traced.u_factor, 1e-2 * priors.u_shrinkage_percent)
        self.u_prior = np.array([U_MOTION, U_MOTION, U_MOTION, u_size, 1e-3 * priors.u_overgrowth_um])
        self.prior = np.array(
            [0.0, 0.0, 0.0, math.log1p(-1e-2 * priors.shrinkage_percent), 1e-3 * priors.overgrowth_um]
        )

    @property
    def precision(self) -> FloatArray:
        return np.asarray(self.u_prior**-2.0)

    def solved(self) -> _Placed:
        """Return the most probable motion, size and overgrowth; the residuals give the magnitude of the form error."""
        fit = self.placed(np.zeros(5))
        for _ in range(MAX_ITERATIONS):
            scale = fit.independent() / max(fit.mean_square, 1e-14)
            normal = scale * fit.normal + np.diag(self.precision)
            step = -np.linalg.solve(normal, scale * fit.gradient + self.precision * (fit.values - self.prior))
            step[3:] = np.clip(step[3:], -0.1, 0.1)
            shift = rotated(fit.values[1:3], float(step[0])) + step[1:3]
            fit = self.placed(np.concatenate([[fit.values[0] + step[0]], shift, fit.values[3:] + step[3:]]))
            if np.abs(step).max() < CONVERGED_MM:
                break
        return fit

    def placed(self, values: FloatArray) -> _Placed:
        """Return the residuals of front and walls: deviations from the scaled and uniformly grown design."""
        turn, factor, growth = float(values[0]), math.exp(values[3]), float(values[4])
        fronts = (self.nominal, *(wall for _, wall in self.walls))
        rows = [
            _piece(rotated(points, turn) + values[1:3], front, factor, growth)
            for points, front in zip(self._points, fronts, strict=True)
        ]
        pieces = tuple(used for *_, used in rows)
        residual = np.concatenate([part[used] for part, _, used in rows])
        jacobian = np.concatenate([part[used] for _, part, used in rows])
        everywhere = np.ones(len(residual), dtype=bool)
        return _Placed(values, residual, jacobian, huber(residual, everywhere), pieces)


def _piece(
    points: FloatArray, nominal: NominalFront, factor: float, growth: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return residuals, derivatives and the mask of used points for a front or a wall."""
    nearest = nominal.nearest(points / factor)
    outside = factor * nearest.deviation_mm
    motion = motion_jacobian(points, nearest.normals)
    jacobian = np.column_stack([motion[:, :3], outside - motion[:, 3], np.full(len(points), -1.0)])
    shifts = nominal.corner_shifts(0.0, growth / factor)
    used = ~nearest.beyond & nominal.on_front(points / factor, nearest.arc_mm, shifts)
    return outside - growth, jacobian, used


@dataclass(frozen=True, eq=False)
class _Posterior:
    """Mean (5,) and covariance (5, 5) of motion, size and overgrowth, and the logarithm of the marginal likelihood."""

    mean: FloatArray
    covariance: FloatArray
    log_evidence: float

    @classmethod
    def of(cls, problem: _Problem, fit: _Placed, count: float) -> "_Posterior":
        """Return the posterior about a fit, integrated over the magnitude of the form error."""
        precision, change = np.diag(problem.precision), fit.values - problem.prior
        means, covariances, logs = [], [], []
        for form in _FORMS_MM:
            scale = count / form**2
            inverse = np.linalg.inv(scale * fit.normal + precision)
            gradient = scale * fit.gradient + precision @ change
            misfit = scale * fit.mean_square + change @ precision @ change - gradient @ inverse @ gradient
            means.append(fit.values - inverse @ gradient)
            covariances.append(inverse)
            log_ratio = math.log(1e3 * form / problem.priors.form_um) / math.log(FORM_FACTOR)
            volume = 0.5 * float(np.linalg.slogdet(inverse @ precision)[1])
            logs.append(-count * math.log(form) - 0.5 * (misfit + log_ratio**2) + volume)
        weight = np.exp(np.array(logs) - max(logs))
        evidence = max(logs) + math.log(weight.sum())
        weight /= weight.sum()
        mean = weight @ np.array(means)
        spread = np.array(means) - mean
        covariance = np.einsum("k,kij->ij", weight, np.array(covariances))
        return cls(mean, covariance + np.einsum("k,ki,kj->ij", weight, spread, spread), evidence)


def _print_fit(problem: _Problem, fit: _Placed, posterior: _Posterior, count: float) -> PrintFit:
    """Return the result, with the size factor divided between scale and shrinkage according to their priors."""
    priors, traced = problem.priors, problem.traced
    size, u_size = float(posterior.mean[3]), math.sqrt(float(posterior.covariance[3, 3]))
    parts = np.array([traced.u_factor, 1e-2 * priors.u_shrinkage_percent])
    gain = parts**2 / np.sum(parts**2)
    change = size - problem.prior[3]
    u_parts = np.sqrt(parts**2 * (1.0 - gain) + (gain * u_size) ** 2)
    form = math.sqrt(fit.mean_square)
    u_bias_um = EDGE_BIAS_PX * traced.pose.um_per_px
    return PrintFit(
        overgrowth_um=1e3 * float(posterior.mean[4]),
        u_overgrowth_um=math.hypot(1e3 * math.sqrt(float(posterior.covariance[4, 4])), u_bias_um),
        size_factor=math.exp(size),
        u_size_factor=math.exp(size) * u_size,
        scale_factor=math.exp(-gain[0] * change),
        u_scale_factor=float(u_parts[0]),
        shrinkage_percent=priors.shrinkage_percent - 100.0 * float(gain[1]) * change,
        u_shrinkage_percent=100.0 * float(u_parts[1]),
        form_um=1e3 * form,
        p_form=_p_form(form, 1e-3 * priors.form_um, count),
        independent_values=count,
        walls=len(problem.walls),
        log_evidence=posterior.log_evidence,
        on_front=fit.pieces[0] | (_u_of_corners(problem.nominal, posterior) > END_MM),
        by_scale_um=1e3 * float(posterior.covariance[4, 3] * problem.precision[3]) * traced.u_factor,
        motion=(float(fit.values[0]), float(fit.values[1]), float(fit.values[2])),
    )


def registered(
    traced: TracedOutline, nominal: NominalFront, size: PrintFit
) -> tuple[FloatArray, tuple[FloatArray | None, ...]]:
    """Return the points (N, 2) of the front and of its left and right wall, registered to the design by the fit, mm."""

    def moved(points_px: FloatArray) -> FloatArray:
        turn, *shift = size.motion
        return np.asarray(rotated(traced.pose.to_mm(points_px), turn) + np.array(shift))

    seen = iter(traced.walls_px)
    walls = [next(seen, None) if len(wall) > 1 else None for wall in (nominal.left_mm, nominal.right_mm)]
    left, right = (None if points is None or not len(points) else moved(points) for points in walls)
    return moved(traced.front_px), (left, right)


def _u_of_corners(nominal: NominalFront, posterior: _Posterior) -> float:
    """Return the larger standard uncertainty in mm of the positions of both corners along the front."""
    slopes = np.column_stack([nominal.corner_shifts(1.0, 0.0), nominal.corner_shifts(0.0, 1.0)])
    return math.sqrt(float(np.einsum("ki,ij,kj->k", slopes, posterior.covariance[3:, 3:], slopes).max()))


def _p_form(form: float, usual: float, count: float) -> float:
    """Return the probability of a form error of at least this size; the usual one is known to within `FORM_FACTOR`."""
    magnitudes = usual * FORM_FACTOR**_QUANTILES
    freedom = max(count - 5.0, 1.0)
    return float(np.mean(chi2.sf(freedom * (form / magnitudes) ** 2, freedom)))
