"""The commands for layers: slice a part for a printer, list the printers."""

from collections.abc import Iterator

from solen.cli.app import lines, listing
from solen.fabricate.layers import LayeredPrint
from solen.parts import PrinterList, PrinterSummary
from solen.parts import printers as library
from solen.pipeline.print.layers import layers as layers
from solen.results import Outcome


def printers(name: str | None = None, /) -> Outcome[PrinterList | PrinterSummary]:
    """List the supported printers, or show one with the sources of its values.

    Parameters
    ----------
    name
        Printer of the library, or its file; default: list the library.
    """
    if name is not None:
        return Outcome(PrinterSummary.of(name))
    return Outcome(PrinterList(tuple(map(PrinterSummary.of, library()))))


@lines.register
def _(made: LayeredPrint) -> Iterator[str]:
    values = {key: getattr(made, key) for key in ("printer", "layers", "layer_um", "copies")}
    values |= {"pixel_um": _pixel(made), "size_mm": _times(made.size_mm), "solid_volume_mm3": made.solid_volume_mm3}
    if made.volume_error is not None:
        values |= {"stack_volume_mm3": made.stack_volume_mm3, "volume_error": f"{made.volume_error:+.2e}"}
    if made.settings.estimated_time_s is not None:
        values["estimated_time_min"] = made.settings.estimated_time_s / 60.0
    yield made.name
    yield from listing(values)


@lines.register
def _(library: PrinterList) -> Iterator[str]:
    width = max(len(row.printer) for row in library.printers)
    yield f"{'':{width}}  {'pixel um':>11}  {'pixels':>12}  {'builds mm':>21}  rests on"
    for row in library.printers:
        basis = row.file.pitch_um.basis
        pixels = f"{row.columns} x {row.rows}"
        yield f"{row.printer:{width}}  {_pixel(row):>11}  {pixels:>12}  {_times(row.size_mm):>21}  {basis}"


@lines.register
def _(shown: PrinterSummary) -> Iterator[str]:
    stated = shown.file.model_dump(mode="json", exclude_none=True)
    yield shown.name
    yield f"  document: {stated['document']}"
    if shown.file.notes:
        yield f"  {shown.file.notes}"
    for key, number in stated.items():
        if isinstance(number, dict):
            about = {"basis", "source"}
            values = ", ".join(
                f"{name} {value if isinstance(value, str) else format(value, 'g')}"
                for name, value in number.items()
                if name not in about
            )
            yield f"  {key}: {values or 'yes'} ({number['basis']}: {number['source']})"


def _pixel(of: LayeredPrint | PrinterSummary) -> str:
    return " x ".join(dict.fromkeys(f"{side:.4g}" for side in (of.pitch_um, of.pitch_y_um)))


def _times(size_mm: tuple[float, float, float]) -> str:
    return " x ".join(f"{length:.4g}" for length in size_mm)
