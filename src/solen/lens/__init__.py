"""The lens: a Cartesian oval that takes the emitter to one focus, or the flat face of a sensor without one."""

from solen.lens.build import lens_of
from solen.lens.measured import MeasuredProfile, profile_of, profile_text, read_profile
from solen.lens.optics import FlatFace, Lens, OvalLens, nearest_focus_mm, tangency

__all__ = [
    "FlatFace",
    "Lens",
    "MeasuredProfile",
    "OvalLens",
    "lens_of",
    "nearest_focus_mm",
    "profile_of",
    "profile_text",
    "read_profile",
    "tangency",
]
