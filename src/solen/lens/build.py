"""The lens of a design."""

from solen.errors import DesignError
from solen.lens.optics import FlatFace, Lens, OvalLens
from solen.spec import Design


def lens_of(design: Design, index: float) -> Lens:
    """Lens a design asks for in a material of ``index`` (at the emitter's wavelength); `DesignError` if it cannot work.

    The oval is cut for ``lens.design_index`` where that is given, else for the material's own index.
    """
    spec, distance_mm = design.lens, design.emitter.distance_mm
    if spec.shape == "none":
        return FlatFace(distance_mm, spec.half_width_mm)
    if spec.design_index is None and index <= 1.0:
        raise DesignError(
            "the material's index", value=index, limit="must be above 1, the air's", remedy="or no lens can focus"
        )
    return OvalLens(distance_mm, spec.focus_mm, spec.half_width_mm, spec.design_index or index)
