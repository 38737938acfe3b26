"""Sums over chunks of rays, and their conversion to a result.

The differences between groups of rays give the uncertainty.
"""

import math
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray, IntArray
from solen.scene import Source
from solen.trace.chunks import HALVES, Job
from solen.trace.entry import REFLECTED
from solen.trace.kernel import tally
from solen.trace.result import (
    ABSORBED,
    DETECTED,
    ESCAPED,
    MAX_LOCATIONS,
    SEGMENT_FIELDS,
    TRUNCATED,
    Crossed,
    Detected,
    Ledger,
    Trace,
)


def empty(job: Job, segments: int = 0) -> tally.Sums:
    """Return empty sums, with room for ``segments`` ray segments."""
    receivers, monitors = len(job.scene.receivers), len(job.scene.monitors)
    interfaces = len(job.scene.interfaces) if job.position_bins else 0
    return tally.Sums(
        fate=np.zeros(REFLECTED + 1),
        detected=np.zeros(receivers),
        arrived=np.zeros(receivers, dtype=np.int64),
        optical=np.zeros(receivers),
        position=np.zeros((interfaces, job.position_bins)),
        angle=np.zeros((receivers, job.angle_bins)),
        crossed=np.zeros(monitors),
        crossings=np.zeros(monitors, dtype=np.int64),
        maps=np.zeros(int(job.tables.bins.sum())),
        counts=np.zeros(4, dtype=np.int64),
        location=np.full((2, MAX_LOCATIONS, 2), math.nan),
        segments=np.empty((segments, tally.SEGMENT_WIDTH)),
    )


def of_tasks(tasks: int, receivers: int, monitors: int = 0, bins: int = 0) -> tally.Sums:
    """Return empty sums for many tasks with these total numbers of receivers, monitors and map bins."""
    return tally.Sums(
        fate=np.zeros((tasks, REFLECTED + 1)),
        detected=np.zeros(receivers),
        arrived=np.zeros(receivers, dtype=np.int64),
        optical=np.zeros(receivers),
        position=np.zeros((0, 0)),
        angle=np.zeros((0, 0)),
        crossed=np.zeros(monitors),
        crossings=np.zeros(monitors, dtype=np.int64),
        maps=np.zeros(bins),
        counts=np.zeros((tasks, 4), dtype=np.int64),
        location=np.full((tasks, 2, MAX_LOCATIONS, 2), math.nan),
        segments=np.empty((0, tally.SEGMENT_WIDTH)),
    )


def add(total: tally.Sums, sums: tally.Sums) -> tally.Sums:
    """Return the total of two sums, with the first locations of both, and the segments of ``total``."""
    added = {
        name: getattr(total, name) + getattr(sums, name)
        for name in tally.Sums._fields
        if name not in {"location", "segments"}
    }
    return tally.Sums(**added, location=_first_locations(total.location, sums.location), segments=total.segments)


def _first_locations(*locations: FloatArray) -> FloatArray:
    """Return the first locations of undefined rays and of truncated rays."""
    if np.isnan(locations[-1][:, 0, 0]).all():
        return locations[0]
    first = np.full((2, MAX_LOCATIONS, 2), math.nan)
    for kind in range(2):
        stored = np.vstack([location[kind][~np.isnan(location[kind][:, 0])] for location in locations])[:MAX_LOCATIONS]
        first[kind, : len(stored)] = stored
    return first


def segments_of(sums: tally.Sums, emitted: float) -> NDArray[np.void]:
    """Return the ray segments that a chunk stored, with powers as fractions of the emitted power."""
    rows = sums.segments[: sums.counts[tally.SEGMENTS]]
    segments = np.empty(len(rows), dtype=SEGMENT_FIELDS)
    for column, name in enumerate(SEGMENT_FIELDS.names or ()):
        segments[name] = rows[:, column]
    segments["power_s"] /= emitted
    segments["power_p"] /= emitted
    return segments


Counts = list[IntArray]
"""For each source, the number of rays in each group (G,); the number of groups may differ between sources."""


