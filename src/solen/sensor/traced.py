"""Results at one angle of a design: a trace with its names, convergence, and sensitivities."""

import math
from collections.abc import Sequence
from dataclasses import field

from solen.arrays import Progress
from solen.errors import SpecError
from solen.results import HIDDEN, Result
from solen.sensor.numbers import inert, usual_keys
from solen.sensor.response import Sensitivity
from solen.sensor.sensor import Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.trace import Convergence, Trace, convergence
from solen.trace.described import Branch, branches, face_names
from solen.trace.options import TraceOptions, check_paths, trace_with


class DesignTrace(Trace, kw_only=True):
    """Trace of a design at an angle.

    Attributes
    ----------
    sensor
        The scene traced; not in JSON.
    name, angle_deg, lens
        Name of the design, angle of its motion, and shape of its lens.
    in_space
        Whether rays were traced in space.
    faces
        Names of each receiver's interfaces, in the order of ``power_by_position``.
    branches
        Paths of all rays, where they were asked for.
    warnings
        Warnings, and keys that have no effect.
    """

    sensor: Sensor = field(metadata=HIDDEN)
    name: str
    angle_deg: float
    lens: str
    in_space: bool
    faces: dict[str, tuple[str, ...]]
    branches: tuple[Branch, ...] | None
    warnings: tuple[str, ...]


class DesignConvergence(Convergence, kw_only=True):
    """Error against rays of a design at an angle, with what must be known of it."""

    name: str
    angle_deg: float
    warnings: tuple[str, ...]


class Sensitivities(Result):
    """Derivatives of a design's readings at an angle, ranked by what a tolerance of each number does.

    Attributes
    ----------
    name, angle_deg
        Name of the design, and angle of its motion.
    sensitivities
        One for each number of the design.
    skipped
        Why numbers were left out, by their keys.
    warnings
        Warnings about the numbers.
    simulated
        Always true: nothing was measured.
    """

    name: str
    angle_deg: float
    sensitivities: tuple[Sensitivity, ...]
    skipped: dict[str, str]
    warnings: tuple[str, ...]
    simulated: bool = True


def trace_design(
    sensor: Sensor, angle_deg: float = 0.0, options: TraceOptions = TraceOptions(), *, paths: bool = False
) -> DesignTrace:
    """Trace a design at an angle; ``paths`` keeps those of all rays.

    Raises
    ------
    SpecError
        Where an option has no effect, or the angle is none.
    """
    check_angle(angle_deg)
    scene = sensor.scene(angle_deg)
    if paths:
        check_paths(scene)
    trace = trace_with(scene, options, sensor.design.trace.mode, paths=paths)
    return DesignTrace(
        **vars(trace),
        sensor=sensor,
        name=sensor.design.name,
        angle_deg=angle_deg,
        lens=sensor.design.lens.shape,
        in_space=scene.extrusion is not None,
        faces=face_names(scene),
        branches=branches(trace, scene) if paths else None,
        warnings=(*sensor.warnings, *keys_without_effect(sensor, trace.mode)),
    )


def design_convergence(sensor: Sensor, angle_deg: float = 0.0) -> DesignConvergence:
    """Error against rays of a design at an angle, in its own mode, for each way to choose the rays."""
    check_angle(angle_deg)
    found = convergence(sensor.scene(angle_deg), sensor.design.trace.mode)
    return DesignConvergence(
        **vars(found), name=sensor.design.name, angle_deg=angle_deg, warnings=tuple(sensor.warnings)
    )


def sensitivities(
    sensor: Sensor, keys: Sequence[str] = (), angle_deg: float = 0.0, progress: Progress | None = None
) -> Sensitivities:
    """Derivatives of a design's readings at an angle by numbers of it; see `Sensor.sensitivity`."""
    check_angle(angle_deg)
    rows = sensor.sensitivity(keys or None, angle_deg, progress)
    skipped = {} if keys else {key: why for key in usual_keys(sensor) if (why := inert(sensor, key))}
    return Sensitivities(sensor.design.name, angle_deg, rows, skipped, tuple(sensor.warnings))


def check_angle(angle_deg: float) -> None:
    """`SpecError` for an angle that no motion reaches."""
    if not (math.isfinite(angle_deg) and abs(angle_deg) < 90.0):
        raise SpecError("--angle-deg", value=angle_deg, limit="must be between -90 and 90")
