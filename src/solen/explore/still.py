"""Keys of a sweep that change nothing: no response and no resolution, at any of its points.

The interface: `still_on_grid` of a grid, `still_in_samples` of samples, which traces a few more points.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from solen.explore.axes import Axis
from solen.explore.store import Point

TRIED = 3
"""Samples of which each number is moved alone."""


def still_on_grid(axes: Sequence[Axis], points: Sequence[Point]) -> list[str]:
    """Keys along whose axes all points are the same, the last axis running fastest."""
    same = {point.content: place for place, point in enumerate(points)}
    kinds = np.array([same[point.content] for point in points]).reshape([len(one.values) for one in axes])
    return [one.key for place, one in enumerate(axes) if len(one.values) > 1 and not np.diff(kinds, axis=place).any()]


def still_in_samples(
    axes: Sequence[Axis],
    values: Sequence[Mapping[str, Any]],
    points: Sequence[Point],
    traced: Callable[[Sequence[Mapping[str, Any]]], Sequence[Point]],
) -> Iterator[str]:
    """Keys that change none of a few samples where they alone take all values of a list, or both ends of a range."""
    finished = [place for place, point in enumerate(points) if point.is_traced][:TRIED]
    for one in axes:
        moved = [{**values[place], one.key: value} for place in finished for value in one.values]
        own = [points[place].content for place in finished for _ in one.values]
        if len(one.values) > 1 and own == [point.content for point in traced(moved)]:
            yield one.key
