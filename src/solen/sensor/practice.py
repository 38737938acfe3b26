"""A sensor as built: with an LED of finite size that emits into space, and numbers that deviate by their tolerances.

One sensor is described in three ways: as in the paper, with a point emitter in the plane; as the design specifies it;
and as built, with the design's chip (or one of `CHIP_MM` in place of a point), in space, Lambertian in place of a fan.
Effects are computed for the sensor as built (`solen.sensor.effects`). Parts that do not apply to a design, or cannot be
built, are omitted; `Practice.skipped` gives the reasons.

Public names: `practice` and `Practice`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import numpy as np

from solen.errors import SolenError
from solen.progress import Progress, part_of
from solen.results import Result, reported
from solen.sensor.budget import Budget, budget
from solen.sensor.effects import HOLD, HOLDS, TOLERANCE, Effect, effects
from solen.sensor.lens_choice import LensChoice, lens_choice
from solen.sensor.response import Response
from solen.sensor.sensor import OF_SHAPES, Sensor
from solen.spec import with_values
from solen.trace import Slope

CHIP_MM = 0.2
"""Width and height of a small LED chip, used if the design specifies no size."""
MAX_ANGLES = 13
"""Maximum number of angles for tracing a sensor that differs from the design."""
PAPER_TOLERANCE = 1e-5
"""Tolerance of the integrated response as in the paper."""
MOVED = 0.05
"""Change of the contrast above which the uncertainty of the index raises a warning: a fortieth of the contrast
range.
"""
UNSTATED = ("part", "spectrum", "fwhm_nm", "pattern_table", "pattern_file", "ray_file")
PAPER: dict[str, Any] = dict.fromkeys(f"emitter.{key}" for key in UNSTATED) | {
    "emitter.pattern": "fan",
    "emitter.exponent": 1.0,
    "emitter.cone_deg": 120.0,
    "emitter.width_mm": 0.0,
    "emitter.height_mm": 0.0,
    "trace.dimension": "2d",
}
"""Settings that replace any emitter by the paper's."""
DARK: dict[str, Any] = {"ambient.power": 0.0, "ambient.irradiance_per_mm": 0.0}
"""Settings that omit ambient light, which is modelled in the plane only and is subtracted anyway."""

T = TypeVar("T")


@dataclass(frozen=True)
class Extent:
    """Emitter size: the design's ``own``, a chip for ``comparison``, or that of a ray ``file``."""

    width_mm: float
    height_mm: float
    kind: Literal["own", "comparison", "file"]


class Built(Result):
    """The sensor with an LED in space.

    Attributes
    ----------
    emitter
        Size of the chip.
    pattern, pattern_replaced
        Emission pattern, and whether it replaces the design's fan, which has no light out of the plane.
    cone_deg, thickness_mm
        Cone of the emitter and thickness of the body.
    is_design
        Whether it is the design itself.
    response
        Its response.
    null_deg, slope_per_deg, u_slope_per_deg
        Its null and the slope of the contrast there.
    """

    emitter: Extent
    pattern: str
    pattern_replaced: bool
    cone_deg: float
    thickness_mm: float
    is_design: bool
    response: Response
    null_deg: float | None
    slope_per_deg: float | None
    u_slope_per_deg: float | None


class Practice(Result):
    """A design as built; ``skipped`` explains each None by its name.

    Attributes
    ----------
    paper
        Response of a point in the plane, as in the paper; None if that is the design.
    built
        The sensor with its LED in space.
    effects
        Effects of errors of its numbers on the response, the largest first.
    budget
        Light budget at rest.
    lenses
        The design with other lenses.
    skipped
        Reasons for missing parts.
    """

    paper: Response | None
    built: Built | None
    effects: tuple[Effect, ...]
    budget: Budget | None
    lenses: LensChoice | None
    skipped: dict[str, str]

    def effect(self, key: str) -> Effect | None:
        """Return the effect of a number by its key."""
        return next((effect for effect in self.effects if effect.key == key), None)

    @reported
    def warnings(self) -> tuple[str, ...]:
        """Warnings before printing."""
        return (*self._of_the_index(), *self._of_holds())

    def _of_holds(self) -> tuple[str, ...]:
        """Return a warning if the way a soft body is held affects the response."""
        found = [effect for effect in self.effects if effect.key == HOLD]
        most = max(found, key=lambda effect: effect.largest, default=None)
        for key, why in self.skipped.items():
            if key.startswith(HOLD) and "not installed" in why:
                return (f"the supports of a soft body, which may matter most, were not compared: {why}",)
        if most is None or most.largest < MOVED:
            return ()
        place = int(np.nanargmax(np.abs(most.contrast)))
        return (
            f"the body is treated as rigid: for a soft body held by {HOLDS[str(most.value)]}, the contrast "
            f"differs by {most.contrast[place]:+.2g} at {most.angle_deg[place]:+.3g}°; "
            'specify its supports with motion.kind = "loaded"',
        )

    def _of_the_index(self) -> tuple[str, ...]:
        """Return a warning if the index is not known well enough."""
        index = self.effect("material.index")
        if index is None or not index.by_uncertainty or index.largest < MOVED:
            return ()
        place = int(np.nanargmax(np.abs(index.contrast)))
        return (
            f"the index is known only to ± {index.tolerance:.2g}: within this range the contrast "
            f"changes by up to {index.largest:.2g}, at {index.angle_deg[place]:+.3g}°",
        )


