"""The command that does the whole chain of a design."""

from collections.abc import Iterator
from pathlib import Path

from solen.cli.app import Set, lines, progress_bar, short, text
from solen.results import Outcome
from solen.sensor import AsPrinted, DesignStudy, Practice


def run(file: Path, /, *, out: Path, set_: Set = None) -> Outcome[DesignStudy]:
    """Simulate a design over its motion: lens, body, response with and without lens, figures, tables, report.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for report.html, results.json, results.csv and the figures; made if need be.
    """
    from solen.pipeline.design import run as pipeline

    with progress_bar("tracing") as progress:
        return pipeline.run(file, out, set_, progress)


@lines.register
def _(study: DesignStudy) -> Iterator[str]:
    material = study.material
    u = "" if material.u_index is None else f" ± {material.u_index:.2g}"
    yield f"{study.name}: index {material.index:.6g}{u} at {study.wavelength_nm:g} nm"
    for name, case in study.summary.items():
        ends = f"{text(case.contrast_from)} at {case.from_deg:g} deg to {text(case.contrast_to)}"
        yield f"  {name:8} contrast {ends} at {case.to_deg:g} deg, received {case.received_share:.4f}"
    if study.as_printed is not None:
        yield from _as_printed(study.as_printed)
    if study.practice is not None:
        yield from _practice(study.practice)


def _as_printed(as_printed: AsPrinted) -> Iterator[str]:
    """What a lens as it was printed does to the response."""
    for comparison in (as_printed.emitter, as_printed.chip):
        if comparison is None or (largest := comparison.largest) is None:
            continue
        emitter = f"chip of {comparison.width_mm:g} mm" if comparison.width_mm else "point"
        yield (
            f"  {'printed':8} {as_printed.label} less as designed, {emitter}: contrast {largest.contrast:+.4f} ± "
            f"{short(largest.u_contrast)} at most, at {largest.angle_deg:g} deg; received "
            f"{comparison.printed.received_share:.4f}, designed {comparison.designed.received_share:.4f}"
        )
        if comparison.null_shift_deg is not None:
            moved = f"{comparison.null_shift_deg:+.4f} ± {short(comparison.u_null_shift_deg)}"
            yield f"  {'null':8} moves by {moved} deg"


def _practice(practice: Practice) -> Iterator[str]:
    """A real chip, its decentre, and another index."""
    chip, null, emitter = practice.chip, practice.null_shift, practice.emitter
    if chip is not None and emitter.kind != "file":
        first, last = float(chip.angle_deg[0]), float(chip.angle_deg[-1])
        ends = f"{text(chip.contrast_at(first))} at {first:g} deg to {text(chip.contrast_at(last))}"
        width = f"{emitter.width_mm:g} mm wide" + (", for comparison" if emitter.kind == "comparison" else "")
        yield f"  {'chip':8} contrast {ends} at {last:g} deg, {width}"
    if null is not None:
        moved = f"{null.shift_deg:+.3f} ± {null.u_shift_deg:.1g} deg"
        yield f"  {'null':8} moves by {moved} for {null.step_mm:g} mm of the emitter towards +x"
    if practice.index and practice.index_shift is not None:
        step = practice.index[0]
        what = "its uncertainty" if step.by_uncertainty else f"{abs(step.step):g} of index"
        alone = "" if practice.chip_shift is None else f"; the chip alone by {practice.chip_shift.contrast:.3f}"
        moved = f"{practice.index_shift.contrast:.3f} at {practice.index_shift.angle_deg:g} deg"
        yield f"  {'index':8} {what} moves the contrast by up to {moved}{alone}"
