"""Treated surfaces in space: the counterpart of `solen.trace.kernel.treated` in the plane.

Scatter profiles are rotationally symmetric in the disc of direction cosines, scattered light is unpolarised, and a
texture tilts the surface along the interface or along y. Ideal elements and gratings exist only in the plane.
"""

import math

from solen.trace.kernel.compiled import called, compiled
from solen.trace.kernel.rows import (
    BY_TABLE,
    GAUSSIAN,
    HARVEY_SHACK,
    MIRROR,
    SMOOTH,
    SPLITTER,
    Treatment,
    treatment_row,
)
from solen.trace.kernel.space import (
    Beam,
    Border,
    Parts,
    Vector,
    bare,
    divided,
    scalar,
    smooth_parts,
    unit_of,
    unpolarised,
    upright,
)
from solen.trace.kernel.surface import COUNT, Event, chance_of
from solen.trace.kernel.treated import (
    BACK,
    FACET,
    KEEP,
    ON,
    TRIES,
    Amplitudes,
    acting,
    by_angle,
    film,
    offset,
    shut,
)
from solen.trace.tables import Tables


@called
def treated_parts(
    tables: Tables, splitting: int, c: int, colour: int, event: Event, beam: Beam, border: Border
) -> Parts:
    """Return both parts at a treated wall."""
    t, behaviour = treatment_row(tables.treatments, tables.treatment[c]), acting(tables, c, colour)
    if behaviour < 0:
        return smooth_parts(beam, border)
    d, (n, n1, n2, from_right) = beam.d, border
    f = facet(t, event, d, border) if t.tilt > 0.0 else n
    counting = splitting == COUNT
    cos = -scalar(d, f)
    if t.rows > 0.0 and not counting:
        no_way_on = behaviour == MIRROR or bare(n1, n2, n1 * cos).on_s == 0.0
        a = by_angle(tables, t, from_right, cos, no_way_on)
    elif behaviour == MIRROR:
        rho = 1.0 if counting else t.reflectance
        a = Amplitudes(rho, rho, -rho, 0.0, 0.0, 0.0, 0.0, 0.0)
    elif behaviour == SPLITTER:
        on = 1.0 if counting else t.transmitted
        a = Amplitudes(1.0 - on, 1.0 - on, on - 1.0, 0.0, on, on, on, 0.0)
    elif t.layers > 0.0 and not counting:
        a = film(tables, t, colour, from_right, cos, n1, n2)
    else:
        a = bare(n1, n2, n1 * cos)
        if t.layers > 0.0 and shut(tables, t, colour, cos, n1):
            a = Amplitudes(1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if a.on_s > 0.0 and (counting or t.partial == 0.0):
            a = Amplitudes(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    ahead, behind = divided(beam, Border(f, n1, n2, from_right), a)
    if behaviour == SPLITTER:
        ahead = Beam(d, ahead.e, ahead.light)
    if t.scatter != SMOOTH:
        if chance_of(event, ON) < t.share:
            d = scattered(tables, t, event, ON, ahead.d, Vector(-n.x, -n.y, -n.z))
            ahead = Beam(d, upright(d), unpolarised(ahead.light))
        if chance_of(event, BACK) < t.share:
            d = scattered(tables, t, event, BACK, behind.d, n)
            behind = Beam(d, upright(d), unpolarised(behind.light))
    return Parts(ahead, behind)


@compiled
def facet(t: Treatment, event: Event, d: Vector, border: Border) -> Vector:
    """Normal of the ripple facet that a ray meets; see `solen.trace.kernel.treated.facet`."""
    n, n1, n2, _ = border
    along = Vector(0.0, 1.0, 0.0) if t.across > 0.0 else Vector(-n.z, 0.0, n.x)
    cos_in, sine = -scalar(d, n), scalar(d, along)
    steepest = 1.0 + t.tilt * abs(sine) / cos_in
    for i in range(TRIES):
        slope = t.tilt * math.cos(2.0 * math.pi * chance_of(event, FACET + 2 * i))
        seen = 1.0 - slope * sine / cos_in
        if chance_of(event, FACET + 2 * i + 1) * steepest > seen:
            continue
        f = unit_of(Vector(n.x + slope * along.x, n.y + slope * along.y, n.z + slope * along.z))
        cos, upwards = -scalar(d, f), scalar(f, n)
        if not cos > 0.0:
            continue
        back = -cos_in + 2.0 * cos * upwards
        cos2 = n2 * n2 - n1 * n1 * (1.0 - cos * cos)
        onwards = -n1 * cos_in + (n1 * cos - math.sqrt(cos2)) * upwards if cos2 > 0.0 else -1.0
        if back > 0.0 and onwards < 0.0:
            return f
    return n


@compiled
def scattered(tables: Tables, t: Treatment, event: Event, purpose: int, d: Vector, n: Vector) -> Vector:
    """Direction drawn from the profile around the smooth direction, on the side of the wall normal."""
    flat = d.x * -n.z + d.z * n.x
    for i in range(TRIES):
        one, two = chance_of(event, purpose + 2 * i + 1), chance_of(event, purpose + 2 * i + 2)
        radius, along, up = math.sqrt(one), flat, d.y
        if t.scatter == GAUSSIAN:
            radius = t.width * math.sqrt(-2.0 * math.log(1.0 - one))
        elif t.scatter == HARVEY_SHACK:
            radius = t.width * harvey_shack_radius(t.width, t.wing, one)
        elif t.scatter == BY_TABLE:
            radius, kept = offset(tables, t, one, True)
            if not kept > chance_of(event, purpose + KEEP + i):
                continue
        else:
            along, up = 0.0, 0.0
        along += radius * math.cos(2.0 * math.pi * two)
        up += radius * math.sin(2.0 * math.pi * two)
        rest = 1.0 - along * along - up * up
        if rest > 0.0:
            cos = math.sqrt(rest)
            return Vector(cos * n.x - along * n.z, up, cos * n.z + along * n.x)
    return d


@compiled
def harvey_shack_radius(width: float, wing: float, share: float) -> float:
    """Radius in shoulders that contains the fraction ``share`` of the profile truncated at offsets of 2."""
    widest, power = 1.0 + (2.0 / width) ** 2, 1.0 - 0.5 * wing
    if abs(power) < 1e-9:
        return math.sqrt(math.expm1(share * math.log(widest)))
    return math.sqrt(max((1.0 + share * (widest**power - 1.0)) ** (1.0 / power) - 1.0, 0.0))


@compiled
def henyey_greenstein(one: float, two: float, g: float, d: Vector) -> Vector:
    """Direction after scattering in a turbid medium (Astrophys. J. 93, 70, 1941), from two numbers in [0, 1)."""
    cos = 1.0 - 2.0 * one
    if abs(g) > 1e-6:
        part = (1.0 - g * g) / (1.0 + g - 2.0 * g * one)
        cos = (1.0 + g * g - part * part) / (2.0 * g)
    sin = math.sqrt(max(1.0 - cos * cos, 0.0))
    e = upright(d)
    f = Vector(d.y * e.z - d.z * e.y, d.z * e.x - d.x * e.z, d.x * e.y - d.y * e.x)
    a, b = sin * math.cos(2.0 * math.pi * two), sin * math.sin(2.0 * math.pi * two)
    return unit_of(Vector(cos * d.x + a * e.x + b * f.x, cos * d.y + a * e.y + b * f.y, cos * d.z + a * e.z + b * f.z))
