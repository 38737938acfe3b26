"""What chunks of rays add up, and the result that it makes.

How far the groups of rays are apart says how far the whole can be trusted.
"""

import math
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from solen.trace.chunks import HALVES, Job
from solen.trace.kernel import loop
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
    Trace,
)


def empty(job: Job, legs: int = 0) -> loop.Sums:
    """Sums of nothing, with room for so many legs."""
    receivers, monitors = len(job.scene.receivers), len(job.scene.monitors)
    interfaces = len(job.scene.interfaces) if job.position_bins else 0
    return loop.Sums(
        fate=np.zeros(loop.LEAKED + 1),
        detected=np.zeros(receivers),
        arrived=np.zeros(receivers, dtype=np.int64),
        optical=np.zeros(receivers),
        position=np.zeros((interfaces, job.position_bins)),
        angle=np.zeros((receivers, job.angle_bins)),
        crossed=np.zeros(monitors),
        crossings=np.zeros(monitors, dtype=np.int64),
        maps=np.zeros(int(job.tables.bins.sum())),
        counts=np.zeros(4, dtype=np.int64),
        place=np.full((2, KEPT_PLACES, 2), math.nan),
        legs=np.empty((legs, loop.LEG_WIDTH)),
    )


def add(total: loop.Sums, sums: loop.Sums) -> loop.Sums:
    """Both sums together; of the places the first, and of the legs those of the total."""
    added = {
        name: getattr(total, name) + getattr(sums, name) for name in loop.Sums._fields if name not in {"place", "legs"}
    }
    return loop.Sums(**added, place=_first_places(total.place, sums.place), legs=total.legs)


def _first_places(*places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The first places of both kinds."""
    if np.isnan(places[-1][:, 0, 0]).all():
        return places[0]
    found = np.full((2, KEPT_PLACES, 2), math.nan)
    for kind in range(2):
        known = np.vstack([place[kind][~np.isnan(place[kind][:, 0])] for place in places])[:KEPT_PLACES]
        found[kind, : len(known)] = known
    return found


def legs_of(sums: loop.Sums, emitted: float) -> NDArray[np.void]:
    """Straight stretches that a chunk kept, powers as fractions of the emitted power."""
    rows = sums.legs[: sums.counts[loop.LEGS]]
    legs = np.empty(len(rows), dtype=LEG)
    for column, name in enumerate(LEG.names or ()):
        legs[name] = rows[:, column]
    legs["power_s"] /= emitted
    legs["power_p"] /= emitted
    return legs


def result(job: Job, totals: list[list[loop.Sums]], rays: NDArray[np.int64], legs: NDArray[np.void] | None) -> Trace:
    """Trace of a job from its sums by source and group, and the rays (S, G) in each."""
    scene, emitted = job.scene, job.scene.emitted
    of_source = [reduce(add, groups) for groups in totals]
    total = reduce(add, of_source)
    shares = rays / np.maximum(rays.sum(axis=1, keepdims=True), 1)  # of each source's power in each group
    power = np.array([source.power for source in scene.sources])
    weight, share = power @ shares, float(np.max(power / np.maximum(rays.sum(axis=1), 1)) / emitted)

    def spread(name: str) -> NDArray[np.float64]:
        """Uncertainty of each entry of a sum, from what the groups have found."""
        found = np.sum([[getattr(sums, name) for sums in groups] for groups in totals], axis=0)
        return _spread(found, weight, share)

    ends = np.cumsum([monitor.bins for monitor in scene.monitors], dtype=int)[:-1]
    maps = np.split(total.maps / emitted, ends) if scene.monitors else []
    u_detected, u_crossed = spread("detected"), spread("crossed")
    undefined_at, truncated_at = (tuple((float(x), float(z)) for x, z in at if not math.isnan(x)) for at in total.place)
    return Trace(
        mode=job.mode,
        method=job.sampling,
        rays=int(rays.sum()),
        detectors={
            name: Detected(
                power=float(total.detected[i] / emitted),
                u=float(u_detected[i]),
                rays=int(total.arrived[i]),
                by_source=tuple(float(sums.detected[i] / emitted) for sums in of_source),
                optical_path_mm=float(total.optical[i] / total.detected[i]) if total.detected[i] > 0.0 else math.nan,
                position=_positions(job, name, total),
                angle=total.angle[i] / emitted,
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
        hits=int(total.counts[loop.HITS]),
        undefined=int(total.counts[loop.UNDEFINED]),
        undefined_at=undefined_at,
        truncated=int(total.counts[loop.CUT]),
        truncated_at=truncated_at,
        missed=float(total.fate[loop.MISSED] / emitted),
        leaked=float(total.fate[loop.LEAKED] / emitted),
        legs=legs,
    )


def _spread(found: NDArray[np.float64], weight: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Uncertainty of the whole from what each group (G, …) found of its emitted power (G,).

    Of two halves of a fan, half their difference; but at least the share of one ray, by which any jump can be missed:
    two fans can agree by chance. Of independent samples the standard error of their mean. NaN where a group has no
    rays.
    """
    if not np.all(weight > 0.0):
        return np.full(found.shape[1:], math.nan)
    estimates = found / weight[:, None]
    if len(weight) == HALVES:
        return np.asarray(np.maximum(0.5 * np.abs(estimates[0] - estimates[1]), share))
    error = np.std(estimates, axis=0, ddof=1) / math.sqrt(len(weight))
    return np.where(error > 0.0, error, share)  # that no sample has seen it does not mean that there is nothing


def _positions(job: Job, receiver: str, total: loop.Sums) -> NDArray[np.float64]:
    """Histogram along each interface of a receiver."""
    if not job.position_bins:
        return np.empty((0, 0))
    mine = [i for i, interface in enumerate(job.scene.interfaces) if interface.receiver == receiver]
    return np.asarray(total.position[mine] / job.scene.emitted)
