"""The effect of a treated surface on a ray, in plain Python: the reference for `solen.trace.kernel.treated`.

See `solen.scene.surface` for the treatments. Random numbers are those of the engine, so that the two can be compared
ray by ray. The formulas are implemented independently, and films are computed by another method.
"""

import cmath
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from solen.plane import Point, cross, dot, left_of, minus, right_of, unit
from solen.refraction import fresnel, reflected, refracted
from solen.scene import Coating, Gaussian, Grating, HarveyShack, Interface, ScatterTable, Surface, Texture
from solen.trace.kernel.surface import Event, uniform_of
from solen.trace.kernel.treated import FACET, ORDER, REFLECTED, REJECTION, TRANSMITTED, TRIES

Draw = Callable[[int], float]
"""Function that returns the n-th random number in [0, 1) for a given ray and hit."""


class Part(NamedTuple):
    """Direction and powers of the light that leaves a surface on one side."""

    direction: Point
    s: float
    p: float


class Arrival(NamedTuple):
    """A ray that meets a surface; ``facing`` is the normal on the side of the ray, n1 the index there, n2 behind."""

    at: Point
    direction: Point
    s: float
    p: float
    facing: Point
    n1: float
    n2: float
    wavelength_nm: float | None
    from_right: bool

    @property
    def cos(self) -> float:
        """Cosine of the angle of incidence."""
        return -dot(self.direction, self.facing)


def treated(interface: Interface, surface: Surface, ray: Arrival, draw: Draw, counting: bool) -> tuple[Part, Part]:
    """Return the transmitted and reflected parts before weak parts are dropped; the remaining power is absorbed."""
    if surface.grating is not None:
        return _diffracted(surface.grating, ray, draw, counting)
    tilted = ray
    if surface.texture is not None and surface.texture.direction == "along":
        tilted = ray._replace(facing=_facet(surface.texture, ray, draw))
    through, back = _smooth(interface, surface, tilted, counting)
    if surface.focal_mm is not None:
        through, back = _focused(interface, surface.focal_mm, ray, through, back)
    if surface.coating is not None and not counting:
        through, back = _coated(surface.coating, tilted, through, back)
    elif surface.coating is not None and _is_opaque(surface.coating, tilted):
        through, back = through._replace(s=0.0, p=0.0), back._replace(s=ray.s, p=ray.p)
    if surface.table is not None and not counting:
        through, back = _tabulated(surface, tilted, through, back, interface.behaviour)
    behind = (-ray.facing[0], -ray.facing[1])
    return (
        _scattered(surface, through, behind, draw, TRANSMITTED),
        _scattered(surface, back, ray.facing, draw, REFLECTED),
    )


def _smooth(interface: Interface, surface: Surface, ray: Arrival, counting: bool) -> tuple[Part, Part]:
    """Return both parts at a smooth surface with the specified behaviour."""
    back = reflected(ray.direction, ray.facing)
    no_light = Part(ray.direction, 0.0, 0.0)
    if interface.behaviour == "lens":
        return Part(ray.direction, ray.s, ray.p), no_light
    if interface.behaviour == "splitter":
        t = 1.0 if counting else surface.transmitted
        through = Part(ray.direction, t * ray.s, t * ray.p)
        return through, Part(back, ray.s - through.s, ray.p - through.p)
    if interface.behaviour == "mirror":
        r = 1.0 if counting else surface.reflectance
        return no_light, Part(back, r * ray.s, r * ray.p)
    direction = refracted(ray.direction, ray.facing, ray.n1, ray.n2)
    if direction is None:
        return no_light, Part(back, ray.s, ray.p)
    if counting or not surface.partial:
        return Part(direction, ray.s, ray.p), Part(back, 0.0, 0.0)
    reflectance = fresnel(ray.cos, ray.n1, ray.n2)
    through = Part(direction, ray.s * (1.0 - reflectance.s), ray.p * (1.0 - reflectance.p))
    return through, Part(back, ray.s * reflectance.s, ray.p * reflectance.p)


def _focused(interface: Interface, focal_mm: float, ray: Arrival, through: Part, back: Part) -> tuple[Part, Part]:
    """Deflect a ray paraxially at any angle: its slope to the axis decreases by its height divided by f."""
    along = left_of(ray.facing)
    height = dot(minus(ray.at, interface.curve.middle_point), along)
    slope = dot(ray.direction, along) / ray.cos - height / focal_mm
    if interface.behaviour == "lens":
        return through._replace(direction=_direction(slope, along, (-ray.facing[0], -ray.facing[1]))), back
    return through, back._replace(direction=_direction(slope, along, ray.facing))


def _direction(slope: float, along: Point, axis: Point) -> Point:
    return unit((slope * along[0] + axis[0], slope * along[1] + axis[1]))


