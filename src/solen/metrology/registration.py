"""Registration of a measured outline to its design: the rotation and the shift that minimise the deviations.

An image does not show where the part was placed, so rotation and shift are free. Its scale is fixed, because a size
error could not be detected otherwise (`solen.metrology.print_fit` fits the size too). The distances of the points from
the front along its normals are minimised by the Gauss-Newton method with Huber weights (P. J. Huber, Ann. Math.
Statist. 35, 73, 1964), so an outlier such as a speck has little influence. A print's deviations are form errors, not
noise: neighbouring points agree. Uncertainties are therefore based on the number of independent values that follows
from the correlation of the deviations, not on the number of pixels.

Public names: `register`, `Registration` and `effective_number`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import BoolArray, FloatArray, IndexArray
from solen.errors import DataError
from solen.metrology.nominal import END_MM, NominalFront
from solen.metrology.pose import Pose

MAX_ITERATIONS = 60
HUBER_SIGMAS = 2.5
"""Deviation, in robust standard deviations, above which a point is down-weighted."""
CONVERGED_MM = 1e-8
MIN_POINTS = 4
"""Minimum number of points to which a rotation and a shift are fitted."""


@dataclass(frozen=True, eq=False)
class Registration:
    """A measured outline registered to a design.

    Attributes
    ----------
    pose
        Pose of the design in the image.
    points_mm
        Shape (N, 2): the measured points in lens coordinates, in their order along the front.
    deviation_um
        Shape (N,): their deviations from the design, µm.
    u_um
        Shape (N,): standard uncertainties of the deviations due to edge, registration and scale.
    used
        Indices of these points among those passed to `register`.
    u_rotation_deg, u_shift_um
        Standard uncertainties of the rotation and of the shifts along x and z.
    by_scale_um
        Shape (N,): derivative of ``deviation_um``, after registration, with respect to the logarithm of the scale.
    independent_values
        Number of independent values among the deviations.
    weights
        Shape (N,): Huber's weights.
    """

    pose: Pose
    points_mm: FloatArray
    deviation_um: FloatArray
    u_um: FloatArray
    used: IndexArray
    u_rotation_deg: float
    u_shift_um: tuple[float, float]
    by_scale_um: FloatArray
    independent_values: float
    weights: FloatArray = field(repr=False)

    @property
    def rms_um(self) -> float:
        """RMS of the deviations."""
        return float(np.sqrt(np.mean(self.deviation_um**2)))

    @property
    def um_per_percent_of_scale(self) -> float:
        """RMS change of the deviations if the scale changes by 1 %."""
        return 0.01 * float(np.sqrt(np.mean(self.by_scale_um**2)))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Rigid motion of the points in lens coordinates, p -> R(turn) p + shift, and the moved points."""

    turn: float
    shift: FloatArray
    points: FloatArray
    deviation: FloatArray
    arc: FloatArray
    jacobian: FloatArray
    weights: FloatArray
    inside: BoolArray


def register(
    points_px: FloatArray,
    u_px: FloatArray,
    pose: Pose,
    nominal: NominalFront,
    u_scale: float = 0.0,
    on_front: BoolArray | None = None,
) -> Registration:
    """Register points of an image to a design.

    Parameters
    ----------
    points_px
        Shape (N, 2): (x, y) in the image of points on the front and possibly beyond it.
    u_px
        Shape (N,): standard uncertainties along the normal.
    pose
        Initial pose, accurate to about a tenth of the lens's width.
    nominal
        The design.
    u_scale
        Relative standard uncertainty of the scale.
    on_front
        Shape (N,): whether a point belongs to the front; by default, all points near it do.

    Raises
    ------
    DataError
        If too few points are near the front.
    """
    fit = _fit(pose.to_mm(points_px), nominal, np.ones(len(points_px), dtype=bool) if on_front is None else on_front)
    order = np.flatnonzero(fit.inside)
    if len(order) < MIN_POINTS:
        what, limit = "image points near the designed lens", f"at least {MIN_POINTS} are needed"
        raise DataError(what, value=len(order), limit=limit, remedy="check the scale (--um-per-px) and the design")
    order = order[np.argsort(fit.arc[order], kind="stable")]
    deviation, weights, jacobian = fit.deviation[order], fit.weights[order], fit.jacobian[order]
    independent_values = effective_number(deviation)
    covariance = _covariance(jacobian[:, :3], deviation, weights, independent_values)
    by_scale = _after_registration(jacobian[:, 3], jacobian[:, :3], weights)
    u_edge = u_px[order] * pose.um_per_px / 1e3
    u = np.sqrt(u_edge**2 + _u_of_pose(jacobian[:, :3], u_edge, weights) ** 2 + (by_scale * u_scale) ** 2)
    return Registration(
        pose=_moved(pose, fit),
        points_mm=fit.points[order],
        deviation_um=1e3 * deviation,
        u_um=1e3 * u,
        used=order,
        u_rotation_deg=math.degrees(math.sqrt(covariance[0, 0])),
        u_shift_um=(1e3 * math.sqrt(covariance[1, 1]), 1e3 * math.sqrt(covariance[2, 2])),
        by_scale_um=1e3 * by_scale,
        independent_values=independent_values,
        weights=weights,
    )


