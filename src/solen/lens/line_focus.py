"""The lens that takes every ray of the emitter through one line, and is smooth.

Every way from the emitter E to the surface and on to a wave front behind it has the same optical length,
|P − E| + n·D(P) = const. D decides what becomes of the light along y. With ρ = √(x² + (s' − z)²), the distance from
the focal line, D = ρ makes the wave fronts cylinders about that line: the light is collimated in y. A front at a
constant distance from a circle of radius ρ₀ about the line, D = −√((ρ − ρ₀)² + y²), lets it diverge in y as if it came
from that circle: from a virtual focus ρ₀ − s' before the vertex. Either way ∇D has no part round the line, so every ray
meets it. At y = 0 both are D = ρ but for a constant: the middle section is the Cartesian oval.
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
from solen.ranks import look_at
from solen.results import reported

SCAN, HALVINGS, STEPS = 64, 14, 5
"""Places along z at which the face is sought, halvings of a stretch, and steps of Newton's method after them."""
FARTHEST_MM, CLOSENESS_MM = 1e4, 1e-3
"""How far before the vertex a virtual focus is sought, and how closely."""
LEAST_MM = 0.02
"""Least distance from the virtual focus at which the face is looked for with care."""
ZERO_MM = 1e-15
"""Depth that is rounding alone."""
END_MM = 1e-9
"""Difference of optical lengths that may be rounding alone."""


