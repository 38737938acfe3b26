"""The commands for the sensitivities and the convergence of a design."""

import math
from collections.abc import Iterator, Sequence

from solen.cli.app import lines, short
from solen.cli.design.trace import signed
from solen.pipeline.design.trace import convergence as convergence
from solen.pipeline.design.trace import sensitivity as sensitivity
from solen.sensor.network import NetworkSensitivities
from solen.sensor.network.motions import Determination, Suggestion, combination_text
from solen.sensor.traced import DesignConvergence, Sensitivities, value_text


@lines.register
def _(result: DesignConvergence) -> Iterator[str]:
    reference = result.reference
    exact = f"{reference.method} with {reference.rays} rays, u {short(reference.u_power)}"
    position = f" with {result.emitter} lit" if result.emitter else f" at {value_text(result)}"
    yield f"{result.name}{position}, mode {result.mode}: error relative to {exact}"
    for series in result.series:
        for rays, error, u in zip(series.rays, series.error, series.u_power, strict=True):
            yield f"  {series.method:8} {rays:8} rays  error {short(error)}  u {short(u)}"


@lines.register
def _(sensitivities: Sensitivities) -> Iterator[str]:
    width = max((len(row.key) for row in sensitivities.sensitivities), default=0)
    title = f"{sensitivities.name} at {value_text(sensitivities)}"
    yield f"{title}: change per unit of each parameter, and of the contrast for its tolerance"
    heads = f"{'d right':>12}  {'d left':>12}  {'d contrast':>12}  {'u':>9}  {'tolerance':>9}  {'contrast':>9}"
    yield f"  {'':{width}}  {'value':>9}  {heads}"
    for row in sensitivities.sensitivities:
        start = f"  {row.key:{width}}  {row.value:9.6g}"
        if row.why:
            yield f"{start}  {row.why}"
            continue
        slopes = "".join(f"  {_slope(slope.value)}" for slope in (row.right, row.left, row.contrast))
        effect = f"{row.contrast.value * row.tolerance:+9.2g}"
        yield f"{start}{slopes}  {short(row.contrast.u_value):>9}  {row.tolerance:9.3g}  {effect}"
    for key, why in sensitivities.skipped.items():
        yield f"omitted: {key}: {why}"


@lines.register
def _(result: NetworkSensitivities) -> Iterator[str]:
    yield f"{result.name}: change of each power per unit of each parameter, emitters in turn"
    width = max(len(name) for name in (*result.receivers, "receiver"))
    for number, key in enumerate(result.keys):
        yield f"  {key} = {result.value[number]:.6g}, from differences over ±{result.step[number]:.3g}"
        yield f"    {'':12}" + "".join(f"{name:>{width + 3}}" for name in result.receivers)
        for emitter, slopes in zip(result.emitters, result.slope[number], strict=True):
            yield f"    {emitter:12}" + "".join(f"{slope:+{width + 3}.2g}" for slope in slopes)
        yield f"    each ± {short(float(result.u_slope[number].max()))} at most"
        rows = zip(result.readings, result.reading_slope[number], result.u_reading_slope[number], strict=True)
        yield from (f"    {name}: {signed(slope, u)}" for name, slope, u in rows)
    for key, why in result.skipped.items():
        yield f"omitted: {key}: {why}"
    if result.by_voltages is not None:
        yield "  one reading of every receiver, emitters in turn, with the noise of the readout, determines"
        yield from _determination(result.by_voltages)
    if result.by_readings is not None:
        yield f"  {', '.join(result.readings)} alone determine"
        yield from _determination(result.by_readings)
    if result.suggestions is not None:
        yield from _suggestions(result.suggestions, result.by_voltages)


def _determination(motions: Determination) -> Iterator[str]:
    for name, sd, u in zip(motions.motions, motions.sd_deg.tolist(), motions.u_sd_deg.tolist(), strict=True):
        accuracy = f"to {short(sd)} ± {short(u)} deg (standard deviation)" if math.isfinite(sd) else "not at all"
        yield f"    {name}: {accuracy}"
    for combination in motions.combinations:
        change = f"{short(combination.singular_per_deg)} ± {short(combination.u_singular_per_deg)}"
        yield f"    readings change by {change} times their noise per degree for {combination_text(combination)}"


def _suggestions(suggestions: Sequence[Suggestion], present: Determination | None) -> Iterator[str]:
    if not suggestions:
        yield "  no position was found for a receiver or emitter that would determine the motions better"
        return
    yield "  with one more part, the least certain motion is determined"
    if present is not None:
        yield f"    {_worst(present)}: present network"
    yield from (
        f"    {_worst(suggestion.by_voltages)}: {suggestion.part} at {suggestion.place}" for suggestion in suggestions
    )
    yield "  to use the first of these, add to the design file:"
    yield from suggestions[0].tables.splitlines()


def _worst(motions: Determination) -> str:
    if math.isfinite(motions.worst_sd_deg):
        return f"to {short(motions.worst_sd_deg)} deg"
    return f"not at all ({motions.rank} of {len(motions.motions)} combinations are determined)"


def _slope(value: float) -> str:
    return f"{'none' if math.isnan(value) else f'{value:+.6g}':>12}"
