"""Effects of tolerances: the change of the response when each number of a design deviates by its tolerance.

Derivatives in different units cannot be ranked. Multiplied by tolerances, they show how real prints and LEDs affect the
sensor. Each number is changed in both directions while the lens keeps its designed shape, and the contrast is
integrated near the null, at a third of the motion and at its ends; for symmetric sensors on one side only. The join
between a turned lens and the stem is a modelling choice without a tolerance; for it, the other joins are compared. The
body's rigidity is also a modelling choice: soft bodies with usual mounts are compared if the extra `mechanics` is
installed.

Public names: `effects` and `Effect`.
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
from solen.sensor.numbers import OF_THE_MATERIAL, inert, number, tolerance_of
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.spec import Join, Motion, with_values
from solen.spec.soft import Hold, Mechanics
from solen.trace import Slope

KEYS = (
    *(f"emitter.{name}" for name in ("offset_mm", "width_mm", "distance_mm")),
    *("material.index", "material.absorption_per_mm", "body.arm_width_mm", "receivers.gap_mm"),
)
"""Numbers that are compared; other numbers have less effect on the light in designs similar to the shipped ones."""
JOIN, HOLD = "motion.join", "hold"
HOLDS = {"outer-*": "the outer edges of the arms", "receiver-*": "the ends of the arms"}
"""Faces held by usual mounts, and their names in sentences."""
HOLD_MESH_MM = 1.0
TOLERANCE, STANDARD_ERROR = 3e-4, 1e-3
"""Tolerance of integrated powers, and standard error of sampled ones."""
NEAR_SHARE = 1 / 3
OF_MATERIAL = {"material.absorption_per_mm", "emitter.wavelength_nm"}
"""Numbers other than the index on which the material at the emitter's wavelength depends."""
OFF_A_DRAWING = ("emitter.", "material.", "network.emitters[")
"""Key prefixes of deviations that do not change the drawing of a network's lenses."""
RESOLVED = 2.0
"""A change is significant if it exceeds this multiple of its uncertainty."""


