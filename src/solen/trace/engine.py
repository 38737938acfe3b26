"""The compiled engine: scene → tables → kernel → result.

Rays are traced in chunks of one size whatever the machine, on as many threads as asked for, and the chunks' sums are
added in order: the same scene gives the same numbers to the last bit on one thread and on many. Memory is that of a few
chunks. Between chunks a trace can be interrupted.
"""

import math
import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice

import numpy as np

from solen.curve import check_count
from solen.scene import Launch, Scene, Source
from solen.trace import kernel
from solen.trace.result import (
    ABSORBED,
    DETECTED,
    ESCAPED,
    KEPT_PLACES,
    LEG,
    TRUNCATED,
    Crossed,
    Detected,
    Ledger,
    Limits,
    Mode,
    Trace,
    check_mode,
    in_order,
)
from solen.trace.tables import Tables, compile_scene

CHUNK = 8192
Progress = Callable[[int], None]


def trace(
    scene: Scene,
    mode: Mode = "count",
    limits: Limits | None = None,
    *,
    legs: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Trace:
    """Trace every ray of every source.

    Parameters
    ----------
    scene
        What is traced.
    mode
        ``"count"``: refraction or total reflection, no splitting, no absorption in media. ``"power"``: Fresnel with s
        and p apart, both branches, absorption.
    limits
        Where following a ray ends; see `Limits`.
    legs
        Keep every straight stretch, so that ``paths()`` has the ways of all rays: some hundred bytes each.
    threads
        Threads to use; by default one per core. The numbers do not depend on it.
    progress
        Called with the number of rays done so far.

    Returns
    -------
    Trace
        Powers as fractions of the emitted power, with the ledger.

    Raises
    ------
    DesignError
        Unknown mode, limits out of range, or a curve that the engine does not know.
    """
    check_mode(mode)
    threads = (os.cpu_count() or 1) if threads is None else threads
    check_count("threads", threads, 1)
    limits = limits or Limits()
    tables = compile_scene(scene)
    total = _empty(tables, scene)
    kept: list[np.ndarray[tuple[int, ...], np.dtype[np.void]]] = []
    done = 0
    for rays, sums in _chunks(scene, tables, mode == "power", limits, legs, threads):
        total = _add(total, sums)
        if legs:
            kept.append(_legs(sums, scene.emitted))
        done += rays
        if progress is not None:
            progress(done)
    return _result(scene, mode, total, in_order(np.concatenate(kept)) if kept else None)


def trace_launch(
    scene: Scene, tables: Tables, launch: Launch, mode: Mode, limits: Limits
) -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.void]], int]:
    """Every straight stretch (see `LEG`; powers as launched) of some rays of a scene, and how many were undefined."""
    sums = _trace_chunk(tables, scene, launch, 0, mode == "power", limits, legs=True)
    return in_order(_legs(sums, 1.0)), int(sums.counts[kernel.UNDEFINED])


def _chunks(
    scene: Scene, tables: Tables, split: bool, limits: Limits, legs: bool, threads: int
) -> Iterator[tuple[int, kernel.Sums]]:
    """Sums of one chunk after the other, in order, a few of them ahead of the consumer."""

    def job(source: Source, start: int, stop: int, before: int) -> tuple[int, kernel.Sums]:
        launch = source.launch(start, stop)
        return len(launch), _trace_chunk(tables, scene, launch, before + start, split, limits, legs)

    jobs = _stretches(scene)
    if threads == 1 or scene.rays <= CHUNK:
        yield from (job(*item) for item in jobs)
        return
    with ThreadPoolExecutor(threads) as pool:
        running: list[Future[tuple[int, kernel.Sums]]] = [pool.submit(job, *item) for item in islice(jobs, 2 * threads)]
        try:
            while running:
                yield running.pop(0).result()
                running.extend(pool.submit(job, *item) for item in islice(jobs, 1))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _stretches(scene: Scene) -> Iterator[tuple[Source, int, int, int]]:
    """Rays of all sources in chunks: the source, the first and last of its rays, and the rays before that source."""
    before = 0
    for source in scene.sources:
        for start in range(0, source.rays, CHUNK):
            yield source, start, min(start + CHUNK, source.rays), before
        before += source.rays


