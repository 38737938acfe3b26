"""The lens: a Cartesian oval that takes the emitter to one focus, one that was measured, or a flat face without one."""

from solen.lens.build import lens_of, measured_lens
from solen.lens.fitted_profile import FittedProfile
from solen.lens.measured import MeasuredLens
from solen.lens.optics import FlatFace, Lens, OvalLens, nearest_focus_mm, tangency
from solen.lens.profile import MeasuredProfile, profile_of, profile_text, read_profile

__all__ = [
    "FittedProfile",
    "FlatFace",
    "Lens",
    "MeasuredLens",
    "MeasuredProfile",
    "OvalLens",
    "lens_of",
    "measured_lens",
    "nearest_focus_mm",
    "profile_of",
    "profile_text",
    "read_profile",
    "tangency",
]
