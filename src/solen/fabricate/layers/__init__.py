"""Print layers: sections of a solid at mid-height of each layer, as images of the pixel coverage with exposures.

A `Solid` is oriented for printing, with its lowest point on the plate; it is a `Plan` of exact outlines if the part is
printed flat, and otherwise `Slices` of a closed mesh. A `Job` places copies of the solid on the plate of a printer and
yields each `Layer` on demand, so that even a job of thousands of layers keeps only a few of them in memory. The value
of a pixel is the fraction covered by the solid **at mid-height of the layer**. The last layer is omitted if the solid
fills less than half of it, and is otherwise printed at its full thickness; on average, the stack is therefore as high
as the solid.

`printable_design` and `printable_mesh` prepare a part in an `orientation`, and `Job.layers` slices it according to
`Slicing`. `write_archive` writes a ZIP file of PNGs with a job.json, and `write_goo` writes a .goo file.
`layered_print` returns the summary, and `as_sheet` the settings for a slicer that reads the STL.
"""

from solen.fabricate.layers.archive import Stack, as_png, write_archive
from solen.fabricate.layers.goo import lift_of, write_goo
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.layered import LayeredPrint, layered_print
from solen.fabricate.layers.options import Orientation, Slicing
from solen.fabricate.layers.orientation import orientation, rotation
from solen.fabricate.layers.printable import Printable, printable_design, printable_mesh
from solen.fabricate.layers.sheet import as_sheet
from solen.fabricate.layers.solid import Plan, Slices, Solid, mesh_solid, solid_of

__all__ = [
    "Job",
    "Layer",
    "LayeredPrint",
    "Orientation",
    "Plan",
    "Printable",
    "Slices",
    "Slicing",
    "Solid",
    "Stack",
    "as_png",
    "as_sheet",
    "layered_print",
    "lift_of",
    "mesh_solid",
    "orientation",
    "printable_design",
    "printable_mesh",
    "rotation",
    "solid_of",
    "write_archive",
    "write_goo",
]
