"""The reference tracer in space, which follows single rays by brute force to check the engine's extruded scenes.

It shares only the scene with the engine: vectors have three components, light consists of two independent complex
fields whose powers add, and random numbers come from Python's own generator. At a partial reflection one part is
followed, chosen with probability proportional to its power. Scatter profiles are sampled by rejection, so only their
definition matters.
"""

import math
import random
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from solen.errors import DesignError
from solen.scene import Extrusion, Gaussian, HarveyShack, Interface, Region, ScatterTable, Scene, Surface, Texture
from solen.trace.reference_front import FrontHit, FrontInSpace
from solen.trace.reference_surfaces import film_fields, table_fractions
from solen.trace.result import Limits

Vector = tuple[float, float, float]
Field = tuple[complex, complex, complex]
Light = tuple[Field, Field]
UP: Vector = (0.0, 1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Reading:
    """Sums of ray powers, and of their squares for the standard error, keyed by fate."""

    rays: int
    sums: dict[str, float]
    squares: dict[str, float]

    def mean(self, fate: str) -> float:
        """Power with a fate, as a fraction of the emitted power."""
        return self.sums.get(fate, 0.0) / self.rays

    def error(self, fate: str) -> float:
        """Standard error of `mean`."""
        mean = self.mean(fate)
        return math.sqrt(max(self.squares.get(fate, 0.0) / self.rays - mean * mean, 0.0) / self.rays)


class Ray(NamedTuple):
    """A ray: ``last`` is the wall at its origin, ``region`` its medium (None if not yet determined)."""

    at: Vector
    d: Vector
    light: Light
    region: str | None = None
    last: Interface | None = None


class Arrival(NamedTuple):
    """A wall, its normal on the side of the ray, and the media in front of it and behind it."""

    wall: Interface
    normal: Vector
    from_right: bool
    medium: str
    beyond: str


def trace_space_reference(scene: Scene, limits: Limits | None = None, *, seed: int = 0) -> Reading:
    """Trace every ray of every source of an extruded scene.

    The fates are the names of the receivers, ``escaped`` with its parts ``missed`` and ``leaked`` (see `Trace`),
    ``absorbed`` and ``truncated``. All rays are assumed to carry the same power. Corners receive no special treatment,
    so a ray within about 1e-9 mm of a corner may be truncated.

    Raises
    ------
    DesignError
        If the scene is not extruded.
    """
    if scene.extrusion is None:
        raise DesignError("scene", limit="must be extruded", remedy="specify an extrusion or use trace_reference")
    tracer = _Tracer(scene, scene.extrusion, limits or Limits(), random.Random(seed))  # noqa: S311  not for cryptography
    for source in scene.sources:
        launch = source.launch(in_space=True)
        if launch.y_mm is None or launch.dy is None:
            raise AssertionError("rays of an extruded scene are launched in space")
        for i in range(len(launch)):
            d = (float(launch.dx[i]), float(launch.dy[i]), float(launch.dz[i]))
            e, power = _upright(d), launch.power_s[i] + launch.power_p[i]
            light = (
                _field(math.sqrt(launch.power_s[i] / power), e),
                _field(math.sqrt(launch.power_p[i] / power), _cross(d, e)),
            )
            at = (float(launch.x_mm[i]), float(launch.y_mm[i]), float(launch.z_mm[i]))
            region = None if tracer.face is None else tracer.face.right
            nm = source.spectrum[launch.line[i]][0] if source.spectrum else None
            tracer.follow(Ray(at, d, light, region), nm)
    return Reading(tracer.rays, tracer.totals, tracer.squares)


class _Tracer:
    """Tracer for rays through one scene, which adds up their powers by fate."""

    def __init__(self, scene: Scene, slab: Extrusion, limits: Limits, draw: random.Random) -> None:
        self.scene, self.slab, self.limits, self.draw = scene, slab, limits, draw
        self.regions = {region.name: region for region in scene.regions}
        self.half = 0.5 * slab.thickness_mm
        self.front = None if scene.front is None else FrontInSpace(scene.front)
        name = "" if scene.front is None else scene.front.interface
        self.face = next((interface for interface in scene.interfaces if interface.name == name), None)
        """the vertical face that is replaced by the face of a lens for skew rays; the sources are on its right"""
        self.rays = 0
        self.sums: dict[str, float] = {}
        """for the current ray"""
        self.totals: dict[str, float] = {}
        self.squares: dict[str, float] = {}
        self.nm: float | None = None

    def follow(self, ray: Ray, wavelength_nm: float | None) -> None:
        """Follow one ray to its end."""
        self.sums, self.nm = {}, wavelength_nm
        current: Ray | None = ray
        for _ in range(self.limits.max_hits):
            if current is None or _power(current.light) < self.limits.min_weight:
                break
            current = self._step(current)
        if current is not None:
            self._record("truncated", current.light)
        self.rays += 1
        for fate, power in self.sums.items():
            self.totals[fate] = self.totals.get(fate, 0.0) + power
            self.squares[fate] = self.squares.get(fate, 0.0) + power * power

    def _record(self, fate: str, light: Light) -> None:
        """Add power to a fate of the current ray."""
        self.sums[fate] = self.sums.get(fate, 0.0) + _power(light)

    def _miss(self, ray: Ray) -> None:
        """Let a ray escape above or below all bodies."""
        self._record("missed", ray.light)
        self._record("escaped", ray.light)

    def _step(self, ray: Ray) -> Ray | None:
        """Advance a ray to the nearest event: a wall, the top or bottom, or scattering in a medium."""
        if abs(ray.at[1]) > self.half * (1.0 + 1e-12):
            self._miss(ray)
            return None
        arrival, wall_mm = self._next_arrival(ray)
        if arrival is None or ray.region not in (None, arrival.medium):
            self._end(ray, arrival, wall_mm)
            return None
        medium = self.regions[arrival.medium]
        free_mm = self._free_path(medium)
        slab_mm = (math.copysign(self.half, ray.d[1]) - ray.at[1]) / ray.d[1] if ray.d[1] != 0.0 else math.inf
        length_mm = min(wall_mm, free_mm, max(slab_mm, 0.0))
        transmittance = math.exp(-medium.absorption_per_mm * length_mm)
        self._record("absorbed", _attenuated(ray.light, 1.0 - transmittance))
        light = _attenuated(ray.light, transmittance)
        ray = _moved(ray, length_mm)._replace(light=light, region=arrival.medium)
        if length_mm == free_mm:
            d = self._scattering_direction(ray.d, medium.anisotropy)
            return ray._replace(d=d, light=_depolarised(ray.light, d), last=None)
        return self._at_slab(ray) if length_mm < wall_mm else self._at_wall(ray._replace(last=arrival.wall), arrival)

    def _next_arrival(self, ray: Ray) -> tuple[Arrival | None, float]:
        """Return the arrival at the nearest wall or at the lens, and its distance."""
        wall, wall_mm = self._wall(ray)
        hit = self.front.hit(ray.at, ray.d) if self.front is not None else None
        if hit is not None and hit.distance < wall_mm:
            return self._front_arrival(hit), hit.distance
        return None if wall is None else _arrival(wall, _moved(ray, wall_mm)), wall_mm

    def _end(self, ray: Ray, arrival: Arrival | None, wall_mm: float) -> None:
        """Record a ray that meets no wall, or meets a wall from a medium other than its own."""
        if arrival is None:
            lossy = ray.region is not None and self.regions[ray.region].absorption_per_mm > 0.0
            self._record("absorbed" if lossy else "escaped", ray.light)
        elif self._passes_over(ray, wall_mm):
            self._miss(ray)
        else:
            self._record("truncated", ray.light)

    def _wall(self, ray: Ray) -> tuple[Interface | None, float]:
        """Return the first wall on the path of a ray and its distance."""
        in_plane = math.hypot(ray.d[0], ray.d[2])
        if in_plane == 0.0:
            return None, math.inf
        wall, nearest = None, math.inf
        for interface in self.scene.interfaces:
            if interface is self.face:
                continue
            origin, along = (ray.at[0], ray.at[2]), (ray.d[0] / in_plane, ray.d[2] / in_plane)
            for t in interface.curve.hits(origin, along, leaving=interface is ray.last):
                hidden = self.front is not None and t < nearest and self.front.hides(_moved(ray, t / in_plane).at)
                if t < nearest and not hidden:
                    wall, nearest = interface, t
        return wall, nearest / in_plane

    def _front_arrival(self, hit: FrontHit) -> Arrival:
        """Return the arrival at the face of a lens for skew rays, whose interface has the body on its left."""
        wall = self.face
        if wall is None:
            raise AssertionError("a scene with a front has its face")
        if hit.enters:
            return Arrival(wall, hit.normal, True, wall.right, wall.left)
        return Arrival(wall, _scaled(-1.0, hit.normal), False, wall.left, wall.right)

    def _passes_over(self, ray: Ray, wall_mm: float) -> bool:
        """Return whether a ray in the air in front of the lens leaves the slab before it reaches a wall."""
        if self.face is None or ray.region != self.face.right:
            return False
        return abs(ray.at[1] + wall_mm * ray.d[1]) > self.half

    def _free_path(self, medium: Region) -> float:
        return self.draw.expovariate(medium.scattering_per_mm) if medium.scattering_per_mm > 0.0 else math.inf

    def _scattering_direction(self, d: Vector, g: float) -> Vector:
        """Return a direction after scattering, sampled by rejection from uniform directions."""
        while True:
            new = self._uniform_direction()
            value = (1.0 - g * g) / (1.0 + g * g - 2.0 * g * _dot(d, new)) ** 1.5
            if self.draw.random() * (1.0 + abs(g)) / (1.0 - abs(g)) ** 2 < value:
                return new

    def _uniform_direction(self) -> Vector:
        """Return a random unit vector, uniformly distributed on the sphere."""
        while True:
            v = (self.draw.uniform(-1.0, 1.0), self.draw.uniform(-1.0, 1.0), self.draw.uniform(-1.0, 1.0))
            if 1e-6 < _dot(v, v) < 1.0:
                return _unit(v)

    def _at_slab(self, ray: Ray) -> Ray | None:
        """Reflect a ray at the top or bottom of the slab and record the transmitted part, which is not followed."""
        up = 1.0 if ray.d[1] > 0.0 else -1.0
        ray = ray._replace(at=(ray.at[0], up * self.half, ray.at[2]))
        n1 = self.regions[str(ray.region)].index_at(self.nm)
        n2 = self.slab.index_above if up > 0.0 else self.slab.index_below
        if n1 == n2:
            self._miss(ray)
            return None
        normal = (0.0, -up, 0.0)
        amplitudes = _fresnel(n1, n2, -_dot(ray.d, normal))
        through = _refracted(ray.d, normal, n1, n2)
        if through is not None:
            leaked = _deflected(ray, through, normal, amplitudes.ts, amplitudes.tp)
            self._record("leaked", leaked)
            self._record("escaped", leaked)
        back = _reflected(ray.d, normal)
        light = _deflected(ray, back, normal, amplitudes.rs, amplitudes.rp)
        return ray._replace(d=back, light=light, last=None)  # the ray is no longer on a wall

    def _at_wall(self, ray: Ray, arrival: Arrival) -> Ray | None:
        """Continue a ray at a wall as one part, chosen with probability proportional to its power."""
        wall, surface = arrival.wall, arrival.wall.surface or Surface()
        if surface.acts_at(self.nm):
            behaviour = wall.behaviour
        else:
            surface, behaviour = Surface(), "refracting"
        if wall.height_mm is not None and not wall.height_mm[0] <= ray.at[1] <= wall.height_mm[1]:
            behaviour = "refracting"
        if behaviour in ("receiver", "absorbing"):
            is_detected = behaviour == "receiver" and not arrival.from_right
            self._record(str(wall.receiver) if is_detected else "absorbed", ray.light)
            return None
        n1, n2 = (self.regions[name].index_at(self.nm) for name in (arrival.medium, arrival.beyond))
        normal = self._facet(surface.texture, ray.d, arrival.normal, n1, n2) if surface.texture else arrival.normal
        a = self._amplitudes(behaviour, surface, arrival.from_right, n1, n2, -_dot(ray.d, normal))
        back, through = _reflected(ray.d, normal), _refracted(ray.d, normal, n1, n2)
        through = ray.d if behaviour == "splitter" else through
        back_light = _deflected(ray, back, normal, a.rs, a.rp)
        dark = _attenuated(ray.light, 0.0)
        through_light = dark if through is None else _deflected(ray, through, normal, a.ts, a.tp)
        total, reflected = _power(back_light) + _power(through_light), _power(back_light)
        self.sums["absorbed"] = self.sums.get("absorbed", 0.0) + max(_power(ray.light) - total, 0.0)
        if total == 0.0:
            return None
        if through is None or self.draw.random() * total < reflected:
            back, light = self._scattered(surface, back, _attenuated(back_light, total / reflected), arrival.normal)
            return ray._replace(d=back, light=light)
        behind = _scaled(-1.0, arrival.normal)
        light = _attenuated(through_light, total / _power(through_light))
        through, light = self._scattered(surface, through, light, behind)
        return ray._replace(d=through, light=light, region=arrival.beyond)

    def _amplitudes(
        self, behaviour: str, surface: Surface, from_right: bool, n1: float, n2: float, cos: float
    ) -> "Amplitudes":
        """Return the amplitude factors of both fields, reflected and transmitted."""
        if surface.table is not None:
            table = table_fractions(surface, from_right, cos)
            if behaviour == "mirror" or n1 * n1 * (1.0 - cos * cos) >= n2 * n2:
                return Amplitudes(-math.sqrt(table.rs + table.ts), math.sqrt(table.rp + table.tp), 0.0, 0.0)
            return Amplitudes(-math.sqrt(table.rs), math.sqrt(table.rp), math.sqrt(table.ts), math.sqrt(table.tp))
        if behaviour == "mirror":
            r = math.sqrt(surface.reflectance)
            return Amplitudes(-r, r, 0.0, 0.0)
        if behaviour == "splitter":
            r, t = math.sqrt(1.0 - surface.transmitted), math.sqrt(surface.transmitted)
            return Amplitudes(-r, r, t, t)
        if surface.coating is not None and self.nm is not None:
            layers = surface.coating.layers[::-1] if from_right else surface.coating.layers
            films = [(complex(layer.index, -layer.extinction), layer.thickness_nm) for layer in layers]
            rs, ts, ratio_s = film_fields(films, cos, n1, n2, self.nm, "s")
            rp, tp, ratio_p = film_fields(films, cos, n1, n2, self.nm, "p")
            return Amplitudes(rs, -rp, math.sqrt(max(ratio_s, 0.0)) * ts, math.sqrt(max(ratio_p, 0.0)) * tp)
        a = _fresnel(n1, n2, cos)
        return Amplitudes(0.0, 0.0, 1.0, 1.0) if not surface.partial and abs(a.ts) > 0.0 else a

    def _facet(self, texture: Texture, d: Vector, normal: Vector, n1: float, n2: float) -> Vector:
        """Return the normal of the ripple facet that a ray meets, sampled in proportion to projected size."""
        along = UP if texture.direction == "across" else _cross(normal, UP)
        largest = 1.0 + texture.slope * abs(_dot(d, along)) / -_dot(d, normal)
        while True:
            slope = texture.slope * math.cos(self.draw.uniform(0.0, 2.0 * math.pi))
            tilted = tuple(n + slope * t for n, t in zip(normal, along, strict=True))
            projected = sum(-a * b for a, b in zip(d, tilted, strict=True)) / -_dot(d, normal)
            if self.draw.random() * largest >= projected:
                continue
            facet = _unit((tilted[0], tilted[1], tilted[2]))
            through = _refracted(d, facet, n1, n2)
            if _dot(_reflected(d, facet), normal) > 0.0 and (through is None or _dot(through, normal) < 0.0):
                return facet

    def _scattered(self, surface: Surface, d: Vector, light: Light, normal: Vector) -> tuple[Vector, Light]:
        """Return a part unchanged, or in a direction sampled from the profile, on the same side of the surface."""
        scatter = surface.scatter
        if scatter is None or self.draw.random() >= scatter.share:
            return d, light
        while True:
            along, up = self.draw.uniform(-1.0, 1.0), self.draw.uniform(-1.0, 1.0)
            if along * along + up * up >= 1.0:
                continue
            across = _cross(normal, UP)
            offset = math.hypot(along - _dot(d, across), up - d[1])
            value = 1.0
            if isinstance(scatter, Gaussian):
                value = math.exp(-0.5 * (offset / scatter.sigma) ** 2)
            elif isinstance(scatter, HarveyShack):
                value = float((1.0 + (offset / scatter.shoulder) ** 2) ** (-0.5 * scatter.slope))
            elif isinstance(scatter, ScatterTable):
                value = float(np.interp(offset, scatter.offset, scatter.density, right=0.0)) / max(scatter.density)
            if self.draw.random() < value:
                cos = math.sqrt(1.0 - along * along - up * up)
                new = (cos * normal[0] + along * across[0], up, cos * normal[2] + along * across[2])
                return new, _depolarised(light, new)


class Amplitudes(NamedTuple):
    """Amplitude factors for reflected and transmitted fields perpendicular to the plane of incidence and in it.

    The squares of the factors are power fractions.
    """

    rs: complex
    rp: complex
    ts: complex
    tp: complex


def _fresnel(n1: float, n2: float, cos: float) -> Amplitudes:
    """Return Fresnel amplitudes for fields with time dependence exp(+iωt), with p = d × s on either side."""
    a1 = n1 * cos
    square = n2 * n2 - n1 * n1 + a1 * a1
    a2 = math.sqrt(square) if square > 0.0 else complex(0.0, -math.sqrt(-square))
    rs, rp = (a1 - a2) / (a1 + a2), (n2 * n2 * a1 - n1 * n1 * a2) / (n2 * n2 * a1 + n1 * n1 * a2)
    if square <= 0.0:
        return Amplitudes(rs, rp, 0.0, 0.0)
    root = math.sqrt(abs(a2) / a1)
    return Amplitudes(rs, rp, root * 2.0 * a1 / (a1 + a2), root * 2.0 * n1 * n2 * a1 / (n2 * n2 * a1 + n1 * n1 * a2))


def _deflected(ray: Ray, d: Vector, normal: Vector, factor_s: complex, factor_p: complex) -> Light:
    """Return the fields of a ray deflected to d, with factors on the components along s and p."""
    across = _cross(ray.d, normal)
    s = _unit(across) if _dot(across, across) > 1e-24 else _upright(ray.d)
    p_in, p_out = _cross(ray.d, s), _cross(d, s)

    def deflected(e: Field) -> Field:
        return _sum(_field(factor_s * _component(e, s), s), _field(factor_p * _component(e, p_in), p_out))

    return deflected(ray.light[0]), deflected(ray.light[1])


def _arrival(wall: Interface, ray: Ray) -> Arrival:
    """Return the wall, normal and media for a ray that has arrived at a wall."""
    nx, nz = wall.curve.normal_at((ray.at[0], ray.at[2]))
    if ray.d[0] * nx + ray.d[2] * nz > 0.0:
        return Arrival(wall, (-nx, 0.0, -nz), True, wall.right, wall.left)
    return Arrival(wall, (nx, 0.0, nz), False, wall.left, wall.right)


def _moved(ray: Ray, length_mm: float) -> Ray:
    x, y, z = (a + length_mm * b for a, b in zip(ray.at, ray.d, strict=True))
    return ray._replace(at=(x, y, z))


def _refracted(d: Vector, normal: Vector, n1: float, n2: float) -> Vector | None:
    """Return the direction behind a surface by Snell's law, or None for total reflection."""
    cos = -_dot(d, normal)
    square = 1.0 - (n1 / n2) ** 2 * (1.0 - cos * cos)
    if square <= 0.0:
        return None
    x, y, z = (n1 / n2 * a + (n1 / n2 * cos - math.sqrt(square)) * b for a, b in zip(d, normal, strict=True))
    return _unit((x, y, z))


def _reflected(d: Vector, normal: Vector) -> Vector:
    x, y, z = (a - 2.0 * _dot(d, normal) * b for a, b in zip(d, normal, strict=True))
    return _unit((x, y, z))


def _depolarised(light: Light, d: Vector) -> Light:
    """Return the same power in two independent fields of equal strength."""
    each, e = math.sqrt(0.5 * _power(light)), _upright(d)
    return _field(each, e), _field(each, _cross(d, e))


def _upright(d: Vector) -> Vector:
    """Return the unit vector perpendicular to d in the plane of d and the y-axis."""
    x, y, z = (a - d[1] * b for a, b in zip(UP, d, strict=True))
    return _unit((x, y, z)) if x * x + y * y + z * z > 1e-24 else (1.0, 0.0, 0.0)


def _power(light: Light) -> float:
    return sum(abs(component) ** 2 for field in light for component in field)


def _attenuated(light: Light, transmittance: float) -> Light:
    factor = math.sqrt(transmittance)
    return _field(factor, light[0]), _field(factor, light[1])


def _field(amplitude: complex, direction: Vector | Field) -> Field:
    return (amplitude * direction[0], amplitude * direction[1], amplitude * direction[2])


def _sum(a: Field, b: Field) -> Field:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _component(e: Field, direction: Vector) -> complex:
    return e[0] * direction[0] + e[1] * direction[1] + e[2] * direction[2]


def _scaled(factor: float, a: Vector) -> Vector:
    return (factor * a[0], factor * a[1], factor * a[2])


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _unit(a: Vector) -> Vector:
    return _scaled(1.0 / math.sqrt(_dot(a, a)), a)
