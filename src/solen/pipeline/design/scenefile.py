"""What `solen trace` does with a scene: solen's own JSON, or a scene of ray-optics.

A scene has no motion and no design: what is asked of a design only is refused. Receivers and monitors are both told as
detectors, a monitor with bins with its map. Of a scene of ray-optics, lengths and powers are in the file's units and
rays go the way that program sends them, unless a mode is asked for: then the exact curves are traced by the engine.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from solen import files
from solen.errors import DataError, SpecError
from solen.pipeline.design.options import Sampling, check_netcdf, check_paths
from solen.pipeline.outputs import check_choice, check_figure
from solen.report.design import results as numbers
from solen.report.plain import number
from solen.scene import Monitor, Scene, loads, rayoptics
from solen.sensor import CHIP_TOLERANCE, TOLERANCE
from solen.trace import Crossed, Trace, Turns, integrate, trace, trace_in_turns
from solen.trace.adaptive import is_extended
from solen.trace.dataset import writer
from solen.trace.result import MODES, Mode

SUFFIX = ".json"


@dataclass(frozen=True)
class Opened:
    """A scene and where it comes from; ``imported`` is what else there is of one of ray-optics."""

    scene: Scene
    imported: rayoptics.Imported | None = None

    @property
    def name(self) -> str:
        """Its format."""
        return "solen" if self.imported is None else "ray-optics"


def is_scene(path: Path) -> bool:
    """Whether a file is a scene, by its name."""
    return path.suffix.lower() == SUFFIX


def refuse_design_options(asked: Mapping[str, object]) -> None:
    """`SpecError` for options that only a design has; None is what was not asked for."""
    for name, value in asked.items():
        if value is not None and value is not False:
            limit = "belongs to a design; a scene has no motion and no keys"
            raise SpecError(name, value=None if value is True else value, limit=limit, remedy="leave it out")


def open_scene(path: Path, *, facets: bool) -> Opened:
    """Scene of a file in either format; `DataError` where it is neither. For ``facets`` see `rayoptics.loads`."""
    text = files.read_text(path, DataError)
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as bad:
        raise DataError(str(path), limit=f"not JSON: {bad}") from None
    if rayoptics.recognised(data):
        imported = rayoptics.loads(text, str(path), facets=facets)
        return Opened(imported.scene, imported)
    if isinstance(data, dict) and "solen_scene" in data:
        return Opened(loads(text, str(path)))
    limit = "no scene: neither solen's (no key solen_scene) nor ray-optics' (no list objs with a version)"
    raise DataError(str(path), limit=limit)


def trace_scene(
    path: Path,
    *,
    mode: str | None = None,
    sampling: Sampling | None = None,
    paths: bool = False,
    figure: Path | None = None,
    netcdf: Path | None = None,
) -> dict[str, Any]:
    """Trace a scene's file; a mode that was not asked for is power, or for ray-optics its own way."""
    sampling = sampling or Sampling()
    check_figure(figure)
    sampling.check()
    if netcdf is not None:
        check_netcdf(netcdf)
    if mode is not None:
        check_choice("--mode", mode, MODES)
    opened = open_scene(path, facets=mode is None)
    if paths:
        check_paths(opened.scene)
    if figure is not None and opened.scene.extrusion is not None:
        raise SpecError("--figure", limit="draws the plane, and these rays are in space", remedy="leave it out")
    keeps_legs = paths or figure is not None
    if opened.imported is not None and mode is None:
        result = _in_turns(opened.imported, sampling, keeps_legs)
    else:
        chosen: Mode = next((one for one in MODES if one == mode), "power")
        result = _traced(opened.scene, chosen, sampling, keeps_legs)
    contents: dict[Path, files.Content] = {}
    if figure is not None:
        from solen.report import canvas
        from solen.report.design import figures

        drawn = figures.scene_figure(opened.scene, result, _units(opened.imported)["length"])
        contents[figure] = canvas.encoded(drawn, figure.suffix.lower(), "scene")
    if netcdf is not None:
        contents[netcdf] = writer(result, {"name": opened.scene.name, "format": opened.name})
    files.write_all(contents)
    where = {"figure": figure, "netcdf": netcdf}
    return _told(opened, result, paths) | {name: str(file) for name, file in where.items() if file is not None}


