"""The compiled path of rays through a lens face that varies with height, into a body that is extruded behind the face.

Coordinates are those of the lens frame. A ray from in front of the face is advanced to it, layer by layer; a smooth
face is one layer. Where a layer protrudes beyond the one that the ray comes from, the ray meets the horizontal *ledge*
of that layer, which changes β, the quantity that vertical walls conserve. At a ledge one of the two parts is followed,
chosen with probability proportional to its power. At the face both parts are followed, because reflected light may meet
the next ledge. Light that enters is advanced, with reflections off top and bottom, to the plane of the stem's base,
unless it is already beyond that plane; behind the plane the body has vertical walls.

Two cases are not modelled. Rays in the body that return to the face meet the cylinder of its middle section instead.
Rays in the body that would meet a ledge from inside pass it.
"""

import math
from typing import NamedTuple

from solen.arrays import FloatArray, IntArray
from solen.lens.face import Face
from solen.trace.kernel.compiled import called, compiled, linked
from solen.trace.kernel.space import (
    Beam,
    Border,
    Coherency,
    Vector,
    cross,
    dot,
    power_of,
    rotated_basis,
    scaled_beam,
    smooth_parts,
    split_beam,
    unit,
    upright,
)
from solen.trace.kernel.treated import Amplitudes

MAX_STEPS = 500
"""Maximum number of steps towards the face."""
HIT_TOLERANCE_MM, INSIDE_MM, BESIDE_MM = 1e-13, 1e-7, 0.05
"""Tolerance of a hit on the face; distance behind the plane of the base at which rays in the body start; distance
beside the lens at which other rays start.
"""
SEARCH_MARGIN_MM = 1e-3
"""Margin in front of the nearest point and behind the deepest point of a face within which hits are sought, to allow
for errors of these points.
"""
ROUNDING, TINY = 1e-12, 1e-300
MAX_BOUNCES = 1000

PASSED, ENTERED, MISSED = range(3)
"""Outcomes for a ray: it passes beside the face, enters the body, or passes above or below it."""
LEAKED, REFLECTED, TURNED_BACK, ABSORBED, LOSSES = range(5)
"""Indices of powers that do not arrive behind the face, and their number; see `FaceRays`."""


class FaceInMedia(NamedTuple):
    """A face and the media in front of it, behind it and beside it."""

    face: Face
    outside: float
    above: float
    below: float
    loss: float
    """absorption coefficient of the body in 1/mm"""
    counting: bool
    """whether rays are counted, and therefore not split"""


