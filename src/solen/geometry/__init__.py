"""Bodies: closed outlines of named exact curves, computed or drawn, at any motion angle."""

from solen.geometry.bend import bend_of, bent
from solen.geometry.body import Body, Face, Front, Pose, material
from solen.geometry.displaced import ContactSegment, Displaced, FaceDisplacement, displaced
from solen.geometry.kinds import BODY_KINDS, BodyKind, body_of, drawn_kind
from solen.geometry.mirror import are_mirrored
from solen.geometry.outline import outline_body
from solen.geometry.sections import section, with_front
from solen.geometry.walls import has_name
from solen.geometry.y import arm_angle_deg, y_body

__all__ = [
    "BODY_KINDS",
    "Body",
    "BodyKind",
    "ContactSegment",
    "Displaced",
    "Face",
    "FaceDisplacement",
    "Front",
    "Pose",
    "are_mirrored",
    "arm_angle_deg",
    "bend_of",
    "bent",
    "body_of",
    "displaced",
    "drawn_kind",
    "has_name",
    "material",
    "outline_body",
    "section",
    "with_front",
    "y_body",
]
