"""Fans, chips, beams and single rays.

Coordinates are (x, z) in mm, angles in degrees counter-clockwise from +z.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from solen.arrays import FloatArray
from solen.curve import check_numbers, check_points
from solen.errors import DesignError
from solen.plane import Point, heading
from solen.scene.sources.base import Emission, Line, Placed, Source
from solen.scene.sources.pattern import Isotropic, Stretch


def cone_angle(axis_deg: float, cone_deg: float, u: FloatArray) -> FloatArray:
    """Angles (N,) in radians of the rays at places ``u`` (N,) of a cone, from its right edge to its left one."""
    return np.radians(axis_deg + cone_deg * (u - 0.5))


def across(point: Point, axis_deg: float, width_mm: float, place: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points x, z (N,) at places (N,) from 0 to 1 of a line about ``point``, across an axis: from right to left."""
    left_x, left_z = heading(axis_deg + 90.0)
    step = width_mm * (place - 0.5)
    return point[0] + left_x * step, point[1] + left_z * step


def _whole_cone(cone_deg: float) -> tuple[tuple[Stretch, ...], float]:
    """The stretches of a fan, and their width."""
    cone = math.radians(cone_deg)
    return Isotropic().stretches(0.5 * cone), cone


def check_cone(what: str, cone_deg: float) -> None:
    """`DesignError` where a cone is not from 0 to 360 degrees wide."""
    if not 0.0 <= cone_deg <= 360.0:
        raise DesignError(f"{what} cone_deg", value=cone_deg, limit="must be from 0 to 360")


def check_size(what: str, size_mm: float) -> None:
    """`DesignError` where a length is not a number from 0 up."""
    check_numbers(what, size_mm)
    if not size_mm >= 0.0:
        raise DesignError(what, value=size_mm, limit="must be at least 0")


@dataclass(frozen=True)
class Fan(Source):
    """Point source, uniform in angle over ``cone_deg`` about ``axis_deg``.

    Each ray stands in the middle of its equal share of the cone, from the right edge of the cone to the left one, so
    that N rays are the midpoint rule and a symmetric fan has no ray at its edges.
    """

    point: Point
    axis_deg: float
    cone_deg: float
    rays: int
    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    @property
    def shape_dimensions(self) -> int:
        """The angle."""
        return 1

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        angle = cone_angle(self.axis_deg, self.cone_deg, u[:, 0])
        x, z = (np.full(len(u), value) for value in self.point)
        return x, z, -np.sin(angle), np.cos(angle)

    def emission(self) -> Emission | None:
        """See :meth:`~solen.scene.sources.base.Source.emission`."""
        return Emission(lambda _: (*self.point, self.axis_deg), *_whole_cone(self.cone_deg), 0)

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("fan", self.point)
        check_numbers("fan", self.axis_deg, self.cone_deg)
        check_cone("fan", self.cone_deg)


@dataclass(frozen=True)
class Chip(Source):
    """Line of ``width_mm`` about ``point``, across ``axis_deg``; every point of it is a fan over ``cone_deg``."""

    point: Point
    width_mm: float
    axis_deg: float
    cone_deg: float
    rays: int
    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    @property
    def shape_dimensions(self) -> int:
        """The angle, and the place on the chip from its right end to its left one."""
        return 2

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        angle = cone_angle(self.axis_deg, self.cone_deg, u[:, 0])
        x, z = across(self.point, self.axis_deg, self.width_mm, u[:, 1])
        return x, z, -np.sin(angle), np.cos(angle)

    def emission(self) -> Emission | None:
        """See :meth:`~solen.scene.sources.base.Source.emission`."""

        def at(place: float) -> tuple[float, float, float]:
            x, z = across(self.point, self.axis_deg, self.width_mm, np.array([place]))
            return float(x[0]), float(z[0]), self.axis_deg

        return Emission(at, *_whole_cone(self.cone_deg), 1 if self.width_mm > 0.0 else 0)

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("chip", self.point)
        check_numbers("chip", self.axis_deg, self.cone_deg)
        check_size("chip width_mm", self.width_mm)
        check_cone("chip", self.cone_deg)


@dataclass(frozen=True)
class Beam(Source):
    """Parallel beam from the line ``start`` to ``end``: each ray in the middle of its equal share of the line."""

    start: Point
    end: Point
    direction_deg: float
    rays: int
    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    @property
    def shape_dimensions(self) -> int:
        """The place along the line."""
        return 1

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        share = u[:, 0]
        x, z = ((1.0 - share) * start + share * end for start, end in zip(self.start, self.end, strict=True))
        dx, dz = (np.full(len(u), value) for value in heading(self.direction_deg))
        return x, z, dx, dz

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("beam", self.start, self.end)
        check_numbers("beam direction_deg", self.direction_deg)


@dataclass(frozen=True)
class Rays(Source):
    """Rays one by one: origins and directions (x, z); directions need not be of length 1."""

    origins: tuple[Point, ...]
    directions: tuple[Point, ...]
    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    @property
    def rays(self) -> int:  # type: ignore[override]  # a count that follows from the list
        """Number of rays."""
        return len(self.origins)

    def with_rays(self, rays: int) -> Self:  # noqa: ARG002  a list has the rays that it has
        """See :meth:`~solen.scene.sources.base.Source.with_rays`."""
        return self

    @property
    def shape_dimensions(self) -> int:
        """Which of the rays."""
        return 1

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        which = np.minimum((u[:, 0] * self.rays).astype(int), self.rays - 1)
        x, z = np.asarray(self.origins, dtype=float)[which].T
        dx, dz = np.asarray(self.directions, dtype=float)[which].T
        length = np.hypot(dx, dz)
        return x.copy(), z.copy(), dx / length, dz / length

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        if len(self.origins) != len(self.directions):
            found = f"{len(self.origins)} origins, {len(self.directions)} directions"
            raise DesignError("rays", value=found, limit="must be as many of both")
        check_points("rays", *self.origins, *self.directions)
        if any(not math.hypot(*direction) > 0.0 for direction in self.directions):
            raise DesignError("rays", value="a direction (0, 0)", limit="must have a length")
