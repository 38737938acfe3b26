"""Supports and loads of a soft body, ``[[hold]]``, ``[[press]]`` and ``[[pull]]``, and its elasticity, ``[mechanics]``.

There is no default support, because the supports of a body determine its response. Supports, fingers and pulls have
names; hold tables with the same name form one support. A motion of kind ``loaded`` drives one of their quantities:
``drives = "clamp.angle_deg"``.
"""

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from solen.spec.quantities import Length, Point
from solen.spec.stretch import Stretch
from solen.spec.strict import NotNegative, Number, Positive, Strict, Text, refused, reported_as

if TYPE_CHECKING:
    from solen.spec.design import Design

HOLD_CHOICES = (
    'add [[hold]] with face = "receiver-*" (the ends of the arms), "outer-*" (the arms), "stem-*" or "lens", and '
    'with kind = "fixed", "sliding" or "turning"'
)
DRIVEN = {"hold": ("angle_deg",), "press": ("depth_mm", "force_N"), "pull": ("force_N",)}
"""Quantities that a loaded motion can drive, by table."""
LISTS = {"angle_deg": None, "depth_mm": "depths_mm", "force_N": "forces_N"}
"""Motion keys with the values of a driven quantity; an angle has from_deg, to_deg and step_deg instead."""


class Mechanics(Strict):
    """Elastic properties of the body under load; used with ``motion.kind = "loaded"``."""

    table: ClassVar[str] = "mechanics"

    modulus_MPa: Positive | None = Field(
        None, description="Young's modulus in MPa; default: the resin's, with its hyperelastic model."
    )
    poisson: Annotated[Number, Field(ge=0.4, le=0.5)] = Field(
        0.5, description="Poisson's ratio at small strain, 0.4 to 0.5."
    )
    plane: Literal["strain", "stress"] = Field(
        "strain",
        description="Plane strain, as inside a thick body, or plane stress, as in a thin body; "
        "a real part is between the two.",
    )
    mesh_mm: Annotated[Number, Field(ge=0.02, le=100)] | None = Field(
        None, description="Element size in mm; default: chosen from the size of the body."
    )


class Hold(Stretch):
    """A support of part of the outline."""

    table: ClassVar[str] = "hold"

    name: Text = Field("hold", description="Name of the support; tables with the same name form one support.")
    kind: Literal["fixed", "sliding", "turning"] = Field(
        "fixed", description="Fixed; sliding along the wall; or turning about a point as a rigid body."
    )
    about: (
        Annotated[
            Literal["stem-base", "emitter"] | Point,
            reported_as('must be "stem-base", "emitter" or [x_mm, z_mm] with two finite numbers'),
        ]
        | None
    ) = Field(None, description='For turning: the pivot, "stem-base", "emitter" or [x_mm, z_mm].')
    angle_deg: Annotated[Number, Field(gt=-90, lt=90)] | None = Field(
        None, description="For turning: angle in degrees; default: driven by the motion, or free to turn."
    )
    solid: bool = Field(False, description="Whether a clamp also constrains the material between its faces.")

    @model_validator(mode="after")
    def _check_pivot(self) -> Self:
        if self.kind == "turning" and self.about is None:
            raise refused(
                "about", 'is missing: required with kind = "turning"', remedy='add, for example, about = "stem-base"'
            )
        for key in ("about", "angle_deg"):
            if self.kind != "turning" and getattr(self, key) is not None:
                limit = f'does not apply with kind = "{self.kind}"'
                raise refused(key, limit, value=getattr(self, key), remedy=f'omit {key}, or set kind = "turning"')
        return self


class Press(Strict):
    """A round, rigid, frictionless finger that presses into a wall."""

    table: ClassVar[str] = "press"

    name: Text = Field("press", description="Name of the finger.")
    face: Text = Field(description='the wall that the finger touches first, such as "stem-right".')
    at_mm: NotNegative = Field(description="position of the finger along the wall in mm.")
    radius_mm: Length = Field(description="radius of the finger in mm.")
    depth_mm: NotNegative | None = Field(
        None, description="Distance in mm by which the finger moves after first contact."
    )
    force_N: NotNegative | None = Field(None, description="Force in N over the whole thickness, instead of depth_mm.")
    direction_deg: Annotated[Number, Field(ge=-360, le=360)] | None = Field(
        None,
        description="Direction in which the finger moves, in degrees counter-clockwise from +z; default: normal to the "
        "wall.",
    )
    backing: Text | None = Field(
        None, description="Face that slides on a flat support opposite the finger; default: no support."
    )
    index: Annotated[Number, Field(ge=1, lt=5)] | None = Field(
        None,
        description="Refractive index of the finger's surface in optical contact with the body; "
        "default: dry contact, with air in between.",
    )
    absorption_per_mm: NotNegative = Field(0.0, description="Absorption coefficient for power per mm in the finger.")

    @model_validator(mode="after")
    def _check_keys(self) -> Self:
        if self.depth_mm is not None and self.force_N is not None:
            raise refused("force_N", "does not apply with depth_mm", value=self.force_N, remedy="omit one of them")
        if self.absorption_per_mm and self.index is None:
            limit = "does not apply without an index: a finger in dry contact absorbs no light"
            raise refused(
                "absorption_per_mm", limit, value=self.absorption_per_mm, remedy="add, for example, index = 1.4"
            )
        return self


