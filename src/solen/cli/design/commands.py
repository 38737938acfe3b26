"""The commands of a design: from a new file to the report of its response."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import Json, Set, listing, progress_bar, short, show, text
from solen.errors import SpecError


def new(folder: Path, /, *, example: str = "solen-860", as_json: Json = False) -> None:
    """Write a commented design file, FOLDER/sensor.toml.

    Parameters
    ----------
    folder
        Where to write it; made if need be.
    example
        Which of the shipped designs: solen-860, solen-500, solen-450 or pmma-860.
    """
    from solen.pipeline.design import commands as pipeline

    found = pipeline.new(folder, example)
    show(found, as_json, lambda: [f"wrote {found['design']}", f'next: solen run "{found["design"]}" --out out'])


def check(file: Path, /, *, set_: Set = None, as_json: Json = False) -> None:
    """Prove that a design can be built at every angle of its motion.

    Parameters
    ----------
    file
        The design file.
    """
    from solen.pipeline.design import commands as pipeline

    found = pipeline.check(file, set_ or ())
    show(
        found,
        as_json,
        lambda: [
            f"{found['name']}: a valid sensor at all {found['angles']} angles",
            *listing(_material(found["material"]) | found["lens"] | found["body"]),
            *_focus_lines(found["lens"]),
            f"faces: {', '.join(found['body']['faces'])}",
            *_warning_lines(found),
        ],
    )


def lens(
    file: Path, /, *, set_: Set = None, csv: Path | None = None, tolerance_mm: float = 1e-4, as_json: Json = False
) -> None:
    """Show the lens of a design: shape, acceptance, magnification, focus in the material it is made of.

    Parameters
    ----------
    file
        The design file.
    csv
        Write the profile as a table of x and z in mm.
    tolerance_mm
        How far a straight line between two points of the table may leave the profile.
    """
    from solen.pipeline.design import commands as pipeline

    found = pipeline.lens(file, set_ or (), csv, tolerance_mm)
    show(found, as_json, lambda: [*listing(found), *_focus_lines(found), *_warning_lines(found)])


def trace(
    file: Path,
    /,
    *,
    angle_deg: float | None = None,
    no_lens: Annotated[bool, Parameter(negative=())] = False,
    rays: str | None = None,
    mode: str | None = None,
    sampling: str = "fan",
    seed: str | None = None,
    tolerance: float | None = None,
    precision: str | None = None,
    histogram: str | None = None,
    set_: Set = None,
    paths: Annotated[bool, Parameter(negative=())] = False,
    figure: Path | None = None,
    netcdf: Path | None = None,
    as_json: Json = False,
) -> None:
    """Trace a design at one angle of its motion, or a scene: solen's own or one of ray-optics, a .json file.

    Parameters
    ----------
    file
        The design file, or a scene's JSON.
    angle_deg
        Angle in degrees, counter-clockwise: a negative one turns to the right; 0 by default. Of a design only.
    no_lens
        Leave the lens out: a flat face at the stem's base.
    rays
        Number of rays, in place of emitter.rays.
    mode
        count (refraction or total reflection), power (Fresnel, both branches) or roulette (Fresnel, one branch drawn),
        in place of trace.mode.
    sampling
        fan (regular rays), sobol (independent samples) or adaptive (integration over the launch angle).
    seed
        Of sobol and of roulette: a whole number; the same one gives the same result.
    tolerance
        Of adaptive: what no power shall be off by, as a share of the emitted power; by default 1e-6 for a
        point of one colour, 1e-4 for other sources.
    precision
        double, or single with its error stated.
    histogram
        Number of bins, for the power at each receiver by place and by angle of incidence.
    paths
        With --json or --netcdf: add the ways of all rays.
    figure
        Draw the rays into this .svg, .png or .pdf.
    netcdf
        Write everything that was found to this .nc file.
    """
    from solen.pipeline.design import commands as pipeline
    from solen.pipeline.design import options, scenefile

    if paths and not (as_json or netcdf):
        raise SpecError("--paths", limit="is written as JSON or netCDF", remedy="add --json or --netcdf")
    if sampling == "adaptive" and rays is not None:
        limit = "has no meaning with --sampling adaptive"
        raise SpecError("--rays", value=rays, limit=limit, remedy="leave one of them out")
    how = options.Sampling(sampling, seed, tolerance, precision, histogram)
    if scenefile.is_scene(file):
        scenefile.refuse_design_options(
            {"--angle-deg": angle_deg, "--no-lens": no_lens, "--rays": rays, "--set": set_ and set_[0]}
        )
        scene = scenefile.trace_scene(file, mode=mode, sampling=how, paths=paths, figure=figure, netcdf=netcdf)
        show(scene, as_json, lambda: _scene_lines(scene))
        return
    chosen = {"lens.shape": "none" if no_lens else None, "emitter.rays": rays, "trace.mode": mode}
    assignments = [*(set_ or ()), *(f"{key}={value}" for key, value in chosen.items() if value is not None)]
    found = pipeline.trace_design(
        file, assignments, angle_deg=angle_deg or 0.0, sampling=how, paths=paths, figure=figure, netcdf=netcdf
    )
    show(found, as_json, lambda: _trace_lines(found))


def convergence(
    file: Path,
    /,
    *,
    angle_deg: float = 0.0,
    mode: str = "power",
    set_: Set = None,
    figure: Path | None = None,
    as_json: Json = False,
) -> None:
    """Show how the error falls with the number of rays, by fan, by Sobol' samples and by adaptive integration.

    Parameters
    ----------
    file
        The design file.
    angle_deg
        Angle in degrees, counter-clockwise: a negative one turns to the right.
    mode
        count, power or roulette.
    figure
        Draw error and stated uncertainty against rays into this .svg, .png or .pdf.
    """
    from solen.pipeline.design import commands as pipeline

    found = pipeline.convergence_of(file, set_ or (), angle_deg=angle_deg, mode=mode, figure=figure)
    show(found, as_json, lambda: _convergence_lines(found))


def sensitivity(file: Path, /, *keys: str, angle_deg: float = 0.0, set_: Set = None, as_json: Json = False) -> None:
    """Show how the readings change with the numbers of the design, per unit of each, the steepest contrast first.

    Parameters
    ----------
    file
        The design file.
    keys
        Numbers of the design, as in body.arm_width_mm; by default all that the light depends on.
    angle_deg
        Angle in degrees, counter-clockwise: a negative one turns to the right.
    """
    from solen.pipeline.design import commands as pipeline

    with progress_bar("differentiating") as progress:
        found = pipeline.sensitivity(file, keys, set_ or (), angle_deg=angle_deg, progress=progress)
    show(found, as_json, lambda: _sensitivity_lines(found))


def run(file: Path, /, *, out: Path, set_: Set = None, as_json: Json = False) -> None:
    """Do the whole chain: lens, body, response with and without lens, figures, tables, report.

    Parameters
    ----------
    file
        The design file.
    out
        Folder for report.html, results.json, results.csv and the figures; made if need be.
    """
    from solen.pipeline.design import commands as pipeline

    with progress_bar("tracing") as progress:
        found = pipeline.run(file, out, set_ or (), progress)
    show(found, as_json, lambda: _run_lines(found))


def _trace_lines(found: dict[str, Any]) -> list[str]:
    method = "" if found["method"] == "fan" else f", {found['method']}"
    lines = [f"{found['name']} at {found['angle_deg']:g} deg, {found['rays']} rays, mode {found['mode']}{method}"]
    for name, one in found["detectors"].items():
        u = "" if one["u"] is None else f" ± {one['u']:.1e}"
        lines.append(f"  {name:9} {one['power']:.6f}{u}  ({one['rays']} rays)")
    lines += [f"  {name:9} {power:.6f}" for name, power in found["ledger"].items()]
    if "missed" in found:
        lines.append(
            f"  of what escaped, {found['missed']:.6f} passed above or below, {found['leaked']:.6f} leaked there"
        )
    if found["single_error"] is not None:
        lines.append(f"single precision is off by at most {found['single_error']:.1e} where it was compared")
    if not found["reached"]:
        lines.append(f"the tolerance was not reached: {found['why']}")
    if found["undefined_at_mm"]:
        lines.append(f"  {found['undefined']} rays met an inconsistent interface, at {found['undefined_at_mm'][0]} mm")
    return [
        *lines,
        *_warning_lines(found),
        *(f"{kind}: {found[kind]}" for kind in ("figure", "netcdf") if kind in found),
    ]


def _scene_lines(found: dict[str, Any]) -> list[str]:
    lines = [f"{found['name']} ({found['format']}), {found['rays']} rays, mode {found['mode']}"]
    for name, one in found["detectors"].items():
        bins = f", {len(one['map']['position'])} bins" if "map" in one else ""
        lines.append(f"  {name:9} {one['power']:.6g} ({one['rays']} rays{bins})")
    lines += [f"  {name:9} {power:.6f}" for name, power in found["ledger"].items()]
    if found["undefined_at_mm"]:
        lines.append(f"  {found['undefined']} rays met an inconsistent interface, at {found['undefined_at_mm'][0]} mm")
    for one in found["not_understood"]:
        what = "scene" if one["object"] == 0 else f"object {one['object']}, {one['type']}"
        lines.append(f"not understood: {what}{'' if one['key'] is None else ', ' + one['key']}: {one['reason']}")
    return lines + [f"{kind}: {found[kind]}" for kind in ("figure", "netcdf") if kind in found]


def _convergence_lines(found: dict[str, Any]) -> list[str]:
    reference = found["reference"]
    by = f"{reference['method']} with {reference['rays']} rays, u {short(reference['u'])}"
    lines = [f"{found['name']} at {found['angle_deg']:g} deg, mode {found['mode']}: error against {by}"]
    for series in found["series"]:
        rows = zip(series["rays"], series["error"], series["u"], strict=True)
        lines += [f"  {series['method']:8} {rays:8} rays  error {short(e)}  u {short(u)}" for rays, e, u in rows]
    return [*lines, *_warning_lines(found), *([f"figure: {found['figure']}"] if "figure" in found else [])]


def _sensitivity_lines(found: dict[str, Any]) -> list[str]:
    rows = found["sensitivities"]
    width = max((len(row["key"]) for row in rows), default=0)
    lines = [
        f"{found['name']} at {found['angle_deg']:g} deg: change per unit of each number",
        f"  {'':{width}}  {'value':>9}  {'d right':>12}  {'d left':>12}  {'d contrast':>12}  {'u of that':>9}",
    ]
    for row in rows:
        start = f"  {row['key']:{width}}  {row['value']:9.6g}"
        if row["why"]:
            lines.append(f"{start}  {row['why']}")
            continue
        slopes = "".join(f"  {_slope(row[name])}" for name in ("right", "left", "contrast"))
        lines.append(f"{start}{slopes}  {short(row['u_contrast']):>9}")
    return [*lines, *(f"left out: {key}: {why}" for key, why in found["skipped"].items()), *_warning_lines(found)]


def _slope(value: float | None) -> str:
    return f"{'none' if value is None else f'{value:+.6g}':>12}"


def _material(found: dict[str, Any]) -> dict[str, Any]:
    """Numbers of a material that a line each is spent on."""
    return {name: found[name] for name in ("index", "u_index", "mode") if name == "index" or found[name] is not None}


def _focus_lines(found: dict[str, Any]) -> list[str]:
    """Foci in materials whose index is off by its standard uncertainty."""
    return [
        f"  index {one['index']:.6g} (off by its uncertainty, {one['step']:+.2g}): near the axis "
        f"{text(one['paraxial_focus_mm'])} mm, smallest spot {text(one['best_focus_mm'])} mm"
        for one in found.get("focus_by_index", ())
        if one["is_u_index"]
    ]


def _warning_lines(*parts: dict[str, Any]) -> list[str]:
    return [f"warning: {one}" for part in parts for one in part["warnings"]]


def _run_lines(found: dict[str, Any]) -> list[str]:
    material = found["material"]
    u = "" if material["u_index"] is None else f" ± {material['u_index']:.2g}"
    lines = [f"{found['name']}: index {material['index']:.6g}{u} at {material['wavelength_nm']:g} nm"]
    for name, one in found["summary"].items():
        ends = f"{text(one['contrast_from'])} at {one['from_deg']:g} deg to {text(one['contrast_to'])}"
        lines.append(f"  {name:8} contrast {ends} at {one['to_deg']:g} deg, received {one['received_share']:.4f}")
    parts = [part for part in (found, found["practice"]) if part is not None]
    told = [*_printed_lines(found["as_printed"]), *_practice_lines(found["practice"])]
    return [*lines, *told, *_warning_lines(*parts), f"report: {found['report']}"]


def _printed_lines(found: dict[str, Any] | None) -> list[str]:
    """What a lens as it was printed does to the response."""
    if found is None:
        return []
    lines = []
    for name in ("emitter", "chip"):
        one = found[name]
        if one is None or one["largest"] is None:
            continue
        who = f"chip of {one['width_mm']:g} mm" if one["width_mm"] else "point"
        largest = one["largest"]
        lines.append(
            f"  {'printed':8} {found['told']} less as designed, {who}: contrast {largest['difference']:+.4f} ± "
            f"{short(largest['u'])} at most, at {largest['angle_deg']:g} deg; received {one['received_printed']:.4f}, "
            f"designed {one['received_designed']:.4f}"
        )
        if one["null_shift_deg"] is not None:
            lines.append(f"  {'null':8} moves by {one['null_shift_deg']:+.4f} ± {short(one['u_null_shift_deg'])} deg")
    return lines


def _practice_lines(found: dict[str, Any] | None) -> list[str]:
    """A real chip, and what its decentre does."""
    if found is None:
        return []
    lines, chip, shift, emitter = [], found["chip"], found["null_shift"], found["emitter"]
    if chip is not None and emitter["kind"] != "file":
        ends = f"{text(chip['contrast_from'])} at {chip['from_deg']:g} deg to {text(chip['contrast_to'])}"
        width = f"{emitter['width_mm']:g} mm wide" + (", for comparison" if emitter["kind"] == "comparison" else "")
        lines.append(f"  {'chip':8} contrast {ends} at {chip['to_deg']:g} deg, {width}")
    if shift is not None:
        moved = f"{shift['shift_deg']:+.3f} ± {shift['u_deg']:.1g} deg"
        lines.append(f"  {'null':8} moves by {moved} for {shift['step_mm']:g} mm of the emitter towards +x")
    if found["index_shift"] is not None:
        what = "its uncertainty" if found["index_is_u"] else f"{found['index_step']:g} of index"
        beside = "" if found["chip_shift"] is None else f"; the chip alone by {found['chip_shift']['contrast']:.3f}"
        moved = f"{found['index_shift']['contrast']:.3f} at {found['index_shift']['angle_deg']:g} deg"
        lines.append(f"  {'index':8} {what} moves the contrast by up to {moved}{beside}")
    return lines
