"""Derivatives of a sensor's powers and contrast with respect to numbers of its design and to its angle."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from solen.errors import DesignError, SolenError, SpecError
from solen.progress import Progress, tracked
from solen.scene import Scene
from solen.sensor.numbers import inert, number, tolerance_of, usual_keys
from solen.sensor.response import Sensitivity, contrast_slope
from solen.spec import with_values
from solen.trace import Derivative, Mode, Slope, Trace, derivative, integrate
from solen.trace.adaptive import POINT_TOLERANCE, default_tolerance, is_extended, why_not
from solen.trace.derivative import EXTENDED_TOLERANCE, MAX_LEGS, SPACE_TOLERANCE, TOLERANCE

if TYPE_CHECKING:
    from solen.sensor.sensor import Sensor

SAMPLED_TOLERANCE = 2e-4
"""Required standard error of sampled light (light in space, and scattered light)."""
AROUND_ZERO, MIN_STEP_MM = ("emitter.offset_mm", "emitter.y_mm"), 0.003
"""Numbers with values around 0, and the smallest step for their derivatives."""
SLOPE_DEG, WIDE_SLOPE_DEG = 0.04, 0.2
"""Angle span of a slope: for a point emitter in the plane, whose response is steep, and for any other light."""


def derivative_of(sensor: "Sensor", key: str, angle_deg: float, mode: Mode, emitter: str | None) -> Derivative:
    """See `Sensor.derivative`."""
    network = sensor.design.network
    if emitter is not None and emitter != network.lit:
        return sensor.set({"network.lit": emitter}).derivative(key, angle_deg, mode, emitter=emitter)
    if emitter is None and len(network.emitters) > 1:
        names = ", ".join(emitter.name for emitter in network.emitters)
        raise SpecError("emitter", limit=f"missing: the emitters are {names}", remedy="name one of them")
    value = number(sensor, key)
    loss = {"material.absorption_per_mm": sensor.material.absorption_per_mm}
    kept = loss if key == "material.index" else {}  # a stated index replaces the resin and its loss

    def scene_at(value: float) -> Scene:
        other = type(sensor).of(with_values(sensor.design, kept | {key: value}))
        return (replace(other, cut=sensor.cut) if sensor.is_measured else other).scene(angle_deg)  # its shape is fixed

    wide = sensor.is_loaded or (key.startswith("lens.knots_um") and _has_smooth_light(sensor, angle_deg))
    step = 0.5 * tolerance_of(sensor, key)[0] if wide else None  # well above the noise of a mesh or an integral
    if key in AROUND_ZERO and _has_smooth_light(sensor, angle_deg):
        step = max(MIN_STEP_MM, 0.01 * abs(value))
    return derivative(scene_at, value, mode=mode, step=step)


def _has_smooth_light(sensor: "Sensor", angle_deg: float) -> bool:
    """Return whether the source is more than a point in the plane; numbers around 0 then need an absolute step."""
    scene = sensor.scene(angle_deg)
    return is_extended(scene) or scene.extrusion is not None


def sensitivities(
    sensor: "Sensor", keys: Sequence[str] | None, angle_deg: float, progress: Progress | None
) -> tuple[Sensitivity, ...]:
    """See `Sensor.sensitivity`."""
    sensor.check_pair()
    chosen = (
        [key for key in usual_keys(sensor) if not inert(sensor, key)] if keys is None else list(dict.fromkeys(keys))
    )
    for key in chosen:
        if why := inert(sensor, key):
            raise SpecError(key, limit=why, remedy="omit it")
    values = {key: number(sensor, key) for key in chosen}
    scene = sensor.scene(angle_deg)
    if (why := why_not(scene)) and not sensor.is_sampled:
        limit = "derivatives require point sources and no random scatter"
        raise DesignError("sensitivity", value=why, limit=limit, remedy="compare two designs with solen trace")
    in_space = scene.extrusion is not None
    tolerance = EXTENDED_TOLERANCE if is_extended(scene) else TOLERANCE
    tolerance = SPACE_TOLERANCE if in_space else tolerance
    if sensor.is_sampled:
        base, u = sensor.sampled(angle_deg)
        if u > SAMPLED_TOLERANCE:
            limit = f"its samples must reach {SAMPLED_TOLERANCE:g}"
            raise DesignError(f"light at {angle_deg:g} deg", value=f"{u:.1e}", limit=limit, remedy="use solen trace")
    else:
        base = integrate(scene, "power", tolerance, most_legs=None if in_space else MAX_LEGS)
    if not base.reached:
        limit = f"the integral must reach {tolerance:g}"
        raise DesignError(f"light at {angle_deg:g} deg", value=base.why, limit=limit, remedy="try another angle")
    rows = []
    for key, value in tracked(values.items(), progress):
        rows.append(replace(_sensitivity(sensor, key, value, angle_deg, base), tolerance=tolerance_of(sensor, key)[0]))
    return tuple(sorted(rows, key=lambda row: row.effect, reverse=True))


def _sensitivity(sensor: "Sensor", key: str, value: float, angle_deg: float, base: Trace) -> Sensitivity:
    """Return the row of one key; a value at the limit of its range has no derivative, and ``why`` then says so."""
    nothing = Slope(math.nan, math.nan)
    try:
        derivative = sensor.derivative(key, angle_deg)
    except SolenError as bad:
        return Sensitivity(
            key,
            value,
            nothing,
            nothing,
            nothing,
            f"values on both sides of {value:g} are required, and one is impossible: {bad}",
        )
    right, left = derivative.detectors["right"], derivative.detectors["left"]
    if not derivative.reached:
        return Sensitivity(key, value, nothing, nothing, nothing, derivative.why)
    return Sensitivity(key, value, right, left, contrast_slope(base, right, left))


def slope_per_deg(sensor: "Sensor", angle_deg: float, tolerance: float | None) -> Slope | None:
    """See `Sensor.slope_per_deg`."""
    point = default_tolerance(sensor.scene(angle_deg)) == POINT_TOLERANCE
    half = (SLOPE_DEG if point else WIDE_SLOPE_DEG) / 2
    near = sensor.power([angle_deg + n * half for n in (-2, -1, 1, 2)], tolerance=tolerance)
    value, u = near.contrast, near.u_contrast
    if not np.isfinite(value).all():
        return None
    close, wide = (value[2] - value[1]) / (2 * half), (value[3] - value[0]) / (4 * half)
    return Slope(float(close), float(abs(wide - close) / 3 + (u[1] + u[2]) / (2 * half)))