def _coated(coating: Coating, ray: Arrival, through: Part, back: Part) -> tuple[Part, Part]:
    if ray.wavelength_nm is None:
        raise AssertionError("a scene with coatings has wavelengths")
    layers = coating.layers[::-1] if ray.from_right else coating.layers
    films = [(complex(layer.index, -layer.extinction), layer.thickness_nm) for layer in layers]
    rs, ts = film_powers(films, ray.cos, ray.n1, ray.n2, ray.wavelength_nm, "s")
    rp, tp = film_powers(films, ray.cos, ray.n1, ray.n2, ray.wavelength_nm, "p")
    return through._replace(s=ts * ray.s, p=tp * ray.p), back._replace(s=rs * ray.s, p=rp * ray.p)


def _tabulated(surface: Surface, ray: Arrival, through: Part, back: Part, behaviour: str) -> tuple[Part, Part]:
    """Return both parts, from the table for the side of the ray; without a refracted ray, all light is reflected."""
    table = table_fractions(surface, ray.from_right, ray.cos)
    direction = refracted(ray.direction, ray.facing, ray.n1, ray.n2) if behaviour == "refracting" else None
    ts, tp = (table.ts, table.tp) if direction is not None else (0.0, 0.0)
    rs, rp = (table.rs + table.ts - ts, table.rp + table.tp - tp)
    return through._replace(s=ts * ray.s, p=tp * ray.p), back._replace(s=rs * ray.s, p=rp * ray.p)


class PowerFractions(NamedTuple):
    """Reflected and transmitted fractions of the power polarised perpendicular to the plane of incidence and in it."""

    rs: float
    rp: float
    ts: float
    tp: float


def table_fractions(surface: Surface, from_right: bool, cos: float) -> PowerFractions:
    """Return the power fractions in a surface table, interpolated at an angle of incidence."""
    table = surface.table_right if from_right and surface.table_right is not None else surface.table
    if table is None:
        raise AssertionError("the surface has a table")
    columns = np.array(table.rows).T
    angle_deg = math.degrees(math.acos(min(cos, 1.0)))
    return PowerFractions(*(float(np.interp(angle_deg, columns[0], column)) for column in columns[1:]))


def orders_of(grating: Grating, ray: Arrival) -> list[Part]:
    """Return all propagating orders of a grating, with their powers."""
    if ray.wavelength_nm is None:
        raise AssertionError("a scene with gratings has wavelengths")
    index = ray.n1 if grating.mirrored else ray.n2
    forward = (-ray.facing[0], -ray.facing[1])
    right = right_of(forward)
    outward = ray.facing if grating.mirrored else forward
    parts = []
    for order, efficiency in grating.orders:
        wave = ray.n1 * dot(ray.direction, right) + order * ray.wavelength_nm * 1e-6 * grating.lines_per_mm
        sine = wave / index
        if abs(sine) < 1.0 and efficiency > 0.0:
            cos = math.sqrt(1.0 - sine * sine)
            direction = (sine * right[0] + cos * outward[0], sine * right[1] + cos * outward[1])
            parts.append(Part(direction, efficiency * ray.s, efficiency * ray.p))
    return parts


def _diffracted(grating: Grating, ray: Arrival, draw: Draw, counting: bool) -> tuple[Part, Part]:
    """Choose one order with probability proportional to its power; it carries the power of all orders."""
    no_light, orders = Part(ray.direction, 0.0, 0.0), orders_of(grating, ray)
    if not orders:
        return no_light, no_light
    powers = np.array([part.s + part.p for part in orders])
    index = int(np.searchsorted(np.cumsum(powers), draw(ORDER) * powers.sum(), side="right"))
    total = 1.0 if counting else float(powers.sum()) / (ray.s + ray.p)
    part = orders[min(index, len(orders) - 1)]._replace(s=total * ray.s, p=total * ray.p)
    return (no_light, part) if grating.mirrored else (part, no_light)


def _is_opaque(coating: Coating, ray: Arrival) -> bool:
    """Return whether counting mode treats light as totally reflected at a film thicker than the wavelength."""
    tangential = ray.n1 * math.sqrt(1.0 - ray.cos**2)
    max_nm = ray.wavelength_nm or math.inf
    return any(film.thickness_nm > max_nm and film.index < tangential for film in coating.layers)


def film_powers(
    films: list[tuple[complex, float]], cos: float, n1: float, n2: float, wavelength_nm: float, polarisation: str
) -> tuple[float, float]:
    """Return the reflectance and transmittance of films; see `film_fields`."""
    r, t, ratio = film_fields(films, cos, n1, n2, wavelength_nm, polarisation)
    return abs(r) ** 2, abs(t) ** 2 * ratio


