"""Lenses that vary with height, which can be printed because every layer is drawn separately.

A cylinder is a stronger lens for skew rays, so they cross the axis before the fork. A :class:`LensInSpace` has the oval
as its section at mid-height and a different profile at every other height, so skew rays cross the same *line* (x = 0, z
= s'). It has two subclasses: :class:`~solen.lens.line_focus.LineFocusLens`, an exact smooth surface, and
:class:`~solen.lens.layered.LayeredLens`, a stack of vertical walls with one profile for each printed layer. Heights y
are measured from mid-height of the body unless specified otherwise.
"""

import math
from abc import abstractmethod
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Spline, check_range, fitted_spline
from solen.errors import DesignError
from solen.lens.face import Face
from solen.lens.optics import OvalLens
from solen.results import reported

PLACES_ACROSS, PLACES_UP = 65, 33
"""Numbers of points, across half the aperture and over half the height, at which a surface is checked."""
SECTION_MM = 1e-6
"""Maximum deviation of the curve of a section."""
NEAREST = 0.9
"""Largest approach of the face to the emitter, as a fraction of the emitter's distance."""


class LensInSpace(OvalLens, eq=True):
    """A face that has the Cartesian oval as its section at mid-height and varies with height.

    Parameters
    ----------
    thickness_mm
        Height of the body for which the face is made.

    Raises
    ------
    DesignError
        If no such face exists over the entire aperture, or the emitter's light grazes it.
    """

    thickness_mm: float = 4.0

    @abstractmethod
    def z_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return z(x, y) of the face at lateral positions and heights of the same shape; NaN where there is no face."""

    @abstractmethod
    def slope_at(self, x_mm: FloatArray, y_mm: FloatArray) -> FloatArray:
        """Return dz/dx of the face at lateral positions and heights of the same shape."""

    @property
    @abstractmethod
    def face(self) -> Face:
        """Numerical description of the face for the tracer."""

    def section(self, y_mm: float) -> Spline:
        """Return the face at one height, from its left edge to its right edge, within `SECTION_MM`."""

        def place(x: FloatArray) -> FloatArray:
            return np.column_stack([x, self.z_at(x, np.full_like(x, y_mm))])

        def velocity(x: FloatArray) -> FloatArray:
            return np.column_stack([np.ones_like(x), self.slope_at(x, np.full_like(x, y_mm))])

        half = self.half_width_mm
        return fitted_spline(place, velocity, SECTION_MM, (-half, -0.5 * half, 0.0, 0.5 * half, half))

    @property
    def middle(self) -> OvalLens:
        """The cylinder with the same section at mid-height."""
        return OvalLens(self.distance_mm, self.focus_mm, self.half_width_mm, self.design_index, self.outside_index)

    @property
    def remedy(self) -> str:
        """Remedy if no such face exists."""
        return "narrow the lens, thin the body, focus farther away or move the emitter away"

    @property
    def half_height_mm(self) -> float:
        """Half the body's height."""
        return 0.5 * self.thickness_mm

    @cached_property
    def checked(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y and z (N, M) of the face over a quarter of the aperture, which suffices by symmetry."""
        x, y = np.meshgrid(
            np.linspace(0.0, self.half_width_mm, PLACES_ACROSS), np.linspace(0.0, self.half_height_mm, PLACES_UP)
        )
        return x, y, self.z_at(x, y)

    @reported
    def deepest_mm(self) -> float:
        """Largest z of the face."""
        return float(np.max(self.checked[2]))

    @reported
    def nearest_mm(self) -> float:
        """Smallest z of the face, which is negative if the face comes nearer to the emitter than its vertex."""
        return float(np.min(self.checked[2]))

    @reported
    def edge_depth_at_top_mm(self) -> float:
        """Depth z of the face's corners, at the edge of the aperture on top and bottom of the body."""
        return float(self.checked[2][-1, -1])

    @reported
    def acceptance_y_deg(self) -> float:
        """Largest angle out of the plane, above the axis, at which the emitter's light is incident on the face."""
        depth_mm = float(self.checked[2][-1, 0])
        return math.degrees(math.atan2(self.half_height_mm, self.distance_mm + depth_mm))

    def table(self, tolerance_mm: float = 1e-4) -> str:
        """Return a CSV table of x, y and z of points on the face, in sections at `heights_mm`."""
        across = self.front.flattened(tolerance_mm)[:, 0]
        x, y = (part.ravel() for part in np.meshgrid(across, self.heights_mm))
        rows = (f"{a:.9g},{b:.9g},{c:.12g}" for a, b, c in zip(x, y, self.z_at(x, y), strict=True))
        return "\n".join(["x_mm,y_mm,z_mm", *rows, ""])

    @property
    def heights_mm(self) -> FloatArray:
        """Heights of the sections in the table."""
        return np.linspace(-self.half_height_mm, self.half_height_mm, 2 * PLACES_UP - 1)

    def _check_face(self) -> None:
        """Reject a face that does not exist over the entire aperture or comes too close to the emitter."""
        check_range("body.thickness_mm", self.thickness_mm, above=0.0)
        x, y, z = self.checked
        if np.isnan(z).any():
            bad = np.isnan(z)
            raise DesignError(
                f"lens.shape {self.shape_name}",
                value=f"there is no face beyond |x| = {x[bad].min():.3f} and |y| = {y[bad].min():.3f} mm",
                limit=f"the emitter's light must be incident on the face over ±{self.half_width_mm:g} "
                f"by ±{self.half_height_mm:g} mm",
                remedy=self.remedy,
            )
        if self.nearest_mm <= -NEAREST * self.distance_mm:
            raise DesignError(
                f"lens.shape {self.shape_name}",
                value=f"comes within {self.distance_mm + self.nearest_mm:.3f} mm of the emitter's plane",
                limit=f"must remain behind z = {-NEAREST * self.distance_mm:.3f} mm",
                remedy="increase lens.y_focus_mm or make the body thinner",
            )
