"""Affine maps of the plane, and the transform attribute of SVG."""

import math
import re
from dataclasses import dataclass

from solen.errors import DataError
from solen.plane import Point

CALL = re.compile(r"\s*(\w+)\s*\(([^)]*)\)\s*,?")


@dataclass(frozen=True)
class Affine:
    """(x, y) -> (a x + c y + e, b x + d y + f)."""

    a: float = 1.0
    b: float = 0.0
    c: float = 0.0
    d: float = 1.0
    e: float = 0.0
    f: float = 0.0

    @classmethod
    def of(cls, text: str, where: str) -> "Affine":
        """Return the map of a transform attribute; raise `DataError` if the string is not a transform."""
        affine, index = cls(), 0
        while index < len(text.rstrip()):
            call = CALL.match(text, index)
            if call is None:
                raise DataError(f"{where}: transform", value=text, limit="is not supported")
            try:
                numbers = [float(number) for number in re.split(r"[\s,]+", call[2].strip())]
                affine = affine.after(_function_map(call[1], numbers))
            except ValueError:
                raise DataError(f"{where}: transform", value=text, limit="is not supported") from None
            index = call.end()
        return affine

    def after(self, first: "Affine") -> "Affine":
        """Return the map that applies ``first`` and then this map."""
        return Affine(
            *self.vector((first.a, first.b)), *self.vector((first.c, first.d)), *self.point((first.e, first.f))
        )

    def point(self, p: Point) -> Point:
        """Return the image of a point."""
        x, y = self.vector(p)
        return (x + self.e, y + self.f)

    def vector(self, v: Point) -> Point:
        """Return the image of a vector."""
        return (self.a * v[0] + self.c * v[1], self.b * v[0] + self.d * v[1])


def _function_map(name: str, numbers: list[float]) -> Affine:
    """Return the map of one function in a transform attribute."""
    if name == "rotate":
        angle, *about = numbers
        turn = _turn(math.radians(angle))
        if not about:
            return turn
        x, y = about
        return Affine(e=x, f=y).after(turn).after(Affine(e=-x, f=-y))
    if name == "matrix" and len(numbers) == 6:
        return Affine(*numbers)
    first, *rest = numbers
    if name == "translate":
        return Affine(e=first, f=rest[0] if rest else 0.0)
    if name == "scale":
        return Affine(a=first, d=rest[0] if rest else first)
    if name in ("skewX", "skewY"):
        slant = math.tan(math.radians(first))
        return Affine(c=slant) if name == "skewX" else Affine(b=slant)
    raise ValueError(name)


def _turn(angle: float) -> Affine:
    return Affine(math.cos(angle), math.sin(angle), -math.sin(angle), math.cos(angle))
