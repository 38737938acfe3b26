"""The nearest interface ahead of each ray in a block.

For each curve, a branch-free inner loop runs over the rays of the block, and the CPU vectorises it. For many curves,
the grid of `solen.trace.kernel.nearest` is used instead, ray by ray.
"""

from typing import NamedTuple

from solen.trace.kernel.buffers import BlockHits, Rays
from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.hits import (
    arc_hit,
    conic_hit,
    may_hit_oval,
    on_oval,
    oval_circle,
    oval_residual,
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
    larger,
    oval_row,
    segment_row,
    smaller,
    typed,
)
from solen.trace.tables import Tables

VECTOR_STEPS = 3


class Bounds(NamedTuple):
    """Lowest and highest x, z, dx and dz in a block of rays."""

    x: tuple[float, float]
    z: tuple[float, float]
    dx: tuple[float, float]
    dz: tuple[float, float]


@compiled
def span(numbers: Floats, n: int) -> tuple[float, float]:
    """Lowest and highest of the first n numbers."""
    low, high = numbers[0], numbers[0]
    for i in range(n):
        low, high = smaller(low, numbers[i]), larger(high, numbers[i])
    return low, high


@compiled
def product(a: tuple[float, float], b: tuple[float, float]) -> tuple[float, float]:
    """Interval of the products of two intervals."""
    p, q, r, s = a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]
    return min(min(p, q), min(r, s)), max(max(p, q), max(r, s))


@compiled
def block_misses(rays: Bounds, box: Floats) -> bool:
    """Whether no ray of a block can meet anything in a box (lowest x, highest x, lowest z, highest z).

    Interval arithmetic bounds the lateral and forward distances between box and rays. Rays that are close together, as
    in a fan, miss most boxes.
    """
    vx, vz = (box[0] - rays.x[1], box[1] - rays.x[0]), (box[2] - rays.z[1], box[3] - rays.z[0])
    a, b = product(rays.dx, vz), product(rays.dz, vx)
    if a[0] - b[1] > 0.0 or a[1] - b[0] < 0.0:
        return True
    return product(rays.dx, vx)[1] + product(rays.dz, vz)[1] < 0.0


@compiled
def find_block(  # noqa: C901  one inner loop per kind of curve
    k: Precision, tables: Tables, n: int, rays: Rays, block_hits: BlockHits
) -> None:
    """Write the nearest hit of the first n rays: distance (or infinity), curve (or −1), parameter."""
    x, z, dx, dz, last, at = rays
    distance, curve, u_hit = block_hits.distance, block_hits.curve, block_hits.u
    if len(tables.grid_item) > 0:
        for i in range(n):
            distance[i], curve[i], u_hit[i] = nearest(k, tables, Ray(x[i], z[i], dx[i], dz[i], last[i], at[i]))
        return
    kind, shape = tables.kind, tables.shape
    for i in range(n):
        distance[i], curve[i], u_hit[i] = k.none, -1, k.zero
    bounds = Bounds(span(x, n), span(z, n), span(dx, n), span(dz, n))
    for c in range(len(kind)):
        if block_misses(bounds, tables.box[c]):
            continue
        tag = typed(curve[0], c)
        if kind[c] == SEGMENT:
            s = segment_row(shape, c)
            for i in range(n):
                t = segment_hit(k, s, x[i], z[i], dx[i], dz[i], last[i] == tag)
                nearer = t < distance[i]
                distance[i] = t if nearer else distance[i]
                curve[i] = tag if nearer else curve[i]
        elif kind[c] == CONIC:
            q = conic_row(shape, c)
            for i in range(n):
                t = conic_hit(k, q, x[i], z[i], dx[i], dz[i], last[i] == tag)
                nearer = t < distance[i]
                distance[i] = t if nearer else distance[i]
                curve[i] = tag if nearer else curve[i]
        elif kind[c] == ARC:
            a = arc_row(shape, c)
            for i in range(n):
                t = arc_hit(k, a, x[i], z[i], dx[i], dz[i], last[i] == tag)
                nearer = t < distance[i]
                distance[i] = t if nearer else distance[i]
                curve[i] = tag if nearer else curve[i]
        elif kind[c] == OVAL:
            oval_block(k, oval_row(shape, c), tag, n, rays, block_hits)
        else:
            for i in range(n):
                t, u = curve_hit(k, tables, c, Ray(x[i], z[i], dx[i], dz[i], last[i], at[i]))
                if t < distance[i]:
                    distance[i], curve[i], u_hit[i] = t, c, u


