"""Laying a measured outline on its design: the rotation and the shift that leave the least, and what is left.

The idea: a picture says nothing about where the part was put, so rotation and shift are free; its scale is not, or an
error of size could never be seen. The distances of the points from the front, along its normal, are made small by
Gauss and Newton's method with Huber's weights (P. J. Huber, Ann. Math. Statist. 35, 73, 1964), so that a speck that
passed for an edge counts little. What a print's distances are is form, not noise: neighbours agree. Uncertainties
therefore count as many independent values as the distances' own correlation leaves, not as many as there are pixels.

The interface: `register` gives a `Registration`; `effective_number` the number of independent values.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solen.arrays import BoolArray, FloatArray
from solen.metrology.find import Pose
from solen.metrology.ideal import Ideal

ROUNDS = 60
HUBER = 2.5
"""Distances beyond so many robust standard deviations count less."""
SETTLED_MM = 1e-8
END_MM = 0.03
"""The front's ends are corners, which no step along a normal fits: they are left out on this length."""


@dataclass(frozen=True)
class Registration:
    """A measured outline laid on a design.

    Attributes
    ----------
    pose
        Where the design lies in the picture.
    points_mm
        Shape (N, 2): the measured points in lens coordinates, in their order along the front.
    off_um
        Shape (N,): how far they stand out of the design, µm.
    u_um
        Shape (N,): standard uncertainty of that: edge, registration and scale.
    arc_mm
        Shape (N,): where along the front.
    used
        Which of the points that were given these are.
    u_rotation_deg, u_shift_um
        Standard uncertainties of the pose, shift along x and z.
    by_scale_um
        Shape (N,): by how much ``off_um`` grows where the true scale is greater by the factor e, after registration.
    scale_factor, u_scale_factor
        By what factor the outline would have to grow to lie best on the design, and its standard uncertainty.
    independent
        Number of independent values among the distances.
    """

    pose: Pose
    points_mm: FloatArray
    off_um: FloatArray
    u_um: FloatArray
    arc_mm: FloatArray
    used: NDArray[np.intp]
    u_rotation_deg: float
    u_shift_um: tuple[float, float]
    by_scale_um: FloatArray
    scale_factor: float
    u_scale_factor: float
    independent: float
    weights: FloatArray = field(repr=False)

    @property
    def rms_um(self) -> float:
        """Root of the mean square of the distances."""
        return float(np.sqrt(np.mean(self.off_um**2)))

    @property
    def robust_um(self) -> float:
        """Standard deviation of the distances by their median, which few points far out do not change."""
        return 1.4826 * float(np.median(np.abs(self.off_um)))


@dataclass(frozen=True)
class _Fit:
    """Motion of the points in lens coordinates p -> (1 + e) R(turn) p + shift, and where they come to lie."""

    turn: float
    shift: FloatArray
    grown: float
    points: FloatArray
    off: FloatArray
    arc: FloatArray
    jacobian: FloatArray
    weights: FloatArray
    inside: BoolArray


def register(
    points_px: FloatArray, u_px: FloatArray, pose: Pose, ideal: Ideal, u_scale: float = 0.0, *, scaled: bool = False
) -> Registration:
    """Lay points of a picture on a design.

    Parameters
    ----------
    points_px
        Shape (N, 2), (x, y) in the picture, of the front and perhaps beyond it.
    u_px
        Shape (N,): standard uncertainties along the normal.
    pose
        A first one, within about a tenth of the lens's width.
    ideal
        The design.
    u_scale
        Relative standard uncertainty of the scale.
    scaled
        Whether the scale is fitted as well, and the points grown by it.
    """
    start = pose.to_mm(points_px)
    rigid = _fit(start, ideal, scaled=False)
    free = _fit(start, ideal, scaled=True, begin=rigid)
    fit = free if scaled else rigid
    order = np.flatnonzero(fit.inside)
    order = order[np.argsort(fit.arc[order], kind="stable")]
    off, weights = fit.off[order], fit.weights[order]
    jacobian = fit.jacobian[order]
    independent = effective_number(off)
    spread = _covariance(jacobian[:, :3], off, weights, independent)
    spread_free = _covariance(free.jacobian[free.inside], free.off[free.inside], free.weights[free.inside], independent)
    by_scale = _left(jacobian[:, 3], jacobian[:, :3], weights)
    u_edge = u_px[order] * pose.um_per_px / 1e3
    u = np.sqrt(u_edge**2 + _of_pose(jacobian[:, :3], u_edge, weights) ** 2 + (by_scale * u_scale) ** 2)
    return Registration(
        pose=_moved(pose, fit),
        points_mm=fit.points[order],
        off_um=1e3 * off,
        u_um=1e3 * u,
        arc_mm=fit.arc[order],
        used=order,
        u_rotation_deg=math.degrees(math.sqrt(spread[0, 0])),
        u_shift_um=(1e3 * math.sqrt(spread[1, 1]), 1e3 * math.sqrt(spread[2, 2])),
        by_scale_um=1e3 * by_scale,
        scale_factor=1.0 + free.grown,
        u_scale_factor=math.sqrt(spread_free[3, 3]),
        independent=independent,
        weights=weights,
    )


