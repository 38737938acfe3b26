"""A trace job, and the division of its rays into chunks.

The size of a chunk does not depend on the machine. The rays are divided into *groups*, each of which gives an estimate
of the powers: the even and the odd rays of a lattice, or sixteen independent samples.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np

from solen.arrays import FloatArray
from solen.scene import Launch, Scene, Source
from solen.scene.sources.points import COPIES, sample
from solen.trace.kernel.buffers import Rows
from solen.trace.kernel.extruded import RowsInSpace
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.step import Rules
from solen.trace.kernel.surface import SPLITTING
from solen.trace.result import Limits, Mode
from solen.trace.tables import Tables, compile_scene

HALVES, REPLICATES = 2, COPIES
DTYPES: dict[str, type[np.floating[Any]]] = {"double": np.float64, "single": np.float32}
Sampling = Literal["fan", "sobol"]
Device = Literal["cpu", "cuda"]
Digits = Literal["double", "single"]


@dataclass(frozen=True, eq=False)
class Job:
    """Data common to all chunks of a trace."""

    scene: Scene
    tables: Tables
    constants: Precision
    mode: Mode
    limits: Limits
    sampling: Sampling = "fan"
    seed: int = 0
    position_bins: int = 0
    angle_bins: int = 0
    segments: bool = False
    device: Device = "cpu"

    @classmethod
    def of(cls, scene: Scene, mode: Mode, limits: Limits, dtype: type[np.floating[Any]], **rest: Any) -> "Job":
        """Return the job for a scene at a given precision; ``rest`` supplies the remaining fields by name."""
        return cls(scene, compile_scene(scene, dtype), Precision.of(dtype), mode, limits, **rest)

    def groups(self, source: Source) -> int:
        """Return the number of groups into which the rays of a source are divided."""
        regular = self.sampling == "fan" and self.mode != "roulette" and not self.scene.is_random
        return HALVES if regular and source.copies(self.scene.extrusion is not None) == 1 else REPLICATES


@dataclass(frozen=True, eq=False)
class Chunk:
    """Rays of one source and one group: every ``step``-th ray from number ``first`` on, counted over all sources."""

    source: int
    group: int
    first: int
    step: int
    launch: Launch


def chunks(job: Job, max_rays: int) -> Iterator[Callable[[], Chunk]]:
    """Yield functions that create the chunks, by source and group, each with at most ``max_rays`` rays."""
    offset, in_space = 0, job.scene.extrusion is not None
    for index, source in enumerate(job.scene.sources):
        if job.sampling == "fan":
            yield from _fan_chunks(source, index, offset, job.groups(source), max_rays, in_space)
            offset += source.rays
        else:
            sample_size = _sample_size(source)
            yield from _sample_chunks(source, index, offset, sample_size, job.seed, max_rays, in_space)
            offset += REPLICATES * sample_size


def _fan_chunks(
    source: Source, index: int, offset: int, groups: int, max_rays: int, in_space: bool
) -> Iterator[Callable[[], Chunk]]:
    def make(first: int, stop: int, group: int) -> Chunk:
        numbers = np.arange(first, stop, groups, dtype=float)
        return Chunk(index, group, offset + first, groups, source.launch(numbers, in_space))

    for group in range(groups):
        for first in range(group, source.rays, max_rays * groups):
            yield partial(make, first, min(first + max_rays * groups, source.rays), group)


def _sample_size(source: Source) -> int:
    """Return the number of rays in each replicate: a power of two, for which Sobol' points are balanced."""
    return 1 << math.ceil(math.log2(max(source.rays / REPLICATES, 1.0)))


def _sample_chunks(
    source: Source, index: int, offset: int, sample_size: int, seed: int, max_rays: int, in_space: bool
) -> Iterator[Callable[[], Chunk]]:
    def make(draw: Callable[[int, int], FloatArray], start: int, group: int) -> Chunk:
        launch = source.launch_at(draw(start, min(start + max_rays, sample_size)), REPLICATES * sample_size, in_space)
        return Chunk(index, group, offset + group * sample_size + start, 1, launch)

    for group in range(REPLICATES):
        draw = sample(source.dimensions(in_space), (seed, index, group))
        for start in range(0, sample_size, max_rays):
            yield partial(make, draw, start, group)


def rows_of(job: Job, chunk: Chunk) -> Rows:
    """Return the rays of a chunk in the kernel's format."""
    launch, dtype = chunk.launch, job.tables.shape.dtype.type
    spectrum = job.scene.sources[chunk.source].spectrum
    colours = np.array([job.scene.wavelengths_nm.index(nm) for nm, _ in spectrum] or [0], dtype=np.int64)
    columns = (launch.x_mm, launch.z_mm, launch.dx, launch.dz, launch.power_s, launch.power_p)
    x, z, dx, dz, s, p = (column.astype(dtype, copy=False) for column in columns)
    return Rows(x, z, dx, dz, s, p, colours[launch.line])


def rows_in_space(job: Job, chunk: Chunk) -> RowsInSpace:
    """Return the rays of a chunk of an extruded scene in the kernel's format."""
    launch, flat = chunk.launch, rows_of(job, chunk)
    if launch.y_mm is None or launch.dy is None:
        raise AssertionError("rays of an extruded scene are launched in space")
    zeros = np.zeros(len(launch.x_mm))
    behind = launch.behind
    extra = (zeros, zeros, zeros) if behind is None else (behind.cr, behind.ci, behind.optical_path_mm)
    return RowsInSpace(flat.x, launch.y_mm, flat.z, flat.dx, launch.dy, flat.dz, flat.s, flat.p, *extra, flat.colour)


def rules_of(job: Job, chunk: Chunk) -> Rules:
    """Return the propagation rules for the rays of a chunk."""
    min_weight: Any = job.tables.shape.dtype.type(job.limits.min_weight)
    turbid = job.scene.is_turbid
    return Rules(SPLITTING[job.mode], min_weight, job.limits.max_hits, job.seed, chunk.first, chunk.step, turbid)
