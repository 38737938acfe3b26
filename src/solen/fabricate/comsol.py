"""Interpolation curves for COMSOL in the *sectionwise* data format: points and the lines between them.

A section of coordinates is followed by a section of elements, which are pairs of row numbers counted from 1; COMSOL
writes the lines of a plot in the same form (manual, "Interpolation Curve" and "Sectionwise Data Format"). Each face has
its own points, even at its junction with the next face, so each face becomes one curve and corners remain sharp. Both
the straight lines between the points and a spline through them deviate from the exact curve by at most 10 nm.

Lengths are in mm: set the length unit of the geometry to mm. X is x, Y is z.
"""

from solen.fabricate.label import Label
from solen.geometry import Body

POINT_TOLERANCE_MM = 1e-5
"""Maximum deviation of the lines between the points from a curve: 10 nm."""


def as_comsol(body: Body, label: Label) -> bytes:
    """Return the outlines of a body in the sectionwise data format."""
    points: list[str] = []
    elements: list[str] = []
    curves: list[str] = []
    for face in body.all_faces:
        rows = face.curve.flattened(POINT_TOLERANCE_MM).tolist()
        first, last = len(points) + 1, len(points) + len(rows)
        curves.append(f"% Curve: {face.name}, points {first} to {last}")
        points += [f"{x:.15g} {z:.15g}" for x, z in rows]
        elements += [f"{i} {i + 1}" for i in range(first, last)]
    head = [f"% {line}" for line in label.lines]
    head += ["% Dimension: 2", f"% Nodes: {len(points)}", f"% Elements: {len(elements)}", "% Length unit: mm"]
    text = "\n".join([*head, *curves, "% Coordinates", *points, "% Elements (lines)", *elements])
    return (text + "\n").encode()
