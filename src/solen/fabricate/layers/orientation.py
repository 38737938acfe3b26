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
"""``flat`` keeps the orientation of the part. ``upright`` turns −Y away from the plate: a sensor stands on the ends
of its arms, and the lens is printed last. ``on-edge`` turns X away from the plate.
"""
_IN_WORDS: dict[Orientation, str] = {
    "flat": "flat: the part's own Z points away from the plate, and the layers divide its thickness",
    "upright": "upright: the part's own −Y points away from the plate; a sensor stands on its "
    "arms, and the lens is printed last",
    "on-edge": "on edge: the part's own X points away from the plate; a sensor lies on its left side",
}


def orientation(name: Orientation, rotate_deg: Degrees = (0.0, 0.0, 0.0)) -> FloatArray:
    """Rotation matrix (3, 3) of a named orientation followed by rotations in degrees about the plate's X, Y and Z."""
    return turned(rotate_deg) @ ORIENTATIONS[name]


def described(name: Orientation, rotate_deg: Degrees) -> str:
    """Describe an orientation for the settings sheet."""
    turns = ", then rotated about X, Y, Z by " + ", ".join(f"{angle:g}" for angle in rotate_deg) + "°"
    return _IN_WORDS[name] + (turns if any(rotate_deg) else "")


def turned(rotate_deg: Degrees) -> FloatArray:
    """Matrix (3, 3) of rotations about X, then Y, then Z, counter-clockwise when looking against the axis."""
    matrix = np.eye(3)
    for axis, angle in enumerate(rotate_deg):
        cos, sin = _cos_sin(angle)
        first, second = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[first, first, second, second], [first, second, first, second]] = cos, -sin, sin, cos
        matrix = turn @ matrix
    return matrix


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    """Return the cosine and sine of an angle in degrees, exact at multiples of a right angle."""
    quarter, rest = divmod(angle_deg, 90.0)
    if rest == 0.0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
