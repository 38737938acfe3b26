"""The commands of coupons: what is printed in order to be measured, and what the measurement says."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, short, show

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


def fidelity(
    file: Path,
    /,
    *,
    coupon: str | None = None,
    job: Path | None = None,
    um_per_px: float | None = None,
    u_um_per_px: float | None = None,
    z_um: float | None = None,
    set_: Choose = None,
    figure: FigureFile = None,
    out: Annotated[
        Path | None, Parameter(help="Write the result, with nominal and measured sizes, to this .json.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure a printed coupon in a picture or a z map, and tell the smallest features that are resolved.

    Parameters
    ----------
    file
        A picture (TIFF, PNG and others), or with --z-um a z map (TIFF of 16 bits or with points, or a table of text).
    coupon
        Which coupon it shows: group-a, group-b, group-c, holes or z-reference.
    job
        The job file that solen print coupons wrote beside the coupon; it tells the coupon and its parameters.
    um_per_px
        Size of a pixel in µm, where the file does not say it.
    u_um_per_px
        Its standard uncertainty.
    z_um
        Height of one level of a z map in µm.
    """
    from solen.pipeline.print import fidelity as pipeline

    found = pipeline.fidelity(
        file,
        coupon,
        job=job,
        um_per_px=um_per_px,
        u_um_per_px=u_um_per_px,
        z_um=z_um,
        assignments=set_ or (),
        figure=figure,
        out=out,
    )
    show(found, as_json, lambda: _measured(found))


MINIMA = {
    "positive_diameter": "smallest pillar that stands",
    "gap": "smallest gap that is open",
    "hole": "smallest hole that is open",
    "hole_variation": "smallest variation of holes",
    "z_step": "smallest step of height",
}


def _measured(found: dict[str, Any]) -> list[str]:
    lines = [f"{found['coupon']} in a {found['image']} of {found['um_per_px']:.4g} µm per pixel"]
    lines += [_minimum(kind, one) for kind, one in found["minimum"].items()]
    lines.append(f"  {'':24} nominal    measured   u (mm)")
    for one in (*found["features"], *found["undecided"]):
        size = "   -    " if one["measured_mm"] is None else f"{one['measured_mm']:.5f}"
        end = "" if one["resolved"] else f"  {one['reason']}"
        spread = "-" if one["u_mm"] is None else short(one["u_mm"])
        lines.append(f"  {one['name']:24} {one['nominal_mm']:<8.4g}   {size}   {spread}{end}")
    lines += [f"warning: {line}" for line in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]


def _minimum(kind: str, one: dict[str, Any]) -> str:
    """A limit with what it rests on."""
    if one["nominal_mm"] is None:
        return f"{MINIMA[kind]}: none; not even {one['next_mm']:g} mm is resolved"
    line = f"{MINIMA[kind]}: {'at most ' if one['bound'] else ''}{one['nominal_mm']:g} mm"
    if one["measured_mm"] is not None:
        line += f", printed {one['measured_mm']:.4f} ± {short(one['u_mm'])} mm"
    return line + (f"; {one['next_mm']:g} mm is not" if one["next_mm"] is not None else "")
