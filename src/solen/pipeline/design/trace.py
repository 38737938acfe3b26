"""Trace of a design at an angle or of a scene file; convergence and sensitivities of a design."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from solen import files
from solen.errors import OutputError, SpecError
from solen.pipeline.design.designs import open_design
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.pipeline.outputs import drawn, named, write
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor import Sensor
from solen.sensor.network import NetworkTrace, check_single_emitter_options, network_trace
from solen.sensor.network.slopes import NetworkSensitivities, network_sensitivities
from solen.sensor.network.suggestions import suggestions
from solen.sensor.traced import (
    DesignConvergence,
    DesignTrace,
    Sensitivities,
    design_convergence,
    requested_value,
    sensitivities,
    trace_design,
    with_lit_emitter,
)
from solen.spec import dumps, with_values
from solen.trace import Mode, Trace
from solen.trace.dataset import Attributes, check_installed, writer
from solen.trace.options import TraceOptions, check_paths
from solen.trace.scene_file import SceneTrace, label_trace, open_scene, trace_scene


def trace(
    path: Path,
    assignments: Sequence[str] | None = None,
    options: TraceOptions = TraceOptions(),
    *,
    angle_deg: float | None = None,
    at: float | None = None,
    emitter: str | None = None,
    paths: bool = False,
    figure: FigureOptions = FigureOptions(),
    netcdf: Path | None = None,
) -> Outcome[DesignTrace | NetworkTrace]:
    """Trace a design at one angle or under one load; for a network, all emitters in turn or only the specified one."""
    _check_outputs(figure, netcdf)
    mode = {} if options.mode is None else {"trace.mode": options.mode}
    lit = {} if emitter is None else {"network.lit": emitter}
    sensor = Sensor.of(with_values(open_design(path, assignments), mode | lit))
    if sensor.is_network and emitter is None:
        check_single_emitter_options(
            {"--angle-deg": angle_deg, "--at": at, "--paths": paths or None, "--netcdf": netcdf}
        )
        traced = network_trace(sensor.design, options)
        files.write_all(drawn(traced, figure, "rays"))
        return Outcome(traced, named(figure=figure.figure))
    value = requested_value(sensor, angle_deg, at)
    result = trace_design(sensor, value, options, paths=paths)

    names = ", ".join(interface.name for interface in sensor.scene(value).interfaces)
    attributes: Attributes = {
        "name": result.name,
        sensor.design.motion.key: value,
        "design": dumps(sensor.design),
        "interfaces": names,
    }
    return Outcome(result, _written(result, attributes, "rays", figure, netcdf))


def trace_file(
    path: Path,
    options: TraceOptions = TraceOptions(),
    *,
    paths: bool = False,
    figure: FigureOptions = FigureOptions(),
    netcdf: Path | None = None,
) -> Outcome[SceneTrace]:
    """Trace a scene file of solen or ray-optics."""
    _check_outputs(figure, netcdf)
    file = open_scene(path, facets=options.mode is None)
    if paths:
        check_paths(file.scene)
    if figure.figure is not None and file.scene.extrusion is not None:
        limit = "cannot show this scene, whose rays are in space: it shows the x-z plane"
        raise SpecError("--figure", limit=limit, remedy="omit it")
    traced = trace_scene(file, options, paths=paths or figure.figure is not None)
    result = label_trace(file, traced, paths=paths)

    attributes: Attributes = {"name": result.name, "format": result.format}
    return Outcome(result, _written(result, attributes, "scene", figure, netcdf))


def convergence(
    file: Path,
    /,
    *,
    angle_deg: float | None = None,
    at: float | None = None,
    emitter: str | None = None,
    mode: Mode = "power",
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[DesignConvergence]:
    """Show how the error decreases with the number of rays, for a fan, Sobol' samples and adaptive integration.

    Parameters
    ----------
    file
        The design file.
    angle_deg
        Angle in degrees, counter-clockwise: a negative angle turns to the right; default: 0. Above -90, below 90.
    at
        For a soft body: value of the quantity that its motion drives, in its unit; default: the last value of the
        motion.
    emitter
        For a network: the emitter that is lit; default: network.lit, or the only one.
    mode
        Treatment of rays at faces: power splits each ray by the Fresnel equations, count refracts or totally reflects
        it without splitting.
    """
    figure.check()
    design = with_lit_emitter(open_design(file, set_), emitter)
    sensor = Sensor.of(with_values(design, {"trace.mode": mode}))
    return write(design_convergence(sensor, requested_value(sensor, angle_deg, at)), "convergence", figure=figure)


def sensitivity(
    file: Path,
    /,
    *keys: str,
    angle_deg: float | None = None,
    at: float | None = None,
    suggest: bool = False,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[Sensitivities | NetworkSensitivities]:
    """Show how the readings depend on the parameters of a design, ranked by the effect of each tolerance.

    Parameters
    ----------
    file
        The design file.
    keys
        Keys of the design, such as body.arm_width_mm; default: all that affect the light, and for a network its
        motions.
    angle_deg
        Angle in degrees, counter-clockwise: a negative angle turns to the right; default: 0. Above -90, below 90.
    at
        For a soft body: value of the quantity that its motion drives, in its unit; default: the last value of the
        motion.
    suggest
        For a network: suggest positions for another receiver or emitter, ranked by how well the motions are determined.
    """
    figure.check()
    sensor = Sensor.of(open_design(file, set_))
    value = requested_value(sensor, angle_deg, at)
    if sensor.is_network:
        network = network_sensitivities(sensor.design, keys, progress=None if suggest else progress)
        if suggest:
            network = replace(network, suggestions=suggestions(sensor.design, progress=progress))
        return write(network, "sensitivity", figure=figure)
    if suggest:
        limit = "requires a network of guides, which this design is not"
        raise SpecError("--suggest", limit=limit, remedy="omit it")
    result = sensitivities(sensor, keys, value, progress)
    return write(result, "sensitivity", figure=figure)


def _check_outputs(figure: FigureOptions, netcdf: Path | None) -> None:
    figure.check()
    if netcdf is None:
        return
    if netcdf.suffix.lower() != ".nc":
        raise OutputError(str(netcdf), limit="a netCDF file must end in .nc", remedy="rename it")
    check_installed()


def _written(
    trace: Trace, attributes: Attributes, kind: str, figure: FigureOptions, netcdf: Path | None
) -> dict[str, Path]:
    """Write the figure and the netCDF file, both or neither."""
    contents = drawn(trace, figure, kind)
    if netcdf is not None:
        contents[netcdf] = writer(trace, attributes)
    files.write_all(contents)
    return named(figure=figure.figure, netcdf=netcdf)