class FaceRays(NamedTuple):
    """Rays in the lens frame, in front of the face; they are overwritten with the results.

    The source supplies N rays; there is room for N more, for light that the face reflects forwards or onto a ledge.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    dx: FloatArray
    dy: FloatArray
    dz: FloatArray
    s: FloatArray
    p: FloatArray
    cr: FloatArray
    ci: FloatArray
    optical: FloatArray
    inside: FloatArray
    """refractive index of the body at the wavelength of the ray"""
    random: FloatArray
    """random number in [0, 1) for the choice at ledges"""
    line: IntArray
    lost: FloatArray
    """(4,) powers: leaked; reflected by the face; the reflected part that turns back; absorbed"""


class FaceHit(NamedTuple):
    """Distance of a ray to the face, whether the ray meets the face, and whether it does so on a ledge."""

    distance: float
    is_hit: bool
    on_ledge: bool
    layer: int


@compiled
def optical_length(f: Face, x: float, y: float, z: float) -> tuple[float, Vector]:
    """Optical length through a point to the wavefront behind a smooth face, minus that of the axis; its gradient."""
    from_line = math.sqrt(x * x + (f.focus - z) * (f.focus - z))
    length, by_line, by_y = from_line - f.focus, 1.0, 0.0
    if f.ring_radius < math.inf:
        from_ring = f.ring_radius - from_line
        size = math.sqrt(from_ring * from_ring + y * y)
        length, by_line, by_y = (f.ring_radius - f.focus) - size, from_ring / size, -y / size
    from_emitter = z + f.distance
    r = math.sqrt(x * x + y * y + from_emitter * from_emitter)
    scale = f.design_index * by_line / from_line
    gradient = Vector(x / r + scale * x, y / r + f.design_index * by_y, from_emitter / r - scale * (f.focus - z))
    return r - f.distance + f.design_index * length, gradient


@compiled
def in_front(f: Face, layer: int, x: float, y: float, z: float) -> float:
    """A function above 0 in front of the face and below 0 in the body: optical length, or distance from a profile."""
    if len(f.profiles) > 0:
        return profile_at(f, layer, x)[0] - z
    return optical_length(f, x, y, z)[0]


@compiled
def profile_cell(f: Face, x: float) -> tuple[float, int, float]:
    """Spacing of the profile points, the point before a lateral position, and the relative distance to the next."""
    step = f.half_width / (f.profiles.shape[1] - 1)
    position = min(abs(x), f.half_width) / step
    cell = min(int(position), f.profiles.shape[1] - 2)
    return step, cell, position - cell


@compiled
def profile_at(f: Face, layer: int, x: float) -> tuple[float, float]:
    """Depth z of a layer's profile, and dz/dx."""
    step, cell, t = profile_cell(f, x)
    a, p, q = f.profiles[layer, cell], f.slopes[layer, cell], f.slopes[layer, cell + 1]
    mean_slope = (f.profiles[layer, cell + 1] - a) / step
    second, third = 3.0 * mean_slope - 2.0 * p - q, p + q - 2.0 * mean_slope
    slope = p + t * (2.0 * second + t * 3.0 * third)
    return a + step * t * (p + t * (second + t * third)), slope if x >= 0.0 else -slope


@compiled
def face_normal(f: Face, layer: int, x: float, y: float, z: float) -> Vector:
    """Outward unit normal of the face."""
    if len(f.profiles) > 0:
        return unit(Vector(profile_at(f, layer, x)[1], 0.0, -1.0))
    return unit(optical_length(f, x, y, z)[1])


@compiled
def search_range(f: Face, at: Vector, d: Vector) -> tuple[float, float]:
    """Distances between which a ray may meet the face: from its nearest to its deepest point, within the aperture."""
    low_z, high_z = f.min_z - SEARCH_MARGIN_MM, f.max_z + SEARCH_MARGIN_MM
    start, end = 0.0, math.inf
    if d.z > 0.0:
        start, end = max((low_z - at.z) / d.z, 0.0), (high_z - at.z) / d.z
    elif d.z < 0.0:
        end = (low_z - at.z) / d.z
    if d.x != 0.0:
        end = min(end, (math.copysign(f.half_width, d.x) - at.x) / d.x)
    if d.y != 0.0:
        end = min(end, (math.copysign(f.half_height, d.y) - at.y) / d.y)
    return start, end


@compiled
def along(f: Face, layer: int, at: Vector, d: Vector, distance: float) -> tuple[float, float]:
    """The function `in_front` at a point along a ray, and its derivative along the ray."""
    x, y, z = at.x + distance * d.x, at.y + distance * d.y, at.z + distance * d.z
    if len(f.profiles) > 0:
        depth, slope = profile_at(f, layer, x)
        return depth - z, slope * d.x - d.z
    length, gradient = optical_length(f, x, y, z)
    return length, dot(gradient, d)


@compiled
def distance_to_face(f: Face, layer: int, at: Vector, d: Vector, start: float, end: float) -> float:
    """Distance to a smooth face, or to the profile of a layer; infinite if there is no hit before the end.

    Newton's method is used with the smallest possible second derivative, so that no step passes the first root.
    """
    bend, t = (f.max_bend * d.x * d.x if len(f.profiles) > 0 else f.max_bend), start
    for _ in range(MAX_STEPS):
        g, rate = along(f, layer, at, d, t)
        g = max(g, 0.0)
        root = math.sqrt(rate * rate + 2.0 * bend * g)
        far_step = (rate + root) / bend if bend > 0.0 else math.inf
        step = 2.0 * g / (root - rate) if rate < 0.0 else far_step
        t += step
        if t > end + HIT_TOLERANCE_MM:
            break
        if step <= HIT_TOLERANCE_MM:
            return min(t, end)
    return math.inf


