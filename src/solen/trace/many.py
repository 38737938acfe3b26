"""Many scenes in one call, for example positions of a motion or variants of a design, each with few rays.

The tables and rays of all scenes are concatenated and traced with one compiled call per thread, without Python in
between. The results are bit-identical to those of `solen.trace.trace`, unless a source has more rays than two chunks.
"""

import os
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import IntArray
from solen.curve import check_count
from solen.errors import DesignError
from solen.scene import Scene
from solen.trace.chunks import DTYPES, Chunk, Digits, Job, chunks, rows_of, rules_of
from solen.trace.kernel import batch, tally
from solen.trace.kernel.buffers import BLOCK, Rows, new_buffers
from solen.trace.result import Limits, Mode, Trace, check_choice, check_mode
from solen.trace.sums import empty, of_tasks, result
from solen.trace.tables import Tables

Task = tuple[int, Chunk]
RECEIVERS, MONITORS = ("detected", "arrived", "optical"), ("crossed", "crossings")
ROWS = ("fate", "counts", "location")


def trace_many(
    scenes: Sequence[Scene],
    mode: Mode = "count",
    limits: Limits | None = None,
    *,
    seed: int = 0,
    precision: Digits = "double",
    threads: int | None = None,
) -> list[Trace]:
    """Trace the regular rays of every source in every scene.

    Parameters and errors are those of `solen.trace.trace`. All rays are in memory at once, and the error of single
    precision is not reported; the function is intended for few rays in many scenes.
    """
    check_mode(mode)
    check_choice("precision", precision, tuple(DTYPES))
    check_count("seed", seed, 0)
    threads = (os.cpu_count() or 1) if threads is None else threads
    check_count("threads", threads, 1)
    if not scenes:
        return []
    if any(scene.extrusion is not None for scene in scenes):
        limit, remedy = "must be in the plane for trace_many", "trace each extruded scene separately"
        raise DesignError("scenes", limit=limit, remedy=remedy)
    jobs = [Job.of(scene, mode, limits or Limits(), DTYPES[precision], seed=seed) for scene in scenes]
    tasks = [(i, make()) for i, job in enumerate(jobs) for make in chunks(job, job.scene.rays)]
    batched = _Batch(jobs, tasks)
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda ends: batched.trace(*ends), pairwise(batched.bounds(threads))))
    return batched.results()


