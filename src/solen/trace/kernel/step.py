"""The steps of a ray from one interface to the next, common to all loops.

The loop over blocks of rays, the tree of one ray and the GPU thread store rays differently, but each takes them through
an interface with the same three functions: `meet` advances a ray to the interface, `leave` computes the transmitted and
reflected light, and `part` returns the ray for one of these.
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
    """Ray state other than geometry: powers in s and p, the minimum power that is followed, medium and history."""

    s: float
    p: float
    least: float
    optical: float
    """optical path length so far, mm"""
    region: int
    """index of the medium; −1 if not yet determined"""
    colour: int
    number: int
    hits: int


class Meeting(NamedTuple):
    """A ray at the interface ahead of it."""

    x: float
    z: float
    nx: float
    nz: float
    """z-component of the left normal of the curve"""
    here: int
    """region on the side that the ray comes from"""
    there: int
    undefined: bool
    """whether the ray was in another region"""
    corner: bool
    """whether the ray starts in a corner and meets only the end of the other curve"""
    loss: float
    """absorption coefficient on the way, per mm"""
    kept: float
    """fraction of the power that remains"""
    fate: int


@compiled
def event_of(rules: Rules, load: Load) -> Event:
    """Return the event for random draws at the next hit of a ray."""
    return Event(rules.seed, rules.first + rules.step * load.number, load.hits)


@compiled
def meet(k: Precision, tables: Tables, rules: Rules, ray: Ray, hit: Hit, load: Load) -> Meeting:
    """Advance a ray to a curve, before the surface itself acts on it."""
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
    """Return the absorption coefficient and the fate of a ray that meets no further interface."""
    loss = tables.absorption[colour, region] if rules.splitting != COUNT and region >= 0 else k.zero
    return loss, ABSORBED if loss > 0.0 else ESCAPED


@compiled
def carried_on(k: Precision, ray: Ray, hit: Hit) -> Ray:
    """Move a ray in a corner past the end of the curve that it would meet; the step grows with rounding errors."""
    step = k.corner + k.rounding * (abs(ray.x) + abs(ray.z))
    return Ray(ray.x + step * ray.dx, ray.z + step * ray.dz, ray.dx, ray.dz, hit.curve, hit.place)


@compiled
def weakened(load: Load, kept: float, way: float) -> Load:
    """Return a load with a fraction of its power after an optical path."""
    return Load(
        kept * load.s, kept * load.p, load.least, load.optical + way, load.region, load.colour, load.number, load.hits
    )


class Leaving(NamedTuple):
    """Light that leaves an interface."""

    parts: Divided
    lost: float
    """power absorbed by the surface"""
    cut: float
    """power of the parts that are too weak to be followed"""
    both: bool
    """whether both parts are followed"""
    ends: bool
    """whether neither part is followed"""
    goes_back: bool
    """whether the part to be followed first, the weaker of two, is the reflected one"""


@compiled
def leave(
    k: Precision, tables: Tables, rules: Rules, treatments: Floats | None, ray: Ray, c: int, met: Meeting, load: Load
) -> Leaving:
    """Apply the surface of curve ``c`` to a ray, with the powers that reach the surface.

    ``treatments`` are those of the tables, or None if there are none; the code for treatments is then not compiled.
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
    """Return the reflected or the transmitted part of a ray at an interface."""
    if back:
        ray = Ray(met.x, met.z, parts.back_x, parts.back_z, hit.curve, hit.place)
        s, p, region = parts.back_s, parts.back_p, met.here
    else:
        ray = Ray(met.x, met.z, parts.on_x, parts.on_z, hit.curve, hit.place)
        s, p, region = parts.on_s, parts.on_p, met.there
    return ray, Load(s, p, load.least, load.optical, region, load.colour, load.number, load.hits + 1)


@compiled
def free_path(k: Precision, tables: Tables, rules: Rules, region: int, load: Load) -> float:
    """Free path of a ray in a medium before scattering, in mm, drawn from the exponential distribution."""
    scattering = tables.scattering[load.colour, region]
    if not scattering > 0.0:
        return k.none
    share = chance_of(event_of(rules, load), FREE_PATH)
    path: float = as_in(k.zero, -math.log(1.0 - share)) / scattering
    return path


@compiled
def phase_turn(k: Precision, tables: Tables, rules: Rules, region: int, load: Load) -> float:
    """Tangent of half the scattering angle in the plane, from the wrapped Cauchy distribution."""
    share = chance_of(event_of(rules, load), PHASE)
    g = tables.anisotropy[load.colour, region]
    half: float = (k.one - g) / (k.one + g) * as_in(k.zero, math.tan(math.pi * (share - 0.5)))
    return half


@compiled
def turned(k: Precision, half: float, dx: float, dz: float) -> tuple[float, float]:
    """Direction rotated by twice the angle that has this tangent."""
    scale = k.one / (k.one + half * half)
    cos, sin = (k.one - half * half) * scale, (half + half) * scale
    return cos * dx - sin * dz, sin * dx + cos * dz
