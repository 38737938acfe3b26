"""Layers of a print: sections of a solid at the middle of each layer, as pictures of pixel coverage with exposures.

The idea: a `Solid` is oriented for printing, with its lowest point on the plate; it is a `Plan` of exact outlines if a
part is printed flat, and `Slices` of a closed mesh otherwise. A `Job` puts copies of it on a printer's plate and yields
each `Layer` on demand, so a job of thousands of layers needs memory for only a few. The value of a pixel is the share
covered by the solid **at the middle of the layer's height**. The last layer is omitted if the solid fills less than
half of it, and otherwise printed at its full thickness; on average, the stack is therefore as high as the solid.

The interface: `printable_design` and `printable_mesh` in an `orientation`, sliced according to `Slicing`; `Job.layers`;
`write_archive` for a ZIP of PNGs with a job.json, `write_goo` for a .goo file; `layered_print` for the summary,
`as_sheet` for slicing programs that read the STL.
"""

from solen.fabricate.layers.archive import Stack, as_png, write_archive
from solen.fabricate.layers.goo import checked_for_goo, write_goo
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.layered import LayeredPrint, layered_print
from solen.fabricate.layers.options import Orientation, Slicing
from solen.fabricate.layers.orientation import orientation, turned
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
    "checked_for_goo",
    "layered_print",
    "mesh_solid",
    "orientation",
    "printable_design",
    "printable_mesh",
    "solid_of",
    "turned",
    "write_archive",
    "write_goo",
]
