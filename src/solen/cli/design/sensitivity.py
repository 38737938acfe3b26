"""The commands that show the sensitivities of a design, and how its trace converges."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from solen.cli.app import FLAT, Set, lines, progress_bar, short
from solen.report.options import FigureOptions
from solen.results import Outcome
from solen.sensor.traced import DesignConvergence, Sensitivities
from solen.trace import Mode


def convergence(
    file: Path,
    /,
    *,
    angle_deg: float = 0.0,
    mode: Mode = "power",
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[DesignConvergence]:
    """Show how the error falls with the number of rays, by fan, by Sobol' samples and by adaptive integration.

    Parameters
    ----------
    file
        The design file.
    angle_deg
        Angle in degrees, counter-clockwise: a negative one turns to the right. Above -90, below 90.
    mode
        How light meets faces.
    """
    from solen.pipeline.design import trace as pipeline

    return pipeline.convergence(file, set_, mode=mode, angle_deg=angle_deg, figure=figure)


def sensitivity(
    file: Path,
    /,
    *keys: str,
    angle_deg: float = 0.0,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[Sensitivities]:
    """Show how the readings change with the numbers of the design, ranked by what a tolerance of each does.

    Parameters
    ----------
    file
        The design file.
    keys
        Numbers of the design, as in body.arm_width_mm; default: all that the light depends on.
    angle_deg
        Angle in degrees, counter-clockwise: a negative one turns to the right. Above -90, below 90.
    """
    from solen.pipeline.design import trace as pipeline

    with progress_bar("differentiating") as progress:
        return pipeline.sensitivity(file, keys, set_, angle_deg=angle_deg, figure=figure, progress=progress)


@lines.register
def _(result: DesignConvergence) -> Iterator[str]:
    reference = result.reference
    by = f"{reference.method} with {reference.rays} rays, u {short(reference.u_power)}"
    yield f"{result.name} at {result.angle_deg:g} deg, mode {result.mode}: error against {by}"
    for series in result.series:
        for rays, error, u in zip(series.rays, series.error, series.u_power, strict=True):
            yield f"  {series.method:8} {rays:8} rays  error {_short(error)}  u {_short(u)}"


@lines.register
def _(sensitivities: Sensitivities) -> Iterator[str]:
    width = max((len(row.key) for row in sensitivities.sensitivities), default=0)
    at = f"{sensitivities.name} at {sensitivities.angle_deg:g} deg"
    yield f"{at}: change per unit of each number, and by its tolerance"
    heads = f"{'d right':>12}  {'d left':>12}  {'d contrast':>12}  {'u of that':>9}  {'off by':>9}  {'contrast':>9}"
    yield f"  {'':{width}}  {'value':>9}  {heads}"
    for row in sensitivities.sensitivities:
        start = f"  {row.key:{width}}  {row.value:9.6g}"
        if row.why:
            yield f"{start}  {row.why}"
            continue
        slopes = "".join(f"  {_slope(slope.value)}" for slope in (row.right, row.left, row.contrast))
        effect = f"{row.contrast.value * row.tolerance:+9.2g}"
        yield f"{start}{slopes}  {_short(row.contrast.u_value):>9}  {row.tolerance:9.3g}  {effect}"
    for key, why in sensitivities.skipped.items():
        yield f"left out: {key}: {why}"


def _short(value: float) -> str:
    return short(None if value != value else value)


def _slope(value: float) -> str:
    return f"{'none' if value != value else f'{value:+.6g}':>12}"
