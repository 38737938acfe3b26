"""What matters before printing: a real chip, its decentre, the index, and light out of the plane.

The idea: the design's own response is compared with those of a few neighbours, traced alike. A real emitter is a chip;
it is glued on some hundredths of a millimetre off the axis; the print's index differs from the one the lens is cut for;
and its light leaves the plane. Where the design states a chip, the point is the comparison; where it states none, a
chip of `CHIP_MM` is. A comparison that has no meaning for a design, or cannot be built, is left out, and
`Practice.skipped` says why.

The interface: `practice` of a sensor and its response, which returns a `Practice`.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from solen.arrays import Progress
from solen.errors import SolenError
from solen.parts import Light
from solen.results import Result, reported
from solen.sensor.budget import Budget, budget
from solen.sensor.index_offset import NEAR_DEG, STANDARD_ERROR, Angles, IndexOffset, index_offsets, swept
from solen.sensor.response import Response, Shift, contrast, shift
from solen.sensor.sensor import Sensor
from solen.spec import with_values

CHIP_MM = 0.2
"""Width and height of a small LED chip, where the design states none."""
DECENTRE_MM = 0.01
"""How far the emitter is moved."""
MOST_ANGLES, FEW_ANGLES = 13, 3
"""Angles at most: of a response, and of one in the other dimension."""
MOVED = 0.05
"""Change of the contrast above which the uncertainty of the index raises a warning: a fortieth of its range."""
SETTLED_DEG, MOST_STEPS = 1e-4, 8
"""How closely a null is sought, and after how many steps the search ends."""

T = TypeVar("T")


@dataclass(frozen=True)
class Extent:
    """Size of the emitter: the design's ``own``, one for ``comparison``, or that of its ``file`` of rays."""

    width_mm: float
    height_mm: float
    kind: Literal["own", "comparison", "file"]


@dataclass(frozen=True)
class NullShift:
    """Null of the chip in its place, and moved by ``step_mm`` towards +x, with the uncertainty of their distance."""

    step_mm: float
    null_deg: float
    moved_deg: float
    shift_deg: float
    u_shift_deg: float


@dataclass(frozen=True, eq=False, repr=False)
class InSpace(Result):
    """The same chip in the plane and in space.

    Attributes
    ----------
    emitter
        Size of the chip.
    pattern, pattern_replaced
        What it emits by, in both; whether that stands for the design's fan, which has no light out of the plane.
    cone_deg, thickness_mm
        Cone of the emitter, and thickness of the body.
    plane, space
        Responses; the plane at few of the angles.
    """

    emitter: Extent
    pattern: str
    pattern_replaced: bool
    cone_deg: float
    thickness_mm: float
    plane: Response
    space: Response

    @property
    def same(self) -> Response:
        """In space, at the angles of the plane."""
        return self.space.part([self.space.at(angle) for angle in self.plane.angle_deg])

    @reported
    def received_plane(self) -> float:
        """Power at both receivers, mean over the angles of the plane."""
        return self.plane.received_share

    @reported
    def received_space(self) -> float:
        """The same in space."""
        return self.same.received_share


@dataclass(frozen=True, eq=False, repr=False)
class Practice(Result):
    """A design beside its neighbours; None is what ``skipped`` gives a reason for, by the same name.

    Attributes
    ----------
    emitter
        Size of the emitter.
    point, chip
        Responses of a point and of the chip, in the design's own dimension.
    null_shift
        What a decentre of the chip does to the null.
    index
        Responses with the chip in materials of another index.
    budget
        Where the light goes at rest.
    in_space
        The chip in the plane and in space.
    skipped
        Reasons.
    chip_shift
        How far the chip moves the response of the point at most.
    """

    emitter: Extent
    point: Response | None
    chip: Response | None
    null_shift: NullShift | None
    index: tuple[IndexOffset, ...] | None
    budget: Budget | None
    in_space: InSpace | None
    skipped: dict[str, str]
    chip_shift: Shift | None = None

    @reported
    def index_shift(self) -> Shift | None:
        """How far another index moves the response at most; None without light."""
        shifts = [offset.shift for offset in self.index or () if offset.shift is not None]
        return max(shifts, key=lambda shift: shift.contrast, default=None)

    @reported
    def warnings(self) -> tuple[str, ...]:
        """What must be known before printing."""
        moved = self.index_shift
        if moved is None or not self.index or not self.index[0].by_uncertainty or moved.contrast < MOVED:
            return ()
        return (
            f"the index is known to ± {abs(self.index[0].step):.2g} only: within that the response moves by up to "
            f"{moved.contrast:.2g} in contrast, at {moved.angle_deg:+.3g}°",
        )


