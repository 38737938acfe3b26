"""What happens to a ray from one interface to the next, whoever follows it.

The loop over blocks of rays, the tree of one ray and the thread of a graphics card carry rays differently, but each
takes them through an interface by `meet`, which brings a ray to it, `leave`, which says what goes on and what back, and
`part`, the ray that does.
"""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.nearest import Hit, Ray, normal_at, other_side
from solen.trace.kernel.rows import TREATED, Floats, Precision, as_in
from solen.trace.kernel.surface import (
    COUNT,
    ROULETTE,
    Divided,
    Event,
    Incidence,
    at_surface,
    chance_of,
    drawn,
    end_fate,
)
from solen.trace.kernel.treated import FREE_PATH, PHASE, acting, at_treated
from solen.trace.result import ABSORBED, ESCAPED, TRUNCATED
from solen.trace.tables import Tables


class Rules(NamedTuple):
    """How rays are followed."""

    splitting: int
    min_weight: float
    max_hits: int
    seed: int
    first: int
    """number of the first ray"""
    step: int
    """from one ray's number to the next one's"""
    turbid: bool
    """whether some medium scatters"""


class Load(NamedTuple):
    """What a ray carries: powers in s and p, the least that is followed, where it is and what it has behind it."""

    s: float
    p: float
    least: float
    optical: float
    """optical path so far, mm"""
    region: int
    """−1: not known yet"""
    colour: int
    number: int
    hits: int


class Meeting(NamedTuple):
    """A ray at the interface ahead of it."""

    x: float
    z: float
    nx: float
    nz: float
    """left normal of the curve"""
    here: int
    """region on the side that the ray comes from"""
    there: int
    undefined: bool
    """whether the ray was in another region"""
    corner: bool
    """whether the ray stands in a corner and meets no more than the end of the other curve"""
    loss: float
    """absorption per mm on the way here"""
    kept: float
    """share of the power that is left"""
    fate: int


@compiled
def event_of(rules: Rules, load: Load) -> Event:
    """The meeting that a ray is at."""
    return Event(rules.seed, rules.first + rules.step * load.number, load.hits)


@compiled
def meet(k: Precision, tables: Tables, rules: Rules, ray: Ray, hit: Hit, load: Load) -> Meeting:
    """What becomes of a ray on its way to a curve, before the surface itself acts on it."""
    c, length = hit.curve, hit.distance
    px, pz = ray.x + length * ray.dx, ray.z + length * ray.dz
    nx, nz = normal_at(k, tables.kind[c], tables.shape, c, px, pz, hit.place)
    from_right = ray.dx * nx + ray.dz * nz > 0.0
    here, there = tables.left[c], tables.right[c]
    if from_right:
        here, there = there, here
    undefined = load.region != -1 and load.region != here
    corner = length <= k.corner and ray.last >= 0 and (undefined or other_side(k, tables, ray, c))
    loss = tables.absorption[load.colour, here] if rules.splitting != COUNT and not undefined else k.zero
    kept = math.exp(-loss * length) if loss > 0.0 else k.one
    worn_out = undefined or load.hits + 1 >= rules.max_hits or kept * (load.s + load.p) < load.least
    behaviour = tables.behaviour[c]
    if behaviour >= TREATED:
        behaviour = acting(tables, c, load.colour)
    fate = TRUNCATED if undefined else end_fate(behaviour, from_right, worn_out)
    return Meeting(px, pz, nx, nz, here, there, undefined, corner, loss, kept, fate)


@compiled
def escape(k: Precision, tables: Tables, rules: Rules, region: int, colour: int) -> tuple[float, int]:
    """Absorption per mm where a ray is that meets nothing more, and its fate."""
    loss = tables.absorption[colour, region] if rules.splitting != COUNT and region >= 0 else k.zero
    return loss, ABSORBED if loss > 0.0 else ESCAPED


@compiled
def carried_on(k: Precision, ray: Ray, hit: Hit) -> Ray:
    """A ray in a corner, carried on beyond the end of the curve it would meet; far out less is lost in rounding."""
    step = k.corner + k.rounding * (abs(ray.x) + abs(ray.z))
    return Ray(ray.x + step * ray.dx, ray.z + step * ray.dz, ray.dx, ray.dz, hit.curve, hit.place)


