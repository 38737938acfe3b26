"""From a picture to sizes: micrographs with their scale, sub-pixel edges, and the printed lens against its design.

`read_image` gives an `Image`, grey values with a scale that is never guessed. `fit_edge` finds an edge near a contour
to a small part of a pixel, with its uncertainty and what was set aside.
"""

from solen.metrology.edge import Edge, fit_edge, fit_two_edges, normals_of, profiles
from solen.metrology.image import Image, as_image, read_image
from solen.metrology.scale import Scale

__all__ = ["Edge", "Image", "Scale", "as_image", "fit_edge", "fit_two_edges", "normals_of", "profiles", "read_image"]
