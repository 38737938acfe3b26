"""The steps of a ray from one interface to the next, common to all loops.

The loop over blocks of rays, the tree of one ray and the GPU thread store rays differently, but use the same three
functions at an interface: `meet` advances a ray to it, `leave` computes the transmitted and reflected light, and `part`
returns one of the two as a ray.
"""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.nearest import Hit, Ray, normal_at, other_side
from solen.trace.kernel.rows import TREATED, Floats, Precision, typed
from solen.trace.kernel.surface import (
    COUNT,
    ROULETTE,
    Event,
    Incidence,
    SplitRay,
    at_surface,
    end_fate,
    random_part,
    uniform_of,
)
from solen.trace.kernel.treated import FREE_PATH, PHASE, acting, at_treated
from solen.trace.result import ABSORBED, ESCAPED, TRUNCATED
from solen.trace.tables import Tables


class Rules(NamedTuple):
    """Rules for following rays."""

    splitting: int
    min_weight: float
    max_hits: int
    seed: int
    first: int
    """number of the first ray"""
    step: int
    """difference between the numbers of successive rays"""
    turbid: bool
    """whether any medium scatters"""


class Load(NamedTuple):
    """State of a ray other than its geometry: powers in s and p, minimum power that is followed, medium and history."""

    s: float
    p: float
    min_power: float
    optical: float
    """optical path length so far, mm"""
    region: int
    """index of the medium; −1 if not yet determined"""
    colour: int
    number: int
    hits: int


class Arrival(NamedTuple):
    """A ray at the interface ahead of it."""

    x: float
    z: float
    nx: float
    nz: float
    """z-component of the left normal of the curve"""
    medium: int
    """region on the side from which the ray comes"""
    beyond: int
    undefined: bool
    """whether the ray was in another region"""
    corner: bool
    """whether the ray starts at a corner and meets only the end of the other curve"""
    loss: float
    """absorption coefficient of the medium, per mm"""
    kept: float
    """fraction of the power that remains"""
    fate: int


@compiled
def event_of(rules: Rules, load: Load) -> Event:
    """Return the event that identifies the random numbers at the next hit of a ray."""
    return Event(rules.seed, rules.first + rules.step * load.number, load.hits)


@compiled
def meet(k: Precision, tables: Tables, rules: Rules, ray: Ray, hit: Hit, load: Load) -> Arrival:
    """Return a ray advanced to a curve, before the surface acts on it."""
    c, length = hit.curve, hit.distance
    px, pz = ray.x + length * ray.dx, ray.z + length * ray.dz
    nx, nz = normal_at(k, tables.kind[c], tables.shape, c, px, pz, hit.u)
    from_right = ray.dx * nx + ray.dz * nz > 0.0
    medium, beyond = tables.left[c], tables.right[c]
    if from_right:
        medium, beyond = beyond, medium
    undefined = load.region != -1 and load.region != medium
    corner = length <= k.corner and ray.last >= 0 and (undefined or other_side(k, tables, ray, c))
    loss = tables.absorption[load.colour, medium] if rules.splitting != COUNT and not undefined else k.zero
    kept = math.exp(-loss * length) if loss > 0.0 else k.one
    exhausted = undefined or load.hits + 1 >= rules.max_hits or kept * (load.s + load.p) < load.min_power
    behaviour = tables.behaviour[c]
    if behaviour >= TREATED:
        behaviour = acting(tables, c, load.colour)
    fate = TRUNCATED if undefined else end_fate(behaviour, from_right, exhausted)
    return Arrival(px, pz, nx, nz, medium, beyond, undefined, corner, loss, kept, fate)


@compiled
def escape(k: Precision, tables: Tables, rules: Rules, region: int, colour: int) -> tuple[float, int]:
    """Return the absorption coefficient and the fate of a ray that meets no further interface."""
    loss = tables.absorption[colour, region] if rules.splitting != COUNT and region >= 0 else k.zero
    return loss, ABSORBED if loss > 0.0 else ESCAPED


@compiled
def past_corner(k: Precision, ray: Ray, hit: Hit) -> Ray:
    """Return a ray at a corner moved past the end of the other curve, by a step that grows with rounding errors."""
    step = k.corner + k.rounding * (abs(ray.x) + abs(ray.z))
    return Ray(ray.x + step * ray.dx, ray.z + step * ray.dz, ray.dx, ray.dz, hit.curve, hit.u)


