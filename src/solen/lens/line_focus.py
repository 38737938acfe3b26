"""The smooth lens that refracts every ray from the emitter through one line.

Every path from the emitter E to the surface and on to a wavefront behind it has the same optical length,
|P − E| + n·D(P) = const. D determines the divergence of the light along y. With ρ = √(x² + (s' − z)²), the distance
from the focal line, D = ρ makes the wavefronts cylinders about that line: the light is collimated in y. A wavefront at
a constant distance from a circle of radius ρ₀ about the line, D = −√((ρ − ρ₀)² + y²), makes the light diverge in y as
if it came from that circle: from a virtual focus ρ₀ − s' in front of the vertex. In both cases ∇D has no azimuthal
component about the line, so every ray meets the line. At y = 0 both equal ρ up to a constant: the section at mid-height
is the Cartesian oval.
"""

import math
from functools import cached_property
from typing import ClassVar

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_range
from solen.errors import DesignError
from solen.lens.face import Face
from solen.lens.in_space import LensInSpace
from solen.ranks import warning
from solen.results import reported

SCAN, HALVINGS, STEPS = 64, 14, 5
"""Search for the face along z: number of sampled points, bisections of an interval, and steps of Newton's method."""
MAX_FOCUS_MM, FOCUS_TOLERANCE_MM = 1e4, 1e-3
"""Largest distance in front of the vertex at which a virtual focus is searched for, and the tolerance of the search."""
MIN_CLEARANCE_MM = 0.02
"""Smallest distance from the virtual focus for which the bound of the second derivative holds."""
DEPTH_ROUNDING_MM = 1e-15
"""Depth that rounding alone may cause."""
LENGTH_ROUNDING_MM = 1e-9
"""Difference in optical length that rounding alone may cause."""