def result(job: Job, totals: list[list[tally.Sums]], rays: Counts, segments: NDArray[np.void] | None) -> Trace:
    """Return the trace of a job, given its sums by source and group and the corresponding numbers of rays."""
    scene, emitted = job.scene, job.scene.emitted
    by_source = [reduce(add, groups) for groups in totals]
    total = reduce(add, by_source)
    ends = np.cumsum([monitor.bins for monitor in scene.monitors], dtype=int)[:-1]
    maps = np.split(total.maps / emitted, ends) if scene.monitors else []
    u_detected, u_crossed, u_fate = (_uncertainty(job, totals, rays, name) for name in ("detected", "crossed", "fate"))
    undefined_at_mm, truncated_at_mm = (
        tuple((float(x), float(z)) for x, z in points if not math.isnan(x)) for points in total.location
    )
    return Trace(
        mode=job.mode,
        method=job.sampling,
        rays=sum(int(groups.sum()) for groups in rays),
        detectors={
            name: Detected(
                power=float(total.detected[i] / emitted),
                u_power=float(u_detected[i]),
                rays=int(total.arrived[i]),
                power_by_source=tuple(float(sums.detected[i] / emitted) for sums in by_source),
                optical_path_mm=float(total.optical[i] / total.detected[i]) if total.detected[i] > 0.0 else math.nan,
                power_by_position=_positions(job, name, total),
                power_by_angle=total.angle[i] / emitted,
            )
            for i, name in enumerate(scene.receivers)
        },
        monitors={
            monitor.name: Crossed(
                float(total.crossed[i] / emitted), float(u_crossed[i]), int(total.crossings[i]), maps[i]
            )
            for i, monitor in enumerate(scene.monitors)
        },
        ledger=Ledger(*(float(total.fate[fate] / emitted) for fate in (DETECTED, ESCAPED, ABSORBED, TRUNCATED))),
        u_ledger=Ledger(*(float(u_fate[fate]) for fate in (DETECTED, ESCAPED, ABSORBED, TRUNCATED))),
        hits=int(total.counts[tally.HITS]),
        undefined=int(total.counts[tally.UNDEFINED]),
        undefined_at_mm=undefined_at_mm,
        truncated=int(total.counts[tally.TRUNCATIONS]),
        truncated_at_mm=truncated_at_mm,
        missed=float(total.fate[tally.MISSED] / emitted),
        leaked=float(total.fate[tally.LEAKED] / emitted),
        u_missed=float(u_fate[tally.MISSED]),
        u_leaked=float(u_fate[tally.LEAKED]),
        reflected=float(total.fate[REFLECTED] / emitted),
        segments=segments,
    )


def _uncertainty(job: Job, totals: list[list[tally.Sums]], rays: Counts, name: str) -> FloatArray:
    """Return the uncertainty of each entry of a sum, as a fraction of the emitted power, from the group results.

    Sources with the same number of groups are combined, because their errors may be correlated. Sources with different
    numbers of groups are treated as independent.
    """
    parts = []
    for count in sorted({len(groups) for groups in totals}):
        indices = [i for i, groups in enumerate(totals) if len(groups) == count]
        values = np.sum([[getattr(sums, name) for sums in totals[i]] for i in indices], axis=0)
        power = np.array([job.scene.sources[i].power for i in indices])
        ray_counts = np.array([rays[i] for i in indices])
        all_rays = np.maximum(ray_counts.sum(axis=1, keepdims=True), 1)
        error_rays = np.array(
            [_common_error_rays(job.scene.sources[i], job.scene.extrusion is not None, count) for i in indices]
        )
        minimum = float(np.max(power * error_rays / all_rays[:, 0]))
        parts.append(
            _group_uncertainty(values, power @ (ray_counts / all_rays), minimum / power.sum())
            * (power.sum() / job.scene.emitted)
        )
    return np.asarray(reduce(np.hypot, parts))


def _common_error_rays(source: Source, in_space: bool, groups: int) -> float:
    """Return the number of rays by which both halves of a source may be wrong in the same way.

    With one coordinate, the error at a jump is at most one ray. With two coordinates, a jump follows a line that
    crosses about √N of the N cells of a lattice; each cell is cut at a practically random position, and contributes an
    error of 1/√12 of a ray. The visible region lies between two such lines.
    """
    if groups == HALVES and source.dimensions(in_space) > 1:
        return max(1.0, math.sqrt(math.sqrt(source.rays) / 6.0))
    return 1.0


def _group_uncertainty(values: FloatArray, weight: FloatArray, minimum: float) -> FloatArray:
    """Return the uncertainty of the total from the values of the groups (G, …), whose powers are ``weight`` (G,).

    For the two halves of a lattice, the uncertainty is half of their difference, but at least ``minimum``, because they
    can agree by chance. For independent samples, it is the standard error of their mean. It is NaN if a group has no
    rays.
    """
    if not np.all(weight > 0.0):
        return np.full(values.shape[1:], math.nan)
    estimates = values / weight[:, None]
    if len(weight) == HALVES:
        return np.asarray(np.maximum(0.5 * np.abs(estimates[0] - estimates[1]), minimum))
    error = np.std(estimates, axis=0, ddof=1) / math.sqrt(len(weight))
    return np.where(error > 0.0, error, minimum)  # equal samples do not prove that the error is zero


def _positions(job: Job, receiver: str, total: tally.Sums) -> FloatArray:
    """Return the histograms along each interface of a receiver."""
    if not job.position_bins:
        return np.empty((0, 0))
    indices = [i for i, interface in enumerate(job.scene.interfaces) if interface.receiver == receiver]
    return np.asarray(total.position[indices] / job.scene.emitted)
