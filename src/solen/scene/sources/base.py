"""The interface of sources: numbered rays, each a point of the unit cube.

In the plane a ray is placed by some numbers, in space by as many or more; a source without a form in space stays in
the plane y = 0 there.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.curve import check_count, check_numbers, check_points, check_range
from solen.errors import DesignError
from solen.plane import Point, heading
from solen.scene.sources.pattern import Pattern, Stretch
from solen.scene.sources.points import copies, points

LEAST_POWER, MOST_POWER = 1e-12, 1e12
"""Powers of sources: what even single precision can divide among any number of rays."""


class Behind(NamedTuple):
    """What rays that begin behind a face have behind them: polarisation, optical path (N,), and what was lost.

    ``cr`` and ``ci`` are real and imaginary part of the coherency of both fields, ``inside`` is the index there;
    ``leaked``, ``turned_back`` and ``absorbed`` are the powers that never began, ``turned_back`` a part of what was
    ``reflected``. As many as ``more`` of the rays are parts that were split off at the face.
    """

    cr: FloatArray
    ci: FloatArray
    optical_path_mm: FloatArray
    inside: FloatArray
    leaked: float
    reflected: float
    turned_back: float
    absorbed: float
    more: int


@dataclass(frozen=True, eq=False)
class Launch:
    """Rays as arrays (N,): origin in mm, unit direction, power in each polarisation.

    In the plane s has its field out of the plane and p in it. In space, where ``y_mm`` and ``dy`` are given, s has its
    field in the plane of the ray and the y-axis, p across both: the same for a ray in the plane.
    """

    x_mm: FloatArray
    z_mm: FloatArray
    dx: FloatArray
    dz: FloatArray
    power_s: FloatArray
    power_p: FloatArray
    line: IntArray
    """which line of the source's spectrum"""
    y_mm: FloatArray | None = None
    """None in the plane"""
    dy: FloatArray | None = None
    behind: Behind | None = None
    """None of rays that begin at the source itself"""

    def __len__(self) -> int:
        """Rays of the source."""
        return len(self.x_mm) - (0 if self.behind is None else self.behind.more)


Line = tuple[float, float]
"""Wavelength in nm, and its weight in a spectrum."""

Placed = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Rays of the plane as arrays (N,): origin x, z in mm, unit direction x, z."""
Directions = tuple[FloatArray, FloatArray, FloatArray]
PlacedInSpace = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Rays in space as arrays (N,): origin x, y, z in mm, unit direction x, y, z."""


class Emission(NamedTuple):
    """A source of the plane as point sources side by side, to be integrated over."""

    at: Callable[[float], tuple[float, float, float]]
    """gives for a place from 0 to 1 the point there, x and z in mm, and its axis in degrees"""
    stretches: tuple[Stretch, ...]
    """intensity by the angle from the axis, the same at all places"""
    whole: float
    """its integral over all angles, in radians"""
    panels: int
    """stretches that the places are divided into at first; 0 where there is a single point"""


@dataclass(frozen=True, kw_only=True)
class Source(ABC):
    """Something that launches rays; they are numbered, so that any of them can be launched on their own.

    A ray is a point of the unit cube of so many ``dimensions``: an angle, a place, a wavelength. By number the points
    fill it evenly; a sample hands in its own. Where ``spectrum`` names lines, each ray has the wavelength of
    one, drawn by their weights; without it the wavelength is unknown, which serves where no index depends on it.

    Directions are those in the medium that the source stands in.
    """

    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    if TYPE_CHECKING:  # at run time a field of every source, or what follows from its list

        @property
        def rays(self) -> int:
            """Number of rays."""

    @property
    @abstractmethod
    def shape_dimensions(self) -> int:
        """Numbers that place a ray in the plane."""

    @property
    def space_dimensions(self) -> int:
        """Numbers that place a ray in space."""
        return self.shape_dimensions

    @abstractmethod
    def place(self, u: FloatArray) -> Placed:
        """Origins and unit directions of the rays at points ``u`` (N, shape_dimensions or more)."""

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """Origins and unit directions in space at points ``u`` (N, space_dimensions or more); by default with y = 0."""
        x, z, dx, dz = self.place(u)
        return x, np.zeros(len(x)), z, dx, np.zeros(len(x)), dz

    def emission(self) -> Emission | None:
        """Cone for integration over the source; None if it is not made of point sources, as a beam."""
        return None

    def dimensions(self, in_space: bool = False) -> int:
        """Numbers in [0, 1) that make a ray: those that place it, and one for its wavelength if there are several."""
        return (self.space_dimensions if in_space else self.shape_dimensions) + (len(self.spectrum) > 1)

    def check(self) -> None:
        """`DesignError` if the source cannot launch its rays; a scene checks its sources."""
        check_count("source rays", self.rays, 1)
        check_numbers("source", self.power)
        if not LEAST_POWER <= self.power <= MOST_POWER:
            limit = f"must be from {LEAST_POWER:g} to {MOST_POWER:g}"
            raise DesignError("source power", value=self.power, limit=limit, remedy="only ratios of powers matter")
        check_range("source s_share", self.s_share, 0.0, 1.0)
        for line in self.spectrum:
            _check_line(line)

    def with_rays(self, rays: int) -> Self:
        """The same source with so many rays; a list of rays as it is."""
        return replace(self, rays=rays)  # type: ignore[call-arg]  # every source is a dataclass with rays

    def with_spectrum(self, spectrum: tuple[Line, ...]) -> Self:
        """The same source with another spectrum."""
        return replace(self, spectrum=spectrum)

    def copies(self, in_space: bool = False) -> int:
        """Independent copies that the rays are dealt to in turn by their numbers; 1 where they are one lattice."""
        return copies(self.dimensions(in_space))

    def even_points(self, number: FloatArray, in_space: bool = False) -> FloatArray:
        """Points (N, dimensions) of the rays of those numbers; see `solen.scene.sources.points`."""
        return points(number, self.rays, self.dimensions(in_space))

    def launch(self, numbers: FloatArray | None = None, in_space: bool = False) -> Launch:
        """Rays of those numbers, by default all; together they have the source's power."""
        numbers = np.arange(self.rays, dtype=float) if numbers is None else numbers
        return self.launch_at(self.even_points(numbers, in_space), self.rays, in_space)

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """Rays at points (N, dimensions), each with the share of the source's power that one of ``rays`` has."""
        each = np.full(len(u), self.power / rays)
        y, dy = None, None
        if in_space:
            x, y, z, dx, dy, dz = self.place_in_space(u)
        else:
            x, z, dx, dz = self.place(u)
        return Launch(x, z, dx, dz, each * self.s_share, each * (1.0 - self.s_share), self.lines(u), y, dy)

    def lines(self, u: FloatArray) -> IntArray:
        """Which line of the spectrum each of the rays at points ``u`` has: by the last coordinate."""
        if len(self.spectrum) < 2:
            return np.zeros(len(u), dtype=np.int64)
        return drawn_by([weight for _, weight in self.spectrum], u[:, -1])


