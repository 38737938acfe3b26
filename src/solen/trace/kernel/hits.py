"""Hits of a ray on a curve: one function per kind of curve, with the same mathematics as `solen.curve`.

Each function takes a row of `solen.trace.tables.Tables.shape` and a ray, and returns the distance to the nearest hit
ahead, or ``k.none`` (infinity) for none. The functions have no loops and almost no branches, so a loop over rays that
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
    place = (wx * dz - wz * dx) * inverse
    hit = (t > 0.0) & (place >= -k.end) & (place <= s.length + k.end) & (not leaving)
    return t if hit else k.none


@compiled
def roots(k: Precision, a: float, half_b: float, rest: float, square: float, leaving: bool) -> tuple[float, float]:
    """Return the roots of a t² + 2 half_b t + rest; ``square`` = half_b² − a rest. See `solen.curve.quadratic_roots`.

    A ray that is ``leaving`` has one root near 0, which is omitted (−1). The other root is corrected with the remainder
    to first order: −b/a + rest/b. Operands are selected before the division, because divisions are slow.
    """
    root = math.sqrt(max(square, k.zero))
    total = -half_b - (root if half_b >= 0.0 else -root)
    b = half_b + half_b
    mend = a * rest if abs(a * rest) < k.small * b * b else k.zero
    first = (mend - b * b if leaving else total) / (a * b if leaving else a)
    second = -k.one if leaving else rest / total
    missed = (not leaving) & (square <= 0.0)  # a tangent line does not cross the curve
    return (-k.one if missed else first), (-k.one if missed else second)


@compiled
def arc_hit(k: Precision, a: Arc, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to an arc."""
    wx, wz = x - a.cx, z - a.cz
    half_b = wx * dx + wz * dz
    rest = wx * wx + wz * wz - a.radius * a.radius
    passes = abs(wx * dz - wz * dx)  # far away, b² − 4ac would be lost to rounding
    square = (a.radius - passes) * (a.radius + passes)
    t1, t2 = roots(k, k.one, half_b, rest, square, leaving)
    t1 = t1 if (t1 > 0.0) & on_arc(k, a, wx + t1 * dx, wz + t1 * dz) else k.none
    t2 = t2 if (t2 > 0.0) & on_arc(k, a, wx + t2 * dx, wz + t2 * dz) else k.none
    return min(t1, t2)


@compiled
def on_arc(k: Precision, a: Arc, px: float, pz: float) -> bool:
    """Whether a point on the circle, relative to its centre, is on the arc."""
    forward, beside = px * a.mx + pz * a.mz, abs(px * a.mz - pz * a.mx)
    short = (forward >= -k.end) & (beside <= a.end + k.end)
    long = (forward >= 0.0) | (beside >= a.end - k.end)
    return bool(((a.at_most_half == 1.0) & short) | ((a.at_most_half != 1.0) & long))


