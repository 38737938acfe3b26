"""Closed outlines of named exact curves, from a lens and a guide or from a drawing, at any motion angle."""

from solen.geometry.bend import bend_of, bent
from solen.geometry.body import Body, Face, Front, Pose, material
from solen.geometry.displaced import Displaced, Moves, Touch, displaced
from solen.geometry.kinds import BODY_KINDS, BodyKind, body_of, drawn_kind
from solen.geometry.mirror import are_mirrored
from solen.geometry.outline import outline_body
from solen.geometry.sections import fronted, section
from solen.geometry.walls import called
from solen.geometry.y import arm_angle_deg, y_body

__all__ = [
    "BODY_KINDS",
    "Body",
    "BodyKind",
    "Displaced",
    "Face",
    "Front",
    "Moves",
    "Pose",
    "Touch",
    "are_mirrored",
    "arm_angle_deg",
    "bend_of",
    "bent",
    "body_of",
    "called",
    "displaced",
    "drawn_kind",
    "fronted",
    "material",
    "outline_body",
    "section",
    "y_body",
]
