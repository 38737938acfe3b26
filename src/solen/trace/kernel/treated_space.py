"""Treated surfaces in space, as `solen.trace.kernel.treated` in the plane.

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
    dot,
    smooth_parts,
    split_beam,
    unit,
    unpolarised,
    upright,
)
from solen.trace.kernel.surface import COUNT, Event, uniform_of
from solen.trace.kernel.treated import (
    FACET,
    REFLECTED,
    REJECTION,
    TRANSMITTED,
    TRIES,
    Amplitudes,
    acting,
    film,
    is_opaque,
    tabulated,
    tabulated_offset,
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
    cos = -dot(d, f)
    if t.rows > 0.0 and not counting:
        no_transmission = behaviour == MIRROR or bare(n1, n2, n1 * cos).on_s == 0.0
        a = tabulated(tables, t, from_right, cos, no_transmission)
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
        if t.layers > 0.0 and is_opaque(tables, t, colour, cos, n1):
            a = Amplitudes(1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if a.on_s > 0.0 and (counting or t.partial == 0.0):
            a = Amplitudes(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0)
    through, reflected = split_beam(beam, Border(f, n1, n2, from_right), a)
    if behaviour == SPLITTER:
        through = Beam(d, through.e, through.light)
    if t.scatter != SMOOTH:
        if uniform_of(event, TRANSMITTED) < t.scatter_fraction:
            d = scattered(tables, t, event, TRANSMITTED, through.d, Vector(-n.x, -n.y, -n.z))
            through = Beam(d, upright(d), unpolarised(through.light))
        if uniform_of(event, REFLECTED) < t.scatter_fraction:
            d = scattered(tables, t, event, REFLECTED, reflected.d, n)
            reflected = Beam(d, upright(d), unpolarised(reflected.light))
    return Parts(through, reflected)


@compiled
def facet(t: Treatment, event: Event, d: Vector, border: Border) -> Vector:
    """Normal of the ripple facet that a ray meets; see `solen.trace.kernel.treated.facet`."""
    n, n1, n2, _ = border
    along = Vector(0.0, 1.0, 0.0) if t.across > 0.0 else Vector(-n.z, 0.0, n.x)
    cos_in, sine = -dot(d, n), dot(d, along)
    steepest = 1.0 + t.tilt * abs(sine) / cos_in
    for i in range(TRIES):
        slope = t.tilt * math.cos(2.0 * math.pi * uniform_of(event, FACET + 2 * i))
        projected = 1.0 - slope * sine / cos_in
        if uniform_of(event, FACET + 2 * i + 1) * steepest > projected:
            continue
        f = unit(Vector(n.x + slope * along.x, n.y + slope * along.y, n.z + slope * along.z))
        cos, upwards = -dot(d, f), dot(f, n)
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
    """Direction sampled from the profile around the smooth direction, on the side of the wall normal."""
    sine = d.x * -n.z + d.z * n.x
    for i in range(TRIES):
        random_1, random_2 = uniform_of(event, purpose + 2 * i + 1), uniform_of(event, purpose + 2 * i + 2)
        radius, along, up = math.sqrt(random_1), sine, d.y
        if t.scatter == GAUSSIAN:
            radius = t.width * math.sqrt(-2.0 * math.log(1.0 - random_1))
        elif t.scatter == HARVEY_SHACK:
            radius = t.width * harvey_shack_radius(t.width, t.wing, random_1)
        elif t.scatter == BY_TABLE:
            radius, acceptance = tabulated_offset(tables, t, random_1, True)
            if not acceptance > uniform_of(event, purpose + REJECTION + i):
                continue
        else:
            along, up = 0.0, 0.0
        along += radius * math.cos(2.0 * math.pi * random_2)
        up += radius * math.sin(2.0 * math.pi * random_2)
        cos2 = 1.0 - along * along - up * up
        if cos2 > 0.0:
            cos = math.sqrt(cos2)
            return Vector(cos * n.x - along * n.z, up, cos * n.z + along * n.x)
    return d


@compiled
def harvey_shack_radius(width: float, wing: float, fraction: float) -> float:
    """Radius, in shoulders, that contains a fraction of the profile, which is truncated at offsets of 2."""
    widest, power = 1.0 + (2.0 / width) ** 2, 1.0 - 0.5 * wing
    if abs(power) < 1e-9:
        return math.sqrt(math.expm1(fraction * math.log(widest)))
    return math.sqrt(max((1.0 + fraction * (widest**power - 1.0)) ** (1.0 / power) - 1.0, 0.0))


@compiled
def henyey_greenstein(random_1: float, random_2: float, g: float, d: Vector) -> Vector:
    """Direction after scattering in a turbid medium (Astrophys. J. 93, 70, 1941), from two numbers in [0, 1)."""
    cos = 1.0 - 2.0 * random_1
    if abs(g) > 1e-6:
        ratio = (1.0 - g * g) / (1.0 + g - 2.0 * g * random_1)
        cos = (1.0 + g * g - ratio * ratio) / (2.0 * g)
    sin = math.sqrt(max(1.0 - cos * cos, 0.0))
    e = upright(d)
    f = Vector(d.y * e.z - d.z * e.y, d.z * e.x - d.x * e.z, d.x * e.y - d.y * e.x)
    a, b = sin * math.cos(2.0 * math.pi * random_2), sin * math.sin(2.0 * math.pi * random_2)
    return unit(Vector(cos * d.x + a * e.x + b * f.x, cos * d.y + a * e.y + b * f.y, cos * d.z + a * e.z + b * f.z))