@compiled
def attenuated(load: Load, kept: float, optical: float) -> Load:
    """Return a load with a fraction of its power, after an optical path."""
    return Load(
        kept * load.s,
        kept * load.p,
        load.min_power,
        load.optical + optical,
        load.region,
        load.colour,
        load.number,
        load.hits,
    )


class Departure(NamedTuple):
    """Light that leaves an interface."""

    parts: SplitRay
    absorbed: float
    """power absorbed by the surface"""
    truncated: float
    """power of the parts that are too weak to be followed"""
    both: bool
    """whether both parts are followed"""
    ends: bool
    """whether neither part is followed"""
    reflected_first: bool
    """whether the part to be followed first, the weaker of two, is the reflected one"""


@compiled
def leave(
    k: Precision,
    tables: Tables,
    rules: Rules,
    treatments: Floats | None,
    ray: Ray,
    c: int,
    arrival: Arrival,
    load: Load,
) -> Departure:
    """Apply the surface of curve ``c`` to a ray, with the powers that reach the surface.

    ``treatments`` are those of the tables, or None if there are none; the code for treatments is then not compiled.
    """
    index = tables.refractive_index[load.colour]
    n1, n2, absorbed = index[arrival.medium], index[arrival.beyond], k.zero
    incidence = Incidence(arrival.x, arrival.z, ray.dx, ray.dz, arrival.nx, arrival.nz, n1, n2, load.s, load.p)
    if treatments is None or tables.behaviour[c] < TREATED:
        parts = at_surface(k, tables.behaviour[c], rules.splitting, incidence)
    else:
        parts = at_treated(k, tables, rules.splitting, c, load.colour, event_of(rules, load), incidence)
        absorbed = max((load.s - parts.on_s - parts.back_s) + (load.p - parts.on_p - parts.back_p), k.zero)
    on, back = parts.on_s + parts.on_p, parts.back_s + parts.back_p
    if rules.splitting == ROULETTE and on > 0.0 and back > 0.0:
        parts, on, back = random_part(k, event_of(rules, load), load.s + load.p - absorbed, parts)
    truncated = (on if on < load.min_power else k.zero) + (back if back < load.min_power else k.zero)
    both = on >= load.min_power and back >= load.min_power
    ends = not (on >= load.min_power or back >= load.min_power)
    reflected_first = back <= on if both else back >= load.min_power
    return Departure(parts, absorbed, truncated, both, ends, reflected_first)


@compiled
def part(hit: Hit, arrival: Arrival, parts: SplitRay, load: Load, back: bool) -> tuple[Ray, Load]:
    """Return the reflected or the transmitted part of a ray at an interface."""
    if back:
        ray = Ray(arrival.x, arrival.z, parts.back_x, parts.back_z, hit.curve, hit.u)
        s, p, region = parts.back_s, parts.back_p, arrival.medium
    else:
        ray = Ray(arrival.x, arrival.z, parts.on_x, parts.on_z, hit.curve, hit.u)
        s, p, region = parts.on_s, parts.on_p, arrival.beyond
    return ray, Load(s, p, load.min_power, load.optical, region, load.colour, load.number, load.hits + 1)


@compiled
def free_path(k: Precision, tables: Tables, rules: Rules, region: int, load: Load) -> float:
    """Free path in mm of a ray before it is scattered in a medium, sampled from an exponential distribution."""
    scattering = tables.scattering[load.colour, region]
    if not scattering > 0.0:
        return k.none
    random = uniform_of(event_of(rules, load), FREE_PATH)
    path: float = typed(k.zero, -math.log(1.0 - random)) / scattering
    return path


@compiled
def phase_turn(k: Precision, tables: Tables, rules: Rules, region: int, load: Load) -> float:
    """Tangent of half the scattering angle in the plane, from the wrapped Cauchy distribution."""
    random = uniform_of(event_of(rules, load), PHASE)
    g = tables.anisotropy[load.colour, region]
    half_tangent: float = (k.one - g) / (k.one + g) * typed(k.zero, math.tan(math.pi * (random - 0.5)))
    return half_tangent


@compiled
def rotated(k: Precision, half_tangent: float, dx: float, dz: float) -> tuple[float, float]:
    """Direction rotated by twice the angle that has this tangent."""
    scale = k.one / (k.one + half_tangent * half_tangent)
    cos, sin = (k.one - half_tangent * half_tangent) * scale, (half_tangent + half_tangent) * scale
    return cos * dx - sin * dz, sin * dx + cos * dz
