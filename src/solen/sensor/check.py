"""Checks of a design before any ray is traced: material, lens and body, and whether it can be built.

Public names: `check`, `lens_check`, `foci_of` and `body_sizes`.
"""

from dataclasses import dataclass, replace
from typing import Annotated

from pydantic import Field

from solen.geometry import arm_angle_deg
from solen.lens import CurvedLens, Lens, MeasuredLens, OvalLens
from solen.material import Optical
from solen.results import Result
from solen.sensor.effects import index_offsets
from solen.sensor.numbers import tolerance_of
from solen.sensor.sensor import Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.spec.strict import Finite, Options


@dataclass(frozen=True)
class Focus:
    """Foci of a lens in a material of a given index, in mm behind the vertex; None for a focus that does not exist.

    Attributes
    ----------
    material_index, step
        Index of the material, and its difference from the design's index.
    by_uncertainty
        Whether the step is the standard uncertainty of the index.
    paraxial_focus_mm, marginal_focus_mm
        Foci of rays near the axis and at the edge; None unless the lens is an oval.
    best_focus_mm, u_best_focus_mm
        Position of the smallest spot of all rays, and its uncertainty due to a measured profile.
    spot_rms_mm, spot_x_mm
        RMS size of that spot, unless the lens is an oval, and its distance from the axis, for a measured lens.
    designed_best_focus_mm
        Best focus of the designed lens, for a measured lens.
    """

    material_index: float
    step: float = 0.0
    by_uncertainty: bool = False
    paraxial_focus_mm: float | None = None
    marginal_focus_mm: float | None = None
    best_focus_mm: float | None = None
    u_best_focus_mm: float | None = None
    spot_rms_mm: float | None = None
    spot_x_mm: float | None = None
    designed_best_focus_mm: float | None = None


@dataclass(frozen=True)
class BodySizes:
    """Sizes of a body at rest that follow from its dimensions; None for those that its kind of body does not have.

    Attributes
    ----------
    file
        File of the drawing, for an outline.
    faces, receivers
        Names of the faces and of the receivers.
    area_mm2
        Area of the section.
    emitter_x_mm, emitter_z_mm, emitter_axis_deg
        Position of the emitter, and its direction, counter-clockwise from +z.
    arm_angle_deg, arm_angle_assumed
        Angle of a Y's arms, and whether they are assumed to continue the stem's edge.
    fork_width_mm
        Width of the stem at the fork.
    stem_base_z_mm, crotch_z_mm
        Positions of the stem's base and of the crotch, where the arms separate.
    """

    file: str | None
    faces: tuple[str, ...]
    receivers: tuple[str, ...]
    area_mm2: float
    emitter_x_mm: float
    emitter_z_mm: float
    emitter_axis_deg: float
    arm_angle_deg: float | None = None
    arm_angle_assumed: bool | None = None
    fork_width_mm: float | None = None
    stem_base_z_mm: float | None = None
    crotch_z_mm: float | None = None


class LensCheck(Result):
    """The lens of a design.

    Attributes
    ----------
    name
        Name of the design.
    lens
        Its lens.
    foci
        Foci of the lens for several indices of the material.
    warnings
        Warnings about lens and material.
    """

    name: str
    lens: Lens
    foci: tuple[Focus, ...]
    warnings: tuple[str, ...] = ()


class LensOptions(Options):
    """Options for writing the profile of a lens."""

    tolerance_mm: Annotated[Finite, Field(ge=1e-9)] = 1e-4
    """Largest distance between the profile and the straight lines that connect the points of the table."""


