"""One design at all angles and emitter-position bins, in one call of compiled code.

A `DesignBatch` contains the arrays for this call: the tables, rays and sums for all angles and bins, concatenated.
`DesignBatch.trace` fills them with compiled code and returns the power at both receivers for each angle and bin.
Because no Python runs between the poses, a design takes only a few milliseconds.
"""

import math
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.trace.kernel.batch import Starts, Tasks, trace_tasks, trace_tasks_in_space
from solen.trace.kernel.buffers import BLOCK, Rows, new_buffers
from solen.trace.kernel.designs import Bins, Sensors, launch_all, launch_all_in_space, prepare
from solen.trace.kernel.extruded import RowsInSpace, Slab, buffers_in_space
from solen.trace.kernel.rows import Precision, Treatment
from solen.trace.kernel.step import Rules
from solen.trace.kernel.surface import SPLITTING
from solen.trace.kernel.y_tables import WALLS
from solen.trace.result import TRUNCATED, Limits, Mode
from solen.trace.sums import of_tasks
from solen.trace.tables import LAYER_WIDTH, WIDTH, Tables

DOUBLE = Precision.of(np.float64)
REGIONS, RECEIVERS = 2, 2


class BatchPowers(NamedTuple):
    """Powers for one design, by angle and bin."""

    power: FloatArray
    """(A, B, 2), at the right and left receiver"""
    truncated: FloatArray
    """(A, B), truncated power"""
    soundness: IntArray
    """(A,), codes defined in `solen.trace.kernel.y_tables`"""


@dataclass
class DesignBatch:
    """Arrays for one design at A angles and B bins, with ``rays_per_bin`` rays per angle and bin."""

    angle_deg: FloatArray
    bins: int
    rays_per_bin: int
    max_pieces: int
    mode: Mode
    in_space: bool
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        angles = len(self.angle_deg)
        tasks = angles * self.bins
        self.tables = _empty_tables(angles, angles * (self.max_pieces + WALLS))
        no_rows = np.zeros(angles + 1, np.int64)
        self.starts = Starts(
            piece=np.zeros(angles + 1, np.int64),
            wavelength=np.arange(angles + 1),
            monitor=no_rows,
            cell=2 * np.arange(angles + 1),
            item=no_rows,
            treatment=no_rows,
            layer=no_rows,
        )
        ends = np.arange(tasks + 1)
        self.tasks = Tasks(
            scene=np.repeat(np.arange(angles), self.bins),
            first=np.zeros(tasks, np.int64),
            step=np.ones(tasks, np.int64),
            ray=self.rays_per_bin * ends,
            receiver=RECEIVERS * ends,
            monitor=np.zeros(tasks + 1, np.int64),
            bin=np.zeros(tasks + 1, np.int64),
        )
        self.sums = of_tasks(tasks, RECEIVERS * tasks)
        self.poses, self.soundness = np.zeros((angles, 3)), np.zeros(angles, np.int64)
        columns = [np.zeros(tasks * self.rays_per_bin) for _ in range(11 if self.in_space else 6)]
        rows: Any = RowsInSpace if self.in_space else Rows
        self.rays = rows(*columns, np.zeros(tasks * self.rays_per_bin, np.int64))
        self.rules = Rules(
            SPLITTING[self.mode], np.float64(self.limits.min_weight), self.limits.max_hits, 0, 0, 1, False
        )
        self.waiting = 64 * BLOCK
        self._allocate()

    def trace(self, sensors: Sensors, d: int, bins: Bins, seed: int) -> BatchPowers:
        """Trace design number ``d`` and return its powers, which are 0 if the body is unsound."""
        self.prepare(sensors, d, bins, seed)
        while not self._fits(sensors, d):
            self.waiting *= 2
            self._allocate()
        power = self.sums.detected.reshape(len(self.angle_deg), self.bins, RECEIVERS).copy()
        truncated = self.sums.fate[:, TRUNCATED].reshape(len(self.angle_deg), self.bins).copy()
        return BatchPowers(power, truncated, self.soundness.copy())

    def prepare(self, sensors: Sensors, d: int, bins: Bins, seed: int) -> None:
        """Compute the tables and rays of design number ``d``."""
        prepare(sensors, d, self.angle_deg, self.tables, self.starts, self.poses, self.soundness)
        launch: Any = launch_all_in_space if self.in_space else launch_all
        launch(sensors, d, self.tables, self.starts, self.poses, bins, seed, self.rays, self.rays_per_bin)

    def _fits(self, sensors: Sensors, d: int) -> bool:
        """Trace the rays; return whether the buffers were large enough for all waiting branches."""
        for column in (self.sums.fate, self.sums.detected, self.sums.arrived, self.sums.optical, self.sums.counts):
            column[...] = 0
        if np.any(self.soundness < 0):
            return True
        if self.in_space:
            slab = Slab(0.5 * float(sensors.thickness[d]), 1.0, 1.0)
            return trace_tasks_in_space(
                DOUBLE, self.tables, self.starts, self.tasks, self.sums, self.rays, self.rules, slab, self.buffers
            )
        return trace_tasks(
            DOUBLE, self.tables, self.starts, self.tasks, self.sums, self.rays, self.rules, self.buffers, None, 0,
            len(self.tasks.scene),
        )  # fmt: skip

    def _allocate(self) -> None:
        self.buffers: Any = (
            buffers_in_space(self.waiting)
            if self.in_space
            else new_buffers(self.rays_per_bin, np.float64, self.waiting)
        )


def _empty_tables(scenes: int, pieces: int) -> Tables:
    """Allocate tables for scenes with two media and one wavelength each, with a total of ``pieces`` curve pieces."""

    def ints(count: int) -> IntArray:
        return np.zeros(count, np.int64)

    return Tables(
        kind=ints(pieces), shape=np.zeros((pieces, WIDTH)), middle=np.zeros((pieces, 2)), box=np.zeros((pieces, 4)),
        owner=ints(pieces), previous=ints(pieces), behaviour=ints(pieces), treatment=ints(pieces), left=ints(pieces),
        right=ints(pieces), receiver=ints(pieces), height=np.zeros((pieces, 2)),
        refractive_index=np.ones((scenes, REGIONS)), absorption=np.zeros((scenes, REGIONS)),
        scattering=np.zeros((scenes, REGIONS)), anisotropy=np.zeros((scenes, REGIONS)),
        wavelength=np.full(scenes, math.nan), treatments=np.zeros((0, len(Treatment._fields))),
        layers=np.zeros((0, LAYER_WIDTH)), monitor=np.zeros((0, 5)), bins=ints(0), first_bin=ints(0),
        grid_low=np.zeros(2 * scenes), grid_cell=np.ones(2 * scenes), grid_count=np.ones(2 * scenes, np.int64),
        grid_first=ints(2 * scenes), grid_item=ints(0),
    )  # fmt: skip
