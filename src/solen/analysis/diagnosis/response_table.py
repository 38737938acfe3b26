"""The traced response of a design for an emitter of any place and width, as one table.

The idea: every point of a chip shines for itself, so the response of a chip is the mean of the responses of its points.
These are traced on a grid, angles of the motion by places of a point emitter, and integrated over the places once: a
chip is then a difference of two values of that integral, whatever its decentre and width. Places are traced more
densely where the response bends, and counted from the place where light changes sides, which wanders with the angle;
beside it the response changes slowly with the angle, so that few angles do. Directional receivers see less of each
point's light, as `solen.sensor.readings` says.

The interface: `Table.of` a `Sensor` at `angles_deg`; `Table.chip` gives the shares of the emitted power at both
receivers.
"""

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from solen.arrays import FloatArray, IndexArray, Progress
from solen.errors import DesignError
from solen.scene import Scene
from solen.scene.sources import Chip, Emitter
from solen.sensor import Sensor
from solen.sensor.readings import SIDES, Acceptance
from solen.spec import with_values
from solen.trace.adaptive import Points

TOLERANCE = 1e-5
"""Within what fraction of the emitted power each point is integrated."""
REACH_MM = 0.6
"""How far from the axis places are traced, beyond the design's own decentre and half its chip."""
FIRST_MM, LEAST_MM = 0.05, 0.0001
"""Distance of places to begin with, and the least that it is halved to."""
BEND_MM = 3e-6
"""Where a place departs from the straight line between its neighbours by so much, over their distance, it is parted."""
STEP_MM = 0.002
"""Step of the integral over the places."""
STEP_DEG, MOST_ANGLES = 0.125, 81
"""Distance of the traced angles, and how many there are at most."""
POINT_MM = 0.004
"""A chip less wide than this is a point."""
POINT_RAYS = 1024
"""Rays that tell at which angles the light of one point arrives; a chip's share is then good to 1e-5."""
_PAD = 12


@dataclass(frozen=True, eq=False)
class Table:
    """Integral of the response of a point emitter over its place.

    Attributes
    ----------
    angle_deg
        Traced angles, (a,).
    place_mm
        Places from the edge, (p,).
    edge
        Polynomial of the edge's place in mm by the angle, as `numpy.polyval` takes it.
    total_mm
        Integral up to each place, right and left, (2, a, p).
    points
        Points traced.
    """

    angle_deg: FloatArray
    place_mm: FloatArray
    edge: FloatArray
    total_mm: FloatArray
    points: int

    @classmethod
    def of(
        cls, sensor: Sensor, angle_deg: FloatArray, edge: FloatArray | None = None, progress: Progress | None = None
    ) -> "Table":
        """Table of a design at angles (a,), of which there are at least four; ``edge`` is another table's.

        Raises
        ------
        DesignError
            Where the design cannot be traced by points: in space, with scatter, or from a file of rays.
        """
        wide, reach_mm = _reaching(sensor)
        wide.check_pair()
        traced = _traced(wide, angle_deg, reach_mm, progress)
        places, shares = [one for one, _ in traced], [one for _, one in traced]
        edge = _edge(angle_deg, places, shares) if edge is None else edge
        shift = np.polyval(edge, angle_deg)
        end = reach_mm - np.abs(np.polyval(edge, angle_deg[[0, -1]])).max()
        grid = np.linspace(-end, end, 1 + 2 * math.ceil(end / STEP_MM))
        total = np.stack([_integral(p, s, grid + d) for p, s, d in zip(places, shares, shift, strict=True)], axis=1)
        return cls(angle_deg, grid, edge, total, sum(len(p) for p in places))

    def less(self, other: "Table") -> "Table":
        """How this table differs from one that has its angles among others, and the same places and edge."""
        rows = np.searchsorted(other.angle_deg, self.angle_deg - 1e-9)
        return replace(self, total_mm=self.total_mm - other.total_mm[:, rows])

    @cached_property
    def _coefficients(self) -> tuple[FloatArray, ...]:
        """Cubic splines' coefficients of both receivers, the table continued so that no end bends."""
        from scipy.ndimage import spline_filter

        wide = np.pad(self.total_mm, ((0, 0), (_PAD, _PAD), (_PAD, _PAD)), mode="reflect", reflect_type="odd")
        return tuple(spline_filter(one, mode="mirror") for one in wide)

    @property
    def reach_mm(self) -> float:
        """How far from the axis a chip may reach at every angle."""
        return float(self.place_mm[-1] - np.abs(np.polyval(self.edge, self.angle_deg[[0, -1]])).max())

    def chip(self, angle_deg: FloatArray, offset_mm: float, width_mm: float) -> FloatArray:
        """Shares of the emitted power (n, 2), right and left, at angles (n,), for a chip about a place."""
        from scipy.ndimage import map_coordinates

        half = 0.5 * max(width_mm, POINT_MM)
        row = (angle_deg - self.angle_deg[0]) / (self.angle_deg[1] - self.angle_deg[0]) + _PAD
        place = offset_mm - np.polyval(self.edge, angle_deg) - self.place_mm[0]
        ends = np.concatenate([place - half, place + half]) / (self.place_mm[1] - self.place_mm[0]) + _PAD
        at = np.stack([np.concatenate([row, row]), ends])
        found = (
            map_coordinates(coefficient, at, prefilter=False, mode="nearest") for coefficient in self._coefficients
        )
        n = angle_deg.size
        return np.column_stack([(one[n:] - one[:n]) / (2.0 * half) for one in found])


