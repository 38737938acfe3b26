"""Rays from an emitter in space along a one-parameter path, and their weights."""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.rows import Floats
from solen.trace.kernel.space import Vector
from solen.trace.kernel.step import Rules


class FamilyInSpace(NamedTuple):
    """Rays from an emitter along a path from parameter ``low`` to ``high``: over its angle, its position, or both.

    At parameter u a ray starts at (x + u along_x, z + u along_z), at heights from ``y_low`` to ``y_high``. Its
    projected angle from the axis is ``angle`` + u ``turn``, in radians, and the y-component of its direction is
    ``rise``. Its weight, at an angle θ from the axis in space, is cos(θ)^``power``, or is interpolated from the
    ``relative`` intensities at ``theta`` if these have entries.
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
    escape_mm: float
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
    """Return the weight of the ray at a parameter, per projected angle and per sine of the out-of-plane angle."""
    cos = math.sqrt(1.0 - family.rise * family.rise) * math.cos(family.angle + u * family.turn)
    if len(family.theta) == 0:
        return 1.0 if family.power == 0.0 else max(cos, 0.0) ** family.power
    theta = math.acos(min(max(cos, -1.0), 1.0))
    if theta > family.theta[-1]:
        return 0.0
    i = 1
    while family.theta[i] < theta and i < len(family.theta) - 1:
        i += 1
    fraction = (theta - family.theta[i - 1]) / (family.theta[i] - family.theta[i - 1])
    value: float = family.relative[i - 1] + fraction * (family.relative[i] - family.relative[i - 1])
    return value


class Heading(NamedTuple):
    """Direction of a ray, and its weight."""

    d: Vector
    weight: float


@compiled
def heading(family: FamilyInSpace, u: float) -> Heading:
    """Return the direction and weight of the ray at a parameter."""
    angle = family.axis + family.angle + u * family.turn
    flat = math.sqrt(1.0 - family.rise * family.rise)
    d = Vector(-flat * math.sin(angle), family.rise, flat * math.cos(angle))
    return Heading(d, intensity_in_space(family, u))


@compiled
def at_angles(family: FamilyInSpace, angle: float, turn: float, rise: float, low: float, high: float) -> FamilyInSpace:
    """Return the family along a path at other angles."""
    f = family
    return FamilyInSpace(
        f.x, f.z, f.along_x, f.along_z, f.axis, angle, turn, rise, f.y_low, f.y_high, f.s, f.p, f.colour, f.rules,
        f.escape_mm, f.half, f.above, f.below, low, high, f.power, f.theta, f.relative,
    )  # fmt: skip
