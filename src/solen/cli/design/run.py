"""The command that simulates a design from end to end."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from solen.cli.app import lines, short
from solen.cli.design import deform as deform  # registers the lines of a soft body's response
from solen.cli.design.trace import matrix
from solen.pipeline.design.run import run as run
from solen.sensor import AsPrinted, DesignStudy
from solen.sensor.network import NetworkStudy

if TYPE_CHECKING:
    from solen.report.design.summary import EffectRow

HEADING_WIDTH = 16


@lines.register
def _(study: DesignStudy) -> Iterator[str]:
    from solen.report.design.summary import advice, effect_rows, emitter_text, expected, lens_sentences, lens_table

    material, space = study.material, study.design.trace.dimension == "extruded"
    u = "" if material.u_index is None else f" ± {material.u_index:.2g}"
    emitter = emitter_text(study) if space else "in the plane"
    yield f"{study.name}: index {material.index:.6g}{u} at {study.wavelength_nm:g} nm; {emitter}"
    yield "what to expect"
    for heading, text in expected(study):
        yield f"  {heading:{HEADING_WIDTH}}  {text}" if len(heading) <= HEADING_WIDTH else f"  {heading}: {text}"
    if study.as_printed is not None:
        yield from _as_printed(study.as_printed)
    yield from _effects(*effect_rows(study.practice))
    yield from _columns(lens_table(study.practice))
    yield from (f"  {text}" for text in lens_sentences(study.practice))
    for number, text in enumerate(advice(study)):
        yield f"{'what to do' if number == 0 else '':10}  {text}"


@lines.register
def _(study: NetworkStudy) -> Iterator[str]:
    from solen.report.design.network_page import largest_change

    yield f"{study.name}: {study.check.kind}, emitters in turn, at rest"
    yield from matrix(study.at_rest, 0)
    yield from (f"  {name}: {largest_change(response)}" for name, response in study.sweeps.items())


def _effects(angles: list[float], rows: Sequence["EffectRow"]) -> Iterator[str]:
    """Yield the effect of each parameter's tolerance on the response."""
    if not rows:
        return
    heads = ("what matters", "deviation", *(f"contrast at {angle:+.3g}°" for angle in angles), "null", "light")
    yield from _columns([heads, *((row.name, row.by, *row.contrast, row.null, row.light) for row in rows)])


def _columns(table: Sequence[tuple[str, ...]]) -> Iterator[str]:
    """Yield the lines of a table with aligned columns; the first row contains the headings."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    for n, row in enumerate(table):
        cells = [f"{text:{width}}" for text, width in zip(row, widths, strict=True)]
        yield ("  " if n else "") + "  ".join(cells).rstrip()


def _as_printed(as_printed: AsPrinted) -> Iterator[str]:
    """Yield lines on the effect of the printed lens on the response."""
    for comparison in (as_printed.emitter, as_printed.chip):
        if comparison is None or (largest := comparison.largest) is None:
            continue
        emitter = f"chip of {comparison.width_mm:g} mm" if comparison.width_mm else "point"
        yield (
            f"  {'printed':8} {as_printed.label} minus designed, {emitter}: contrast {largest.contrast:+.4f} ± "
            f"{short(largest.u_contrast)} at most, at {largest.angle_deg:g} deg; received "
            f"{comparison.printed.received_share:.4f}, designed {comparison.designed.received_share:.4f}"
        )
        if comparison.null_shift_deg is not None:
            shift = f"{comparison.null_shift_deg:+.4f} ± {short(comparison.u_null_shift_deg)}"
            yield f"  {'null':8} moves by {shift} deg"
