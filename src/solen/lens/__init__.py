"""Lenses: a Cartesian oval, a free form, a lens for skew rays, a measured lens, or a flat face."""

from solen.lens.base import CurvedLens, Lens
from solen.lens.build import lens_of, measured_lens
from solen.lens.fitted_profile import FittedProfile
from solen.lens.in_space import LensInSpace
from solen.lens.layered import LayeredLens, layer_count, layer_edges_mm
from solen.lens.layers_file import LayeredLensFromFile, LayerProfiles, layers_text, read_layers
from solen.lens.line_focus import LineFocusLens
from solen.lens.measured import MeasuredLens
from solen.lens.optics import FlatFace, OvalLens, nearest_focus_mm, tangency
from solen.lens.profile import MeasuredProfile, profile_of, profile_text, read_profile
from solen.lens.spline import DesignedLens, SplineLens

__all__ = [
    "CurvedLens",
    "DesignedLens",
    "FittedProfile",
    "FlatFace",
    "LayerProfiles",
    "LayeredLens",
    "LayeredLensFromFile",
    "Lens",
    "LensInSpace",
    "LineFocusLens",
    "MeasuredLens",
    "MeasuredProfile",
    "OvalLens",
    "SplineLens",
    "layer_count",
    "layer_edges_mm",
    "layers_text",
    "lens_of",
    "measured_lens",
    "nearest_focus_mm",
    "profile_of",
    "profile_text",
    "read_layers",
    "read_profile",
    "tangency",
]
