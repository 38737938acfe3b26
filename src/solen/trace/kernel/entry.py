"""The compiled path of rays through a face whose walls are not vertical, into a body that is a prism behind the face.

Coordinates are those of the lens frame. A ray from in front of the face is advanced to it, layer by layer; a smooth
face is one layer. Where a layer protrudes beyond the one that the ray comes from, the ray meets the horizontal *ledge*
of that layer, which changes β, the quantity that vertical walls conserve. One of the two parts at a ledge is followed,
drawn with probability proportional to its power. At the face both parts are followed, because reflected light may meet
the next ledge. Light that enters is advanced, with reflections off top and bottom, to the plane of the stem's base,
unless it is already beyond that plane; from there on the body is a prism.

Two cases are not modelled. Rays in the body that return to the face meet the cylinder of its middle section instead.
Rays in the body that meet a ledge from within, on their way to the middle of the body, or that travel back from a
ledge, are not treated.
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
    divided,
    power_of,
    scalar,
    smooth_parts,
    times,
    turned_basis,
    unit_of,
    upright,
    vector,
)
from solen.trace.kernel.treated import Amplitudes

MAX_STEPS = 500
"""Maximum number of steps towards the face."""
CLOSE_MM, INSIDE_MM, BESIDE_MM = 1e-13, 1e-7, 0.05
"""Accuracy of a hit on the face; depth inside the body at which entering rays start; distance from the lens at which
other rays start.
"""
BEYOND_MM = 1e-3
"""Margin in front of the nearest point and behind the deepest point of a face within which hits are sought, to allow
for errors of these points.
"""
ROUNDING, TINY = 1e-12, 1e-300
MAX_BOUNCES = 1000

PASSED, ENTERED, OVER = range(3)
"""Outcomes for a ray: passes beside the face; enters the body; passes above or below it."""
LEAKED, REFLECTED, TURNED_BACK, ABSORBED, LOST = range(5)


class Faced(NamedTuple):
    """A face and the media in front of it, behind it and beside it."""

    face: Face
    outside: float
    above: float
    below: float
    loss: float
    """absorption coefficient of the body in 1/mm"""
    counts: bool
    """whether rays are counted, and therefore not split"""


class Passage(NamedTuple):
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
    chance: FloatArray
    """random number from 0 to 1, for ledges"""
    line: IntArray
    lost: FloatArray
    """(4,) powers: leaked; reflected by the face; the reflected part that turns back; absorbed"""


class Step(NamedTuple):
    """Distance of a ray to the face, whether the ray meets the face, and whether it does so on a ledge."""

    way: float
    met: bool
    ledge: bool
    layer: int


@compiled
def optical_length(f: Face, x: float, y: float, z: float) -> tuple[float, Vector]:
    """Optical length via a point to the wavefront behind a smooth face, minus that via the vertex; its gradient."""
    from_line = math.sqrt(x * x + (f.focus - z) * (f.focus - z))
    length, by_line, by_y = from_line - f.focus, 1.0, 0.0
    if f.ring_radius < math.inf:
        away = f.ring_radius - from_line
        size = math.sqrt(away * away + y * y)
        length, by_line, by_y = (f.ring_radius - f.focus) - size, away / size, -y / size
    rise = z + f.distance
    r = math.sqrt(x * x + y * y + rise * rise)
    scale = f.design_index * by_line / from_line
    gradient = Vector(x / r + scale * x, y / r + f.design_index * by_y, rise / r - scale * (f.focus - z))
    return r - f.distance + f.design_index * length, gradient


@compiled
def before(f: Face, layer: int, x: float, y: float, z: float) -> float:
    """Function above 0 in front of the face and below 0 in the body: optical length, or distance from a profile."""
    if len(f.profiles) > 0:
        return profile_at(f, layer, x)[0] - z
    return optical_length(f, x, y, z)[0]


@compiled
def place_on(f: Face, x: float) -> tuple[float, int, float]:
    """Spacing of the profile points, the point before a lateral position, and the relative distance to the next."""
    step = f.half_width / (f.profiles.shape[1] - 1)
    at = min(abs(x), f.half_width) / step
    cell = min(int(at), f.profiles.shape[1] - 2)
    return step, cell, at - cell


@compiled
def profile_at(f: Face, layer: int, x: float) -> tuple[float, float]:
    """Depth z of a layer's profile, and dz/dx."""
    step, cell, t = place_on(f, x)
    a, p, q = f.profiles[layer, cell], f.slopes[layer, cell], f.slopes[layer, cell + 1]
    rise = (f.profiles[layer, cell + 1] - a) / step
    second, third = 3.0 * rise - 2.0 * p - q, p + q - 2.0 * rise
    slope = p + t * (2.0 * second + t * 3.0 * third)
    return a + step * t * (p + t * (second + t * third)), slope if x >= 0.0 else -slope


