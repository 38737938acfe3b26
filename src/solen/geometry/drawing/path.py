"""SVG path data (SVG specification, section 9.3): commands M L H V C S Q T A Z, absolute and relative."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from solen.errors import DataError
from solen.geometry.drawing.transform import Affine
from solen.plane import Point

FARTHEST = 1e9
"""Maximum absolute value of a coordinate."""
NUMBER = re.compile(r"\s*,?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
FLAG = re.compile(r"\s*,?\s*([01])")
COMMAND = re.compile(r"\s*,?\s*([MmLlHhVvCcSsQqTtAaZz])")
COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


@dataclass(frozen=True)
class Piece:
    """A Bézier segment with its control points, or an elliptical arc: centre, two half axes and ``sweep``."""

    points: tuple[Point, ...]
    start: float = 0.0
    sweep: float | None = None

    def moved(self, onto: Affine) -> "Piece":
        """Return the segment transformed by an affine map."""
        if self.sweep is None:
            return Piece(tuple(onto.point(point) for point in self.points))
        center, u, v = self.points
        return Piece((onto.point(center), onto.vector(u), onto.vector(v)), self.start, self.sweep)

    def at(self, share: float) -> Point:
        """Return a point of an elliptical arc."""
        center, u, v = self.points
        angle = self.start + share * (self.sweep or 0.0)
        cos, sin = math.cos(angle), math.sin(angle)
        return (center[0] + cos * u[0] + sin * v[0], center[1] + cos * u[1] + sin * v[1])


def path_pieces(data: str, where: str) -> Iterator[Piece]:
    """Return the segments of a path in order; raises `DataError` if the text is not path data."""
    pen = _Pen()
    for command, numbers in _commands(data, where):
        piece = pen.draw(command, numbers)
        if piece is not None:
            yield piece


def _commands(data: str, where: str) -> Iterator[tuple[str, list[float]]]:
    """Yield every command with its numbers, including implied commands: further pairs after an M are Ls."""
    place, command = 0, ""
    while data[place:].strip(" \t\r\n,"):
        match = COMMAND.match(data, place)
        if match:
            command, place = match[1], match.end()
        elif command in ("", "Z", "z"):
            raise DataError(where, value=data[place : place + 20], limit="is not path data")
        numbers, place = _numbers(data, place, command, where)
        yield command, numbers
        command = {"M": "L", "m": "l"}.get(command, command)


def _numbers(data: str, place: int, command: str, where: str) -> tuple[list[float], int]:
    numbers: list[float] = []
    for i in range(COUNTS[command.upper()]):
        match = (FLAG if command in "Aa" and i in (3, 4) else NUMBER).match(data, place)
        if match is None:
            raise DataError(where, value=data[place : place + 20], limit=f"{command} requires another number there")
        numbers.append(coordinate(float(match[1]), where))
        place = match.end()
    return numbers, place


def coordinate(number: float, where: str) -> float:
    """Return a drawing coordinate; raises `DataError` if it is not a finite number, or too large."""
    if not abs(number) <= FARTHEST:
        raise DataError(where, value=number, limit=f"must be a finite number of at most ±{FARTHEST:g}")
    return number


class _Pen:
    """Current position of the path, start of its subpath, and the handle mirrored by S and T."""

    def __init__(self) -> None:
        self._at: Point = (0.0, 0.0)
        self._began: Point = (0.0, 0.0)
        self._cubic: Point | None = None
        self._quadratic: Point | None = None

    def draw(self, command: str, numbers: list[float]) -> Piece | None:
        """Return the segment drawn by a command; None if nothing is drawn."""
        kind, before = command.upper(), self._at
        offset = before if command.islower() else (0.0, 0.0)
        cubic, quadratic = self._cubic, self._quadratic
        self._cubic = self._quadratic = None
        if kind == "A":
            self._at = (numbers[5] + offset[0], numbers[6] + offset[1])
            return _arc(before, numbers, self._at)
        if kind in "HV":
            self._at = (numbers[0] + offset[0], before[1]) if kind == "H" else (before[0], numbers[0] + offset[1])
            return _line(before, self._at)
        if kind == "Z":
            self._at = self._began
            return _line(before, self._at)
        points = [(x + offset[0], y + offset[1]) for x, y in zip(numbers[::2], numbers[1::2], strict=True)]
        self._at = points[-1]
        if kind == "M":
            self._began = self._at
            return None
        if kind == "L":
            return _line(before, self._at)
        if kind in "CS":
            handles = points if kind == "C" else [_mirrored(cubic or before, before), *points]
            self._cubic = handles[-2]
            return Piece((before, *handles))
        handle = points[0] if kind == "Q" else _mirrored(quadratic or before, before)
        self._quadratic = handle
        return Piece((before, handle, self._at))


def _line(a: Point, b: Point) -> Piece | None:
    return Piece((a, b)) if a != b else None


def _mirrored(handle: Point, at: Point) -> Point:
    return (2.0 * at[0] - handle[0], 2.0 * at[1] - handle[1])


def _arc(a: Point, numbers: list[float], b: Point) -> Piece | None:
    """Return an elliptical arc between two points (SVG, appendix B.2.4); radii that are too small are enlarged."""
    rx, ry, turn = abs(numbers[0]), abs(numbers[1]), math.radians(numbers[2])
    large, positive = numbers[3] != 0.0, numbers[4] != 0.0
    if rx == 0.0 or ry == 0.0 or a == b:
        return _line(a, b)
    cos, sin = math.cos(turn), math.sin(turn)
    half = (0.5 * (a[0] - b[0]), 0.5 * (a[1] - b[1]))
    x, y = (cos * half[0] + sin * half[1]) / rx, (-sin * half[0] + cos * half[1]) / ry
    square = x * x + y * y
    if square > 1.0:
        rx, ry, x, y = rx * math.sqrt(square), ry * math.sqrt(square), x / math.sqrt(square), y / math.sqrt(square)
        square = 1.0
    away = math.sqrt(max(0.0, 1.0 / square - 1.0)) * (-1.0 if large == positive else 1.0)
    cx, cy = (
        away * y,
        -away * x,
    )  # centre relative to the midpoint of the chord, in coordinates in which the ellipse is the unit circle
    start, end = math.atan2(y - cy, x - cx), math.atan2(-y - cy, -x - cx)
    sweep = (end - start) % math.tau
    sweep = sweep if positive else sweep - math.tau
    u, v = (rx * cos, rx * sin), (-ry * sin, ry * cos)
    center = (0.5 * (a[0] + b[0]) + cx * u[0] + cy * v[0], 0.5 * (a[1] + b[1]) + cx * u[1] + cy * v[1])
    return Piece((center, u, v), start, sweep)
