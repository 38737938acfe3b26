"""The base class of sources: numbered rays, each determined by a point of the unit cube.

A few numbers determine a ray in the plane, and at least as many determine a ray in space. A source that is defined only
in the plane emits in the plane y = 0 if the scene is in space.
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
from solen.scene.sources.pattern import AngleInterval, Pattern
from solen.scene.sources.points import copies, points

MIN_POWER, MAX_POWER = 1e-12, 1e12
"""Limits of the power of a source: between them, even single precision can divide it among any number of rays."""


class Behind(NamedTuple):
    """Properties of rays that start behind a face: polarisation, optical path length (N,) and the power lost before.

    ``cr`` and ``ci`` are the real and imaginary parts of the off-diagonal element of the coherency matrix, and
    ``inside`` is the refractive index behind the face. ``leaked``, ``turned_back`` and ``absorbed`` are powers lost
    before the rays start; ``turned_back`` is included in the ``reflected`` power. ``more`` is the number of additional
    rays that were split off at the face.
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

    In the plane, the s field is perpendicular to the plane and the p field is in it. In space, with ``y_mm`` and
    ``dy``, the s field is in the plane of the ray and the y-axis, and the p field is perpendicular to that plane; for a
    ray in the plane, both definitions agree.
    """

    x_mm: FloatArray
    z_mm: FloatArray
    dx: FloatArray
    dz: FloatArray
    power_s: FloatArray
    power_p: FloatArray
    line: IntArray
    """index into the spectrum of the source"""
    y_mm: FloatArray | None = None
    """None in the plane"""
    dy: FloatArray | None = None
    behind: Behind | None = None
    """None for rays that start at the source itself"""

    def __len__(self) -> int:
        """Number of rays launched."""
        return len(self.x_mm) - (0 if self.behind is None else self.behind.more)


Line = tuple[float, float]
"""Wavelength in nm, and its weight in a spectrum."""

Placed = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Rays in the plane as arrays (N,): origin x, z in mm, unit direction x, z."""
Directions = tuple[FloatArray, FloatArray, FloatArray]
PlacedInSpace = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Rays in space as arrays (N,): origin x, y, z in mm, unit direction x, y, z."""


class Emission(NamedTuple):
    """A planar source as a row of point sources, for integration."""

    at: Callable[[float], tuple[float, float, float]]
    """function that maps a position from 0 to 1 to a source point: x and z in mm, and the axis there in degrees"""
    intervals: tuple[AngleInterval, ...]
    """intensity as a function of the angle from the axis, in smooth pieces, the same at all positions"""
    integral: float
    """integral of the intensity over all angles, in radians"""
    panels: int
    """initial number of intervals into which the positions are divided; 0 for a single point"""


@dataclass(frozen=True, kw_only=True)
class Source(ABC):
    """A source of numbered rays, each of which can be launched individually.

    A ray is determined by a point of the unit cube with ``dimensions`` coordinates: an angle, a position, a wavelength.
    The numbered points fill the cube uniformly; a random sample supplies its own points. If ``spectrum`` contains
    spectral lines, each ray has the wavelength of one line, chosen with probability proportional to weight. Without
    a spectrum the wavelength is unknown, which suffices if no index depends on it.

    Directions are those in the medium that contains the source.
    """

    power: float = 1.0
    s_share: float = 0.5
    spectrum: tuple[Line, ...] = ()

    if TYPE_CHECKING:  # at run time, a field of each source or the length of its list

        @property
        def rays(self) -> int:
            """Number of rays."""

    @property
    @abstractmethod
    def shape_dimensions(self) -> int:
        """Number of coordinates that determine a ray in the plane."""

    @property
    def space_dimensions(self) -> int:
        """Number of coordinates that determine a ray in space."""
        return self.shape_dimensions

    @abstractmethod
    def place(self, u: FloatArray) -> Placed:
        """Return origins and unit directions of the rays at points ``u`` (N, shape_dimensions or more)."""

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        """Return origins and unit directions in space at points ``u`` (N, space_dimensions or more).

        By default these are the rays in the plane, with y = 0.
        """
        x, z, dx, dz = self.place(u)
        return x, np.zeros(len(x)), z, dx, np.zeros(len(x)), dz

    def emission(self) -> Emission | None:
        """Return the source for integration, or None if it is not made of point sources, for example a beam."""
        return None

    def dimensions(self, in_space: bool = False) -> int:
        """Number of coordinates in [0, 1) that determine a ray, including one if there are several wavelengths."""
        return (self.space_dimensions if in_space else self.shape_dimensions) + (len(self.spectrum) > 1)

    def check(self) -> None:
        """Raise `DesignError` if the source cannot launch its rays; each scene checks its sources."""
        check_count("source rays", self.rays, 1)
        check_numbers("source", self.power)
        if not MIN_POWER <= self.power <= MAX_POWER:
            limit = f"must be from {MIN_POWER:g} to {MAX_POWER:g}"
            remedy = "scale the powers of all sources: only their ratios matter"
            raise DesignError("source power", value=self.power, limit=limit, remedy=remedy)
        check_range("source s_share", self.s_share, 0.0, 1.0)
        for line in self.spectrum:
            _check_line(line)

    def with_rays(self, rays: int) -> Self:
        """Return the source with this number of rays; a list of rays is returned unchanged."""
        return replace(self, rays=rays)  # type: ignore[call-arg]  # every source is a dataclass with rays

    def with_spectrum(self, spectrum: tuple[Line, ...]) -> Self:
        """Return the source with another spectrum."""
        return replace(self, spectrum=spectrum)

    def copies(self, in_space: bool = False) -> int:
        """Number of independent point sets to which successive rays belong in turn; 1 for a single lattice."""
        return copies(self.dimensions(in_space))

    def even_points(self, number: FloatArray, in_space: bool = False) -> FloatArray:
        """Return the points (N, dimensions) of the rays with these numbers; see `solen.scene.sources.points`."""
        return points(number, self.rays, self.dimensions(in_space))

    def launch(self, numbers: FloatArray | None = None, in_space: bool = False) -> Launch:
        """Return the rays with these numbers, by default all; all rays together carry the power of the source."""
        numbers = np.arange(self.rays, dtype=float) if numbers is None else numbers
        return self.launch_at(self.even_points(numbers, in_space), self.rays, in_space)

    def launch_at(self, u: FloatArray, rays: int, in_space: bool = False) -> Launch:
        """Return the rays at points (N, dimensions), each with the power of the source divided by ``rays``."""
        ray_power = np.full(len(u), self.power / rays)
        y, dy = None, None
        if in_space:
            x, y, z, dx, dy, dz = self.place_in_space(u)
        else:
            x, z, dx, dz = self.place(u)
        return Launch(x, z, dx, dz, ray_power * self.s_share, ray_power * (1.0 - self.s_share), self.lines(u), y, dy)

    def lines(self, u: FloatArray) -> IntArray:
        """Return the index of the spectral line for each ray at points ``u``, selected by the last coordinate."""
        if len(self.spectrum) < 2:
            return np.zeros(len(u), dtype=np.int64)
        return weighted_indices([weight for _, weight in self.spectrum], u[:, -1])


class LineSource(Source):
    """A source on a line of ``width_mm`` across its axis, with the same pattern within a cone at every point."""

    point: Point
    axis_deg: float
    cone_deg: float
    width_mm: float
    pattern: Pattern

    @property
    def half_rad(self) -> float:
        """Half the cone angle in radians."""
        return 0.5 * math.radians(self.cone_deg)

    @abstractmethod
    def angles(self, u: FloatArray) -> FloatArray:
        """Return directions (N,) in radians from +z for cumulative power fractions ``u`` (N,)."""

    def across(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return points x, z (N,) at positions (N,) from 0 at the right end of the line to 1 at its left end."""
        left_x, left_z = heading(self.axis_deg + 90.0)
        step = self.width_mm * (position - 0.5)
        return self.point[0] + left_x * step, self.point[1] + left_z * step

    def place(self, u: FloatArray) -> Placed:
        """See :meth:`Source.place`."""
        angle = self.angles(u[:, 0])
        x, z = self.across(u[:, 1] if self.shape_dimensions > 1 else np.full(len(u), 0.5))
        return x, z, *headings(angle)

    def emission(self) -> Emission:
        """See :meth:`Source.emission`."""

        def at(position: float) -> tuple[float, float, float]:
            x, z = self.across(np.array([position]))
            return float(x[0]), float(z[0]), self.axis_deg

        intervals = self.pattern.intervals(self.half_rad)
        return Emission(at, intervals, self.pattern.plane_angle(self.half_rad), 1 if self.width_mm > 0.0 else 0)

    def check(self) -> None:
        """See :meth:`Source.check`."""
        super().check()
        what = type(self).__name__.lower()
        check_points(what, self.point)
        check_numbers(what, self.axis_deg)
        check_range(f"{what} width_mm", self.width_mm, 0.0)
        check_range(f"{what} cone_deg", self.cone_deg, 0.0, 360.0)


