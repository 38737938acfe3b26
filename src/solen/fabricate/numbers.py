"""Numbers of the parts of a network in its drawings, and the table that lists the parts."""

from collections.abc import Iterator
from dataclasses import dataclass

from numpy.polynomial import polynomial

from solen.curve import ArcLength
from solen.geometry import Body
from solen.geometry.body import Face
from solen.geometry.network import drawn_lenses, network_lenses, plan_of
from solen.plane import Point, along, heading
from solen.spec import Design

NUMBER_DISTANCE_MM = 1.1
"""Distance between a number and its face or emitter."""
TEXT_MM, LINE_MM, LETTER_WIDTH = 1.2, 1.9, 0.62
"""Text height, line spacing of the table, and ratio of letter width to text height."""


@dataclass(frozen=True)
class NumberedPart:
    """A part of a network, its number, and the position of the number in the drawing."""

    number: int
    kind: str
    name: str
    size: str
    position: Point

    @property
    def row(self) -> str:
        """Row of the part in the table."""
        return f"{self.number}  {self.kind} {self.name}: {self.size}"


def numbered(design: Design, body: Body) -> tuple[NumberedPart, ...]:
    """Return the parts of a network in the order of its lists; empty for any other kind of body."""
    if design.body.kind != "network":
        return ()
    rows = (*_guides(design), *_lenses(design, body), *_emitters(body), *_receivers(design, body))
    return tuple(NumberedPart(number, *row) for number, row in enumerate(rows, start=1))


_Row = tuple[str, str, str, Point]


def _guides(design: Design) -> Iterator[_Row]:
    paths = {} if design.outline_file is not None else plan_of(design).paths
    for name, path in paths.items():
        (a, b), (c, d) = (wall.middle_point for wall in path.walls.values())
        ends = polynomial.polyval([0.0, path.spine.length_mm], path.guide.widths).tolist()
        width = " to ".join(dict.fromkeys(f"{end:.4g}" for end in ends))
        yield "guide", name, f"{width} mm wide, {path.spine.length_mm:.4g} mm long", (0.5 * (a + c), 0.5 * (b + d))


def _lenses(design: Design, body: Body) -> Iterator[_Row]:
    lenses = drawn_lenses(design, body) if design.outline_file is not None else network_lenses(design)
    for name, lens in lenses.items():
        size = f"{lens.shape}, {2.0 * lens.half_width_mm:.4g} mm wide, {lens.depth_mm:.4g} mm deep"
        yield "lens", name, size, _next_to(body, f"lens-{name}", inside=True)


def _emitters(body: Body) -> Iterator[_Row]:
    for name, pose in body.emitters:
        size = f"at x {pose.point[0]:.4g}, z {pose.point[1]:.4g} mm, towards {pose.axis_deg + 0.0:.4g} deg"
        yield "emitter", name, size, along(pose.point, heading(pose.axis_deg), -NUMBER_DISTANCE_MM)


def _receivers(design: Design, body: Body) -> Iterator[_Row]:
    for receiver in design.network.receivers:
        curve = _face(body, f"receiver-{receiver.name}").curve
        position = f", at node {receiver.node}" if receiver.node else ""
        if receiver.guide:
            position = f", {receiver.side} side of {receiver.guide} from {receiver.from_mm:.4g} mm"
        size = f"{ArcLength(curve).length_mm:.4g} mm long{position}"
        yield "receiver", receiver.name, size, _next_to(body, f"receiver-{receiver.name}", inside=False)


def _face(body: Body, name: str) -> Face:
    """Return the face with a given name, or the first segment of this face."""
    return next(face for face in (*body.all_faces, *body.separate) if face.name.partition(".")[0] == name)


def _next_to(body: Body, name: str, *, inside: bool) -> Point:
    """Return a position next to the midpoint of a face, inside or outside the material."""
    curve = _face(body, name).curve
    inwards_mm = NUMBER_DISTANCE_MM if inside else -NUMBER_DISTANCE_MM
    return along(curve.middle_point, curve.normal_at(curve.middle_point), inwards_mm)