def _in_turns(imported: rayoptics.Imported, sampling: Sampling, legs: bool) -> Trace:
    """Trace as ray-optics does, which knows no way to choose rays but its own."""
    asked = {
        "--sampling": None if sampling.method == "fan" else sampling.method,
        "--seed": sampling.seed,
        "--tolerance": sampling.tolerance,
        "--precision": sampling.precision,
        "--histogram": sampling.histogram,
    }
    for name, value in asked.items():
        if value is not None:
            limit = "has no meaning where rays go the way of ray-optics"
            raise SpecError(name, value=value, limit=limit, remedy="add --mode power to trace by solen's engine")
    max_hits = {} if imported.max_hits is None else {"max_hits": imported.max_hits}
    return trace_in_turns(imported.scene, Turns(imported.weak, imported.weakest, imported.fresh, **max_hits), legs=legs)


def _traced(scene: Scene, mode: Mode, sampling: Sampling, legs: bool) -> Trace:
    if sampling.method == "adaptive":
        if legs:
            raise SpecError(
                "--sampling", value="adaptive", limit="keeps no ways of rays", remedy="use fan for pictures"
            )
        if scene.monitors:
            limit = "reads receivers alone, and this scene has monitors"
            raise SpecError("--sampling", value="adaptive", limit=limit, remedy="use fan or sobol")
        usual = CHIP_TOLERANCE if is_extended(scene) else TOLERANCE
        return integrate(scene, mode, usual if sampling.tolerance is None else sampling.tolerance)
    options = sampling.options(mode, draws=scene.is_random)
    options["legs"] = legs
    return trace(scene, mode, **options)


def _told(opened: Opened, result: Trace, paths: bool) -> dict[str, Any]:
    scene, imported = opened.scene, opened.imported
    faces = {name: [i.name for i in scene.interfaces if i.receiver == name] for name in scene.receivers}
    detectors = {name: numbers.detected_numbers(result.detectors[name], faces[name]) for name in scene.receivers}
    if imported is None:
        detectors |= {one.name: _monitor(one, result.monitors[one.name]) for one in scene.monitors}
    else:
        detectors |= _imported(imported, result)
    found: dict[str, Any] = {
        "name": scene.name,
        "format": opened.name,
        "units": _units(imported),
        **numbers.trace_numbers(result, in_space=scene.extrusion is not None),
        "emitted": scene.emitted,
        "detectors": detectors,
        "not_understood": _missed(imported),
    }
    if paths:
        found["paths"] = [
            numbers.way_numbers(way, [interface.name for interface in scene.interfaces]) for way in result.paths()
        ]
    return found


def _units(imported: rayoptics.Imported | None) -> dict[str, str]:
    """Units of maps and of the powers of monitors; the ledger is always in shares of the emitted power."""
    if imported is None:
        return {"length": "mm", "power": "share of the emitted power"}
    return {"length": "unit of the file", "power": "brightness"}


def _monitor(monitor: Monitor, crossed: Crossed) -> dict[str, Any]:
    """Power as a share of what was emitted; a map in shares per mm, by the start of each bin."""
    found: dict[str, Any] = {"power": crossed.power, "u": number(crossed.u_power), "rays": crossed.rays}
    if monitor.bins:
        step_mm = monitor.segment.length_mm / monitor.bins
        found["map"] = {
            "position": [i * step_mm for i in range(monitor.bins)],
            "irradiance": [float(power) / step_mm for power in crossed.power_by_bin],
        }
    return found


def _imported(imported: rayoptics.Imported, result: Trace) -> dict[str, Any]:
    """Readings in the file's units."""
    found: dict[str, Any] = {}
    for detector, (name, reading) in zip(imported.detectors, imported.readings(result.monitors).items(), strict=True):
        crossed = [result.monitors[monitor.name] for monitor in detector.monitors]
        u = number(sum(one.u_power for one in crossed) * imported.scene.emitted)
        found[name] = {"power": reading.power, "u": u, "rays": sum(one.rays for one in crossed)}
        if reading.position is not None and reading.irradiance is not None:
            maps = {"position": reading.position.tolist(), "irradiance": reading.irradiance.tolist()}
            found[name]["map"] = maps
    return found


def _missed(imported: rayoptics.Imported | None) -> list[dict[str, Any]]:
    missed: Sequence[rayoptics.NotUnderstood] = () if imported is None else imported.not_understood
    return [{"object": one.object, "type": one.type, "key": one.key, "reason": one.reason} for one in missed]