def angles_deg(low_deg: float, high_deg: float) -> FloatArray:
    """Angles at which a response is traced between two: an odd number, so that every other one has both ends."""
    half = int(np.clip(math.ceil(0.5 * (high_deg - low_deg) / STEP_DEG), 4, MOST_ANGLES // 2))
    return np.linspace(low_deg, high_deg, 2 * half + 1)


def _traced(
    wide: Sensor, angle_deg: FloatArray, reach_mm: float, progress: Progress | None
) -> list[tuple[FloatArray, FloatArray]]:
    """Places and shares at every angle, on all cores."""
    traced = []
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        chips = (_Chip(wide, float(angle), reach_mm) for angle in angle_deg)
        for done, one in enumerate(pool.map(_Chip.traced, chips), start=1):
            traced.append(one)
            if progress is not None:
                progress(done / len(angle_deg))
    return traced


class _Chip:
    """A chip that reaches over all places, at one angle; its points are asked for one by one."""

    def __init__(self, sensor: Sensor, angle_deg: float, reach_mm: float) -> None:
        scene = sensor.scene(angle_deg)
        _check(scene)
        self.points = Points(replace(scene, sources=scene.sources[:1]), TOLERANCE)
        self.order = [list(scene.receivers).index(side) for side in SIDES]
        self.reach_mm = reach_mm
        self.scene, self.acceptance = scene, Acceptance.of(sensor)

    def __call__(self, places_mm: FloatArray) -> FloatArray:
        """Shares (p, 2) at places (p,)."""
        return np.asarray(self.points.powers((0.5 - 0.5 * places_mm / self.reach_mm).tolist())[:, self.order])

    def traced(self) -> tuple[FloatArray, FloatArray]:
        """Places (p,) and shares (p, 2), denser where these bend."""
        count = 2 * math.ceil(self.reach_mm / FIRST_MM)
        places = np.linspace(-self.reach_mm, self.reach_mm, count + 1)
        shares, step, suspects = self(places), float(places[1] - places[0]), np.arange(count)
        while suspects.size and step > LEAST_MM:
            step *= 0.5
            middles = 0.5 * (places[suspects] + places[suspects + 1])
            places, shares, suspects = _merged(places, shares, suspects, middles, self(middles), step)
        return places, shares * self._seen(places)

    def _seen(self, places_mm: FloatArray) -> FloatArray:
        """What directional receivers see of the shares (p, 2) at places (p,); 1 for flat windows."""
        if self.acceptance.is_flat:
            return np.ones((places_mm.size, len(SIDES)))
        chip = self.scene.sources[0].with_rays(POINT_RAYS)
        emission = chip.emission()
        if not (isinstance(chip, Chip | Emitter) and emission is not None):
            raise AssertionError("checked before: a chip made of points")
        points = (emission.at(0.5 - 0.5 * place / self.reach_mm)[:2] for place in places_mm.tolist())
        lights = (replace(chip, point=point, width_mm=0.0) for point in points)
        return np.array([self.acceptance.factors(replace(self.scene, sources=(light,))) for light in lights])


def _reaching(sensor: Sensor) -> tuple[Sensor, float]:
    """The same sensor with a chip that reaches over all places, and how far it does."""
    emitter = sensor.design.emitter
    reach_mm = REACH_MM + abs(emitter.offset_mm) + 0.5 * sensor.light.width_mm
    wide = Sensor.of(with_values(sensor.design, {"emitter.offset_mm": 0.0, "emitter.width_mm": 2.0 * reach_mm}))
    return replace(wide, cut=sensor.cut), reach_mm


def _check(scene: Scene) -> None:
    """`DesignError` where a scene's emitter cannot be taken point by point."""
    if scene.is_random or scene.extrusion is not None:
        value = "rays in space" if scene.extrusion is not None else "scattered light"
        limit = "diagnosis needs light in the plane that nothing scatters by chance"
        raise DesignError("diagnosis", value=value, limit=limit, remedy='set trace.dimension = "2d", without scatter')
    if scene.sources[0].emission() is None:
        raise DesignError("emitter", limit="a file of rays has no points to fit", remedy="state a pattern")


def _merged(
    places: FloatArray,
    shares: FloatArray,
    suspects: IndexArray,
    middles: FloatArray,
    between: FloatArray,
    step: float,
) -> tuple[FloatArray, FloatArray, IndexArray]:
    """Places with the middles among them, and the intervals that are to be halved again."""
    bend = np.abs(between - 0.5 * (shares[suspects] + shares[suspects + 1])).max(axis=1, initial=0.0)
    order = np.argsort(np.concatenate([places, middles]), kind="stable")
    merged = np.concatenate([places, middles])[order]
    values = np.concatenate([shares, between])[order]
    bent = np.searchsorted(merged, middles[bend * step > BEND_MM])
    return merged, values, np.unique(np.concatenate([bent - 1, bent])).astype(np.intp)


def _edge(angles: FloatArray, places: Sequence[FloatArray], shares: Sequence[FloatArray]) -> FloatArray:
    """Straight line through the places where light changes sides most steeply; 0 where they are on none."""
    found = []
    for place, share in zip(places, shares, strict=True):
        rise = np.diff(share[:, 0] - share[:, 1]) / np.diff(place)
        steepest = int(np.argmin(rise))  # an emitter to the right lights the left receiver
        found.append(0.5 * (place[steepest] + place[steepest + 1]))
    line = np.polyfit(angles, np.array(found), 1)
    off = np.abs(np.polyval(line, angles) - found).max()
    return line if off < FIRST_MM else np.zeros(1)


def _integral(places: FloatArray, shares: FloatArray, at: FloatArray) -> FloatArray:
    """Integral (2, n) of shares over the places up to others, from the first of these."""
    from scipy.interpolate import PchipInterpolator

    total = PchipInterpolator(places, shares).antiderivative()(at)
    return np.asarray((total - total[0]).T)