def effective_number(values: FloatArray) -> float:
    """Return the number of independent values that determine a mean square as well as a correlated sequence does.

    It is N over 1 + 2 Σ ρ_k², where ρ_k is the correlation of values k positions apart, summed up to the first
    non-positive one (see G. V. Bayley and J. M. Hammersley, J. R. Stat. Soc. Suppl. 8, 184, 1946, for variances).
    """
    count = len(values)
    if count < 4:
        return float(count)
    return float(max(count / (1.0 + 2.0 * np.sum(correlations([values]) ** 2)), 1.0))


def correlations(parts: Sequence[FloatArray]) -> FloatArray:
    """Return the correlations at lags 1, 2, … within parts of a sequence, up to the first non-positive one."""
    longest = max(len(part) for part in parts)
    size = 1 << (2 * longest - 1).bit_length()
    spectra = [np.fft.rfft(part, size) for part in parts]
    total = np.sum([np.fft.irfft(spectrum * np.conj(spectrum), size)[:longest] for spectrum in spectra], axis=0)
    rho = total / max(float(total[0]), 1e-30)
    ends = np.flatnonzero(rho <= 0.0)
    return np.asarray(rho[1 : int(ends[0]) if len(ends) else longest])


def _fit(start: FloatArray, nominal: NominalFront, on_front: BoolArray) -> _Fit:
    """Return the motion that minimises the points' deviations."""
    turn, shift = 0.0, np.zeros(2)
    fit = _placed(start, nominal, on_front, turn, shift)
    for _ in range(MAX_ITERATIONS):
        jacobian, weights = fit.jacobian[fit.inside][:, :3], fit.weights[fit.inside]
        normal = jacobian.T @ (weights[:, None] * jacobian)
        step = -np.linalg.solve(normal + 1e-12 * np.eye(3), jacobian.T @ (weights * fit.deviation[fit.inside]))
        turn, shift = turn + float(step[0]), rotated(shift, float(step[0])) + step[1:]
        fit = _placed(start, nominal, on_front, turn, shift)
        if np.abs(step).max() < CONVERGED_MM:
            break
    return fit


def _placed(start: FloatArray, nominal: NominalFront, on_front: BoolArray, turn: float, shift: FloatArray) -> _Fit:
    """Return the moved points with their deviations, the derivatives of these, and Huber weights."""
    points = rotated(start, turn) + shift
    nearest = nominal.nearest(points)
    jacobian = motion_jacobian(points, nearest.normals)
    inside = (
        on_front & ~nearest.beyond & (nearest.arc_mm > END_MM) & (nearest.arc_mm < float(nominal.arc_mm[-1]) - END_MM)
    )
    weights = huber(nearest.deviation_mm, inside)
    return _Fit(turn, shift, points, nearest.deviation_mm, nearest.arc_mm, jacobian, weights, inside)


def rotated(points: FloatArray, turn: float) -> FloatArray:
    """Return points (..., 2) after a counter-clockwise rotation in radians."""
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


def motion_jacobian(points: FloatArray, normals: FloatArray) -> FloatArray:
    """Return derivatives (N, 4) of deviations with respect to rotation, shifts along x and z, and log size."""
    by_turn = -normals[:, 0] * points[:, 1] + normals[:, 1] * points[:, 0]
    return np.stack([by_turn, normals[:, 0], normals[:, 1], np.sum(normals * points, axis=1)], axis=1)


def huber(deviation: FloatArray, inside: BoolArray) -> FloatArray:
    """Return the Huber weights (N,) of deviations, based on a robust standard deviation."""
    size = np.abs(deviation)
    sigma = 1.4826 * float(np.median(size[inside])) if inside.any() else 1.0
    return np.minimum(1.0, HUBER_SIGMAS * max(sigma, 1e-9) / np.maximum(size, 1e-12))


def _covariance(
    jacobian: FloatArray, deviation: FloatArray, weights: FloatArray, independent_values: float
) -> FloatArray:
    """Return the covariance of the parameters for the given number of independent deviations."""
    count, parameters = jacobian.shape
    freedom = max(independent_values - parameters, 1.0)
    variance = float(np.sum(weights * deviation**2)) / count * independent_values / freedom
    normal = jacobian.T @ (weights[:, None] * jacobian)
    return np.asarray(np.linalg.pinv(normal) * variance * count / independent_values)


def _u_of_pose(jacobian: FloatArray, u: FloatArray, weights: FloatArray) -> FloatArray:
    """Return each point's standard uncertainty due to the pose, from the uncertainties of the edges."""
    inverse = np.linalg.pinv(jacobian.T @ (weights[:, None] * jacobian))
    noise = jacobian.T @ ((weights * u)[:, None] ** 2 * jacobian)
    covariance = inverse @ noise @ inverse
    return np.asarray(np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", jacobian, covariance, jacobian), 0.0)))


def _after_registration(column: FloatArray, jacobian: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the part of a change of the deviations (N,) that remains after a rotation and a shift."""
    normal = jacobian.T @ (weights[:, None] * jacobian)
    return np.asarray(column - jacobian @ (np.linalg.pinv(normal) @ (jacobian.T @ (weights * column))))


def _moved(pose: Pose, fit: _Fit) -> Pose:
    """Return the pose of the design after the rigid motion of the points."""
    c, s = math.cos(fit.turn), math.sin(fit.turn)
    inverse_rotation = np.array([[c, -s], [s, c]])  # rotates row vectors back
    axis = pose.direction_px(np.array([0.0, 1.0]) @ inverse_rotation)
    angle = math.degrees(math.atan2(-axis[0], -axis[1])) % 360.0
    x, y = pose.to_px(-fit.shift @ inverse_rotation).tolist()
    return replace(pose, rotation_deg=angle, origin_px=(x, y))
