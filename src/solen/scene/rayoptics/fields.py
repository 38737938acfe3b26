"""Keys of one object in the file, read with their defaults; a missing key or a value of the wrong type is an error.

In the file y points down; in solen z points up. With (x, z) = (x, −y) an image keeps its orientation.
"""

import builtins
import math
from dataclasses import dataclass, field
from typing import Any, TypeVar

from solen.plane import Point
from solen.scene.rayoptics.formula import number_in
from solen.scene.rayoptics.modules import Expression

GREEN_NM = 540.0
"""Default wavelength of a source or filter."""

T = TypeVar("T")

MAX_NUMBER = 1e12
"""Largest number in a file and largest coordinate from a formula; squares and products of such values remain finite."""


@dataclass(frozen=True)
class NotUnderstood:
    """Content of a file that was omitted: the object, its type, its key (None for the entire object) and the reason.

    ``object`` counts the objects in the file from 1; 0 is the scene itself.
    """

    object: int
    type: str
    key: str | None
    reason: str

    def __str__(self) -> str:
        what = "scene" if self.object == 0 else f"object {self.object}, {self.type}"
        return f"{what}{'' if self.key is None else f', {self.key}'}: {self.reason}"


class UnreadableError(Exception):
    """An object that cannot be read, with the invalid key and the reason."""

    def __init__(self, key: str | None, reason: str) -> None:
        super().__init__(reason)
        self.key = key
        self.reason = reason


@dataclass
class Fields:
    """Object ``number`` of the file, of the given type; ``unread`` contains the keys that have not been read yet."""

    number: int
    type: str
    data: dict[str, Any]
    unread: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.unread = set(self.data) - {"type", "name"}

    def _value(self, key: str) -> Any:
        self.unread.discard(key)
        return self.data.get(key)

    def number_of(
        self, key: str, default: float | None = None, *, above: float = -math.inf, least: float = -math.inf
    ) -> float:
        """Read a finite number within limits."""
        value = self._value(key)
        number = default if default is not None and key not in self.data else finite(key, value)
        if not number > above:
            raise UnreadableError(key, f"must be above {above:g}, not {number:g}")
        if not number >= least:
            raise UnreadableError(key, f"must be at least {least:g}, not {number:g}")
        return number

    def _of_type(self, key: str, kind: builtins.type[T], default: T, what: str) -> T:
        value = self._value(key)
        if value is None:
            return default
        if not isinstance(value, kind):
            raise UnreadableError(key, f"must be {what}, not {shown(value)}")
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """Read true or false."""
        return self._of_type(key, bool, default, "true or false")

    def string(self, key: str, default: str) -> str:
        """Read a string."""
        return self._of_type(key, str, default, "a string")

    def point(self, key: str) -> Point:
        """Read a point."""
        return point_of(key, self._value(key))

    def items(self, key: str, default: list[dict[str, Any]] | None = None) -> list[dict[str, Any]]:
        """Read a list of objects."""
        value = self._value(key)
        if value is None and default is not None:
            return default
        if not isinstance(value, list) or not all(isinstance(item, dict) for item in value):
            raise UnreadableError(key, f"must be a list of objects, not {shown(value)}")
        return value

    def numbers(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """Read a list of numbers."""
        value = self._value(key)
        if value is None:
            return default
        if not isinstance(value, list):
            raise UnreadableError(key, f"must be a list of numbers, not {shown(value)}")
        return tuple(finite(f"{key}[{i}]", item) for i, item in enumerate(value))

    def formula(self, key: str, variable: str, default: str) -> Expression:
        """Read a formula with one variable."""
        value = self._value(key)
        return expression(key, default if value is None else value, variable)

    def skip(self, *keys: str) -> None:
        """Mark keys that do not affect light as read."""
        self.unread -= set(keys)


def expression(key: str, value: Any, variable: str) -> Expression:
    """Return a formula with one variable; a number becomes a constant formula."""
    if isinstance(value, Expression):
        return value.in_variable(variable)
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = repr(finite(key, value))
    if not isinstance(value, str):
        raise UnreadableError(key, f"must be a formula, not {shown(value)}")
    return Expression(value, (variable,))


def finite(key: str, value: Any) -> float:
    """Return the value as a finite number."""
    if value is None:
        raise UnreadableError(key, "is missing")
    number = number_in(value)
    if number is None:
        raise UnreadableError(key, f"must be a number, not {shown(value)}")
    if not abs(number) <= MAX_NUMBER:
        raise UnreadableError(key, f"must be a finite number of at most {MAX_NUMBER:g}, not {shown(value)}")
    return number


def point_of(key: str, value: Any) -> Point:
    """Return {x, y} as (x, z) in mm."""
    if value is None:
        raise UnreadableError(key, "is missing")
    if not isinstance(value, dict):
        raise UnreadableError(key, f"must be a point, not {shown(value)}")
    return (finite(f"{key}.x", value.get("x")), -finite(f"{key}.y", value.get("y")))


def shown(value: object) -> str:
    """Return the repr of a value, truncated to 40 characters."""
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
