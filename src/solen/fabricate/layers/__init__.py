"""Layers of a print: sections of a solid at the middle of each layer, as pictures of covered pixels with exposures.

The idea: a `Solid` is oriented for printing, its lowest point on the plate; it is a `Plan` of exact outlines if a part
is printed flat, and `Slices` of a closed mesh otherwise. A `Job` puts copies of it on a printer's plate and yields
`Layer` after `Layer` on demand, so that a job of thousands needs the memory of a few. The value
of a pixel is its share covered by the solid **at the middle of the layer's height**; a last layer that the solid
fills to less than half is left out, otherwise whole, so that the stack is on average as high as the solid.

The interface: `printable_design` and `printable_mesh` in an `orientation`, sliced by `Slicing`; `Job.layers`;
`write_archive` for a ZIP of PNGs with a job.json, `write_goo` for a .goo file; `layered_print` for the numbers,
`as_sheet` for printers' software that takes the STL.
"""

from solen.fabricate.layers.archive import Stack, as_png, write_archive
from solen.fabricate.layers.goo import checked_for_goo, write_goo
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.layered import LayeredPrint, layered_print
from solen.fabricate.layers.orientation import orientation, turned
from solen.fabricate.layers.printable import Printable, printable_design, printable_mesh
from solen.fabricate.layers.sheet import as_sheet
from solen.fabricate.layers.slicing import Orientation, Slicing
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
