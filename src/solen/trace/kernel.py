"""The compiled loop over rays: tables in, sums out; it holds the same physics as `solen.trace.reference`.

Rays are carried in blocks. For every curve of the scene an inner loop runs over the rays of the block, free of branches
so that the processor handles several rays at once; then each ray is taken through the interface it met, rays that ended
leave their places to branches that wait and to rays not yet launched. A ray that stands on a curve has that curve's
root at zero divided out by algebra (its constant term is zero), never by a distance threshold.

Everything here is compiled by numba without the interpreter's lock, so that chunks of rays run on several threads, and
cached on disk. It lives in one file because the cache of a compiled function looks only at the file it stands in.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from solen.curve import END_TOLERANCE_MM, ROUNDING, SMALL
from solen.trace.result import ABSORBED, CORNER_MM, DETECTED, ESCAPED, GOES_ON, KEPT_PLACES, TRUNCATED
from solen.trace.tables import ABSORBING, ARC, MIRROR, PARABOLA, RECEIVER, SEGMENT, Tables

P = ParamSpec("P")
R = TypeVar("R")
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK = 128
"""Rays carried side by side: enough to fill vector registers, few enough to stay in the nearest cache."""
NEWTON_STEPS = 60
HITS, UNDEFINED, LEGS = range(3)
RUNNING, CONVERGED, MISSED = 0.0, 1.0, 2.0
LEG_WIDTH = 14


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """`numba.njit` with a cache on disk, keeping the types that a checker sees.

    Division follows IEEE 754 (no branch for a zero divisor), and rounding may differ by fused operations and by
    multiplying with a reciprocal; infinities and NaN keep their meaning, parallel rays depend on it.
    """
    options: dict[str, Any] = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "arcp", "nsz"}}
    try:
        return cast("Callable[P, R]", numba.njit(cache=True, **options)(function))
    except RuntimeError:  # nowhere to keep a cache: a read-only installation and no home folder
        return cast("Callable[P, R]", numba.njit(**options)(function))


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
def other_root(a: float, b: float, rest: float) -> float:
    """The root of a t² + b t + rest that is not the one next to 0; see `solen.curve.quadratic_roots`."""
    return -b / a + (rest / b if abs(a * rest) < SMALL * b * b else 0.0)


@compiled
def segment_hits(
    c: int, shape: Floats, n: int, x: Floats, z: Floats, dx: Floats, dz: Floats, last: Ints, best: Floats, found: Ints
) -> None:
    """Segment ``c`` against rays 0 to n: its distance and number go to ``best`` and ``found`` if it is the nearest."""
    ax, az, ux, uz, high = shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4] + END_TOLERANCE_MM
    for i in range(n):
        wx, wz = ax - x[i], az - z[i]
        inverse = 1.0 / (dx[i] * uz - dz[i] * ux)
        t = (wx * uz - wz * ux) * inverse
        place = (wx * dz[i] - wz * dx[i]) * inverse
        hit = (t > 0.0) & (t < best[i]) & (place >= -END_TOLERANCE_MM) & (place <= high) & (last[i] != c)
        best[i] = t if hit else best[i]
        found[i] = c if hit else found[i]


@compiled
def arc_hits(
    c: int, shape: Floats, n: int, x: Floats, z: Floats, dx: Floats, dz: Floats, last: Ints, best: Floats, found: Ints
) -> None:
    """Arc ``c`` against rays 0 to n, as in `segment_hits`."""
    cx, cz, radius, mx, mz = shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4]
    end, at_most_half = shape[c, 5], shape[c, 7] == 1.0
    for i in range(n):
        wx, wz = x[i] - cx, z[i] - cz
        half_b = wx * dx[i] + wz * dz[i]
        rest = wx * wx + wz * wz - radius * radius
        passes = abs(wx * dz[i] - wz * dx[i])  # far away, rounding would drown b² − 4ac
        square = (radius - passes) * (radius + passes)
        root = math.sqrt(max(square, 0.0))
        q = -half_b - (root if half_b >= 0.0 else -root)
        other = other_root(1.0, 2.0 * half_b, rest)
        leaving = last[i] == c
        for t in (other if leaving else q, -1.0 if leaving else rest / q):
            px, pz = wx + t * dx[i], wz + t * dz[i]
            forward, beside = px * mx + pz * mz, abs(px * mz - pz * mx)
            short = (forward >= -END_TOLERANCE_MM) & (beside <= end + END_TOLERANCE_MM)
            long = (forward >= 0.0) | (beside >= end - END_TOLERANCE_MM)
            hit = (t > 0.0) & (t < best[i]) & (leaving | (square >= 0.0)) & (short if at_most_half else long)
            best[i] = t if hit else best[i]
            found[i] = c if hit else found[i]


@compiled
def parabola_hits(
    c: int, shape: Floats, n: int, x: Floats, z: Floats, dx: Floats, dz: Floats, last: Ints, best: Floats, found: Ints
) -> None:
    """Parabola ``c`` against rays 0 to n, as in `segment_hits`; its frame: the axis, and the axis turned by −90°."""
    vx, vz, ax, az, bend = shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4]
    low, high = shape[c, 5] - END_TOLERANCE_MM, shape[c, 6] + END_TOLERANCE_MM
    for i in range(n):
        wx, wz = x[i] - vx, z[i] - vz
        run, rise = wx * ax + wz * az, wx * az - wz * ax
        d_run, d_rise = dx[i] * ax + dz[i] * az, dx[i] * az - dz[i] * ax
        a, b = -bend * d_run * d_run, d_rise - 2.0 * bend * run * d_run
        rest = rise - bend * run * run
        square = b * b - 4.0 * a * rest
        root = math.sqrt(max(square, 0.0))
        q = -0.5 * (b + (root if b >= 0.0 else -root))
        other = other_root(a, b, rest)
        leaving = last[i] == c
        for t in (other if leaving else q / a, -1.0 if leaving else rest / q):
            place = run + t * d_run
            hit = (t > 0.0) & (t < best[i]) & (leaving | (square >= 0.0)) & (place >= low) & (place <= high)
            best[i] = t if hit else best[i]
            found[i] = c if hit else found[i]


@compiled
def oval_hits(
    c: int,
    shape: Floats,
    n: int,
    x: Floats,
    z: Floats,
    dx: Floats,
    dz: Floats,
    last: Ints,
    best: Floats,
    found: Ints,
    work: Floats,
    pick: Ints,
) -> None:
    """Front of oval ``c`` against rays 0 to n, as in `segment_hits`.

    Only rays whose line comes near the front are taken. One that is outside and goes inwards meets the near root first;
    that one, or for a ray inside the far one, counts if it lies on the front. A ray on the front itself can only meet
    the far root. Rays that pass the depth of the front while still inside the convex oval cannot meet it at all.

    Rows of ``work``: 0 to 5 x, z, dx, dz, distance and state of the rays that Newton's method runs on, whose places are
    in ``pick``; 6 to 14 residual, slope, residual at the front's depth, place, x, z, dx, dz and whether it stands on
    the front, of all rays that come near.
    """
    near = oval_near(c, shape, n, x, z, dx, dz, last, work)
    if near == 0:
        return
    oval_classify(c, shape, near, work)
    for far in (False, True):
        m = oval_starts(c, shape, near, work, pick, far)
        if m == 0:
            continue
        oval_newton(c, shape, m, work, 1.0 if far else -1.0)
        for j in range(m):
            i, t = pick[j], work[4, j]
            if (
                work[5, j] == CONVERGED
                and 0.0 < t < best[i]
                and oval_holds(c, shape, x[i] + t * dx[i], z[i] + t * dz[i])
            ):
                best[i] = t
                found[i] = c


@compiled
def oval_holds(c: int, shape: Floats, x: float, z: float) -> bool:
    """Whether a point of the oval is between the rays from the object focus to the front's ends, and faces it."""
    rx, rz, qx, qz = x - shape[c, 0], z - shape[c, 1], x - shape[c, 2], z - shape[c, 3]
    r, q = math.sqrt(rx * rx + rz * rz), math.sqrt(qx * qx + qz * qz)
    right = shape[c, 16] * rz - shape[c, 17] * rx >= -END_TOLERANCE_MM
    left = shape[c, 18] * rz - shape[c, 19] * rx <= END_TOLERANCE_MM
    return bool(right and left and shape[c, 4] * r + shape[c, 5] * (qx * rx + qz * rz) / q < 0.0)