class _NoMeaning(Exception):  # noqa: N818  a reason, not an error
    """Why a part has no meaning for a design."""


def practice(
    sensor: Sensor, own: Response, progress: Progress | None = None, *, chip: Response | None = None
) -> Practice:
    """Compare a sensor with its neighbours over the angles of its response in power.

    Parameters
    ----------
    sensor
        The design.
    own
        Its response in power.
    progress
        Called with the share done, up to 1.
    chip
        Its response in power with a chip of `CHIP_MM`, as far as it is known, where the design is a point.
    """
    neighbours, skipped = _Neighbours(sensor, own, chip), dict[str, str]()

    def part(name: str, make: Callable[[], T], done: float) -> T | None:
        made: T | None = None
        try:
            made = make()
        except (_NoMeaning, SolenError) as why:
            skipped[name] = str(why)
        if progress is not None:
            progress(done)
        return made

    point = part("point", neighbours.point, 0.05)
    chip = part("chip", neighbours.chip, 0.3)
    return Practice(
        emitter=neighbours.extent,
        point=point,
        chip=chip,
        null_shift=part("null_shift", lambda: neighbours.null_shift(chip), 0.4),
        index=part("index", lambda: neighbours.index(chip), 0.7),
        budget=part("budget", neighbours.budget, 0.75),
        in_space=part("in_space", neighbours.in_space, 1.0),
        skipped=skipped,
        chip_shift=neighbours.chip_shift(point, chip),
    )


@dataclass(frozen=True)
class _Neighbours:
    """A sensor and what can be compared with it."""

    sensor: Sensor
    own: Response
    known_chip: Response | None = None

    @property
    def light(self) -> Light:
        return self.sensor.light

    @property
    def extent(self) -> Extent:
        light = self.light
        if light.ray_file is not None:
            return Extent(0.0, 0.0, "file")
        width_mm = light.width_mm or self.sensor.body().emitter.width_mm
        if width_mm > 0.0:
            return Extent(width_mm, light.height_mm, "own")
        return Extent(CHIP_MM, light.height_mm, "comparison")

    @property
    def angles(self) -> Angles:
        """Some of the response's angles, and those near the null."""
        return self._near(self._some(MOST_ANGLES))

    def _some(self, most: int) -> Angles:
        """Fewer of the response's angles, each a part of the more."""
        return spread(spread(self.own.angle_deg.tolist(), MOST_ANGLES), most)

    def _near(self, angles: Angles) -> Angles:
        first, last = float(self.own.angle_deg[0]), float(self.own.angle_deg[-1])
        return sorted({*angles, *(near for near in (-NEAR_DEG, NEAR_DEG) if first <= near <= last)})

    def point(self) -> Response:
        if self.extent.kind == "file":
            raise _NoMeaning("the emitter is a file of rays, which has its size")
        if self.extent.kind == "comparison":
            return self.own
        if self.light.width_mm == 0.0:
            raise _NoMeaning("the emitter's width is drawn")
        return swept(self._point, self.angles)

    @property
    def _point(self) -> Sensor:
        """The sensor with a point in the chip's place."""
        if self.extent.kind == "comparison":
            return self.sensor
        return self._with({"emitter.width_mm": 0.0, "emitter.height_mm": 0.0})

    @property
    def real(self) -> Sensor:
        """The sensor with the chip, or as it is."""
        if self.extent.kind != "comparison":
            return self.sensor
        return self._with({"emitter.width_mm": self.extent.width_mm})

    def chip(self) -> Response:
        known = self.known_chip if self.extent.kind == "comparison" else self.own
        return swept(self.real, self.angles, known)

    def chip_shift(self, point: Response | None, chip: Response | None) -> Shift | None:
        if point is None or chip is None:
            return None
        return shift(chip, swept(self._point, chip.angle_deg.tolist(), point))

    def null_shift(self, chip: Response | None) -> NullShift:
        null = None if chip is None else chip.null_deg()
        if chip is None or null is None:
            raise _NoMeaning("with the chip there is no null in this range")
        slope = slope_per_deg(chip, null)
        offset_mm = self.sensor.design.emitter.offset_mm
        moved = _with(self.real, {"emitter.offset_mm": offset_mm + DECENTRE_MM})
        here, u_here = _null(self.real, null, slope)
        there, u_there = _null(moved, here, slope)
        return NullShift(DECENTRE_MM, here, there, there - here, u_here + u_there)

    def index(self, chip: Response | None) -> tuple[IndexOffset, ...]:
        if chip is None:
            raise _NoMeaning("the response with the chip is not known")
        known = chip if self.extent.kind == "comparison" else chip.joined(self.own)
        return index_offsets(self.real, known, self._near([float(known.angle_deg[0]), float(known.angle_deg[-1])]))

    def budget(self) -> Budget:
        return budget(self.sensor)

    def in_space(self) -> InSpace:
        extent, light, replaced = self.extent, self.light, False
        changes: dict[str, Any] = {}
        if extent.kind != "file":
            extent = replace(extent, height_mm=extent.height_mm or extent.width_mm)
            replaced = light.pattern == "fan"
            changes = {"emitter.width_mm": extent.width_mm, "emitter.height_mm": extent.height_mm}
        if replaced:
            changes |= {"emitter.pattern": "lambertian", "emitter.cone_deg": light.cone_deg}
        plane, space = (self._with({**changes, "trace.dimension": kind}) for kind in ("2d", "extruded"))
        known = {sensor.design.trace.dimension: self.own for sensor in (plane, space) if _same(sensor, self.sensor)}
        return InSpace(
            extent,
            space.light.pattern if extent.kind != "file" else "file",
            replaced,
            light.cone_deg,
            space.design.body.thickness_mm,
            swept(plane, self._some(FEW_ANGLES), known.get("2d")),
            swept(space, self.angles, known.get("extruded")),
        )

    def _with(self, values: dict[str, Any]) -> Sensor:
        return _with(self.sensor, values)


