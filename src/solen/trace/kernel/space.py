"""Rays in space: vectors, polarisation, and the effect of a surface.

A ray carries its coherency matrix [[i1, c], [c*, i2]] in the basis (e, d × e), where e is a unit vector perpendicular
to its direction d, and c = cr + i·ci. At a surface the basis is rotated so that e lies along s = d × N; Fresnel's
amplitudes then apply to the two fields separately (Born & Wolf, sections 1.5 and 10.9), including the phases of total
reflection. Fields have the time dependence exp(+iωt).
"""

import math
from typing import NamedTuple

from solen.trace.kernel.compiled import compiled
from solen.trace.kernel.treated import Amplitudes

PARALLEL = 1e-12
"""Sine of the angle of incidence below which any basis can be used."""


class Vector(NamedTuple):
    """x, y, z."""

    x: float
    y: float
    z: float


class Coherency(NamedTuple):
    """Powers of the fields along e and perpendicular to e, and the correlation of the two fields."""

    i1: float
    i2: float
    cr: float
    ci: float


class Beam(NamedTuple):
    """Light on its way: direction, the basis vector e, and its coherency."""

    d: Vector
    e: Vector
    light: Coherency


class Border(NamedTuple):
    """A surface seen from the incident light: the normal is on the side of the light, which comes from the index n1."""

    n: Vector
    n1: float
    n2: float
    from_right: bool
    """whether light comes from the right of the curve in projection; not used for bare surfaces"""


class Parts(NamedTuple):
    """The transmitted and the reflected light at a surface."""

    on: Beam
    back: Beam


@compiled
def scalar(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@compiled
def vector(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@compiled
def unit_of(a: Vector) -> Vector:
    """Vector scaled to length 1."""
    scale = 1.0 / math.sqrt(scalar(a, a))
    return Vector(scale * a.x, scale * a.y, scale * a.z)


@compiled
def upright(d: Vector) -> Vector:
    """Unit vector perpendicular to d in the plane of d and the y-axis; x for a ray along y."""
    flat = d.x * d.x + d.z * d.z
    if flat < PARALLEL * PARALLEL:
        return Vector(1.0, 0.0, 0.0)
    return unit_of(Vector(-d.y * d.x, flat, -d.y * d.z))


@compiled
def turned_basis(light: Coherency, cos: float, sin: float) -> Coherency:
    """Coherency in the basis rotated by an angle from e towards d × e."""
    both, cross = 2.0 * cos * sin * light.cr, cos * sin * (light.i2 - light.i1)
    return Coherency(
        cos * cos * light.i1 + sin * sin * light.i2 + both,
        sin * sin * light.i1 + cos * cos * light.i2 - both,
        cross + (cos * cos - sin * sin) * light.cr,
        light.ci,
    )


@compiled
def scaled(light: Coherency, by: float) -> Coherency:
    """Coherency with the power multiplied by a factor."""
    return Coherency(by * light.i1, by * light.i2, by * light.cr, by * light.ci)


@compiled
def power_of(light: Coherency) -> float:
    """Total power of both fields."""
    return light.i1 + light.i2


@compiled
def times(beam: Beam, by: float) -> Beam:
    """Light with the power multiplied by a factor."""
    return Beam(beam.d, beam.e, scaled(beam.light, by))


@compiled
def unpolarised(light: Coherency) -> Coherency:
    """The same power without polarisation."""
    half = 0.5 * (light.i1 + light.i2)
    return Coherency(half, half, 0.0, 0.0)


@compiled
def bare(n1: float, n2: float, axial: float) -> Amplitudes:
    """Return Fresnel's coefficients; ``axial`` is n1 times the cosine of the angle of incidence."""
    square = (n2 - n1) * (n2 + n1) + axial * axial
    if square <= 0.0:
        # total reflection: both phases, from the square root of their product
        behind = math.sqrt(-square)
        real, imaginary = n2 * n2 * axial * axial - n1 * n1 * square, (n2 - n1) * (n2 + n1) * axial * behind
        whole = real * real + imaginary * imaginary
        cr, ci = (real - imaginary) * (real + imaginary) / whole, 2.0 * real * imaginary / whole
        return Amplitudes(1.0, 1.0, cr, ci, 0.0, 0.0, 0.0, 0.0)
    behind_real = math.sqrt(square)
    rs = (axial - behind_real) / (axial + behind_real)
    rp = (n2 * n2 * axial - n1 * n1 * behind_real) / (n2 * n2 * axial + n1 * n1 * behind_real)
    on_s, on_p = 1.0 - rs * rs, 1.0 - rp * rp
    return Amplitudes(rs * rs, rp * rp, rs * rp, 0.0, on_s, on_p, math.sqrt(max(on_s * on_p, 0.0)), 0.0)


@compiled
def passed(amount_s: float, amount_p: float, cr: float, ci: float, light: Coherency) -> Coherency:
    """Coherency with both fields attenuated and their product multiplied by a complex number."""
    return Coherency(
        amount_s * light.i1, amount_p * light.i2, cr * light.cr - ci * light.ci, cr * light.ci + ci * light.cr
    )


@compiled
def in_plane_of_incidence(d: Vector, e: Vector, n: Vector, light: Coherency) -> tuple[Vector, Coherency]:
    """The unit vector s perpendicular to the plane of incidence, and the coherency in its basis."""
    across = vector(d, n)
    size = math.sqrt(scalar(across, across))
    if size < PARALLEL:
        return e, light
    s = Vector(across.x / size, across.y / size, across.z / size)
    return s, turned_basis(light, scalar(s, e), scalar(s, vector(d, e)))


@compiled
def mirrored(d: Vector, n: Vector, cos: float) -> Vector:
    """Direction after a reflection, normalised to avoid drift over many reflections."""
    twice = cos + cos
    x, y, z = d.x + twice * n.x, d.y + twice * n.y, d.z + twice * n.z
    mend = 1.0 + 0.5 * (1.0 - (x * x + y * y + z * z))
    return Vector(mend * x, mend * y, mend * z)


@compiled
def bent(d: Vector, n: Vector, cos: float, n1: float, n2: float) -> Vector:
    """Direction behind a surface by Snell's law; undefined for total reflection."""
    square = (n2 - n1) * (n2 + n1) + (n1 * cos) * (n1 * cos)
    if square <= 0.0:
        return d
    bend = (n1 * cos - math.sqrt(square)) / n2
    ratio = n1 / n2
    return unit_of(Vector(ratio * d.x + bend * n.x, ratio * d.y + bend * n.y, ratio * d.z + bend * n.z))


@compiled
def divided(beam: Beam, border: Border, a: Amplitudes) -> Parts:
    """Return both parts of a ray at a surface, in the basis of s."""
    d, n = beam.d, border.n
    cos = -scalar(d, n)
    s, own = in_plane_of_incidence(d, beam.e, n, beam.light)
    return Parts(
        Beam(bent(d, n, cos, border.n1, border.n2), s, passed(a.on_s, a.on_p, a.on_cr, a.on_ci, own)),
        Beam(mirrored(d, n, cos), s, passed(a.back_s, a.back_p, a.back_cr, a.back_ci, own)),
    )


@compiled
def smooth_parts(beam: Beam, border: Border) -> Parts:
    """Return both parts at a smooth, clean and bare surface."""
    return divided(beam, border, bare(border.n1, border.n2, -border.n1 * scalar(beam.d, border.n)))
