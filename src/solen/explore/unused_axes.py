"""Keys of a sweep that change neither the response nor the resolution at any of its points.

Public names: `unused_on_grid` and `unused_in_samples`.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from solen.explore.axes import Axis
from solen.explore.store import Point

TRIAL_SAMPLES = 3
"""Number of samples in which each key is varied alone."""


def unused_on_grid(axes: Sequence[Axis], points: Sequence[Point]) -> list[str]:
    """Return the keys along whose axes all points are equal; the last axis varies fastest."""
    index = {point.content: k for k, point in enumerate(points)}
    contents = np.array([index[point.content] for point in points]).reshape([len(axis.values) for axis in axes])
    return [axis.key for k, axis in enumerate(axes) if len(axis.values) > 1 and not np.diff(contents, axis=k).any()]


def unused_in_samples(
    axes: Sequence[Axis],
    values: Sequence[Mapping[str, Any]],
    points: Sequence[Point],
    traced: Callable[[Sequence[Mapping[str, Any]]], Sequence[Point]],
) -> Iterator[str]:
    """Yield the keys that, varied alone over their list or to both ends of their range, change no sample tried."""
    trials = [sample for sample, point in enumerate(points) if point.is_traced][:TRIAL_SAMPLES]
    for axis in axes:
        varied = [{**values[sample], axis.key: value} for sample in trials for value in axis.values]
        unchanged = [points[sample].content for sample in trials for _ in axis.values]
        if len(axis.values) > 1 and unchanged == [point.content for point in traced(varied)]:
            yield axis.key
