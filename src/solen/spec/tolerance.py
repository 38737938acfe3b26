"""The tolerance table: how far each number of the built sensor may differ from the design."""

from typing import ClassVar

from pydantic import Field

from solen.spec.strict import Positive, Strict


class Tolerance(Strict):
    """Tolerances of the numbers in the design, with which `solen run` and `solen sensitivity` rank their effects.

    A key is the dotted key of the number with the dot replaced by an underscore; all entries of a list share one
    tolerance.
    """

    table: ClassVar[str] = "tolerance"

    emitter_wavelength_nm: Positive = Field(5.0, description="Tolerance of emitter.wavelength_nm, in nm.")
    emitter_distance_mm: Positive = Field(
        0.05, description="Tolerance of emitter.distance_mm, in mm; the lens stays the same."
    )
    emitter_offset_mm: Positive = Field(
        0.01, description="Tolerance of emitter.offset_mm, in mm; default: as placed under a microscope."
    )
    emitter_y_mm: Positive = Field(0.1, description="Tolerance of emitter.y_mm, in mm; default: as placed by eye.")
    emitter_width_mm: Positive = Field(0.02, description="Tolerance of emitter.width_mm, in mm.")
    emitter_height_mm: Positive = Field(0.02, description="Tolerance of emitter.height_mm, in mm.")
    emitter_cone_deg: Positive = Field(5.0, description="Tolerance of emitter.cone_deg, in degrees.")
    material_index: Positive | None = Field(
        None,
        description="Tolerance of material.index; default: the resin's standard uncertainty, or 0.01 if it is unknown.",
    )
    material_absorption_per_mm: Positive | None = Field(
        None,
        description="Tolerance of material.absorption_per_mm; default: the resin's standard uncertainty, or 0.005 if "
        "it is unknown.",
    )
    lens_focus_mm: Positive = Field(0.2, description="Tolerance of lens.focus_mm, in mm.")
    lens_half_width_mm: Positive = Field(0.05, description="Tolerance of lens.half_width_mm, in mm.")
    lens_knots_um: Positive = Field(
        2.0, description="Tolerance of each entry of lens.knots_um, in µm; default: the form error of a print."
    )
    lens_design_index: Positive = Field(0.002, description="Tolerance of lens.design_index.")
    body_stem_length_mm: Positive = Field(0.05, description="Tolerance of body.stem_length_mm, in mm.")
    body_stem_curve_per_mm: Positive = Field(1e-4, description="Tolerance of body.stem_curve_per_mm, in 1/mm.")
    body_arm_length_mm: Positive = Field(0.05, description="Tolerance of body.arm_length_mm, in mm.")
    body_arm_width_mm: Positive = Field(0.05, description="Tolerance of body.arm_width_mm, in mm.")
    body_arm_angle_deg: Positive = Field(0.2, description="Tolerance of body.arm_angle_deg, in degrees.")
    body_thickness_mm: Positive = Field(0.05, description="Tolerance of body.thickness_mm, in mm.")
    receivers_gap_mm: Positive = Field(0.05, description="Tolerance of receivers.gap_mm, in mm.")

    def of(self, key: str) -> float | None:
        """Return the tolerance of the number with a dotted key; None if it has neither a tolerance nor a default."""
        value: float | None = getattr(self, key.partition("[")[0].replace(".", "_"), None)
        return value
