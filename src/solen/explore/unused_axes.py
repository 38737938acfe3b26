"""Keys of a sweep that change neither the response nor the resolution at any of its points.

Public names: `unused_on_grid` and `unused_in_samples`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from solen.explore.axes import Axis
from solen.explore.store import Point

TRIED = 3
"""Number of samples in which each number is varied alone."""


def unused_on_grid(axes: Sequence[Axis], points: Sequence[Point]) -> list[str]:
    """Return the keys along whose axes all points are equal; the last axis varies fastest."""
    same = {point.content: place for place, point in enumerate(points)}
    kinds = np.array([same[point.content] for point in points]).reshape([len(axis.values) for axis in axes])
    return [
        axis.key for place, axis in enumerate(axes) if len(axis.values) > 1 and not np.diff(kinds, axis=place).any()
    ]


def unused_in_samples(
    axes: Sequence[Axis],
    values: Sequence[Mapping[str, Any]],
    points: Sequence[Point],
    traced: Callable[[Sequence[Mapping[str, Any]]], Sequence[Point]],
) -> Iterator[str]:
    """Return the keys that change none of a few samples when varied alone over a list, or to both ends of a range."""
    finished = [place for place, point in enumerate(points) if point.is_traced][:TRIED]
    for axis in axes:
        moved = [{**values[place], axis.key: value} for place in finished for value in axis.values]
        own = [points[place].content for place in finished for _ in axis.values]
        if len(axis.values) > 1 and own == [point.content for point in traced(moved)]:
            yield axis.key
