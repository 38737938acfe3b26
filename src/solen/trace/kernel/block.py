"""The nearest interface ahead of a block of rays.

For every curve an inner loop runs over the rays of the block, free of branches, so that the processor handles several
rays at once. Where there are many curves the grid of `solen.trace.kernel.nearest` takes over, ray by ray.
"""

from typing import NamedTuple

from solen.arrays import IntArray
from solen.trace.kernel.compiled import compiled, never_nan
from solen.trace.kernel.hits import (
    arc_hit,
    conic_hit,
    oval_at,
    oval_circle,
    oval_holds,
    oval_near,
    oval_root,
    oval_start,
    oval_step,
    segment_hit,
)
from solen.trace.kernel.nearest import Ray, curve_hit, nearest
from solen.trace.kernel.rows import (
    ARC,
    CONIC,
    OVAL,
    SEGMENT,
    Floats,
    Oval,
    Precision,
    arc_row,
    conic_row,
    oval_row,
    segment_row,
)
from solen.trace.tables import Tables

BLOCK = 128
"""Rays carried side by side: enough to fill vector registers, few enough to stay in the nearest cache."""
VECTOR_STEPS = 3


class Rays(NamedTuple):
    """A block of rays (BLOCK,): where they are, where they go, the curve they stand on and the parameter there."""

    x: Floats
    z: Floats
    dx: Floats
    dz: Floats
    last: IntArray
    at: Floats


class Found(NamedTuple):
    """What lies ahead of each ray of a block, and room to work in."""

    distance: Floats
    curve: IntArray
    place: Floats
    work: Floats
    pick: IntArray


class Bounds(NamedTuple):
    """Least and greatest x, z, dx, dz of a block of rays."""

    x: tuple[float, float]
    z: tuple[float, float]
    dx: tuple[float, float]
    dz: tuple[float, float]


@never_nan
def span(numbers: Floats, n: int) -> tuple[float, float]:
    """Least and greatest of the first n numbers."""
    low, high = numbers[0], numbers[0]
    for i in range(n):
        low = numbers[i] if numbers[i] < low else low
        high = numbers[i] if numbers[i] > high else high
    return low, high


