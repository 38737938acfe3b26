"""How a part lies on the plate: rotations of its own axes X, Y, Z, of which Z counts away from the plate."""

import math

import numpy as np

from solen.arrays import FloatArray
from solen.errors import SpecError

ORIENTATIONS: dict[str, FloatArray] = {
    "flat": np.eye(3),
    "upright": np.array([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)]),
    "on-edge": np.array([(0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)]),
}
"""Flat: as it is. Upright: −Y away from the plate, a sensor on the ends of its arms, lens last. On edge: X away."""
IN_WORDS = {
    "flat": "flat: the part's own Z points away from the plate, layers lie across its thickness",
    "upright": "upright: the part's own −Y points away from the plate; a sensor stands on its arms, the lens is last",
    "on-edge": "on edge: the part's own X points away from the plate; a sensor lies on its left side",
}


def orientation(name: str, rotate_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> FloatArray:
    """Rotation matrix (3, 3) of a named orientation and, after it, of turns in degrees about the plate's X, Y and Z.

    Raises
    ------
    SpecError
        Where there is no orientation of that name, or an angle is not finite.
    """
    if name not in ORIENTATIONS:
        raise SpecError("--orientation", value=name, limit=f"must be one of {', '.join(ORIENTATIONS)}")
    return turned(rotate_deg) @ ORIENTATIONS[name]


def turned(rotate_deg: tuple[float, float, float]) -> FloatArray:
    """Rotation matrix (3, 3) of turns about X, then Y, then Z, counter-clockwise as seen from the axis' far end."""
    if not all(map(math.isfinite, rotate_deg)):
        raise SpecError("--rotate-deg", value=rotate_deg, limit="must be finite, in degrees")
    found = np.eye(3)
    for axis, angle in enumerate(rotate_deg):
        cos, sin = _cos_sin(angle)
        one, two = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[[one, one, two, two], [one, two, one, two]] = cos, -sin, sin, cos
        found = turn @ found
    return found


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    """Cosine and sine, exact at right angles."""
    quarter, rest = divmod(angle_deg, 90.0)
    if rest == 0.0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
