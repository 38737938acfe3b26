"""What `solen print coupons` does: solids, jobs and plans of coupons in one folder, all made before any is written."""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from solen import fabricate, files
from solen.errors import OutputError, SpecError
from solen.fabricate import Label, Mesh, Part
from solen.fabricate.coupons import as_job, as_plan, cautions, check_plate, coupon_parts, job_sha256
from solen.geometry.coupons import COUPONS, Choices, Coupon, chosen, layout
from solen.parts import printer_of
from solen.pipeline.outputs import check_figure
from solen.spec.toml import parse_assignment

MESHES = {kind: fabricate.MESH_WRITERS[kind] for kind in ("stl", "3mf")}


def choices_of(assignments: Sequence[str] = (), **options: object) -> Choices:
    """Parameters of coupons from ``key=value`` texts and options that are not None; the options count."""
    values: dict[str, object] = dict(parse_assignment(text) for text in assignments)
    return chosen(values | {name: value for name, value in options.items() if value is not None})


def names_of(only: str | None) -> list[str]:
    """Names of coupons of a list with commas, in the library's order; all where there is none."""
    if only is None:
        return list(COUPONS)
    wanted = [name.strip() for name in only.split(",")]
    for name in wanted:
        if name not in COUPONS:
            raise SpecError("--only", value=name, limit=f"must be some of {', '.join(COUPONS)}")
    return [name for name in COUPONS if name in wanted]


def listed(only: str | None, choices: Choices) -> dict[str, Any]:
    """What coupons there are, and what was read into each."""
    return {"coupons": [_told(layout(name, choices), choices) for name in names_of(only)], "choices": asdict(choices)}


def coupons(
    out: Path,
    only: str | None = None,
    choices: Choices | None = None,
    *,
    step: bool = False,
    plate_mm: tuple[float, float] | None = None,
    printer: str | None = None,
    tolerance_mm: float = 1e-3,
    figure: Path | None = None,
) -> dict[str, Any]:
    """Write STL, 3MF, job and plan of coupons into a folder.

    Parameters
    ----------
    out
        Folder, made if need be; files of the same names are replaced.
    only
        Names with commas between them; all coupons by default.
    choices
        Parameters.
    step
        Whether to write STEP as well.
    plate_mm
        Build plate that each coupon must fit on.
    printer
        Name or file of a printer, whose plate and pixel are taken where they are not given.
    tolerance_mm
        How far a mesh may leave the exact walls.
    figure
        Draw all plans into this file.

    Raises
    ------
    SolenError
        Where a coupon cannot be made or a file not be written; nothing is written then.
    """
    check_figure(figure)
    if step:
        fabricate.check_kernel()
    choices = choices or Choices()
    if printer is not None:
        made_by = printer_of(printer)
        plate_mm = plate_mm or made_by.size_mm[:2]
        choices = replace(choices, pitch_um=choices.pitch_um or made_by.pitch_um.usual)
    chosen_ones = [layout(name, choices) for name in names_of(only)]
    if plate_mm is not None:
        if not all(0.0 < side < math.inf for side in plate_mm):
            raise SpecError("--plate-mm", value=list(plate_mm), limit="must be above 0")
        for coupon in chosen_ones:
            check_plate(coupon, plate_mm)
    with files.output_folder(out):
        contents: dict[Path, files.Content] = {}
        found = [_made(coupon, choices, out, contents, step=step, tolerance_mm=tolerance_mm) for coupon in chosen_ones]
        if figure is not None:
            if figure.resolve() in {target.resolve() for target in contents}:
                raise OutputError(str(figure), limit="is a file of the coupons too", remedy="rename the figure")
            contents[figure] = _drawn(chosen_ones, figure)
        files.write_all(contents)
    result = {"coupons": found, "choices": asdict(choices), "folder": str(out)}
    return result | ({} if figure is None else {"figure": str(figure)})


def _told(coupon: Coupon, choices: Choices) -> dict[str, Any]:
    """What a coupon is, in numbers."""
    return {
        "name": coupon.name,
        "title": coupon.title,
        "size_mm": list(coupon.size_mm),
        "features": len(coupon.features),
        "gaps": len(coupon.gaps),
        "steps": len(coupon.steps),
        "readings": [asdict(reading) for reading in coupon.readings],
        "warnings": cautions(coupon, choices),
    }


def _made(
    coupon: Coupon, choices: Choices, out: Path, contents: dict[Path, files.Content], *, step: bool, tolerance_mm: float
) -> dict[str, Any]:
    """Files of one coupon, put into ``contents``, and what is told of it."""
    label = Label(coupon.name, job_sha256(coupon, choices), f"coupon: {coupon.title}")
    stages, made = {}, []
    for name, part in coupon_parts(coupon).items():
        mesh = fabricate.mesh_of(part, tolerance_mm)
        data = {kind: write(mesh, label) for kind, write in MESHES.items()}
        if step:
            data["step"] = fabricate.as_step(part, label)
        contents |= {out / f"{part.name}.{kind}": content for kind, content in data.items()}
        stages[name] = {kind: f"{part.name}.{kind}" for kind in data}
        made.append(_numbers(part, mesh))
    job = as_job(coupon, choices, stages)
    paths = {"job": out / f"{coupon.name}.json", "plan": out / f"{coupon.name}.svg"}
    contents[paths["job"]] = (json.dumps(job, indent=1, allow_nan=False) + "\n").encode()
    contents[paths["plan"]] = as_plan(coupon, label)
    named = {kind: str(out / name) for one in stages.values() for kind, name in one.items()}
    if len(stages) > 1:
        named = {f"{kind}-{stage}": str(out / name) for stage, one in stages.items() for kind, name in one.items()}
    told = _told(coupon, choices) | {"sha256": label.sha256, "parts": made}
    return told | {"files": named | {kind: str(path) for kind, path in paths.items()}}


def _numbers(part: Part, mesh: Mesh) -> dict[str, Any]:
    return {
        "name": part.name,
        "volume_mm3": part.volume_mm3,
        "mesh_volume_mm3": mesh.volume_mm3,
        "volume_bound_mm3": part.wall_mm2 * mesh.tolerance_mm,
        "triangles": len(mesh.triangles),
    }


def _drawn(chosen_ones: list[Coupon], figure: Path) -> bytes:
    from solen.report import canvas
    from solen.report.print.coupons import plans_figure

    return canvas.encoded(plans_figure(chosen_ones), figure.suffix.lower(), "coupons")
