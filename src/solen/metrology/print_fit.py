"""Size and form of a print: pose, scale, shrinkage and uniform overgrowth fitted jointly.

Three effects change the size of an entire print. A wrong scale and shrinkage multiply all lengths and cannot be
separated in an image; their priors decide how the factor is divided. Overgrowth, the usual fault of projection
printing, moves every wall outwards by the same distance. It is barely distinguishable from a size factor by the front
alone (for a circle not at all), but the walls behind the front separate the two. Front and walls are therefore fitted
jointly, all five parameters at once, with the form error of the print, of unknown magnitude, as residual.

Form errors of neighbouring points are correlated, so N points count as m independent values: with a form error of
standard deviation σ, the logarithm of the likelihood is -m ln σ - (m/N) Σ d²/2σ². Deviations are linear in the five
parameters near the best fit, so the integral over these is exact, and the integral over σ is computed on a grid with a
prior about the usual form error. The result is the marginal likelihood of the design (A. Gelman and others, Bayesian
Data Analysis, chapters 7 and 14). The same prior gives the probability that a print of this design deviates by as much:
an absolute test.

Public names: `fit_print`, `Traced`, `PrintFit` and `PrintPriors`.
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
from solen.metrology.registration import CONVERGED_MM, ROUNDS, by_motion, correlations, huber, rotated
from solen.results import HIDDEN
from solen.spec.strict import Finite, Options

U_SCALE = 0.03
"""Relative standard uncertainty assumed for a scale without a specified uncertainty."""
EDGE_BIAS_PX = 0.05
"""Edge shift due to non-uniform illumination and the camera's tone curve: systematic, and not visible in the
scatter.
"""
SPREAD_OF_FORM = 2.0
"""Factor of one standard deviation in the prior of a print's form error."""
ABSORBED = 8.0
"""The five fitted parameters remove slowly varying form from the residual, which then looks less correlated than it
is: m values count as m²/(m + 8), for which intervals cover form errors of 0.15 to 0.6 mm correlation length (by
simulation).
"""
U_MOTION = 10.0
"""Prior standard deviation of a rotation (rad) and a shift (mm): wide enough to have no effect, and equal for all
designs.
"""
_FORMS_MM = np.geomspace(1e-6, 1.0, 121)
_NORMAL = ndtri((np.arange(31) + 0.5) / 31)


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
    """Usual deviation (rms) of a print of the right design after its size is corrected, µm."""


@dataclass(frozen=True, eq=False)
class Traced:
    """A print's outline in an image: points (N, 2) of the front and of its walls, and the image scale."""

    front_px: FloatArray
    walls_px: tuple[FloatArray | None, ...]
    pose: Pose
    u_scale: float | None

    @classmethod
    def of(cls, edge: Edge, walls: Sequence[Edge | None], pose: Pose, u_scale: float | None) -> "Traced":
        """Return the outline from measured edges; None stands for a wall that is not visible."""
        beside = tuple(None if wall is None else wall.measured[0] for wall in walls)
        return cls(edge.measured[0], beside, pose, u_scale)

    @property
    def u_factor(self) -> float:
        """Relative standard uncertainty of the scale, an assumed value if none is specified."""
        return U_SCALE if self.u_scale is None else self.u_scale


@dataclass(frozen=True)
class PrintFit:
    """Size and form of a print relative to one design.

    Attributes
    ----------
    overgrowth_um, u_overgrowth_um
        Uniform displacement of all walls outwards.
    size_factor, u_size_factor
        Size of the outline relative to the design, at the image's scale and without overgrowth.
    scale_factor, u_scale_factor
        Ratio of true to stated pixel size.
    shrinkage_percent, u_shrinkage_percent
        Shrinkage of the print; scale and shrinkage make up the size factor, divided by their priors.
    form_um
        Rms deviation that no rotation, shift, size and overgrowth explain.
    p_form
        Probability that a print of this design deviates by as much, given the usual form error.
    independent_values
        Number of independent values among the deviations.
    walls
        Number of walls used; without them overgrowth and size are barely separated.
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
    traced: Traced, nominal: NominalFront, priors: PrintPriors = PrintPriors(), independent: float | None = None
) -> PrintFit:
    """Fit pose, size and overgrowth of an outline to a design.

    Parameters
    ----------
    traced
        The outline, with a pose within about a tenth of the lens's width.
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
    """Moved and resized outline: residuals (N,) in mm, derivatives (N, 5), weights, mask of used points."""

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
        return max(count**2 / (count + ABSORBED), 1.0)


