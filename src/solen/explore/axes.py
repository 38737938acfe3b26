"""Axes of a sweep: the keys of a design that vary, and their values.

Public names: `axis`, `check_axes`, `grid` and `sampled`.
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
from solen.spec.strict import repeated

MAX_POINTS = 1_000_000
"""Largest number of points of a sweep, or of one part of it; their responses must fit in memory."""
FORMS = "write KEY=FROM:TO:NUMBER, KEY=VALUE,VALUE,... or, with --samples, KEY=FROM:TO"


@dataclass(frozen=True)
class Axis:
    """One key of the design and its values; for a range to be sampled at random, the values are its two ends."""

    key: str
    values: tuple[Any, ...]
    kind: Literal["list", "spaced", "range"] = "list"

    def at(self, fraction: float) -> Any:
        """Return the value at a fraction, 0 to 1, of the length of the axis."""
        if self.kind == "range":
            return self.values[0] + fraction * (self.values[1] - self.values[0])
        return self.values[min(int(fraction * len(self.values)), len(self.values) - 1)]


def axis(text: str, design: Design, option: str = "--over", forms: str = FORMS) -> Axis:
    """Parse the value of an option; raise `SpecError` if it is malformed or empty, or its key is not in the design."""
    key, equals, values = (part.strip() for part in text.partition("="))
    if not (equals and key and values):
        raise SpecError(option, value=text, limit="is not a key with its values", remedy=forms)
    current = None if key == "name" else value_at(design, key)  # rejects an unknown key
    if ":" in values:
        return _spaced(f"{option} {key}", key, values, forms)
    listed = tuple(parse_assignment(f"{key}={part}")[1] for part in values.split(","))
    if isinstance(current, float) and any(isinstance(part, str) for part in listed):
        raise SpecError(f"{option} {key}", value=values, limit="contains a value that is not a number", remedy=forms)
    if any(part == "" for part in listed):
        raise SpecError(f"{option} {key}", value=values, limit="contains an empty value", remedy=forms)
    if len(set(map(str, listed))) < len(listed):
        raise SpecError(f"{option} {key}", value=values, limit="contains a value twice", remedy="omit the duplicate")
    return Axis(key, listed)


def check_not_set(option: str, texts: Sequence[str], assignments: Sequence[str] | None) -> None:
    """Raise `SpecError` if an assignment already sets the key of an option."""
    fixed = {parse_assignment(text)[0] for text in assignments or ()}
    for text in texts:
        for key in re.split(r"[-+*\s]+", text.partition("=")[0]):
            if key in fixed:
                limit = f"--set {key} sets the same key to a single value"
                raise SpecError(
                    f"{option} {key}",
                    limit=limit,
                    remedy="omit one of the two options, or set the value in the design file",
                )


def _spaced(what: str, key: str, text: str, forms: str) -> Axis:
    """Return the axis of ``15:25:11``, eleven evenly spaced values, or of ``15:25``, a range with two ends."""
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
        limit = "the number of values must be an integer of at least 2"
        raise SpecError(what, value=f"{number[0]:g}", limit=limit, remedy=forms)
    _check_count(int(number[0]))
    return Axis(key, tuple(np.linspace(low, high, int(number[0])).tolist()), "spaced")


def check_axes(axes: Sequence[Axis], samples: int | None, part: str | None = None) -> range:
    """Return the indices of the points of a sweep, or of a part of it such as ``3/10``.

    Raises
    ------
    SpecError
        If a key is specified twice, a range has no number of values, or there are too many points.
    """
    if not axes:
        raise SpecError("--over", limit="a sweep requires at least one axis", remedy=FORMS)
    twice = repeated(axis.key for axis in axes)
    if twice:
        remedy = "put all values of the key in one --over"
        raise SpecError(f"--over {twice}", limit="is specified twice", remedy=remedy)
    for axis in axes:
        ends = ":".join(f"{value:g}" for value in (axis.values[0], axis.values[-1])) if axis.kind != "list" else ""
        if axis.kind == "range" and samples is None:
            limit = "is a range without a number of values"
            raise SpecError(f"--over {axis.key}", value=ends, limit=limit, remedy="add :NUMBER or --samples N")
        if axis.kind == "spaced" and samples is not None:
            limit, remedy = "must be a range with --samples", f"write --over {axis.key}={ends}"
            raise SpecError(f"--over {axis.key}", value=f"{len(axis.values)} values", limit=limit, remedy=remedy)
    count = math.prod(len(axis.values) for axis in axes) if samples is None else samples
    points = range(count) if part is None else _part(part, count)
    _check_count(len(points))
    return points


def _part(text: str, count: int) -> range:
    """Return the indices of the points in one of several parts of equal size."""
    number, slash, parts = text.partition("/")
    if not (slash and number.isdecimal() and parts.isdecimal() and 1 <= int(number) <= int(parts) <= count):
        limit = f"is not a valid part of {count:,} points"
        raise SpecError("--part", value=text, limit=limit, remedy="write NUMBER/PARTS, as in 3/10")
    return range((int(number) - 1) * count // int(parts), int(number) * count // int(parts))


def _check_count(points: int) -> None:
    if points > MAX_POINTS:
        remedy = "use fewer values, --samples N with ranges, or trace the sweep in parts: --part 1/N, --part 2/N, ..."
        raise SpecError("points", value=f"{points:,}", limit=f"a sweep has at most {MAX_POINTS:,}", remedy=remedy)


def grid(axes: Sequence[Axis], points: range | None = None) -> Iterator[dict[str, Any]]:
    """Yield the points with the given indices, by default all, of a grid; the last axis varies fastest."""
    shape = [len(axis.values) for axis in axes]
    for point in range(math.prod(shape)) if points is None else points:
        indices = np.unravel_index(point, shape)
        yield {axis.key: axis.values[index] for axis, index in zip(axes, indices, strict=True)}


def sampled(axes: Sequence[Axis], points: range, seed: int) -> Iterator[dict[str, Any]]:
    """Yield points of a scrambled Sobol' sequence; values of a list have equal probability."""
    for row in sobol(len(axes), len(points), np.random.default_rng(seed), points.start).tolist():
        yield {axis.key: axis.at(fraction) for axis, fraction in zip(axes, row, strict=True)}
