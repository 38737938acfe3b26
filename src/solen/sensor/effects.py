"""Effects of tolerances: the change of the response when each number of a design deviates by its tolerance.

Derivatives in different units cannot be ranked; multiplied by tolerances, they show how real prints and LEDs affect the
sensor. Each number is changed in both directions while the lens keeps its designed shape, and the contrast is computed
near the null, at a third of the motion and at its ends; for symmetric sensors on one side only. The join between a
rotated lens and the stem is a modelling choice without a tolerance, and is compared with the other joins. The rigidity
of the body is also a modelling choice: it is compared with soft bodies on common mounts if the extra `mechanics` is
installed.

Public names: `effects`, `Effect`, `with_deviations` and `response_at`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import get_args

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SolenError
from solen.geometry.network import network_lenses
from solen.lens import Lens
from solen.material import Optical, Tabulated
from solen.parts import Light
from solen.progress import Progress, tracked
from solen.results import Result, reported
from solen.sensor.numbers import MATERIAL_KEYS, number, tolerance_of, why_inert
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.spec import Join, Motion, with_values
from solen.spec.soft import Hold, Mechanics
from solen.trace import Slope

KEYS = (
    *(f"emitter.{name}" for name in ("offset_mm", "width_mm", "distance_mm")),
    *("material.index", "material.absorption_per_mm", "body.arm_width_mm", "receivers.gap_mm"),
)
"""Numbers that are compared; in designs similar to the templates, other numbers have smaller effects."""
JOIN, HOLD = "motion.join", "hold"
HOLDS = {"outer-*": "the outer edges of the arms", "receiver-*": "the ends of the arms"}
"""Faces held by common mounts, and their names in sentences."""
HOLD_MESH_MM = 1.0
TOLERANCE, STANDARD_ERROR = 3e-4, 1e-3
"""Tolerance of integrated powers, and standard error of sampled ones."""
NEAR_FRACTION = 1 / 3
"""Distance of the intermediate angles from the null, as a fraction of the distance to an end of the motion."""
OPTICAL_MATERIAL_KEYS = {"material.absorption_per_mm", "emitter.wavelength_nm"}
"""Numbers other than the index that change the material at the emitter's wavelength."""
UNDRAWN_KEYS = ("emitter.", "material.", "network.emitters[")
"""Key prefixes of deviations that do not change the designed shapes of a network's lenses."""
COVERAGE_FACTOR = 2.0
"""Multiple of its uncertainty that a significant change exceeds."""


class Effect(Result):
    """Change of the response per tolerance of one number: half the difference between plus and minus the tolerance.

    Attributes
    ----------
    key, value
        The number and its value; for ``motion.join`` the other join, for ``hold`` the held faces of a soft body.
    tolerance, by_uncertainty
        Its tolerance, and whether that is its standard uncertainty; None for a join and a hold.
    angle_deg, contrast, u_contrast
        Angles (K,), the change of the contrast there and its uncertainty.
    received, u_received
        Relative change of the power at both receivers, averaged over these angles except 0.
    null_deg, u_null_deg
        Change of the null; None without a null.
    """

    key: str
    value: float | str
    tolerance: float | None
    by_uncertainty: bool
    angle_deg: FloatArray
    contrast: FloatArray
    u_contrast: FloatArray
    received: float
    u_received: float
    null_deg: float | None = None
    u_null_deg: float | None = None

    @reported
    def largest(self) -> float:
        """Largest absolute change of the contrast."""
        return float(np.abs(self.contrast[np.isfinite(self.contrast)]).max(initial=0.0))

    @reported
    def resolved(self) -> bool:
        """Whether the change at some angle exceeds twice its uncertainty."""
        return bool(np.any(np.abs(self.contrast) > COVERAGE_FACTOR * self.u_contrast))


def effects(
    sensor: Sensor, response: Response, null: tuple[float, Slope] | None, progress: Progress | None = None
) -> tuple[tuple[Effect, ...], dict[str, str]]:
    """Return the effects of numbers, joins and holds, the largest first, and the reasons why others are omitted.

    Parameters
    ----------
    sensor, response
        The sensor, and its response in power at some angles.
    null
        Its null and the slope of the contrast there.
    progress
        Function called with the completed fraction, up to 1.
    """
    tasks: list[tuple[str, Callable[[], Effect]]] = []
    skipped: dict[str, str] = {}
    base = _base(sensor, response, 0.0 if null is None else null[0])
    for key in KEYS:
        if why := "" if key in MATERIAL_KEYS else why_inert(sensor, key):
            skipped[key] = why
        else:
            tasks.append((key, partial(_number_effect, sensor, key, base, null)))
    tasks += [(f"{JOIN} = {join}", partial(_join_effect, sensor, join, base)) for join in _joins(sensor)]
    if _rotates_lens(sensor):
        tasks += [(f"{HOLD} = {face}", partial(_hold_effect, sensor, face, base)) for face in HOLDS]
    results: list[Effect] = []
    for name, make in tracked(tasks, progress):
        try:
            results.append(make())
        except SolenError as why:
            skipped[name] = str(why)
    return tuple(sorted(results, key=lambda effect: effect.largest, reverse=True)), skipped


