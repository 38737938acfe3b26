"""Rays of an emitter in space along a path of one parameter, and how much each counts."""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.rows import Floats
from solen.trace.kernel.space import Vector
from solen.trace.kernel.step import Rules


class FamilyInSpace(NamedTuple):
    """Rays of an emitter along a path of one parameter, from ``low`` to ``high``: its angle, its place, or both.

    At parameter u a ray starts at (x + u along_x, z + u along_z), at heights from ``y_low`` to ``y_high``. It leaves
    at ``angle`` + u ``turn`` from the axis in projection, in radians, with the y-component ``rise`` of its direction.
    One at θ from the axis in space counts cos(θ)^``power`` times, or by the table of ``relative`` intensities over
    ``theta`` where that has entries.
    """

    x: float
    z: float
    along_x: float
    along_z: float
    axis: float
    angle: float
    turn: float
    rise: float
    y_low: float
    y_high: float
    s: float
    p: float
    colour: int
    rules: Rules
    far: float
    half: float
    """half the thickness, mm"""
    above: float
    below: float
    low: float
    high: float
    power: float
    theta: Floats
    relative: Floats


@compiled
def intensity_in_space(family: FamilyInSpace, u: float) -> float:
    """How much the ray at a parameter counts, per angle in projection and per sine out of the plane."""
    cos = math.sqrt(1.0 - family.rise * family.rise) * math.cos(family.angle + u * family.turn)
    if len(family.theta) == 0:
        return 1.0 if family.power == 0.0 else max(cos, 0.0) ** family.power
    theta = math.acos(min(max(cos, -1.0), 1.0))
    if theta > family.theta[-1]:
        return 0.0
    i = 1
    while family.theta[i] < theta and i < len(family.theta) - 1:
        i += 1
    share = (theta - family.theta[i - 1]) / (family.theta[i] - family.theta[i - 1])
    value: float = family.relative[i - 1] + share * (family.relative[i] - family.relative[i - 1])
    return value


class Heading(NamedTuple):
    """Direction of a ray, and how much it counts."""

    d: Vector
    weight: float


@compiled
def heading(family: FamilyInSpace, u: float) -> Heading:
    """Direction and weight of the ray at a parameter."""
    angle = family.axis + family.angle + u * family.turn
    flat = math.sqrt(1.0 - family.rise * family.rise)
    d = Vector(-flat * math.sin(angle), family.rise, flat * math.cos(angle))
    return Heading(d, intensity_in_space(family, u))


@compiled
def at_angles(family: FamilyInSpace, angle: float, turn: float, rise: float, low: float, high: float) -> FamilyInSpace:
    """The family along another path."""
    f = family
    return FamilyInSpace(
        f.x, f.z, f.along_x, f.along_z, f.axis, angle, turn, rise, f.y_low, f.y_high, f.s, f.p, f.colour, f.rules,
        f.far, f.half, f.above, f.below, low, high, f.power, f.theta, f.relative,
    )  # fmt: skip
