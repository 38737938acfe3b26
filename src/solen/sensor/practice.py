"""A sensor as built: with an LED of finite size that emits into space, and numbers that deviate by their tolerances.

The response is computed in three ways: as in the paper, with a point emitter in the plane; as the design specifies; and
as built, in space, with the design's chip (or one of `CHIP_MM` in place of a point) and Lambertian emission in place of
a fan. Effects are computed for the sensor as built (`solen.sensor.effects`). Parts that do not apply to a design, or
cannot be built, are omitted; `Practice.skipped` gives the reasons.

Public names: `practice`, `Practice`, `Built`, `Extent`, `as_built` and `subsample`.
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
from solen.sensor.sensor import NO_SHAPE_KEYS, Sensor
from solen.spec import with_values
from solen.trace import Slope

CHIP_MM = 0.2
"""Width and height of a small LED chip, used if the design specifies no size."""
MAX_ANGLES = 13
"""Maximum number of angles at which a sensor that differs from the design is traced."""
PAPER_TOLERANCE = 1e-5
"""Integration tolerance of the response with the emitter of the paper."""
MIN_CONTRAST_CHANGE = 0.05
"""Smallest change of the contrast that causes a warning: a fortieth of the contrast range."""
REMOVED_KEYS = ("part", "spectrum", "fwhm_nm", "pattern_table", "pattern_file", "ray_file")
PAPER: dict[str, Any] = dict.fromkeys(f"emitter.{key}" for key in REMOVED_KEYS) | {
    "emitter.pattern": "fan",
    "emitter.exponent": 1.0,
    "emitter.cone_deg": 120.0,
    "emitter.width_mm": 0.0,
    "emitter.height_mm": 0.0,
    "trace.dimension": "2d",
}
"""Design values that replace any emitter with that of the paper."""
DARK: dict[str, Any] = {"ambient.power": 0.0, "ambient.irradiance_per_mm": 0.0}
"""Design values that remove ambient light, which is modelled in the plane only and subtracted in a measurement."""

T = TypeVar("T")


@dataclass(frozen=True)
class Extent:
    """Emitter size: the design's ``own``, that of a chip for ``comparison``, or that of a ray ``file``."""

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
        Emission pattern, and whether it replaces the design's fan, which emits no light out of the plane.
    cone_deg, thickness_mm
        Cone of the emitter, and thickness of the body.
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
    """A design as built, compared with variants.

    Attributes
    ----------
    paper
        Response of a point in the plane, as in the paper; None if the design is such a point.
    built
        The sensor with its LED in space.
    effects
        Effects of deviations of its numbers on the response, the largest first.
    budget
        Light budget at rest.
    lenses
        The design with other lenses.
    skipped
        Reasons for missing parts, keyed by name.
    """

    paper: Response | None
    built: Built | None
    effects: tuple[Effect, ...]
    budget: Budget | None
    lenses: LensChoice | None
    skipped: dict[str, str]

    def effect(self, key: str) -> Effect | None:
        """Return the effect of a number, or None if it was not computed."""
        return next((effect for effect in self.effects if effect.key == key), None)

    @reported
    def warnings(self) -> tuple[str, ...]:
        """Warnings to consider before printing."""
        return (*self._index_warnings(), *self._hold_warnings())

    def _hold_warnings(self) -> tuple[str, ...]:
        """Return a warning if the supports of a soft body affect the response."""
        for key, why in self.skipped.items():
            if key.startswith(HOLD) and "not installed" in why:
                return (f"the supports of a soft body, which may have the largest effect, were not compared: {why}",)
        holds = [effect for effect in self.effects if effect.key == HOLD]
        largest = max(holds, key=lambda effect: effect.largest, default=None)
        if largest is None or largest.largest < MIN_CONTRAST_CHANGE:
            return ()
        index = int(np.nanargmax(np.abs(largest.contrast)))
        return (
            f"the body is treated as rigid: for a soft body supported at {HOLDS[str(largest.value)]}, the contrast "
            f"differs by {largest.contrast[index]:+.2g} at {largest.angle_deg[index]:+.3g}°; "
            'set motion.kind = "loaded" and specify its supports',
        )

    def _index_warnings(self) -> tuple[str, ...]:
        """Return a warning if the index is not known well enough."""
        effect = self.effect("material.index")
        if effect is None or not effect.by_uncertainty or effect.largest < MIN_CONTRAST_CHANGE:
            return ()
        place = int(np.nanargmax(np.abs(effect.contrast)))
        return (
            f"the index is known only to ± {effect.tolerance:.2g}: within this range the contrast "
            f"changes by up to {effect.largest:.2g}, at {effect.angle_deg[place]:+.3g}°",
        )


class _NotApplicableError(Exception):
    """Reason why a part does not apply to a design."""


