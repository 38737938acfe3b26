"""The tables of a Y at an angle, computed from the design parameters alone by compiled code.

`solen.geometry.y`, `solen.scene.sensor` and `solen.trace.tables`, which together create these tables in Python, remain
the reference; the formulas here are the same, and tests compare rays traced with both.
"""

import math
from typing import NamedTuple

from solen.arrays import FloatArray, IntArray
from solen.geometry.body import GAP_MM
from solen.geometry.y import MIN_LENGTH_MM, STEP_MM
from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.rows import CONIC, CUBIC, OVAL, RECEIVER, REFRACTING, SEGMENT, Floats
from solen.trace.tables import BOX_MARGIN, BOX_MARGIN_MM, Tables

FLAT, WHOLE_OVAL, PIECES = range(3)
"""Kinds of lens: the flat face of the stem, an oval, pieces of a spline."""
AT_BASE, AT_EMITTER, AT_POINT = range(3)
"""Kinds of pivot: the base of the stem, the emitter, or a specified point."""
AIR, BODY = range(2)
"""Indices of the regions."""
WALLS = 13
"""Maximum number of pieces other than spline pieces: a lens, five on each side, and two receivers behind gaps."""
FIT_POINTS = 17
MAX_TURN, MAX_GAP = 0.3, 0.25
"""Sine of the rotation of the lens, and gap between lens and stem relative to the half width, up to which the outline
is sound without a search for intersections.
"""
MIN_LENGTH = 0.01
"""Lengths and gaps below which `solen.scene` must check for overlaps."""
SOUND, UNSURE = 1, 0
NO_JOIN, TOO_WIDE = -1, -2
"""Codes that `y_tables` returns for a body that `solen.geometry` rejects."""


class Y(NamedTuple):
    """Design parameters; lengths in mm."""

    lens: float
    distance: float
    focus: float
    half_width: float
    cut_index: float
    depth: float
    """depth of a lens made of pieces"""
    left_edge: float
    """depth of the left edge; edge depths may differ from those in the design"""
    right_edge: float
    refractive_index: float
    absorption: float
    stem_length: float
    stem_curve: float
    arm_length: float
    arm_width: float
    arm_angle: float
    """angle of the arms in radians"""
    pivot: float
    pivot_x: float
    pivot_z: float
    turns_lens: float
    turns_emitter: float
    turns_receivers: float
    seam: float
    gap: float
    """gap in front of the receivers; NaN for receivers on the ends of the arms"""
    receiver_height: float
    """height of the receivers; infinite if it is that of the body"""
    first_piece: float
    pieces: float


class LensFront(NamedTuple):
    """Properties that depend only on the lens, in its own frame with the vertex at the origin."""

    depth: float
    corner: float
    """distance from the axis at which the edge tangents intersect the vertex tangent"""
    p0: float
    p1: float
    p2: float


class Motion(NamedTuple):
    """A rotation followed by a translation."""

    cos: float
    sin: float
    x: float
    z: float


@compiled
def y_row(numbers: FloatArray, d: int) -> Y:
    """Return the row of a design."""
    n = numbers[d]
    return Y(
        n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11], n[12], n[13], n[14], n[15], n[16],
        n[17], n[18], n[19], n[20], n[21], n[22], n[23], n[24], n[25],
    )  # fmt: skip


@compiled
def turn_about(x: float, z: float, angle_deg: float) -> Motion:
    """Return the rotation about a point; for 0 it is exactly the identity."""
    if angle_deg == 0.0:
        return Motion(1.0, 0.0, 0.0, 0.0)
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return Motion(c, s, x - (c * x - s * z), z - (s * x + c * z))


@compiled
def moved(t: Motion, x: float, z: float) -> tuple[float, float]:
    """Return a point after a rotation and translation."""
    return t.cos * x - t.sin * z + t.x, t.sin * x + t.cos * z + t.z


@compiled
def oval_depth(y: Y, x: float) -> tuple[float, float]:
    """Depth z of the oval at x, and the slope there; see `solen.lens.OvalLens.z_mm`."""
    n2, s, f, z = y.cut_index, y.distance, y.focus, 0.0
    for _ in range(60):
        to_object, to_image = math.hypot(z + s, x), math.hypot(f - z, x)
        square = x * x + z * z
        value = (square + 2.0 * s * z) / (to_object + s) + n2 * (square - 2.0 * f * z) / (to_image + f)
        step = value / ((z + s) / to_object - n2 * (f - z) / to_image)
        z -= step
        if abs(step) <= 1e-15 * (1.0 + z):
            break
    to_object, to_image = math.hypot(z + s, x), math.hypot(f - z, x)
    return z, -(x / to_object + n2 * x / to_image) / ((z + s) / to_object - n2 * (f - z) / to_image)


