"""The command of coupons: parts that are printed to be measured."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, show

Flag = Annotated[bool, Parameter(negative=())]
Choose = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="A parameter and its value, as in --set spacing_mm=2; repeatable."),
]


def coupons(
    *,
    out: Path | None = None,
    only: str | None = None,
    listing: Annotated[bool, Parameter(name="--list", negative=())] = False,
    layer_um: float | None = None,
    pitch_um: float | None = None,
    hole_reading: str | None = None,
    step_reading: str | None = None,
    reference_reading: str | None = None,
    gap_reading: str | None = None,
    set_: Choose = None,
    plate_mm: tuple[float, float] | None = None,
    printer: str | None = None,
    step: Flag = False,
    tolerance_mm: float = 1e-3,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Write the coupons that show what a printer and a resin can do: STL, 3MF, plan and job of each.

    Parameters
    ----------
    out
        Folder for the files; made if need be.
    only
        Some coupons, with commas: group-a, group-b, group-c, holes, z-reference, cure-discs, film-layer, cubes, guides.
    listing
        List the coupons and what was read into their source; write nothing.
    layer_um
        Layer thickness; 25 by default.
    pitch_um
        Pixel of the printer; where given, features stand on its corners.
    hole_reading
        Eight holes of 1.40 to 1.65 mm: repeats, even, or tenths.
    step_reading
        Steps of group C: halving, or literal.
    reference_reading
        Third pillar of the z reference: literal, or staircase.
    gap_reading
        Gaps of group B: pairs, or row.
    plate_mm
        Width and depth of the build plate, which each coupon must fit on.
    printer
        A printer of solen print printers, or a printer file: its plate and its pixel.
    step
        Write exact solids for CAD programs, too (needs the extra cad).
    tolerance_mm
        How far a mesh may leave the exact walls, 1e-4 to 1.
    """
    from solen.errors import SpecError
    from solen.pipeline.print import coupons as pipeline

    readings = {"hole_reading": hole_reading, "step_reading": step_reading, "gap_reading": gap_reading}
    choices = pipeline.choices_of(
        set_ or (), layer_um=layer_um, pitch_um=pitch_um, reference_reading=reference_reading, **readings
    )
    if listing:
        told = pipeline.listed(only, choices)
        show(told, as_json, lambda: _listed(told))
        return
    if out is None:
        raise SpecError("--out", limit="is missing", remedy="name a folder, or --list the coupons")
    found = pipeline.coupons(
        out, only, choices, step=step, plate_mm=plate_mm, printer=printer, tolerance_mm=tolerance_mm, figure=figure
    )
    show(found, as_json, lambda: _written(found))


def _listed(told: dict[str, Any]) -> list[str]:
    lines = []
    for one in told["coupons"]:
        size = " x ".join(f"{side:.4g}" for side in one["size_mm"])
        lines.append(f"{one['name']}: {one['title']}; {size} mm")
        lines += [f'  {read["about"]}: printed "{read["printed"]}"; taken: {read["taken"]}' for read in one["readings"]]
        lines += [f"  note: {line}" for line in one["warnings"]]
    return lines


def _written(found: dict[str, Any]) -> list[str]:
    lines = []
    for one in found["coupons"]:
        volume = sum(part["volume_mm3"] for part in one["parts"])
        lines.append(f"{one['name']}: {one['features']} features, {volume:.5g} mm3")
        lines += [f"  note: {line}" for line in one["warnings"]]
        lines += [f"  {kind}: {path}" for kind, path in one["files"].items()]
    return lines + ([f"figure: {found['figure']}"] if "figure" in found else [])
