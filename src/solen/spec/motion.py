"""The motion table: the moving parts, their pivot, and the angles of a sweep."""

from decimal import Decimal
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self, TypedDict

from pydantic import AfterValidator, Field, model_validator

from solen.errors import SpecError
from solen.spec.quantities import Place, Point
from solen.spec.strict import Number, Positive, Strict, Text, refused, reported_as

MAX_STEPS = 100_000
_SAME_ANGLE = Decimal("1e-9")  # fraction of a step; angles that differ by less are treated as equal


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(low < high for low, high in pairwise(values)):
        raise refused("", "must be in ascending order", value=list(values))
    return values


Sweep = Annotated[Number, Field(gt=-90, lt=90)]
Pivot = Literal["stem-base", "emitter"] | Point
Values = Annotated[
    tuple[Number, ...],
    Field(min_length=1, max_length=10_000),
    AfterValidator(_ascending),
    reported_as("must be a list of numbers in ascending order"),
]
Part = Literal["lens", "emitter", "receivers", "mirrors"]
Join = Literal["bridge", "seam", "smooth"]
PARTS: tuple[Part, ...] = ("lens", "emitter", "receivers", "mirrors")
PARTS_LIMIT = 'must be a list of "lens", "emitter", "receivers" and "mirrors", at least one, each at most once'


def _in_order(moves: tuple[Part, ...]) -> tuple[Part, ...]:
    if len(set(moves)) != len(moves) or not moves:
        raise refused("", PARTS_LIMIT, value=list(moves))
    return tuple(part for part in PARTS if part in moves)


class DrivenValue(TypedDict):
    """A value of the quantity that a motion drives: an angle, or the depth or force of a load on a soft body."""

    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None


class Motion(Strict):
    """The motion of the sensor and the angles of a sweep, counter-clockwise with z up and x to the right."""

    table: ClassVar[str] = "motion"

    kind: Literal["rotation", "bend", "loaded"] = Field(
        "rotation",
        description="A rotation of parts about a pivot, a bend of the stem, or loads on a soft body; [[hold]], "
        "[[press]] and [[pull]] specify its supports and loads.",
    )
    pivot: Annotated[Pivot, reported_as('must be "stem-base", "emitter" or [x_mm, z_mm] with two finite numbers')] = (
        Field("stem-base", description="Centre of the rotation: stem-base, emitter, or a point [x_mm, z_mm].")
    )
    moves: Annotated[tuple[Part, ...], AfterValidator(_in_order), reported_as(PARTS_LIMIT)] = Field(
        ("lens", "emitter"),
        description="Parts that rotate: lens, emitter, receivers (behind an air gap), mirrors (of an outline).",
        json_schema_extra={"uniqueItems": True, "minItems": 1},
    )
    centre_line: (
        Annotated[
            tuple[Point, ...],
            Field(min_length=3, max_length=1000),
            reported_as("must be a list of 3 to 1000 points [x_mm, z_mm]"),
        ]
        | None
    ) = Field(
        None,
        description="Points of the centre line of a bent stem, from base to fork; they define how the bend is "
        "distributed along the stem. Default: evenly.",
    )
    bend_mm: Annotated[tuple[Place, Place], reported_as("must be two values [z_from_mm, z_to_mm]")] | None = Field(
        None, description="Values of z between which an outline bends; the part below moves along as a rigid body."
    )
    join: Join = Field(
        "bridge",
        description="How a rotated lens is joined to the stem: by a bridge or step, by a straight seam, or by sides "
        "that bend smoothly.",
    )
    drives: Text | None = Field(
        None,
        description="For a loaded body: the name and key of the quantity that is driven, such as "
        '"clamp.angle_deg" or "finger.depth_mm".',
    )
    depths_mm: Values | None = Field(
        None, description="Depths in mm of a driven finger, in ascending order, at least 0."
    )
    forces_N: Values | None = Field(None, description="Forces in N of a driven finger or pull, in ascending order.")
    emitter_on: Text = Field(
        "lens", description="For a loaded body: the faces with which the emitter moves, or ground if it is stationary."
    )
    from_deg: Sweep = Field(-3.0, description="First angle in degrees.")
    to_deg: Sweep = Field(3.0, description="Last angle in degrees, greater than from_deg.")
    step_deg: Positive = Field(0.25, description=f"Step in degrees; at most {MAX_STEPS:,} steps.")

    @model_validator(mode="after")
    def _check_sweep(self) -> Self:
        if not self.from_deg < self.to_deg:
            limit = f"must be less than motion.to_deg = {self.to_deg}"
            remedy = "swap them" if self.from_deg > self.to_deg else "raise motion.to_deg"
            raise refused("from_deg", limit, value=self.from_deg, remedy=remedy)
        if (self.to_deg - self.from_deg) / MAX_STEPS > self.step_deg * (1 + 1e-12):
            limit = f"makes more than {MAX_STEPS:,} steps from {self.from_deg} to {self.to_deg}"
            raise refused("step_deg", limit, value=self.step_deg, remedy="use a larger step")
        return self

    @property
    def key(self) -> Literal["angle_deg", "depth_mm", "force_N"]:
        """The key of the quantity that the motion drives."""
        key = (self.drives or "angle_deg").rpartition(".")[2]
        return "depth_mm" if key == "depth_mm" else "force_N" if key == "force_N" else "angle_deg"

    def keyed(self, value: float) -> DrivenValue:
        """Return a dictionary with the value under the key of the driven quantity and None under the other keys."""
        key = self.key
        return DrivenValue(
            angle_deg=value if key == "angle_deg" else None,
            depth_mm=value if key == "depth_mm" else None,
            force_N=value if key == "force_N" else None,
        )

    @property
    def unit(self) -> str:
        """The unit of the driven quantity: deg, mm or N."""
        return self.key.rpartition("_")[2]

    def values(self) -> tuple[float, ...]:
        """Return the values of the driven quantity in ascending order: angles, depths or forces."""
        return self.angles_deg() if self.key == "angle_deg" else self.depths_mm or self.forces_N or ()

    def angles_deg(self) -> tuple[float, ...]:
        """Return the angles from `from_deg` in steps of `step_deg`, including `to_deg` if a step reaches it.

        The angles are computed in decimal arithmetic, as written in the file: from -0.3 in steps of 0.1, one of them is
        exactly 0.

        Returns
        -------
        tuple of float
            In ascending order, in degrees; no angle exceeds `to_deg`.

        Raises
        ------
        SpecError
            If the motion drives a depth or a force.
        """
        if self.key != "angle_deg":
            limit = "is not an angle, which this command requires"
            raise SpecError("motion.drives", value=self.drives, limit=limit, remedy="use solen run, deform or trace")
        first, last, step = (Decimal(repr(value)) for value in (self.from_deg, self.to_deg, self.step_deg))
        steps = int((last - first) / step + _SAME_ANGLE)
        return tuple(_snapped(first + i * step, last, step * _SAME_ANGLE) for i in range(steps + 1))


def _snapped(angle: Decimal, last: Decimal, tolerance: Decimal) -> float:
    """Return an angle as a float, set to 0 or the last angle if only the rounding of a step such as 1/3 missed it."""
    return float(next((exact for exact in (Decimal(0), last) if abs(angle - exact) <= tolerance), angle))
