"""The table of the motion: which parts turn about which pivot, and the angles of a sweep."""

from decimal import Decimal
from itertools import pairwise
from typing import Annotated, ClassVar, Literal, Self, TypedDict

from pydantic import AfterValidator, Field, model_validator

from solen.errors import SpecError
from solen.spec.quantities import Place, Point
from solen.spec.strict import Number, Positive, Strict, Text, or_refuse, refused

MAX_STEPS = 100_000
_SAME_ANGLE = Decimal("1e-9")  # of a step: nearer than this, two angles are one


def _ascending(values: tuple[float, ...]) -> tuple[float, ...]:
    if not all(low < high for low, high in pairwise(values)):
        raise refused("", "must ascend", value=list(values))
    return values


Sweep = Annotated[Number, Field(gt=-90, lt=90)]
Pivot = Literal["stem-base", "emitter"] | Point
Values = Annotated[
    tuple[Number, ...],
    Field(min_length=1, max_length=10_000),
    AfterValidator(_ascending),
    or_refuse("must be a list of numbers, each above the one before"),
]
Part = Literal["lens", "emitter", "receivers", "mirrors"]
Join = Literal["bridge", "seam", "smooth"]
PARTS: tuple[Part, ...] = ("lens", "emitter", "receivers", "mirrors")
PARTS_LIMIT = 'must be a list of "lens", "emitter", "receivers", "mirrors", at least one and none twice'


def _parts(moves: tuple[Part, ...]) -> tuple[Part, ...]:
    if len(set(moves)) != len(moves) or not moves:
        raise refused("", PARTS_LIMIT, value=list(moves))
    return tuple(part for part in PARTS if part in moves)


class Driven(TypedDict):
    """A value of what a motion drives: an angle, or a depth or a force on a soft body."""

    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None


class Motion(Strict):
    """How the sensor is moved, and the angles of a sweep; counter-clockwise with z up and x to the right."""

    table: ClassVar[str] = "motion"

    kind: Literal["rotation", "bend", "loaded"] = Field(
        "rotation",
        description="A rotation of parts about a pivot, a bend of the stem, or a soft body under load, which holds it "
        "and loads it as [[hold]], [[press]] and [[pull]] say.",
    )
    pivot: Annotated[Pivot, or_refuse('must be "stem-base", "emitter" or [x_mm, z_mm] with two finite numbers')] = (
        Field("stem-base", description="Centre of the rotation: stem-base, emitter, or a point [x_mm, z_mm].")
    )
    moves: Annotated[tuple[Part, ...], AfterValidator(_parts), or_refuse(PARTS_LIMIT)] = Field(
        ("lens", "emitter"),
        description="Parts that turn: lens, emitter, receivers (behind an air gap), mirrors (of an outline).",
        json_schema_extra={"uniqueItems": True, "minItems": 1},
    )
    centre_line: (
        Annotated[
            tuple[Point, ...],
            Field(min_length=3, max_length=1000),
            or_refuse("must be a list of 3 to 1000 points [x_mm, z_mm]"),
        ]
        | None
    ) = Field(
        None,
        description="Points of a bent stem's centre line, from base to fork: how the bend is shared out along it; "
        "default: evenly.",
    )
    bend_mm: Annotated[tuple[Place, Place], or_refuse("must be two heights [z_from_mm, z_to_mm]")] | None = Field(
        None, description="Heights z between which an outline bends; the part below is carried along."
    )
    join: Join = Field(
        "bridge",
        description="How a turned lens joins the stem: by a bridge or step, by a straight seam, or by sides that bend "
        "smoothly.",
    )
    drives: Text | None = Field(
        None, description='Of a loaded body: what is driven, by its name and key: "clamp.angle_deg", "finger.depth_mm".'
    )
    depths_mm: Values | None = Field(
        None, description="Depths in mm, ascending from 0 or more, of a finger that is driven."
    )
    forces_N: Values | None = Field(None, description="Forces in N, ascending, of a finger or a pull that is driven.")
    emitter_on: Text = Field(
        "lens", description="Of a loaded body: the faces that carry the emitter, or ground where it stands still."
    )
    from_deg: Sweep = Field(-3.0, description="First angle in degrees.")
    to_deg: Sweep = Field(3.0, description="Last angle in degrees, greater than from_deg.")
    step_deg: Positive = Field(0.25, description=f"Step in degrees; at most {MAX_STEPS:,} steps.")

    @model_validator(mode="after")
    def _sweep_ascends_in_few_steps(self) -> Self:
        if not self.from_deg < self.to_deg:
            limit = f"must be less than motion.to_deg = {self.to_deg}"
            remedy = "swap the two" if self.from_deg > self.to_deg else "raise motion.to_deg"
            raise refused("from_deg", limit, value=self.from_deg, remedy=remedy)
        if (self.to_deg - self.from_deg) / MAX_STEPS > self.step_deg * (1 + 1e-12):
            limit = f"at most {MAX_STEPS:,} steps from {self.from_deg} to {self.to_deg}"
            raise refused("step_deg", limit, value=self.step_deg, remedy="take a larger step")
        return self

    @property
    def key(self) -> Literal["angle_deg", "depth_mm", "force_N"]:
        """Number that the motion drives, by its key."""
        key = (self.drives or "angle_deg").rpartition(".")[2]
        return "depth_mm" if key == "depth_mm" else "force_N" if key == "force_N" else "angle_deg"

    def named(self, value: float) -> "Driven":
        """A value of what the motion drives by its key, None for the others."""
        key = self.key
        return Driven(
            angle_deg=value if key == "angle_deg" else None,
            depth_mm=value if key == "depth_mm" else None,
            force_N=value if key == "force_N" else None,
        )

    @property
    def unit(self) -> str:
        """Unit of what the motion drives: deg, mm or N."""
        return self.key.rpartition("_")[2]

    def values(self) -> tuple[float, ...]:
        """Values of what the motion drives, ascending: angles, or the depths or forces of a loaded body."""
        return self.angles_deg() if self.key == "angle_deg" else self.depths_mm or self.forces_N or ()

    def angles_deg(self) -> tuple[float, ...]:
        """Angles from `from_deg` to `to_deg` by `step_deg`, both ends included where the step meets them.

        They are summed in decimal, as the file states them: -0.3 by 0.1 passes through exactly 0.0.

        Returns
        -------
        tuple of float
            Ascending, in degrees; none exceeds `to_deg`.

        Raises
        ------
        SpecError
            Where the motion drives a depth or a force.
        """
        if self.key != "angle_deg":
            limit = "is not an angle, which this command needs"
            raise SpecError("motion.drives", value=self.drives, limit=limit, remedy="use solen run, deform or trace")
        first, last, step = (Decimal(repr(value)) for value in (self.from_deg, self.to_deg, self.step_deg))
        steps = int((last - first) / step + _SAME_ANGLE)
        return tuple(_snapped(first + i * step, last, step * _SAME_ANGLE) for i in range(steps + 1))


def _snapped(angle: Decimal, last: Decimal, near: Decimal) -> float:
    """Angle as a float; a step such as 1/3 misses 0 and the end by rounding, which is corrected here."""
    goal = next((goal for goal in (Decimal(0), last) if abs(angle - goal) <= near), angle)
    return float(goal)
