"""DXF drawings of a body with ezdxf (the extra ``dxf``): LINE, ARC and SPLINE entities in mm, with one layer per face.

The layers are named after the faces, so that `solen.geometry.drawing` can read the body back. The emitter is a point (a
line for a chip) on the layer ``emitter``; the emitters of a network are on layers ``emitter-NAME``, and the pivot of
the motion is a point on the layer ``pivot``. Custom header properties contain the label. X is x, Y is z.
"""

import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from solen.curve import Arc, Segment
from solen.extras import need
from solen.fabricate.bspline import Bspline, primitives
from solen.fabricate.label import Label
from solen.fabricate.numbers import LINE_MM, NUMBER_DISTANCE_MM, TEXT_MM, NumberedPart
from solen.geometry import Body, Pose
from solen.plane import along, heading, right_of

VERSION = "R2010"
MILLIMETRES = 4
"""Code for mm in $INSUNITS."""
FORBIDDEN = re.compile(r'[<>/\\":;?*|=`]')
"""Characters that are not allowed in a layer name."""


def check_writer() -> None:
    """Raise `OutputError` if ezdxf is not installed."""
    need("ezdxf", what="--dxf", doing="writing DXF")


def as_dxf(body: Body, label: Label, parts: Sequence[NumberedPart] = ()) -> bytes:
    """Return a DXF file of a body, with its parts numbered and listed; `OutputError` if ezdxf is not installed."""
    check_writer()
    from ezdxf.filemanagement import new

    with _no_dates():
        document = new(VERSION, units=MILLIMETRES)
        properties = {"Design": label.name, "Written by": label.lines[1], "Design SHA-256": label.sha256}
        for key, value in (properties | {"About": label.about}).items():
            document.header.custom_vars.append(key, value)
        space = document.modelspace()
        for face in (*body.all_faces, *body.separate):
            for piece in primitives(face.curve):
                _draw(space, piece, layer_of(face.name))
        _mark(space, body)
        _number(space, body, parts)
        text = io.StringIO()
        document.write(text)
    return text.getvalue().encode(document.output_encoding, "dxfreplace")


def layer_of(name: str) -> str:
    """Return the name of the layer for a face."""
    return FORBIDDEN.sub("-", name)


def _draw(space: Any, piece: Segment | Arc | Bspline, layer: str) -> None:
    attributes = {"layer": layer}
    if isinstance(piece, Segment):
        space.add_line(piece.a, piece.b, dxfattribs=attributes)
    elif isinstance(piece, Arc) and abs(piece.sweep_deg) >= 360.0:
        space.add_circle(piece.center, piece.radius_mm, dxfattribs=attributes)
    elif isinstance(piece, Arc):
        ends = sorted((piece.start_deg, piece.start_deg + piece.sweep_deg))
        space.add_arc(piece.center, piece.radius_mm, *ends, dxfattribs=attributes)
    else:
        spline = space.add_spline(degree=piece.degree, dxfattribs=attributes)
        spline.control_points = [(x, z, 0.0) for x, z in piece.points]
        spline.knots = piece.knot_vector.tolist()


def _mark(space: Any, body: Body) -> None:
    """Draw each emitter and the pivot on a separate layer."""
    for name, emitter in emitters(body):
        ends = emitter_line(emitter)
        if math.dist(*ends) > 0.0:
            space.add_line(*ends, dxfattribs={"layer": name})
        else:
            space.add_point(emitter.point, dxfattribs={"layer": name})
    if "stem-base" in body.marks:
        space.add_point(body.marks["stem-base"], dxfattribs={"layer": "pivot"})


def _number(space: Any, body: Body, parts: Sequence[NumberedPart]) -> None:
    """Draw the part numbers on the layer ``note-numbers`` and the table of parts on the layer ``note-table``."""
    from ezdxf.enums import TextEntityAlignment

    right_mm, top_mm = body.outline(1e-2).max(axis=0).tolist()
    for row, part in enumerate(parts):
        number = space.add_text(str(part.number), height=TEXT_MM, dxfattribs={"layer": "note-numbers"})
        number.set_placement(part.position, align=TextEntityAlignment.MIDDLE_CENTER)
        line = space.add_text(part.row, height=TEXT_MM, dxfattribs={"layer": "note-table"})
        line.set_placement((right_mm + 2.0 * NUMBER_DISTANCE_MM, top_mm - row * LINE_MM))


def emitters(body: Body) -> list[tuple[str, Pose]]:
    """Return the emitters with their names in a drawing: ``emitter``, or ``emitter-NAME`` in a network."""
    return [(f"emitter-{name}", pose) for name, pose in body.emitters] or [("emitter", body.emitter)]


def emitter_line(emitter: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the ends of a line as wide as the emitter chip; for a point emitter, they coincide."""
    across = right_of(heading(emitter.axis_deg))
    return along(emitter.point, across, -0.5 * emitter.width_mm), along(emitter.point, across, 0.5 * emitter.width_mm)


@contextmanager
def _no_dates() -> Iterator[None]:
    """Make ezdxf omit dates and random names, so that the same design always gives the same file."""
    import ezdxf

    options = ezdxf.options  # type: ignore[attr-defined]  # public, but not exported explicitly
    before = options.write_fixed_meta_data_for_testing
    options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing = before
