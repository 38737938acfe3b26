"""Derivatives of a sensor's powers and contrast with respect to numbers of its design, and to its angle."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from solen.errors import DesignError, SolenError, SpecError
from solen.progress import Progress, tracked
from solen.scene import Scene
from solen.sensor.numbers import number, optical_keys, tolerance_of, why_inert
from solen.sensor.response import Sensitivity, contrast_slope
from solen.spec import with_values
from solen.trace import Derivative, Mode, Slope, Trace, derivative, integrate
from solen.trace.adaptive import POINT_TOLERANCE, default_tolerance, integration_obstacle, is_extended
from solen.trace.derivative import EXTENDED_TOLERANCE, MAX_SEGMENTS, SPACE_TOLERANCE, TOLERANCE

if TYPE_CHECKING:
    from solen.sensor.sensor import Sensor

SAMPLED_TOLERANCE = 2e-4
"""Required standard error of sampled powers, through a lens that is not a cylinder or with random scatter."""
NEAR_ZERO_KEYS, MIN_STEP_MM = ("emitter.offset_mm", "emitter.y_mm"), 0.003
"""Numbers with values around 0, and the smallest step of their derivatives."""
SLOPE_DEG, WIDE_SLOPE_DEG = 0.04, 0.2
"""Angle span of a slope: for a point emitter in the plane, whose response is steep, and for any other emitter."""


def derivative_of(sensor: "Sensor", key: str, angle_deg: float, mode: Mode, emitter: str | None) -> Derivative:
    """See `Sensor.derivative`."""
    network = sensor.design.network
    if emitter is not None and emitter != network.lit:
        return sensor.set({"network.lit": emitter}).derivative(key, angle_deg, mode, emitter=emitter)
    if emitter is None and len(network.emitters) > 1:
        names = ", ".join(emitter.name for emitter in network.emitters)
        raise SpecError("emitter", limit=f"is missing: the emitters are {names}", remedy="name one of them")
    value = number(sensor, key)
    loss = {"material.absorption_per_mm": sensor.material.absorption_per_mm}
    kept = loss if key == "material.index" else {}  # an index in the design replaces the resin and its loss

    def scene_at(value: float) -> Scene:
        other = type(sensor).of(with_values(sensor.design, kept | {key: value}))
        return (replace(other, cut=sensor.cut) if sensor.is_measured else other).scene(angle_deg)  # its shape is fixed

    is_noisy = sensor.is_loaded or (key.startswith("lens.knots_um") and _is_extended(sensor, angle_deg))
    step = 0.5 * tolerance_of(sensor, key)[0] if is_noisy else None  # well above the noise of a mesh or an integral
    if key in NEAR_ZERO_KEYS and _is_extended(sensor, angle_deg):
        step = max(MIN_STEP_MM, 0.01 * abs(value))
    return derivative(scene_at, value, mode=mode, step=step)


def _is_extended(sensor: "Sensor", angle_deg: float) -> bool:
    """Return whether the source is more than a point in the plane."""
    scene = sensor.scene(angle_deg)
    return is_extended(scene) or scene.extrusion is not None


def sensitivities(
    sensor: "Sensor", keys: Sequence[str] | None, angle_deg: float, progress: Progress | None
) -> tuple[Sensitivity, ...]:
    """See `Sensor.sensitivity`."""
    sensor.check_pair()
    selected = (
        [key for key in optical_keys(sensor) if not why_inert(sensor, key)]
        if keys is None
        else list(dict.fromkeys(keys))
    )
    for key in selected:
        if why := why_inert(sensor, key):
            raise SpecError(key, limit=why, remedy=f"omit {key}")
    values = {key: number(sensor, key) for key in selected}
    scene = sensor.scene(angle_deg)
    if (why := integration_obstacle(scene)) and not sensor.is_sampled:
        limit = f"is not available for {why}, whose light cannot be integrated"
        raise DesignError("sensitivity", limit=limit, remedy="compare two designs with solen trace")
    base = _base(sensor, scene, angle_deg)
    rows = []
    for key, value in tracked(values.items(), progress):
        rows.append(replace(_sensitivity(sensor, key, value, angle_deg, base), tolerance=tolerance_of(sensor, key)[0]))
    return tuple(sorted(rows, key=lambda row: row.effect, reverse=True))


def _base(sensor: "Sensor", scene: Scene, angle_deg: float) -> Trace:
    """Return the powers at an angle; raise `DesignError` if they are not accurate enough."""
    light = f"light at {angle_deg:g} deg"
    if sensor.is_sampled:
        base, u = sensor.sampled(angle_deg)
        if u > SAMPLED_TOLERANCE:
            limit = f"its standard error, {u:.1e}, must not exceed {SAMPLED_TOLERANCE:g}"
            raise DesignError(light, limit=limit, remedy="use solen trace")
        return base
    in_space = scene.extrusion is not None
    tolerance = SPACE_TOLERANCE if in_space else EXTENDED_TOLERANCE if is_extended(scene) else TOLERANCE
    base = integrate(scene, "power", tolerance, max_segments=None if in_space else MAX_SEGMENTS)
    if not base.reached:
        limit = f"cannot be integrated to {tolerance:g}: {base.why}"
        raise DesignError(light, limit=limit, remedy="try another angle")
    return base


def _sensitivity(sensor: "Sensor", key: str, value: float, angle_deg: float, base: Trace) -> Sensitivity:
    """Return the row of one key; ``why`` explains a missing derivative, such as that at the end of a range."""
    undefined = Slope(math.nan, math.nan)
    try:
        derivative = sensor.derivative(key, angle_deg)
    except SolenError as error:
        why = f"values on both sides of {value:g} are required, and one is impossible: {error}"
        return Sensitivity(key, value, undefined, undefined, undefined, why)
    right, left = derivative.detectors["right"], derivative.detectors["left"]
    if not derivative.reached:
        return Sensitivity(key, value, undefined, undefined, undefined, derivative.why)
    return Sensitivity(key, value, right, left, contrast_slope(base, right, left))


def slope_per_deg(sensor: "Sensor", angle_deg: float, tolerance: float | None) -> Slope | None:
    """See `Sensor.slope_per_deg`."""
    point = default_tolerance(sensor.scene(angle_deg)) == POINT_TOLERANCE
    half = (SLOPE_DEG if point else WIDE_SLOPE_DEG) / 2
    near = sensor.power([angle_deg + n * half for n in (-2, -1, 1, 2)], tolerance=tolerance)
    value, u = near.contrast, near.u_contrast
    if not np.isfinite(value).all():
        return None
    close, is_noisy = (value[2] - value[1]) / (2 * half), (value[3] - value[0]) / (4 * half)
    return Slope(float(close), float(abs(is_noisy - close) / 3 + (u[1] + u[2]) / (2 * half)))
