"""Text that COMSOL reads as interpolation curves, data format *sectionwise*: points and the lines between them.

A section of coordinates is followed by a section of elements, which are pairs of row numbers from 1, just as COMSOL
itself writes the lines of a plot (its manual, "Interpolation Curve" and "Sectionwise Data Format"). Every face has its
own points, even at its junction with the next; each face therefore becomes one curve, and corners are kept. Both the
straight lines between the points and a spline through them deviate from the exact curve by 10 nm at most.

Lengths are in mm: set the geometry's length unit to mm. X is x, Y is z.
"""

from solen.fabricate.label import Label
from solen.geometry import Body

POINT_TOLERANCE_MM = 1e-5
"""Maximum deviation of the lines between the points from a curve: 10 nm."""


def as_comsol(body: Body, label: Label) -> bytes:
    """Sectionwise text of a body's outlines."""
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
