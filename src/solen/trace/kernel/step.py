"""What happens to a ray from one interface to the next, whoever follows it.

The loop over blocks of rays, the tree of one ray and the thread of a graphics card carry rays differently, but each
takes them through an interface by `meet`, which brings a ray to it, and `leave`, which says what goes on and what back.
"""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.nearest import normal_at, other_side
from solen.trace.kernel.rows import TREATED, Floats, Precision, as_in
from solen.trace.kernel.surface import COUNT, ROULETTE, at_surface, chance_of, drawn, end_fate
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
def meet(
    k: Precision,
    tables: Tables,
    rules: Rules,
    c: int,
    length: float,
    place: float,
    x: float,
    z: float,
    dx: float,
    dz: float,
    last: int,
    at: float,
    region: int,
    colour: int,
    hits: int,
    power: float,
    least: float,
) -> Meeting:
    """What becomes of a ray at curve ``c``, a ``length`` ahead, before the surface itself acts on it."""
    px, pz = x + length * dx, z + length * dz
    nx, nz = normal_at(k, tables.kind[c], tables.shape, c, px, pz, place)
    from_right = dx * nx + dz * nz > 0.0
    here, there = tables.left[c], tables.right[c]
    if from_right:
        here, there = there, here
    undefined = region != -1 and region != here
    corner = length <= k.corner and last >= 0 and (undefined or other_side(k, tables, last, at, c, x, z, dx, dz))
    loss = tables.absorption[colour, here] if rules.splitting != COUNT and not undefined else k.zero
    kept = math.exp(-loss * length) if loss > 0.0 else k.one
    worn_out = undefined or hits + 1 >= rules.max_hits or kept * power < least
    behaviour = tables.behaviour[c]
    if behaviour >= TREATED:
        behaviour = acting(tables, c, colour)
    fate = TRUNCATED if undefined else end_fate(behaviour, from_right, worn_out)
    return Meeting(px, pz, nx, nz, here, there, undefined, corner, loss, kept, fate)


@compiled
def escape(k: Precision, tables: Tables, rules: Rules, region: int, colour: int) -> tuple[float, int]:
    """Absorption per mm where a ray is that meets nothing more, and its fate."""
    loss = tables.absorption[colour, region] if rules.splitting != COUNT and region >= 0 else k.zero
    return loss, ABSORBED if loss > 0.0 else ESCAPED


@compiled
def corner_step(k: Precision, x: float, z: float) -> float:
    """How far a ray in a corner is carried on, mm; far out less would be lost in rounding."""
    return k.corner + k.rounding * (abs(x) + abs(z))


class Leaving(NamedTuple):
    """What leaves an interface: a part that goes on through it, and one that goes back."""

    on_x: float
    """direction"""
    on_z: float
    on_s: float
    on_p: float
    back_x: float
    back_z: float
    back_s: float
    back_p: float
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
    k: Precision,
    tables: Tables,
    rules: Rules,
    treatments: Floats | None,
    c: int,
    colour: int,
    here: int,
    there: int,
    number: int,
    hits: int,
    x: float,
    z: float,
    dx: float,
    dz: float,
    nx: float,
    nz: float,
    s: float,
    p: float,
    least: float,
) -> Leaving:
    """What the surface of curve ``c`` makes of ray ``number``, which has met ``hits`` interfaces before this one.

    ``treatments`` are those of the tables, or None where there are none: then what they need is not even compiled.
    """
    n1, n2, lost = tables.refractive_index[colour, here], tables.refractive_index[colour, there], k.zero
    if treatments is None or tables.behaviour[c] < TREATED:
        on_x, on_z, back_x, back_z, back_s, back_p = at_surface(
            k, tables.behaviour[c], rules.splitting, dx, dz, nx, nz, n1, n2, s, p
        )
        on_s, on_p = s - back_s, p - back_p
    else:
        ray = rules.first + rules.step * number
        on_x, on_z, back_x, back_z, on_s, on_p, back_s, back_p = at_treated(
            k, tables, rules.splitting, rules.seed, c, colour, ray, hits, x, z, dx, dz, nx, nz, n1, n2, s, p
        )
        lost = max((s - on_s - back_s) + (p - on_p - back_p), k.zero)
    on, back = on_s + on_p, back_s + back_p
    if rules.splitting == ROULETTE and on > 0.0 and back > 0.0:
        ray, power = rules.first + rules.step * number, s + p - lost
        on_s, on_p, back_s, back_p, on, back = drawn(k, rules.seed, ray, hits, power, on_s, on_p, back_s, back_p)
    cut = (on if on < least else k.zero) + (back if back < least else k.zero)
    both = on >= least and back >= least
    ends = not (on >= least or back >= least)
    goes_back = back <= on if both else back >= least
    return Leaving(on_x, on_z, on_s, on_p, back_x, back_z, back_s, back_p, lost, cut, both, ends, goes_back)


@compiled
def free_path(k: Precision, tables: Tables, rules: Rules, region: int, colour: int, number: int, hits: int) -> float:
    """How far a ray gets in a medium before it is scattered, mm: drawn from the exponential distribution."""
    scattering = tables.scattering[colour, region]
    if not scattering > 0.0:
        return k.none
    share = chance_of(rules.seed, rules.first + rules.step * number, hits, FREE_PATH)
    path: float = as_in(k.zero, -math.log(1.0 - share)) / scattering
    return path


@compiled
def phase_turn(k: Precision, tables: Tables, rules: Rules, region: int, colour: int, number: int, hits: int) -> float:
    """Tangent of half the angle by which scattering turns a ray in the plane: the wrapped Cauchy distribution."""
    share = chance_of(rules.seed, rules.first + rules.step * number, hits, PHASE)
    g = tables.anisotropy[colour, region]
    half: float = (k.one - g) / (k.one + g) * as_in(k.zero, math.tan(math.pi * (share - 0.5)))
    return half


@compiled
def turned(k: Precision, half: float, dx: float, dz: float) -> tuple[float, float]:
    """Direction turned by the angle of whose half this is the tangent."""
    scale = k.one / (k.one + half * half)
    cos, sin = (k.one - half * half) * scale, (half + half) * scale
    return cos * dx - sin * dz, sin * dx + cos * dz