class LineFocusLens(LensInSpace, eq=True):
    """Surface |P − E| + n·D(ρ, y) = const with a line focus at x = 0, z = s'.

    Parameters
    ----------
    y_focus_mm
        Distance in front of the vertex from which the light in the body seems to diverge along y; infinite if
        collimated.
    """

    shape_name: ClassVar[str] = "line-focus"

    y_focus_mm: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isinf(self.y_focus_mm):
            check_range("lens.y_focus_mm", self.y_focus_mm, above=0.0)
        self._check_face()

    @classmethod
    def confining(cls, lens: "LineFocusLens") -> "LineFocusLens":
        """Return the lens with the nearest virtual focus for which top and bottom totally reflect the light.

        A ray with β = n·d_y is totally reflected if β² < n² − 1; only rays from the emitter's centre are considered.
        """
        index = lens.design_index
        if index <= math.sqrt(2.0):
            limit = f"requires an index above √2, for total reflection at top and bottom, but the index is {index:g}"
            remedy = 'set lens.y_focus_mm to "collimated"'
            raise DesignError("lens.y_focus_mm", value="body", limit=limit, remedy=remedy)
        low, high = 1e-3, 1.0
        while not lens._confines(high):
            low, high = high, 2.0 * high
            if high > MAX_FOCUS_MM:
                return lens
        while high - low > FOCUS_TOLERANCE_MM:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if lens._confines(middle) else (middle, high)
        return cls(**{**_fields(lens), "y_focus_mm": high})

    def z_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return z(x, y) of the face: the first z of equal optical length, to 1e-13 mm; NaN where there is no face."""
        x, y = np.broadcast_arrays(np.abs(x_mm), np.abs(y_mm))
        planes = np.linspace(-self.distance_mm, self.focus_mm, SCAN + 1)
        first = np.zeros(x.shape, dtype=int)
        for i, plane in enumerate(planes):
            first = np.where((first == 0) & (self.residual_mm(x, y, plane) < 0.0), i, first)
            if first.all():
                break
        low, high = planes[np.maximum(first - 1, 0)], planes[first]
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            inside = self.residual_mm(x, y, middle) < 0.0
            low, high = np.where(inside, low, middle), np.where(inside, middle, high)
        z = 0.5 * (low + high)
        for _ in range(STEPS):
            z = np.clip(z - self.residual_mm(x, y, z) / self._gradient(x, y, z)[1], low, high)
        # not at the virtual focus, where the optical length jumps
        converged = np.abs(self.residual_mm(x, y, z)) < LENGTH_ROUNDING_MM
        z = np.where(np.abs(z) < DEPTH_ROUNDING_MM, 0.0, z)
        return np.where((first > 0) & converged & (self._derivative_along_ray(x, y, z) < 0.0), z, np.nan)

    def slope_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return dz/dx of the face at lateral positions and heights, from the gradient of the optical length."""
        x, y = np.broadcast_arrays(x_mm, y_mm)
        z = self.z_at(x, y)
        along_x, along_z = self._gradient(x, y, z)
        return np.asarray(-along_x / along_z)

    def residual_mm(self, x: FloatArray, y: FloatArray, z: FloatArray | float) -> FloatArray:
        """Return the optical length from the emitter minus that through the vertex: positive before the surface."""
        from_line = np.hypot(x, self.focus_mm - z)
        along = from_line - self.focus_mm
        if not math.isinf(self.y_focus_mm):
            ring = self.focus_mm + self.y_focus_mm
            along = np.where(from_line < ring, self.y_focus_mm - np.hypot(from_line - ring, y), np.inf)
        from_emitter = np.sqrt(x * x + y * y + (z + self.distance_mm) ** 2)
        return np.asarray(from_emitter - self.distance_mm + self.design_index * along)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings that concern the lens's response."""
        if self.design_index <= math.sqrt(2.0) or self._max_dy <= _max_confined_dy(self.design_index):
            return ()
        leak = "light from the emitter's centre leaks through top and bottom, because it meets these faces too steeply"
        remedy = 'set lens.y_focus_mm to "body", the nearest focus that confines the light'
        return (warning(f"lens.y_focus_mm = {self.y_focus_mm:.4g}: {leak}; {remedy}"),)

    @reported
    def y_focus(self) -> str:
        """Divergence of the light along y: ``collimated``, or the point from which the light seems to diverge."""
        if math.isinf(self.y_focus_mm):
            return "collimated"
        return f"as from {self.y_focus_mm:.4g} mm before the vertex"

    @property
    def remedy(self) -> str:
        """Remedy if no such face exists."""
        return super().remedy if math.isinf(self.y_focus_mm) else f"increase lens.y_focus_mm, or {super().remedy}"

    @property
    def face(self) -> Face:
        """Numerical description of the face for the tracer."""
        half, no_profiles = self.half_height_mm, np.empty((0, 0))
        ring = self.focus_mm + self.y_focus_mm
        sizes = (self.distance_mm, self.focus_mm, self.design_index, ring, self.half_width_mm, half)
        depths = (self.depth_mm, self.nearest_mm, self.deepest_mm)
        edges = np.array([-half, half])
        return Face(*sizes, *depths, edges, no_profiles, no_profiles, self._max_bend, 0.0, 0.0, 0.0, 0.0)

    @property
    def _max_bend(self) -> float:
        """Upper bound for the second derivative of n·√((ρ − ρ₀)² + y²) along a line.

        It is n divided by the minimum distance from the circle.
        """
        farthest = math.hypot(self.half_width_mm, self.focus_mm - self.nearest_mm)
        return self.design_index / max(self.focus_mm + self.y_focus_mm - farthest, MIN_CLEARANCE_MM)

    @cached_property
    def _max_dy(self) -> float:
        """Largest d_y in the body among rays from the emitter's centre."""
        x, y, z = self.sampled_face
        if math.isinf(self.y_focus_mm):
            return 0.0
        from_ring = self.focus_mm + self.y_focus_mm - np.hypot(x, self.focus_mm - z)
        return float(np.max(y / np.hypot(from_ring, y)))

    def _confines(self, y_focus_mm: float) -> bool:
        """Return whether a surface with this virtual focus exists, and whether top and bottom confine its light."""
        try:
            other = LineFocusLens(**{**_fields(self), "y_focus_mm": y_focus_mm})
        except DesignError:
            return False
        return other._max_dy <= _max_confined_dy(self.design_index)

    def _derivative_along_ray(self, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """Return the derivative of the residual along the emitter's ray: negative if the surface faces the emitter."""
        from_line = np.hypot(x, self.focus_mm - z)
        from_emitter = np.sqrt(x * x + y * y + (z + self.distance_mm) ** 2)
        by_line, by_y = self._by_line(from_line, y)
        dot_product = by_line * (x * x - (self.focus_mm - z) * (z + self.distance_mm)) / from_line + by_y * y
        return np.asarray(1.0 + self.design_index * dot_product / from_emitter)

    def _gradient(self, x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of the residual with respect to x and z."""
        from_line = np.hypot(x, self.focus_mm - z)
        from_emitter = np.sqrt(x * x + y * y + (z + self.distance_mm) ** 2)
        scale = self.design_index * self._by_line(from_line, y)[0] / from_line
        along_z = (z + self.distance_mm) / from_emitter - scale * (self.focus_mm - z)
        return np.asarray(x / from_emitter + scale * x), np.asarray(along_z)

    def _by_line(self, from_line: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives of D with respect to the distance from the focal line and to y."""
        if math.isinf(self.y_focus_mm):
            return np.ones_like(from_line), np.zeros_like(from_line)
        from_ring = self.focus_mm + self.y_focus_mm - from_line
        with np.errstate(invalid="ignore"):  # undefined at the virtual focus itself
            return from_ring / np.hypot(from_ring, y), -y / np.hypot(from_ring, y)


def _max_confined_dy(index: float) -> float:
    """Return the largest d_y for total reflection at top and bottom of a body of this index in air."""
    return math.sqrt(1.0 - 1.0 / index**2)


def _fields(lens: LineFocusLens) -> dict[str, float]:
    names = ("distance_mm", "focus_mm", "half_width_mm", "design_index", "outside_index", "thickness_mm", "y_focus_mm")
    return {name: getattr(lens, name) for name in names}