@compiled
def product(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Interval of the products of two intervals."""
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@compiled
def passes_by(rays: Bounds, box: Floats) -> bool:
    """Whether no ray of a block can meet anything in a box (least x, greatest x, least z, greatest z).

    Interval arithmetic on how far the box lies beside the rays and ahead of them: rays that run together, as those of a
    fan do, pass most curves by.
    """
    vx, vz = (box[0] - rays.x[1], box[1] - rays.x[0]), (box[2] - rays.z[1], box[3] - rays.z[0])
    a, b = product(rays.dx, vz), product(rays.dz, vx)
    if a[0] - b[1] > 0.0 or a[1] - b[0] < 0.0:
        return True
    return product(rays.dx, vx)[1] + product(rays.dz, vz)[1] < 0.0


@compiled
def find_block(  # noqa: C901  one inner loop per kind of curve
    k: Precision, tables: Tables, n: int, rays: Rays, found: Found
) -> None:
    """Nearest interface ahead of rays 0 to n: distance (infinity for none), which (−1), parameter there."""
    x, z, dx, dz, last, at = rays
    best, which, place, work, pick = found
    if len(tables.grid_item) > 0:
        for i in range(n):
            best[i], which[i], place[i] = nearest(k, tables, Ray(x[i], z[i], dx[i], dz[i], last[i], at[i]))
        return
    kind, shape = tables.kind, tables.shape
    for i in range(n):
        best[i], which[i], place[i] = k.none, -1, k.zero
    bounds = Bounds(span(x, n), span(z, n), span(dx, n), span(dz, n))
    for c in range(len(kind)):
        if passes_by(bounds, tables.box[c]):
            continue
        if kind[c] == SEGMENT:
            s = segment_row(shape, c)
            for i in range(n):
                t = segment_hit(k, s, x[i], z[i], dx[i], dz[i], last[i] == c)
                nearer = t < best[i]
                best[i] = t if nearer else best[i]
                which[i] = c if nearer else which[i]
        elif kind[c] == CONIC:
            q = conic_row(shape, c)
            for i in range(n):
                t = conic_hit(k, q, x[i], z[i], dx[i], dz[i], last[i] == c)
                nearer = t < best[i]
                best[i] = t if nearer else best[i]
                which[i] = c if nearer else which[i]
        elif kind[c] == ARC:
            a = arc_row(shape, c)
            for i in range(n):
                t = arc_hit(k, a, x[i], z[i], dx[i], dz[i], last[i] == c)
                nearer = t < best[i]
                best[i] = t if nearer else best[i]
                which[i] = c if nearer else which[i]
        elif kind[c] == OVAL:
            oval_block(k, shape, c, n, rays, best, which, work, pick)
        else:
            for i in range(n):
                t, u = curve_hit(k, tables, c, Ray(x[i], z[i], dx[i], dz[i], last[i], at[i]))
                if t < best[i]:
                    best[i], which[i], place[i] = t, c, u


@compiled
def oval_block(  # noqa: C901  several inner loops over one set of rays
    k: Precision, shape: Floats, c: int, n: int, rays: Rays, best: Floats, which: IntArray, work: Floats, pick: IntArray
) -> None:
    """Front of oval ``c`` against rays 0 to n; as `solen.trace.kernel.hits.oval_hit`, in steps over many rays.

    Rows of ``work``: x, z, dx, dz, number, residual, slope of the rays that come near; from row 7 the same of those
    that Newton's method runs on, with distance and state in place of residual and slope.
    """
    o = oval_row(shape, c)
    mask = work[5]
    for i in range(n):
        comes = oval_near(k, o, rays.x[i], rays.z[i], rays.dx[i], rays.dz[i], rays.last[i] == c)
        mask[i] = k.one if comes else k.zero
    near = 0
    for i in range(n):
        if mask[i] == 1.0:
            pick[near] = i
            work[0, near], work[1, near], work[2, near], work[3, near] = rays.x[i], rays.z[i], rays.dx[i], rays.dz[i]
            near += 1
    if near == 0:
        return
    for j in range(near):
        work[5, j], work[6, j] = oval_at(k, o, work[0, j], work[1, j], work[2, j], work[3, j])
    m = 0
    for j in range(near):
        i = pick[j]
        outside = work[5, j] > 0.0 and rays.last[i] != c
        if work[6, j] < 0.0 and outside:
            for row in range(4):
                work[7 + row, m] = work[row, j]
            work[4, m] = i
            m += 1
        elif work[6, j] < 0.0 or (not outside and rays.last[i] != c):
            x, z, dx, dz = work[0, j], work[1, j], work[2, j], work[3, j]
            t = oval_root(k, o, x, z, dx, dz, k.one)
            if 0.0 < t < best[i] and oval_holds(k, o, x + t * dx, z + t * dz):
                best[i], which[i] = t, c
    newton(k, o, m, work)
    for j in range(m):
        i, x, z, dx, dz = int(work[4, j]), work[7, j], work[8, j], work[9, j], work[10, j]
        t = work[11, j] if work[12, j] == 1.0 else oval_root(k, o, x, z, dx, dz, -k.one)
        if t != t:
            continue  # the line misses the oval
        if t > 0.0 and oval_holds(k, o, x + t * dx, z + t * dz):
            if t < best[i]:
                best[i], which[i] = t, c
            continue
        t = oval_root(k, o, x, z, dx, dz, k.one)
        if 0.0 < t < best[i] and oval_holds(k, o, x + t * dx, z + t * dz):
            best[i], which[i] = t, c


@compiled
def newton(k: Precision, o: Oval, m: int, work: Floats) -> None:
    """A few steps of Newton's method to the near root for m rays side by side; most need no more."""
    x, z, dx, dz, distance, settled = work[7], work[8], work[9], work[10], work[11], work[12]
    outwards = -k.one
    for j in range(m):
        t = oval_start(k, o, x[j], z[j], dx[j], dz[j], outwards)
        t, _, missed = oval_step(k, o, x[j], z[j], dx[j], dz[j], t, outwards)
        again = oval_circle(o, x[j], z[j], dx[j], dz[j], outwards)
        distance[j] = again if missed else t
    for _ in range(VECTOR_STEPS):
        for j in range(m):
            t, done, _ = oval_step(k, o, x[j], z[j], dx[j], dz[j], distance[j], outwards)
            distance[j] = t
            settled[j] = k.one if done else k.zero