def _with(sensor: Sensor, values: dict[str, Any]) -> Sensor:
    """The sensor with some values set; its lens stays."""
    return replace(sensor, design=with_values(sensor.design, values))


def _same(sensor: Sensor, other: Sensor) -> bool:
    """Whether they have the same light, in the plane or in space alike."""
    return sensor.light == other.light and sensor.design.trace.dimension == other.design.trace.dimension


def spread(angles: Angles, most: int) -> Angles:
    """So many of the angles at most, evenly, both ends included."""
    places = np.unique(np.round(np.linspace(0, len(angles) - 1, min(len(angles), most))).astype(int))
    return [angles[i] for i in places.tolist()]


def slope_per_deg(response: Response, null_deg: float) -> float:
    """Slope of the contrast between the angles on both sides of a null."""
    angle, value = response.angle_deg, response.contrast
    high = int(np.clip(np.searchsorted(angle, null_deg), 1, len(angle) - 1))
    low = high - 1 if angle[high] > null_deg or high == len(angle) - 1 else high
    high = max(high, low + 1)
    return float((value[high] - value[low]) / (angle[high] - angle[low]))


def _null(sensor: Sensor, start_deg: float, slope_per_deg: float) -> tuple[float, float]:
    """Null by the secant method, with its uncertainty; `_NoMeaning` where it does not converge."""
    angle, slope, before = start_deg, slope_per_deg, None
    for _ in range(MOST_STEPS):
        found = sensor.power([angle], standard_error=STANDARD_ERROR)
        value = contrast(float(found.right[0]), float(found.left[0]))
        if value is None or not np.isfinite(slope) or slope == 0.0:
            raise _NoMeaning("no light reaches the receivers at the null")
        u = 2.0 * float(found.u_power[0]) / float(found.right[0] + found.left[0])
        if before is not None and angle != before[0]:
            slope = (value - before[1]) / (angle - before[0]) or slope
        if abs(value) <= max(u, SETTLED_DEG * abs(slope)):
            return angle, (abs(value) + u) / abs(slope)
        before = (angle, value)
        angle -= value / slope
        if abs(angle - start_deg) > 45.0:
            break
    raise _NoMeaning("the null of the decentred emitter is not found")
