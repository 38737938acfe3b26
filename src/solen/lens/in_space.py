"""Lenses for skew rays, which vary with height; they can be printed because every layer is drawn separately.

A cylinder is a stronger lens for skew rays, so they cross the axis before the fork. A :class:`LensInSpace` has the oval
as its section at mid-height and a different profile at every other height, so skew rays cross the same *line* (x = 0, z
= s'). It has two subclasses: :class:`~solen.lens.line_focus.LineFocusLens`, an exact smooth surface, and
:class:`~solen.lens.layered.LayeredLens`, a stack of vertical walls with one profile for each printed layer. Heights y
are measured from mid-height of the body.
"""

import math
from abc import abstractmethod
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray
from solen.curve import Spline, check_range, fitted_spline
from solen.errors import DesignError
from solen.lens.base import MAX_APPROACH
from solen.lens.face import Face
from solen.lens.optics import OvalLens
from solen.results import reported

X_SAMPLES, Y_SAMPLES = 65, 33
"""Numbers of points, across half the aperture and over half the height, at which a surface is checked."""
SECTION_TOLERANCE_MM = 1e-6
"""Maximum deviation of the curve of a section."""


class LensInSpace(OvalLens, eq=True):
    """A face that has the Cartesian oval as its section at mid-height and varies with height.

    Parameters
    ----------
    thickness_mm
        Height of the body for which the face is made.

    Raises
    ------
    DesignError
        If no such face exists over the entire aperture, or the emitter's light is not incident on all of it.
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
        """Return the face at one height, from its left edge to its right edge, within `SECTION_TOLERANCE_MM`."""

        def position(x: FloatArray) -> FloatArray:
            return np.column_stack([x, self.z_at(x, np.full_like(x, y_mm))])

        def velocity(x: FloatArray) -> FloatArray:
            return np.column_stack([np.ones_like(x), self.slope_at(x, np.full_like(x, y_mm))])

        half = self.half_width_mm
        return fitted_spline(position, velocity, SECTION_TOLERANCE_MM, (-half, -0.5 * half, 0.0, 0.5 * half, half))

    @property
    def middle(self) -> OvalLens:
        """The cylinder with the same section at mid-height."""
        return OvalLens(self.distance_mm, self.focus_mm, self.half_width_mm, self.design_index, self.outside_index)

    @property
    def remedy(self) -> str:
        """Remedy if no such face exists."""
        return "reduce lens.half_width_mm or body.thickness_mm, or increase lens.focus_mm or emitter.distance_mm"

    @property
    def half_height_mm(self) -> float:
        """Half the body's height."""
        return 0.5 * self.thickness_mm

    @cached_property
    def sampled_face(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """x, y and z (N, M) of points on a quarter of the face, which suffices by symmetry."""
        x, y = np.meshgrid(
            np.linspace(0.0, self.half_width_mm, X_SAMPLES), np.linspace(0.0, self.half_height_mm, Y_SAMPLES)
        )
        return x, y, self.z_at(x, y)

    @reported
    def deepest_mm(self) -> float:
        """Largest z of the face."""
        return float(np.max(self.sampled_face[2]))

    @reported
    def nearest_mm(self) -> float:
        """Smallest z of the face, negative if it is nearer to the emitter than the vertex."""
        return float(np.min(self.sampled_face[2]))

    @reported
    def edge_depth_at_top_mm(self) -> float:
        """Depth z of the face's corners, at the edge of the aperture on top and bottom of the body."""
        return float(self.sampled_face[2][-1, -1])

    @reported
    def acceptance_y_deg(self) -> float:
        """Largest angle above the plane y = 0 at which the emitter's light is incident on the face."""
        depth_mm = float(self.sampled_face[2][-1, 0])
        return math.degrees(math.atan2(self.half_height_mm, self.distance_mm + depth_mm))

    def table(self, tolerance_mm: float = 1e-4) -> str:
        """Return a CSV table of x, y and z of points on the face, in sections at `heights_mm`."""
        lateral = self.front.flattened(tolerance_mm)[:, 0]
        x, y = (grid.ravel() for grid in np.meshgrid(lateral, self.heights_mm))
        rows = (f"{a:.9g},{b:.9g},{c:.12g}" for a, b, c in zip(x, y, self.z_at(x, y), strict=True))
        return "\n".join(["x_mm,y_mm,z_mm", *rows, ""])

    @property
    def heights_mm(self) -> FloatArray:
        """Heights of the sections in the table."""
        return np.linspace(-self.half_height_mm, self.half_height_mm, 2 * Y_SAMPLES - 1)

    def _check_face(self) -> None:
        """Raise `DesignError` if the face does not exist over the entire aperture or is too close to the emitter."""
        check_range("body.thickness_mm", self.thickness_mm, above=0.0)
        x, y, z = self.sampled_face
        missing = np.isnan(z)
        if missing.any():
            limit = (
                f"the emitter's light must be incident on a face of ±{self.half_width_mm:g} by "
                f"±{self.half_height_mm:g} mm, but there is no face beyond |x| = {x[missing].min():.3f} mm and "
                f"|y| = {y[missing].min():.3f} mm"
            )
            raise DesignError("lens.shape", value=self.shape_name, limit=limit, remedy=self.remedy)
        if self.nearest_mm <= -MAX_APPROACH * self.distance_mm:
            limit = (
                f"the face extends to z = {self.nearest_mm:.3f} mm, but must be behind "
                f"z = {-MAX_APPROACH * self.distance_mm:.3f} mm"
            )
            remedy = "increase lens.y_focus_mm or reduce body.thickness_mm"
            raise DesignError("lens.shape", value=self.shape_name, limit=limit, remedy=remedy)