@compiled
def facing(f: Face, layer: int, x: float, y: float, z: float) -> Vector:
    """Outward unit normal of the face."""
    if len(f.profiles) > 0:
        return unit_of(Vector(profile_at(f, layer, x)[1], 0.0, -1.0))
    return unit_of(optical_length(f, x, y, z)[1])


@compiled
def search_range(f: Face, at: Vector, d: Vector) -> tuple[float, float]:
    """Distances between which a ray may meet the face: from its nearest to its deepest point, within the aperture."""
    first, last = f.min_z - BEYOND_MM, f.max_z + BEYOND_MM
    start, end = 0.0, math.inf
    if d.z > 0.0:
        start, end = max((first - at.z) / d.z, 0.0), (last - at.z) / d.z
    elif d.z < 0.0:
        end = (first - at.z) / d.z
    if d.x != 0.0:
        end = min(end, (math.copysign(f.half_width, d.x) - at.x) / d.x)
    if d.y != 0.0:
        end = min(end, (math.copysign(f.half_height, d.y) - at.y) / d.y)
    return start, end


@compiled
def along(f: Face, layer: int, at: Vector, d: Vector, way: float) -> tuple[float, float]:
    """The function `before` at a point along a ray, and its derivative along the ray."""
    x, y, z = at.x + way * d.x, at.y + way * d.y, at.z + way * d.z
    if len(f.profiles) > 0:
        depth, slope = profile_at(f, layer, x)
        return depth - z, slope * d.x - d.z
    length, gradient = optical_length(f, x, y, z)
    return length, scalar(gradient, d)


@compiled
def reach(f: Face, layer: int, at: Vector, d: Vector, start: float, end: float) -> float:
    """Distance to a smooth face, or to the profile of a layer; infinite if there is no hit before the end.

    Newton's method is used with the smallest possible second derivative, so that no step passes the first root.
    """
    bend, t = (f.max_bend * d.x * d.x if len(f.profiles) > 0 else f.max_bend), start
    for _ in range(MAX_STEPS):
        g, change = along(f, layer, at, d, t)
        g = max(g, 0.0)
        root = math.sqrt(change * change + 2.0 * bend * g)
        away = (change + root) / bend if bend > 0.0 else math.inf
        step = 2.0 * g / (root - change) if change < 0.0 else away
        t += step
        if t > end + CLOSE_MM:
            break
        if step <= CLOSE_MM:
            return min(t, end)
    return math.inf


@compiled
def may_dip(f: Face, d: Vector, g: float, change: float, way: float) -> bool:
    """Whether a ray may have been behind a profile within the distance ``way`` before this point."""
    return g <= 0.0 or change > 0.0 or g - change * way <= 0.5 * f.max_bend * d.x * d.x * way * way


@linked
def to_layers(f: Face, layer: int, at: Vector, d: Vector, start: float, end: float) -> Step:
    """Find the profile of a layer ahead of a ray, or the ledge of the next layer.

    Layers that the ray certainly passes are skipped, based on the largest decrease of its distance from layer to layer.
    """
    if start > 0.0:
        layer = layer_of(f, at.y + start * d.y)
    up, last = (1 if d.y > 0.0 else -1), len(f.edges) - 2
    fall = f.max_step + TINY
    if d.y != 0.0:
        slope = f.max_fall if at.x * d.x >= 0.0 else max(f.max_rise, f.max_fall)  # the ray may cross the axis
        rate = d.z + abs(d.x) * slope
        fall += max(rate, 0.0) * f.max_layer / abs(d.y)
    while True:
        border = f.edges[layer + 1] if d.y > 0.0 else f.edges[layer]
        to = max(min((border - at.y) / d.y, end) if d.y != 0.0 else end, start)
        g, change = along(f, layer, at, d, to)
        if may_dip(f, d, g, change, to - start):
            way = reach(f, layer, at, d, start, to)
            if way < math.inf:
                return Step(way, True, False, layer)
        following = layer + up
        if to >= end or not 0 <= following <= last:
            return Step(end, False, False, layer)
        g = along(f, following, at, d, to)[0]
        if g <= 0.0:
            return Step(to, True, True, layer)
        start, layer = to, following
        passed = int(min(g / fall, float(last - following if d.y > 0.0 else following)))
        if passed > 0:
            layer = following + up * passed
            start = ((f.edges[layer] if d.y > 0.0 else f.edges[layer + 1]) - at.y) / d.y
            if start >= end:
                return Step(end, False, False, layer)


