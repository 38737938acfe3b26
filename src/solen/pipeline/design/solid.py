"""`solen export`: the formats as options of a command."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.errors import SpecError
from solen.fabricate import ExportedSolid
from solen.fabricate.layers import Slicing
from solen.fabricate.seats import SeatOptions
from solen.pipeline.design import export as pipeline
from solen.pipeline.options import FLAT, ProgressBar, Set
from solen.report.options import FigureOptions
from solen.results import Outcome


def export(
    file: Path,
    /,
    *,
    out: Path,
    step: bool = False,
    stl: bool = False,
    threemf: Annotated[bool, Parameter(name="--3mf")] = False,
    glb: bool = False,
    dxf: bool = False,
    comsol: bool = False,
    svg: bool = False,
    layers: bool = False,
    slicing: Annotated[Slicing | None, FLAT] = None,
    seats: Annotated[SeatOptions, FLAT] = SeatOptions(),
    thickness_mm: str | None = None,
    tolerance_mm: float = 1e-3,
    set_: Set = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    progress: ProgressBar = None,
) -> Outcome[ExportedSolid]:
    """Write the solid and the drawings of a sensor in mm; default formats: STL and 3MF.

    Parameters
    ----------
    file
        The design file; the written files are named after it.
    out
        Folder for the files; created if missing.
    step
        Exact solid with B-splines, for CAD programs (requires the extra cad).
    stl
        Binary mesh for printers.
    threemf
        Mesh for printers, with unit and name.
    glb
        Mesh for viewers.
    dxf
        Drawing of the outline, with a layer for each face (requires the extra dxf).
    comsol
        Points in sectionwise format, for interpolation curves of COMSOL.
    svg
        Drawing of the outline, with a named path for each face.
    layers
        Layer images for a printer, with STL and settings; options as for solen print layers.
    thickness_mm
        Thickness in mm instead of body.thickness_mm.
    tolerance_mm
        Maximum distance of a mesh from the exact walls in mm, 1e-4 to 1.
    """
    selected = {"step": step, "stl": stl, "3mf": threemf, "glb": glb, "dxf": dxf, "comsol": comsol, "svg": svg}
    thickness = [] if thickness_mm is None else [f"body.thickness_mm={thickness_mm}"]
    assignments = [*(set_ or ()), *seats.assignments, *thickness]
    formats = tuple(kind for kind, is_selected in selected.items() if is_selected)
    if slicing is not None and not layers:
        raise SpecError("--layers", limit="is missing, but slicing options are specified", remedy="add --layers")
    return pipeline.export(
        file,
        out,
        formats,
        assignments,
        tolerance_mm=tolerance_mm,
        figure=figure,
        slicing=(slicing or Slicing()) if layers else None,
        progress=progress,
    )