class _Batch:
    """Tables, rays and sums of all scenes, concatenated."""

    def __init__(self, jobs: list[Job], tasks: list[Task]) -> None:
        self.jobs, self.tasks = jobs, tasks
        self.tables, self.starts = _joined([job.tables for job in jobs])
        rays = [rows_of(jobs[i], chunk) for i, chunk in tasks]
        self.rays = Rows(*(np.concatenate(column) for column in zip(*rays, strict=True)))
        receivers = [len(jobs[i].scene.receivers) for i, _ in tasks]
        monitors = [len(jobs[i].scene.monitors) for i, _ in tasks]
        bins = [int(jobs[i].tables.bins.sum()) for i, _ in tasks]
        self.layout = batch.Tasks(
            scene=np.array([i for i, _ in tasks], dtype=np.int64),
            first=np.array([chunk.first for _, chunk in tasks], dtype=np.int64),
            step=np.array([chunk.step for _, chunk in tasks], dtype=np.int64),
            ray=_starts(len(chunk.launch) for _, chunk in tasks),
            receiver=_starts(receivers),
            monitor=_starts(monitors),
            bin=_starts(bins),
        )
        self.sums = of_tasks(len(tasks), sum(receivers), sum(monitors), sum(bins))

    def bounds(self, threads: int) -> list[int]:
        """Return the first task of each thread, and the end of the last; threads have about equal numbers of rays."""
        rays = self.layout.ray
        inner = np.searchsorted(rays, np.arange(1, threads) * rays[-1] / threads)
        return [0, *(int(task) for task in inner), len(self.tasks)]

    def trace(self, begin: int, stop: int) -> None:
        """Trace a range of tasks; repeat it with more memory if necessary."""
        max_rays = int(np.diff(self.layout.ray[begin : stop + 1]).max(initial=0))
        job, waiting = self.jobs[0], 64 * BLOCK
        rules = rules_of(job, self.tasks[0][1])._replace(turbid=any(job.scene.is_turbid for job in self.jobs))
        dtype = job.tables.shape.dtype.type
        treatments = self.tables.treatments if len(self.tables.treatments) else None
        while not batch.trace_tasks(
            job.constants, self.tables, self.starts, self.layout, self.sums, self.rays, rules,
            new_buffers(max_rays, dtype, waiting), treatments, begin, stop,
        ):  # fmt: skip
            waiting *= 2
            self._clear(begin, stop)

    def _clear(self, begin: int, stop: int) -> None:
        """Clear the sums for a range of tasks."""
        for name in tally.Sums._fields:
            column = self._part(name, begin, stop)
            column[...] = np.nan if name == "location" else 0

    def _part(self, name: str, begin: int, stop: int) -> NDArray[Any]:
        """Return the section of a sum array that belongs to a range of tasks."""
        starts: dict[str, IntArray] = {
            **dict.fromkeys(RECEIVERS, self.layout.receiver),
            **dict.fromkeys(MONITORS, self.layout.monitor),
            "maps": self.layout.bin,
        }
        column: NDArray[Any] = getattr(self.sums, name)
        if name in ROWS:
            return column[begin:stop]
        return column[starts[name][begin] : starts[name][stop]] if name in starts else column

    def _task_sums(self, task: int) -> tally.Sums:
        """Return the sums of a single task."""
        parts = {name: self._part(name, task, task + 1) for name in tally.Sums._fields}
        for name in ROWS:
            parts[name] = parts[name][0]
        receivers = len(self.jobs[self.tasks[task][0]].scene.receivers)
        return tally.Sums(**{**parts, "angle": np.zeros((receivers, 0))})

    def results(self) -> list[Trace]:
        """Return the trace of each scene."""
        parts: list[list[list[tally.Sums]]] = [[[] for _ in job.scene.sources] for job in self.jobs]
        rays = [[np.zeros(job.groups(source), dtype=np.int64) for source in job.scene.sources] for job in self.jobs]
        for task, (i, chunk) in enumerate(self.tasks):
            while len(parts[i][chunk.source]) < chunk.group:  # a group without rays has no task
                parts[i][chunk.source].append(empty(self.jobs[i]))
            parts[i][chunk.source].append(self._task_sums(task))
            rays[i][chunk.source][chunk.group] += len(chunk.launch)
        for job, sources in zip(self.jobs, parts, strict=True):
            for source, groups in zip(job.scene.sources, sources, strict=True):
                groups.extend(empty(job) for _ in range(job.groups(source) - len(groups)))
        return [result(job, *data, None) for job, data in zip(self.jobs, zip(parts, rays, strict=True), strict=True)]


def _starts(lengths: Iterable[int]) -> IntArray:
    """Return the start of each item and the end of the last, from the item lengths."""
    return np.cumsum([0, *lengths], dtype=np.int64)


def _joined(tables: list[Tables]) -> tuple[Tables, batch.Starts]:
    """Concatenate tables; also return the first row of each."""
    regions = max(part.refractive_index.shape[1] for part in tables)

    def column(name: str) -> NDArray[Any]:
        parts: list[NDArray[Any]] = [getattr(part, name) for part in tables]
        if name in {"refractive_index", "absorption", "scattering", "anisotropy"}:
            parts = [np.pad(part, ((0, 0), (0, regions - part.shape[1]))) for part in parts]
        return np.concatenate(parts)

    starts = batch.Starts(
        piece=_starts(len(part.kind) for part in tables),
        wavelength=_starts(len(part.refractive_index) for part in tables),
        monitor=_starts(len(part.bins) for part in tables),
        cell=_starts(len(part.grid_first) for part in tables),
        item=_starts(len(part.grid_item) for part in tables),
        treatment=_starts(len(part.treatments) for part in tables),
        layer=_starts(len(part.layers) for part in tables),
    )
    return Tables(**{name: column(name) for name in Tables._fields}), starts