@compiled
def oval_block(k: Precision, o: Oval, tag: int, n: int, rays: Rays, block_hits: BlockHits) -> None:
    """Test the front of oval ``tag`` against the first n rays, as `solen.trace.kernel.hits.oval_hit` does for one ray.

    Rows of ``work``: row 5 is the root required for a ray (near, far or none), and then its hit; rows 7 to 10 are x, z,
    dx and dz of the rays whose near root is computed by Newton's method; rows 11 and 12 are that root, and whether it
    has converged.
    """
    x, z, dx, dz, last, _ = rays
    distance, curve, _, work, selected = block_hits
    root_of, hit = work[5], work[5]
    for i in range(n):
        leaving = last[i] == tag
        value, slope = oval_residual(k, o, x[i], z[i], dx[i], dz[i])
        outside = (value > 0.0) & (not leaving)
        near = k.one if outside & (slope < 0.0) else k.zero
        far = -k.one if (slope < 0.0) | (not (outside | leaving)) else k.zero
        may_hit = may_hit_oval(k, o, x[i], z[i], dx[i], dz[i], leaving)
        root_of[i] = (near if near > 0.0 else far) if may_hit else k.zero
    m = 0
    for i in range(n):
        if root_of[i] > 0.0:
            selected[m] = i
            work[7, m], work[8, m], work[9, m], work[10, m] = x[i], z[i], dx[i], dz[i]
            m += 1
        elif root_of[i] < 0.0:
            t = oval_root(k, o, x[i], z[i], dx[i], dz[i], k.one)
            if 0.0 < t < distance[i] and on_oval(k, o, x[i] + t * dx[i], z[i] + t * dz[i]):
                distance[i], curve[i] = t, tag
    newton(k, o, m, work)
    for j in range(m):
        t = work[11, j]
        is_hit = (
            (work[12, j] == 1.0) & (t > 0.0) & on_oval(k, o, work[7, j] + t * work[9, j], work[8, j] + t * work[10, j])
        )
        hit[j] = t if is_hit else -k.one
    for j in range(m):
        i, t = selected[j], hit[j]
        if t < 0.0:
            t = remaining_oval_hit(
                k, o, work[7, j], work[8, j], work[9, j], work[10, j], work[11, j], work[12, j] == 1.0
            )
        if t < distance[i]:
            distance[i], curve[i] = t, tag


@compiled
def remaining_oval_hit(
    k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, near_root: float, converged: bool
) -> float:
    """Return the hit of a ray from outside whose near root did not converge in a few steps or is not on the front."""
    t = near_root if converged else oval_root(k, o, x, z, dx, dz, -k.one)
    if t != t:
        return k.none  # NaN: the line misses the oval
    if t > 0.0 and on_oval(k, o, x + t * dx, z + t * dz):
        return t
    t = oval_root(k, o, x, z, dx, dz, k.one)
    return t if t > 0.0 and on_oval(k, o, x + t * dx, z + t * dz) else k.none


@compiled
def newton(k: Precision, o: Oval, m: int, work: Floats) -> None:
    """Take a few Newton steps towards the near root of m rays together; most rays need no more."""
    x, z, dx, dz, distance, converged = work[7], work[8], work[9], work[10], work[11], work[12]
    outwards = -k.one
    for j in range(m):
        t = oval_start(k, o, x[j], z[j], dx[j], dz[j], outwards)
        t, _, missed = oval_step(k, o, x[j], z[j], dx[j], dz[j], t, outwards)
        fallback = oval_circle(o, x[j], z[j], dx[j], dz[j], outwards)
        distance[j] = fallback if missed else t
    for _ in range(VECTOR_STEPS):
        for j in range(m):
            t, done, _ = oval_step(k, o, x[j], z[j], dx[j], dz[j], distance[j], outwards)
            distance[j] = t
            converged[j] = k.one if done else k.zero
