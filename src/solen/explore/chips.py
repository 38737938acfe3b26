"""Chips of a sweep that share their rays: points that differ only in the chip's width and decentre need one trace.

The compiled batch traces a design for a lattice of emitter positions, and the response to each chip is a weighted sum
over them (`solen.sensor.respond`).

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
"""Largest range of emitter positions, in widths of the narrowest chip, for which sharing rays saves time."""


def chips_of(design: Design, axes: Sequence[Axis]) -> tuple[Chip, ...]:
    """Return widths and decentres of a grid for one common trace; empty if that is impossible or saves no time."""
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
    """Return the indices of the points of a grid, ordered so that the chips of each design are consecutive."""
    shape = [len(axis.values) for axis in axes]
    indices = np.arange(math.prod(shape)).reshape(shape)
    is_chip_axis = [axis.key in KEYS for axis in axes]
    order: list[int] = indices.transpose(np.argsort(is_chip_axis, kind="stable").tolist()).ravel().tolist()
    return order