@compiled
def conic_hit(k: Precision, q: Conic, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to a conic c r² − 2 w + b w² = 0; only the sheet through its vertex, where b w < 1, exists."""
    wx, wz = x - q.vx, z - q.vz
    r, w = wx * q.lx + wz * q.lz, wz * q.lx - wx * q.lz
    dr, dw = dx * q.lx + dz * q.lz, dz * q.lx - dx * q.lz
    a = q.c * dr * dr + q.b * dw * dw
    half_b = q.c * r * dr - dw + q.b * w * dw
    rest = q.c * r * r - (w + w) + q.b * w * w
    moment = w * dr - r * dw
    square = dw * dw + q.c * moment * (dr + dr - q.b * moment)  # half_b² − a rest, without loss of digits far away
    t1, t2 = roots(k, a, half_b, rest, square, leaving)
    t1 = t1 if (t1 > 0.0) & on_conic(k, q, r + t1 * dr, w + t1 * dw) else k.none
    t2 = t2 if (t2 > 0.0) & on_conic(k, q, r + t2 * dr, w + t2 * dw) else k.none
    return min(t1, t2)


@compiled
def on_conic(k: Precision, q: Conic, r: float, w: float) -> bool:
    """Whether a point of the conic is on the piece and on the sheet through the vertex."""
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
def oval_near(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, leaving: bool) -> bool:
    """Whether a ray may meet the front: a test with straight lines, which avoids Newton's method for most rays.

    The front is in the convex hull of its ends and of the intersections of three of its tangents. With its chord it
    encloses a convex cap: a ray that leaves the cap through the chord, or that is beyond the chord and moves away, does
    not meet the front.
    """
    height, climb = (z - o.az) * o.ux - (x - o.ax) * o.uz, dz * o.ux - dx * o.uz
    a, d = dx * (o.az - z) - dz * (o.ax - x), dx * (o.dz - z) - dz * (o.dx - x)
    b, c = dx * (o.bz - z) - dz * (o.bx - x), dx * (o.cz - z) - dz * (o.cx - x)
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    past = (low > k.margin) | (high < -k.margin)
    between = ((a > k.margin) & (d < -k.margin)) | ((a < -k.margin) & (d > k.margin))
    leaves = leaving & between & (climb > 0.0)
    beyond = (height > k.margin) & (climb >= 0.0)
    return not (past | leaves | beyond)


@compiled
def oval_at(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float) -> tuple[float, float]:
    """Residual of the oval equation and its slope along a direction, both multiplied by positive numbers.

    The equation is n1 (|P − F1| − s) + n2 (|P − F2| − s'), with each bracket as a difference of squares over a sum.
    """
    ax, az, bx, bz, vx, vz = x - o.x1, z - o.z1, x - o.x2, z - o.z2, x - o.vx, z - o.vz
    a, b = math.sqrt(ax * ax + az * az), math.sqrt(bx * bx + bz * bz)
    square, forward = vx * vx + vz * vz, vx * o.wx + vz * o.wz
    first = o.n1 * (square + (o.s1 + o.s1) * forward) * (b + o.s2)
    second = o.n2 * (square - (o.s2 + o.s2) * forward) * (a + o.s1)
    forth = ax * dx + az * dz
    at_focus = a == 0.0  # at the emitter the distance from F1 grows in any direction
    forth, a = (k.one if at_focus else forth), (k.one if at_focus else a)
    return first + second, o.n1 * b * forth + o.n2 * a * (bx * dx + bz * dz)


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
    """Intersection of the line with the circle about F2 that contains the oval, as a start outside; NaN for none."""
    wx, wz = x - o.x2, z - o.z2
    middle, nearest = -(wx * dx + wz * dz), wx * dz - wz * dx
    return middle + outwards * math.sqrt(o.circle * o.circle - nearest * nearest)


@compiled
def oval_step(
    k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, t: float, outwards: float
) -> tuple[float, bool, bool]:
    """One Newton step along a ray: the new distance, whether it is the root, and whether there is no root.

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
    settled = (o.n1 * b + o.n2 * a) * step * step <= k.rounding * (abs(t) + a + o.s1) * abs(slope)
    return (t if missed else t - step), bool(settled & (not missed)), missed


@compiled
def oval_root(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, outwards: float) -> float:
    """Distance of the near (``outwards`` −1) or far root (+1) on the entire oval; NaN if the ray misses the oval."""
    t = oval_start(k, o, x, z, dx, dz, outwards)
    t, settled, missed = oval_step(k, o, x, z, dx, dz, t, outwards)
    if missed or t != t:
        t = oval_circle(o, x, z, dx, dz, outwards)
        settled, missed = False, t != t
    for _ in range(STEPS):
        if settled or missed:
            break
        t, settled, missed = oval_step(k, o, x, z, dx, dz, t, outwards)
    return t if settled else k.nan


@compiled
def oval_holds(k: Precision, o: Oval, x: float, z: float) -> bool:
    """Whether a point of the oval is between the rays from the object focus to the front's ends and faces it."""
    rx, rz, qx, qz = x - o.x1, z - o.z1, x - o.x2, z - o.z2
    r, q = math.sqrt(rx * rx + rz * rz), math.sqrt(qx * qx + qz * qz)
    right, left = o.rx * rz - o.rz * rx >= -k.end, o.lx * rz - o.lz * rx <= k.end
    return bool(right & left & (o.n1 * r * q + o.n2 * (qx * rx + qz * rz) < 0.0))


@compiled
def oval_hit(k: Precision, o: Oval, x: float, z: float, dx: float, dz: float, leaving: bool) -> float:
    """Distance to the front of an oval."""
    if not oval_near(k, o, x, z, dx, dz, leaving):
        return k.none
    value, slope = oval_at(k, o, x, z, dx, dz)
    outside = value > 0.0 and not leaving
    if slope >= 0.0 and (outside or leaving):
        return k.none  # the ray moves away from a convex region
    if outside:
        t = oval_root(k, o, x, z, dx, dz, -k.one)
        if t > 0.0 and oval_holds(k, o, x + t * dx, z + t * dz):
            return t
    t = oval_root(k, o, x, z, dx, dz, k.one)
    return t if t > 0.0 and oval_holds(k, o, x + t * dx, z + t * dz) else k.none


# Cubic pieces. A piece turns by less than 90 degrees and has no inflection, so that a line meets it at most twice, and
# the distance f(u) of its points from the line has at most one extremum. The signs of f at the ends are those of the
# control points there, which neighbouring pieces share: no ray slips between them.


@rounded
def product(a: float, b: float) -> float:
    """A separately rounded product; `solen.trace.kernel.cuda` replaces it, because a GPU fuses products with sums."""
    return a * b


@rounded
def aside(dx: float, dz: float, x: float, z: float) -> float:
    """Lateral distance of a point from the line of a ray, with a sign that is the same for both pieces at a joint."""
    return product(dx, z) - product(dz, x)


@compiled
def cubic_hit(
    k: Precision, q: Cubic, x: float, z: float, dx: float, dz: float, standing: bool, at: float, beside: float
) -> tuple[float, float]:
    """Distance to a cubic piece, and the parameter there; the ray may start on this piece, ``at`` a parameter.

    ``beside`` is the apparent lateral distance of a ray that starts on the neighbouring piece. It is a rounding error,
    and is subtracted because a ray that leaves at a small angle would otherwise meet this piece immediately.
    """
    f0, f1 = aside(dx, dz, q.x0 - x, q.z0 - z) - beside, aside(dx, dz, q.x1 - x, q.z1 - z) - beside
    f2, f3 = aside(dx, dz, q.x2 - x, q.z2 - z) - beside, aside(dx, dz, q.x3 - x, q.z3 - z) - beside
    c1 = k.three * (f1 - f0)
    c2 = k.three * ((f2 - f1) - (f1 - f0))
    c3 = (f3 - f0) - k.three * (f2 - f1)
    if standing:
        return cubic_other(k, q, x, z, dx, dz, at, f0, c1, c2, c3)
    reach = k.end if q.before > 0.0 or q.after > 0.0 else k.zero
    if min(min(f0, f1), min(f2, f3)) > reach or max(max(f0, f1), max(f2, f3)) < -reach:
        return k.none, k.zero  # the entire hull is on one side
    best, place = k.none, k.zero
    turn = cubic_turn(k, f0, f1, f2, f3)
    ends = (k.zero, turn, k.one)
    ftop = f0 + turn * (c1 + turn * (c2 + turn * c3))
    ftop = f3 if turn >= 1.0 else f0 if turn <= 0.0 else ftop  # exactly the sign for the next piece
    for half in range(2):
        low, high = ends[half], ends[half + 1]
        flow, fhigh = (f0, ftop) if half == 0 else (ftop, f3)
        if (flow < 0.0) == (fhigh < 0.0) or low >= high:
            continue
        u = cubic_root(k, f0, c1, c2, c3, low, high, flow < 0.0)
        t = cubic_along(k, q, x, z, dx, dz, u)
        if 0.0 < t < best:
            best, place = t, u
    for end in range(2):  # the straight extension beyond an end of the complete curve
        u = -f0 / c1 if end == 0 else k.one - f3 / (k.three * (f3 - f2))
        beyond = (-q.before * k.end <= u < 0.0) if end == 0 else (1.0 < u <= k.one + q.after * k.end)
        t = cubic_along(k, q, x, z, dx, dz, u) if beyond else k.none
        if 0.0 < t < best:
            best, place = t, u
    return best, place


@compiled
def cubic_beside(k: Precision, q: Cubic, x: float, z: float, dx: float, dz: float, u: float) -> float:
    """Lateral distance between the line of a ray and the point of a piece at a parameter."""
    px, pz = cubic_point(k, q, u)
    return dx * (pz - z) - dz * (px - x)


@compiled
def cubic_turn(k: Precision, f0: float, f1: float, f2: float, f3: float) -> float:
    """Parameter at which f has its extremum; 1 if there is none inside.

    f' is proportional to g0 (1 − u)² + 2 g1 u (1 − u) + g2 u²; if g0 and g2 differ in sign, it has one root.
    """
    g0, g1, g2 = f1 - f0, f2 - f1, f3 - f2
    if (g0 < 0.0) == (g2 < 0.0) or g0 == 0.0:
        return k.one
    root = math.sqrt(g1 * g1 - g0 * g2)
    q = -(g1 + (root if g1 >= 0.0 else -root))
    return q / (q + g2) if q * g2 > 0.0 else g0 / (g0 + q)


@compiled
def cubic_root(k: Precision, f0: float, c1: float, c2: float, c3: float, low: float, high: float, rises: bool) -> float:
    """Root of f0 + c1 u + c2 u² + c3 u³ in a bracket where it is monotonic: Newton's method with bisection."""
    u = k.half * (low + high)
    for _ in range(STEPS):
        value = f0 + u * (c1 + u * (c2 + u * c3))
        if (value < 0.0) == rises:
            low = u
        else:
            high = u
        slope = c1 + u * (c2 + c2 + k.three * u * c3)
        new = u - value / slope
        if not low <= new <= high:
            new = k.half * (low + high)
        if abs(new - u) <= k.rounding or value == 0.0:
            return new
        u = new
    return u


@compiled
def cubic_other(
    k: Precision,
    q: Cubic,
    x: float,
    z: float,
    dx: float,
    dz: float,
    at: float,
    f0: float,
    c1: float,
    c2: float,
    c3: float,
) -> tuple[float, float]:
    """The other hit of a ray that starts on the piece: division of f by (u − at) leaves a quadratic."""
    rest = f0 + at * (c1 + at * (c2 + at * c3))
    b1 = c1 + at * (c2 + c2 + k.three * at * c3)
    b2 = c2 + k.three * at * c3
    square = b2 * b2 - (c3 + c3 + c3 + c3) * b1
    if square < 0.0:
        return k.none, k.zero
    root = math.sqrt(square)
    total = -k.half * (b2 + (root if b2 >= 0.0 else -root))
    best, place = k.none, k.zero
    for which in range(2):
        v = total / c3 if which == 0 else b1 / total
        slope = b1 + v * (b2 + b2 + k.three * v * c3)
        v -= rest / slope if abs(rest) < k.small * abs(slope * v) else k.zero
        u = at + v
        t = cubic_along(k, q, x, z, dx, dz, u)
        if -q.before * k.end <= u <= k.one + q.after * k.end and 0.0 < t < best:
            best, place = t, u
    return best, place


@compiled
def cubic_along(k: Precision, q: Cubic, x: float, z: float, dx: float, dz: float, u: float) -> float:
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