def practice(
    sensor: Sensor, response: Response, progress: Progress | None = None, *, slope: Slope | None = None
) -> Practice:
    """Return the response of a sensor as in the paper and as built, and the effects of tolerances.

    Parameters
    ----------
    sensor
        The design.
    response
        Its response in power.
    progress
        Function called with the completed fraction, up to 1.
    slope
        Slope of the contrast at its null, if already computed.
    """
    skipped: dict[str, str] = {}

    def part(name: str, make: Callable[[], T], done: float) -> T | None:
        result: T | None = None
        try:
            result = make()
        except (_NotApplicableError, SolenError) as reason:
            skipped[name] = str(reason)
        if progress is not None:
            progress(done)
        return result

    paper = part("paper", lambda: _paper_response(sensor, response), 0.05)
    built_sensor = part("built", lambda: as_built(sensor), 0.1)
    built = None if built_sensor is None else part("built", lambda: _built(sensor, built_sensor, response, slope), 0.4)
    changes: tuple[Effect, ...] = ()
    if built_sensor is not None and built is not None:
        null = None
        if built.null_deg is not None and built.slope_per_deg is not None and built.u_slope_per_deg is not None:
            null = (built.null_deg, Slope(built.slope_per_deg, built.u_slope_per_deg))
        changes, omitted = effects(built_sensor, built.response, null, part_of(progress, 0.4, length=0.4))
        skipped |= omitted
    light_budget = part("budget", lambda: budget(sensor), 0.9)
    null_deg = None if built is None else built.null_deg
    lenses = part("lenses", lambda: lens_choice(sensor, response, null_deg), 1.0)
    return Practice(paper, built, changes, light_budget, lenses, skipped)


def extent_of(sensor: Sensor) -> Extent:
    """Return the size of the emitter as built."""
    light = sensor.light
    if light.ray_file is not None:
        return Extent(0.0, 0.0, "file")
    width_mm = light.width_mm or sensor.body().emitter.width_mm
    if width_mm > 0.0:
        return Extent(width_mm, light.height_mm or width_mm, "own")
    return Extent(CHIP_MM, light.height_mm or CHIP_MM, "comparison")


def _paper_response(sensor: Sensor, response: Response) -> Response:
    light = sensor.light
    values = PAPER | {"emitter.wavelength_nm": light.wavelength_nm}
    if sensor.design.lens.in_space:  # it would be the oval in the plane
        values |= NO_SHAPE_KEYS | {"lens.shape": "cartesian-oval"}
    paper = _with(sensor, values)
    if paper.light == light and sensor.scene().extrusion is None:
        raise _NotApplicableError("the design is a point in the plane")
    tolerance = None if paper.scene().is_random else PAPER_TOLERANCE
    return paper.refined(paper.power(response.angle_deg.tolist(), tolerance=tolerance), tolerance)


def as_built(sensor: Sensor) -> Sensor:
    """Return the sensor with its LED in space: a chip that emits into space in place of a point or a fan."""
    changes: dict[str, Any] = DARK | {"trace.dimension": "extruded"}
    extent, light = extent_of(sensor), sensor.light
    if extent.kind != "file":
        changes |= {"emitter.width_mm": extent.width_mm, "emitter.height_mm": extent.height_mm}
        if light.pattern == "fan":
            changes |= {"emitter.pattern": "lambertian", "emitter.cone_deg": light.cone_deg}
    return _with(sensor, changes)


def _built(sensor: Sensor, built_sensor: Sensor, response: Response, slope: Slope | None) -> Built:
    """Return the sensor as built; ``response`` and ``slope`` are those of the design."""
    is_design = built_sensor.light == sensor.light and sensor.design.trace.dimension == "extruded"
    if not is_design:
        angles, slope = subsample(response.angle_deg.tolist(), MAX_ANGLES), None
        response = built_sensor.refined(built_sensor.power(angles))
    null = response.null_deg()
    if slope is None and null is not None:
        slope = built_sensor.slope_per_deg(null, TOLERANCE)
    return Built(
        extent_of(sensor),
        "file" if built_sensor.light.ray_file is not None else built_sensor.light.pattern,
        built_sensor.light.pattern != sensor.light.pattern,
        built_sensor.light.cone_deg,
        built_sensor.design.body.thickness_mm,
        is_design,
        response,
        null,
        None if slope is None else slope.value,
        None if slope is None else slope.u_value,
    )


def _with(sensor: Sensor, values: dict[str, Any]) -> Sensor:
    """Return the sensor with some values set, and the same lens and material."""
    return replace(sensor, design=with_values(sensor.design, values))


def subsample(angles: Sequence[float], max_count: int) -> list[float]:
    """Return at most a given number of the angles, evenly spaced, with both ends."""
    indices = np.unique(np.round(np.linspace(0, len(angles) - 1, min(len(angles), max_count))).astype(int))
    return [angles[i] for i in indices.tolist()]


def slope_per_deg(response: Response, null_deg: float) -> float:
    """Return the slope of the contrast between the angles on either side of a null."""
    angle, value = response.angle_deg, response.contrast
    high = int(np.clip(np.searchsorted(angle, null_deg), 1, len(angle) - 1))
    low = high - 1 if angle[high] > null_deg or high == len(angle) - 1 else high
    high = max(high, low + 1)
    return float((value[high] - value[low]) / (angle[high] - angle[low]))