@compiled
def fitted_conic(y: Y, depth: float) -> tuple[float, float, float]:
    """Conic r² = p0 + p1 w + p2 w², fitted by least squares at equal angles: an initial guess for Newton's method."""
    edge = math.atan2(y.half_width, y.distance + depth)
    a, c = y.cut_index * y.cut_index - 1.0, y.distance + y.cut_index * y.focus
    d = y.distance + y.focus
    rest = (y.cut_index - 1.0) * y.distance * (y.cut_index * d + c)
    m1, m2, m3, m4, b0, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(FIT_POINTS):
        angle = edge * i / (FIT_POINTS - 1)
        half_b = y.cut_index * y.cut_index * d * math.cos(angle) - c
        radius = rest / (half_b + math.sqrt(max(half_b * half_b - a * rest, 0.0)))
        w, r = (radius * math.cos(angle) - y.distance) / depth, radius * math.sin(angle)
        m1, m2, m3, m4 = m1 + w, m2 + w * w, m3 + w * w * w, m4 + w * w * w * w
        b0, b1, b2 = b0 + r * r, b1 + w * r * r, b2 + w * w * r * r
    m0 = float(FIT_POINTS)
    c00, c01, c02 = m2 * m4 - m3 * m3, m2 * m3 - m1 * m4, m1 * m3 - m2 * m2
    c11, c12, c22 = m0 * m4 - m2 * m2, m1 * m2 - m0 * m3, m0 * m2 - m1 * m1
    determinant = m0 * c00 + m1 * c01 + m2 * c02
    p0 = (c00 * b0 + c01 * b1 + c02 * b2) / determinant
    p1 = (c01 * b0 + c11 * b1 + c12 * b2) / determinant
    p2 = (c02 * b0 + c12 * b1 + c22 * b2) / determinant
    return p0, p1 / depth, p2 / (depth * depth)


@compiled
def front_of(y: Y) -> LensFront:
    """Compute the properties that depend only on the lens."""
    if y.lens != WHOLE_OVAL:
        return LensFront(y.depth if y.lens == PIECES else 0.0, 0.0, 0.0, 0.0, 0.0)
    depth, slope = oval_depth(y, y.half_width)
    p0, p1, p2 = fitted_conic(y, depth)
    return LensFront(depth, y.half_width - depth / slope, p0, p1, p2)


@compiled
def put_box(t: Tables, p: int, low_x: float, high_x: float, low_z: float, high_z: float) -> None:
    """Write a box with its margin."""
    margin = BOX_MARGIN_MM + BOX_MARGIN * max(max(abs(low_x), abs(high_x)), max(abs(low_z), abs(high_z)))
    t.box[p, 0], t.box[p, 1], t.box[p, 2], t.box[p, 3] = (
        low_x - margin,
        high_x + margin,
        low_z - margin,
        high_z + margin,
    )


@compiled
def put_segment(t: Tables, p: int, ax: float, az: float, bx: float, bz: float) -> None:
    """Write a segment."""
    length = math.hypot(bx - ax, bz - az)
    t.kind[p] = SEGMENT
    t.shape[p, 0], t.shape[p, 1], t.shape[p, 4] = ax, az, length
    t.shape[p, 2], t.shape[p, 3] = (bx - ax) / length, (bz - az) / length
    t.middle[p, 0], t.middle[p, 1] = ax + 0.5 * (bx - ax), az + 0.5 * (bz - az)
    put_box(t, p, min(ax, bx), max(ax, bx), min(az, bz), max(az, bz))


@compiled
def put_stem(t: Tables, p: int, side: float, x: float, z: float, c: float, begin: float, end: float) -> None:
    """Write one side of the stem: a parabola from the corner (x, z), between two heights above the base."""
    t.kind[p] = CONIC
    row = t.shape[p]
    row[0], row[1], row[2], row[3], row[4], row[5] = x, z, 0.0, -1.0, 2.0 * side * c, 0.0
    row[6], row[7], row[8] = -end, -begin, -side
    half = 0.5 * (begin + end)
    t.middle[p, 0], t.middle[p, 1] = x + side * c * half * half, z + half
    a, b = x + side * c * begin * begin, x + side * c * end * end
    m, n = x + side * c * begin * half, x + side * c * half * end  # intersection of tangents
    put_box(t, p, min(min(a, b), min(m, n)), max(max(a, b), max(m, n)), z + begin, z + end)