@compiled
def may_be_behind(f: Face, d: Vector, g: float, rate: float, distance: float) -> bool:
    """Whether a ray may have been behind a profile anywhere on the last ``distance`` before this point."""
    return g <= 0.0 or rate > 0.0 or g - rate * distance <= 0.5 * f.max_bend * d.x * d.x * distance * distance


@linked
def next_layer_hit(f: Face, layer: int, at: Vector, d: Vector, start: float, end: float) -> FaceHit:
    """Return the hit on the profile of a layer ahead of a ray, or on a ledge.

    Layers that the ray certainly passes are skipped, based on the largest decrease of its distance from layer to layer.
    """
    if start > 0.0:
        layer = layer_of(f, at.y + start * d.y)
    up, last_layer = (1 if d.y > 0.0 else -1), len(f.edges) - 2
    max_decrease = f.max_step + TINY
    if d.y != 0.0:
        slope = f.max_fall if at.x * d.x >= 0.0 else max(f.max_rise, f.max_fall)  # the ray may cross the axis
        rate = d.z + abs(d.x) * slope
        max_decrease += max(rate, 0.0) * f.max_layer / abs(d.y)
    while True:
        edge = f.edges[layer + 1] if d.y > 0.0 else f.edges[layer]
        target = max(min((edge - at.y) / d.y, end) if d.y != 0.0 else end, start)
        g, rate = along(f, layer, at, d, target)
        if may_be_behind(f, d, g, rate, target - start):
            distance = distance_to_face(f, layer, at, d, start, target)
            if distance < math.inf:
                return FaceHit(distance, True, False, layer)
        following = layer + up
        if target >= end or not 0 <= following <= last_layer:
            return FaceHit(end, False, False, layer)
        g = along(f, following, at, d, target)[0]
        if g <= 0.0:
            return FaceHit(target, True, True, layer)
        start, layer = target, following
        skipped = int(min(g / max_decrease, float(last_layer - following if d.y > 0.0 else following)))
        if skipped > 0:
            layer = following + up * skipped
            start = ((f.edges[layer] if d.y > 0.0 else f.edges[layer + 1]) - at.y) / d.y
            if start >= end:
                return FaceHit(end, False, False, layer)


@compiled
def next_face_hit(f: Face, layer: int, at: Vector, d: Vector) -> FaceHit:
    """Return the hit on the face ahead of a ray; without a hit, the distance at which the ray leaves the aperture."""
    start, end = search_range(f, at, d)
    if not end > start or abs(at.x) > f.half_width:
        return FaceHit(max(end, 0.0), False, False, layer)
    if len(f.profiles) > 0:
        return next_layer_hit(f, layer, at, d, start, end)
    distance = distance_to_face(f, 0, at, d, start, end)
    return FaceHit(min(distance, end), start < distance < math.inf, False, 0)


@compiled
def layer_of(f: Face, y: float) -> int:
    """Index of the layer at a given height."""
    low, high = 0, len(f.edges) - 2
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if f.edges[middle] <= y else (low, middle - 1)
    return low


class Walk(NamedTuple):
    """A ray on its way: position, light, optical path length so far, and outcome."""

    at: Vector
    beam: Beam
    optical: float
    fate: int


@compiled
def point_at(at: Vector, d: Vector, distance: float) -> Vector:
    """Position at a distance along a direction."""
    return Vector(at.x + distance * d.x, at.y + distance * d.y, at.z + distance * d.z)


