"""The commands of the print process: the lens that the printer makes, and the process from measured coupons."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Set, progress_bar, show


def predict(
    file: Path,
    /,
    *,
    process: Path | None = None,
    printer: str | None = None,
    orientation: str = "flat",
    at: str = "middle",
    compensate: Path | None = None,
    solid: Path | None = None,
    response: Annotated[bool, Parameter(negative="--no-response")] = True,
    set_: Set = None,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the printed lens's profile to this .json.")] = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Predict the lens that the printer makes of a design: how far from the wanted one, and what response is lost.

    Parameters
    ----------
    file
        The design file.
    process
        Process file; by default published settings with assumed optics.
    printer
        Printer whose pixels are taken: a name of solen print printers, or a printer's .toml.
    orientation
        How the part lies in the printer: flat, upright (the lens last), upright-lens-first or on-edge.
    at
        Of a flat part, whose profile is meant: middle of the thickness, mean over it, or a height in mm.
    compensate
        Write a design to this .toml whose outline prints as the wanted lens (flat parts).
    solid
        Write the whole part as it is printed flat to this .stl, .3mf or .glb.
    response
        Trace the sensor with both lenses.
    """
    from solen.pipeline.print import predict as pipeline

    how, outputs = pipeline.Print(process, printer, orientation, at), pipeline.Outputs(out, compensate, figure, solid)
    with progress_bar("printing") as progress:
        found = pipeline.printed(file, how, outputs, set_ or (), response=response, progress=progress)
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    off, shape = found["deviation_um"], found["shape_um"]
    x, z = off["max_at_mm"]
    first = next(iter(found["contributions_um"]), None)
    most = "" if first is None else f", most of it {first} ({found['contributions_um'][first]:.2g} µm)"
    return [
        f"simulated: {found['name']}, printed {found['orientation']} ({found['process']})",
        f"profile: {found['profile_at']}",
        f"off the wanted lens by {off['rms']:.3g} µm rms, mean {off['mean']:+.3g}, largest {off['max']:+.3g} at "
        f"x = {x:.3g}, z = {z:.3g} mm (more material is above 0)",
        f"known to ± {off['u']:.2g} µm{most}",
        f"of shape alone, moved by {shape['shift_z']:+.3g} µm along z: {shape['rms']:.3g} µm rms",
        _ripple(found["ripple_um"]),
        *_walls(found["walls_um"]),
        *_response(found["response"]),
        *_compensation(found["compensation"]),
        *_volume(found.get("solid_mm3")),
        *(f"warning: {warning}" for warning in found["warnings"]),
        *(f"{name}: {found[name]}" for name in ("out", "compensated", "figure", "solid") if name in found),
    ]


def _volume(solid: dict[str, Any] | None) -> list[str]:
    if solid is None:
        return []
    more = 100.0 * (solid["printed"] / solid["designed"] - 1.0)
    return [f"solid: {solid['printed']:.2f} mm3, {more:+.2g} % of the designed {solid['designed']:.2f} mm3"]


def _ripple(ripple: dict[str, Any]) -> str:
    rms = "" if ripple["rms"] is None else f", {ripple['rms']:.2g} µm rms"
    return f"ripple of the layers along the {ripple['along']}: {ripple['peak_to_valley']:.2g} µm peak to valley{rms}"


def _walls(walls: dict[str, Any] | None) -> list[str]:
    if walls is None:
        return []
    return [
        f"{walls['layers']} layers; straight walls beyond their image by {walls['first']:+.3g} µm at the first, "
        f"{walls['middle']:+.3g} in the middle, {walls['last']:+.3g} at the last"
    ]


def _response(response: dict[str, Any] | None) -> list[str]:
    if response is None:
        return []
    emitter = "a point emitter" if response["width_mm"] == 0.0 else f"the emitter of {response['width_mm']:g} mm"
    found = [_lost(emitter, response)]
    if response["chip"] is not None:
        found.append(_lost(f"a chip of {response['chip']['width_mm']:g} mm", response["chip"]))
    return found


def _lost(emitter: str, response: dict[str, Any]) -> str:
    slope, change, lost = response["slope_per_deg"], response["largest_change"], response["slope_lost_percent"]
    if lost is None or change is None or response["light_lost_percent"] is None:
        return f"contrast with {emitter}: none, too little light arrives"
    return (
        f"contrast with {emitter}: {slope['designed']:.3g} per degree about 0 designed, {slope['printed']:.3g} printed "
        f"({lost:.2g} % lost); largest change {change['contrast']:+.3g} at {change['angle_deg']:g} deg; light lost "
        f"{response['light_lost_percent']:.2g} %"
    )


def _compensation(made: dict[str, Any] | None) -> list[str]:
    if made is None:
        return []
    low, high = made["lens_drawn_um"]
    response = made["response"] and (made["response"]["chip"] or made["response"])
    return [
        f"compensated: {made['before_um']['rms']:.3g} µm rms before, {made['after_um']['rms']:.2g} after "
        f"{len(made['rounds_rms_um'])} rounds (largest {made['after_um']['max']:+.2g}); the lens is drawn "
        f"{low:+.3g} to {high:+.3g} µm off, walls {made['walls_drawn_um']:+.3g} µm, all {made['scale']:.5g} times",
        *([_lost(f"an emitter of {response['width_mm']:g} mm, compensated", response)] if response else []),
    ]


def calibrate(
    files: list[Path],
    /,
    *,
    process: Path | None = None,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the process to this .toml.")] = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Find a printer's blur, edge growth and shrinkage from measured coupons, for solen print predict.

    Parameters
    ----------
    files
        Files of measured features (JSON), as solen print fidelity --out writes them of a coupon.
    process
        Process that the coupons were printed with, as far as it is known; by default the published settings.
    """
    from solen.pipeline.print import calibrate as pipeline

    found = pipeline.calibrate_printer(files, process, out, figure)
    show(found, as_json, lambda: _calibration(found))


def _calibration(found: dict[str, Any]) -> list[str]:
    simulated = "simulated: " if found["simulated"] else ""
    used, critical = found["features"], found["Ec_mJ_per_cm2"]
    return [
        f"{simulated}{found['name']}",
        *(
            f"  {key} {one['value']:.4g} ± {one['u']:.2g} (before: ± {one['u_before']:.2g})"
            for key, one in found["found"].items()
        ),
        f"  effective Ec {critical['value']:.3g} ± {critical['u']:.2g} mJ/cm²",
        f"{used['used']} of {used['given']} features used, off by {found['rms_um']:.2g} µm rms; uncertainties widened "
        f"{found['widened_by']:.2g} times",
        *(f"warning: {warning}" for warning in found["warnings"]),
        *(f"{name}: {found[name]}" for name in ("out", "figure") if name in found),
    ]