def with_deviations(sensor: Sensor, steps: Mapping[str, float]) -> Sensor:
    """Return the sensor with numbers changed by steps; the lens keeps its shape unless a number of ``lens`` changes."""
    index = steps.get("material.index", 0.0)
    values = {key: number(sensor, key) + step for key, step in steps.items() if key != "material.index"}
    other = Sensor.of(with_values(sensor.design, values)) if values else sensor
    drawn = {key: value for key, value in values.items() if key.startswith("lens.")}
    material = other.material if sensor.is_network or OPTICAL_MATERIAL_KEYS & values.keys() else sensor.material
    return replace(
        other,
        material=_offset(material, index, other.light) if index else material,
        cut=Sensor.of(with_values(sensor.design, drawn)).cut if drawn else sensor.cut,
        lenses=_lenses_cut(sensor, values) if sensor.is_network else None,
    )


def _lenses_cut(sensor: Sensor, values: Mapping[str, float]) -> dict[str, Lens]:
    """Return the lenses of a network; deviations of emitters and the material do not change their shapes."""
    drawn = {key: value for key, value in values.items() if not key.startswith(UNDRAWN_KEYS)}
    return network_lenses(with_values(sensor.design, drawn))


def response_at(sensor: Sensor, angles: Sequence[float], existing: Response | None = None) -> Response:
    """Return the response at angles; angles of an existing response are not traced again."""
    missing = [angle for angle in angles if existing is None or angle not in existing.angle_deg]
    known = [angle for angle in angles if angle not in missing]
    kept = None if existing is None else existing.subset([existing.index_at(angle) for angle in known])
    if not missing and kept is not None:
        return kept
    traced = sensor.power(missing, tolerance=TOLERANCE, standard_error=STANDARD_ERROR)
    return traced if kept is None else kept.merged(traced)


def index_offsets(material: Optical, step: float) -> list[tuple[float, bool]]:
    """Return offsets of the index (lower, none, higher), and whether each is its standard uncertainty."""
    size = material.u_index or step
    offsets = [offset for offset in (-size, 0.0, size) if material.index + offset >= 1.0]
    return [(offset, bool(material.u_index) and offset != 0.0) for offset in offsets]


def _base(sensor: Sensor, response: Response, null_deg: float) -> Response:
    """Return the response near the null, at a third of the motion and at its ends; on one side only if symmetric."""
    first, last = float(response.angle_deg[0]), float(response.angle_deg[-1])
    ends = {first} if sensor.is_symmetric and first < 0.0 else {first, last}
    angles = ends | {null_deg + NEAR_FRACTION * (end - null_deg) for end in ends} | {null_deg}
    return response.subset(sorted({response.index_at(angle) for angle in angles}))


def _number_effect(sensor: Sensor, key: str, base: Response, null: tuple[float, Slope] | None) -> Effect:
    """Return half the change when a number goes from minus to plus its tolerance; at a limit, the one-sided change."""
    tolerance, by_uncertainty = tolerance_of(sensor, key)
    angles = base.angle_deg.tolist()
    ends = []
    for step in (-tolerance, tolerance):
        try:
            other = with_deviations(sensor, {key: step})
            other.body(angles[0])
        except SolenError:
            continue
        ends.append(_with_symmetric_rest(sensor, other, base) or response_at(other, angles))
    if not ends:
        with_deviations(sensor, {key: tolerance}).body(angles[0])  # raises the error of the impossible body
    low, high = ends if len(ends) == 2 else (base, ends[0])
    half = 1.0 / len(ends)
    effect = _effect(key, number(sensor, key), low, high, half)
    shift, u_shift = _shift(effect, null)
    return replace(effect, tolerance=tolerance, by_uncertainty=by_uncertainty, null_deg=shift, u_null_deg=u_shift)


def _with_symmetric_rest(sensor: Sensor, other: Sensor, base: Response) -> Response | None:
    """Return the response of ``other`` at the angles of ``base``, with the reading at rest copied from ``base``.

    Both have a contrast of 0 at rest if both sensors are symmetric; None if one is not, or rest is not in ``base``. The
    copied powers are not those of ``other``: `_effect` compares the light at the remaining angles.
    """
    at_rest = base.angle_deg == 0.0
    if at_rest.all() or not (at_rest.any() and sensor.is_symmetric and other.is_symmetric):
        return None
    moving = [float(angle) for angle in base.angle_deg if angle != 0.0]
    return response_at(other, moving).merged(base.subset(np.flatnonzero(at_rest).tolist()))