class Pull(Stretch):
    """A force distributed uniformly over part of the outline; its direction stays constant as the body moves."""

    table: ClassVar[str] = "pull"

    name: Text = Field("pull", description="Name of the pull.")
    force_N: Number | None = Field(
        None, description="Force in N over the whole thickness; default: driven by the motion."
    )
    direction_deg: Annotated[Number, Field(ge=-360, le=360)] = Field(
        description="direction in degrees, counter-clockwise from +z; 90 pulls to the left."
    )


def check_loads(design: "Design") -> None:
    """Reject a loaded motion without a support or a driven quantity, and loads with any other kind of motion."""
    tables = {name: getattr(design, name) for name in DRIVEN}
    if design.motion.kind != "loaded":
        given = [name for name, rows in tables.items() if rows]
        if design.mechanics != Mechanics():
            given.append("mechanics")
        if given:
            limit = f'does not apply with motion.kind = "{design.motion.kind}"'
            raise refused(given[0], limit, remedy=f'omit {given[0]}, or set motion.kind = "loaded"')
        return
    if not design.hold:
        limit = "is missing: there is no default, because the supports of the body determine its response"
        raise refused("hold", limit, remedy=HOLD_CHOICES)
    _check_names(design)
    _check_driven(design)


def driven(design: "Design") -> tuple[str, str, str]:
    """Return the table, name and key of the quantity that a loaded motion drives."""
    name, _, key = (design.motion.drives or "").rpartition(".")
    table = next(table for table in DRIVEN if any(row.name == name for row in getattr(design, table)))
    return table, name, key


def _check_names(design: "Design") -> None:
    """Check that hold tables with the same name describe one support, and that fingers and pulls have unique names."""
    first_rows: dict[str, tuple[str, Strict]] = {}
    media = {wall.outside for wall in design.wall}
    for table in DRIVEN:
        for number, row in enumerate(getattr(design, table)):
            if "." in row.name:
                raise refused(f"{table}[{number}].name", "cannot contain a dot", value=row.name)
            if table == "press" and row.name in ("air", "body", *(media if row.index is not None else ())):
                limit = "is the name of another medium"
                raise refused(f"{table}[{number}].name", limit, value=row.name, remedy="use another name")
            other, first = first_rows.setdefault(row.name, (table, row))
            if first is row:
                continue
            if table != "hold" or other != "hold":
                limit = f"is already the name of a {other}"
                raise refused(f"{table}[{number}].name", limit, value=row.name, remedy="use another name")
            for key in ("kind", "about", "angle_deg"):
                if getattr(row, key) != getattr(first, key):
                    limit = f"must be the same in all hold tables named {row.name}, which form one support"
                    raise refused(f"{table}[{number}].{key}", limit, value=getattr(row, key))


def _check_driven(design: "Design") -> None:
    """Check that the driven quantity exists, is not also given in its own table, and has values."""
    drives = design.motion.drives
    choices = [
        f"{row.name}.{key}"
        for table, keys in DRIVEN.items()
        for row in getattr(design, table)
        for key in keys
        if table != "hold" or row.kind == "turning"
    ]
    if drives not in choices:
        limit = "is missing" if drives is None else "is not a quantity of this design that can be driven"
        remedy = 'add a [[press]], a [[pull]] or a [[hold]] with kind = "turning"'
        if choices:
            remedy = f"set one of {', '.join(dict.fromkeys(choices))}"
        raise refused("motion.drives", limit, value=drives, remedy=remedy)
    _check_quantities(design)
    _check_values(design)


def _check_quantities(design: "Design") -> None:
    """Check that the driven quantity is not given in its own table, and that the quantities of all other loads are."""
    driven_table, name, _ = driven(design)
    for table in ("hold", "press", "pull"):
        for number, row in enumerate(getattr(design, table)):
            given = next((key for key in DRIVEN[table] if getattr(row, key) is not None), None)
            is_driven = (table, row.name) == (driven_table, name)
            if is_driven and given:
                limit = f"does not apply with motion.drives = {design.motion.drives!r}"
                raise refused(f"{table}[{number}].{given}", limit, value=getattr(row, given), remedy=f"omit {given}")
            if not (is_driven or given or table == "hold"):
                key = DRIVEN[table][0]
                limit = "is missing: required unless motion.drives drives it"
                raise refused(f"{table}[{number}].{key}", limit, remedy=f"add {key} = 0.1")


def _check_values(design: "Design") -> None:
    """Check that the motion lists values of the driven quantity and of no other quantity."""
    motion, (_, _, key) = design.motion, driven(design)
    condition = f"drives = {motion.drives!r}"
    sweep = {name: name in motion.model_fields_set for name in ("from_deg", "to_deg", "step_deg")}
    lists = {name: getattr(motion, name) is not None for name in LISTS.values() if name}
    required = LISTS[key]
    for name, given in (lists | (sweep if required else {})).items():
        if given and name != required:
            limit = f"does not apply with {condition}"
            raise refused(f"motion.{name}", limit, value=getattr(motion, name), remedy=f"omit motion.{name}")
    if required and not lists[required]:
        limit = f"is missing: required with {condition}"
        raise refused(f"motion.{required}", limit, remedy=f"add {required} = [0, 0.1, 0.2]")
    if key == "depth_mm" and motion.depths_mm and motion.depths_mm[0] < 0.0:
        raise refused("motion.depths_mm", "must be at least 0", value=list(motion.depths_mm))
    if driven(design)[0] == "press" and motion.forces_N and motion.forces_N[0] < 0.0:
        raise refused("motion.forces_N", "must be at least 0 for a finger", value=list(motion.forces_N))