def _trace_chunk(
    tables: Tables, scene: Scene, launch: Launch, first: int, split: bool, limits: Limits, legs: bool
) -> kernel.Sums:
    rays = np.column_stack([launch.x_mm, launch.z_mm, launch.dx, launch.dz, launch.power_s, launch.power_p])
    room = 16 * len(launch) if legs else 0
    while True:
        sums = _empty(tables, scene, room)
        kernel.trace_rays(tables, sums, rays, first, split, limits.min_weight, limits.max_hits)
        if not legs or sums.counts[kernel.LEGS] <= room:
            return sums
        room = int(sums.counts[kernel.LEGS])


def _empty(tables: Tables, scene: Scene, room: int = 0) -> kernel.Sums:
    receivers, monitors = len(scene.receivers), len(scene.monitors)
    return kernel.Sums(
        fate=np.zeros(5),
        detected=np.zeros(receivers),
        arrived=np.zeros(receivers, dtype=np.int64),
        crossed=np.zeros(monitors),
        crossings=np.zeros(monitors, dtype=np.int64),
        maps=np.zeros(int(tables.bins.sum())),
        counts=np.zeros(3, dtype=np.int64),
        place=np.full((KEPT_PLACES, 2), math.nan),
        legs=np.empty((room, kernel.LEG_WIDTH)),
    )


def _add(total: kernel.Sums, sums: kernel.Sums) -> kernel.Sums:
    places = np.vstack([total.place, sums.place])
    places = places[~np.isnan(places[:, 0])][:KEPT_PLACES]
    return kernel.Sums(
        fate=total.fate + sums.fate,
        detected=total.detected + sums.detected,
        arrived=total.arrived + sums.arrived,
        crossed=total.crossed + sums.crossed,
        crossings=total.crossings + sums.crossings,
        maps=total.maps + sums.maps,
        counts=total.counts + sums.counts,
        place=places,
        legs=total.legs,
    )


def _legs(sums: kernel.Sums, emitted: float) -> np.ndarray[tuple[int, ...], np.dtype[np.void]]:
    rows = sums.legs[: sums.counts[kernel.LEGS]]
    legs = np.empty(len(rows), dtype=LEG)
    for column, name in enumerate(LEG.names or ()):
        legs[name] = rows[:, column]
    legs["power_s"] /= emitted
    legs["power_p"] /= emitted
    return legs


def _result(
    scene: Scene, mode: Mode, sums: kernel.Sums, legs: np.ndarray[tuple[int, ...], np.dtype[np.void]] | None
) -> Trace:
    emitted = scene.emitted
    ends = np.cumsum([monitor.bins for monitor in scene.monitors], dtype=int)[:-1]
    maps = np.split(sums.maps / emitted, ends) if scene.monitors else []
    return Trace(
        mode=mode,
        rays=scene.rays,
        detectors={
            name: Detected(float(power / emitted), int(n))
            for name, power, n in zip(scene.receivers, sums.detected, sums.arrived, strict=True)
        },
        monitors={
            monitor.name: Crossed(float(power / emitted), int(n), bins)
            for monitor, power, n, bins in zip(scene.monitors, sums.crossed, sums.crossings, maps, strict=True)
        },
        ledger=Ledger(*(float(sums.fate[fate] / emitted) for fate in (DETECTED, ESCAPED, ABSORBED, TRUNCATED))),
        hits=int(sums.counts[kernel.HITS]),
        undefined=int(sums.counts[kernel.UNDEFINED]),
        undefined_at=tuple((float(x), float(z)) for x, z in sums.place),
        legs=legs,
    )
