"""Refraction and reflection at one interface between two media: Snell's law, Fresnel equations, total reflection.

Directions are unit vectors; ``normal`` is the unit normal on the side of the incident ray (their scalar product is
negative). n1 is the index on the incident side, n2 that on the other side.
"""

import math
from typing import NamedTuple

from solen.plane import Point, dot, unit


class Fresnel(NamedTuple):
    """Reflected fractions of power for the two polarisations (s: field perpendicular to the plane of incidence)."""

    s: float
    p: float


def cos_refracted(cos_incident: float, n1: float, n2: float) -> float | None:
    """Return the cosine of the angle of refraction from Snell's law, or None under total reflection."""
    cos2 = (n2 - n1) * (n2 + n1) + (n1 * cos_incident) ** 2  # times n2²; also exact for matched indices
    return None if cos2 <= 0.0 else math.sqrt(cos2) / n2


def fresnel(cos_incident: float, n1: float, n2: float) -> Fresnel:
    """Return the Fresnel reflectances of a smooth interface between lossless media (Born & Wolf, section 1.5).

    They are 1 under total reflection.
    """
    cos_out = cos_refracted(cos_incident, n1, n2)
    if cos_out is None:
        return Fresnel(1.0, 1.0)
    s = (n1 * cos_incident - n2 * cos_out) / (n1 * cos_incident + n2 * cos_out)
    p = (n2 * cos_incident - n1 * cos_out) / (n2 * cos_incident + n1 * cos_out)
    return Fresnel(s * s, p * p)


def reflected(direction: Point, normal: Point) -> Point:
    """Return the direction after specular reflection, normalised so that many reflections do not change its length."""
    twice = 2.0 * dot(direction, normal)
    return unit((direction[0] - twice * normal[0], direction[1] - twice * normal[1]))


def refracted(direction: Point, normal: Point, n1: float, n2: float) -> Point | None:
    """Return the refracted direction from Snell's law in vector form, or None under total reflection."""
    cos_in = -dot(direction, normal)
    cos_out = cos_refracted(cos_in, n1, n2)
    if cos_out is None:
        return None
    ratio = n1 / n2
    bend = ratio * cos_in - cos_out
    x, z = ratio * direction[0] + bend * normal[0], ratio * direction[1] + bend * normal[1]
    length = math.hypot(x, z)
    return (x / length, z / length)
