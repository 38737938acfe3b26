"""Emitters with a size and a pattern: what a light-emitting diode is."""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_numbers, check_points
from solen.plane import Point
from solen.scene.sources.base import Emission, Line, Placed, PlacedInSpace, Source
from solen.scene.sources.pattern import Isotropic, Pattern
from solen.scene.sources.plain import across, check_cone, check_size

EVENLY = Isotropic()


@dataclass(frozen=True)
class Emitter(Source):
    """A flat chip that emits by a pattern from every point of it, all alike.

    Attributes
    ----------
    point, axis_deg
        Its middle and the direction that the pattern is measured from.
    rays
        Number of rays.
    pattern
        Relative intensity by the angle from the axis; in the plane its slice is emitted, in space all of it.
    cone_deg
        Full opening angle beyond which nothing is emitted: 360 for light to the side and to the back.
    width_mm, height_mm
        Size across the axis in the plane, and along y; 0 for a point or a line. The plane knows no height.
    y_mm
        Height of its middle over the middle of the slab.
    power, s_share, spectrum
        As of every source.
    """

    point: Point
    axis_deg: float
    rays: int
    pattern: Pattern = EVENLY
    cone_deg: float = 180.0
    width_mm: float = 0.0
    height_mm: float = 0.0
    y_mm: float = 0.0
    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    @property
    def half_rad(self) -> float:
        """Half of the cone in radians."""
        return 0.5 * math.radians(self.cone_deg)

    @property
    def shape_dimensions(self) -> int:
        """The angle, and the place across the axis where it has a width."""
        return 1 + (self.width_mm > 0.0)

    @property
    def space_dimensions(self) -> int:
        """The angle from the axis, the one round it, and the place where there is width or height."""
        return 2 + (self.width_mm > 0.0) + (self.height_mm > 0.0)

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        angle = math.radians(self.axis_deg) + self.pattern.in_plane(u[:, 0], self.half_rad)
        place = u[:, 1] if self.width_mm > 0.0 else np.full(len(u), 0.5)
        x, z = across(self.point, self.axis_deg, self.width_mm, place)
        return x, z, -np.sin(angle), np.cos(angle)

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """See :meth:`~solen.scene.sources.base.Source.place_in_space`."""
        theta, phi = self.pattern.in_space(u[:, 0], self.half_rad), 2.0 * math.pi * u[:, 1]
        middle = np.full(len(u), 0.5)
        wide, high = self.width_mm > 0.0, self.height_mm > 0.0
        x, z = across(self.point, self.axis_deg, self.width_mm, u[:, 2] if wide else middle)
        y = self.y_mm + self.height_mm * ((u[:, 2 + wide] if high else middle) - 0.5)
        along, left, up = np.cos(theta), np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
        c, s = math.cos(math.radians(self.axis_deg)), math.sin(math.radians(self.axis_deg))
        return x, y, z, -s * along - c * left, up, c * along - s * left

    def emission(self) -> Emission:
        """See :meth:`~solen.scene.sources.base.Source.emission`."""

        def at(place: float) -> tuple[float, float, float]:
            x, z = across(self.point, self.axis_deg, self.width_mm, np.array([place]))
            return float(x[0]), float(z[0]), self.axis_deg

        stretches = self.pattern.stretches(self.half_rad)
        return Emission(at, stretches, self.pattern.plane_angle(self.half_rad), 1 if self.width_mm > 0.0 else 0)

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("emitter", self.point)
        check_numbers("emitter", self.axis_deg, self.cone_deg, self.y_mm)
        check_cone("emitter", self.cone_deg)
        check_size("emitter width_mm", self.width_mm)
        check_size("emitter height_mm", self.height_mm)
        if self.cone_deg > 0.0:
            self.pattern.stretches(self.half_rad)  # a table refuses a cone in which it is dark
