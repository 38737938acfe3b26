"""Sums in a loop over rays: powers by fate and receiver, monitor crossings, legs, locations."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.curve import END_TOLERANCE_MM
from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.nearest import Hit, Ray, place_on
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.step import Load, Meeting, Rules
from solen.trace.result import FATES, KEPT_PLACES
from solen.trace.tables import Tables

HITS, UNDEFINED, CUT, LEGS = range(4)
MISSED, LEAKED = len(FATES), len(FATES) + 1
"""Indices of the parts of the escaped power in an extruded scene: light that missed the bodies, and light that
leaked.
"""
LEG_WIDTH = 15


class Sums(NamedTuple):
    """Sums of one chunk of rays, in double precision."""

    fate: NDArray[np.float64]
    """(7,) power by fate, and the missed and leaked parts of the escaped power in an extruded scene"""
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
    """(4,) numbers of hits, undefined rays, other truncated branches, legs"""
    place: NDArray[np.float64]
    """(2, KEPT_PLACES, 2) locations of the first undefined rays, and of the first other truncated rays"""
    legs: NDArray[np.float64]
    """(capacity, LEG_WIDTH) legs, as many as there is room for"""


class Stem(NamedTuple):
    """A branch of a ray, and the branch from which it was split off (−1 for none)."""

    branch: int
    parent: int


@compiled
def count_monitors(
    tables: Tables, sums: Sums, ox: float, oz: float, dx: float, dz: float, length: float, power: float, loss: float
) -> None:
    """Record a leg at each monitor that it crosses, with the power remaining there."""
    lines = tables.monitor
    for m in range(len(lines)):
        wx, wz = lines[m, 0] - ox, lines[m, 1] - oz
        inverse = 1.0 / (dx * lines[m, 3] - dz * lines[m, 2])
        t = (wx * lines[m, 3] - wz * lines[m, 2]) * inverse
        place = (wx * dz - wz * dx) * inverse
        inside = -END_TOLERANCE_MM <= place <= lines[m, 4] + END_TOLERANCE_MM
        if not (0.0 < t <= length and t < math.inf and inside):
            continue
        left = math.copysign(power * math.exp(-loss * t), -inverse)
        sums.crossed[m] += left
        sums.crossings[m] += 1
        if tables.bins[m] > 0:
            b = min(max(int(place / lines[m, 4] * tables.bins[m]), 0), tables.bins[m] - 1)
            sums.maps[tables.first_bin[m] + b] += left


@compiled
def count_arrival(
    k: Precision, tables: Tables, sums: Sums, ray: Ray, hit: Hit, met: Meeting, power: float, optical: float
) -> None:
    """Record light detected by a receiver."""
    c = hit.curve
    receiver = tables.receiver[c]
    sums.detected[receiver] += power
    sums.arrived[receiver] += 1
    sums.optical[receiver] += power * optical
    many = sums.position.shape[1]
    if many > 0:
        share = place_on(k, tables.kind[c], tables.shape, c, met.x, met.z, hit.place)
        sums.position[tables.owner[c], min(max(int(share * many), 0), many - 1)] += power
    many = sums.angle.shape[1]
    if many > 0:
        sine = ray.dx * met.nz - ray.dz * met.nx  # along the curve, as its left normal is (nx, nz)
        share = math.asin(min(max(sine, -1.0), 1.0)) / math.pi + 0.5
        sums.angle[receiver, min(max(int(share * many), 0), many - 1)] += power


@compiled
def note_leg(
    sums: Sums, rules: Rules, ray: Ray, load: Load, stem: Stem, interface: int, fate: int, length: float, kept: float
) -> None:
    """Store a leg if there is room, in the order of `solen.trace.result.LEG`; count it in any case."""
    row = sums.counts[LEGS]
    if row < len(sums.legs):
        leg = sums.legs[row]
        leg[0], leg[1] = rules.first + rules.step * load.number, stem.branch
        leg[2], leg[3] = stem.parent, load.hits
        leg[4], leg[5], leg[10], leg[13], leg[14] = interface, fate, length, kept, load.optical
        leg[6], leg[7], leg[8], leg[9] = ray.x, ray.z, ray.dx, ray.dz
        leg[11], leg[12] = load.s, load.p
    sums.counts[LEGS] += 1


@compiled
def note_place(sums: Sums, which: int, x: float, z: float) -> None:
    """Count an undefined or truncated ray, and store its location."""
    n = sums.counts[which]
    if n < KEPT_PLACES:
        sums.place[which - UNDEFINED, n, 0], sums.place[which - UNDEFINED, n, 1] = x, z
    sums.counts[which] += 1
