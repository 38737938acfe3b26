"""Hits of a ray on a curve: one function per kind of curve, with the same mathematics as `solen.curve`.

Each function takes a row of `solen.trace.tables.Tables.shape` and a ray, and returns the distance to the nearest hit
ahead, or ``k.none`` (infinity) for none. Most functions have no loops and almost no branches, so a loop over rays that
calls one of them can be vectorised; on a GPU the same functions treat one ray at a time.

Arithmetic uses no literals: numbers come from the tables and from ``k``, so single precision is preserved.
"""

import math

from solen.trace.kernel.compiled import compiled, rounded
from solen.trace.kernel.rows import Arc, Conic, Cubic, Oval, Precision, Segment

STEPS = 60


@compiled
def segment_hit(k: Precision, s: Segment, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to a segment."""
    wx, wz = s.ax - x, s.az - z
    inverse = k.one / (dx * s.uz - dz * s.ux)
    t = (wx * s.uz - wz * s.ux) * inverse
    position = (wx * dz - wz * dx) * inverse
    hit = (t > 0.0) & (position >= -k.end) & (position <= s.length + k.end) & (not leaving)
    return t if hit else k.none


@compiled
def roots(k: Precision, a: float, half_b: float, rest: float, square: float, leaving: bool) -> tuple[float, float]:
    """Return the roots of a t² + 2 half_b t + rest; ``square`` = half_b² − a rest. See `solen.curve.quadratic_roots`.

    A ray that is ``leaving`` has one root near 0, which is omitted (−1). The other root is corrected with the remainder
    to first order: −b/a + rest/b. Operands are selected before the division, because divisions are slow.
    """
    root = math.sqrt(max(square, k.zero))
    q = -half_b - (root if half_b >= 0.0 else -root)
    b = half_b + half_b
    correction = a * rest if abs(a * rest) < k.small * b * b else k.zero
    first = (correction - b * b if leaving else q) / (a * b if leaving else a)
    second = -k.one if leaving else rest / q
    missed = (not leaving) & (square <= 0.0)  # a tangent line does not cross the curve
    return (-k.one if missed else first), (-k.one if missed else second)


@compiled
def arc_hit(k: Precision, a: Arc, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to an arc."""
    wx, wz = x - a.cx, z - a.cz
    half_b = wx * dx + wz * dz
    rest = wx * wx + wz * wz - a.radius * a.radius
    nearest = abs(wx * dz - wz * dx)  # for a distant origin, rounding would swamp b² − 4ac
    square = (a.radius - nearest) * (a.radius + nearest)
    t1, t2 = roots(k, k.one, half_b, rest, square, leaving)
    t1 = t1 if (t1 > 0.0) & on_arc(k, a, wx + t1 * dx, wz + t1 * dz) else k.none
    t2 = t2 if (t2 > 0.0) & on_arc(k, a, wx + t2 * dx, wz + t2 * dz) else k.none
    return min(t1, t2)


@compiled
def on_arc(k: Precision, a: Arc, px: float, pz: float) -> bool:
    """Whether a point on the circle, relative to its centre, is on the arc."""
    forward, sideways = px * a.mx + pz * a.mz, abs(px * a.mz - pz * a.mx)
    short = (forward >= -k.end) & (sideways <= a.end + k.end)
    long = (forward >= 0.0) | (sideways >= a.end - k.end)
    return bool(((a.at_most_half == 1.0) & short) | ((a.at_most_half != 1.0) & long))


@compiled
def conic_hit(k: Precision, q: Conic, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to a conic c r² − 2 w + b w² = 0, of which only the vertex side and branch, b w < 1, are used."""
    wx, wz = x - q.vx, z - q.vz
    r, w = wx * q.lx + wz * q.lz, wz * q.lx - wx * q.lz
    dr, dw = dx * q.lx + dz * q.lz, dz * q.lx - dx * q.lz
    a = q.c * dr * dr + q.b * dw * dw
    half_b = q.c * r * dr - dw + q.b * w * dw
    rest = q.c * r * r - (w + w) + q.b * w * w
    moment = w * dr - r * dw
    square = dw * dw + q.c * moment * (dr + dr - q.b * moment)  # half_b² − a rest, also accurate for a distant origin
    t1, t2 = roots(k, a, half_b, rest, square, leaving)
    t1 = t1 if (t1 > 0.0) & on_conic(k, q, r + t1 * dr, w + t1 * dw) else k.none
    t2 = t2 if (t2 > 0.0) & on_conic(k, q, r + t2 * dr, w + t2 * dw) else k.none
    return min(t1, t2)


@compiled
def on_conic(k: Precision, q: Conic, r: float, w: float) -> bool:
    """Whether a point of the conic is on the piece, and on the vertex side and branch."""
    return bool((r >= q.low - k.end) & (r <= q.high + k.end) & (q.b * w < 1.0))


@compiled
def unit(x: float, z: float, side: float) -> tuple[float, float]:
    """A vector scaled to the length ``side``."""
    scale = side / math.sqrt(x * x + z * z)
    return scale * x, scale * z


@compiled
def arc_normal(a: Arc, x: float, z: float) -> tuple[float, float]:
    """Left unit normal of an arc at one of its points."""
    return unit(a.cx - x, a.cz - z, a.side)


@compiled
def conic_normal(k: Precision, q: Conic, x: float, z: float) -> tuple[float, float]:
    """Left unit normal of a conic at one of its points."""
    wx, wz = x - q.vx, z - q.vz
    r, w = wx * q.lx + wz * q.lz, wz * q.lx - wx * q.lz
    across, inwards = -q.c * r, k.one - q.b * w
    return unit(across * q.lx - inwards * q.lz, across * q.lz + inwards * q.lx, q.side)


@compiled
def oval_normal(o: Oval, x: float, z: float) -> tuple[float, float]:
    """Left unit normal of an oval front at one of its points."""
    ax, az, bx, bz = x - o.x1, z - o.z1, x - o.x2, z - o.z2
    f1, f2 = o.n1 / math.sqrt(ax * ax + az * az), o.n2 / math.sqrt(bx * bx + bz * bz)
    return unit(f1 * ax + f2 * bx, f1 * az + f2 * bz, o.side)


# The Cartesian oval. Along a line its residual is convex: Newton's method from any point where the slope has the sign
# of the required root steps outside at most once and then converges to that root without overshoot.


@compiled
def may_hit_oval(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, leaving: bool) -> bool:
    """Whether a ray may meet the front: a test with straight lines, which avoids Newton's method for most rays.

    The front is in the convex hull of its ends and of the intersections of three of its tangents. The front and its
    chord enclose a convex cap: a ray that leaves the cap through the chord, or that is behind the chord and moves away,
    does not meet the front.
    """
    height, height_rate = (z - o.az) * o.ux - (x - o.ax) * o.uz, dz * o.ux - dx * o.uz
    a, d = dx * (o.az - z) - dz * (o.ax - x), dx * (o.dz - z) - dz * (o.dx - x)
    b, c = dx * (o.bz - z) - dz * (o.bx - x), dx * (o.cz - z) - dz * (o.cx - x)
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    passes = (low > k.margin) | (high < -k.margin)
    between = ((a > k.margin) & (d < -k.margin)) | ((a < -k.margin) & (d > k.margin))
    leaves_cap = leaving & between & (height_rate > 0.0)
    behind_chord = (height > k.margin) & (height_rate >= 0.0)
    return not (passes | leaves_cap | behind_chord)


@compiled
def oval_residual(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float) -> tuple[float, float]:
    """Residual of the oval equation and its slope along a direction, both multiplied by positive numbers.

    The equation is n1 (|P − F1| − s) + n2 (|P − F2| − s'), with each bracket as a difference of squares over a sum.
    """
    ax, az, bx, bz, vx, vz = x - o.x1, z - o.z1, x - o.x2, z - o.z2, x - o.vx, z - o.vz
    a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
    square, forward = vx * vx + vz * vz, vx * o.wx + vz * o.wz
    first = o.n1 * (square + (o.s1 + o.s1) * forward) * (b + o.s2)
    second = o.n2 * (square - (o.s2 + o.s2) * forward) * (a + o.s1)
    a_along = ax * dx + az * dz
    at_focus = a == 0.0  # at F1 the distance from F1 increases in any direction
    a_along, a = (k.one if at_focus else a_along), (k.one if at_focus else a)
    return first + second, o.n1 * b * a_along + o.n2 * a * (bx * dx + bz * dz)


@compiled
def oval_start(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, outwards: float) -> float:
    """Starting value for Newton's method: at the conic r² = p0 + p1 w + p2 w² fitted to the front, or near it."""
    vx, vz = x - o.vx, z - o.vz
    w, r = vx * o.wx + vz * o.wz, vx * o.wz - vz * o.wx
    dw, dr = dx * o.wx + dz * o.wz, dx * o.wz - dz * o.wx
    a = dr * dr - o.p2 * dw * dw
    half_b = r * dr - dw * (o.p1 * k.half + o.p2 * w)
    rest = r * r - o.p0 - w * (o.p1 + o.p2 * w)
    root = outwards * math.sqrt(max(half_b * half_b - a * rest, k.zero))
    return (root - half_b) / a if half_b * outwards < 0.0 else -rest / (half_b + root)


@compiled
def oval_circle(o: Oval, x: float, z: float, dx: float, dz: float, outwards: float) -> float:
    """Starting value outside the oval: an intersection with the circle about F2 that contains it; NaN for none."""
    wx, wz = x - o.x2, z - o.z2
    middle, offset = -(wx * dx + wz * dz), wx * dz - wz * dx
    return middle + outwards * math.sqrt(o.circle * o.circle - offset * offset)


@compiled
def oval_step(
    k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, t: float, outwards: float
) -> tuple[float, bool, bool]:
    """One Newton step along a ray: the new distance, whether this is the root, and whether there is no root.

    After a step h the error is at most h² f''/2 f', and f'' is at most n1/|P − F1| + n2/|P − F2|.
    """
    px, pz = x + t * dx, z + t * dz
    ax, az, bx, bz, vx, vz = px - o.x1, pz - o.z1, px - o.x2, pz - o.z2, px - o.vx, pz - o.vz
    a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
    square, forward = vx * vx + vz * vz, vx * o.wx + vz * o.wz
    first = o.n1 * (square + (o.s1 + o.s1) * forward) * (b + o.s2)
    second = o.n2 * (square - (o.s2 + o.s2) * forward) * (a + o.s1)
    slope = o.n1 * b * (ax * dx + az * dz) + o.n2 * a * (bx * dx + bz * dz)
    step = (first + second) * (a * b) / ((a + o.s1) * (b + o.s2) * slope)
    missed = slope * outwards <= 0.0
    converged = (o.n1 * b + o.n2 * a) * step * step <= k.rounding * (abs(t) + a + o.s1) * abs(slope)
    return (t if missed else t - step), bool(converged & (not missed)), missed


@compiled
def oval_root(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, outwards: float) -> float:
    """Distance of the near (``outwards`` −1) or far root (+1) on the entire oval; NaN if the ray misses the oval."""
    t = oval_start(k, o, x, z, dx, dz, outwards)
    t, converged, missed = oval_step(k, o, x, z, dx, dz, t, outwards)
    if missed or t != t:
        t = oval_circle(o, x, z, dx, dz, outwards)
        converged, missed = False, t != t
    for _ in range(STEPS):
        if converged or missed:
            break
        t, converged, missed = oval_step(k, o, x, z, dx, dz, t, outwards)
    return t if converged else k.nan


@compiled
def on_oval(k: Precision, o: Oval, x: float, z: float) -> bool:
    """Whether a point of the oval is on the front: between its ends as seen from the object focus, and facing it."""
    rx, rz, qx, qz = x - o.x1, z - o.z1, x - o.x2, z - o.z2
    r, q = math.sqrt(rx * rx + rz * rz), math.sqrt(qx * qx + qz * qz)
    right, left = o.rx * rz - o.rz * rx >= -k.end, o.lx * rz - o.lz * rx <= k.end
    return bool(right & left & (o.n1 * r * q + o.n2 * (qx * rx + qz * rz) < 0.0))


@compiled
def oval_hit(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to the front of an oval."""
    if not may_hit_oval(k, o, x, z, dx, dz, leaving):
        return k.none
    value, slope = oval_residual(k, o, x, z, dx, dz)
    outside = value > 0.0 and not leaving
    if slope >= 0.0 and (outside or leaving):
        return k.none  # the ray moves away from a convex region
    if outside:
        t = oval_root(k, o, x, z, dx, dz, -k.one)
        if t > 0.0 and on_oval(k, o, x + t * dx, z + t * dz):
            return t
    t = oval_root(k, o, x, z, dx, dz, k.one)
    return t if t > 0.0 and on_oval(k, o, x + t * dx, z + t * dz) else k.none


# Cubic pieces. A piece turns by less than 90 degrees and has no inflection, so that a line meets it at most twice, and
# the distance f(u) of its points from the line has at most one extremum. The signs of f at the ends are those of the
# control points there, which neighbouring pieces share: no ray slips between them.


@rounded
def product(a: float, b: float) -> float:
    """A separately rounded product; `solen.trace.kernel.cuda` replaces it, because a GPU fuses products with sums."""
    return a * b


@rounded
def lateral(dx: float, dz: float, x: float, z: float) -> float:
    """Lateral distance of a point from the line of a ray, with the same sign for both pieces at a joint."""
    return product(dx, z) - product(dz, x)


@compiled
def cubic_hit(
    k: Precision, q: Cubic, x: float, z: float, dx: float, dz: float, leaving: bool, u_start: float, offset: float
) -> tuple[float, float]:
    """Return the distance to a cubic piece, and the parameter there.

    ``leaving`` means that the ray starts on this piece, at the parameter ``u_start``. ``offset`` is the apparent
    lateral distance of a ray that starts on the neighbouring piece. It is a rounding error, and is subtracted because a
    ray that leaves at a small angle would otherwise meet this piece immediately.
    """
    f0, f1 = lateral(dx, dz, q.x0 - x, q.z0 - z) - offset, lateral(dx, dz, q.x1 - x, q.z1 - z) - offset
    f2, f3 = lateral(dx, dz, q.x2 - x, q.z2 - z) - offset, lateral(dx, dz, q.x3 - x, q.z3 - z) - offset
    c1 = k.three * (f1 - f0)
    c2 = k.three * ((f2 - f1) - (f1 - f0))
    c3 = (f3 - f0) - k.three * (f2 - f1)
    if leaving:
        return cubic_other_hit(k, q, x, z, dx, dz, u_start, f0, c1, c2, c3)
    margin = k.end if q.before_per_mm > 0.0 or q.after_per_mm > 0.0 else k.zero
    if min(min(f0, f1), min(f2, f3)) > margin or max(max(f0, f1), max(f2, f3)) < -margin:
        return k.none, k.zero  # the entire hull is on one side
    distance, u_hit = k.none, k.zero
    u_top = cubic_extremum(k, f0, f1, f2, f3)
    ends = (k.zero, u_top, k.one)
    f_top = f0 + u_top * (c1 + u_top * (c2 + u_top * c3))
    f_top = f3 if u_top >= 1.0 else f0 if u_top <= 0.0 else f_top  # the same sign as for the next piece
    for half in range(2):
        low, high = ends[half], ends[half + 1]
        f_low, f_high = (f0, f_top) if half == 0 else (f_top, f3)
        if (f_low < 0.0) == (f_high < 0.0) or low >= high:
            continue
        u = cubic_root(k, f0, c1, c2, c3, low, high, f_low < 0.0)
        t = cubic_distance(k, q, x, z, dx, dz, u)
        if 0.0 < t < distance:
            distance, u_hit = t, u
    for end in range(2):  # the straight extension beyond an end of the complete curve
        u = -f0 / c1 if end == 0 else k.one - f3 / (k.three * (f3 - f2))
        on_extension = (
            (-q.before_per_mm * k.end <= u < 0.0) if end == 0 else (1.0 < u <= k.one + q.after_per_mm * k.end)
        )
        t = cubic_distance(k, q, x, z, dx, dz, u) if on_extension else k.none
        if 0.0 < t < distance:
            distance, u_hit = t, u
    return distance, u_hit


@compiled
def cubic_offset(k: Precision, q: Cubic, x: float, z: float, dx: float, dz: float, u: float) -> float:
    """Lateral distance between the line of a ray and the point of a piece at a parameter."""
    px, pz = cubic_point(k, q, u)
    return dx * (pz - z) - dz * (px - x)


@compiled
def cubic_extremum(k: Precision, f0: float, f1: float, f2: float, f3: float) -> float:
    """Parameter at which f has its extremum; 1 if there is no extremum inside.

    f' is proportional to g0 (1 − u)² + 2 g1 u (1 − u) + g2 u²; if g0 and g2 differ in sign, it has one root.
    """
    g0, g1, g2 = f1 - f0, f2 - f1, f3 - f2
    if (g0 < 0.0) == (g2 < 0.0) or g0 == 0.0:
        return k.one
    root = math.sqrt(g1 * g1 - g0 * g2)
    q = -(g1 + (root if g1 >= 0.0 else -root))
    return q / (q + g2) if q * g2 > 0.0 else g0 / (g0 + q)


@compiled
def cubic_root(
    k: Precision, f0: float, c1: float, c2: float, c3: float, low: float, high: float, rising: bool
) -> float:
    """Root of f0 + c1 u + c2 u² + c3 u³ in a bracket where it is monotonic: Newton's method with bisection."""
    u = k.half * (low + high)
    for _ in range(STEPS):
        value = f0 + u * (c1 + u * (c2 + u * c3))
        if (value < 0.0) == rising:
            low = u
        else:
            high = u
        slope = c1 + u * (c2 + c2 + k.three * u * c3)
        u_next = u - value / slope
        if not low <= u_next <= high:
            u_next = k.half * (low + high)
        if abs(u_next - u) <= k.rounding or value == 0.0:
            return u_next
        u = u_next
    return u


@compiled
def cubic_other_hit(
    k: Precision,
    q: Cubic,
    x: float,
    z: float,
    dx: float,
    dz: float,
    u_start: float,
    f0: float,
    c1: float,
    c2: float,
    c3: float,
) -> tuple[float, float]:
    """Return the other hit of a ray that starts on the piece: division of f by (u − u_start) leaves a quadratic."""
    rest = f0 + u_start * (c1 + u_start * (c2 + u_start * c3))
    b1 = c1 + u_start * (c2 + c2 + k.three * u_start * c3)
    b2 = c2 + k.three * u_start * c3
    square = b2 * b2 - (c3 + c3 + c3 + c3) * b1
    if square < 0.0:
        return k.none, k.zero
    root = math.sqrt(square)
    q_sum = -k.half * (b2 + (root if b2 >= 0.0 else -root))
    distance, u_hit = k.none, k.zero
    for i in range(2):
        v = q_sum / c3 if i == 0 else b1 / q_sum
        slope = b1 + v * (b2 + b2 + k.three * v * c3)
        v -= rest / slope if abs(rest) < k.small * abs(slope * v) else k.zero
        u = u_start + v
        t = cubic_distance(k, q, x, z, dx, dz, u)
        if -q.before_per_mm * k.end <= u <= k.one + q.after_per_mm * k.end and 0.0 < t < distance:
            distance, u_hit = t, u
    return distance, u_hit


@compiled
def cubic_distance(k: Precision, q: Cubic, x: float, z: float, dx: float, dz: float, u: float) -> float:
    """Distance along a ray to the point of a piece at a parameter."""
    px, pz = cubic_point(k, q, u)
    return (px - x) * dx + (pz - z) * dz


@compiled
def cubic_point(k: Precision, q: Cubic, u: float) -> tuple[float, float]:
    """Point of a piece at a parameter."""
    v = k.one - u
    a, b, c, d = v * v * v, k.three * v * v * u, k.three * v * u * u, u * u * u
    return a * q.x0 + b * q.x1 + c * q.x2 + d * q.x3, a * q.z0 + b * q.z1 + c * q.z2 + d * q.z3


@compiled
def cubic_tangent(k: Precision, q: Cubic, u: float) -> tuple[float, float]:
    """Direction of a piece at a parameter, not normalised."""
    v = k.one - u
    a, b, c = v * v, (v + v) * u, u * u
    tx = a * (q.x1 - q.x0) + b * (q.x2 - q.x1) + c * (q.x3 - q.x2)
    tz = a * (q.z1 - q.z0) + b * (q.z2 - q.z1) + c * (q.z3 - q.z2)
    return tx, tz
