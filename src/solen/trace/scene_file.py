"""Scene files and their traces, with the face names and the units of the file.

`open_scene` reads a scene in the JSON format of solen or ray-optics; `trace_scene` traces it, and `label_trace` adds
names and units to the trace. `face_names` and `branches` use the face names of a scene for any trace.
"""

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from solen import files
from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.plane import Point
from solen.results import HIDDEN, Result
from solen.scene import Monitor, Scene, loads, rayoptics
from solen.trace.options import TraceOptions, trace_with
from solen.trace.result import Crossed, Trace
from solen.trace.round_robin import RoundRobin, trace_round_robin


class Branch(Result):
    """Path of one branch of a ray, with the names of the faces that it meets; see `solen.trace.Path`."""

    ray: int
    branch: int
    parent: int
    fate: str
    power: float
    faces: tuple[str, ...]
    points_mm: FloatArray
    exit_direction: Point | None


class ScreenReading(Result):
    """Reading of a receiver, monitor or detector of a scene file, in the units of that file.

    Attributes
    ----------
    power, u_power
        Power and its uncertainty, which is None for a single ray.
    rays
        Number of rays or branches that arrived.
    position, irradiance
        Start of each bin along a monitor and power per unit length in each bin, both (bins,); None without bins.
    """

    power: float
    u_power: float | None
    rays: int
    position: FloatArray | None = None
    irradiance: FloatArray | None = None


class SceneTrace(Trace, kw_only=True):
    """Trace of a scene file.

    Attributes
    ----------
    scene
        The scene that was traced; omitted from JSON.
    name, format
        Name of the scene, and file format: ``solen`` or ``ray-optics``.
    length_unit, power_unit
        Units of the readings; detectors and ledger are always in fractions of the emitted power.
    emitted
        Total power of all sources, in the unit of the file.
    in_space
        Whether rays were traced in space.
    readings
        Readings of receivers, monitors and detectors, keyed by name.
    faces
        Names of the interfaces of each receiver, in the order of ``power_by_position``.
    not_understood
        Parts of a ray-optics scene that were omitted.
    branches
        Paths of all rays, if requested.
    warnings
        Warnings about the readings.
    """

    scene: Scene = field(metadata=HIDDEN)
    name: str
    format: str
    length_unit: str
    power_unit: str
    emitted: float
    in_space: bool
    readings: dict[str, ScreenReading]
    faces: dict[str, tuple[str, ...]]
    not_understood: tuple[rayoptics.NotUnderstood, ...] = ()
    branches: tuple[Branch, ...] | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class SceneFile:
    """A scene read from a file; ``imported`` contains further data if it is a ray-optics file."""

    scene: Scene
    imported: rayoptics.Imported | None = None

    @property
    def format(self) -> str:
        """``solen`` or ``ray-optics``."""
        return "solen" if self.imported is None else "ray-optics"

    @property
    def length_unit(self) -> str:
        """Unit of the lengths in the file: mm in a solen scene."""
        return "mm" if self.imported is None else "unit of the file"


class SceneCheck(Result):
    """Summary of a valid scene file.

    Attributes
    ----------
    name, format
        Name of the scene, and file format: ``solen`` or ``ray-optics``.
    regions, interfaces, sources, rays
        Numbers of regions, interfaces, sources and rays.
    receivers, monitors
        Names of receivers and monitors; for a ray-optics scene, ``monitors`` contains its detectors.
    in_space
        Whether the scene is extruded.
    is_random
        Whether the scene scatters at random, so that it can be sampled but not integrated.
    not_understood
        Parts of a ray-optics scene that were omitted.
    warnings
        Warnings about the readings.
    """

    name: str
    format: str
    regions: int
    interfaces: int
    sources: int
    rays: int
    receivers: tuple[str, ...]
    monitors: tuple[str, ...]
    in_space: bool
    is_random: bool
    not_understood: tuple[rayoptics.NotUnderstood, ...]
    warnings: tuple[str, ...]


def scene_check(file: SceneFile) -> SceneCheck:
    """Return a summary of a scene file."""
    scene, imported = file.scene, file.imported
    screens = imported.detectors if imported else scene.monitors
    return SceneCheck(
        name=scene.name,
        format=file.format,
        regions=len(scene.regions),
        interfaces=len(scene.interfaces),
        sources=len(scene.sources),
        rays=scene.rays,
        receivers=scene.receivers,
        monitors=tuple(screen.name for screen in screens),
        in_space=scene.extrusion is not None,
        is_random=scene.is_random,
        not_understood=tuple(imported.not_understood) if imported else (),
        warnings=tuple(_grating_warnings(scene)),
    )


def open_scene(path: Path, *, facets: bool) -> SceneFile:
    """Open a scene file; raise `DataError` if it has neither format. For ``facets`` see `rayoptics.loads`."""
    text = files.read_text(path, DataError)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as bad:
        raise DataError(str(path), limit=f"is not JSON: {bad}") from None
    if rayoptics.recognised(data):
        imported = rayoptics.loads(text, str(path), facets=facets)
        return SceneFile(imported.scene, imported)
    if isinstance(data, dict) and "solen_scene" in data:
        return SceneFile(loads(text, str(path)))
    limit = (
        "is not a scene: neither in solen's format (no key solen_scene) nor in ray-optics' "
        "(no list objs with a version)"
    )
    raise DataError(str(path), limit=limit)