def _join_effect(sensor: Sensor, join: str, base: Response) -> Effect:
    """Return the effect of another join between the rotated lens and the stem."""
    other = replace(sensor.set({JOIN: join}), cut=sensor.cut, material=sensor.material)
    return _effect_at_ends(JOIN, join, base, other)


def _hold_effect(sensor: Sensor, face: str, base: Response) -> Effect:
    """Return the effect of a soft body with some faces held and its lens in a turning clamp."""
    return _effect_at_ends(HOLD, face, base, on_soft_body(sensor, face))


def _effect_at_ends(key: str, value: str, base: Response, other: Sensor) -> Effect:
    """Return the difference between another sensor and the base at the ends of the motion."""
    ends = {float(base.angle_deg[index]) for index in (0, -1)} - {0.0}
    response = response_at(other, sorted(ends))
    return _effect(key, value, base.subset([base.index_at(angle) for angle in response.angle_deg]), response, 1.0)


def on_soft_body(sensor: Sensor, face: str) -> Sensor:
    """Return the sensor on a soft body with some faces held; its modulus has no effect, as the angle is prescribed."""
    design = sensor.design
    motion = Motion(
        kind="loaded",
        drives="clamp.angle_deg",
        emitter_on="lens" if "emitter" in design.motion.moves else "ground",
        **{key: getattr(design.motion, key) for key in ("from_deg", "to_deg", "step_deg")},
    )
    holds = (Hold(name="mount", face=face), Hold(name="clamp", face="lens", kind="turning", about=design.motion.pivot))
    mechanics = Mechanics(modulus_MPa=1.0, mesh_mm=HOLD_MESH_MM)
    changed = design.model_copy(update={"motion": motion, "hold": holds, "mechanics": mechanics})
    return replace(sensor, design=changed.in_folder(design.folder))


def _rotates_lens(sensor: Sensor) -> bool:
    """Return whether the motion rotates a lens that solen has designed."""
    motion = sensor.design.motion
    return motion.kind == "rotation" and "lens" in motion.moves and sensor.has_lens and not sensor.is_drawn


def _joins(sensor: Sensor) -> tuple[str, ...]:
    """Return the other joins of a rotated lens."""
    return tuple(join for join in get_args(Join) if _rotates_lens(sensor) and join != sensor.design.motion.join)


def _effect(key: str, value: float | str, low: Response, high: Response, half: float) -> Effect:
    """Return the difference of two responses at the same angles, times ``half``; their light is compared off rest."""
    off_rest = np.flatnonzero(high.angle_deg != 0.0).tolist() or [0]
    compared = [response.subset(off_rest) for response in (low, high)]
    light = [response.received_share for response in compared]
    u_light = [float(np.max(2.0 * response.u_power)) for response in compared]
    return Effect(
        key,
        value,
        None,
        False,
        high.angle_deg,
        half * (high.contrast - low.contrast),
        half * (high.u_contrast + low.u_contrast),
        half * (light[1] - light[0]) / light[0] if light[0] > 0.0 else math.nan,
        half * sum(u_light) / light[0] if light[0] > 0.0 else math.nan,
    )


def _shift(effect: Effect, null: tuple[float, Slope] | None) -> tuple[float | None, float | None]:
    """Return the shift of the null and its uncertainty, from the change and the slope of the contrast there."""
    if null is None or not abs(null[1].value) > 0.0:
        return None, None
    near, slope = int(np.argmin(np.abs(effect.angle_deg - null[0]))), null[1]
    shift = -float(effect.contrast[near]) / slope.value
    return shift, float(effect.u_contrast[near]) / abs(slope.value) + abs(shift * slope.u_value / slope.value)


def _offset(material: Optical, step: float, light: Light) -> Optical:
    """Return the material with its index changed by a step at all wavelengths of the light."""
    dispersion = material.dispersion
    if dispersion is None or not light.spectrum:
        return replace(material, index=material.index + step, dispersion=None)
    lines = sorted({light.wavelength_nm, *(nm for nm, _ in light.spectrum)})
    values = [dispersion.index(nm) + step for nm in lines]
    if len(lines) == 1:
        lines, values = [*lines, lines[0] + 1.0], [*values, values[0]]
    table = Tabulated(kind="table", wavelength_nm=tuple(lines), n=tuple(values))
    return replace(material, index=material.index + step, dispersion=table)
