"""The command that takes a design to the workshop: solids and drawings."""

from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from solen.cli.app import FigureFile, Json, Set, listing, progress_bar, show
from solen.cli.print.layers import How
from solen.cli.print.layers import told as layers_told
from solen.errors import SpecError
from solen.pipeline.print.slicing import Slicing

Flag = Annotated[bool, Parameter(negative=())]


def export(
    file: Path,
    /,
    *,
    out: Path,
    step: Flag = False,
    stl: Flag = False,
    threemf: Annotated[bool, Parameter(name="--3mf", negative=())] = False,
    glb: Flag = False,
    dxf: Flag = False,
    comsol: Flag = False,
    svg: Flag = False,
    layers: Flag = False,
    how: How = None,
    pockets: Flag = False,
    slots: Flag = False,
    thickness_mm: str | None = None,
    tolerance_mm: float = 1e-3,
    set_: Set = None,
    figure: FigureFile = None,
    as_json: Json = False,
) -> None:
    """Write the solid and the drawings of a sensor, in mm; without a format, STL and 3MF.

    Parameters
    ----------
    file
        The design file; what is written has its name.
    out
        Folder for the files; made if need be.
    step
        Exact solid with B-splines, for CAD programs (needs the extra cad).
    stl
        Mesh for printers, binary.
    threemf
        Mesh for printers, with its unit and name.
    glb
        Mesh for viewers.
    dxf
        Drawing of the outline, a layer for each face (needs the extra dxf).
    comsol
        Text of points that COMSOL reads as interpolation curves, sectionwise.
    svg
        Drawing of the outline, a named path for each face.
    layers
        Pictures of layers for a printer, with STL and settings for its program; the options are of solen print layers.
    pockets
        Seat the receivers in pockets; short for --set fabricate.pockets=true.
    slots
        Cut slots for supports of film at receivers and emitter; short for --set fabricate.slots=[...].
    thickness_mm
        In place of body.thickness_mm.
    tolerance_mm
        How far a mesh may leave the exact walls, 1e-4 to 1.
    """
    from solen.pipeline.design import export as pipeline

    asked = {"step": step, "stl": stl, "3mf": threemf, "glb": glb, "dxf": dxf, "comsol": comsol, "svg": svg}
    chosen = {
        "fabricate.pockets": "true" if pockets else None,
        "fabricate.slots": '["receivers", "emitter"]' if slots else None,
        "body.thickness_mm": thickness_mm,
    }
    assignments = [*(set_ or ()), *(f"{key}={value}" for key, value in chosen.items() if value is not None)]
    formats = tuple(kind for kind, wanted in asked.items() if wanted)
    if how is not None and not layers:
        raise SpecError("options of layers", limit="have no meaning without --layers", remedy="add --layers")
    slicing = (how or Slicing()) if layers else None
    with progress_bar("layers") as progress:
        found = pipeline.export(
            file,
            out,
            formats,
            assignments,
            tolerance_mm=tolerance_mm,
            figure=figure,
            slicing=slicing,
            progress=progress,
        )
    show(found, as_json, lambda: _lines(found))


def _lines(found: dict[str, Any]) -> list[str]:
    lines = [found["name"], *listing({key: found[key] for key in ("thickness_mm", "area_mm2", "volume_mm3")})]
    lines += [f"  {seat['name']} takes {seat['volume_mm3']:.4g} mm3" for seat in found["seats"]]
    if found["mesh"] is not None:
        mesh = found["mesh"]
        lines.append(
            f"mesh: {mesh['triangles']} triangles within {mesh['tolerance_mm']:g} mm, {mesh['volume_mm3']:.6g} mm3"
        )
    job = found.get("layers")
    notes = [line for line in found["warnings"] if job is None or line not in job["warnings"]]
    lines += [f"warning: {line}" for line in notes]
    lines += [f"{kind}: {path}" for kind, path in found["files"].items()]
    lines += layers_told(job)[1:] if job is not None else []
    return lines + ([f"figure: {found['figure']}"] if "figure" in found else [])