def film_fields(
    films: list[tuple[complex, float]], cos: float, n1: float, n2: float, wavelength_nm: float, polarisation: str
) -> tuple[complex, complex, float]:
    """Return the amplitude coefficients r and t of films (complex index, thickness in nm), by Airy's sum.

    It is applied from the last boundary to the first (Born & Wolf, section 1.6; Parratt, Phys. Rev. 95, 359, 1954). The
    amplitudes are those of the fields along the surface, with time dependence exp(+iωt). The third result converts |t|²
    to a power fraction.
    """
    k0, q = 2.0 * math.pi / wavelength_nm, n1 * math.sqrt(1.0 - cos * cos)
    indices = [complex(n1), *(index for index, _ in films), complex(n2)]
    normal = [_decaying(n * n - q * q) for n in indices]
    admittance = [a if polarisation == "s" else n * n / a for n, a in zip(indices, normal, strict=True)]
    r, t = 0.0 + 0.0j, 1.0 + 0.0j
    for j in range(len(indices) - 2, -1, -1):
        boundary = (admittance[j] - admittance[j + 1]) / (admittance[j] + admittance[j + 1])
        thickness_nm = films[j][1] if j < len(films) else 0.0  # for the film behind this boundary
        phase = cmath.exp(-1j * k0 * normal[j + 1] * thickness_nm)
        behind = r * phase * phase
        denominator = 1.0 + boundary * behind
        r, t = (boundary + behind) / denominator, t * (1.0 + boundary) * phase / denominator
    return r, t, admittance[-1].real / admittance[0].real


def _decaying(square: complex) -> complex:
    """Return the square root of a squared wave number for a decaying wave, with time dependence exp(+iωt)."""
    root = cmath.sqrt(square)
    return -root if root.imag > 0.0 else root


def _facet(texture: Texture, ray: Arrival, draw: Draw) -> Point:
    """Return the normal of the ripple facet that a ray meets, sampled in proportion to projected size."""
    along = left_of(ray.facing)
    sine = dot(ray.direction, along)
    for i in range(TRIES):
        slope = texture.slope * math.cos(2.0 * math.pi * draw(FACET + 2 * i))
        size, largest = 1.0 - slope * sine / ray.cos, 1.0 + texture.slope * abs(sine) / ray.cos
        if draw(FACET + 2 * i + 1) * largest > size:
            continue
        normal = unit((ray.facing[0] + slope * along[0], ray.facing[1] + slope * along[1]))
        if dot(ray.direction, normal) >= 0.0:
            continue
        back, through = reflected(ray.direction, normal), refracted(ray.direction, normal, ray.n1, ray.n2)
        if dot(back, ray.facing) > 0.0 and (through is None or dot(through, ray.facing) < 0.0):
            return normal
    return ray.facing


def _scattered(surface: Surface, part: Part, normal: Point, draw: Draw, purpose: int) -> Part:
    """Return a part unchanged, or in a direction sampled from the profile, on the same side of the surface."""
    scatter = surface.scatter
    if scatter is None or draw(purpose) >= scatter.share:
        return part
    along = left_of(normal)
    smooth = cross(normal, part.direction)
    for i in range(TRIES):
        u, v = draw(purpose + 2 * i + 1), draw(purpose + 2 * i + 2)
        if isinstance(scatter, Gaussian):
            radius = math.sqrt(-2.0 * math.log(1.0 - u))
            sine = smooth + scatter.sigma * radius * math.cos(2.0 * math.pi * v)
        elif isinstance(scatter, HarveyShack):
            offset = math.tan(math.pi * (u - 0.5))
            if v >= _acceptance(scatter, offset):
                continue
            sine = smooth + scatter.shoulder * offset
        elif isinstance(scatter, ScatterTable):
            offset, density = _from_envelope(scatter, u)
            if draw(purpose + REJECTION + i) >= density:
                continue
            sine = smooth + (offset if v < 0.5 else -offset)
        else:
            sine = 2.0 * u - 1.0
        if abs(sine) < 1.0:
            cos = math.sqrt(1.0 - sine * sine)
            direction = (cos * normal[0] + sine * along[0], cos * normal[1] + sine * along[1])
            return part._replace(direction=direction)
    return part


def _from_envelope(scatter: ScatterTable, u: float) -> tuple[float, float]:
    """Return the offset at a cumulative fraction of the step envelope, and the density divided by the envelope."""
    offsets, density = np.array(scatter.offset), np.array(scatter.density)
    steps = np.maximum(density[1:], density[:-1])
    cumulative = np.concatenate([[0.0], np.cumsum(steps * np.diff(offsets))])
    offset = float(np.interp(u * cumulative[-1], cumulative, offsets))
    cell = min(int(np.searchsorted(cumulative, u * cumulative[-1], side="right")) - 1, len(steps) - 1)
    return offset, float(np.interp(offset, offsets, density)) / float(steps[cell])


def _acceptance(scatter: HarveyShack, offset: float) -> float:
    """Return the acceptance probability of a sample from the Cauchy distribution; the offset is in shoulders."""
    if abs(offset) > 2.0 / scatter.shoulder:
        return 0.0

    def ratio(x: float) -> float:
        return float((1.0 + x * x) ** (1.0 - scatter.slope / 2.0))

    return ratio(offset) / max(1.0, ratio(2.0 / scatter.shoulder))


def draws(seed: int, ray: int, hit: int) -> Draw:
    """Return the function that generates the random numbers for a ray and a hit."""
    return lambda number: uniform_of(Event(seed, ray, hit), number)
