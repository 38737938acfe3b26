"""Lenses with an analytic shape: the Cartesian oval, and the flat face of the stem.

:class:`OvalLens` focuses the emitter to one point without aberration; :class:`FlatFace` is the sensor without a lens.
"""

import math
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from solen.curve import CartesianOval, Segment, check_numbers
from solen.errors import DesignError
from solen.lens.base import CurvedLens, Lens
from solen.plane import Point, unit
from solen.refraction import refracted
from solen.results import reported


class FlatFace(Lens, eq=True):
    """No lens: a flat face at the stem's base."""

    shape_name: ClassVar[str] = "none"

    distance_mm: float
    half_width_mm: float

    def __post_init__(self) -> None:
        _check_lengths(self)

    @property
    def front(self) -> Segment:
        """The face from its left edge to its right edge, with the vertex at the origin."""
        return Segment((-self.half_width_mm, 0.0), (self.half_width_mm, 0.0))

    @property
    def depth_mm(self) -> float:
        """Distance from the vertex to the plane of the edges: 0, because the face is flat."""
        return 0.0


class OvalLens(CurvedLens, eq=True):
    """Cartesian oval n1 |P − F1| + n2 |P − F2| = n1 s + n2 s': every incident ray from F1 is refracted to F2.

    The curve is from R. Descartes, La Géométrie (1637), book II; see O. N. Stavroudis, The Optics of Rays, Wave Fronts
    and Caustics (1972).

    Parameters
    ----------
    distance_mm
        s, from the emitter F1 to the vertex.
    focus_mm
        s', from the vertex to the focus F2 inside the material.
    half_width_mm
        Half the lens's width; `DesignError` is raised beyond `tangency`, where the oval is hidden from the emitter.
    design_index
        n2, the index for which the oval is computed.
    outside_index
        n1, the index in front of the lens.
    """

    shape_name: ClassVar[str] = "cartesian-oval"

    distance_mm: float
    focus_mm: float
    half_width_mm: float
    design_index: float
    outside_index: float = 1.0

    def __post_init__(self) -> None:
        self._check_signs()
        if not self.half_width_mm < self.tangency_half_width_mm:
            self._refuse_width(self.tangency_half_width_mm)

    @cached_property
    def front(self) -> CartesianOval:
        """The face from its left edge to its right edge, with the vertex at the origin."""
        edge_deg = self.acceptance_deg
        return self._oval(edge_deg, -edge_deg)

    @cached_property
    def depth_mm(self) -> float:
        """Distance from the vertex to the plane of the edges."""
        return float(self.z_mm(self.half_width_mm))

    def z_mm(self, x_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the profile z(x) at positions |x| <= half width; the residual of the oval is below 1e-12 mm.

        Newton's method starts on the tangent plane at the vertex, which is outside the oval, and proceeds along z. The
        equation is convex along any line, so the iteration cannot jump to the second root behind the front.
        """
        x = np.abs(np.asarray(x_mm, dtype=float))
        if not np.all(x <= self.half_width_mm):
            raise DesignError(
                "x_mm", value=float(np.max(x)), limit=f"must be within {self.half_width_mm} mm of the axis"
            )
        n1, n2, s, f = self.outside_index, self.design_index, self.distance_mm, self.focus_mm
        z = np.zeros_like(x)
        for _ in range(60):
            to_object, to_image = np.hypot(z + s, x), np.hypot(f - z, x)
            square = x * x + z * z
            value = n1 * (square + 2 * s * z) / (to_object + s) + n2 * (square - 2 * f * z) / (to_image + f)
            step = value / (n1 * (z + s) / to_object - n2 * (f - z) / to_image)
            z = z - step
            if np.all(np.abs(step) <= 1e-15 * (1.0 + z)):
                break
        return np.asarray(z)

    def slope(self, x_mm: ArrayLike) -> NDArray[np.float64]:
        """Return dz/dx of the profile, dimensionless."""
        fx, fz, *_ = self._derivatives(np.asarray(x_mm, dtype=float))
        return np.asarray(-fx / fz)

    def curvature_per_mm(self, x_mm: ArrayLike) -> NDArray[np.float64]:
        """Return the signed curvature z''/(1 + z'²)^(3/2) of the profile: positive if convex to the emitter."""
        fx, fz, fxx, fxz, fzz = self._derivatives(np.asarray(x_mm, dtype=float))
        return np.asarray(-(fxx * fz**2 - 2 * fxz * fx * fz + fzz * fx**2) / (np.hypot(fx, fz) ** 3) * np.sign(fz))

    @reported
    def tangency_half_width_mm(self) -> float:
        """Half width at which a ray from the emitter is tangent to the oval: the upper limit."""
        return tangency(self.outside_index, self.design_index, self.distance_mm, self.focus_mm)[1]

    @reported
    def vertex_radius_mm(self) -> float:
        """Radius of curvature at the vertex, (n2 − n1)/(n1/s + n2/s')."""
        n1, n2 = self.outside_index, self.design_index
        return (n2 - n1) / (n1 / self.distance_mm + n2 / self.focus_mm)

    @reported
    def na_object(self) -> float:
        """Numerical aperture on the emitter's side, n1 sin of the acceptance angle."""
        return self.outside_index * math.sin(math.radians(self.acceptance_deg))

    @reported
    def na_image(self) -> float:
        """Numerical aperture on the side of the focus, n2 sin of the edge ray's angle there."""
        return self.design_index * math.sin(math.atan2(self.half_width_mm, self.focus_mm - self.depth_mm))

    @reported
    def magnification(self) -> float:
        """Paraxial size of the focal spot relative to that of the emitter, (s'/s)(n1/n2); the image is inverted."""
        return (self.focus_mm / self.distance_mm) * (self.outside_index / self.design_index)

    @reported
    def edge_slope(self) -> float:
        """dz/dx of the profile at its right edge."""
        return float(self.slope(self.half_width_mm))

    @reported
    def edge_curvature_per_mm(self) -> float:
        """Curvature of the profile at its edges."""
        return float(self.curvature_per_mm(self.half_width_mm))

    def paraxial_focus_mm(self, index: float) -> float | None:
        """Return the paraxial focus in a material of ``index``, mm behind the vertex; None if rays diverge.

        n/s'' = (n − n1)/R − n1/s with R the vertex radius.
        """
        n1 = self.outside_index
        vergence = (index - n1) / self.vertex_radius_mm - n1 / self.distance_mm
        return index / vergence if vergence > 0.0 else None

    def marginal_focus_mm(self, index: float) -> float | None:
        """Return the focus of the edge ray in a material of ``index``, mm behind the vertex; None if there is none."""
        edge: Point = (self.half_width_mm, self.depth_mm)
        ray = unit((edge[0], edge[1] + self.distance_mm))
        normal = self.front.normal_at(edge)
        inside = refracted(ray, (-normal[0], -normal[1]), self.outside_index, index)
        if inside is None or inside[0] >= 0.0:
            return None
        return edge[1] - edge[0] * inside[1] / inside[0]

    def _oval(self, from_deg: float, to_deg: float) -> CartesianOval:
        return CartesianOval(
            (0.0, 0.0),
            (0.0, 1.0),
            self.outside_index,
            self.design_index,
            self.distance_mm,
            self.focus_mm,
            from_deg,
            to_deg,
        )

    def _derivatives(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return first and second derivatives of the oval's equation on its front: Fx, Fz, Fxx, Fxz, Fzz."""
        z = self.z_mm(x)
        parts = []
        for n, dz in ((self.outside_index, z + self.distance_mm), (self.design_index, z - self.focus_mm)):
            r = np.hypot(x, dz)
            parts.append((n * x / r, n * dz / r, n * dz**2 / r**3, -n * x * dz / r**3, n * x**2 / r**3))
        return tuple(np.asarray(a + b) for a, b in zip(*parts, strict=True))

    def _check_signs(self) -> None:
        _check_lengths(self)
        check_numbers("lens.focus_mm", self.focus_mm)
        check_numbers("lens.design_index", self.design_index, self.outside_index)
        if not self.focus_mm > 0.0:
            raise DesignError("lens.focus_mm", value=self.focus_mm, limit="must be above 0", remedy="give it in mm")
        if not self.outside_index >= 1.0:
            raise DesignError("outside_index", value=self.outside_index, limit="must be at least 1")
        if not self.design_index > self.outside_index:
            raise DesignError(
                "lens.design_index",
                value=self.design_index,
                limit=f"must be above {self.outside_index:g}, the index in front of the lens, for the lens to focus",
                remedy="increase it",
            )

    def _refuse_width(self, limit_mm: float) -> None:
        n1, n2, s = self.outside_index, self.design_index, self.distance_mm
        nearest_mm = nearest_focus_mm(n1, n2, s, self.half_width_mm)
        angle_deg, _ = tangency(n1, n2, s, nearest_mm)
        least_depth_mm = self.half_width_mm / math.tan(math.radians(angle_deg)) - s
        if self.focus_mm <= least_depth_mm:
            raise DesignError(
                "lens.focus_mm",
                value=self.focus_mm,
                limit=f"must be behind the lens, which is at least {least_depth_mm:.2f} mm deep at a "
                f"half width of {self.half_width_mm:g} mm",
                remedy=f"set lens.focus_mm above {nearest_mm:.2f} or lens.half_width_mm below {limit_mm:.3f}",
            )
        raise DesignError(
            "lens.half_width_mm",
            value=self.half_width_mm,
            limit=f"must be below {limit_mm:.3f} mm, where a ray from the emitter is tangent to the oval",
            remedy=f"reduce lens.half_width_mm, set lens.focus_mm above {nearest_mm:.2f} or "
            "increase emitter.distance_mm",
        )


def _check_lengths(lens: Lens) -> None:
    """Reject a distance or a width that is not a positive number."""
    for name, value in (("emitter.distance_mm", lens.distance_mm), ("lens.half_width_mm", lens.half_width_mm)):
        check_numbers(name, value)
        if not value > 0.0:
            raise DesignError(name, value=value, limit="must be above 0", remedy="give it in mm")


def tangency(n1: float, n2: float, distance_mm: float, focus_mm: float) -> tuple[float, float]:
    """Return the angle in degrees and the half width in mm at which a ray from the emitter is tangent to the oval.

    Seen from F1, the oval's equation is quadratic in the distance; where its discriminant vanishes, the two roots meet.
    """
    c, d = n1 * distance_mm + n2 * focus_mm, distance_mm + focus_mm
    a = n2**2 - n1**2
    rest = (n2 - n1) * distance_mm * (n2 * d + c)
    cos_angle = min((n1 * c + math.sqrt(a * rest)) / (n2**2 * d), 1.0)
    radius_mm = math.sqrt(rest / a)
    return math.degrees(math.acos(cos_angle)), radius_mm * math.sqrt(1.0 - cos_angle**2)


def nearest_focus_mm(n1: float, n2: float, distance_mm: float, half_width_mm: float) -> float:
    """Return the nearest focus in mm at which an oval of this half width ends before tangency, to a relative 1e-6."""
    low, high = 1e-6, 1.0
    while tangency(n1, n2, distance_mm, high)[1] <= half_width_mm:
        low, high = high, 2.0 * high
    while high - low > 1e-6 * high:
        middle = 0.5 * (low + high)
        if tangency(n1, n2, distance_mm, middle)[1] <= half_width_mm:
            low = middle
        else:
            high = middle
    return high
