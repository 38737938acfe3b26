"""From a body to files for making it: the solid with its seats, as meshes, as a STEP file, as drawings.

`sensor_part` makes the `Part` of a design, exact and without any file: prisms of curves, less cuts. `mesh_of` makes
triangles of it within a tolerance. Each format is a function from these to bytes: `as_stl`, `as_threemf` and `as_glb`
of a mesh, `as_step` of a part, `as_dxf`, `as_svg` and `as_comsol` of a body; `FORMATS` lists them. Each file carries a
`Label`.
"""

from solen.fabricate.bspline import Bspline, primitives
from solen.fabricate.comsol import as_comsol
from solen.fabricate.dxf import as_dxf, check_writer
from solen.fabricate.export import FORMATS, USUAL, Export, ExportedSolid, MeshSize, exported_solid
from solen.fabricate.label import Label, label_of
from solen.fabricate.measures import area_mm2, perimeter_mm
from solen.fabricate.mesh import Mesh, mesh_of
from solen.fabricate.meshfiles import MESH_WRITERS, as_glb, as_stl, as_threemf
from solen.fabricate.part import Cut, Part, Prism, sensor_prism
from solen.fabricate.raster import coverage, coverage_bytes, rings_of
from solen.fabricate.seats import sensor_part
from solen.fabricate.step import as_step, check_kernel
from solen.fabricate.svg import as_svg

__all__ = [
    "FORMATS",
    "MESH_WRITERS",
    "USUAL",
    "Bspline",
    "Cut",
    "Export",
    "ExportedSolid",
    "Label",
    "Mesh",
    "MeshSize",
    "Part",
    "Prism",
    "area_mm2",
    "as_comsol",
    "as_dxf",
    "as_glb",
    "as_step",
    "as_stl",
    "as_svg",
    "as_threemf",
    "check_kernel",
    "check_writer",
    "coverage",
    "coverage_bytes",
    "exported_solid",
    "label_of",
    "mesh_of",
    "perimeter_mm",
    "primitives",
    "rings_of",
    "sensor_part",
    "sensor_prism",
]