@compiled
def oval_near(
    c: int, shape: Floats, n: int, x: Floats, z: Floats, dx: Floats, dz: Floats, last: Ints, work: Floats
) -> int:
    """Put the rays whose line passes the circle round the front side by side; returns how many."""
    near = 0
    for i in range(n):
        cx, cz = shape[c, 13] - x[i], shape[c, 14] - z[i]
        work[10, near], work[11, near], work[12, near], work[13, near] = x[i], z[i], dx[i], dz[i]
        work[9, near] = i
        work[14, near] = 1.0 if last[i] == c else 0.0
        passes = (abs(cx * dz[i] - cz * dx[i]) <= shape[c, 15]) & (cx * dx[i] + cz * dz[i] > -shape[c, 15])
        near += 1 if passes else 0
    return near


@compiled
def oval_residual(c: int, shape: Floats, x: float, z: float, to_1: float, to_2: float) -> float:
    """Residual of the oval's equation, from the distances to both foci; see `solen.curve.CartesianOval.residual_mm`."""
    wx, wz = x - shape[c, 7], z - shape[c, 8]
    square, forward = wx * wx + wz * wz, wx * shape[c, 9] + wz * shape[c, 10]
    first = (square + 2.0 * shape[c, 6] * forward) / (to_1 + shape[c, 6])
    second = (square - 2.0 * shape[c, 20] * forward) / (to_2 + shape[c, 20])
    return float(shape[c, 4] * first + shape[c, 5] * second)


