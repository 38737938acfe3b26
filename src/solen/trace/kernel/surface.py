"""The effect of an interface on a ray.

A behaviour either ends the ray (`end_fate`) or continues it: `at_surface` returns the transmitted and reflected
directions and powers. Further behaviours are added here, for all loops over rays.
"""

import math
from typing import NamedTuple

import numpy as np

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.rows import ABSORBING, MIRROR, RECEIVER, Precision
from solen.trace.result import ABSORBED, DETECTED, GOES_ON, TRUNCATED

COUNT, BRANCHES, ROULETTE = range(3)
"""Treatment of partial reflection: transmit all light, follow both parts, or follow one part chosen at random."""
SPLITTING = {"count": COUNT, "power": BRANCHES, "roulette": ROULETTE}
"""Treatment of partial reflection by trace mode."""


class Event(NamedTuple):
    """A hit of a ray, which identifies its random numbers."""

    seed: int
    ray: int
    """number of the ray"""
    hit: int
    """number of previous hits"""


class Incidence(NamedTuple):
    """A ray at a surface; the normal may point to either side."""

    x: float
    z: float
    dx: float
    dz: float
    nx: float
    nz: float
    n1: float
    """refractive index on the side of the ray"""
    n2: float
    s: float
    p: float


class SplitRay(NamedTuple):
    """The transmitted and the reflected part of a ray at a surface."""

    on_x: float
    """x-component of the transmitted direction"""
    on_z: float
    back_x: float
    back_z: float
    on_s: float
    """transmitted power in s"""
    on_p: float
    back_s: float
    back_p: float


@compiled
def end_fate(behaviour: int, from_right: bool, worn_out: bool) -> int:
    """Fate of a ray at an interface with this behaviour; GOES_ON if the ray continues."""
    if behaviour == RECEIVER and not from_right:
        return DETECTED
    if behaviour in (RECEIVER, ABSORBING):
        return ABSORBED
    return TRUNCATED if worn_out else GOES_ON


@compiled
def fresnel(cos_in: float, cos_out: float, n1: float, n2: float) -> tuple[float, float]:
    """Reflected power fractions in s and p."""
    s = (n1 * cos_in - n2 * cos_out) / (n1 * cos_in + n2 * cos_out)
    p = (n2 * cos_in - n1 * cos_out) / (n2 * cos_in + n1 * cos_out)
    return s * s, p * p


class Deflection(NamedTuple):
    """Transmitted and reflected directions at a surface, and the reflected power fractions for s and p."""

    on_x: float
    on_z: float
    back_x: float
    back_z: float
    reflectance_s: float
    reflectance_p: float


@compiled
def deflection(
    k: Precision,
    behaviour: int,
    splitting: int,
    dx: float,
    dz: float,
    nx: float,
    nz: float,
    n1: float,
    n2: float,
) -> Deflection:
    """Return the directions of a ray after a smooth, clean and bare surface.

    The normal may point to either side. In counting mode the entire ray is transmitted unless it is totally reflected.
    """
    cos = -(dx * nx + dz * nz)
    cos_in, nx, nz = abs(cos), (-nx if cos < 0.0 else nx), (-nz if cos < 0.0 else nz)
    bx, bz = dx + (cos_in + cos_in) * nx, dz + (cos_in + cos_in) * nz
    correction = k.one + k.half * (
        k.one - (bx * bx + bz * bz)
    )  # otherwise the length drifts over thousands of reflections
    cos2 = (n2 - n1) * (n2 + n1) + (n1 * cos_in) * (n1 * cos_in)  # times n2²; also exact if the indices are equal
    total = (behaviour == MIRROR) | (cos2 <= 0.0)
    ratio, cos_out = n1 / n2, math.sqrt(max(cos2, k.zero)) / n2
    turn = ratio * cos_in - cos_out
    tx, tz = ratio * dx + turn * nx, ratio * dz + turn * nz
    scale = k.zero if total else k.one / math.sqrt(tx * tx + tz * tz)
    reflectance_s, reflectance_p = (k.zero, k.zero) if splitting == COUNT else fresnel(cos_in, cos_out, n1, n2)
    reflectance_s, reflectance_p = (k.one if total else reflectance_s), (k.one if total else reflectance_p)
    return Deflection(scale * tx, scale * tz, correction * bx, correction * bz, reflectance_s, reflectance_p)


@compiled
def at_surface(k: Precision, behaviour: int, splitting: int, ray: Incidence) -> SplitRay:
    """Return both parts of a ray at a smooth, clean and bare surface; see `deflection`."""
    _, _, dx, dz, nx, nz, n1, n2, s, p = ray
    deflected = deflection(k, behaviour, splitting, dx, dz, nx, nz, n1, n2)
    back_s, back_p = s * deflected.reflectance_s, p * deflected.reflectance_p
    return SplitRay(
        deflected.on_x, deflected.on_z, deflected.back_x, deflected.back_z, s - back_s, p - back_p, back_s, back_p
    )


@compiled
def random_part(k: Precision, event: Event, power: float, d: SplitRay) -> tuple[SplitRay, float, float]:
    """Choose one of two parts at random, to carry all the power; also return the power of each part."""
    on, back = d.on_s + d.on_p, d.back_s + d.back_p
    if uniform(event.seed, event.ray, event.hit) * power < back:
        back_s, back_p = d.back_s * power / back, d.back_p * power / back
        return SplitRay(d.on_x, d.on_z, d.back_x, d.back_z, d.on_s, d.on_p, back_s, back_p), k.zero, power
    on_s, on_p = d.on_s * power / on, d.on_p * power / on
    return SplitRay(d.on_x, d.on_z, d.back_x, d.back_z, on_s, on_p, d.back_s, d.back_p), power, k.zero


@compiled
def uniform(seed: int, ray: int, hit: int) -> float:
    """Random number in [0, 1) for a seed, a ray and a hit; identical on every machine and thread (splitmix64)."""
    number = scrambled(np.uint64(seed))  # otherwise another seed would only permute the numbers among the rays
    for part in (ray, hit):
        number = scrambled(number ^ np.uint64(part))
    return float(number >> np.uint64(11)) * 2.0**-53


@compiled
def uniform_of(event: Event, draw: int) -> float:
    """As `uniform`, for several numbers at one hit; ``draw``, from 1 on, is the index of the number."""
    number = scrambled(np.uint64(event.seed))
    for part in (event.ray, event.hit, draw):
        number = scrambled(number ^ np.uint64(part))
    return float(number >> np.uint64(11)) * 2.0**-53


@compiled
def scrambled(number: np.uint64) -> np.uint64:
    """Scramble the bits of a number (Steele, Lea & Flood, 2014)."""
    number += np.uint64(0x9E3779B97F4A7C15)
    number = (number ^ (number >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    number = (number ^ (number >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return number ^ (number >> np.uint64(31))