def headings(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit directions x, z (N,) for angles in radians, computed quickly from the tangent of the half angle."""
    half = np.tan(0.5 * angle)
    scale = 1.0 / (1.0 + half * half)
    return -(half + half) * scale, (1.0 - half * half) * scale


def about_axis(theta: FloatArray, phi: FloatArray, dx: FloatArray | float, dz: FloatArray | float) -> Directions:
    """Return unit directions x, y, z (N,) at a polar angle from the axis (x, z) and an azimuth around it."""
    minus_sin_theta, cos_theta = headings(theta)
    minus_sin_phi, cos_phi = headings(phi)
    left, up = -minus_sin_theta * cos_phi, minus_sin_theta * minus_sin_phi
    return dx * cos_theta - dz * left, up, dz * cos_theta + dx * left


def weighted_indices(weights: Sequence[float] | FloatArray, u: FloatArray) -> IntArray:
    """Return for each number ``u`` (N,) in [0, 1) the index of an item, with probability proportional to its weight."""
    cumulative = np.cumsum(weights)
    return np.minimum(np.searchsorted(cumulative / cumulative[-1], u, side="right"), len(cumulative) - 1)


def _check_line(line: object) -> None:
    if not (isinstance(line, tuple) and len(line) == 2):
        raise DesignError("source spectrum", value=repr(line), limit="must be pairs (wavelength in nm, weight)")
    check_numbers("source spectrum", *line)
    if not min(line) > 0.0:
        raise DesignError("source spectrum", value=line, limit="wavelengths and weights must be above 0")