@compiled
def oval_classify(c: int, shape: Floats, near: int, work: Floats) -> None:
    """Residual and slope where the rays stand, and the residual where they reach the front's depth."""
    x1, z1, x2, z2 = shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3]
    n1, n2 = shape[c, 4], shape[c, 5]
    vx, vz, ax, az, depth = shape[c, 7], shape[c, 8], shape[c, 9], shape[c, 10], shape[c, 11]
    for j in range(near):
        x, z, dx, dz = work[10, j], work[11, j], work[12, j], work[13, j]
        px, pz, qx, qz = x - x1, z - z1, x - x2, z - z2
        p, q = math.sqrt(px * px + pz * pz), math.sqrt(qx * qx + qz * qz)
        slope_1 = (px * dx + pz * dz) / (p if p > 0.0 else 1.0)  # at a focus the mean of both sides, 0
        slope_2 = (qx * dx + qz * dz) / (q if q > 0.0 else 1.0)
        work[6, j] = oval_residual(c, shape, x, z, p, q)
        work[7, j] = n1 * slope_1 + n2 * slope_2
        top = (depth - (x - vx) * ax - (z - vz) * az) / (dx * ax + dz * az)
        px, pz, qx, qz = px + top * dx, pz + top * dz, qx + top * dx, qz + top * dz
        p, q = math.sqrt(px * px + pz * pz), math.sqrt(qx * qx + qz * qz)
        beyond = oval_residual(c, shape, x + top * dx, z + top * dz, p, q)
        work[8, j] = beyond if top > 0.0 else -1.0


@compiled
def oval_starts(c: int, shape: Floats, near: int, work: Floats, pick: Ints, far: bool) -> int:
    """Of the rays near the front take those that may meet the near or the far root on it, with Newton's start."""
    circle = shape[c, 4] * shape[c, 6] / shape[c, 5] + shape[c, 20]  # about the image focus; the oval lies inside it
    outwards = 1.0 if far else -1.0
    m = 0
    for j in range(near):
        leaving = work[14, j] == 1.0
        outside = work[6, j] > 0.0 and not leaving
        x, z, dx, dz = work[10, j], work[11, j], work[12, j], work[13, j]
        rises = dx * shape[c, 9] + dz * shape[c, 10] > 0.0
        away = work[7, j] >= 0.0 and (outside or leaving)
        passes = far and not outside and rises and work[8, j] < 0.0
        if away or passes or (not far and not outside):
            continue
        wx, wz = x - shape[c, 2], z - shape[c, 3]
        middle, nearest = -(wx * dx + wz * dz), wx * dz - wz * dx
        square = circle * circle - nearest * nearest
        if square <= 0.0:
            continue
        pick[m] = int(work[9, j])
        work[0, m], work[1, m], work[2, m], work[3, m] = x, z, dx, dz
        work[4, m] = middle + outwards * math.sqrt(square)
        work[5, m] = RUNNING
        m += 1
    return m


