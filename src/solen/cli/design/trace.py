"""The command that traces a design or a scene."""

import math
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from pydantic import Field

from solen.cli.app import SHOWN, lines, short
from solen.errors import SpecError
from solen.pipeline.design.designs import is_scene
from solen.pipeline.options import FLAT, Set
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor.network import NetworkResponse, NetworkTrace
from solen.sensor.traced import DesignTrace, value_text
from solen.trace import Trace
from solen.trace.options import TraceOptions
from solen.trace.scene_file import SceneTrace


class DesignOptions(TraceOptions):
    """Options of a trace, including the number of rays of a design."""

    rays: Annotated[int, Field(ge=1)] | None = None
    """Number of rays; default: emitter.rays."""


def trace(
    file: Path,
    /,
    *,
    options: Annotated[DesignOptions, FLAT] = DesignOptions(),
    angle_deg: float | None = None,
    at: float | None = None,
    emitter: str | None = None,
    no_lens: bool = False,
    set_: Set = None,
    paths: bool = False,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    netcdf: Annotated[Path | None, Parameter(help="Write all results to this .nc file.")] = None,
) -> Outcome[DesignTrace | NetworkTrace | SceneTrace]:
    """Trace a design at one angle of its motion, or a scene file (.json) of solen or ray-optics.

    Parameters
    ----------
    file
        The design file, or a scene file.
    angle_deg
        Angle in degrees, counter-clockwise: a negative angle turns to the right; default: 0. Above -90, below 90. For
        designs only.
    at
        For a soft body: value of the quantity that its motion drives, in its unit; default: the last value of the
        motion.
    emitter
        For a network: the emitter to light; default: all in turn, with the power at each receiver.
    no_lens
        Replace the lens by a flat face at the base of the stem.
    paths
        With --json or --netcdf: add the paths of all rays.
    """
    from solen.pipeline.design import trace as pipeline

    if paths and not (SHOWN.as_json or netcdf):
        raise SpecError("--paths", limit="can only be written as JSON or netCDF", remedy="add --json or --netcdf")
    rays = options.rays
    if options.sampling == "adaptive" and rays is not None:
        limit, remedy = "does not apply to adaptive sampling", "omit it, or specify another --sampling"
        raise SpecError("--rays", value=rays, limit=limit, remedy=remedy)
    design_options = {"--angle-deg": angle_deg, "--at": at, "--emitter": emitter, "--no-lens": no_lens, "--rays": rays}
    if is_scene(file, design_options | {"--set": set_ and set_[0]}):
        return pipeline.trace_file(file, options, paths=paths, figure=figure, netcdf=netcdf)
    assignments = [f"emitter.rays={rays}"] * (rays is not None) + ["lens.shape=none"] * no_lens
    return pipeline.trace(
        file,
        [*(set_ or ()), *assignments],
        options,
        angle_deg=angle_deg,
        at=at,
        emitter=emitter,
        paths=paths,
        figure=figure,
        netcdf=netcdf,
    )


@lines.register
def _(result: DesignTrace) -> Iterator[str]:
    yield f"{result.name} at {value_text(result)}, {_method(result)}"
    for name, reading in sorted(result.detectors.items()):
        yield f"  {name:9} {_power(reading.power, reading.u_power)}  ({reading.rays} rays)"
    yield from _ledger(result, result.in_space)


@lines.register
def _(result: NetworkTrace) -> Iterator[str]:
    yield f"{result.name}, {len(result.emitters)} emitters in turn, mode {result.mode}, {result.method}"
    yield from matrix(result, 0)
    for emitter, ledger in zip(result.emitters, result.ledgers[0], strict=True):
        fractions = ", ".join(f"{field.name} {getattr(ledger, field.name):.6f}" for field in fields(ledger))
        yield f"  {emitter}: {fractions}"


def matrix(response: NetworkResponse, state: int) -> Iterator[str]:
    """Yield the powers of one state, with a line for each emitter and a column for each receiver."""
    width = max(10, *(len(name) + 2 for name in response.receivers))
    yield f"  {'':12}" + "".join(f"{name:>{width}}" for name in response.receivers)
    for emitter, powers in zip(response.emitters, response.power[state], strict=True):
        yield f"  {emitter:12}" + "".join(f"{power:{width}.6f}" for power in powers)
    yield f"  each ± {short(float(response.u_power[state].max()))} at most"
    rows = zip(response.readings, response.reading[state], response.u_reading[state], strict=True)
    yield from (f"  {name} = {signed(value, u)}" for name, value, u in rows)


def signed(value: float, u: float) -> str:
    """Format a signed value with its uncertainty; "none" if it is NaN."""
    return "none" if math.isnan(value) else f"{value:+.6g} ± {short(u)}"


@lines.register
def _(result: SceneTrace) -> Iterator[str]:
    yield f"{result.name} ({result.format}), {_method(result)}"
    for name, reading in result.readings.items():
        bins = "" if reading.position is None else f", {len(reading.position)} bins"
        power = _power(reading.power, reading.u_power, ".6g")
        yield f"  {name:9} {power}  ({reading.rays} rays{bins})"
    yield from _ledger(result, result.in_space)
    for part in result.not_understood:
        yield f"ignored: {part}"


def _method(result: Trace) -> str:
    method = "" if result.method == "fan" else f", {result.method}"
    return f"{result.rays} rays, mode {result.mode}{method}"


def _power(power: float, u: float | None, digits: str = ".6f") -> str:
    """Format a power with its uncertainty."""
    return f"{power:{digits}} ± {short(u)}"


def _ledger(result: Trace, in_space: bool) -> Iterator[str]:
    """Yield the power ledger of a trace, and notes on its accuracy."""
    for field in fields(result.ledger):
        yield f"  {field.name:9} {_power(getattr(result.ledger, field.name), getattr(result.u_ledger, field.name))}"
    if in_space:
        missed, leaked = _power(result.missed, result.u_missed), _power(result.leaked, result.u_leaked)
        yield f"  of the emitted power, {missed} passed above or below the body, {leaked} leaked through top or bottom"
    if result.single_error is not None:
        yield f"single precision deviates by at most {result.single_error:.1e} for the compared rays"
    if not result.reached:
        yield f"the tolerance was not reached: {result.why}"
    if result.undefined_at_mm:
        x, z = result.undefined_at_mm[0]
        yield f"  {result.undefined} rays hit an inconsistent interface, the first at [{x}, {z}] mm"
