"""Ambient light: the same radiance from all directions."""

import math
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_points, check_range
from solen.plane import Point, heading
from solen.scene.sources.base import Emission, Placed, PlacedInSpace, Source, about_axis, headings
from solen.scene.sources.pattern import CosinePower

PANELS = 16
"""Initial number of parts into which the circle is divided for integration."""
LAMBERT = CosinePower()


@dataclass(frozen=True)
class Ambient(Source):
    """Light of uniform radiance that enters through a circle or, in space, through a wall of ``height_mm``.

    With uniform radiance every line through the circle carries the same power, whatever its direction and its distance
    from the centre: each point of the circle is a Lambertian emitter. The circle must enclose all bodies and receivers;
    its size then affects only the power, which is that of all light through it. In space the light enters only through
    the wall, so less light arrives from a larger circle.
    """

    center: Point
    radius_mm: float
    rays: int
    height_mm: float = 0.0

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinates: the position on the circle, and the angle there."""
        return 2

    @property
    def space_dimensions(self) -> int:
        """Ray coordinates: the position on the circle, two angles, and the height if the wall has one."""
        return 3 + (self.height_mm > 0.0)

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        x, z, inwards = self._on_the_circle(u[:, 0])
        angle = inwards + LAMBERT.in_plane(u[:, 1], 0.5 * math.pi)
        return x, z, *headings(angle)

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """See :meth:`~solen.scene.sources.base.Source.place_in_space`."""
        x, z, inwards = self._on_the_circle(u[:, 0])
        theta, phi = LAMBERT.in_space(u[:, 1], 0.5 * math.pi), 2.0 * math.pi * u[:, 2]
        y = self.height_mm * (u[:, 3] - 0.5) if self.height_mm > 0.0 else np.zeros(len(u))
        return x, y, z, *about_axis(theta, phi, *headings(inwards))

    def _on_the_circle(self, position: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the points x, z on the circle and the inward directions there, in radians from +z."""
        outwards = 2.0 * math.pi * position
        dx, dz = headings(outwards)
        return self.center[0] + self.radius_mm * dx, self.center[1] + self.radius_mm * dz, outwards + math.pi

    def emission(self) -> Emission:
        """See :meth:`~solen.scene.sources.base.Source.emission`."""

        def at(position: float) -> tuple[float, float, float]:
            dx, dz = heading(360.0 * position)
            return self.center[0] + self.radius_mm * dx, self.center[1] + self.radius_mm * dz, 360.0 * position + 180.0

        half = 0.5 * math.pi
        return Emission(at, LAMBERT.intervals(half), LAMBERT.plane_angle(half), PANELS)

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("ambient light", self.center)
        check_range("ambient light radius_mm", self.radius_mm, above=0.0)
        check_range("ambient light height_mm", self.height_mm, 0.0)