@compiled
def oval_newton(c: int, shape: Floats, m: int, work: Floats, outwards: float) -> None:
    """Newton's method from outside for m rays side by side; ``work`` as in `oval_hits`."""
    x1, z1, x2, z2 = shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3]
    n1, n2 = shape[c, 4], shape[c, 5]
    vx, vz = shape[c, 7], shape[c, 8]
    wx, wz, wdx, wdz, distance, state = work[0], work[1], work[2], work[3], work[4], work[5]
    for _ in range(NEWTON_STEPS):
        running = 0
        for j in range(m):
            px, pz = wx[j] + distance[j] * wdx[j], wz[j] + distance[j] * wdz[j]
            ax, az, bx, bz = px - x1, pz - z1, px - x2, pz - z2
            a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
            value = oval_residual(c, shape, px, pz, a, b)
            slope = n1 * (ax * wdx[j] + az * wdz[j]) / a + n2 * (bx * wdx[j] + bz * wdz[j]) / b
            live = state[j] == RUNNING
            missed = slope * outwards <= 0.0
            distance[j] = distance[j] - value / slope if live & (not missed) else distance[j]
            lengths = abs(distance[j]) + math.sqrt((px - vx) * (px - vx) + (pz - vz) * (pz - vz))
            small = (value <= ROUNDING * lengths * (n1 + n2)) | (abs(value) <= ROUNDING * abs(distance[j] * slope))
            now = MISSED if missed else (CONVERGED if small else RUNNING)
            state[j] = now if live else state[j]
            running += 1 if state[j] == RUNNING else 0
        if running == 0:
            return


@compiled
def find_hits(
    kind: Ints,
    shape: Floats,
    n: int,
    x: Floats,
    z: Floats,
    dx: Floats,
    dz: Floats,
    last: Ints,
    best: Floats,
    found: Ints,
    work: Floats,
    pick: Ints,
) -> None:
    """Nearest interface ahead of rays 0 to n, into ``best`` (inf for none) and ``found`` (−1 for none)."""
    for i in range(n):
        best[i], found[i] = math.inf, -1
    for c in range(len(kind)):
        if kind[c] == SEGMENT:
            segment_hits(c, shape, n, x, z, dx, dz, last, best, found)
        elif kind[c] == PARABOLA:
            parabola_hits(c, shape, n, x, z, dx, dz, last, best, found)
        elif kind[c] == ARC:
            arc_hits(c, shape, n, x, z, dx, dz, last, best, found)
        else:
            oval_hits(c, shape, n, x, z, dx, dz, last, best, found, work, pick)


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
def fresnel(cos_in: float, cos_out: float, n1: float, n2: float) -> tuple[float, float]:
    """Reflected fractions of power in s and p."""
    s = (n1 * cos_in - n2 * cos_out) / (n1 * cos_in + n2 * cos_out)
    p = (n2 * cos_in - n1 * cos_out) / (n2 * cos_in + n1 * cos_out)
    return s * s, p * p


