"""The compiled loop over rays: tables in, sums out; it holds the same physics as `solen.trace.reference`.

Everything here is compiled by numba without the interpreter's lock, so that chunks of rays run on several threads, and
cached on disk. It lives in one file because the cache of a compiled function looks only at the file it stands in.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from solen.curve import END_TOLERANCE_MM, ROUNDING
from solen.trace.result import ABSORBED, DETECTED, ESCAPED, GOES_ON, KEPT_PLACES, TRUNCATED
from solen.trace.tables import ABSORBING, ARC, MIRROR, PARABOLA, RECEIVER, SEGMENT, Tables

P = ParamSpec("P")
R = TypeVar("R")
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STACK = 64
"""Branches waiting at most: each holds more than all that were split off it, so log2(1/least weight) suffice."""
HITS, UNDEFINED, LEGS = range(3)
LEG_WIDTH = 11


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """`numba.njit` with a cache on disk, keeping the types that a checker sees."""
    return cast("Callable[P, R]", numba.njit(cache=True, nogil=True)(function))


class Sums(NamedTuple):
    """What one chunk of rays adds up."""

    fate: Floats
    """(5,) power by fate"""
    detected: Floats
    """(D,) power per receiver"""
    arrived: NDArray[np.int64]
    """(D,) rays or branches per receiver"""
    crossed: Floats
    """(M,) net power per monitor"""
    crossings: NDArray[np.int64]
    """(M,) crossings per monitor"""
    maps: Floats
    """(sum of bins,) net power per bin"""
    counts: NDArray[np.int64]
    """(3,) hits, undefined rays, legs"""
    place: Floats
    """(KEPT_PLACES, 2) where the first undefined rays were"""
    legs: Floats
    """(capacity, LEG_WIDTH) straight stretches, as far as there is room"""


@compiled
def quadratic(a: float, b: float, c: float, leaving: bool) -> tuple[float, float]:
    """Real roots of a t² + b t + c without cancellation, −1 for none; with ``leaving`` t = 0 is divided out."""
    if leaving:
        return (-b / a if a != 0.0 else -1.0), -1.0
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0:
        return -1.0, -1.0
    q = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    return (q / a if a != 0.0 else -1.0), (c / q if q != 0.0 else -1.0)


@compiled
def segment_hit(shape: Floats, c: int, ox: float, oz: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to a segment, inf for none."""
    slant = dx * shape[c, 3] - dz * shape[c, 2]
    if leaving or slant == 0.0:
        return math.inf
    wx, wz = shape[c, 0] - ox, shape[c, 1] - oz
    ahead = (wx * shape[c, 3] - wz * shape[c, 2]) * slant
    if ahead <= 0.0:
        return math.inf
    slant2 = slant * slant
    place = (wx * dz - wz * dx) * slant
    if place < -END_TOLERANCE_MM * slant2 or place > (shape[c, 4] + END_TOLERANCE_MM) * slant2:
        return math.inf
    return float(ahead / slant2)


