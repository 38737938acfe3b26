"""The command that says what a file of spectra holds."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, show


def spectra(
    file: Path,
    /,
    *,
    sheet: str | None = None,
    trace: Annotated[list[str] | None, Parameter(negative=())] = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Show what spectra a file holds: traces, quantities, units, wavelengths, and what to beware of.

    Parameters
    ----------
    file
        A Cary export, a table with a column of wavelengths, or a workbook of either.
    sheet
        Sheet of a workbook; by default the only one with numbers.
    trace
        Name of a trace that is wanted; repeatable. By default all are.
    """
    from solen.pipeline.resin import spectra as pipeline

    found = pipeline.spectra(file, sheet=sheet, traces=tuple(trace or ()), figure=figure)
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    source = found["sources"][0]
    told = [text for text in (source["instrument"], source["date"], f"sha256 {source['sha256'][:12]}") if text]
    lines = [f"{found['file']} ({found['format']}): {len(found['traces'])} traces; {', '.join(told)}"]
    width = max(len(one["name"]) for one in found["traces"])
    for one in found["traces"]:
        unit = {"1": "", None: " without a unit"}.get(one["unit"], f" in {one['unit']}")
        what = f"{one['quantity'] or 'unknown quantity'}{unit}"
        lines.append(f"  {one['name']:{width}}  {one['points']:5} points  {_reach(one)}  {what}")
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + ([f"figure: {found['figure']}"] if "figure" in found else [])


def _reach(one: dict[str, Any]) -> str:
    low, high = one["wavelength_nm"]
    return "no wavelengths" if low is None else f"{low:g} to {high:g} nm"