@compiled
def to_face(f: Face, layer: int, at: Vector, d: Vector) -> Step:
    """Find the face ahead of a ray; without a hit, return the distance at which the ray leaves the aperture."""
    start, end = search_range(f, at, d)
    if not end > start or abs(at.x) > f.half_width:
        return Step(max(end, 0.0), False, False, layer)
    if len(f.profiles) > 0:
        return to_layers(f, layer, at, d, start, end)
    way = reach(f, 0, at, d, start, end)
    return Step(min(way, end), start < way < math.inf, False, 0)


@compiled
def layer_of(f: Face, y: float) -> int:
    """Number of the layer at a given height."""
    low, high = 0, len(f.edges) - 2
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if f.edges[middle] <= y else (low, middle - 1)
    return low


class Walk(NamedTuple):
    """A ray on its way: position, light, and its optical path length so far."""

    at: Vector
    beam: Beam
    optical: float
    fate: int


@compiled
def ahead(at: Vector, d: Vector, way: float) -> Vector:
    """Position at a distance along a direction."""
    return Vector(at.x + way * d.x, at.y + way * d.y, at.z + way * d.z)


@compiled
def over_body(f: Face, y: float, z: float) -> bool:
    """Whether a point at the aperture edge, viewed along y, is in the body: behind its base or its front corner."""
    layer = layer_of(f, y)
    return z > f.base_z or before(f, layer, f.half_width, math.copysign(f.half_height, y), z) < 0.0


@compiled
def goes_over(f: Face, at: Vector, d: Vector, way: float) -> bool:
    """Whether a ray that misses the face leaves the slab above or below the body, not beside it."""
    if d.y == 0.0 or not d.z > 0.0 or abs(at.y + way * d.y) < f.half_height * (1.0 - ROUNDING):
        return False
    if d.x == 0.0:
        return True
    aside = (math.copysign(f.half_width, d.x) - at.x) / d.x
    return over_body(f, at.y + aside * d.y, at.z + aside * d.z)


@compiled
def beside(f: Faced, walk: Walk) -> Walk:
    """Move a ray that misses the face just beside the body; if it left the slab on the way, place it at the edge.

    Behind the base the prism is cut away in front of a deeper face: there the ray is placed beside the wall.
    """
    face, at, d = f.face, walk.at, walk.beam.d
    if not d.z > 0.0 or d.x == 0.0:
        return walk
    way = (math.copysign(face.half_width, d.x) - at.x) / d.x
    way += (BESIDE_MM if at.z + way * d.z > face.base_z else INSIDE_MM) / abs(d.x)
    way = max(way, 0.0)
    there = ahead(at, d, way)
    if abs(there.y) > face.half_height and over_body(face, there.y, there.z):
        return Walk(at, walk.beam, walk.optical, OVER)
    y = min(max(there.y, -face.half_height), face.half_height)
    return Walk(Vector(there.x, y, there.z), walk.beam, walk.optical + f.outside * way, PASSED)


@compiled
def write(f: Faced, rays: Passage, i: int, walk: Walk) -> None:
    """Write a ray to a row, with its polarisation in the vertical basis; a ray over the body goes outside the slab."""
    at, (d, e, light) = walk.at, walk.beam
    basis = upright(d)
    light = turned_basis(light, scalar(basis, e), scalar(basis, vector(d, e)))
    rays.s[i], rays.p[i], rays.cr[i], rays.ci[i] = light.i1, light.i2, light.cr, light.ci
    rays.x[i], rays.y[i], rays.z[i] = at.x, at.y, at.z
    rays.dx[i], rays.dy[i], rays.dz[i] = d.x, d.y, d.z
    rays.optical[i] = walk.optical
    if walk.fate != ENTERED:
        rays.inside[i] = f.outside
    if walk.fate == OVER:
        rays.y[i] = 4.0 * f.face.half_height