@compiled
def count_monitors(
    tables: Tables, sums: Sums, ox: float, oz: float, dx: float, dz: float, length: float, power: float, loss: float
) -> None:
    """Count a straight stretch at every monitor it crosses, with the power left there."""
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
def note_leg(
    sums: Sums, first: int, state: Floats, tags: Ints, i: int, interface: int, fate: int, length: float, kept: float
) -> None:
    """Keep ray i's straight stretch where there is room, in the order of `solen.trace.result.LEG`; count it anyway."""
    row = sums.counts[LEGS]
    if row < len(sums.legs):
        leg = sums.legs[row]
        leg[0], leg[1], leg[2], leg[3] = first + tags[4, i], tags[3, i], tags[5, i], tags[2, i]
        leg[4], leg[5], leg[10], leg[13] = interface, fate, length, kept
        for k in range(4):
            leg[6 + k] = state[k, i]
        leg[11], leg[12] = state[4, i], state[5, i]
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
    dx: float, dz: float, nx: float, nz: float, n1: float, n2: float, mirror: bool, split: bool
) -> tuple[float, float, float, float, float, float]:
    """What an interface makes of a ray: direction through, direction back, reflected fractions of s and p.

    The normal is either of the two. Counting sends all of a ray through unless it is reflected totally.
    """
    cos_in = -(dx * nx + dz * nz)
    if cos_in < 0.0:
        cos_in, nx, nz = -cos_in, -nx, -nz
    bx, bz = dx + 2.0 * cos_in * nx, dz + 2.0 * cos_in * nz
    mend = 1.5 - 0.5 * (bx * bx + bz * bz)  # its length drifts over thousands of reflections
    bx, bz = mend * bx, mend * bz
    ratio = n1 / n2
    cos2 = (n2 - n1) * (n2 + n1) + (n1 * cos_in) * (n1 * cos_in)  # times n2²; exact also where the indices match
    if mirror or cos2 <= 0.0:
        return 0.0, 0.0, bx, bz, 1.0, 1.0
    cos_out = math.sqrt(cos2) / n2
    bend = ratio * cos_in - cos_out
    tx, tz = ratio * dx + bend * nx, ratio * dz + bend * nz
    scale = 1.0 / math.sqrt(tx * tx + tz * tz)
    if not split:
        return scale * tx, scale * tz, bx, bz, 0.0, 0.0
    back_s, back_p = fresnel(cos_in, cos_out, n1, n2)
    return scale * tx, scale * tz, bx, bz, back_s, back_p


@compiled
def other_side(tables: Tables, last: int, c: int, x: float, z: float, dx: float, dz: float) -> bool:
    """Whether curve ``c`` lies on the other side of the curve a ray stands on than the ray goes to."""
    nx, nz = curve_normal(tables.kind[last], tables.shape, last, x, z)
    towards = (tables.middle[c, 0] - x) * nx + (tables.middle[c, 1] - z) * nz
    return bool(towards * (dx * nx + dz * nz) < 0.0)


