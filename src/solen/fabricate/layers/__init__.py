"""Layers of a print: a solid cut at the middle of each layer, as pictures of covered pixels with their exposure.

The idea: a `Solid` lies as it is printed, its lowest point on the plate; it is a `Plan` of exact outlines where a part
is printed flat, and `Slices` of a closed mesh otherwise. A `Job` puts copies of it on a printer's plate and gives
`Layer` after `Layer`, each made when it is asked for, so that a job of thousands needs the memory of a few. The value
of a pixel is the share of it that the solid covers **at the middle of the layer's height**; a last layer that the solid
fills by less than half is left out, by more is whole, so that the stack is on average as high as the solid.

The interface: `solid_of` a part and `mesh_solid` of a mesh, in an `orientation`; `Job.layers`; `write_archive` for a
ZIP of PNGs with a job.json; `settings` and `as_sheet` for the program of a printer that takes the STL.
"""

from solen.fabricate.layers.archive import Summary, write_archive
from solen.fabricate.layers.exposure import Exposure
from solen.fabricate.layers.job import Job, Layer
from solen.fabricate.layers.orientation import ORIENTATIONS, orientation, turned
from solen.fabricate.layers.png import as_png
from solen.fabricate.layers.sheet import as_sheet, settings
from solen.fabricate.layers.solid import Plan, Slices, Solid, mesh_solid, solid_of

__all__ = [
    "ORIENTATIONS",
    "Exposure",
    "Job",
    "Layer",
    "Plan",
    "Slices",
    "Solid",
    "Summary",
    "as_png",
    "as_sheet",
    "mesh_solid",
    "orientation",
    "settings",
    "solid_of",
    "turned",
    "write_archive",
]
