"""Export of a body: the solid with its seats as meshes and as a STEP file, and the outlines as drawings.

`sensor_part` makes the exact `Part` of a design without writing a file: prisms bounded by curves, minus cuts. `mesh_of`
triangulates the part within a tolerance. Each format has a function that returns the bytes of a file: `as_stl`,
`as_threemf` and `as_glb` for a mesh, `as_step` for a part, and `as_dxf`, `as_svg` and `as_comsol` for a body; `FORMATS`
lists them. Each file contains a `Label`.
"""

from solen.fabricate.bspline import Bspline, primitives
from solen.fabricate.comsol import as_comsol
from solen.fabricate.dxf import as_dxf
from solen.fabricate.export import (
    DEFAULT_FORMATS,
    FORMATS,
    Export,
    ExportedSolid,
    SolidFiles,
    exported_solid,
    solid_files,
)
from solen.fabricate.label import Label, label_of
from solen.fabricate.lens_parts import cut_for
from solen.fabricate.mesh import Mesh, mesh_of
from solen.fabricate.meshfiles import MESH_WRITERS, as_glb, as_stl, as_threemf
from solen.fabricate.part import Part, Prism
from solen.fabricate.seats import sensor_part
from solen.fabricate.step import as_step
from solen.fabricate.svg import as_svg
from solen.geometry.measures import area_mm2, perimeter_mm

__all__ = [
    "DEFAULT_FORMATS",
    "FORMATS",
    "MESH_WRITERS",
    "Bspline",
    "Export",
    "ExportedSolid",
    "Label",
    "Mesh",
    "Part",
    "Prism",
    "SolidFiles",
    "area_mm2",
    "as_comsol",
    "as_dxf",
    "as_glb",
    "as_step",
    "as_stl",
    "as_svg",
    "as_threemf",
    "cut_for",
    "exported_solid",
    "label_of",
    "mesh_of",
    "perimeter_mm",
    "primitives",
    "sensor_part",
    "solid_files",
]