class _Problem:
    """Fit of rotation, shift along x and z, logarithm of the size factor and overgrowth (mm) of an outline."""

    def __init__(self, traced: Traced, nominal: NominalFront, priors: PrintPriors) -> None:
        self.traced, self.nominal, self.priors = traced, nominal, priors
        seen = [(points, wall) for points, wall in zip(traced.walls_px, nominal.walls, strict=False)]
        self.walls = [(points, wall) for points, wall in seen if points is not None and len(points)]
        self._points = [traced.pose.to_mm(points) for points in (traced.front_px, *(one for one, _ in self.walls))]
        u_size = math.hypot(traced.u_factor, 1e-2 * priors.u_shrinkage_percent)
        self.u_before = np.array([U_MOTION, U_MOTION, U_MOTION, u_size, 1e-3 * priors.u_overgrowth_um])
        self.before = np.array(
            [0.0, 0.0, 0.0, math.log1p(-1e-2 * priors.shrinkage_percent), 1e-3 * priors.overgrowth_um]
        )

    @property
    def precision(self) -> FloatArray:
        return np.asarray(self.u_before**-2.0)

    def solved(self) -> _Placed:
        """Return the most probable motion, size and overgrowth; the residual gives the magnitude of the form error."""
        fit = self.placed(np.zeros(5))
        for _ in range(ROUNDS):
            spread = fit.independent() / max(fit.mean_square, 1e-14)
            normal = spread * fit.normal + np.diag(self.precision)
            step = -np.linalg.solve(normal, spread * fit.gradient + self.precision * (fit.values - self.before))
            step[3:] = np.clip(step[3:], -0.1, 0.1)
            shift = rotated(fit.values[1:3], float(step[0])) + step[1:3]
            fit = self.placed(np.concatenate([[fit.values[0] + step[0]], shift, fit.values[3:] + step[3:]]))
            if np.abs(step).max() < CONVERGED_MM:
                break
        return fit

    def placed(self, values: FloatArray) -> _Placed:
        """Return the residuals of front and walls: deviations from the scaled and uniformly grown design."""
        turn, factor, grown = float(values[0]), math.exp(values[3]), float(values[4])
        fronts = (self.nominal, *(wall for _, wall in self.walls))
        rows = [_piece(rotated(points, turn) + values[1:3], front, factor, grown)
                for points, front in zip(self._points, fronts, strict=True)]  # fmt: skip
        pieces = tuple(use for *_, use in rows)
        residual = np.concatenate([part[use] for part, _, use in rows])
        jacobian = np.concatenate([part[use] for _, part, use in rows])
        everywhere = np.ones(len(residual), dtype=bool)
        return _Placed(values, residual, jacobian, huber(residual, everywhere), pieces)


def _piece(
    points: FloatArray, nominal: NominalFront, factor: float, grown: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return residuals, derivatives and the mask of used points for a front or a wall."""
    nearest = nominal.nearest(points / factor)
    outside = factor * nearest.deviation_mm
    motion = by_motion(points, nearest.normals)
    jacobian = np.column_stack([motion[:, :3], outside - motion[:, 3], np.full(len(points), -1.0)])
    moved = nominal.corner_moved(0.0, grown / factor)
    use = ~nearest.beyond & nominal.before_corners(points / factor, nearest.arc_mm, moved)
    return outside - grown, jacobian, use


@dataclass(frozen=True, eq=False)
class _Posterior:
    """Mean (5,) and covariance (5, 5) of motion, size and overgrowth, and the logarithm of the marginal likelihood."""

    mean: FloatArray
    covariance: FloatArray
    log_evidence: float

    @classmethod
    def of(cls, problem: _Problem, fit: _Placed, count: float) -> "_Posterior":
        """Integrate over the magnitude of the form error."""
        precision, off = np.diag(problem.precision), fit.values - problem.before
        means, covariances, logs = [], [], []
        for form in _FORMS_MM:
            spread = count / form**2
            inverse = np.linalg.inv(spread * fit.normal + precision)
            gradient = spread * fit.gradient + precision @ off
            best = spread * fit.mean_square + off @ precision @ off - gradient @ inverse @ gradient
            means.append(fit.values - inverse @ gradient)
            covariances.append(inverse)
            odd = math.log(1e3 * form / problem.priors.form_um) / math.log(SPREAD_OF_FORM)
            volume = 0.5 * float(np.linalg.slogdet(inverse @ precision)[1])
            logs.append(-count * math.log(form) - 0.5 * (best + odd**2) + volume)
        weight = np.exp(np.array(logs) - max(logs))
        evidence = max(logs) + math.log(weight.sum())
        weight /= weight.sum()
        mean = weight @ np.array(means)
        apart = np.array(means) - mean
        covariance = np.einsum("k,kij->ij", weight, np.array(covariances))
        return cls(mean, covariance + np.einsum("k,ki,kj->ij", weight, apart, apart), evidence)


def _print_fit(problem: _Problem, fit: _Placed, posterior: _Posterior, count: float) -> PrintFit:
    """Return the result, with the size factor divided between scale and shrinkage by their priors."""
    priors, traced = problem.priors, problem.traced
    size, u_size = float(posterior.mean[3]), math.sqrt(float(posterior.covariance[3, 3]))
    parts = np.array([traced.u_factor, 1e-2 * priors.u_shrinkage_percent])
    gain = parts**2 / np.sum(parts**2)  # of the size factor, their sum
    off = size - problem.before[3]
    u_parts = np.sqrt(parts**2 * (1.0 - gain) + (gain * u_size) ** 2)
    form = math.sqrt(fit.mean_square)
    u_bias_um = EDGE_BIAS_PX * traced.pose.um_per_px
    return PrintFit(
        overgrowth_um=1e3 * float(posterior.mean[4]),
        u_overgrowth_um=math.hypot(1e3 * math.sqrt(float(posterior.covariance[4, 4])), u_bias_um),
        size_factor=math.exp(size),
        u_size_factor=math.exp(size) * u_size,
        scale_factor=math.exp(-gain[0] * off),
        u_scale_factor=float(u_parts[0]),
        shrinkage_percent=priors.shrinkage_percent - 100.0 * float(gain[1]) * off,
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
    traced: Traced, nominal: NominalFront, size: PrintFit
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
    slopes = np.column_stack([nominal.corner_moved(1.0, 0.0), nominal.corner_moved(0.0, 1.0)])
    return math.sqrt(float(np.einsum("ki,ij,kj->k", slopes, posterior.covariance[3:, 3:], slopes).max()))


def _p_form(form: float, usual: float, count: float) -> float:
    """Return the probability of such a form error if the usual one is known within a factor."""
    usuals = usual * SPREAD_OF_FORM**_NORMAL
    freedom = max(count - 5.0, 1.0)
    return float(np.mean(chi2.sf(freedom * (form / usuals) ** 2, freedom)))
