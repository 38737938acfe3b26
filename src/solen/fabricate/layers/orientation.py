"""Orientation of a part on the plate: rotations of its axes X, Y and Z; Z points away from the plate."""

import math

import numpy as np

from solen.arrays import FloatArray
from solen.fabricate.layers.options import Degrees, Orientation

ORIENTATIONS: dict[Orientation, FloatArray] = {
    "flat": np.eye(3),
    "upright": np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)]),
    "on-edge": np.array([(0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)]),
}
"""``flat``: Z of the part points away from the plate; ``upright``: −Y of the part, so that a sensor is printed on the
ends of its arms with the lens last; ``on-edge``: X of the part.
"""
DESCRIPTIONS: dict[Orientation, str] = {
    "flat": "flat: Z of the part points away from the plate, and the layers divide its thickness",
    "upright": "upright: −Y of the part points away from the plate; a sensor is printed on the ends of its arms, with "
    "the lens last",
    "on-edge": "on edge: X of the part points away from the plate; a sensor lies on its left side",
}


def orientation(name: Orientation, rotate_deg: Degrees = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return the matrix (3, 3) of a named orientation followed by rotations about X, Y and Z of the plate."""
    return rotation(rotate_deg) @ ORIENTATIONS[name]


def described(name: Orientation, rotate_deg: Degrees) -> str:
    """Return the description of an orientation for the settings sheet."""
    rotations = ", then rotated about X, Y, Z by " + ", ".join(f"{angle:g}" for angle in rotate_deg) + "°"
    return DESCRIPTIONS[name] + (rotations if any(rotate_deg) else "")


def rotation(rotate_deg: Degrees) -> FloatArray:
    """Return the matrix (3, 3) of rotations about X, then Y, then Z, counter-clockwise seen against the axis."""
    matrix = np.eye(3)
    for axis, angle in enumerate(rotate_deg):
        cos, sin = _cos_sin(angle)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        step = np.eye(3)
        step[[first, first, second, second], [first, second, first, second]] = cos, -sin, sin, cos
        matrix = step @ matrix
    return matrix


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    """Return the cosine and sine of an angle in degrees, exact at multiples of a right angle."""
    quarter, rest = divmod(angle_deg, 90.0)
    if rest == 0.0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
