"""The commands that slice a part for a printer and that list the printers."""

from collections.abc import Iterator

from solen.cli.app import lines, listing
from solen.fabricate.layers import LayeredPrint
from solen.parts import PrinterList, PrinterSummary
from solen.parts import printers as library
from solen.pipeline.print.layers import layers as layers
from solen.results import Outcome


def printers(name: str | None = None, /) -> Outcome[PrinterList | PrinterSummary]:
    """List the printers of the library, or show one with the sources of its values.

    Parameters
    ----------
    name
        A printer of the library, or a printer file; default: list the library.
    """
    if name is not None:
        return Outcome(PrinterSummary.of(name))
    return Outcome(PrinterList(tuple(map(PrinterSummary.of, library()))))


@lines.register
def _(result: LayeredPrint) -> Iterator[str]:
    values = {key: getattr(result, key) for key in ("printer", "layers", "layer_um", "copies")}
    values |= {"pixel_um": _pixel(result), "size_mm": _times(result.size_mm)}
    values["solid_volume_mm3"] = result.solid_volume_mm3
    if result.volume_error is not None:
        values |= {"stack_volume_mm3": result.stack_volume_mm3, "volume_error": f"{result.volume_error:+.2e}"}
    if result.settings.estimated_time_s is not None:
        values["estimated_time_min"] = result.settings.estimated_time_s / 60.0
    yield result.name
    yield from listing(values)


@lines.register
def _(library: PrinterList) -> Iterator[str]:
    width = max(len(row.printer) for row in library.printers)
    yield f"{'':{width}}  {'pixel um':>11}  {'pixels':>12}  {'build volume mm':>21}  basis"
    for row in library.printers:
        basis = row.file.pitch_um.basis
        pixels = f"{row.columns} x {row.rows}"
        yield f"{row.printer:{width}}  {_pixel(row):>11}  {pixels:>12}  {_times(row.size_mm):>21}  {basis}"


@lines.register
def _(summary: PrinterSummary) -> Iterator[str]:
    tables = summary.file.model_dump(mode="json", exclude_none=True)
    yield summary.name
    yield f"  document: {tables['document']}"
    if summary.file.notes:
        yield f"  {summary.file.notes}"
    for key, table in tables.items():
        if isinstance(table, dict):
            values = ", ".join(
                f"{name} {value if isinstance(value, str) else format(value, 'g')}"
                for name, value in table.items()
                if name not in {"basis", "source"}
            )
            yield f"  {key}: {values or 'yes'} ({table['basis']}: {table['source']})"


def _pixel(result: LayeredPrint | PrinterSummary) -> str:
    return " x ".join(dict.fromkeys(f"{side:.4g}" for side in (result.pitch_um, result.pitch_y_um)))


def _times(size_mm: tuple[float, float, float]) -> str:
    return " x ".join(f"{length:.4g}" for length in size_mm)
