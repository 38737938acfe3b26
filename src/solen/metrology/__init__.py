"""Measurement of prints in images: micrographs with their scale, sub-pixel edges, and deviations from the design.

`read_image` returns an `Image`: grey values with a scale that is never guessed. `measure_lens` measures a printed lens
in it against its design, and `solen.metrology.coupons.measure_coupon` measures a coupon. `fit_edge` locates an edge
near a contour to a small fraction of a pixel, with its uncertainty and the number of rejected points.
"""

from solen.metrology.edge import Edge, fit_edge, fit_two_edges, normals_of
from solen.metrology.image import Image, as_image, read_image
from solen.metrology.inspection import FacesInspection, InspectOptions, LensInspection, measure_faces, measure_lens
from solen.metrology.scale import Scale

__all__ = [
    "Edge",
    "FacesInspection",
    "Image",
    "InspectOptions",
    "LensInspection",
    "Scale",
    "as_image",
    "fit_edge",
    "fit_two_edges",
    "measure_faces",
    "measure_lens",
    "normals_of",
    "read_image",
]
