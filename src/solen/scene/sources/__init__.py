"""What launches rays: point sources, chips, beams, single rays.

Coordinates are (x, z) in mm, in an extruded scene (x, y, z); angles in degrees counter-clockwise from +z.
"""

from solen.scene.sources.base import Launch, Line, Placed, PlacedInSpace, Source
from solen.scene.sources.plain import Beam, Chip, Fan, Rays

__all__ = ["Beam", "Chip", "Fan", "Launch", "Line", "Placed", "PlacedInSpace", "Rays", "Source"]
