"""Text that COMSOL reads as interpolation curves, data format *sectionwise*: points, and which of them are joined.

A section of coordinates is followed by one of elements, pairs of row numbers from 1 on, in the way in which COMSOL
itself writes the lines of a plot (its manual, "Interpolation Curve" and "Sectionwise Data Format"). Every face has
its own points, also where it meets the next, so that each becomes one curve and a corner stays one. The straight
lines between the points leave the exact curve by 10 nm at most, and so does a spline through them.

Lengths are in mm: set the geometry's length unit to mm. X is x, Y is z.
"""

from solen.fabricate.label import Label
from solen.geometry import Body

POINT_TOLERANCE_MM = 1e-5
"""How far the lines between the points may leave a curve: 10 nm."""


def as_comsol(body: Body, label: Label) -> bytes:
    """Sectionwise text of the outlines of a body."""
    points: list[str] = []
    elements: list[str] = []
    named: list[str] = []
    for face in body.all_faces:
        rows = face.curve.flattened(POINT_TOLERANCE_MM).tolist()
        first, last = len(points) + 1, len(points) + len(rows)
        named.append(f"% Curve: {face.name}, points {first} to {last}")
        points += [f"{x:.15g} {z:.15g}" for x, z in rows]
        elements += [f"{i} {i + 1}" for i in range(first, last)]
    head = [f"% {line}" for line in label.lines]
    head += ["% Dimension: 2", f"% Nodes: {len(points)}", f"% Elements: {len(elements)}", "% Length unit: mm"]
    text = "\n".join([*head, *named, "% Coordinates", *points, "% Elements (lines)", *elements])
    return (text + "\n").encode()
