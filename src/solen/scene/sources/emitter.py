"""Emitters with an extended area and an emission pattern: models of light-emitting diodes."""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_numbers, check_range
from solen.plane import Point, heading
from solen.scene.sources.base import LineSource, PlacedInSpace, about_axis
from solen.scene.sources.pattern import Isotropic, Pattern

UNIFORM = Isotropic()


@dataclass(frozen=True)
class Emitter(LineSource):
    """A flat chip that emits the same pattern from each of its points.

    Attributes
    ----------
    point, axis_deg
        Centre of the chip, and the direction from which the pattern is measured.
    rays
        Number of rays.
    pattern
        Relative intensity as a function of the angle from the axis; in the plane its section is emitted, in space the
        complete pattern.
    cone_deg
        Full opening angle of the cone to which the pattern is limited; 360 includes light to the side and the back.
    width_mm, height_mm
        Size across the axis in the plane, and along y; 0 for a point or a line. In the plane the height has no effect.
    y_mm
        Height of the centre above the mid-plane of the slab.
    """

    point: Point
    axis_deg: float
    rays: int
    pattern: Pattern = UNIFORM
    cone_deg: float = 180.0
    width_mm: float = 0.0
    height_mm: float = 0.0
    y_mm: float = 0.0

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinates: the angle, and the position across the axis if the chip has a width."""
        return 1 + (self.width_mm > 0.0)

    @property
    def space_dimensions(self) -> int:
        """Ray coordinates: polar angle, azimuth, and the position if the chip has a width or height."""
        return 2 + (self.width_mm > 0.0) + (self.height_mm > 0.0)

    def angles(self, u: FloatArray) -> FloatArray:
        """See :meth:`~solen.scene.sources.base.LineSource.angles`."""
        return math.radians(self.axis_deg) + self.pattern.in_plane(u, self.half_rad)

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """See :meth:`~solen.scene.sources.base.Source.place_in_space`."""
        theta, phi = self.pattern.in_space(u[:, 0], self.half_rad), 2.0 * math.pi * u[:, 1]
        middle = np.full(len(u), 0.5)
        wide, high = self.width_mm > 0.0, self.height_mm > 0.0
        x, z = self.across(u[:, 2] if wide else middle)
        y = self.y_mm + self.height_mm * ((u[:, 2 + wide] if high else middle) - 0.5)
        return x, y, z, *about_axis(theta, phi, *heading(self.axis_deg))

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_numbers("emitter", self.y_mm)
        check_range("emitter height_mm", self.height_mm, 0.0)
        if self.cone_deg > 0.0:
            self.pattern.intervals(self.half_rad)  # a table raises if it has no intensity within the cone
