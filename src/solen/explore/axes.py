"""Axes of a sweep: the numbers of a design that vary, and their values.

Public names: `axis`, `grid` and `sampled`.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from solen.errors import SpecError
from solen.explore.sobol import sobol
from solen.spec import Design, parse_assignment, value_at

MAX_POINTS = 1_000_000
"""Largest number of points of a sweep, or of one part of it, whose responses fit in memory."""
FORMS = "write KEY=FROM:TO:NUMBER, KEY=VALUE,VALUE,... or, with --samples, KEY=FROM:TO"


@dataclass(frozen=True)
class Axis:
    """One key of the design and its values; the two ends of a range without a number of values."""

    key: str
    values: tuple[Any, ...]
    kind: Literal["list", "spaced", "range"] = "list"

    def at(self, share: float) -> Any:
        """Return the value at a fraction, 0 to 1, of the length of the axis."""
        if self.kind == "range":
            return self.values[0] + share * (self.values[1] - self.values[0])
        return self.values[min(int(share * len(self.values)), len(self.values) - 1)]


def axis(text: str, design: Design, option: str = "--over", forms: str = FORMS) -> Axis:
    """Parse the text of an option; raise `SpecError` if it is malformed or empty, or its key is not in the design."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (equals and key and values):
        raise SpecError(option, value=text, limit="is not a key with its values", remedy=forms)
    now = None if key == "name" else value_at(design, key)  # rejects an unknown key
    if ":" in values:
        return _spaced(f"{option} {key}", key, values, forms)
    listed = tuple(parse_assignment(f"{key}={part}")[1] for part in values.split(","))
    if isinstance(now, float) and any(isinstance(part, str) for part in listed):
        raise SpecError(f"{option} {key}", value=values, limit="contains a value that is not a number", remedy=forms)
    if any(part == "" for part in listed):
        raise SpecError(f"{option} {key}", value=values, limit="contains an empty value", remedy=forms)
    if len(set(map(str, listed))) < len(listed):
        raise SpecError(f"{option} {key}", value=values, limit="contains a value twice", remedy="omit one")
    return Axis(key, listed)


def check_not_set(option: str, texts: Sequence[str], assignments: Sequence[str] | None) -> None:
    """Raise `SpecError` if an assignment already sets the key of an option."""
    fixed = {parse_assignment(text)[0] for text in assignments or ()}
    for text in texts:
        for key in re.split(r"[-+*\s]+", text.partition("=")[0]):
            if key in fixed:
                limit = f"--set {key} sets the same key to a single value"
                raise SpecError(
                    f"{option} {key}", limit=limit, remedy="omit one of them, or write the value in the design"
                )


def _spaced(what: str, key: str, text: str, forms: str) -> Axis:
    """Return evenly spaced values, ``15:25:11``, or a range, ``15:25``."""
    try:
        low, high, *number = (float(part) for part in text.split(":"))
    except ValueError:
        raise SpecError(what, value=text, limit="does not consist of numbers", remedy=forms) from None
    if len(number) > 1 or not (math.isfinite(low) and math.isfinite(high)):
        raise SpecError(what, value=text, limit="is not a range", remedy=forms)
    if low == high:
        raise SpecError(
            what, value=text, limit="is an empty range", remedy="specify two different limits, or a single value"
        )
    if not number:
        return Axis(key, (low, high), "range")
    if not math.isfinite(number[0]) or number[0] != int(number[0]) or number[0] < 2:
        raise SpecError(what, value=f"{number[0]:g}", limit="the number of values must be an integer of at least 2")
    _check_number(int(number[0]))
    return Axis(key, tuple(np.linspace(low, high, int(number[0])).tolist()), "spaced")


def check_axes(axes: Sequence[Axis], samples: int | None, part: str | None = None) -> range:
    """Return the numbers of the points of a sweep, or of a part of it such as ``3/10``.

    Raises
    ------
    SpecError
        If a key is stated twice, a range is not sampled, or there are too many points.
    """
    if not axes:
        raise SpecError("--over", limit="a sweep requires at least one axis", remedy=FORMS)
    keys = [one.key for one in axes]
    twice = next((key for key in keys if keys.count(key) > 1), None)
    if twice:
        raise SpecError(f"--over {twice}", limit="is specified twice", remedy="put all values of the key in one --over")
    for one in axes:
        ends = ":".join(f"{value:g}" for value in (one.values[0], one.values[-1])) if one.kind != "list" else ""
        if one.kind == "range" and samples is None:
            limit = "is a range without a number of values"
            raise SpecError(f"--over {one.key}", value=ends, limit=limit, remedy="add :NUMBER or --samples N")
        if one.kind == "spaced" and samples is not None:
            limit, remedy = "--samples draws its own values from a range", f"write --over {one.key}={ends}"
            raise SpecError(f"--over {one.key}", value=f"{len(one.values)} values", limit=limit, remedy=remedy)
    number = math.prod(len(one.values) for one in axes) if samples is None else samples
    points = range(number) if part is None else _part(part, number)
    _check_number(len(points))
    return points


def _part(text: str, number: int) -> range:
    """Return the numbers of the points in one of several parts of equal size."""
    place, slash, parts = text.partition("/")
    if not (slash and place.isdecimal() and parts.isdecimal() and 1 <= int(place) <= int(parts) <= number):
        limit = f"is not a valid part of {number:,} points"
        raise SpecError("--part", value=text, limit=limit, remedy="write NUMBER/PARTS, as in 3/10")
    return range((int(place) - 1) * number // int(parts), int(place) * number // int(parts))


def _check_number(points: int) -> None:
    if points > MAX_POINTS:
        remedy = "use fewer values, --samples N with ranges, or --part 1/N and so on"
        raise SpecError("points", value=f"{points:,}", limit=f"a sweep has at most {MAX_POINTS:,}", remedy=remedy)


def grid(axes: Sequence[Axis], points: range | None = None) -> Iterator[dict[str, Any]]:
    """Return combinations of the values by the numbers of the points, all by default; the last axis varies fastest."""
    for number in range(math.prod(len(one.values) for one in axes)) if points is None else points:
        values = {}
        for one in reversed(axes):
            number, place = divmod(number, len(one.values))
            values[one.key] = one.values[place]
        yield {one.key: values[one.key] for one in axes}


def sampled(axes: Sequence[Axis], points: range, seed: int) -> Iterator[dict[str, Any]]:
    """Return the points of a scrambled Sobol' sequence; values of a list are drawn with equal probability."""
    for row in sobol(len(axes), len(points), np.random.default_rng(seed), points.start).tolist():
        yield {one.key: one.at(share) for one, share in zip(axes, row, strict=True)}