@compiled
def arc_hit(shape: Floats, c: int, ox: float, oz: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to an arc, inf for none."""
    wx, wz = ox - shape[c, 0], oz - shape[c, 1]
    first, second = quadratic(1.0, 2.0 * (wx * dx + wz * dz), wx * wx + wz * wz - shape[c, 2] * shape[c, 2], leaving)
    best = math.inf
    for t in (first, second):
        if (
            0.0 < t < best
            and (wx + t * dx) * shape[c, 3] + (wz + t * dz) * shape[c, 4]
            >= shape[c, 2] * shape[c, 5] - END_TOLERANCE_MM
        ):
            best = t
    return best


@compiled
def parabola_hit(shape: Floats, c: int, ox: float, oz: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to a parabola, inf for none. Its frame: the axis, and the axis turned by −90 degrees."""
    wx, wz = ox - shape[c, 0], oz - shape[c, 1]
    run, rise = wx * shape[c, 2] + wz * shape[c, 3], wx * shape[c, 3] - wz * shape[c, 2]
    d_run, d_rise = dx * shape[c, 2] + dz * shape[c, 3], dx * shape[c, 3] - dz * shape[c, 2]
    bend = shape[c, 4]
    first, second = quadratic(
        -bend * d_run * d_run, d_rise - 2.0 * bend * run * d_run, rise - bend * run * run, leaving
    )
    best = math.inf
    for t in (first, second):
        if 0.0 < t < best and shape[c, 5] - END_TOLERANCE_MM <= run + t * d_run <= shape[c, 6] + END_TOLERANCE_MM:
            best = t
    return best


@compiled
def oval_terms(shape: Floats, c: int, x: float, z: float, dx: float, dz: float) -> tuple[float, float]:
    """Residual of the oval's equation at a point and its derivative along a direction."""
    ax, az, bx, bz = x - shape[c, 0], z - shape[c, 1], x - shape[c, 2], z - shape[c, 3]
    a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
    slope = shape[c, 4] * (ax * dx + az * dz) / a + shape[c, 5] * (bx * dx + bz * dz) / b
    return shape[c, 4] * a + shape[c, 5] * b - shape[c, 6], slope


@compiled
def oval_root(
    shape: Floats, c: int, ox: float, oz: float, dx: float, dz: float, start: float, outwards: float
) -> float:
    """Newton's method from a start outside the convex oval; −1 where the line misses it."""
    t = start
    for _ in range(200):
        value, slope = oval_terms(shape, c, ox + t * dx, oz + t * dz, dx, dz)
        if slope * outwards <= 0.0:
            return -1.0
        t -= value / slope
        if value <= ROUNDING * shape[c, 6]:
            return t
    return -1.0


@compiled
def oval_hit(shape: Floats, c: int, ox: float, oz: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to the front of a Cartesian oval, inf for none; the circle round the piece spares most rays Newton."""
    cx, cz = shape[c, 13] - ox, shape[c, 14] - oz
    if abs(cx * dz - cz * dx) > shape[c, 15]:
        return math.inf
    wx, wz = ox - shape[c, 2], oz - shape[c, 3]
    circle, middle, nearest = shape[c, 6] / shape[c, 5], -(wx * dx + wz * dz), wx * dz - wz * dx
    if abs(nearest) >= circle or (leaving and oval_terms(shape, c, ox, oz, dx, dz)[1] >= 0.0):
        return math.inf
    reach = math.sqrt(circle * circle - nearest * nearest)
    for outwards in (-1.0, 1.0):
        if leaving and outwards < 0.0:
            continue
        t = oval_root(shape, c, ox, oz, dx, dz, middle + outwards * reach, outwards)
        depth = (ox + t * dx - shape[c, 7]) * shape[c, 9] + (oz + t * dz - shape[c, 8]) * shape[c, 10]
        if t > 0.0 and depth <= shape[c, 11] + END_TOLERANCE_MM:
            return t
    return math.inf


@compiled
def curve_hit(kind: int, shape: Floats, c: int, ox: float, oz: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to the first point of a curve ahead, inf for none."""
    if kind == SEGMENT:
        return segment_hit(shape, c, ox, oz, dx, dz, leaving)
    if kind == PARABOLA:
        return parabola_hit(shape, c, ox, oz, dx, dz, leaving)
    if kind == ARC:
        return arc_hit(shape, c, ox, oz, dx, dz, leaving)
    return oval_hit(shape, c, ox, oz, dx, dz, leaving)


@compiled
def curve_normal(kind: int, shape: Floats, c: int, x: float, z: float) -> tuple[float, float]:
    """Left unit normal at a point of a curve."""
    if kind == SEGMENT:
        return -shape[c, 3], shape[c, 2]
    if kind == PARABOLA:
        run = (x - shape[c, 0]) * shape[c, 2] + (z - shape[c, 1]) * shape[c, 3]
        slope = 2.0 * shape[c, 4] * run
        tx, tz = shape[c, 2] + slope * shape[c, 3], shape[c, 3] - slope * shape[c, 2]
        nx, nz, side = -tz, tx, shape[c, 7]
    elif kind == ARC:
        nx, nz, side = shape[c, 0] - x, shape[c, 1] - z, shape[c, 6]
    else:
        ax, az, bx, bz = x - shape[c, 0], z - shape[c, 1], x - shape[c, 2], z - shape[c, 3]
        a, b = shape[c, 4] / math.sqrt(ax * ax + az * az), shape[c, 5] / math.sqrt(bx * bx + bz * bz)
        nx, nz, side = a * ax + b * bx, a * az + b * bz, shape[c, 12]
    scale = side / math.sqrt(nx * nx + nz * nz)
    return scale * nx, scale * nz


@compiled
def next_hit(kind: Ints, shape: Floats, ox: float, oz: float, dx: float, dz: float, last: int) -> tuple[int, float]:
    """Nearest interface ahead and its distance; −1 and inf for none."""
    nearest, found = math.inf, -1
    for c in range(len(kind)):
        t = curve_hit(kind[c], shape, c, ox, oz, dx, dz, c == last)
        if t < nearest:
            nearest, found = t, c
    return found, nearest


@compiled
def fresnel(cos_in: float, cos_out: float, n1: float, n2: float) -> tuple[float, float]:
    """Reflected fractions of power in s and p."""
    s = (n1 * cos_in - n2 * cos_out) / (n1 * cos_in + n2 * cos_out)
    p = (n2 * cos_in - n1 * cos_out) / (n2 * cos_in + n1 * cos_out)
    return s * s, p * p


@compiled
def count_monitors(tables: Tables, sums: Sums, ray: Floats, length: float, loss: float) -> None:
    """Count a straight stretch at every monitor it crosses, with the power left there."""
    ox, oz, dx, dz = ray[0], ray[1], ray[2], ray[3]
    lines = tables.monitor
    for m in range(len(lines)):
        t = segment_hit(lines, m, ox, oz, dx, dz, False)
        if t > length or t == math.inf:
            continue
        power = (ray[4] + ray[5]) * math.exp(-loss * t)
        power = math.copysign(power, lines[m, 2] * dz - lines[m, 3] * dx)
        sums.crossed[m] += power
        sums.crossings[m] += 1
        if tables.bins[m] > 0:
            place = math.hypot(ox + t * dx - lines[m, 0], oz + t * dz - lines[m, 1])
            b = min(int(place / lines[m, 4] * tables.bins[m]), tables.bins[m] - 1)
            sums.maps[tables.first_bin[m] + b] += power


@compiled
def note_leg(sums: Sums, number: int, branch: int, interface: int, fate: int, ray: Floats, length: float) -> None:
    """Keep a straight stretch where there is room; count it in any case. ``ray``: x, z, dx, dz, s, p."""
    row = sums.counts[LEGS]
    if row < len(sums.legs):
        leg = sums.legs[row]
        leg[0], leg[1], leg[2], leg[3] = number, branch, interface, fate
        leg[4], leg[5], leg[6], leg[7] = ray[0], ray[1], ray[2], ray[3]
        leg[8], leg[9], leg[10] = length, ray[4], ray[5]
    sums.counts[LEGS] += 1


@compiled
def note_undefined(sums: Sums, x: float, z: float) -> None:
    """Count a ray that met an interface from a medium it was not in, and remember where."""
    n = sums.counts[UNDEFINED]
    if n < KEPT_PLACES:
        sums.place[n, 0], sums.place[n, 1] = x, z
    sums.counts[UNDEFINED] += 1


@compiled
def end_fate(behaviour: int, from_right: bool, worn_out: bool) -> int:
    """Fate of a ray at an interface of this behaviour; GOES_ON where it leaves it again."""
    if behaviour == RECEIVER and not from_right:
        return DETECTED
    if behaviour in (RECEIVER, ABSORBING):
        return ABSORBED
    return TRUNCATED if worn_out else GOES_ON


@compiled
def interact(
    ray: Floats,
    parts: Floats,
    x: float,
    z: float,
    nx: float,
    nz: float,
    n1: float,
    n2: float,
    mirror: bool,
    split: bool,
) -> None:
    """What an interface makes of a ray arriving at (x, z): ``parts[0]`` goes through, ``parts[1]`` back.

    A ray, like each part, is x, z, dx, dz, s, p; a part that does not exist has no power. The normal is any of the two.
    """
    cos_in = -(ray[2] * nx + ray[3] * nz)
    if cos_in < 0.0:
        cos_in, nx, nz = -cos_in, -nx, -nz
    ratio = n1 / n2
    sin2 = ratio * ratio * (1.0 - cos_in * cos_in)
    back_s, back_p = 1.0, 1.0
    if not mirror and sin2 < 1.0:
        cos_out = math.sqrt(1.0 - sin2)
        bend = ratio * cos_in - cos_out
        tx, tz = ratio * ray[2] + bend * nx, ratio * ray[3] + bend * nz
        scale = 1.0 / math.sqrt(tx * tx + tz * tz)
        parts[0, 2], parts[0, 3] = scale * tx, scale * tz
        back_s, back_p = fresnel(cos_in, cos_out, n1, n2) if split else (0.0, 0.0)
    parts[1, 2], parts[1, 3] = ray[2] + 2.0 * cos_in * nx, ray[3] + 2.0 * cos_in * nz
    for part in range(2):
        parts[part, 0], parts[part, 1] = x, z
    parts[0, 4], parts[0, 5] = ray[4] * (1.0 - back_s), ray[5] * (1.0 - back_p)
    parts[1, 4], parts[1, 5] = ray[4] * back_s, ray[5] * back_p


@compiled
def trace_rays(  # noqa: C901  one loop: numba passes arrays between functions at a price
    tables: Tables, sums: Sums, rays: Floats, first: int, split: bool, min_weight: float, max_hits: int
) -> None:
    """Trace rays (N, 6): x, z, dx, dz, s, p, the first being number ``first``, and add up what becomes of them."""
    kind, shape, behaviour = tables.kind, tables.shape, tables.behaviour
    ray, parts, waiting_ray = np.empty(6), np.empty((2, 6)), np.empty((STACK, 6))
    waiting_state = np.empty((STACK, 4), dtype=np.int64)  # branch, region, last interface, hits
    keeps_legs, has_monitors = len(sums.legs) > 0, len(tables.monitor) > 0
    for i in range(len(rays)):
        ray[:] = rays[i]
        least = min_weight * (ray[4] + ray[5])
        branch, branches, waiting, region, last, hits = 0, 1, 0, -1, -1, 0
        while True:
            power, fate = ray[4] + ray[5], GOES_ON
            found, length = next_hit(kind, shape, ray[0], ray[1], ray[2], ray[3], last)
            if found < 0:
                loss = tables.absorption[region] if split and region >= 0 else 0.0
                fate = ABSORBED if loss > 0.0 else ESCAPED
                if has_monitors:
                    count_monitors(tables, sums, ray, math.inf, loss)
                if keeps_legs:
                    note_leg(sums, first + i, branch, -1, fate, ray, math.inf)
            else:
                sums.counts[HITS] += 1
                x, z = ray[0] + length * ray[2], ray[1] + length * ray[3]
                nx, nz = curve_normal(kind[found], shape, found, x, z)
                from_right = ray[2] * nx + ray[3] * nz > 0.0
                here, there = tables.left[found], tables.right[found]
                if from_right:
                    here, there = there, here
                if region not in (-1, here):
                    fate = TRUNCATED
                    note_undefined(sums, x, z)
                    if keeps_legs:
                        note_leg(sums, first + i, branch, found, fate, ray, length)
                else:
                    loss = tables.absorption[here] if split else 0.0
                    if has_monitors:
                        count_monitors(tables, sums, ray, length, loss)
                    kept = math.exp(-loss * length) if loss > 0.0 else 1.0
                    fate = end_fate(behaviour[found], from_right, hits + 1 >= max_hits or kept * power < least)
                    if keeps_legs:
                        note_leg(sums, first + i, branch, found, fate, ray, length)
                    if loss > 0.0:
                        ray[4] *= kept
                        ray[5] *= kept
                        sums.fate[ABSORBED] += power - (ray[4] + ray[5])
                        power = ray[4] + ray[5]
                    if fate == DETECTED:
                        sums.detected[tables.receiver[found]] += power
                        sums.arrived[tables.receiver[found]] += 1
            if fate == GOES_ON:
                mirror = behaviour[found] == MIRROR
                interact(
                    ray,
                    parts,
                    x,
                    z,
                    nx,
                    nz,
                    tables.refractive_index[here],
                    tables.refractive_index[there],
                    mirror,
                    split,
                )
                on, back = parts[0, 4] + parts[0, 5], parts[1, 4] + parts[1, 5]
                sums.fate[TRUNCATED] += (on if on < least else 0.0) + (back if back < least else 0.0)
                hits, last = hits + 1, found
                weaker = 1 if back <= on else 0
                if on >= least and back >= least:  # the stronger part waits under the branch's number
                    waiting_ray[waiting] = parts[1 - weaker]
                    waiting_state[waiting, 0], waiting_state[waiting, 1] = branch, here if weaker == 0 else there
                    waiting_state[waiting, 2], waiting_state[waiting, 3] = last, hits
                    waiting += 1
                    branch = branches
                    branches += 1
                    ray[:] = parts[weaker]
                    region = here if weaker == 1 else there
                elif on >= least or back >= least:
                    ray[:] = parts[1 - weaker]
                    region = here if weaker == 0 else there
                else:
                    fate, power = TRUNCATED, 0.0  # both parts are counted already
            if fate != GOES_ON:
                sums.fate[fate] += power
                if waiting == 0:
                    break
                waiting -= 1
                ray[:] = waiting_ray[waiting]
                branch, region = waiting_state[waiting, 0], waiting_state[waiting, 1]
                last, hits = waiting_state[waiting, 2], waiting_state[waiting, 3]
