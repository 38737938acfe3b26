"""From a lens and a guide to one closed body of named exact curves, at rest or turned."""

from solen.geometry.body import Body, Face, Pose
from solen.geometry.y import arm_angle_deg, y_body

__all__ = ["Body", "Face", "Pose", "arm_angle_deg", "y_body"]
