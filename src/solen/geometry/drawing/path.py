"""SVG path data (SVG specification, section 9.3): commands M L H V C S Q T A Z, absolute and relative."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from solen.errors import DataError
from solen.geometry.drawing.transform import Affine
from solen.plane import Point

MAX_COORDINATE = 1e9
"""Maximum absolute value of a coordinate."""
NUMBER = re.compile(r"\s*,?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
FLAG = re.compile(r"\s*,?\s*([01])")
COMMAND = re.compile(r"\s*,?\s*([MmLlHhVvCcSsQqTtAaZz])")
COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}


@dataclass(frozen=True)
class PathSegment:
    """A Bézier segment with its control points, or an elliptical arc with its centre, two semi-axes and ``sweep``."""

    points: tuple[Point, ...]
    start: float = 0.0
    sweep: float | None = None

    def moved(self, onto: Affine) -> "PathSegment":
        """Return the segment transformed by an affine map."""
        if self.sweep is None:
            return PathSegment(tuple(onto.point(point) for point in self.points))
        center, u, v = self.points
        return PathSegment((onto.point(center), onto.vector(u), onto.vector(v)), self.start, self.sweep)

    def at(self, fraction: float) -> Point:
        """Return a point of an elliptical arc."""
        center, u, v = self.points
        angle = self.start + fraction * (self.sweep or 0.0)
        cos, sin = math.cos(angle), math.sin(angle)
        return (center[0] + cos * u[0] + sin * v[0], center[1] + cos * u[1] + sin * v[1])


def path_segments(data: str, where: str) -> Iterator[PathSegment]:
    """Yield the segments of a path in order; raise `DataError` if the string is not path data."""
    pen = _Pen()
    for command, numbers in _commands(data, where):
        segment = pen.draw(command, numbers)
        if segment is not None:
            yield segment


def _commands(data: str, where: str) -> Iterator[tuple[str, list[float]]]:
    """Yield every command with its numbers; further pairs after an M are implied L commands."""
    index, command = 0, ""
    while data[index:].strip(" \t\r\n,"):
        match = COMMAND.match(data, index)
        if match:
            command, index = match[1], match.end()
        elif command in ("", "Z", "z"):
            raise DataError(where, value=data[index : index + 20], limit="is not path data")
        numbers, index = _numbers(data, index, command, where)
        yield command, numbers
        command = {"M": "L", "m": "l"}.get(command, command)


def _numbers(data: str, index: int, command: str, where: str) -> tuple[list[float], int]:
    numbers: list[float] = []
    for i in range(COUNTS[command.upper()]):
        match = (FLAG if command in "Aa" and i in (3, 4) else NUMBER).match(data, index)
        if match is None:
            raise DataError(
                where, value=data[index : index + 20], limit=f"is not a number, but command {command} requires another"
            )
        numbers.append(coordinate(float(match[1]), where))
        index = match.end()
    return numbers, index


def coordinate(number: float, where: str) -> float:
    """Return a coordinate of a drawing; raise `DataError` if it is not finite, or too large."""
    if not abs(number) <= MAX_COORDINATE:
        raise DataError(where, value=number, limit=f"must be finite and between ±{MAX_COORDINATE:g}")
    return number


class _Pen:
    """The current position of a path, the start of its subpath, and the handle that S and T mirror."""

    def __init__(self) -> None:
        self._position: Point = (0.0, 0.0)
        self._subpath_start: Point = (0.0, 0.0)
        self._cubic: Point | None = None
        self._quadratic: Point | None = None

    def draw(self, command: str, numbers: list[float]) -> PathSegment | None:
        """Return the segment drawn by a command; None if nothing is drawn."""
        kind, start = command.upper(), self._position
        offset = start if command.islower() else (0.0, 0.0)
        cubic, quadratic = self._cubic, self._quadratic
        self._cubic = self._quadratic = None
        if kind == "A":
            self._position = (numbers[5] + offset[0], numbers[6] + offset[1])
            return _arc(start, numbers, self._position)
        if kind in "HV":
            self._position = (numbers[0] + offset[0], start[1]) if kind == "H" else (start[0], numbers[0] + offset[1])
            return _line(start, self._position)
        if kind == "Z":
            self._position = self._subpath_start
            return _line(start, self._position)
        points = [(x + offset[0], y + offset[1]) for x, y in zip(numbers[::2], numbers[1::2], strict=True)]
        self._position = points[-1]
        if kind == "M":
            self._subpath_start = self._position
            return None
        if kind == "L":
            return _line(start, self._position)
        if kind in "CS":
            handles = points if kind == "C" else [_mirrored(cubic or start, start), *points]
            self._cubic = handles[-2]
            return PathSegment((start, *handles))
        handle = points[0] if kind == "Q" else _mirrored(quadratic or start, start)
        self._quadratic = handle
        return PathSegment((start, handle, self._position))


def _line(a: Point, b: Point) -> PathSegment | None:
    return PathSegment((a, b)) if a != b else None


def _mirrored(handle: Point, center: Point) -> Point:
    return (2.0 * center[0] - handle[0], 2.0 * center[1] - handle[1])


def _arc(a: Point, numbers: list[float], b: Point) -> PathSegment | None:
    """Return an elliptical arc between two points (SVG, appendix B.2.4); radii that are too small are enlarged."""
    rx, ry, turn = abs(numbers[0]), abs(numbers[1]), math.radians(numbers[2])
    large, positive = numbers[3] != 0.0, numbers[4] != 0.0
    if rx == 0.0 or ry == 0.0 or a == b:
        return _line(a, b)
    cos, sin = math.cos(turn), math.sin(turn)
    half = (0.5 * (a[0] - b[0]), 0.5 * (a[1] - b[1]))
    x, y = (cos * half[0] + sin * half[1]) / rx, (-sin * half[0] + cos * half[1]) / ry
    squared = x * x + y * y
    if squared > 1.0:
        rx, ry, x, y = rx * math.sqrt(squared), ry * math.sqrt(squared), x / math.sqrt(squared), y / math.sqrt(squared)
        squared = 1.0
    distance = math.sqrt(max(0.0, 1.0 / squared - 1.0)) * (-1.0 if large == positive else 1.0)
    # centre relative to the midpoint of the chord, in coordinates in which the ellipse is the unit circle
    cx, cy = distance * y, -distance * x
    start, end = math.atan2(y - cy, x - cx), math.atan2(-y - cy, -x - cx)
    sweep = (end - start) % math.tau
    sweep = sweep if positive else sweep - math.tau
    u, v = (rx * cos, rx * sin), (-ry * sin, ry * cos)
    center = (0.5 * (a[0] + b[0]) + cx * u[0] + cy * v[0], 0.5 * (a[1] + b[1]) + cx * u[1] + cy * v[1])
    return PathSegment((center, u, v), start, sweep)
