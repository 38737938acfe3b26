"""What holds a body and what loads it, by the names of its faces.

A `Stretch` is a part of the outline, named as wall tables name theirs: lengths along a face count from its start, or
from its end where the face is walked backwards (`solen.geometry.Face.from_end`).

Frictionless throughout. Forces are newtons for the whole thickness, moments N·mm counter-clockwise, directions degrees
counter-clockwise from +z.
"""

from dataclasses import dataclass
from typing import Literal

from solen.plane import Point, Rigid


@dataclass(frozen=True)
class Stretch:
    """Part of a face, or of every face that a pattern names.

    Attributes
    ----------
    face
        Name of a face, or a pattern: ``stem-right``, ``outer-*``, ``*``. Numbers of pieces may be left out.
    from_mm, to_mm
        Where it begins and ends along the face; None for the face's end.
    """

    face: str
    from_mm: float = 0.0
    to_mm: float | None = None


HoldKind = Literal["fixed", "sliding", "turning"]


@dataclass(frozen=True)
class Hold:
    """A support at rest.

    Attributes
    ----------
    stretches
        The parts of the outline that it touches.
    kind
        ``fixed``: no point of them moves. ``sliding``: they move along the wall's own direction at rest, not across.
        ``turning``: they turn together as one rigid piece about ``pivot_mm``, freely.
    pivot_mm
        Of ``turning``, and the point about which the moment is stated; None: the middle of the held points.
    solid
        Whether the material within the convex hull of the stretches is held too, as in a clamp that encloses it.
    name
        How results and messages call it.
    """

    stretches: tuple[Stretch, ...]
    kind: HoldKind = "fixed"
    pivot_mm: Point | None = None
    solid: bool = False
    name: str = "hold"


@dataclass(frozen=True)
class Turn:
    """A driven clamp: its stretches turn as one rigid piece by a stated angle, exactly and not to first order.

    Attributes are those of `Hold`, and ``angle_deg``, counter-clockwise.
    """

    stretches: tuple[Stretch, ...]
    pivot_mm: Point
    angle_deg: float
    solid: bool = False
    name: str = "clamp"

    @property
    def motion(self) -> Rigid:
        """Of the clamp, and of whatever is fixed to it: an emitter."""
        return Rigid.about(self.pivot_mm, self.angle_deg)


@dataclass(frozen=True)
class Press:
    """A rigid, frictionless round finger that is pushed straight into a wall from where it just touches it.

    Attributes
    ----------
    face, at_mm
        Where it first touches: length along a face, counted as in `Stretch`.
    radius_mm
        Radius of the finger.
    depth_mm, force_N
        How far it moves on, or the force along its way with which it does: one of the two.
    direction_deg
        In which it moves; None: square to the wall, into the material.
    name
        How results and messages call it.
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
    """A dead force spread evenly over a part of the outline; its direction does not turn with the body.

    Attributes
    ----------
    stretches
        Over which it is spread, by their length at rest.
    force_N
        Its components along x and z, for the whole thickness.
    name
        How results and messages call it.
    """

    stretches: tuple[Stretch, ...]
    force_N: Point
    name: str = "pull"


Load = Turn | Press | Pull