@compiled
def put_oval(t: Tables, p: int, y: Y, front: LensFront, motion: Motion) -> None:
    """Write the front of an oval."""
    wx, wz = -motion.sin, motion.cos
    vx, vz = motion.x, motion.z
    row = t.shape[p]
    t.kind[p] = OVAL
    row[0], row[1] = vx - y.distance * wx, vz - y.distance * wz
    row[2], row[3] = vx + y.focus * wx, vz + y.focus * wz
    row[4], row[5], row[6], row[7], row[8], row[9], row[10], row[11] = (
        1.0, y.cut_index, y.distance, y.focus, vx, vz, wx, wz,
    )  # fmt: skip
    row[12], row[13] = -1.0, (y.distance + y.cut_index * y.focus) / y.cut_index
    edge = math.hypot(y.half_width, y.distance + front.depth)
    s, c = y.half_width / edge, (y.distance + front.depth) / edge
    row[14], row[15] = c * wx + s * wz, c * wz - s * wx
    row[16], row[17] = c * wx - s * wz, c * wz + s * wx
    row[18], row[19] = moved(motion, -y.half_width, front.depth)
    row[20], row[21] = moved(motion, -front.corner, 0.0)
    row[22], row[23] = moved(motion, front.corner, 0.0)
    row[24], row[25] = moved(motion, y.half_width, front.depth)
    row[26], row[27], row[28], row[29], row[30] = wz, -wx, front.p0, front.p1, front.p2
    t.middle[p, 0], t.middle[p, 1] = vx, vz
    low_x, high_x = min(min(row[18], row[20]), min(row[22], row[24])), max(max(row[18], row[20]), max(row[22], row[24]))
    low_z, high_z = min(min(row[19], row[21]), min(row[23], row[25])), max(max(row[19], row[21]), max(row[23], row[25]))
    put_box(t, p, low_x, high_x, low_z, high_z)


@compiled
def put_cubic(t: Tables, p: int, piece: Floats, motion: Motion) -> None:
    """Write a cubic piece from a table row in the lens frame."""
    row = t.shape[p]
    t.kind[p] = CUBIC
    for i in range(4):
        row[2 * i], row[2 * i + 1] = moved(motion, piece[2 * i], piece[2 * i + 1])
    for i in range(8, 12):
        row[i] = piece[i]
    for axis in range(2):
        a, b, c, d = row[axis], row[axis + 2], row[axis + 4], row[axis + 6]
        t.middle[p, axis] = 0.125 * (a + d) + 0.375 * (b + c)
    put_box(
        t,
        p,
        min(min(row[0], row[2]), min(row[4], row[6])),
        max(max(row[0], row[2]), max(row[4], row[6])),
        min(min(row[1], row[3]), min(row[5], row[7])),
        max(max(row[1], row[3]), max(row[5], row[7])),
    )


@compiled
def set_optics(t: Tables, p: int, owner: int, receiver: int, left: int, height: float) -> None:
    """Write the optical properties of piece ``p``."""
    t.owner[p], t.previous[p], t.treatment[p] = owner, -1, -1
    t.behaviour[p], t.receiver[p] = RECEIVER if receiver >= 0 else REFRACTING, receiver
    t.left[p], t.right[p] = left, AIR
    reach = 0.5 * height if receiver >= 0 else math.inf
    t.height[p, 0], t.height[p, 1] = -reach, reach


@compiled
def wall_start(y: Y, depth: float, edge_x: float, edge_z: float, side: float) -> tuple[float, float]:
    """Height above the base at which a side of the stem begins, and its distance from the lens edge.

    The height is negative if no such stem exists; see `solen.geometry.y`.
    """
    edge_gap = math.hypot(edge_x - side * y.half_width, edge_z - depth)
    if edge_gap <= GAP_MM:
        return 0.0, edge_gap
    height = 0.0 if y.seam == 1.0 else max(0.0, edge_z - depth)
    if height >= y.stem_length:
        return -1.0, 0.0
    start = side * (y.half_width + y.stem_curve * height * height)
    wall_gap = math.hypot(edge_x - start, edge_z - depth - height)
    if GAP_MM < wall_gap < MIN_LENGTH_MM:
        height += STEP_MM
        start = side * (y.half_width + y.stem_curve * height * height)
        wall_gap = math.hypot(edge_x - start, edge_z - depth - height)
    return height, min(edge_gap, wall_gap)


