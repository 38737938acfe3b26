"""Contents of a drawing, independent of the file format."""

import re
from dataclasses import dataclass

from solen.curve import Curve
from solen.plane import Point

PIVOT = "pivot"
EMITTER = "emitter"
WALL = "wall"
"""Name of a face without a name of its own."""
UNITS_MM = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
NO_UNITS_REMEDY = 'specify the unit, for example body.units = "mm"'


@dataclass(frozen=True)
class Stroke:
    """A curve and the name of its face; ``what`` identifies the curve in error messages."""

    name: str
    curve: Curve
    what: str


@dataclass(frozen=True)
class DrawnEmitter:
    """An emitter as drawn: a point that faces along ``axis_deg``, or a line from ``point`` to ``end``."""

    point: Point
    end: Point | None = None
    axis_deg: float | None = None
    width_mm: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Drawing:
    """Strokes, emitters and named points."""

    strokes: tuple[Stroke, ...]
    emitters: tuple[DrawnEmitter, ...] = ()
    points: tuple[tuple[str, Point], ...] = ()


def face_name(text: str) -> str:
    """Return the face name for the name of a layer or element: in lower case, with hyphens instead of spaces."""
    name = re.sub(r"\s+", "-", text.strip().lower())
    return WALL if name in ("", "0") else name


def is_annotation(name: str) -> bool:
    """Return whether strokes with this name are construction lines or notes, which are ignored."""
    return name.startswith(("_", "construction", "note", "dimension", "defpoints"))


def is_called(name: str, part: str) -> bool:
    """Return whether a part has the name, alone or among several: ``emitter``, ``emitter-2``, ``emitter-index-tip``."""
    return re.fullmatch(rf"{part}([-_ .]?[\w-]+)?", name) is not None


def emitter_name(name: str) -> str:
    """Return the emitter name for the name of a layer or element: ``tip`` for ``emitter-tip``."""
    return name.removeprefix(EMITTER).lstrip("-_ .")
