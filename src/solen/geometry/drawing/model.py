"""Contents of a drawing, independent of the file format."""

import re
from dataclasses import dataclass

from solen.curve import Curve
from solen.plane import Point

PIVOT = "pivot"
EMITTER = "emitter"
WALL = "wall"
"""Default name of a face."""
UNITS_MM = {"um": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4}
NO_UNITS_REMEDY = 'specify it, for example body.units = "mm"'


@dataclass(frozen=True)
class Stroke:
    """One curve and the name of its face; ``what`` identifies it in error messages."""

    name: str
    curve: Curve
    what: str


@dataclass(frozen=True)
class Lamp:
    """An emitter as drawn, with its name: a point facing along ``axis_deg``, or a line from ``point`` to ``end``."""

    point: Point
    end: Point | None = None
    axis_deg: float | None = None
    width_mm: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Drawing:
    """Strokes, emitters and named points."""

    strokes: tuple[Stroke, ...]
    lamps: tuple[Lamp, ...] = ()
    points: tuple[tuple[str, Point], ...] = ()


def face_name(text: str) -> str:
    """Return the face name for a layer or element name: lower case, without surrounding spaces."""
    name = re.sub(r"\s+", "-", text.strip().lower())
    return WALL if name in ("", "0") else name


def is_aside(name: str) -> bool:
    """Return whether strokes with this name are construction lines or notes and are ignored."""
    return name.startswith(("_", "construction", "note", "dimension", "defpoints"))


def is_named(name: str, what: str) -> bool:
    """Whether a name belongs to an object or to one of several: ``emitter``, ``emitter-2``, ``emitter-index-tip``."""
    return re.fullmatch(rf"{what}([-_ .]?[\w-]+)?", name) is not None


def lamp_name(name: str) -> str:
    """Return the emitter name for a layer or element name: ``tip`` for ``emitter-tip``."""
    return name.removeprefix(EMITTER).lstrip("-_ .")
