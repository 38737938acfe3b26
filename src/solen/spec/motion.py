"""The motion table: which parts rotate about which pivot, and the angles of a sweep."""

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
    or_refuse("must be a list of numbers in ascending order"),
]
Part = Literal["lens", "emitter", "receivers", "mirrors"]
Join = Literal["bridge", "seam", "smooth"]
PARTS: tuple[Part, ...] = ("lens", "emitter", "receivers", "mirrors")
PARTS_LIMIT = 'must be a list of "lens", "emitter", "receivers" and "mirrors", at least one, each at most once'


def _parts(moves: tuple[Part, ...]) -> tuple[Part, ...]:
    if len(set(moves)) != len(moves) or not moves:
        raise refused("", PARTS_LIMIT, value=list(moves))
    return tuple(part for part in PARTS if part in moves)


class Driven(TypedDict):
    """A value that a motion drives: an angle, or the depth or force of a load on a soft body."""

    angle_deg: float | None
    depth_mm: float | None
    force_N: float | None


class Motion(Strict):
    """The motion of the sensor and the angles of a sweep; counter-clockwise, with z up and x to the right."""

    table: ClassVar[str] = "motion"

    kind: Literal["rotation", "bend", "loaded"] = Field(
        "rotation",
        description="A rotation of parts about a pivot, a bend of the stem, or loads on a soft body, whose "
        "supports and loads are stated by [[hold]], [[press]] and [[pull]].",
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
        description="Points of a bent stem's centre line, from base to fork, which define how the bend is "
        "distributed along it; default: evenly.",
    )
    bend_mm: Annotated[tuple[Place, Place], or_refuse("must be two heights [z_from_mm, z_to_mm]")] | None = Field(
        None, description="Heights z between which an outline bends; the part below moves along rigidly."
    )
    join: Join = Field(
        "bridge",
        description="How a turned lens joins the stem: by a bridge or step, by a straight seam, or by sides that bend "
        "smoothly.",
    )
    drives: Text | None = Field(
        None,
        description="For a loaded body: the support or load that is driven, and its key: "
        '"clamp.angle_deg", "finger.depth_mm".',
    )
    depths_mm: Values | None = Field(None, description="Depths in mm of a driven finger, ascending from 0 or more.")
    forces_N: Values | None = Field(None, description="Forces in N of a driven finger or pull, ascending.")
    emitter_on: Text = Field(
        "lens", description="For a loaded body: the faces that the emitter moves with, or ground if it does not move."
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
            raise refused("step_deg", limit, value=self.step_deg, remedy="use a larger step")
        return self

    @property
    def key(self) -> Literal["angle_deg", "depth_mm", "force_N"]:
        """The key of the quantity that the motion drives."""
        key = (self.drives or "angle_deg").rpartition(".")[2]
        return "depth_mm" if key == "depth_mm" else "force_N" if key == "force_N" else "angle_deg"

    def named(self, value: float) -> "Driven":
        """Return a dictionary with the value under the key of the driven quantity and None under the others."""
        key = self.key
        return Driven(
            angle_deg=value if key == "angle_deg" else None,
            depth_mm=value if key == "depth_mm" else None,
            force_N=value if key == "force_N" else None,
        )

    @property
    def unit(self) -> str:
        """The unit of the driven quantity: deg, mm or N."""
        return self.key.rpartition("_")[2]

    def values(self) -> tuple[float, ...]:
        """Return the values of the driven quantity, ascending: angles, or depths or forces on a loaded body."""
        return self.angles_deg() if self.key == "angle_deg" else self.depths_mm or self.forces_N or ()

    def angles_deg(self) -> tuple[float, ...]:
        """Return the angles from `from_deg` in steps of `step_deg`, to `to_deg` included if a step reaches it.

        The steps are added in decimal arithmetic, as written in the file: -0.3 in steps of 0.1 passes through exactly
        0.0.

        Returns
        -------
        tuple of float
            Ascending, in degrees; no angle exceeds `to_deg`.

        Raises
        ------
        SpecError
            If the motion drives a depth or a force.
        """
        if self.key != "angle_deg":
            limit = "is not an angle, which this command needs"
            raise SpecError("motion.drives", value=self.drives, limit=limit, remedy="use solen run, deform or trace")
        first, last, step = (Decimal(repr(value)) for value in (self.from_deg, self.to_deg, self.step_deg))
        steps = int((last - first) / step + _SAME_ANGLE)
        return tuple(_snapped(first + i * step, last, step * _SAME_ANGLE) for i in range(steps + 1))


def _snapped(angle: Decimal, last: Decimal, near: Decimal) -> float:
    """Return an angle as a float, corrected if rounding of a step such as 1/3 made it miss 0 or the last angle."""
    goal = next((goal for goal in (Decimal(0), last) if abs(angle - goal) <= near), angle)
    return float(goal)