@compiled
def is_over_body(f: Face, y: float, z: float) -> bool:
    """Whether a point at the aperture edge, viewed along y, is in the body: behind its base or its front corner."""
    layer = layer_of(f, y)
    return z > f.base_z or in_front(f, layer, f.half_width, math.copysign(f.half_height, y), z) < 0.0


@compiled
def misses_above_or_below(f: Face, at: Vector, d: Vector, distance: float) -> bool:
    """Whether a ray that misses the face leaves the slab above or below the body, not beside it."""
    if d.y == 0.0 or not d.z > 0.0 or abs(at.y + distance * d.y) < f.half_height * (1.0 - ROUNDING):
        return False
    if d.x == 0.0:
        return True
    to_side = (math.copysign(f.half_width, d.x) - at.x) / d.x
    return is_over_body(f, at.y + to_side * d.y, at.z + to_side * d.z)


@compiled
def past_lens(f: FaceInMedia, walk: Walk) -> Walk:
    """Advance a ray that misses the face to a point just beside the body, with y limited to the slab.

    If the face is deeper than the plane of the base, the walls begin only behind the face. A ray behind this plane is
    therefore placed farther from the walls.
    """
    face, at, d = f.face, walk.at, walk.beam.d
    if not d.z > 0.0 or d.x == 0.0:
        return walk
    distance = (math.copysign(face.half_width, d.x) - at.x) / d.x
    distance += (BESIDE_MM if at.z + distance * d.z > face.base_z else INSIDE_MM) / abs(d.x)
    distance = max(distance, 0.0)
    point = point_at(at, d, distance)
    if abs(point.y) > face.half_height and is_over_body(face, point.y, point.z):
        return Walk(at, walk.beam, walk.optical, MISSED)
    y = min(max(point.y, -face.half_height), face.half_height)
    return Walk(Vector(point.x, y, point.z), walk.beam, walk.optical + f.outside * distance, PASSED)


@compiled
def write_ray(f: FaceInMedia, rays: FaceRays, i: int, walk: Walk) -> None:
    """Write a ray to a row, with its polarisation in the vertical basis; a missed ray is placed outside the slab."""
    at, (d, e, light) = walk.at, walk.beam
    basis = upright(d)
    light = rotated_basis(light, dot(basis, e), dot(basis, cross(d, e)))
    rays.s[i], rays.p[i], rays.cr[i], rays.ci[i] = light.i1, light.i2, light.cr, light.ci
    rays.x[i], rays.y[i], rays.z[i] = at.x, at.y, at.z
    rays.dx[i], rays.dy[i], rays.dz[i] = d.x, d.y, d.z
    rays.optical[i] = walk.optical
    if walk.fate != ENTERED:
        rays.inside[i] = f.outside
    if walk.fate == MISSED:
        rays.y[i] = 4.0 * f.face.half_height


@linked
def store_reflected(
    f: FaceInMedia, rays: FaceRays, free: IntArray, i: int, layer: int, random: float, walk: Walk
) -> None:
    """Write the reflected part of a ray to a separate row, or count it as turned back if it cannot reach the body."""
    power = power_of(walk.beam.light)
    rays.lost[REFLECTED] += power
    row, inside = free[0], rays.inside[i]
    if power == 0.0:
        return
    if row == len(rays.x) or not (walk.beam.d.z > 0.0 or next_face_hit(f.face, layer, walk.at, walk.beam.d).is_hit):
        rays.lost[TURNED_BACK] += power
        return
    write_ray(f, rays, row, walk)
    rays.line[row], rays.inside[row], rays.random[row] = rays.line[i], inside, random
    free[0] += 1


