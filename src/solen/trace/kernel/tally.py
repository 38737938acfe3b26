"""Sums in a loop over rays: powers by fate and receiver, monitor crossings, segments, locations."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.curve import END_TOLERANCE_MM
from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.nearest import Hit, Ray, relative_position
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.step import Arrival, Load, Rules
from solen.trace.result import FATES, MAX_LOCATIONS
from solen.trace.tables import Tables

HITS, UNDEFINED, TRUNCATIONS, SEGMENTS = range(4)
MISSED, LEAKED = len(FATES), len(FATES) + 1
"""Indices of two parts of the escaped power in an extruded scene: light that missed bodies, and light that leaked."""
SEGMENT_WIDTH = 15


class Sums(NamedTuple):
    """Sums of one chunk of rays, in double precision."""

    fate: NDArray[np.float64]
    """(8,) power by fate, then the missed and leaked parts of the escaped power, and the power reflected by a face"""
    detected: NDArray[np.float64]
    """(D,) power per receiver"""
    arrived: NDArray[np.int64]
    """(D,) number of rays or branches per receiver"""
    optical: NDArray[np.float64]
    """(D,) power times optical path length"""
    position: NDArray[np.float64]
    """(I, bins) power per bin along each receiving interface"""
    angle: NDArray[np.float64]
    """(D, bins) power per receiver by angle of incidence"""
    crossed: NDArray[np.float64]
    """(M,) net power per monitor"""
    crossings: NDArray[np.int64]
    """(M,) number of crossings per monitor"""
    maps: NDArray[np.float64]
    """(total number of bins,) net power per bin"""
    counts: NDArray[np.int64]
    """(4,) numbers of hits, undefined rays, other truncated branches, segments"""
    location: NDArray[np.float64]
    """(2, KEPT_PLACES, 2) locations of the first undefined rays, and of the first other truncated rays"""
    segments: NDArray[np.float64]
    """(capacity, SEGMENT_WIDTH) rows of ray segments"""


class Lineage(NamedTuple):
    """A branch of a ray, and the branch from which it was split off (−1 for none)."""

    branch: int
    parent: int


@compiled
def count_monitors(
    tables: Tables, sums: Sums, ox: float, oz: float, dx: float, dz: float, length: float, power: float, loss: float
) -> None:
    """Record a ray segment at each monitor that it crosses, with the power remaining there."""
    lines = tables.monitor
    for m in range(len(lines)):
        wx, wz = lines[m, 0] - ox, lines[m, 1] - oz
        inverse = 1.0 / (dx * lines[m, 3] - dz * lines[m, 2])
        t = (wx * lines[m, 3] - wz * lines[m, 2]) * inverse
        position = (wx * dz - wz * dx) * inverse
        inside = -END_TOLERANCE_MM <= position <= lines[m, 4] + END_TOLERANCE_MM
        if not (0.0 < t <= length and t < math.inf and inside):
            continue
        remaining = math.copysign(power * math.exp(-loss * t), -inverse)
        sums.crossed[m] += remaining
        sums.crossings[m] += 1
        if tables.bins[m] > 0:
            b = min(max(int(position / lines[m, 4] * tables.bins[m]), 0), tables.bins[m] - 1)
            sums.maps[tables.first_bin[m] + b] += remaining


@compiled
def count_arrival(
    k: Precision, tables: Tables, sums: Sums, ray: Ray, hit: Hit, arrival: Arrival, power: float, optical: float
) -> None:
    """Record light detected by a receiver."""
    c = hit.curve
    receiver = tables.receiver[c]
    sums.detected[receiver] += power
    sums.arrived[receiver] += 1
    sums.optical[receiver] += power * optical
    bins = sums.position.shape[1]
    if bins > 0:
        fraction = relative_position(k, tables.kind[c], tables.shape, c, arrival.x, arrival.z, hit.u)
        sums.position[tables.owner[c], min(max(int(fraction * bins), 0), bins - 1)] += power
    bins = sums.angle.shape[1]
    if bins > 0:
        sine = ray.dx * arrival.nz - ray.dz * arrival.nx  # along the curve, as its left normal is (nx, nz)
        fraction = math.asin(min(max(sine, -1.0), 1.0)) / math.pi + 0.5
        sums.angle[receiver, min(max(int(fraction * bins), 0), bins - 1)] += power


@compiled
def store_segment(
    sums: Sums,
    rules: Rules,
    ray: Ray,
    load: Load,
    lineage: Lineage,
    interface: int,
    fate: int,
    length: float,
    kept: float,
) -> None:
    """Count a ray segment, and store it in the order of `solen.trace.result.SEGMENT_FIELDS` if there is room."""
    row = sums.counts[SEGMENTS]
    if row < len(sums.segments):
        segment = sums.segments[row]
        segment[0], segment[1] = rules.first + rules.step * load.number, lineage.branch
        segment[2], segment[3] = lineage.parent, load.hits
        segment[4], segment[5], segment[10], segment[13], segment[14] = interface, fate, length, kept, load.optical
        segment[6], segment[7], segment[8], segment[9] = ray.x, ray.z, ray.dx, ray.dz
        segment[11], segment[12] = load.s, load.p
    sums.counts[SEGMENTS] += 1


@compiled
def store_location(sums: Sums, kind: int, x: float, z: float) -> None:
    """Count an undefined or truncated ray, and store its location."""
    n = sums.counts[kind]
    if n < MAX_LOCATIONS:
        sums.location[kind - UNDEFINED, n, 0], sums.location[kind - UNDEFINED, n, 1] = x, z
    sums.counts[kind] += 1
