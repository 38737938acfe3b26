"""What launches rays: point sources, chips, beams, single rays.

Coordinates are (x, z) in mm, angles in degrees counter-clockwise from +z.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solen.curve import check_count, check_numbers, check_points
from solen.errors import DesignError
from solen.plane import Point, heading

LEAST_POWER, MOST_POWER = 1e-12, 1e12
"""Powers of sources: what even single precision can divide among any number of rays."""


@dataclass(frozen=True)
class Launch:
    """Rays as arrays (N,): origin in mm, unit direction, power in each polarisation (s: field out of the plane)."""

    x_mm: NDArray[np.float64]
    z_mm: NDArray[np.float64]
    dx: NDArray[np.float64]
    dz: NDArray[np.float64]
    power_s: NDArray[np.float64]
    power_p: NDArray[np.float64]
    line: NDArray[np.int64]
    """which line of the source's spectrum"""

    def __len__(self) -> int:
        return len(self.x_mm)


Line = tuple[float, float]
"""Wavelength in nm, and its weight in a spectrum."""


Placed = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""Rays as arrays (N,): origin x, z in mm, unit direction x, z."""


class Source(ABC):
    """Something that launches rays; they are numbered, so that any of them can be launched on their own.

    A ray is a point of the unit cube of so many ``dimensions``: an angle, a place, a wavelength. By number the points
    form a regular lattice; a sample hands in its own. Where ``spectrum`` names lines, each ray has the wavelength of
    one, drawn by their weights; without it the wavelength is unknown, which serves where no index depends on it.
    """

    rays: int
    power: float
    s_share: float
    spectrum: tuple[Line, ...]

    @property
    @abstractmethod
    def shape_dimensions(self) -> int:
        """Numbers that place a ray."""

    @abstractmethod
    def place(self, u: NDArray[np.float64]) -> Placed:
        """Origins and unit directions of the rays at points ``u`` (N, shape_dimensions or more)."""

    @property
    def dimensions(self) -> int:
        """Numbers in [0, 1) that make a ray: those that place it, and one for its wavelength if there are several."""
        return self.shape_dimensions + (len(self.spectrum) > 1)

    def check(self) -> None:
        """`DesignError` where the source cannot launch what it says; a scene checks its sources."""
        check_count("source rays", self.rays, 1)
        check_numbers("source", self.power, self.s_share)
        if not LEAST_POWER <= self.power <= MOST_POWER:
            limit = f"must be from {LEAST_POWER:g} to {MOST_POWER:g}"
            raise DesignError("source power", value=self.power, limit=limit, remedy="powers count against one another")
        if not 0.0 <= self.s_share <= 1.0:
            raise DesignError("source s_share", value=self.s_share, limit="must be from 0 to 1")
        for line in self.spectrum:
            _check_line(line)

    def lattice(self, number: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points (N, dimensions) of the rays of those numbers.

        The first coordinate has equal steps, a ray in the middle of each, so that one dimension is the midpoint rule.
        The others follow a rank-1 lattice by powers of the generalised golden ratio (the root of x^d = x + 1).
        """
        first = ((number + 0.5) / self.rays)[:, None]
        dimensions = self.dimensions
        if dimensions == 1:
            return first
        ratio = 2.0
        for _ in range(60):
            ratio = (1.0 + ratio) ** (1.0 / dimensions)
        powers = ratio ** -np.arange(1.0, dimensions)
        return np.hstack([first, ((number + 0.5)[:, None] * powers + 0.5) % 1.0])

    def launch(self, numbers: NDArray[np.float64] | None = None) -> Launch:
        """Rays of those numbers, by default all; each has the same share of the source's power."""
        numbers = np.arange(self.rays, dtype=float) if numbers is None else numbers
        return self.launch_at(self.lattice(numbers), self.rays)

    def launch_at(self, u: NDArray[np.float64], rays: int) -> Launch:
        """Rays at points (N, dimensions), each with the share of the source's power that one of ``rays`` has."""
        each = np.full(len(u), self.power / rays)
        line = np.zeros(len(u), dtype=np.int64)
        if len(self.spectrum) > 1:
            share = np.cumsum([weight for _, weight in self.spectrum])
            line = np.minimum(np.searchsorted(share / share[-1], u[:, -1], side="right"), len(share) - 1)
        return Launch(*self.place(u), each * self.s_share, each * (1.0 - self.s_share), line)


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

    def place(self, u: NDArray[np.float64]) -> Placed:
        """See :meth:`Source.place`."""
        angle = np.radians(self.axis_deg + self.cone_deg * (u[:, 0] - 0.5))
        x, z = (np.full(len(u), value) for value in self.point)
        return x, z, -np.sin(angle), np.cos(angle)

    def check(self) -> None:
        """See :meth:`Source.check`."""
        super().check()
        check_points("fan", self.point)
        check_numbers("fan", self.axis_deg, self.cone_deg)
        if not 0.0 <= self.cone_deg <= 360.0:
            raise DesignError("fan cone_deg", value=self.cone_deg, limit="must be from 0 to 360")


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

    def place(self, u: NDArray[np.float64]) -> Placed:
        """See :meth:`Source.place`."""
        angle = np.radians(self.axis_deg + self.cone_deg * (u[:, 0] - 0.5))
        left_x, left_z = heading(self.axis_deg + 90.0)
        place = self.width_mm * (u[:, 1] - 0.5)
        return self.point[0] + left_x * place, self.point[1] + left_z * place, -np.sin(angle), np.cos(angle)

    def check(self) -> None:
        """See :meth:`Source.check`."""
        super().check()
        check_points("chip", self.point)
        check_numbers("chip", self.width_mm, self.axis_deg, self.cone_deg)
        if not self.width_mm >= 0.0:
            raise DesignError("chip width_mm", value=self.width_mm, limit="must be at least 0")
        if not 0.0 <= self.cone_deg <= 360.0:
            raise DesignError("chip cone_deg", value=self.cone_deg, limit="must be from 0 to 360")


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

    def place(self, u: NDArray[np.float64]) -> Placed:
        """See :meth:`Source.place`."""
        share = u[:, 0]
        x, z = ((1.0 - share) * start + share * end for start, end in zip(self.start, self.end, strict=True))
        dx, dz = (np.full(len(u), value) for value in heading(self.direction_deg))
        return x, z, dx, dz

    def check(self) -> None:
        """See :meth:`Source.check`."""
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

    @property
    def shape_dimensions(self) -> int:
        """Which of the rays."""
        return 1

    def place(self, u: NDArray[np.float64]) -> Placed:
        """See :meth:`Source.place`."""
        which = np.minimum((u[:, 0] * self.rays).astype(int), self.rays - 1)
        x, z = np.asarray(self.origins, dtype=float)[which].T
        dx, dz = np.asarray(self.directions, dtype=float)[which].T
        length = np.hypot(dx, dz)
        return x.copy(), z.copy(), dx / length, dz / length

    def check(self) -> None:
        """See :meth:`Source.check`."""
        super().check()
        if len(self.origins) != len(self.directions):
            found = f"{len(self.origins)} origins, {len(self.directions)} directions"
            raise DesignError("rays", value=found, limit="must be as many of both")
        check_points("rays", *self.origins, *self.directions)
        if any(not math.hypot(*direction) > 0.0 for direction in self.directions):
            raise DesignError("rays", value="a direction (0, 0)", limit="must have a length")


def _check_line(line: object) -> None:
    if not (isinstance(line, tuple) and len(line) == 2):
        raise DesignError("source spectrum", value=repr(line), limit="must be pairs (wavelength in nm, weight)")
    check_numbers("source spectrum", *line)
    if not min(line) > 0.0:
        raise DesignError("source spectrum", value=line, limit="wavelengths and weights must be above 0")
