"""The commands of layers: cut a part for a printer, list the printers."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Set, listing, progress_bar, show
from solen.pipeline.print.slicing import Slicing

How = Annotated[Slicing | None, Parameter(name="*")]


def layers(
    file: Path,
    /,
    *,
    out: Path,
    how: How = None,
    set_: Set = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Cut a design or a mesh into anti-aliased layers for a printer, with STL and settings for its own program.

    Parameters
    ----------
    file
        A design (.toml) or a closed mesh (.stl in mm, .3mf); what is written has its name.
    out
        Folder for the files; made if need be.
    """
    from solen.pipeline.print import layers as pipeline

    with progress_bar("layers") as progress:
        found = pipeline.layers(file, out, how or Slicing(), set_ or (), figure=figure, progress=progress)
    show(found, as_json, lambda: told(found))


def printers(name: str | None = None, /, *, as_json: Json = False) -> None:
    """List the printers that layers can be made for, or show one with the sources of its numbers.

    Parameters
    ----------
    name
        Printer of the library, or its file; all of the library without.
    """
    from solen.pipeline.print import layers as pipeline

    found = pipeline.list_printers() if name is None else pipeline.show_printer(name)
    show(found, as_json, lambda: _table(found["printers"]) if name is None else _printer(found))


def told(found: dict[str, Any]) -> list[str]:
    """Lines of a job."""
    size = " x ".join(f"{length:.4g}" for length in found["size_mm"])
    plain = {key: found[key] for key in ("printer", "layers", "layer_um", "pitch_um", "copies")}
    plain |= {"size_mm": size, "solid_volume_mm3": found["solid_volume_mm3"]}
    if found["stack_volume_mm3"] is not None:
        plain |= {"stack_volume_mm3": found["stack_volume_mm3"], "volume_error": f"{found['volume_error']:+.2e}"}
    if found["settings"]["estimated_time_s"] is not None:
        plain["estimated_time_min"] = found["settings"]["estimated_time_s"] / 60.0
    lines = [found["name"], *listing(plain), *(f"warning: {line}" for line in found["warnings"])]
    lines += [f"{kind}: {path}" for kind, path in found["files"].items()]
    return lines + ([f"figure: {found['figure']}"] if "figure" in found else [])


def _table(rows: list[dict[str, Any]]) -> list[str]:
    width = max(len(row["printer"]) for row in rows)
    lines = [f"{'':{width}}  {'pixel um':>8}  {'pixels':>11}  {'builds mm':>21}  confirmed"]
    for row in rows:
        size = " x ".join(f"{length:.4g}" for length in row["size_mm"])
        pixels = f"{row['columns']} x {row['rows']}"
        sure = "no" if row["unconfirmed"] else "yes"
        lines.append(f"{row['printer']:{width}}  {row['pitch_um']:8g}  {pixels:>11}  {size:>21}  {sure}")
    return lines


def _printer(found: dict[str, Any]) -> list[str]:
    stated = found["file"]
    lines = [found["name"], f"  document: {stated['document']}"]
    lines += [f"  {stated['notes']}"] if stated.get("notes") else []
    for key, number in stated.items():
        if isinstance(number, dict):
            values = ", ".join(f"{name} {value:g}" for name, value in number.items() if not isinstance(value, str))
            lines.append(f"  {key}: {values} ({number['basis']}: {number['source']})")
    return lines
