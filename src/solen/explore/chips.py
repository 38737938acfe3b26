"""Chips of a sweep that share their rays: points that differ only in width and decentre need one trace.

The compiled batch traces a design for all positions of an emitter, and each chip is a weighted sum of these
(`solen.sensor.respond`).

Public names: `chips_of` and `chips_last`.
"""

import math
from collections.abc import Sequence
from itertools import product

import numpy as np

from solen.explore.axes import Axis
from solen.explore.store import Chip
from solen.sensor import Sensor
from solen.spec import Design

KEYS = ("emitter.width_mm", "emitter.offset_mm")
MAX_REACH = 8.0
"""Longest range of positions, in widths of the narrowest chip, for which sharing rays saves time."""


def chips_of(design: Design, axes: Sequence[Axis]) -> tuple[Chip, ...]:
    """Return widths and decentres of a grid to be traced together; empty if that is impossible or saves no time."""
    values = {axis.key: axis.values for axis in axes}
    sensor = Sensor.of(design)
    widths = values.get(KEYS[0], (sensor.light.width_mm,))
    offsets = values.get(KEYS[1], (sensor.design.emitter.offset_mm,))
    if not all(isinstance(value, int | float) for value in (*widths, *offsets)):
        return ()
    chips = tuple((float(width), float(offset)) for width, offset in product(widths, offsets))
    if len(chips) < 2 or min(widths) <= 0.0 or max(offsets) - min(offsets) + max(widths) > MAX_REACH * min(widths):
        return ()
    return chips


def chips_last(axes: Sequence[Axis]) -> list[int]:
    """Return the numbers of the points of a grid, ordered so that the chips of each design follow one another."""
    numbers = np.arange(math.prod(len(axis.values) for axis in axes)).reshape([len(axis.values) for axis in axes])
    of_chips = [axis.key in KEYS for axis in axes]
    order: list[int] = numbers.transpose(np.argsort(of_chips, kind="stable").tolist()).ravel().tolist()
    return order
