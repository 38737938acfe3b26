"""Test of whether two bodies are mirror images about the axis x = 0.

If the sensor body at every angle is the mirror image of the body at the opposite angle, so are the receiver readings:
only one side needs to be traced, and the results are exactly symmetric.
"""

import re

import numpy as np

from solen.geometry.body import Body, Face
from solen.plane import Point

TOLERANCE_MM, TOLERANCE_DEG = 1e-9, 1e-9
"""Tolerances for positions and directions of mirror images."""
SAMPLES = np.linspace(0.0, 1.0, 9)
OPPOSITE_SIDE = {"right": "left", "left": "right"}


def are_mirrored(body: Body, image: Body) -> bool:
    """Return whether two bodies mirror each other in faces, walls and emitter, with right and left swapped in names."""
    images = {face.name: face for face in (*image.all_faces, *image.separate)}
    faces = (*body.all_faces, *body.separate)
    return (
        len(faces) == len(images)
        and _are_mirrored_points(body.emitter.point, image.emitter.point)
        and abs(body.emitter.axis_deg + image.emitter.axis_deg) < TOLERANCE_DEG
        and body.emitter.width_mm == image.emitter.width_mm
        and all(_is_mirrored_face(face, images.get(_mirrored_name(face.name))) for face in faces)
    )


def _mirrored_name(name: str) -> str:
    return re.sub("right|left", lambda side: OPPOSITE_SIDE[side[0]], name)


def _are_mirrored_points(point: Point, image: Point) -> bool:
    return abs(point[0] + image[0]) < TOLERANCE_MM and abs(point[1] - image[1]) < TOLERANCE_MM


def _is_mirrored_face(face: Face, image: Face | None) -> bool:
    """Return whether a face is the mirror image of another, which has the opposite direction."""
    if image is None or face.wall != image.wall:
        return False
    difference = face.curve.points(SAMPLES) * (-1.0, 1.0) - image.curve.points(SAMPLES[::-1])
    return bool(np.abs(difference).max() < TOLERANCE_MM)