class LineFocusLens(LensInSpace, eq=True):
    """Surface |P − E| + n·D(ρ, y) = const with a line focus at x = 0, z = s'.

    Parameters
    ----------
    y_focus_mm
        How far before the vertex the light in the body seems to come from along y: infinite for collimated light.
    """

    shape_name: ClassVar[str] = "line-focus"

    y_focus_mm: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        if not math.isinf(self.y_focus_mm):
            check_range("lens.y_focus_mm", self.y_focus_mm, above=0.0)
        self._check_face()

    @classmethod
    def keeping_light(cls, lens: "LineFocusLens") -> "LineFocusLens":
        """The lens of the nearest virtual focus whose light is totally reflected at top and bottom of the body.

        A ray with β = n·d_y stays between them as long as β² < n² − 1; the rays of the emitter's middle are meant.
        """
        index = lens.design_index
        if index <= math.sqrt(2.0):
            limit = "only above √2 do top and bottom totally reflect all light in the body"
            raise DesignError(
                "lens.y_focus_mm", value="body", limit=f"index {index:g}: {limit}", remedy='use "collimated"'
            )
        low, high = 1e-3, 1.0
        while not lens._keeps(high):
            low, high = high, 2.0 * high
            if high > FARTHEST_MM:
                return lens
        while high - low > CLOSENESS_MM:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if lens._keeps(middle) else (middle, high)
        return cls(**{**_fields(lens), "y_focus_mm": high})

    def z_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """See :meth:`solen.lens.in_space.LensInSpace.z_at`: the first z of the right optical length, to 1e-13 mm."""
        x, y = np.broadcast_arrays(np.abs(x_mm), np.abs(y_mm))
        planes = np.linspace(-self.distance_mm, self.focus_mm, SCAN + 1)
        first = np.zeros(x.shape, dtype=int)
        for number, plane in enumerate(planes):
            first = np.where((first == 0) & (self.residual_mm(x, y, plane) < 0.0), number, first)
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
        reached = np.abs(self.residual_mm(x, y, z)) < END_MM  # or else the length jumps there, at the virtual focus
        z = np.where(np.abs(z) < ZERO_MM, 0.0, z)
        return np.where((first > 0) & reached & (self._faces(x, y, z) < 0.0), z, np.nan)

    def slope_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """See :meth:`solen.lens.in_space.LensInSpace.slope_at`: by the gradient of the optical length."""
        x, y = np.broadcast_arrays(x_mm, y_mm)
        z = self.z_at(x, y)
        along_x, along_z = self._gradient(x, y, z)
        return np.asarray(-along_x / along_z)

    def residual_mm(self, x: FloatArray, y: FloatArray, z: FloatArray | float) -> FloatArray:
        """Optical length from the emitter less that over the vertex: above 0 before the surface."""
        from_line = np.hypot(x, self.focus_mm - z)
        along = from_line - self.focus_mm
        if not math.isinf(self.y_focus_mm):
            ring = self.focus_mm + self.y_focus_mm
            along = np.where(from_line < ring, self.y_focus_mm - np.hypot(from_line - ring, y), np.inf)
        from_emitter = np.sqrt(x * x + y * y + (z + self.distance_mm) ** 2)
        return np.asarray(from_emitter - self.distance_mm + self.design_index * along)

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`solen.lens.base.Lens.warnings`."""
        if self.design_index <= math.sqrt(2.0) or self._steepest <= _most(self.design_index):
            return ()
        limit = "light of the emitter's middle is too steep for top and bottom, and leaks there"
        return (
            look_at(f'lens.y_focus_mm = {self.y_focus_mm:.4g}: {limit}; "body" is the nearest focus that keeps it'),
        )

    @reported
    def y_focus(self) -> str:
        """Light along y: ``collimated``, or the point that it seems to come from."""
        if math.isinf(self.y_focus_mm):
            return "collimated"
        return f"as from {self.y_focus_mm:.4g} mm before the vertex"

    @property
    def remedy(self) -> str:
        """See :attr:`solen.lens.in_space.LensInSpace.remedy`."""
        return super().remedy if math.isinf(self.y_focus_mm) else f"state a larger lens.y_focus_mm, or {super().remedy}"

    @property
    def face(self) -> Face:
        """See :attr:`solen.lens.in_space.LensInSpace.face`."""
        half, nothing = self.half_height_mm, np.empty((0, 0))
        ring = self.focus_mm + self.y_focus_mm
        numbers = (self.distance_mm, self.focus_mm, self.design_index, ring, self.half_width_mm, half)
        ends = (self.depth_mm, self.nearest_mm, self.deepest_mm)
        return Face(*numbers, *ends, np.array([-half, half]), nothing, nothing, self._bend, 0.0, 0.0, 0.0, 0.0)

    @property
    def _bend(self) -> float:
        """Second derivative of n·√((ρ − ρ₀)² + y²) along a line, at most: n over the least distance from the circle."""
        farthest = math.hypot(self.half_width_mm, self.focus_mm - self.nearest_mm)
        return self.design_index / max(self.focus_mm + self.y_focus_mm - farthest, LEAST_MM)

    @cached_property
    def _steepest(self) -> float:
        """Largest d_y of the rays of the emitter's middle in the body."""
        x, y, z = self.checked
        if math.isinf(self.y_focus_mm):
            return 0.0
        away = self.focus_mm + self.y_focus_mm - np.hypot(x, self.focus_mm - z)
        return float(np.max(y / np.hypot(away, y)))

    def _keeps(self, y_focus_mm: float) -> bool:
        """Whether there is such a surface with another focus, and top and bottom keep its light."""
        try:
            other = LineFocusLens(**{**_fields(self), "y_focus_mm": y_focus_mm})
        except DesignError:
            return False
        return other._steepest <= _most(self.design_index)

    def _faces(self, x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
        """Derivative of the residual along the emitter's ray: below 0 where the surface faces the emitter."""
        from_line = np.hypot(x, self.focus_mm - z)
        from_emitter = np.sqrt(x * x + y * y + (z + self.distance_mm) ** 2)
        by_line, by_y = self._by_line(from_line, y)
        onto = by_line * (x * x - (self.focus_mm - z) * (z + self.distance_mm)) / from_line + by_y * y
        return np.asarray(1.0 + self.design_index * onto / from_emitter)

    def _gradient(self, x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of the residual by x and by z."""
        from_line = np.hypot(x, self.focus_mm - z)
        from_emitter = np.sqrt(x * x + y * y + (z + self.distance_mm) ** 2)
        scale = self.design_index * self._by_line(from_line, y)[0] / from_line
        along_z = (z + self.distance_mm) / from_emitter - scale * (self.focus_mm - z)
        return np.asarray(x / from_emitter + scale * x), np.asarray(along_z)

    def _by_line(self, from_line: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Derivatives of D by the distance from the focal line and by y."""
        if math.isinf(self.y_focus_mm):
            return np.ones_like(from_line), np.zeros_like(from_line)
        away = self.focus_mm + self.y_focus_mm - from_line
        with np.errstate(invalid="ignore"):  # at the virtual focus itself there is no direction
            return away / np.hypot(away, y), -y / np.hypot(away, y)


def _most(index: float) -> float:
    """Largest d_y in a body of this index, in air, that top and bottom reflect totally."""
    return math.sqrt(1.0 - 1.0 / index**2)


def _fields(lens: LineFocusLens) -> dict[str, float]:
    names = ("distance_mm", "focus_mm", "half_width_mm", "design_index", "outside_index", "thickness_mm", "y_focus_mm")
    return {name: getattr(lens, name) for name in names}
