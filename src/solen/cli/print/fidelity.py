"""The command that measures a printed coupon."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, short, show

Choose = Annotated[
    list[str] | None,
    Parameter(name="--set", negative=(), help="A parameter and its value, as in --set spacing_mm=2; repeatable."),
]


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
