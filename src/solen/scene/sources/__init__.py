"""Ray sources: fans, chips, emitters with a pattern, beams, single rays, ray files and ambient light.

Coordinates are (x, z) in mm, or (x, y, z) in an extruded scene; angles are in degrees counter-clockwise from +z.
"""

from solen.scene.sources.ambient import Ambient
from solen.scene.sources.base import Emission, Launch, Line, Placed, Source
from solen.scene.sources.emitter import Emitter
from solen.scene.sources.fans import Beam, Chip, Fan, Rays
from solen.scene.sources.pattern import CosinePower, Isotropic, Pattern, PatternTable
from solen.scene.sources.ray_file import RayFile

__all__ = [
    "Ambient",
    "Beam",
    "Chip",
    "CosinePower",
    "Emission",
    "Emitter",
    "Fan",
    "Isotropic",
    "Launch",
    "Line",
    "Pattern",
    "PatternTable",
    "Placed",
    "RayFile",
    "Rays",
    "Source",
]
