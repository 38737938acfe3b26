"""Supports and loads of a body, on faces that are given by name.

A `Stretch` is a part of the outline, named as in wall tables: lengths along a face are measured from its start, or from
its end if `solen.geometry.Face.from_end` is set.

All contacts are frictionless. Forces are in newtons for the entire thickness, moments in N·mm counter-clockwise,
directions in degrees counter-clockwise from +z.
"""

from dataclasses import dataclass
from typing import Literal

from solen.plane import Point, Rigid


@dataclass(frozen=True)
class Stretch:
    """Part of a face, or of every face that matches a pattern.

    Attributes
    ----------
    face
        Name of a face, or a pattern: ``stem-right``, ``outer-*``, ``*``. The piece number at its end may be omitted.
    from_mm, to_mm
        Start and end along the face; ``to_mm`` None: the end of the face.
    """

    face: str
    from_mm: float = 0.0
    to_mm: float | None = None


HoldKind = Literal["fixed", "sliding", "turning"]


@dataclass(frozen=True)
class Hold:
    """A stationary support.

    Attributes
    ----------
    stretches
        The supported parts of the outline.
    kind
        ``fixed``: the points do not move. ``sliding``: they move along the wall's direction at rest, not across it.
        ``turning``: they rotate freely as one rigid part about ``pivot_mm``.
    pivot_mm
        Pivot of ``turning``, and reference point of the moment; None: the centre of the supported points.
    solid
        Whether the material in the convex hull of the stretches is also constrained, as in a clamp that encloses it.
    name
        Name in results and messages.
    """

    stretches: tuple[Stretch, ...]
    kind: HoldKind = "fixed"
    pivot_mm: Point | None = None
    solid: bool = False
    name: str = "hold"


@dataclass(frozen=True)
class Turn:
    """A driven clamp: its stretches rotate as one rigid part through a prescribed finite angle.

    The attributes are those of `Hold` and ``angle_deg``, counter-clockwise.
    """

    stretches: tuple[Stretch, ...]
    pivot_mm: Point
    angle_deg: float
    solid: bool = False
    name: str = "clamp"

    @property
    def motion(self) -> Rigid:
        """Rigid motion of the clamp and of any part attached to it, such as an emitter."""
        return Rigid.about(self.pivot_mm, self.angle_deg)


@dataclass(frozen=True)
class Press:
    """A rigid, frictionless round finger that is pushed along a straight line into a wall.

    Attributes
    ----------
    face, at_mm
        Point of first contact: length along a face, measured as in `Stretch`.
    radius_mm
        Radius of the finger.
    depth_mm, force_N
        Distance that it moves after first contact, or the force along its direction: exactly one of the two.
    direction_deg
        Direction of its movement; None: perpendicular to the wall, into the material.
    name
        Name in results and messages.
    """

    face: str
    at_mm: float
    radius_mm: float
    depth_mm: float | None = None
    force_N: float | None = None
    direction_deg: float | None = None
    name: str = "press"


@dataclass(frozen=True)
class Pull:
    """A dead load distributed uniformly over part of the outline; its direction does not rotate with the body.

    Attributes
    ----------
    stretches
        Parts over which the load is distributed, by their length at rest.
    force_N
        Components of the load along x and z, over the entire thickness.
    name
        Name in results and messages.
    """

    stretches: tuple[Stretch, ...]
    force_N: Point
    name: str = "pull"


Load = Turn | Press | Pull
