"""Results for a design at one angle, depth or force: a trace with its names, convergence, and sensitivities."""

import math
from collections.abc import Sequence
from dataclasses import field
from typing import Protocol

from solen.errors import SpecError
from solen.progress import Progress
from solen.ranks import Caution, warning
from solen.results import HIDDEN, Result
from solen.sensor.numbers import optical_keys, why_inert
from solen.sensor.response import Sensitivity
from solen.sensor.sensor import Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design, with_values
from solen.trace import Convergence, Trace, convergence
from solen.trace.options import TraceOptions, check_paths, trace_with
from solen.trace.scene_file import Branch, branches, face_names


class DesignTrace(Trace, kw_only=True):
    """Trace of a design at one angle, depth or force.

    Attributes
    ----------
    sensor
        The sensor; not in JSON.
    value
        Value of the quantity that the motion drives; not in JSON.
    name, lens
        Name of the design, and shape of its lens.
    angle_deg, depth_mm, force_N
        Angle of the motion, or depth or force that loads a soft body; the others are None.
    in_space
        Whether rays were traced in space.
    faces
        Names of each receiver's interfaces, in the order of ``power_by_position``.
    branches
        Paths of all rays, if requested.
    warnings
        Warnings about the design, including keys without effect.
    """

    sensor: Sensor = field(metadata=HIDDEN)
    value: float = field(metadata=HIDDEN)
    name: str
    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None
    lens: str
    in_space: bool
    faces: dict[str, tuple[str, ...]]
    branches: tuple[Branch, ...] | None
    warnings: tuple[str, ...]


class DesignConvergence(Convergence, kw_only=True):
    """Error of a design's powers against the number of rays, at an angle or load; ``emitter`` is lit, in a network."""

    name: str
    emitter: str | None
    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None
    warnings: tuple[str, ...]


class Sensitivities(Result):
    """Derivatives of a design's readings at an angle, ranked by the effect of each number's tolerance.

    Attributes
    ----------
    name
        Name of the design.
    angle_deg, depth_mm, force_N
        Angle of its motion, or depth or force that loads a soft body; the others are None.
    sensitivities
        Derivatives with respect to each number of the design.
    skipped
        Reasons why numbers were omitted, keyed by number.
    warnings
        Warnings about the numbers.
    simulated
        Always true: nothing was measured.
    """

    name: str
    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None
    sensitivities: tuple[Sensitivity, ...]
    skipped: dict[str, str]
    warnings: tuple[str, ...]
    simulated: bool = True


def trace_design(
    sensor: Sensor, angle_deg: float = 0.0, options: TraceOptions = TraceOptions(), *, paths: bool = False
) -> DesignTrace:
    """Trace a design at an angle; ``paths`` stores the paths of all rays.

    Raises
    ------
    SpecError
        If an option has no effect, or the angle is invalid.
    """
    check_value(sensor, angle_deg)
    scene = sensor.scene(angle_deg)
    if paths:
        check_paths(scene)
    trace = trace_with(scene, options, sensor.design.trace.mode, paths=paths)
    return DesignTrace(
        **vars(trace),
        sensor=sensor,
        value=angle_deg,
        name=sensor.design.name,
        **sensor.design.motion.keyed(angle_deg),
        lens=sensor.design.lens.shape,
        in_space=scene.extrusion is not None,
        faces=face_names(scene),
        branches=branches(trace, scene) if paths else None,
        warnings=(*sensor.warnings, *keys_without_effect(sensor, trace.mode), *range_cautions(sensor, angle_deg)),
    )


def design_convergence(sensor: Sensor, angle_deg: float = 0.0) -> DesignConvergence:
    """Return the error against the number of rays at an angle, for each sampling method, in the design's mode."""
    check_value(sensor, angle_deg)
    result = convergence(sensor.scene(angle_deg), sensor.design.trace.mode)
    return DesignConvergence(
        **vars(result),
        **sensor.design.motion.keyed(angle_deg),
        name=sensor.design.name,
        emitter=sensor.design.network.lit,
        warnings=tuple(sensor.warnings),
    )


