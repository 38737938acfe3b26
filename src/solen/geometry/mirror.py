"""Test whether two bodies are mirror images about the axis x = 0.

If the sensor body at every angle is the mirror image of the body at the opposite angle, the receiver readings are
mirrored too: only one side needs to be traced, and the results are exactly symmetric.
"""

import re

import numpy as np

from solen.geometry.body import Body, Face
from solen.plane import Point

SAME_MM, SAME_DEG = 1e-9, 1e-9
"""Tolerances for positions and directions of mirror images."""
PLACES = np.linspace(0.0, 1.0, 9)
OTHER = {"right": "left", "left": "right"}


def are_mirrored(one: Body, other: Body) -> bool:
    """Whether one body mirrors another, with faces, walls and emitter; right and left are swapped in the names."""
    there = {face.name: face for face in (*other.all_faces, *other.apart)}
    faces = (*one.all_faces, *one.apart)
    return (
        len(faces) == len(there)
        and _opposite(one.emitter.point, other.emitter.point)
        and abs(one.emitter.axis_deg + other.emitter.axis_deg) < SAME_DEG
        and one.emitter.width_mm == other.emitter.width_mm
        and all(
            _reflects(face, there.get(re.sub("right|left", lambda side: OTHER[side[0]], face.name))) for face in faces
        )
    )


def _opposite(one: Point, other: Point) -> bool:
    return abs(one[0] + other[0]) < SAME_MM and abs(one[1] - other[1]) < SAME_MM


def _reflects(face: Face, image: Face | None) -> bool:
    """Return whether a face is the mirror image of another, which has the opposite direction."""
    if image is None or face.wall != image.wall:
        return False
    apart = face.curve.points(PLACES) * (-1.0, 1.0) - image.curve.points(PLACES[::-1])
    return bool(np.abs(apart).max() < SAME_MM)