@linked
def enter(f: FaceInMedia, rays: FaceRays, i: int, free: IntArray) -> Walk:
    """Return a ray after it has entered the body or missed the face."""
    at, d = Vector(rays.x[i], rays.y[i], rays.z[i]), Vector(rays.dx[i], rays.dy[i], rays.dz[i])
    beam = Beam(d, upright(d), Coherency(rays.s[i], rays.p[i], rays.cr[i], rays.ci[i]))
    inside, random, optical = rays.inside[i], rays.random[i], rays.optical[i]
    layer = layer_of(f.face, at.y)
    while True:
        d = beam.d
        hit = next_face_hit(f.face, layer, at, d)
        if not hit.is_hit:
            return Walk(at, beam, optical, MISSED if misses_above_or_below(f.face, at, d, hit.distance) else PASSED)
        at, layer = point_at(at, d, hit.distance), hit.layer
        optical += f.outside * hit.distance
        normal = (
            Vector(0.0, -math.copysign(1.0, d.y), 0.0) if hit.on_ledge else face_normal(f.face, layer, at.x, at.y, at.z)
        )
        if not dot(d, normal) < 0.0:  # grazing incidence
            return Walk(at, beam, optical, PASSED)
        border = Border(normal, f.outside, inside, False)
        parts = smooth_parts(beam, border)
        if f.counting:
            parts = split_beam(beam, border, Amplitudes(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0))
        on, back = power_of(parts.on.light), power_of(parts.back.light)
        if not hit.on_ledge:
            store_reflected(f, rays, free, i, layer, random, Walk(at, parts.back, optical, PASSED))
            return Walk(at, parts.on, optical, ENTERED)
        reflectance = back / (on + back)
        if not random < reflectance:
            return Walk(at, scaled_beam(parts.on, 1.0 / (1.0 - reflectance)), optical, ENTERED)
        random /= reflectance
        beam = scaled_beam(parts.back, 1.0 / reflectance)


@linked
def to_base(f: FaceInMedia, rays: FaceRays, i: int, walk: Walk) -> Walk:
    """Advance a ray in the body, with its reflections, to the plane of the stem's base, if it is not yet there."""
    at, beam, optical, _ = walk
    d, inside = beam.d, rays.inside[i]
    remaining = max((f.face.base_z - at.z) / d.z, 0.0) if d.z > 0.0 else 0.0
    for _ in range(MAX_BOUNCES):
        to_top = max((math.copysign(f.face.half_height, d.y) - at.y) / d.y, 0.0) if d.y != 0.0 else math.inf
        to_side = max((math.copysign(f.face.half_width, d.x) - at.x) / d.x, 0.0) if d.x != 0.0 else math.inf
        step = min(remaining, to_top, to_side)
        at = point_at(at, d, step)
        optical += inside * step
        transmitted = math.exp(-f.loss * step)
        rays.lost[ABSORBED] += (1.0 - transmitted) * power_of(beam.light)
        beam = scaled_beam(beam, transmitted)
        remaining -= step
        if not remaining > 0.0:
            break
        if to_top <= to_side:
            normal, outside = Vector(0.0, -math.copysign(1.0, d.y), 0.0), f.above if d.y > 0.0 else f.below
        else:
            normal, outside = Vector(-math.copysign(1.0, d.x), 0.0, 0.0), f.outside
        parts = smooth_parts(beam, Border(normal, inside, outside, False))
        loss = LEAKED if to_top <= to_side else TURNED_BACK  # both escape
        rays.lost[loss] += power_of(parts.on.light)
        beam = parts.back
        d = beam.d
    at = Vector(at.x + INSIDE_MM * d.x, at.y, at.z + INSIDE_MM * d.z)
    return Walk(at, beam, optical, ENTERED)


@called
def pass_face(f: FaceInMedia, rays: FaceRays, free: IntArray) -> None:
    """Advance rays to the face and into the body; ``free`` (1,) is the number of rows in use."""
    i = -1
    while i + 1 < free[0]:  # light reflected by the face is appended
        i += 1
        if abs(rays.y[i]) > f.face.half_height:
            continue
        walk = enter(f, rays, i, free)
        if walk.fate == ENTERED:
            walk = to_base(f, rays, i, walk)
        elif walk.fate == PASSED:
            walk = past_lens(f, walk)
        write_ray(f, rays, i, walk)