def sensitivities(
    sensor: Sensor, keys: Sequence[str] = (), angle_deg: float = 0.0, progress: Progress | None = None
) -> Sensitivities:
    """Return the derivatives of a design's readings at an angle with respect to numbers; see `Sensor.sensitivity`."""
    check_value(sensor, angle_deg)
    rows = sensor.sensitivity(keys or None, angle_deg, progress)
    skipped = {} if keys else {key: why for key in optical_keys(sensor) if (why := why_inert(sensor, key))}
    return Sensitivities(
        name=sensor.design.name,
        **sensor.design.motion.keyed(angle_deg),
        sensitivities=rows,
        skipped=skipped,
        warnings=tuple(sensor.warnings),
    )


def with_lit_emitter(design: Design, emitter: str | None) -> Design:
    """Return the design with the named emitter lit, by default that of ``network.lit``.

    Raises
    ------
    SpecError
        If none of several emitters is named, or one is named for a design that is not a network.
    """
    network = design.network
    if emitter is not None:
        return with_values(design, {"network.lit": emitter})
    if design.body.kind == "network" and network.lit is None and len(network.emitters) > 1:
        names = ", ".join(emitter.name for emitter in network.emitters)
        raise SpecError("--emitter", limit=f"is missing: the emitters are {names}", remedy="specify one of them")
    return design


def requested_value(sensor: Sensor, angle_deg: float | None, at: float | None) -> float:
    """Return the requested value of the driven quantity: an angle, by default 0, or a load, by default the last.

    Raises
    ------
    SpecError
        If ``at`` is specified for an angle, or an angle for a load.
    """
    motion = sensor.design.motion
    if sensor.is_network and (angle_deg is not None or at is not None):
        limit = "does not apply: a network has named motions"
        name, value = ("--at", at) if angle_deg is None else ("--angle-deg", angle_deg)
        raise SpecError(name, value=value, limit=limit, remedy="use --set network.motion[0].at_deg=...")
    if sensor.is_loaded:
        if angle_deg is not None:
            limit = f"does not apply: the motion drives {motion.drives}"
            raise SpecError("--angle-deg", value=angle_deg, limit=limit, remedy=f"use --at, in {motion.unit}")
        return motion.values()[-1] if at is None else at
    if at is not None:
        limit = f'does not apply with motion.kind = "{motion.kind}"'
        raise SpecError("--at", value=at, limit=limit, remedy="use --angle-deg")
    return angle_deg or 0.0


def check_value(sensor: Sensor, value: float) -> None:
    """Raise `SpecError` if an angle is outside -90° to 90°, or a load is not finite."""
    if not (math.isfinite(value) and (abs(value) < 90.0 or sensor.design.motion.unit != "deg")):
        limit = "must be between -90 and 90" if sensor.design.motion.unit == "deg" else "must be a finite number"
        raise SpecError("--at" if sensor.is_loaded else "--angle-deg", value=value, limit=limit)


def range_cautions(sensor: Sensor, value: float) -> tuple[Caution, ...]:
    """Return a warning if a load is outside the range of a soft body's motion."""
    if not sensor.is_loaded:
        return ()
    motion = sensor.design.motion
    low, high = motion.values()[0], motion.values()[-1]
    if low <= value <= high:
        return ()
    return (warning(f"{motion.drives} = {value:g} is outside the motion's range of {low:g} to {high:g} {motion.unit}"),)


class DrivenResult(Protocol):
    """A result for an angle, a depth or a force."""

    @property
    def angle_deg(self) -> float | None: ...  # noqa: D102

    @property
    def depth_mm(self) -> float | None: ...  # noqa: D102

    @property
    def force_N(self) -> float | None: ...  # noqa: D102


def value_text(result: DrivenResult) -> str:
    """Format the angle, depth or force of a result with its unit."""
    values = {"deg": result.angle_deg, "mm": result.depth_mm, "N": result.force_N}
    return next((f"{value:g} {unit}" for unit, value in values.items() if value is not None), "")