class _NoMeaning(Exception):  # noqa: N818  a reason, not an error
    """Reasons why parts do not apply to a design."""


def practice(
    sensor: Sensor, own: Response, progress: Progress | None = None, *, slope: Slope | None = None
) -> Practice:
    """Compute a sensor as in the paper and as built, and the effects of tolerances.

    Parameters
    ----------
    sensor
        The design.
    own
        Its response in power.
    progress
        Function called with the completed fraction, up to 1.
    slope
        Slope of its contrast at the null, if already computed.
    """
    skipped: dict[str, str] = {}

    def part(name: str, make: Callable[[], T], done: float) -> T | None:
        made: T | None = None
        try:
            made = make()
        except (_NoMeaning, SolenError) as why:
            skipped[name] = str(why)
        if progress is not None:
            progress(done)
        return made

    paper = part("paper", lambda: _as_in_paper(sensor, own), 0.05)
    real = part("built", lambda: as_built(sensor), 0.1)
    built = None if real is None else part("built", lambda: _built(sensor, real, own, slope), 0.4)
    found: tuple[Effect, ...] = ()
    if real is not None and built is not None:
        null = None
        if built.null_deg is not None and built.slope_per_deg is not None and built.u_slope_per_deg is not None:
            null = (built.null_deg, Slope(built.slope_per_deg, built.u_slope_per_deg))
        found, left_out = effects(real, built.response, null, part_of(progress, 0.4, length=0.4))
        skipped |= left_out
    shares = part("budget", lambda: budget(sensor), 0.9)
    null_deg = None if built is None else built.null_deg
    lenses = part("lenses", lambda: lens_choice(sensor, own, null_deg), 1.0)
    return Practice(paper, built, found, shares, lenses, skipped)


def extent_of(sensor: Sensor) -> Extent:
    """Return the size of the emitter as built."""
    light = sensor.light
    if light.ray_file is not None:
        return Extent(0.0, 0.0, "file")
    width_mm = light.width_mm or sensor.body().emitter.width_mm
    if width_mm > 0.0:
        return Extent(width_mm, light.height_mm or width_mm, "own")
    return Extent(CHIP_MM, light.height_mm or CHIP_MM, "comparison")


def _as_in_paper(sensor: Sensor, own: Response) -> Response:
    light = sensor.light
    values = PAPER | {"emitter.wavelength_nm": light.wavelength_nm}
    if sensor.design.lens.in_space:  # it would be the oval in the plane
        values |= OF_SHAPES | {"lens.shape": "cartesian-oval"}
    paper = _with(sensor, values)
    if paper.light == light and sensor.scene().extrusion is None:
        raise _NoMeaning("the design is a point in the plane")
    tolerance = None if paper.scene().is_random else PAPER_TOLERANCE
    return paper.smooth(paper.power(own.angle_deg.tolist(), tolerance=tolerance), tolerance)


def as_built(sensor: Sensor) -> Sensor:
    """Return the sensor with its LED in space: a chip that emits into space in place of a point or a fan."""
    changes: dict[str, Any] = DARK | {"trace.dimension": "extruded"}
    extent, light = extent_of(sensor), sensor.light
    if extent.kind != "file":
        changes |= {"emitter.width_mm": extent.width_mm, "emitter.height_mm": extent.height_mm}
        if light.pattern == "fan":
            changes |= {"emitter.pattern": "lambertian", "emitter.cone_deg": light.cone_deg}
    return _with(sensor, changes)


def _built(sensor: Sensor, real: Sensor, own: Response, known: Slope | None) -> Built:
    same = real.light == sensor.light and sensor.design.trace.dimension == "extruded"
    response = own if same else real.smooth(real.power(spread(own.angle_deg.tolist(), MAX_ANGLES)))
    null = response.null_deg()
    slope = known if same else None
    if slope is None and null is not None:
        slope = real.slope_per_deg(null, TOLERANCE)
    return Built(
        extent_of(sensor),
        "file" if real.light.ray_file is not None else real.light.pattern,
        real.light.pattern != sensor.light.pattern,
        real.light.cone_deg,
        real.design.body.thickness_mm,
        same,
        response,
        null,
        None if slope is None else slope.value,
        None if slope is None else slope.u_value,
    )


def _with(sensor: Sensor, values: dict[str, Any]) -> Sensor:
    """Return the sensor with some values set; lens and material are unchanged."""
    return replace(sensor, design=with_values(sensor.design, values))


def spread(angles: Sequence[float], most: int) -> list[float]:
    """Return at most the given number of angles, evenly spaced, with both ends."""
    places = np.unique(np.round(np.linspace(0, len(angles) - 1, min(len(angles), most))).astype(int))
    return [angles[i] for i in places.tolist()]


def slope_per_deg(response: Response, null_deg: float) -> float:
    """Return the slope of the contrast between the neighbouring angles of a null."""
    angle, value = response.angle_deg, response.contrast
    high = int(np.clip(np.searchsorted(angle, null_deg), 1, len(angle) - 1))
    low = high - 1 if angle[high] > null_deg or high == len(angle) - 1 else high
    high = max(high, low + 1)
    return float((value[high] - value[low]) / (angle[high] - angle[low]))
