"""The compiled engine: scene → tables → kernel → result.

Rays are traced in chunks whose size does not depend on the machine, with any number of threads, and the sums of the
chunks are added in order. The same scene therefore gives bit-identical results with one thread and with many. Only a
few chunks are in memory at a time, however many rays there are. A trace can be interrupted between chunks.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from itertools import islice
from typing import TYPE_CHECKING, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from solen.curve import check_count
from solen.errors import DesignError
from solen.extras import need
from solen.scene import Extrusion, Scene, Surface
from solen.trace.chunks import (
    DTYPES,
    Chunk,
    Device,
    Digits,
    Job,
    Sampling,
    chunks,
    rows_in_space,
    rows_of,
    rules_of,
)
from solen.trace.entry import add_entry_losses, scene_behind_face
from solen.trace.kernel import extruded, loop, tally
from solen.trace.kernel.buffers import BLOCK, Rows, new_buffers
from solen.trace.kernel.surface import SPLITTING
from solen.trace.result import Limits, Mode, Trace, check_choice, check_mode, in_order
from solen.trace.sums import add, empty, result, segments_of

if TYPE_CHECKING:
    from solen.trace.kernel.cuda import GpuScene

R = TypeVar("R")

CHUNK = 2**13
"""Number of rays per chunk in double precision, twice as many in single precision: with fewer, threads wait for the
interpreter; more exceed the CPU cache.
"""
GPU_CHUNK = 2**18
"""Number of rays sent to a GPU at a time."""
MAX_GPU_FEEDERS = 8
"""Maximum number of threads that prepare rays for a GPU, because waiting rays occupy memory."""
COMPARED_RAYS = 4096
"""Maximum number of rays per source for the comparison of single with double precision."""


def trace(
    scene: Scene,
    mode: Mode = "count",
    limits: Limits | None = None,
    *,
    sampling: Sampling = "fan",
    seed: int = 0,
    precision: Digits = "double",
    position_bins: int = 0,
    angle_bins: int = 0,
    segments: bool = False,
    device: Device = "cpu",
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Trace:
    """Trace every ray of every source.

    Parameters
    ----------
    scene
        The scene to trace.
    mode
        ``"count"``: refraction or total reflection, without splitting or absorption in media. ``"power"``: Fresnel's
        equations for s and p separately, both branches, absorption. ``"roulette"``: as power, but only one of the two
        branches is followed, chosen with probability proportional to its power (probabilistic ray splitting).
    limits
        When to stop following a ray; see `Limits`.
    sampling
        ``"fan"``: the regular rays defined by each source. ``"sobol"``: sixteen independent scrambled Sobol' samples,
        for extended emitters and spectra; the ray count of each source is rounded up to 16 times a power of two.
    seed
        Seed of all random numbers; equal seeds give identical results.
    precision
        ``"single"`` computes in float32, which is faster; the resulting error is reported as ``single_error``.
    position_bins, angle_bins
        Number of bins in each receiver histogram; see `solen.trace.Detected`.
    segments
        Whether to store each ray segment, from which ``paths()`` returns all ray paths; a segment takes about a hundred
        bytes.
    device
        ``"cuda"`` follows the rays on a GPU; it cannot be combined with ``segments`` and requires the extra ``cuda``.
    threads
        Number of threads, by default one per core; it does not affect the results. With a GPU, the threads prepare the
        rays.
    progress
        Function called with the number of rays traced so far. An exception that it raises ends the trace early.

    Returns
    -------
    Trace
        Powers as fractions of the emitted power, with the ledger.

    Raises
    ------
    DesignError
        For an unknown mode, sampling, precision or device, for numbers that are out of range, for a curve that the
        engine does not support, or if ``"cuda"`` finds no GPU.
    """
    check_mode(mode)
    check_choice("sampling", sampling, get_args(Sampling))
    check_choice("precision", precision, tuple(DTYPES))
    check_choice("device", device, get_args(Device))
    if segments and device == "cuda":
        raise DesignError("segments", value=segments, limit="are not supported on a GPU", remedy='use device="cpu"')
    if scene.extrusion is not None:
        _check_extruded(scene, precision, device, segments)
        scene = scene_behind_face(scene, mode)
    treated = scene.is_turbid or any(interface.surface is not None for interface in scene.interfaces)
    if treated and device == "cuda":
        limit = "cuda supports only surfaces that are smooth, clean and bare, and clear media"
        raise DesignError("device", value=device, limit=limit, remedy='use device="cpu"')
    threads = (os.cpu_count() or 1) if threads is None else threads
    check_count("threads", threads, 1)
    check_count("seed", seed, 0)
    for what, value in (("position_bins", position_bins), ("angle_bins", angle_bins)):
        check_count(what, value, 0)
    job = Job.of(
        scene,
        mode,
        limits or Limits(),
        DTYPES[precision],
        sampling=sampling,
        seed=seed,
        position_bins=position_bins,
        angle_bins=angle_bins,
        segments=segments,
        device=device,
    )
    traced = _run(job, threads, progress)
    return traced if precision == "double" else replace(traced, single_error=_single_error(job, threads))


def _check_extruded(scene: Scene, precision: str, device: str, segments: bool) -> None:
    """Raise `DesignError` for options and surfaces that are not supported in space."""
    for what, value, is_set in (
        ("precision", precision, precision != "double"),
        ("device", device, device != "cpu"),
        ("segments", segments, segments),
    ):
        if is_set:
            raise DesignError(what, value=value, limit="is supported only in the plane", remedy="omit it")
    for interface in scene.interfaces:
        surface = interface.surface or Surface()
        for key in ("focal_mm", "grating"):
            if getattr(surface, key) is not None:
                limit = "ideal elements and gratings are supported only in the plane"
                raise DesignError(f"interface {interface.name} {key}", limit=limit, remedy="omit extrusion")


def _traced(job: Job, threads: int) -> Iterator[tuple[Chunk, tally.Sums]]:
    """Yield the chunks in order, each with its sums."""
    if job.device == "cuda":
        gpu = _gpu_scene(job)

        def prepare(make: Callable[[], Chunk]) -> tuple[Chunk, Rows]:
            chunk = make()
            return chunk, rows_of(job, chunk)

        feeders = min(threads, MAX_GPU_FEEDERS) if job.scene.rays > GPU_CHUNK else 1
        for chunk, rows in _ahead(prepare, chunks(job, GPU_CHUNK), feeders):
            yield chunk, gpu.trace(rows, rules_of(job, chunk))
        return

    def work(make: Callable[[], Chunk]) -> tuple[Chunk, tally.Sums]:
        chunk = make()
        return chunk, _trace_chunk(job, chunk)

    max_rays = CHUNK * np.dtype(np.float64).itemsize // job.tables.shape.itemsize
    yield from _ahead(work, chunks(job, max_rays), threads if job.scene.rays > max_rays else 1)


def _ahead(
    work: Callable[[Callable[[], Chunk]], R], chunks: Iterator[Callable[[], Chunk]], threads: int
) -> Iterator[R]:
    """Yield the results of ``work`` for the chunks in order, computing a few ahead of the consumer."""
    if threads == 1:
        yield from map(work, chunks)
        return
    with ThreadPoolExecutor(threads) as pool:
        running: list[Future[R]] = [pool.submit(work, make) for make in islice(chunks, 2 * threads)]
        try:
            while running:
                yield running.pop(0).result()
                running.extend(pool.submit(work, make) for make in islice(chunks, 1))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _gpu_scene(job: Job) -> "GpuScene":
    """Return the GPU, loaded with the job's scene; raise `DesignError` if there is none."""
    need("numba_cuda", what="device", value=job.device, error=DesignError)
    from solen.trace.kernel import cuda  # requires numba-cuda

    if not cuda.available():
        limit = "no CUDA GPU was found, or its driver or compiler is missing"
        raise DesignError("device", value=job.device, limit=limit, remedy='use device="cpu"')
    rays = min(job.scene.rays, GPU_CHUNK)
    return cuda.GpuScene(job.constants, job.tables, empty(job), SPLITTING[job.mode], job.limits.min_weight, rays)