class Check(Result):
    """A design that can be built at every angle of its motion, with derived values.

    Attributes
    ----------
    name
        Name of the design.
    angles
        Number of angles of the motion, or of loads of a soft body.
    loaded
        Whether it is a soft body under load.
    wavelength_nm
        Wavelength of the emitter.
    material
        Index and absorption at that wavelength.
    lens, foci
        The lens, None for a drawn body, and its foci.
    body
        Sizes of the body at rest.
    warnings
        Warnings about the design, including keys without effect.
    """

    name: str
    angles: int
    wavelength_nm: float
    material: Optical
    lens: Lens | None
    foci: tuple[Focus, ...]
    body: BodySizes
    warnings: tuple[str, ...]
    loaded: bool = False


def check(sensor: Sensor) -> Check:
    """Check that a sensor can be built at every angle of its motion; raise `DesignError` if it cannot."""
    sensor.check()
    return Check(
        name=sensor.design.name,
        angles=len(sensor.design.motion.values()),
        wavelength_nm=sensor.light.wavelength_nm,
        material=sensor.material,
        lens=sensor.cut,
        foci=foci_of(sensor),
        body=body_sizes(sensor),
        warnings=(*sensor.warnings, *keys_without_effect(sensor)),
        loaded=sensor.is_loaded,
    )


def lens_check(sensor: Sensor) -> LensCheck:
    """Return the lens of a sensor and its foci; raise `DesignError` if the body cannot be built or is drawn."""
    sensor.body()
    return LensCheck(sensor.design.name, sensor.lens, foci_of(sensor), tuple(sensor.warnings))


def foci_of(sensor: Sensor) -> tuple[Focus, ...]:
    """Return the foci in the material, for a designed lens also at neighbouring indices; none for a flat face."""
    lens, index = sensor.cut, sensor.material.index
    if isinstance(lens, MeasuredLens):
        designed_mm, u_mm = lens.designed.best_focus_mm(index), lens.u_best_focus_mm(index)
        focus, spot = _focus(lens, index), lens.best_spot(index)
        x_mm = None if spot is None else spot.x_mm
        return (replace(focus, spot_x_mm=x_mm, designed_best_focus_mm=designed_mm, u_best_focus_mm=u_mm),)
    if not isinstance(lens, CurvedLens):
        return ()
    steps = index_offsets(sensor.material, tolerance_of(sensor, "material.index")[0])
    return tuple(replace(_focus(lens, index + step), step=step, by_uncertainty=is_u) for step, is_u in steps)


def _focus(lens: CurvedLens, index: float) -> Focus:
    """Return the foci in a material of an index, with the spot size unless the lens is an oval."""
    if isinstance(lens, OvalLens):
        paraxial_mm, marginal_mm = lens.paraxial_focus_mm(index), lens.marginal_focus_mm(index)
        return Focus(index, 0.0, False, paraxial_mm, marginal_mm, lens.best_focus_mm(index))
    spot = lens.best_spot(index)
    if spot is None:
        return Focus(index)
    return Focus(index, best_focus_mm=spot.z_mm, spot_rms_mm=spot.rms_mm)


def body_sizes(sensor: Sensor) -> BodySizes:
    """Return the sizes of a sensor's body at rest."""
    body, design_body = sensor.body(), sensor.design.body
    faces = (*body.all_faces, *body.separate)
    sizes = BodySizes(
        file=design_body.file if sensor.is_drawn else None,
        faces=tuple(face.name for face in (faces if sensor.is_drawn else body.faces)),
        receivers=tuple(dict.fromkeys(face.label for face in faces if face.part == "receiver")),
        area_mm2=body.area_mm2(),
        emitter_x_mm=body.emitter.point[0],
        emitter_z_mm=body.emitter.point[1],
        emitter_axis_deg=body.emitter.axis_deg,
    )
    if sensor.is_drawn:
        return sizes
    return replace(
        sizes,
        arm_angle_deg=arm_angle_deg(sensor.design),
        arm_angle_assumed=design_body.arm_angle_deg is None,
        fork_width_mm=body.marks["fork-right"][0] - body.marks["fork-left"][0],
        stem_base_z_mm=body.marks["stem-base"][1],
        crotch_z_mm=body.marks["crotch"][1],
    )
