"""What an interface makes of a ray that meets it: the one place where further behaviours plug in.

A behaviour either ends the ray (`end_fate`) or sends it on: `at_surface` returns the directions through and back and
the powers that go there, whatever the loop over rays does with them.
"""

import math

import numpy as np

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.rows import ABSORBING, MIRROR, RECEIVER, Precision
from solen.trace.result import ABSORBED, DETECTED, GOES_ON, TRUNCATED

COUNT, BRANCHES, ROULETTE = range(3)
"""Ways to treat a partial reflection: all of the ray goes through; both parts are followed; one of them by chance."""
SPLITTING = {"count": COUNT, "power": BRANCHES, "roulette": ROULETTE}
"""By the mode of a trace."""


@compiled
def end_fate(behaviour: int, from_right: bool, worn_out: bool) -> int:
    """Fate of a ray at an interface of this behaviour; GOES_ON where it leaves it again."""
    if behaviour == RECEIVER and not from_right:
        return DETECTED
    if behaviour in (RECEIVER, ABSORBING):
        return ABSORBED
    return TRUNCATED if worn_out else GOES_ON


@compiled
def fresnel(cos_in: float, cos_out: float, n1: float, n2: float) -> tuple[float, float]:
    """Reflected fractions of power in s and p."""
    s = (n1 * cos_in - n2 * cos_out) / (n1 * cos_in + n2 * cos_out)
    p = (n2 * cos_in - n1 * cos_out) / (n2 * cos_in + n1 * cos_out)
    return s * s, p * p


@compiled
def at_surface(
    k: Precision,
    behaviour: int,
    splitting: int,
    dx: float,
    dz: float,
    nx: float,
    nz: float,
    n1: float,
    n2: float,
    s: float,
    p: float,
) -> tuple[float, float, float, float, float, float]:
    """Direction through, direction back, and the powers in s and p that go back.

    The normal is either of the two. Counting sends all of a ray through unless it is reflected totally.
    """
    cos_in = -(dx * nx + dz * nz)
    if cos_in < 0.0:
        cos_in, nx, nz = -cos_in, -nx, -nz
    bx, bz = dx + (cos_in + cos_in) * nx, dz + (cos_in + cos_in) * nz
    mend = k.one + k.half * (k.one - (bx * bx + bz * bz))  # its length drifts over thousands of reflections
    bx, bz = mend * bx, mend * bz
    cos2 = (n2 - n1) * (n2 + n1) + (n1 * cos_in) * (n1 * cos_in)  # times n2²; exact also where the indices match
    if behaviour == MIRROR or cos2 <= 0.0:
        return k.zero, k.zero, bx, bz, s, p
    ratio, cos_out = n1 / n2, math.sqrt(cos2) / n2
    bend = ratio * cos_in - cos_out
    tx, tz = ratio * dx + bend * nx, ratio * dz + bend * nz
    scale = k.one / math.sqrt(tx * tx + tz * tz)
    if splitting == COUNT:
        return scale * tx, scale * tz, bx, bz, k.zero, k.zero
    back_s, back_p = fresnel(cos_in, cos_out, n1, n2)
    return scale * tx, scale * tz, bx, bz, s * back_s, p * back_p


@compiled
def drawn(
    k: Precision,
    seed: int,
    ray: int,
    hit: int,
    power: float,
    on_s: float,
    on_p: float,
    back_s: float,
    back_p: float,
) -> tuple[float, float, float, float, float, float]:
    """Powers in s and p that go on and that go back after a draw gives all to one of both, and their two sums."""
    on, back = on_s + on_p, back_s + back_p
    if chance(seed, ray, hit) * power < back:
        return on_s, on_p, back_s * power / back, back_p * power / back, k.zero, power
    return on_s * power / on, on_p * power / on, back_s, back_p, power, k.zero


@compiled
def chance(seed: int, ray: int, hit: int) -> float:
    """Number in [0, 1) that belongs to a seed, a ray and a hit: the same on every machine and thread (splitmix64)."""
    number = scrambled(np.uint64(seed))  # else another seed would only deal the same numbers to other rays
    for part in (ray, hit):
        number = scrambled(number ^ np.uint64(part))
    return float(number >> np.uint64(11)) * 2.0**-53


@compiled
def chance_of(seed: int, ray: int, hit: int, draw: int) -> float:
    """As `chance`, for the several numbers that one hit may need: the n-th is that of ``draw`` n, from 1 on."""
    number = scrambled(np.uint64(seed))
    for part in (ray, hit, draw):
        number = scrambled(number ^ np.uint64(part))
    return float(number >> np.uint64(11)) * 2.0**-53


@compiled
def scrambled(number: np.uint64) -> np.uint64:
    """Scramble the bits of a number (Steele, Lea & Flood, 2014)."""
    number += np.uint64(0x9E3779B97F4A7C15)
    number = (number ^ (number >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    number = (number ^ (number >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return number ^ (number >> np.uint64(31))