class Effect(Result):
    """Change of the response when one number exceeds its value by its tolerance: half the difference of high and low.

    Attributes
    ----------
    key, value
        The number and its value; for ``motion.join`` the other join, for ``hold`` the faces that hold a soft body.
    tolerance, by_uncertainty
        Its tolerance, and whether that is its standard uncertainty; None for a join and a hold.
    angle_deg, contrast, u_contrast
        Angles (K,), the change of the contrast there and its uncertainty.
    received, u_received
        Relative change of the power at both receivers, averaged over these angles.
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
        """Whether a change exceeds twice its uncertainty."""
        return bool(np.any(np.abs(self.contrast) > RESOLVED * self.u_contrast))


def effects(
    sensor: Sensor, response: Response, null: tuple[float, Slope] | None, progress: Progress | None = None
) -> tuple[tuple[Effect, ...], dict[str, str]]:
    """Return the effects of the numbers in `KEYS` and of the joins, the largest first, and why others are omitted.

    Parameters
    ----------
    sensor, response
        The sensor, and its response in power at some angles.
    null
        Its null and the slope of the contrast there.
    progress
        Function called with the completed fraction, up to 1.
    """
    asked: list[tuple[str, Callable[[], Effect]]] = []
    skipped: dict[str, str] = {}
    base = _base(sensor, response, 0.0 if null is None else null[0])
    for key in KEYS:
        if why := "" if key in OF_THE_MATERIAL else inert(sensor, key):
            skipped[key] = why
        else:
            asked.append((key, partial(_of_number, sensor, key, base, null)))
    asked += [(f"{JOIN} = {join}", partial(_of_join, sensor, join, base)) for join in _joins(sensor)]
    if _turns(sensor):
        asked += [(f"{HOLD} = {face}", partial(_of_hold, sensor, face, base)) for face in HOLDS]
    found: list[Effect] = []
    for name, make in tracked(asked, progress):
        try:
            found.append(make())
        except SolenError as why:
            skipped[name] = str(why)
    return tuple(sorted(found, key=lambda one: one.largest, reverse=True)), skipped


def off_by(sensor: Sensor, key: str, step: float) -> Sensor:
    """Return the sensor with one number changed by a step; see `as_built`."""
    return as_built(sensor, {key: step})


def as_built(sensor: Sensor, steps: Mapping[str, float]) -> Sensor:
    """Return the sensor with numbers changed by steps; the lens keeps its shape unless its drawing is changed."""
    index = steps.get("material.index", 0.0)
    values = {key: number(sensor, key) + step for key, step in steps.items() if key != "material.index"}
    other = Sensor.of(with_values(sensor.design, values)) if values else sensor
    drawn = {key: value for key, value in values.items() if key.startswith("lens.")}
    material = other.material if sensor.is_network or OF_MATERIAL & values.keys() else sensor.material
    return replace(
        other,
        material=_offset(material, index, other.light) if index else material,
        cut=Sensor.of(with_values(sensor.design, drawn)).cut if drawn else sensor.cut,
        lenses=_lenses_cut(sensor, values) if sensor.is_network else None,
    )


def _lenses_cut(sensor: Sensor, values: Mapping[str, float]) -> dict[str, Lens]:
    """Return the lenses of a network; deviations of emitters and the material do not change their drawing."""
    drawn = {key: value for key, value in values.items() if not key.startswith(OFF_A_DRAWING)}
    return network_lenses(with_values(sensor.design, drawn))


def swept(sensor: Sensor, angles: Sequence[float], known: Response | None = None) -> Response:
    """Return the response at angles; angles of an existing response are not traced again."""
    missing = [angle for angle in angles if known is None or angle not in known.angle_deg]
    old = None if known is None else known.part([known.at(angle) for angle in angles if angle not in missing])
    if not missing and old is not None:
        return old
    found = sensor.power(missing, tolerance=TOLERANCE, standard_error=STANDARD_ERROR)
    return found if old is None else old.joined(found)


def index_steps(material: Optical, step: float) -> list[tuple[float, bool]]:
    """Return the offsets of the index (lower, none, higher), and whether they are its standard uncertainty."""
    size = material.u_index or step
    offsets = [one for one in (-size, 0.0, size) if material.index + one >= 1.0]
    return [(offset, bool(material.u_index) and offset != 0.0) for offset in offsets]


def _base(sensor: Sensor, response: Response, null_deg: float) -> Response:
    """Return the response near the null, at a third of the motion and at its ends; on one side only if symmetric."""
    there = response.angle_deg
    wanted = {float(there[0]), *(() if sensor.is_symmetric and there[0] < 0.0 else (float(there[-1]),))}
    wanted |= {null_deg + NEAR_SHARE * (end - null_deg) for end in wanted} | {null_deg}
    return response.part(sorted({response.at(angle) for angle in wanted}))


def _of_number(sensor: Sensor, key: str, base: Response, null: tuple[float, Slope] | None) -> Effect:
    """Return half the change between the number minus and plus its tolerance; one-sided at a limit."""
    tolerance, stated = tolerance_of(sensor, key)
    angles = base.angle_deg.tolist()
    ends = []
    for step in (-tolerance, tolerance):
        try:
            other = off_by(sensor, key, step)
            other.body(angles[0])
        except SolenError:
            continue
        ends.append(_still(sensor, other, base) or swept(other, angles))
    if not ends:
        off_by(sensor, key, tolerance).body(angles[0])  # raises the reason if impossible
    low, high = ends if len(ends) == 2 else (base, ends[0])
    half = 1.0 / len(ends)
    effect = _effect(key, number(sensor, key), low, high, half)
    shift, u_shift = _shift(effect, null)
    return replace(effect, tolerance=tolerance, by_uncertainty=stated, null_deg=shift, u_null_deg=u_shift)


def _still(sensor: Sensor, other: Sensor, base: Response) -> Response | None:
    """Return the response at rest if the sensor is symmetric (its contrast is 0 without a trace), else None."""
    resting = base.angle_deg == 0.0
    if not (resting.any() and sensor.is_symmetric and other.is_symmetric):
        return None
    moving = [float(angle) for angle in base.angle_deg if angle != 0.0]
    return swept(other, moving).joined(base.part(np.flatnonzero(resting).tolist()))


def _of_join(sensor: Sensor, join: str, base: Response) -> Effect:
    """Return the effect of another join of the turned lens and the stem."""
    other = sensor.set({JOIN: join})
    other = replace(other, cut=sensor.cut, material=sensor.material)
    ends = {float(base.angle_deg[place]) for place in (0, -1)} - {0.0}
    found = swept(other, sorted(ends))
    return _effect(JOIN, join, base.part([base.at(angle) for angle in found.angle_deg]), found, 1.0)


def _of_hold(sensor: Sensor, face: str, base: Response) -> Effect:
    """Return the effect of a soft body with some faces held and its lens in a turning clamp."""
    ends = {float(base.angle_deg[place]) for place in (0, -1)} - {0.0}
    found = swept(soft(sensor, face), sorted(ends))
    return _effect(HOLD, face, base.part([base.at(angle) for angle in found.angle_deg]), found, 1.0)


def soft(sensor: Sensor, face: str) -> Sensor:
    """Return the sensor on a soft body with some faces held; driven by its clamp's angle, it needs no modulus."""
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


def _turns(sensor: Sensor) -> bool:
    """Return whether solen designs the lens and the motion rotates it."""
    motion = sensor.design.motion
    return motion.kind == "rotation" and "lens" in motion.moves and sensor.has_lens and not sensor.is_drawn


def _joins(sensor: Sensor) -> tuple[str, ...]:
    """Return the other joins of a lens that rotates."""
    return tuple(join for join in get_args(Join) if _turns(sensor) and join != sensor.design.motion.join)


def _effect(key: str, value: float | str, low: Response, high: Response, half: float) -> Effect:
    """Return the difference of two responses at the same angles, times ``half``."""
    light = [float(np.mean(one.right + one.left)) for one in (low, high)]
    u_light = [float(np.max(2.0 * one.u_power)) for one in (low, high)]
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
    """Return the shift of the null, from the change of the contrast there and its slope."""
    if null is None or not abs(null[1].value) > 0.0:
        return None, None
    near, slope = int(np.argmin(np.abs(effect.angle_deg - null[0]))), null[1]
    shift = -float(effect.contrast[near]) / slope.value
    return shift, float(effect.u_contrast[near]) / abs(slope.value) + abs(shift * slope.u_value / slope.value)


def _offset(material: Optical, step: float, light: Light) -> Optical:
    """Return the material with its index changed by a step at all wavelengths of a light."""
    dispersion = material.dispersion
    if dispersion is None or not light.spectrum:
        return replace(material, index=material.index + step, dispersion=None)
    lines = sorted({light.wavelength_nm, *(nm for nm, _ in light.spectrum)})
    values = [dispersion.index(nm) + step for nm in lines]
    if len(lines) == 1:
        lines, values = [*lines, lines[0] + 1.0], [*values, values[0]]
    moved = Tabulated(kind="table", wavelength_nm=tuple(lines), n=tuple(values))
    return replace(material, index=material.index + step, dispersion=moved)
