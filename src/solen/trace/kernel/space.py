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
    """Coherency matrix: powers of the fields along e and perpendicular to e, and their correlation cr + i·ci."""

    i1: float
    i2: float
    cr: float
    ci: float


class Beam(NamedTuple):
    """Light: its direction, the basis vector e, and its coherency matrix in the basis of e."""

    d: Vector
    e: Vector
    light: Coherency


class Border(NamedTuple):
    """A surface as seen from the incident light: the normal is on the side of the light, where the index is n1."""

    n: Vector
    n1: float
    n2: float
    from_right: bool
    """whether light comes from the right of the curve in projection; only treated surfaces use it"""


class Parts(NamedTuple):
    """The transmitted and the reflected light at a surface."""

    on: Beam
    back: Beam


@compiled
def dot(a: Vector, b: Vector) -> float:
    """Scalar product."""
    return a.x * b.x + a.y * b.y + a.z * b.z


@compiled
def cross(a: Vector, b: Vector) -> Vector:
    """Vector product."""
    return Vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


@compiled
def unit(a: Vector) -> Vector:
    """Vector scaled to length 1."""
    scale = 1.0 / math.sqrt(dot(a, a))
    return Vector(scale * a.x, scale * a.y, scale * a.z)


@compiled
def upright(d: Vector) -> Vector:
    """Unit vector perpendicular to d in the plane of d and the y-axis; x for a ray along y."""
    flat = d.x * d.x + d.z * d.z
    if flat < PARALLEL * PARALLEL:
        return Vector(1.0, 0.0, 0.0)
    return unit(Vector(-d.y * d.x, flat, -d.y * d.z))


@compiled
def rotated_basis(light: Coherency, cos: float, sin: float) -> Coherency:
    """Coherency matrix in the basis rotated by an angle from e towards d × e."""
    correlation, difference = 2.0 * cos * sin * light.cr, cos * sin * (light.i2 - light.i1)
    return Coherency(
        cos * cos * light.i1 + sin * sin * light.i2 + correlation,
        sin * sin * light.i1 + cos * cos * light.i2 - correlation,
        difference + (cos * cos - sin * sin) * light.cr,
        light.ci,
    )


@compiled
def scaled(light: Coherency, factor: float) -> Coherency:
    """Coherency matrix with the power multiplied by a factor."""
    return Coherency(factor * light.i1, factor * light.i2, factor * light.cr, factor * light.ci)


@compiled
def power_of(light: Coherency) -> float:
    """Total power of both fields."""
    return light.i1 + light.i2


@compiled
def scaled_beam(beam: Beam, factor: float) -> Beam:
    """Light with the power multiplied by a factor."""
    return Beam(beam.d, beam.e, scaled(beam.light, factor))


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
        # total reflection: cr + i·ci is the square of a complex number with half its phase
        decay = math.sqrt(-square)
        real, imaginary = n2 * n2 * axial * axial - n1 * n1 * square, (n2 - n1) * (n2 + n1) * axial * decay
        squared = real * real + imaginary * imaginary
        cr, ci = (real - imaginary) * (real + imaginary) / squared, 2.0 * real * imaginary / squared
        return Amplitudes(1.0, 1.0, cr, ci, 0.0, 0.0, 0.0, 0.0)
    axial_2 = math.sqrt(square)
    rs = (axial - axial_2) / (axial + axial_2)
    rp = (n2 * n2 * axial - n1 * n1 * axial_2) / (n2 * n2 * axial + n1 * n1 * axial_2)
    on_s, on_p = 1.0 - rs * rs, 1.0 - rp * rp
    return Amplitudes(rs * rs, rp * rp, rs * rp, 0.0, on_s, on_p, math.sqrt(max(on_s * on_p, 0.0)), 0.0)


@compiled
def transformed(fraction_s: float, fraction_p: float, cr: float, ci: float, light: Coherency) -> Coherency:
    """Coherency matrix with the powers of both fields multiplied by factors, and their correlation by cr + i·ci."""
    return Coherency(
        fraction_s * light.i1, fraction_p * light.i2, cr * light.cr - ci * light.ci, cr * light.ci + ci * light.cr
    )


@compiled
def in_plane_of_incidence(d: Vector, e: Vector, n: Vector, light: Coherency) -> tuple[Vector, Coherency]:
    """Return the unit vector s perpendicular to the plane of incidence, and the coherency matrix in its basis."""
    normal_vector = cross(d, n)
    sine = math.sqrt(dot(normal_vector, normal_vector))
    if sine < PARALLEL:
        return e, light
    s = Vector(normal_vector.x / sine, normal_vector.y / sine, normal_vector.z / sine)
    return s, rotated_basis(light, dot(s, e), dot(s, cross(d, e)))


@compiled
def reflected(d: Vector, n: Vector, cos: float) -> Vector:
    """Direction after a reflection, normalised to avoid drift over many reflections."""
    twice = cos + cos
    x, y, z = d.x + twice * n.x, d.y + twice * n.y, d.z + twice * n.z
    correction = 1.0 + 0.5 * (1.0 - (x * x + y * y + z * z))
    return Vector(correction * x, correction * y, correction * z)


@compiled
def refracted(d: Vector, n: Vector, cos: float, n1: float, n2: float) -> Vector:
    """Direction behind a surface by Snell's law; undefined for total reflection."""
    square = (n2 - n1) * (n2 + n1) + (n1 * cos) * (n1 * cos)
    if square <= 0.0:
        return d
    normal_part = (n1 * cos - math.sqrt(square)) / n2
    ratio = n1 / n2
    return unit(
        Vector(ratio * d.x + normal_part * n.x, ratio * d.y + normal_part * n.y, ratio * d.z + normal_part * n.z)
    )


@compiled
def split_beam(beam: Beam, border: Border, a: Amplitudes) -> Parts:
    """Return both parts of a ray at a surface, in the basis of s."""
    d, n = beam.d, border.n
    cos = -dot(d, n)
    s, light = in_plane_of_incidence(d, beam.e, n, beam.light)
    return Parts(
        Beam(refracted(d, n, cos, border.n1, border.n2), s, transformed(a.on_s, a.on_p, a.on_cr, a.on_ci, light)),
        Beam(reflected(d, n, cos), s, transformed(a.back_s, a.back_p, a.back_cr, a.back_ci, light)),
    )


@compiled
def smooth_parts(beam: Beam, border: Border) -> Parts:
    """Return both parts at a smooth, clean and bare surface."""
    return split_beam(beam, border, bare(border.n1, border.n2, -border.n1 * dot(beam.d, border.n)))