@linked
def set_aside(f: Faced, rays: Passage, free: IntArray, i: int, layer: int, chance: float, walk: Walk) -> None:
    """Write the reflected part of a ray to its own row if it may reach the body; otherwise it turns back."""
    power = power_of(walk.beam.light)
    rays.lost[REFLECTED] += power
    row, inside = free[0], rays.inside[i]
    if power == 0.0:
        return
    if row == len(rays.x) or not (walk.beam.d.z > 0.0 or to_face(f.face, layer, walk.at, walk.beam.d).met):
        rays.lost[TURNED_BACK] += power
        return
    write(f, rays, row, walk)
    rays.line[row], rays.inside[row], rays.chance[row] = rays.line[i], inside, chance
    free[0] += 1


@linked
def met(f: Faced, rays: Passage, i: int, free: IntArray) -> Walk:
    """Return a ray at the face, as it enters the body or misses the face."""
    at, d = Vector(rays.x[i], rays.y[i], rays.z[i]), Vector(rays.dx[i], rays.dy[i], rays.dz[i])
    beam = Beam(d, upright(d), Coherency(rays.s[i], rays.p[i], rays.cr[i], rays.ci[i]))
    inside, chance, optical = rays.inside[i], rays.chance[i], rays.optical[i]
    layer = layer_of(f.face, at.y)
    while True:
        d = beam.d
        step = to_face(f.face, layer, at, d)
        if not step.met:
            return Walk(at, beam, optical, OVER if goes_over(f.face, at, d, step.way) else PASSED)
        at, layer = ahead(at, d, step.way), step.layer
        optical += f.outside * step.way
        normal = Vector(0.0, -math.copysign(1.0, d.y), 0.0) if step.ledge else facing(f.face, layer, at.x, at.y, at.z)
        if not scalar(d, normal) < 0.0:  # grazing incidence
            return Walk(at, beam, optical, PASSED)
        border = Border(normal, f.outside, inside, False)
        parts = smooth_parts(beam, border)
        if f.counts:
            parts = divided(beam, border, Amplitudes(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0))
        on, back = power_of(parts.on.light), power_of(parts.back.light)
        if not step.ledge:
            set_aside(f, rays, free, i, layer, chance, Walk(at, parts.back, optical, PASSED))
            return Walk(at, parts.on, optical, ENTERED)
        returned = back / (on + back)
        if not chance < returned:
            return Walk(at, times(parts.on, 1.0 / (1.0 - returned)), optical, ENTERED)
        chance /= returned
        beam = times(parts.back, 1.0 / returned)


@linked
def carried(f: Faced, rays: Passage, i: int, walk: Walk) -> Walk:
    """Advance a ray in the body, with its reflections, to the plane of the stem's base unless it is beyond it."""
    at, beam, optical, _ = walk
    d, inside = beam.d, rays.inside[i]
    way = max((f.face.base_z - at.z) / d.z, 0.0) if d.z > 0.0 else 0.0
    for _ in range(MAX_BOUNCES):
        over = max((math.copysign(f.face.half_height, d.y) - at.y) / d.y, 0.0) if d.y != 0.0 else math.inf
        side = max((math.copysign(f.face.half_width, d.x) - at.x) / d.x, 0.0) if d.x != 0.0 else math.inf
        to = min(way, over, side)
        at = ahead(at, d, to)
        optical += inside * to
        kept = math.exp(-f.loss * to)
        rays.lost[ABSORBED] += (1.0 - kept) * power_of(beam.light)
        beam = times(beam, kept)
        way -= to
        if not way > 0.0:
            break
        if over <= side:
            normal, outside = Vector(0.0, -math.copysign(1.0, d.y), 0.0), f.above if d.y > 0.0 else f.below
        else:
            normal, outside = Vector(-math.copysign(1.0, d.x), 0.0, 0.0), f.outside
        parts = smooth_parts(beam, Border(normal, inside, outside, False))
        rays.lost[LEAKED if over <= side else TURNED_BACK] += power_of(
            parts.on.light
        )  # light that leaves through a side also escapes
        beam = parts.back
        d = beam.d
    at = Vector(at.x + INSIDE_MM * d.x, at.y, at.z + INSIDE_MM * d.z)
    return Walk(at, beam, optical, ENTERED)


@called
def pass_face(f: Faced, rays: Passage, free: IntArray) -> None:
    """Advance rays to the face and into the body; ``free`` (1,) is the number of rows in use."""
    i = -1
    while i + 1 < free[0]:  # light reflected by the face is appended
        i += 1
        if abs(rays.y[i]) > f.face.half_height:
            continue
        walk = met(f, rays, i, free)
        if walk.fate == ENTERED:
            walk = carried(f, rays, i, walk)
        elif walk.fate == PASSED:
            walk = beside(f, walk)
        write(f, rays, i, walk)