@compiled
def trace_rays(  # noqa: C901  one loop: numba passes arrays between functions at a price
    tables: Tables, sums: Sums, rays: Floats, first: int, split: bool, min_weight: float, max_hits: int
) -> None:
    """Trace rays (N, 6): x, z, dx, dz, s, p, the first being number ``first``, and add up what becomes of them."""
    kind, shape, behaviour, index = tables.kind, tables.shape, tables.behaviour, tables.refractive_index
    state, tags = np.empty((7, BLOCK)), np.empty((6, BLOCK), dtype=np.int64)
    x, z, dx, dz, s, p, least = state[0], state[1], state[2], state[3], state[4], state[5], state[6]
    region, last, hits, branch, number, parent = tags[0], tags[1], tags[2], tags[3], tags[4], tags[5]
    best, found = np.empty(BLOCK), np.empty(BLOCK, dtype=np.int64)
    work, pick = np.empty((15, BLOCK + 1)), np.empty(BLOCK, dtype=np.int64)
    waiting_state, waiting_tags = np.empty((4 * BLOCK, 7)), np.empty((4 * BLOCK, 6), dtype=np.int64)
    branches = np.ones(len(rays), dtype=np.int64)
    keeps_legs, has_monitors = len(sums.legs) > 0, len(tables.monitor) > 0
    n, waiting, launched = 0, 0, 0
    while True:
        while n < BLOCK and waiting > 0:
            waiting -= 1
            for k in range(7):
                state[k, n] = waiting_state[waiting, k]
            for k in range(6):
                tags[k, n] = waiting_tags[waiting, k]
            n += 1
        while n < BLOCK and launched < len(rays):
            for k in range(6):
                state[k, n] = rays[launched, k]
            least[n] = min_weight * (s[n] + p[n])
            region[n], last[n], hits[n], branch[n], number[n], parent[n] = -1, -1, 0, 0, launched, -1
            launched += 1
            n += 1
        if n == 0:
            return
        find_hits(kind, shape, n, x, z, dx, dz, last, best, found, work, pick)
        left = 0
        for i in range(n):
            c, length, power = found[i], best[i], s[i] + p[i]
            if c < 0:
                loss = tables.absorption[region[i]] if split and region[i] >= 0 else 0.0
                fate = ABSORBED if loss > 0.0 else ESCAPED
                if has_monitors:
                    count_monitors(tables, sums, x[i], z[i], dx[i], dz[i], math.inf, power, loss)
                if keeps_legs:
                    note_leg(sums, first, state, tags, i, -1, fate, math.inf, 1.0)
                sums.fate[fate] += power
                continue
            px, pz = x[i] + length * dx[i], z[i] + length * dz[i]
            nx, nz = curve_normal(kind[c], shape, c, px, pz)
            from_right = dx[i] * nx + dz[i] * nz > 0.0
            here, there = tables.left[c], tables.right[c]
            if from_right:
                here, there = there, here
            undefined = region[i] != -1 and region[i] != here
            if (
                length <= CORNER_MM
                and last[i] >= 0
                and (undefined or other_side(tables, last[i], c, x[i], z[i], dx[i], dz[i]))
            ):  # it stands in a corner and meets no more than the end of the other curve
                for k in range(7):
                    state[k, left] = state[k, i]
                for k in range(6):
                    tags[k, left] = tags[k, i]
                x[left], z[left], last[left] = x[i] + CORNER_MM * dx[i], z[i] + CORNER_MM * dz[i], c
                left += 1
                continue
            sums.counts[HITS] += 1
            loss = tables.absorption[here] if split and not undefined else 0.0
            kept = math.exp(-loss * length) if loss > 0.0 else 1.0
            worn_out = undefined or hits[i] + 1 >= max_hits or kept * power < least[i]
            fate = TRUNCATED if undefined else end_fate(behaviour[c], from_right, worn_out)
            if undefined:
                note_undefined(sums, px, pz)
            elif has_monitors:
                count_monitors(tables, sums, x[i], z[i], dx[i], dz[i], length, power, loss)
            if keeps_legs:
                note_leg(sums, first, state, tags, i, c, fate, length, kept)
            s_here, p_here = kept * s[i], kept * p[i]
            if loss > 0.0:
                sums.fate[ABSORBED] += power - (s_here + p_here)
                power = s_here + p_here
            if fate != GOES_ON:
                sums.fate[fate] += power
                if fate == DETECTED:
                    sums.detected[tables.receiver[c]] += power
                    sums.arrived[tables.receiver[c]] += 1
                continue
            tx, tz, bx, bz, back_s, back_p = interact(
                dx[i], dz[i], nx, nz, index[here], index[there], behaviour[c] == MIRROR, split
            )
            back_s, back_p = s_here * back_s, p_here * back_p
            on_s, on_p = s_here - back_s, p_here - back_p
            on, back = on_s + on_p, back_s + back_p
            sums.fate[TRUNCATED] += (on if on < least[i] else 0.0) + (back if back < least[i] else 0.0)
            both = on >= least[i] and back >= least[i]
            if not (on >= least[i] or back >= least[i]):
                continue
            goes_back = back <= on if both else back >= least[i]  # of two parts the weaker goes first
            own, above = branch[i], parent[i]
            if both:
                if waiting == len(waiting_state):
                    waiting_state = np.concatenate((waiting_state, np.empty_like(waiting_state)))
                    waiting_tags = np.concatenate((waiting_tags, np.empty_like(waiting_tags)))
                w = waiting_state[waiting]
                w[0], w[1], w[6] = px, pz, least[i]
                if goes_back:
                    w[2], w[3], w[4], w[5] = tx, tz, on_s, on_p
                else:
                    w[2], w[3], w[4], w[5] = bx, bz, back_s, back_p
                tag = waiting_tags[waiting]
                tag[0], tag[1], tag[2] = there if goes_back else here, c, hits[i] + 1
                tag[3], tag[4], tag[5] = own, number[i], above
                waiting += 1
                own, above = branches[number[i]], own
                branches[number[i]] += 1
            hits[left], number[left], least[left], branch[left], parent[left] = (
                hits[i] + 1,
                number[i],
                least[i],
                own,
                above,
            )
            x[left], z[left], last[left] = px, pz, c
            if goes_back:
                dx[left], dz[left], s[left], p[left], region[left] = bx, bz, back_s, back_p, here
            else:
                dx[left], dz[left], s[left], p[left], region[left] = tx, tz, on_s, on_p, there
            left += 1
        n = left
