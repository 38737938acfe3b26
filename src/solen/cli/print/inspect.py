"""The command that compares a picture of a printed lens with its design."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Set, show

Profile = Annotated[
    Path | None,
    Parameter(name="--out", help='Write the measured profile to this .json, which [lens] shape = "measured" takes.'),
]


def inspect(
    image: Path,
    /,
    *,
    design: Path,
    um_per_px: float | None = None,
    u_um_per_px: float | None = None,
    against: Annotated[list[Path] | None, Parameter(negative=())] = None,
    edge: str = "auto",
    set_: Set = None,
    figure: FigureFile = None,
    out: Profile = None,
    as_json: Json = False,
) -> None:
    """Measure a printed lens in a picture: its outline, its deviations from the design, the nearest of several designs.

    Parameters
    ----------
    image
        A micrograph of the lens, seen along y: TIFF, OME-TIFF, PNG, JPEG (needs the extra vision).
    design
        The design file of the part.
    um_per_px
        Size of a pixel in µm, where the file does not say it.
    u_um_per_px
        Its standard uncertainty.
    against
        A design file to compare with as well; repeatable. By default the paper's three indices, if it is its lens.
    edge
        Which edge of a thick transparent part to take: auto (the sharper, else the outer), outer, inner, sharper.
    """
    from solen.pipeline.print import inspect as pipeline

    found = pipeline.inspect(
        image,
        design,
        set_ or (),
        um_per_px=um_per_px,
        u_um_per_px=u_um_per_px,
        against=against or (),
        edge=edge,
        figure=figure,
        out=out,
    )
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    off = found["deviation_um"]
    low, high = found["measured_x_mm"]
    lines = [
        f"{'simulated: ' if found['simulated'] else ''}{found['sources'][0]['file']}, {found['um_per_px']:.6g} µm per "
        f"pixel ({found['scale']['origin']})",
        f"{off['rms']:.3g} ± {off['u_rms']:.2g} µm (rms) from {found['design']}, from x = {low:.2f} to {high:.2f} mm",
        f"largest {off['max']:+.3g} ± {off['u_max']:.2g} µm at x = {off['max_at_x_mm']:.2f} mm (+ is outwards)",
        f"{found['edge']} edge: {found['points_used']} points, blur {found['blur_px']:.2f} px, rotation "
        f"{found['rotation_deg']:.2f} ± {found['u_rotation_deg']:.1g} deg",
    ]
    if found["points_rejected"]:
        lines.append("set aside: " + ", ".join(f"{count} {why}" for why, count in found["points_rejected"].items()))
    rivals = found["likelihood"]
    if len(rivals) > 1:
        lines.append(f"nearest of {len(rivals)} designs: {found['nearest']}")
        lines += [
            f"  {name}: {one['rms_um']:.3g} µm (rms), probability {one['probability']:.3g}"
            for name, one in rivals.items()
        ]
    lines += [f"warning: {warning}" for warning in found["warnings"]]
    return lines + [f"{name}: {found[name]}" for name in ("figure", "out") if name in found]