@compiled
def weakened(load: Load, kept: float, way: float) -> Load:
    """A load of which a medium left so much, after so long an optical path."""
    return Load(
        kept * load.s, kept * load.p, load.least, load.optical + way, load.region, load.colour, load.number, load.hits
    )


class Leaving(NamedTuple):
    """What leaves an interface."""

    parts: Divided
    lost: float
    """power that the surface absorbs"""
    cut: float
    """power of the parts that are too weak to be followed"""
    both: bool
    """whether both parts are followed"""
    ends: bool
    """whether none is"""
    goes_back: bool
    """whether the part to be followed first goes back: of two the weaker one"""


@compiled
def leave(
    k: Precision, tables: Tables, rules: Rules, treatments: Floats | None, ray: Ray, c: int, met: Meeting, load: Load
) -> Leaving:
    """What the surface of curve ``c`` makes of a ray; its powers are those that reach it.

    ``treatments`` are those of the tables, or None where there are none: then what they need is not even compiled.
    """
    index = tables.refractive_index[load.colour]
    n1, n2, lost = index[met.here], index[met.there], k.zero
    incidence = Incidence(met.x, met.z, ray.dx, ray.dz, met.nx, met.nz, n1, n2, load.s, load.p)
    if treatments is None or tables.behaviour[c] < TREATED:
        parts = at_surface(k, tables.behaviour[c], rules.splitting, incidence)
    else:
        parts = at_treated(k, tables, rules.splitting, c, load.colour, event_of(rules, load), incidence)
        lost = max((load.s - parts.on_s - parts.back_s) + (load.p - parts.on_p - parts.back_p), k.zero)
    on, back = parts.on_s + parts.on_p, parts.back_s + parts.back_p
    if rules.splitting == ROULETTE and on > 0.0 and back > 0.0:
        parts, on, back = drawn(k, event_of(rules, load), load.s + load.p - lost, parts)
    cut = (on if on < load.least else k.zero) + (back if back < load.least else k.zero)
    both = on >= load.least and back >= load.least
    ends = not (on >= load.least or back >= load.least)
    goes_back = back <= on if both else back >= load.least
    return Leaving(parts, lost, cut, both, ends, goes_back)


@compiled
def part(hit: Hit, met: Meeting, parts: Divided, load: Load, back: bool) -> tuple[Ray, Load]:
    """The part of a ray that goes back from an interface, or the one that goes on."""
    if back:
        ray = Ray(met.x, met.z, parts.back_x, parts.back_z, hit.curve, hit.place)
        s, p, region = parts.back_s, parts.back_p, met.here
    else:
        ray = Ray(met.x, met.z, parts.on_x, parts.on_z, hit.curve, hit.place)
        s, p, region = parts.on_s, parts.on_p, met.there
    return ray, Load(s, p, load.least, load.optical, region, load.colour, load.number, load.hits + 1)


@compiled
def free_path(k: Precision, tables: Tables, rules: Rules, region: int, load: Load) -> float:
    """How far a ray gets in a medium before it is scattered, mm: drawn from the exponential distribution."""
    scattering = tables.scattering[load.colour, region]
    if not scattering > 0.0:
        return k.none
    share = chance_of(event_of(rules, load), FREE_PATH)
    path: float = as_in(k.zero, -math.log(1.0 - share)) / scattering
    return path


@compiled
def phase_turn(k: Precision, tables: Tables, rules: Rules, region: int, load: Load) -> float:
    """Tangent of half the angle by which scattering turns a ray in the plane: the wrapped Cauchy distribution."""
    share = chance_of(event_of(rules, load), PHASE)
    g = tables.anisotropy[load.colour, region]
    half: float = (k.one - g) / (k.one + g) * as_in(k.zero, math.tan(math.pi * (share - 0.5)))
    return half


@compiled
def turned(k: Precision, half: float, dx: float, dz: float) -> tuple[float, float]:
    """Direction turned by the angle of whose half this is the tangent."""
    scale = k.one / (k.one + half * half)
    cos, sin = (k.one - half * half) * scale, (half + half) * scale
    return cos * dx - sin * dz, sin * dx + cos * dz