class Pose(NamedTuple):
    """Emitter pose: position without decentre, and axis direction in radians."""

    x: float
    z: float
    axis: float


@compiled
def put_lens(t: Tables, pieces: Floats, before: IntArray, y: Y, front: LensFront, motion: Motion, first: int) -> int:
    """Write the rows of a lens from row ``first`` on; return the next row."""
    p = first
    if y.lens == FLAT:
        put_segment(t, p, -y.half_width, 0.0, y.half_width, 0.0)
        set_optics(t, p, 0, -1, BODY, 0.0)
        p += 1
    elif y.lens == WHOLE_OVAL:
        put_oval(t, p, y, front, motion)
        set_optics(t, p, 0, -1, BODY, 0.0)
        p += 1
    else:
        for i in range(int(y.pieces)):
            put_cubic(t, p, pieces[int(y.first_piece) + i], motion)
            set_optics(t, p, 0, -1, BODY, 0.0)
            previous = before[int(y.first_piece) + i]
            t.previous[p] = p - 1 - first if previous >= 0 else -1
            p += 1
    return p


@compiled
def put_receivers(
    t: Tables, y: Y, motion: Motion, p: int, owner: int, outer_x: float, outer_z: float, inner_x: float, inner_z: float
) -> int:
    """Write receivers behind a gap from the ends of the arms; return the next row."""
    nx, nz = y.gap * math.sin(y.arm_angle), y.gap * math.cos(y.arm_angle)
    for half in range(2):
        side = 1.0 if half == 0 else -1.0
        ax, az = moved(motion, side * (outer_x + nx), outer_z + nz)
        bx, bz = moved(motion, side * (inner_x + nx), inner_z + nz)
        if half == 0:
            put_segment(t, p, ax, az, bx, bz)
        else:
            put_segment(t, p, bx, bz, ax, az)
        set_optics(t, p, owner + half, half, AIR, y.receiver_height)
        p += 1
    return p