class LineSource(Source):
    """A source on a line of ``width_mm`` across its axis, alike at every point: a pattern within a cone."""

    point: Point
    axis_deg: float
    cone_deg: float
    width_mm: float
    pattern: Pattern

    @property
    def half_rad(self) -> float:
        """Half of the cone in radians."""
        return 0.5 * math.radians(self.cone_deg)

    @abstractmethod
    def angles(self, u: FloatArray) -> FloatArray:
        """Directions (N,) in radians from +z at shares ``u`` (N,) of the power."""

    def across(self, place: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points x, z (N,) at places (N,) from 0 to 1 along the line: from right to left."""
        left_x, left_z = heading(self.axis_deg + 90.0)
        step = self.width_mm * (place - 0.5)
        return self.point[0] + left_x * step, self.point[1] + left_z * step

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`Source.place`."""
        angle = self.angles(u[:, 0])
        x, z = self.across(u[:, 1] if self.shape_dimensions > 1 else np.full(len(u), 0.5))
        return x, z, *headings(angle)

    def emission(self) -> Emission:
        """See :meth:`Source.emission`."""

        def at(place: float) -> tuple[float, float, float]:
            x, z = self.across(np.array([place]))
            return float(x[0]), float(z[0]), self.axis_deg

        stretches = self.pattern.stretches(self.half_rad)
        return Emission(at, stretches, self.pattern.plane_angle(self.half_rad), 1 if self.width_mm > 0.0 else 0)

    def check(self) -> None:
        """See :meth:`Source.check`."""
        super().check()
        what = type(self).__name__.lower()
        check_points(what, self.point)
        check_numbers(what, self.axis_deg)
        check_range(f"{what} width_mm", self.width_mm, 0.0)
        check_range(f"{what} cone_deg", self.cone_deg, 0.0, 360.0)


def headings(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit directions x, z (N,) of angles in radians, through the tangent of the half: numpy takes many at once."""
    half = np.tan(0.5 * angle)
    scale = 1.0 / (1.0 + half * half)
    return -(half + half) * scale, (1.0 - half * half) * scale


def about_axis(theta: FloatArray, phi: FloatArray, dx: FloatArray | float, dz: FloatArray | float) -> Directions:
    """Unit directions x, y, z (N,) at angles from an axis of direction x, z, and round it."""
    right, along = headings(theta)
    down, aside = headings(phi)
    left, up = -right * aside, right * down
    return dx * along - dz * left, up, dz * along + dx * left


def drawn_by(weights: Sequence[float] | FloatArray, u: FloatArray) -> IntArray:
    """Index of the item drawn by its weight at each of the numbers ``u`` (N,) in [0, 1)."""
    share = np.cumsum(weights)
    return np.minimum(np.searchsorted(share / share[-1], u, side="right"), len(share) - 1)


def _check_line(line: object) -> None:
    if not (isinstance(line, tuple) and len(line) == 2):
        raise DesignError("source spectrum", value=repr(line), limit="must be pairs (wavelength in nm, weight)")
    check_numbers("source spectrum", *line)
    if not min(line) > 0.0:
        raise DesignError("source spectrum", value=line, limit="wavelengths and weights must be above 0")