def trace_scene(file: SceneFile, options: TraceOptions = TraceOptions(), *, paths: bool = False) -> Trace:
    """Trace a scene file in the requested mode.

    Without a mode, a solen scene is traced in power mode, and a ray-optics scene with the algorithm of that program.

    Raises
    ------
    SpecError
        If an option does not apply to the scene.
    """
    if file.imported is not None and options.mode is None:
        return _round_robin(file.imported, options, paths)
    return trace_with(file.scene, options, paths=paths)


def label_trace(file: SceneFile, trace: Trace, *, paths: bool = False) -> SceneTrace:
    """Return a trace of a scene file with the names and units of the file; if ``paths``, include the branches."""
    scene, imported = file.scene, file.imported
    return SceneTrace(
        **vars(trace),
        scene=scene,
        name=scene.name,
        format=file.format,
        length_unit=file.length_unit,
        power_unit="fraction of the emitted power" if imported is None else "brightness",
        emitted=scene.emitted,
        in_space=scene.extrusion is not None,
        readings=_of_receivers(scene, trace)
        | (_of_detectors(imported, trace) if imported else _of_monitors(scene, trace)),
        faces=face_names(scene),
        not_understood=() if imported is None else tuple(imported.not_understood),
        branches=branches(trace, scene) if paths else None,
        warnings=tuple(_grating_warnings(scene)),
    )


def _grating_warnings(scene: Scene) -> Iterator[str]:
    """Yield a warning for each grating whose efficiencies add up to more than 1, which ray-optics permits."""
    for interface in scene.interfaces:
        grating = None if interface.surface is None else interface.surface.grating
        total = math.fsum(efficiency for _, efficiency in grating.orders) if grating else 0.0
        if total > 1.0:
            yield (
                f"{interface.name}: the efficiencies of its orders add up to {total:.6g} in this file; "
                "the excess power is subtracted from the truncated power in the ledger"
            )


def face_names(scene: Scene) -> dict[str, tuple[str, ...]]:
    """Return the interface names of each receiver in a scene."""
    return {name: tuple(i.name for i in scene.interfaces if i.receiver == name) for name in scene.receivers}


def branches(trace: Trace, scene: Scene) -> tuple[Branch, ...]:
    """Return the paths of a trace that stored its segments, with the names of the faces met."""
    names = [interface.name for interface in scene.interfaces]
    return tuple(
        Branch(
            ray=path.ray,
            branch=path.branch,
            parent=path.parent,
            fate=path.fate,
            power=path.power,
            faces=tuple(names[i] for i in path.interfaces),
            points_mm=path.points_mm,
            exit_direction=path.exit_direction,
        )
        for path in trace.paths()
    )


def _round_robin(imported: rayoptics.Imported, options: TraceOptions, paths: bool) -> Trace:
    """Trace with the algorithm of the program ray-optics, for which no options can be set."""
    for name, value in options.model_dump(exclude_defaults=True).items():
        limit = "does not apply when tracing with the algorithm of the program ray-optics"
        raise SpecError(f"--{name}", value=value, limit=limit, remedy="add --mode power to trace with solen's engine")
    max_hits = {} if imported.max_hits is None else {"max_hits": imported.max_hits}
    rules = RoundRobin(imported.weak, imported.weakest, imported.fresh, **max_hits)
    return trace_round_robin(imported.scene, rules, segments=paths)


def _of_receivers(scene: Scene, trace: Trace) -> dict[str, ScreenReading]:
    received = ((name, trace.detectors[name]) for name in scene.receivers)
    return {name: ScreenReading(reading.power, reading.u_power, reading.rays) for name, reading in received}


def _of_monitors(scene: Scene, trace: Trace) -> dict[str, ScreenReading]:
    return {monitor.name: _monitor_reading(monitor, trace.monitors[monitor.name]) for monitor in scene.monitors}


def _monitor_reading(monitor: Monitor, crossed: Crossed) -> ScreenReading:
    if not monitor.bins:
        return ScreenReading(crossed.power, crossed.u_power, crossed.rays)
    step_mm = monitor.segment.length_mm / monitor.bins
    position = step_mm * np.arange(float(monitor.bins))
    return ScreenReading(crossed.power, crossed.u_power, crossed.rays, position, crossed.power_by_bin / step_mm)


def _of_detectors(imported: rayoptics.Imported, trace: Trace) -> dict[str, ScreenReading]:
    readings = {}
    for detector, (name, reading) in zip(imported.detectors, imported.readings(trace.monitors).items(), strict=True):
        crossed: Sequence[Crossed] = [trace.monitors[monitor.name] for monitor in detector.monitors]
        u_power = sum(monitor.u_power for monitor in crossed) * imported.scene.emitted
        rays = sum(monitor.rays for monitor in crossed)
        readings[name] = ScreenReading(reading.power, u_power, rays, reading.position, reading.irradiance)
    return readings