@called
def y_tables(
    t: Tables, pieces: Floats, before: IntArray, y: Y, front: LensFront, angle_deg: float, first: int
) -> tuple[int, int, Pose]:
    """Write the rows of a Y from row ``first`` on; return the next row, a code for the body, and the emitter's pose.

    ``pieces`` (N, 12) are the cubics of all lenses in their own frames, and ``before`` (N,) is the piece that each one
    continues. The code `UNSURE` means that the outline might intersect itself or enclose the emitter, which
    `solen.geometry` must check; `NO_JOIN` and `TOO_WIDE` mean that `solen.geometry` rejects the body.
    """
    pivot_x = y.pivot_x if y.pivot == AT_POINT else 0.0
    pivot_z = front.depth if y.pivot == AT_BASE else (-y.distance if y.pivot == AT_EMITTER else y.pivot_z)
    motion, identity = turn_about(pivot_x, pivot_z, angle_deg), Motion(1.0, 0.0, 0.0, 0.0)
    lens_motion = motion if y.turns_lens == 1.0 and y.lens != FLAT else identity
    p = put_lens(t, pieces, before, y, front, lens_motion, first)
    sin, cos, owner = math.sin(y.arm_angle), math.cos(y.arm_angle), 1
    fork_x = y.half_width + y.stem_curve * y.stem_length * y.stem_length
    fork_z = front.depth + y.stem_length
    outer_x, outer_z = fork_x + y.arm_length * sin, fork_z + y.arm_length * cos
    inner_x, inner_z = outer_x - y.arm_width * cos, outer_z + y.arm_width * sin
    crotch = inner_z - inner_x / math.tan(y.arm_angle)
    right_x, right_z = moved(lens_motion, y.half_width, y.right_edge if y.lens == PIECES else front.depth)
    left_x, left_z = moved(lens_motion, -y.half_width, y.left_edge if y.lens == PIECES else front.depth)
    r_from, r_gap = wall_start(y, front.depth, right_x, right_z, 1.0)
    l_from, l_gap = wall_start(y, front.depth, left_x, left_z, -1.0)
    pose = fixed_pose(y)
    if y.turns_emitter == 1.0:
        x, z = moved(motion, 0.0, -y.distance)
        pose = Pose(x, z, math.radians(angle_deg))
    if r_from < 0.0 or l_from < 0.0 or r_gap > y.half_width or l_gap > y.half_width:
        return p, NO_JOIN, pose
    if not (y.arm_angle > 0.0 and inner_x > 0.0):
        return p, TOO_WIDE, pose
    has_gap = y.gap == y.gap
    if r_gap > GAP_MM:
        put_segment(t, p, right_x, right_z, y.half_width + y.stem_curve * r_from * r_from, front.depth + r_from)
        set_optics(t, p, owner, -1, BODY, 0.0)
        p, owner = p + 1, owner + 1
    for half in range(2):
        side = 1.0 if half == 0 else -1.0
        for step in range(4):
            part = step if half == 0 else 3 - step
            if part == 0:
                begin = r_from if half == 0 else l_from
                put_stem(t, p, side, side * y.half_width, front.depth, y.stem_curve, begin, y.stem_length)
            elif part == 1:
                put_side(t, p, side, fork_x, fork_z, outer_x, outer_z)
            elif part == 2:
                put_side(t, p, side, outer_x, outer_z, inner_x, inner_z)
            else:
                put_side(t, p, side, inner_x, inner_z, 0.0, crotch)
            set_optics(t, p, owner, half if part == 2 and not has_gap else -1, BODY, y.receiver_height)
            p, owner = p + 1, owner + 1
    if l_gap > GAP_MM:
        put_segment(t, p, -(y.half_width + y.stem_curve * l_from * l_from), front.depth + l_from, left_x, left_z)
        set_optics(t, p, owner, -1, BODY, 0.0)
        p, owner = p + 1, owner + 1
    if has_gap:
        receiver_motion = motion if y.turns_receivers == 1.0 else identity
        p = put_receivers(t, y, receiver_motion, p, owner, outer_x, outer_z, inner_x, inner_z)
    code = soundness(
        t, first, y, front, motion, pose, crotch, max(right_z, left_z), max(r_gap, l_gap), inner_x, inner_z
    )
    return p, code, pose


@compiled
def fixed_pose(y: Y) -> Pose:
    """Return the pose of an emitter that does not rotate."""
    return Pose(0.0, -y.distance, 0.0)


@compiled
def put_side(t: Tables, p: int, side: float, ax: float, az: float, bx: float, bz: float) -> None:
    """Write a segment of the right half, or its mirror image, which is directed the other way."""
    if side > 0.0:
        put_segment(t, p, ax, az, bx, bz)
    else:
        put_segment(t, p, -bx, bz, -ax, az)


@compiled
def soundness(
    t: Tables, first: int, y: Y, front: LensFront, motion: Motion, pose: Pose, crotch: float, edge_z: float, gap: float,
    inner_x: float, inner_z: float,
) -> int:  # fmt: skip
    """Return `SOUND` if the outline certainly does not intersect itself and the emitter is in front of the lens."""
    lowest = math.inf
    for p in range(first, first + (int(y.pieces) if y.lens == PIECES else 1)):
        lowest = min(lowest, t.box[p, 2])
    before_lens = pose.z < lowest
    small_motion = abs(motion.sin) <= MAX_TURN and gap <= MAX_GAP * y.half_width
    above = crotch > max(edge_z, front.depth) + 0.1 * y.half_width
    slant, c = inner_x / (inner_z - crotch), y.stem_curve
    flares = c >= 0.0 and y.arm_angle < 1.5
    # the inner edges pass inside the sides of the stem: half_width + c u² − slant (u − low) > 0 up to the fork
    low = crotch - front.depth
    u = min(max(slant / (2.0 * c), max(low, 0.0)), y.stem_length) if c > 0.0 else y.stem_length
    stem_outside_arms = low >= y.stem_length or y.half_width + c * u * u - slant * (u - low) > 1e-3
    clear_receivers = y.gap != y.gap or (y.turns_receivers == 0.0 and y.gap > MIN_LENGTH)
    large_enough = min(min(y.half_width, y.stem_length), min(y.arm_length, y.arm_width)) > MIN_LENGTH
    return (
        SOUND
        if before_lens and small_motion and above and flares and stem_outside_arms and clear_receivers and large_enough
        else UNSURE
    )
