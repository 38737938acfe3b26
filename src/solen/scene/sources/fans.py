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
from solen.scene.sources.base import LineSource, Placed, Source
from solen.scene.sources.pattern import Isotropic


class _UniformFan(LineSource):
    """Rays at uniformly spaced angles, from the right edge of the cone to the left edge."""

    pattern = Isotropic()

    def angles(self, u: FloatArray) -> FloatArray:
        """See :meth:`~solen.scene.sources.base.LineSource.angles`."""
        return np.radians(self.axis_deg + self.cone_deg * (u - 0.5))


@dataclass(frozen=True)
class Fan(_UniformFan):
    """Point source, uniform in angle over ``cone_deg`` about ``axis_deg``.

    The cone is divided equally among the rays, from the right edge to the left edge, and each ray is at the centre of
    its part. N rays therefore form the midpoint rule, and a symmetric fan has no ray at its edges.
    """

    point: Point
    axis_deg: float
    cone_deg: float
    rays: int
    width_mm = 0.0

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinate: the angle."""
        return 1


@dataclass(frozen=True)
class Chip(_UniformFan):
    """Line of ``width_mm`` centred on ``point`` across ``axis_deg``; each point emits a fan over ``cone_deg``."""

    point: Point
    width_mm: float
    axis_deg: float
    cone_deg: float
    rays: int

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinates: the angle, and the position on the chip from its right end to its left end."""
        return 2


@dataclass(frozen=True)
class Beam(Source):
    """Parallel beam from the line ``start`` to ``end``.

    The line is divided equally among the rays, and each ray starts at the centre of its part.
    """

    start: Point
    end: Point
    direction_deg: float
    rays: int

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinate: the position along the line."""
        return 1

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        fraction = u[:, 0]
        x, z = ((1.0 - fraction) * start + fraction * end for start, end in zip(self.start, self.end, strict=True))
        dx, dz = (np.full(len(u), value) for value in heading(self.direction_deg))
        return x, z, dx, dz

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        check_points("beam", self.start, self.end)
        check_numbers("beam direction_deg", self.direction_deg)


@dataclass(frozen=True)
class Rays(Source):
    """A list of rays, with origins and directions (x, z); directions need not have unit length."""

    origins: tuple[Point, ...]
    directions: tuple[Point, ...]

    @property
    def rays(self) -> int:
        """Number of rays."""
        return len(self.origins)

    def with_rays(self, rays: int) -> Self:  # noqa: ARG002  a list has the rays that it has
        """See :meth:`~solen.scene.sources.base.Source.with_rays`."""
        return self

    @property
    def shape_dimensions(self) -> int:
        """Ray coordinate: a number that selects one of the rays."""
        return 1

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`~solen.scene.sources.base.Source.place`."""
        indices = np.minimum((u[:, 0] * self.rays).astype(int), self.rays - 1)
        x, z = np.asarray(self.origins, dtype=float)[indices].T
        dx, dz = np.asarray(self.directions, dtype=float)[indices].T
        length = np.hypot(dx, dz)
        return x.copy(), z.copy(), dx / length, dz / length

    def check(self) -> None:
        """See :meth:`~solen.scene.sources.base.Source.check`."""
        super().check()
        if len(self.origins) != len(self.directions):
            limit = f"must have as many directions as origins, but has {len(self.directions)} and {len(self.origins)}"
            raise DesignError("rays", limit=limit)
        check_points("rays", *self.origins, *self.directions)
        if any(not math.hypot(*direction) > 0.0 for direction in self.directions):
            raise DesignError("rays direction", value=(0.0, 0.0), limit="must have a length above 0")
