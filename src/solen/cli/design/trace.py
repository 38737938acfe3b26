"""The command that traces a design or a scene."""

from collections.abc import Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from pydantic import Field

from solen.cli.app import FLAT, SHOWN, FigureFile, Set, lines
from solen.errors import SpecError
from solen.results import Outcome
from solen.sensor.traced import DesignTrace
from solen.trace import Trace
from solen.trace.described import SceneTrace
from solen.trace.options import TraceOptions

SCENE_SUFFIX = ".json"


class DesignOptions(TraceOptions):
    """Options of a trace, with those of a design alone."""

    rays: Annotated[int, Field(ge=1)] | None = None
    """Number of rays; default: emitter.rays."""


def trace(
    file: Path,
    /,
    *,
    options: Annotated[DesignOptions, FLAT] = DesignOptions(),
    angle_deg: float | None = None,
    no_lens: bool = False,
    set_: Set = None,
    paths: bool = False,
    figure: FigureFile = None,
    netcdf: Annotated[Path | None, Parameter(help="Write everything that was found to this .nc file.")] = None,
) -> Outcome[DesignTrace | SceneTrace]:
    """Trace a design at one angle of its motion, or a scene: solen's own or one of ray-optics, a .json file.

    Parameters
    ----------
    file
        The design file, or a scene's JSON.
    angle_deg
        Angle in degrees, counter-clockwise: a negative one turns to the right; default: 0. Of a design only.
        Above -90, below 90.
    no_lens
        Leave the lens out: a flat face at the stem's base.
    paths
        With --json or --netcdf: add the paths of all rays.
    """
    from solen.pipeline.design import trace as pipeline

    if paths and not (SHOWN.as_json or netcdf):
        raise SpecError("--paths", limit="is written as JSON or netCDF", remedy="add --json or --netcdf")
    rays = options.rays
    if options.sampling == "adaptive" and rays is not None:
        raise SpecError(
            "--rays", value=rays, limit="has no meaning with sampling adaptive", remedy="leave one of them out"
        )
    if file.suffix.lower() == SCENE_SUFFIX:
        _refuse({"--angle-deg": angle_deg, "--no-lens": no_lens, "--rays": rays, "--set": set_ and set_[0]})
        return pipeline.trace_file(file, options, paths=paths, figure=figure, netcdf=netcdf)
    chosen = [f"emitter.rays={rays}"] * (rays is not None) + ["lens.shape=none"] * no_lens
    return pipeline.trace(
        file, [*(set_ or ()), *chosen], options, angle_deg=angle_deg or 0.0, paths=paths, figure=figure, netcdf=netcdf
    )


def _refuse(of_designs: Mapping[str, object]) -> None:
    """`SpecError` for options that only a design has."""
    for name, value in of_designs.items():
        if value is not None and value is not False:
            limit = "belongs to a design; a scene has no motion and no keys"
            raise SpecError(name, value=None if value is True else value, limit=limit, remedy="leave it out")


@lines.register
def _(result: DesignTrace) -> Iterator[str]:
    method = "" if result.method == "fan" else f", {result.method}"
    yield f"{result.name} at {result.angle_deg:g} deg, {result.rays} rays, mode {result.mode}{method}"
    for name, reading in sorted(result.detectors.items()):
        u = "" if reading.u_power != reading.u_power else f" ± {reading.u_power:.1e}"
        yield f"  {name:9} {reading.power:.6f}{u}  ({reading.rays} rays)"
    yield from _ledger(result)
    if result.in_space:
        yield f"  of what escaped, {result.missed:.6f} passed above or below, {result.leaked:.6f} leaked there"
    if result.single_error is not None:
        yield f"single precision is off by at most {result.single_error:.1e} where it was compared"
    if not result.reached:
        yield f"the tolerance was not reached: {result.why}"
    yield from _undefined(result)


@lines.register
def _(result: SceneTrace) -> Iterator[str]:
    yield f"{result.name} ({result.format}), {result.rays} rays, mode {result.mode}"
    for name, reading in result.readings.items():
        bins = "" if reading.position is None else f", {len(reading.position)} bins"
        yield f"  {name:9} {reading.power:.6g} ({reading.rays} rays{bins})"
    yield from _ledger(result)
    yield from _undefined(result)
    for part in result.not_understood:
        yield f"not understood: {part}"


def _ledger(result: Trace) -> Iterator[str]:
    for field in fields(result.ledger):
        yield f"  {field.name:9} {getattr(result.ledger, field.name):.6f}"


def _undefined(result: Trace) -> Iterator[str]:
    if result.undefined_at_mm:
        x, z = result.undefined_at_mm[0]
        yield f"  {result.undefined} rays met an inconsistent interface, at [{x}, {z}] mm"