def effective_number(values: FloatArray) -> float:
    """Number of independent values that tell as much about a mean square as correlated ones in their order do.

    N over 1 + 2 Σ ρ_k², ρ_k the correlation of values k places apart, up to the first that is not positive (see
    G. V. Bayley and J. M. Hammersley, J. R. Stat. Soc. Suppl. 8, 184, 1946, for variances).
    """
    count = len(values)
    if count < 4:
        return float(count)
    size = 1 << (2 * count - 1).bit_length()
    spectrum = np.fft.rfft(values, size)
    correlation = np.fft.irfft(spectrum * np.conj(spectrum), size)[:count]
    if correlation[0] <= 0.0:
        return float(count)
    rho = correlation / correlation[0]
    ends = np.flatnonzero(rho <= 0.0)
    stop = int(ends[0]) if len(ends) else count
    return float(max(count / (1.0 + 2.0 * np.sum(rho[1:stop] ** 2)), 1.0))


def _fit(start: FloatArray, ideal: Ideal, *, scaled: bool, begin: _Fit | None = None) -> _Fit:
    """The motion that makes the points' distances least."""
    turn, shift, grown = (0.0, np.zeros(2), 0.0) if begin is None else (begin.turn, begin.shift, begin.grown)
    count = 4 if scaled else 3
    fit = _placed(start, ideal, turn, shift, grown)
    for _ in range(ROUNDS):
        use = fit.inside
        jacobian, weights = fit.jacobian[use][:, :count], fit.weights[use]
        normal = jacobian.T @ (weights[:, None] * jacobian)
        step = -np.linalg.solve(normal + 1e-12 * np.eye(count), jacobian.T @ (weights * fit.off[use]))
        c, s = math.cos(step[0]), math.sin(step[0])
        factor = 1.0 + (float(step[3]) if scaled else 0.0)
        turn, grown = turn + float(step[0]), (1.0 + grown) * factor - 1.0
        shift = factor * np.array([c * shift[0] - s * shift[1], s * shift[0] + c * shift[1]]) + step[1:3]
        fit = _placed(start, ideal, turn, shift, grown)
        if np.abs(step).max() < SETTLED_MM:
            break
    return fit


def _placed(start: FloatArray, ideal: Ideal, turn: float, shift: FloatArray, grown: float) -> _Fit:
    """Points after a motion: their distances, derivatives by turn, shift and growth, and Huber's weights."""
    c, s = math.cos(turn), math.sin(turn)
    points = (1.0 + grown) * start @ np.array([[c, s], [-s, c]]) + shift
    feet = ideal.feet(points)
    n = feet.normals
    by_turn = -n[:, 0] * points[:, 1] + n[:, 1] * points[:, 0]
    jacobian = np.stack([by_turn, n[:, 0], n[:, 1], np.sum(n * points, axis=1)], axis=1)
    inside = ~feet.beyond & (feet.arc_mm > END_MM) & (feet.arc_mm < float(ideal.arc_mm[-1]) - END_MM)
    sigma = 1.4826 * float(np.median(np.abs(feet.off_mm[inside]))) if inside.any() else 1.0
    weights = np.minimum(1.0, HUBER * max(sigma, 1e-9) / np.maximum(np.abs(feet.off_mm), 1e-12))
    return _Fit(turn, shift, grown, points, feet.off_mm, feet.arc_mm, jacobian, weights, inside)


def _covariance(jacobian: FloatArray, off: FloatArray, weights: FloatArray, independent: float) -> FloatArray:
    """Covariance of the parameters with as many independent distances as there are."""
    count, parameters = jacobian.shape
    freedom = max(independent - parameters, 1.0)
    variance = float(np.sum(weights * off**2)) / count * independent / freedom
    normal = jacobian.T @ (weights[:, None] * jacobian)
    return np.asarray(np.linalg.pinv(normal) * variance * count / independent)


def _of_pose(jacobian: FloatArray, u: FloatArray, weights: FloatArray) -> FloatArray:
    """Standard uncertainty at each point that the edges' own uncertainties give the pose."""
    inverse = np.linalg.pinv(jacobian.T @ (weights[:, None] * jacobian))
    noise = jacobian.T @ ((weights * u)[:, None] ** 2 * jacobian)
    spread = inverse @ noise @ inverse
    return np.asarray(np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", jacobian, spread, jacobian), 0.0)))


def _left(column: FloatArray, jacobian: FloatArray, weights: FloatArray) -> FloatArray:
    """What of a change of all distances no turn and no shift can take away."""
    normal = jacobian.T @ (weights[:, None] * jacobian)
    return np.asarray(column - jacobian @ (np.linalg.pinv(normal) @ (jacobian.T @ (weights * column))))


def _moved(pose: Pose, fit: _Fit) -> Pose:
    """Pose of the design after the motion of the points; a growth changes the size of a pixel."""
    c, s = math.cos(fit.turn), math.sin(fit.turn)
    back = np.array([[c, -s], [s, c]])  # rows times this turn back
    vertex = (-fit.shift / (1.0 + fit.grown))[None, :] @ back
    axis = pose.direction_px(np.array([[0.0, 1.0]]) @ back)[0]
    angle = math.degrees(math.atan2(-axis[0], -axis[1])) % 360.0
    x, y = pose.to_px(vertex)[0]
    return Pose(angle, (float(x), float(y)), pose.um_per_px * (1.0 + fit.grown), pose.mirrored)
