"""A target face with which a print is compared: equidistant points, their normals, and zeros of a field along them.

A deviation is measured along the normal of the designed face; it is positive for excess material and negative for
missing material. A print model has a field that is positive in cured resin (the logarithm of dose over critical dose);
along a normal from the inside to the outside, its first zero is the printed wall.

`Target.of` samples a face, `exits_um` finds the zeros of a field, and `Deviation` is the result.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Curve
from solen.errors import DataError
from solen.plane import Point
from solen.results import HIDDEN, reported

Field = Callable[[FloatArray], FloatArray]
"""Function of points (..., 2) in mm that is positive in cured resin."""

_LENGTH_POINTS = 4001  # with which the length along a face is computed
_BISECTIONS = 30
_BATCH = 2_000_000  # points evaluated at a time
FIRST_REACH_UM, MAX_REACH_UM = 200.0, 1600.0
"""First and maximum distance from the target at which a wall is searched for."""


@dataclass(frozen=True, eq=False)
class Target:
    """Points of a target face.

    Attributes
    ----------
    points_mm
        Shape (N, 2), equidistant along the face, in its direction.
    outward
        Unit normals (N, 2) away from the material.
    along_mm
        Length of the face up to each point, (N,).
    centre
        Centre of the shrinkage: the midpoint of the face.
    """

    points_mm: FloatArray
    outward: FloatArray
    along_mm: FloatArray
    centre: Point

    @classmethod
    def of(cls, curve: Curve, points: int) -> "Target":
        """Return points of a face with the material on its left."""
        u = np.linspace(0.0, 1.0, _LENGTH_POINTS)
        dense = curve.points(u)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(dense, axis=0).T))])
        parameters = np.interp(np.linspace(0.0, length[-1], points), length, u)
        parameters[0], parameters[-1] = 0.0, 1.0
        tangent = curve.velocities(parameters)
        tangent /= np.hypot(*tangent.T)[:, None]
        outward = np.column_stack([tangent[:, 1], -tangent[:, 0]])
        return cls(curve.points(parameters), outward, np.interp(parameters, u, length), curve.middle_point)

    def displaced(self, offset_um: FloatArray) -> FloatArray:
        """Return the points (N, 2), displaced along the normals by offsets (N,)."""
        return np.asarray(self.points_mm + 1e-3 * np.asarray(offset_um)[:, None] * self.outward)


def exits_um(field: Field, target: Target, step_um: float) -> FloatArray:
    """Return offsets (N,) in µm at which a field falls to 0 along the normals of a target, from inside to outside.

    Parameters
    ----------
    field
        The field, which may be discontinuous.
    target
        The target face.
    step_um
        Step of the search along the normals; two sign changes within one step are missed.

    Raises
    ------
    DataError
        If the field has no zero within 1.6 mm, or is not positive inside.
    """
    reach = FIRST_REACH_UM
    while True:
        exits = _exits(field, target, reach, step_um)
        if not np.isnan(exits).any():
            return exits
        if reach >= MAX_REACH_UM:
            raise _no_wall(target, exits)
        reach *= 2.0


def _exits(field: Field, target: Target, reach_um: float, step_um: float) -> FloatArray:
    """Return the zeros within a distance of the target; NaN if there is none."""
    t = np.arange(-reach_um, reach_um + step_um, step_um)
    low, high = np.full((2, len(target.points_mm)), np.nan)
    size = max(1, _BATCH // len(t))
    for start in range(0, len(low), size):
        batch = slice(start, start + size)
        points = target.points_mm[batch, None] + 1e-3 * t[:, None] * target.outward[batch, None]
        is_cured = field(points) > 0.0
        exits = is_cured[:, :-1] & ~is_cured[:, 1:]
        # cured resin far outside is another wall, and uncured resin far inside is behind the part
        first, has_exit = np.argmax(exits, axis=1), exits.any(axis=1)
        low[batch], high[batch] = np.where(has_exit, t[first], np.nan), np.where(has_exit, t[first + 1], np.nan)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        inside = field(target.displaced(np.nan_to_num(middle))) > 0.0
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.asarray(0.5 * (low + high))


def _no_wall(target: Target, exits: FloatArray) -> DataError:
    x, z = target.points_mm[int(np.flatnonzero(np.isnan(exits))[0])].tolist()
    limit = f"has no wall within {MAX_REACH_UM:g} µm of the designed lens at x = {x:.3g}, z = {z:.3g} mm"
    remedy = "check exposure_s, Ec_mJ_per_cm2, sigma_um and halo_um of the process"
    return DataError("printed lens", limit=f"{limit}: the dose is too low or too high", remedy=remedy)


@dataclass(frozen=True, eq=False)
class Deviation:
    """Deviation of a printed face from the target, ``um`` (N,) along the normals, positive for excess material."""

    target: Target = field(metadata=HIDDEN)
    um: FloatArray = field(metadata=HIDDEN)

    @reported
    def rms_um(self) -> float:
        """RMS along the face."""
        return float(np.sqrt(np.mean(self.um**2)))

    @reported
    def mean_um(self) -> float:
        """Mean along the face."""
        return float(np.mean(self.um))

    @reported
    def largest_um(self) -> float:
        """Largest deviation, with its sign."""
        return float(self.um[self._worst])

    @reported
    def largest_at_mm(self) -> Point:
        """Position (x, z) of the largest deviation, on the target face."""
        x, z = self.target.points_mm[self._worst].tolist()
        return x, z

    @property
    def _worst(self) -> int:
        return int(np.argmax(np.abs(self.um)))

    @cached_property
    def shifted(self) -> tuple[float, "Deviation"]:
        """Translation along z in µm that minimises the deviation of the printed face, and the remaining form error."""
        cosine = self.target.outward[:, 1]
        shift = -float(self.um @ cosine / (cosine @ cosine))
        return shift, Deviation(self.target, self.um + shift * cosine)

    @property
    def points_mm(self) -> FloatArray:
        """Points of the printed face, (N, 2)."""
        return self.target.displaced(self.um)
