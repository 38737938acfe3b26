"""What `solen export` does: a design's solid and drawings, in one folder, each checked before any is written.

Everything is made in memory first and then written at once, so a design that cannot be made leaves nothing behind.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from solen import fabricate, files
from solen.arrays import Progress
from solen.errors import OutputError, SpecError
from solen.fabricate import Label, Mesh, Part
from solen.geometry import Body
from solen.pipeline.design.commands import open_design
from solen.pipeline.names import stem_of
from solen.pipeline.outputs import check_figure
from solen.pipeline.print import layers as printing
from solen.pipeline.print.slicing import Slicing
from solen.sensor import Sensor
from solen.spec import Design

MESHES: dict[str, Callable[[Mesh, Label], bytes]] = {
    "stl": fabricate.as_stl,
    "3mf": fabricate.as_threemf,
    "glb": fabricate.as_glb,
}
DRAWINGS: dict[str, Callable[[Body, Label], bytes]] = {
    "dxf": fabricate.as_dxf,
    "comsol": fabricate.as_comsol,
    "svg": fabricate.as_svg,
}
NEEDS: dict[str, Callable[[], None]] = {"step": fabricate.check_kernel, "dxf": fabricate.check_writer}
FORMATS = ("step", *MESHES, *DRAWINGS)
USUAL = ("stl", "3mf")
"""Formats where none is asked for: what a printer's program takes."""
ENDINGS = {"comsol": "-comsol.txt"}


def export(
    path: Path,
    out: Path,
    formats: Sequence[str] = (),
    assignments: Sequence[str] = (),
    *,
    tolerance_mm: float = 1e-3,
    figure: Path | None = None,
    slicing: Slicing | None = None,
    progress: Progress = lambda _: None,
) -> dict[str, Any]:
    """Write a design's solid and drawings into a folder.

    Parameters
    ----------
    path
        The design file; the files are called by its name.
    out
        Folder for them, made if need be; files of the same names are replaced.
    formats
        Some of `FORMATS`; none stands for `USUAL`, and with ``slicing`` for none.
    assignments
        ``key=value`` of the design.
    tolerance_mm
        How far a mesh may leave the exact walls.
    figure
        Draw the solid into this file.
    slicing
        Cut the part into layers, too.
    progress
        Told the share of the layers that is done.

    Raises
    ------
    SolenError
        Where the design cannot be made, an extra is missing, or a file cannot be written; nothing is written then.
    """
    check_figure(figure)
    chosen = tuple(kind for kind in FORMATS if kind in (formats or (USUAL if slicing is None else ())))
    for kind in chosen:
        NEEDS.get(kind, lambda: None)()
    design = open_design(path, assignments)
    body = Sensor.of(design).body()
    part = fabricate.sensor_part(design, body)
    mesh = fabricate.mesh_of(part, tolerance_mm) if figure is not None or MESHES.keys() & set(chosen) else None
    found = _told(design, part, body, mesh, chosen)
    label = fabricate.label_of(design, _about(design, part))
    with files.output_folder(out):
        targets = {kind: out / (stem_of(path) + ENDINGS.get(kind, f".{kind}")) for kind in chosen}
        if figure is not None and figure.resolve() in {target.resolve() for target in targets.values()}:
            raise OutputError(str(figure), limit="is a file of the export too", remedy="rename the figure")
        contents: dict[Path, files.Content] = {}
        for kind, target in targets.items():
            contents[target] = _made(kind, part, body, mesh, label)
        if figure is not None and mesh is not None:
            contents[figure] = _drawn(part, mesh, figure)
        run = None
        if slicing is not None:
            made = printing.made_of(design, part, label, path, slicing)
            run = printing.prepared(made, slicing, out, stem_of(path), progress=progress)
            contents |= run.contents()
        files.write_all(contents)
    named = {kind: str(target) for kind, target in targets.items()}
    found |= {"sha256": label.sha256, "files": named, "design": str(path)}
    if run is not None:
        found["layers"] = run.found()
        found["warnings"] += found["layers"]["warnings"]
    return found | ({} if figure is None else {"figure": str(figure)})


def _made(kind: str, part: Part, body: Body, mesh: Mesh | None, label: Label) -> bytes:
    """Content of a file."""
    if kind == "step":
        return fabricate.as_step(part, label)
    if kind in DRAWINGS:
        return DRAWINGS[kind](body, label)
    if mesh is None:
        raise SpecError("--" + kind, limit="needs a mesh")
    return MESHES[kind](mesh, label)


def _drawn(part: Part, mesh: Mesh, figure: Path) -> bytes:
    from solen.report import canvas
    from solen.report.print.fabricate import solid_figure

    return canvas.encoded(solid_figure(part, mesh), figure.suffix.lower(), "solid")


def _about(design: Design, part: Part) -> str:
    """What was made, in words."""
    seats = ", ".join(cut.name for cut in part.cuts)
    return f"thickness {design.body.thickness_mm:g} mm" + (f", with {seats}" if seats else "")


def _told(design: Design, part: Part, body: Body, mesh: Mesh | None, chosen: Sequence[str]) -> dict[str, Any]:
    """Numbers of the part: those of the exact curves, and of the mesh how far it is from them."""
    found: dict[str, Any] = {
        "name": design.name,
        "thickness_mm": design.body.thickness_mm,
        "area_mm2": sum(prism.area_mm2 for prism in part.prisms),
        "volume_mm3": part.volume_mm3,
        "pieces": _pieces(part),
        "faces": [face.name for face in body.all_faces],
        "seats": [{"name": cut.name, "volume_mm3": cut.volume_mm3} for cut in part.cuts],
        "mesh": None,
        "warnings": [*_as_printed(design), *_warnings(part, body, chosen)],
    }
    if mesh is not None:
        found["mesh"] = {
            "tolerance_mm": mesh.tolerance_mm,
            "size_mm": list(mesh.size_mm),
            "triangles": len(mesh.triangles),
            "volume_mm3": mesh.volume_mm3,
            "volume_bound_mm3": part.wall_mm2 * mesh.tolerance_mm,
        }
    return found


def _as_printed(design: Design) -> list[str]:
    """What must be known of a solid whose lens is not the one to print."""
    if design.lens.shape != "measured":
        return []
    return ['the lens is as it was measured; set lens.shape = "cartesian-oval" for the one to print']


def _pieces(part: Part) -> int:
    """Number of pieces that the outlines make: those that are no holes."""
    outlines = [outline for prism in part.prisms for outline in prism.outlines]
    return sum(fabricate.area_mm2([outline]) > 0.0 for outline in outlines)


def _warnings(part: Part, body: Body, chosen: Sequence[str]) -> list[str]:
    """What the files do not hold though the design says it."""
    found = []
    if (pieces := _pieces(part)) > 1:
        found.append(f"the outlines make {pieces} pieces, and nothing holds them together")
    if body.apart:
        names = ", ".join(face.name for face in body.apart)
        found.append(f"{names} stand apart in the air: they are in the DXF and SVG drawings and not part of the solid")
    if part.cuts:
        found.append("light is traced as if there were no pockets and slots: solen trace does not know them")
        flat = [kind for kind in chosen if kind in DRAWINGS]
        if flat:
            found.append(f"pockets and slots are in the solid alone, not in the drawings ({', '.join(flat)})")
    return found