def _trace_chunk(job: Job, chunk: Chunk) -> tally.Sums:
    launch, dtype = chunk.launch, job.tables.shape.dtype.type
    if job.scene.extrusion is not None:
        return _trace_in_space(job, chunk, job.scene.extrusion)
    rays, rules = rows_of(job, chunk), rules_of(job, chunk)
    treatments = job.tables.treatments if len(job.tables.treatments) else None
    segments, waiting = (8 * len(launch) if job.segments else 0), 64 * BLOCK
    while True:
        sums = empty(job, segments)
        buffers = new_buffers(len(launch), dtype, waiting)
        complete = loop.trace_rays(job.constants, job.tables, sums, rays, rules, buffers, treatments)
        if complete and (not job.segments or sums.counts[tally.SEGMENTS] <= segments):
            return sums
        segments = max(segments, int(sums.counts[tally.SEGMENTS]) if job.segments else 0)
        waiting = waiting if complete else 2 * waiting


def _trace_in_space(job: Job, chunk: Chunk, extrusion: Extrusion) -> tally.Sums:
    rays, rules, waiting = rows_in_space(job, chunk), rules_of(job, chunk), 64 * BLOCK
    slab = extruded.Slab(0.5 * extrusion.thickness_mm, extrusion.index_above, extrusion.index_below)
    while True:
        sums, buffers = empty(job), extruded.buffers_in_space(waiting)
        if extruded.trace_in_space(job.constants, job.tables, sums, rays, rules, slab, buffers):
            add_entry_losses(sums, chunk.launch)
            return sums
        waiting *= 2


def _single_error(job: Job, threads: int) -> float:
    """Return the largest difference in receiver power between the two precisions, for fans with few rays."""
    reduced = replace(
        job.scene, sources=tuple(source.with_rays(min(source.rays, COMPARED_RAYS)) for source in job.scene.sources)
    )
    double, single = (
        _run(Job.of(reduced, job.mode, job.limits, dtype, seed=job.seed, device=job.device), threads)
        for dtype in DTYPES.values()
    )
    pairs = zip(double.detectors.values(), single.detectors.values(), strict=True)
    return max((abs(a.power - b.power) for a, b in pairs), default=0.0)


def _run(job: Job, threads: int, progress: Callable[[int], None] | None = None) -> Trace:
    """Trace all chunks of a job and add their sums."""
    totals = [[empty(job) for _ in range(job.groups(source))] for source in job.scene.sources]
    rays, done = [np.zeros(len(groups), dtype=np.int64) for groups in totals], 0
    kept: list[NDArray[np.void]] = []
    for chunk, sums in _traced(job, threads):
        totals[chunk.source][chunk.group] = add(totals[chunk.source][chunk.group], sums)
        rays[chunk.source][chunk.group] += len(chunk.launch)
        if job.segments:
            kept.append(segments_of(sums, job.scene.emitted))
        done += len(chunk.launch)
        if progress is not None:
            progress(done)
    return result(job, totals, rays, in_order(np.concatenate(kept)) if kept else None)
