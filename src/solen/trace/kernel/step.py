"""What happens to a ray from one interface to the next, whoever follows it.

The loop over blocks of rays, the tree of one ray and the thread of a graphics card carry rays differently, but each
takes them through an interface by `meet`, which brings a ray to it, and `leave`, which says what goes on and what back.
"""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.nearest import normal_at, other_side
from solen.trace.kernel.rows import Precision
from solen.trace.kernel.surface import COUNT, ROULETTE, at_surface, drawn, end_fate
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
    fate = TRUNCATED if undefined else end_fate(tables.behaviour[c], from_right, worn_out)
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
    c: int,
    colour: int,
    here: int,
    there: int,
    number: int,
    hits: int,
    dx: float,
    dz: float,
    nx: float,
    nz: float,
    s: float,
    p: float,
    least: float,
) -> Leaving:
    """What the surface of curve ``c`` makes of ray ``number``, which has met ``hits`` interfaces before this one."""
    on_x, on_z, back_x, back_z, back_s, back_p = at_surface(
        k, tables.behaviour[c], rules.splitting, dx, dz, nx, nz,
        tables.refractive_index[colour, here], tables.refractive_index[colour, there], s, p,
    )  # fmt: skip
    on_s, on_p = s - back_s, p - back_p
    on, back = on_s + on_p, back_s + back_p
    if rules.splitting == ROULETTE and on > 0.0 and back > 0.0:
        ray = rules.first + rules.step * number
        on_s, on_p, back_s, back_p, on, back = drawn(k, rules.seed, ray, hits, s + p, on_s, on_p, back_s, back_p)
    cut = (on if on < least else k.zero) + (back if back < least else k.zero)
    both = on >= least and back >= least
    ends = not (on >= least or back >= least)
    goes_back = back <= on if both else back >= least
    return Leaving(on_x, on_z, on_s, on_p, back_x, back_z, back_s, back_p, cut, both, ends, goes_back)
