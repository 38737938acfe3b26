"""Rays as ray-optics places them: their number, origin and brightness follow from the ray density of the scene.

With a density d and a length scale l, a *beam* has a ray every l/d along its line, the first ray half a step from its
start; if it diverges, it has a fan of rays at each of these points. A *point source* has a ray every 2π/int(500 d)
radians, as has a source that emits into an angle. The brightness of a ray is b/d (for a beam b l/d, divided among the
rays of the fan), but at most 1; if the scene requires correct brightnesses, d is increased in steps of 1/500 until no
ray exceeds 1. Each polarisation carries half of the brightness.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import groupby

from solen.plane import Point, minus
from solen.scene.rayoptics.fields import GREEN_NM, Fields, UnreadableError
from solen.scene.rayoptics.seedrandom import random_numbers
from solen.scene.sources import Rays
from solen.scene.sources.base import MIN_POWER

MAX_RAYS = 2_000_000
"""Maximum number of rays in a scene, because each ray is listed individually."""
PER_TURN = 500
STEP = 1.0 / PER_TURN
END_MARGIN_RAD = 1e-5
"""Angle before the end of a cone within which no ray starts."""


@dataclass(frozen=True)
class PlacedRay:
    """One ray: origin, direction and brightness; ``fresh`` if it starts a new sequence of rays."""

    origin: Point
    direction: Point
    brightness: float
    fresh: bool = False


@dataclass
class SourceSettings:
    """Scene data that sources need, with the random number generator."""

    density: float
    length_scale: float
    colours: bool
    correct: bool
    observed: bool
    seed: str | None
    numbers: Iterator[float] = field(init=False)

    def __post_init__(self) -> None:
        self.numbers = random_numbers(self.seed or "")

    def density_for(self, brightest: Callable[[float], float]) -> float:
        """Return the density; if the scene requires correct brightnesses, increase it until no ray exceeds 1."""
        density = self.density
        if self.correct:
            steps = 0
            while brightest(density) > 1.0:
                density += STEP
                steps += 1
                if steps > MAX_RAYS:
                    raise UnreadableError("brightness", "would require too many rays")
        return density


Emission = Callable[[Fields, SourceSettings], list[PlacedRay]]


def rays(fields: Fields, settings: SourceSettings) -> tuple[tuple[Rays, ...], tuple[bool, ...]]:
    """Return the sources of one object, each with rays of equal brightness, and which rays start a new sequence."""
    wavelength_nm = fields.number_of("wavelength", GREEN_NM, above=0.0)
    placed = [ray for ray in EMISSIONS[fields.type](fields, settings) if ray.brightness >= MIN_POWER]
    spectrum = ((wavelength_nm, 1.0),) if settings.colours else ()
    groups = [list(group) for _, group in groupby(placed, key=lambda ray: ray.brightness)]
    sources = tuple(
        Rays(
            tuple(ray.origin for ray in group),
            tuple(ray.direction for ray in group),
            power=group[0].brightness * len(group),
            spectrum=spectrum,
        )
        for group in groups
    )
    return sources, tuple(ray.fresh for ray in placed)


def _per_turn(density: float) -> int:
    """Return the number of directions in 360 degrees."""
    count = int(min(density * PER_TURN, MAX_RAYS + 1.0))
    if count <= 0:
        raise UnreadableError(None, "would have no rays, because the ray density of the scene is too low")
    if count > MAX_RAYS:
        raise UnreadableError("brightness", f"would have more than {MAX_RAYS} rays")
    return count


def _single_ray(fields: Fields, settings: SourceSettings) -> list[PlacedRay]:  # noqa: ARG001  one of several
    origin, other = fields.point("p1"), fields.point("p2")
    if origin == other:
        raise UnreadableError("p2", "is the same point as p1")
    return [PlacedRay(origin, minus(other, origin), fields.number_of("brightness", 1.0, least=0.0), fresh=True)]


def _direction(angle: float) -> Point:
    """Return the direction at an angle from the +y axis of the file, which points down."""
    return (math.sin(angle), -math.cos(angle))


def _angles(start: float, end: float, step: float) -> Iterator[float]:
    """Yield angles, each one step after the previous one."""
    angle = start
    while angle < end:
        yield angle
        angle += step


def _point_source(fields: Fields, settings: SourceSettings) -> list[PlacedRay]:
    """Place rays in all directions from a point."""
    origin = (fields.number_of("x"), -fields.number_of("y"))
    brightness = fields.number_of("brightness", 0.5, least=0.0)
    density = settings.density_for(lambda d: brightness / d)
    step = math.tau / _per_turn(density)
    first = -2.0 * step + 1e-6 if settings.observed else 0.0
    ray_brightness = min(brightness / density, 1.0)
    angles = _angles(first, math.tau - END_MARGIN_RAD, step)
    return [PlacedRay(origin, _direction(angle), ray_brightness, fresh=angle == first) for angle in angles]


def _angle_source(fields: Fields, settings: SourceSettings) -> list[PlacedRay]:
    """Place rays from a point within an angle, centred on a line or starting from it."""
    origin, aim = fields.point("p1"), fields.point("p2")
    brightness, spread = (
        fields.number_of("brightness", 0.5, least=0.0),
        math.radians(fields.number_of("emisAngle", 36.001)),
    )
    symmetric = fields.flag("symmetric", True)
    density = settings.density_for(lambda d: brightness / d)
    step = math.tau / _per_turn(density)
    first = -2.0 * step + 1e-6 if settings.observed else 0.0
    start, end = (first - spread / 2.0, first + spread / 2.0) if symmetric else (first, first + spread)
    middle = math.atan2(origin[1] - aim[1], aim[0] - origin[0])
    ray_brightness = min(brightness / density, 1.0)
    return [
        PlacedRay(origin, (math.cos(angle + middle), -math.sin(angle + middle)), ray_brightness, fresh=angle == first)
        for angle in _angles(start, end - END_MARGIN_RAD, step)
    ]


def _beam(fields: Fields, settings: SourceSettings) -> list[PlacedRay]:
    """Place parallel rays from a line, a fan at each of its points, or random points and angles."""
    a, b = fields.point("p1"), fields.point("p2")
    if a == b:
        raise UnreadableError("p2", "is the same point as p1")
    brightness, half = (
        fields.number_of("brightness", 0.5, least=0.0),
        math.radians(fields.number_of("emisAngle", 0.0)) / 2.0,
    )
    lambert, random = fields.flag("lambert"), fields.flag("random")
    scale = settings.length_scale

    def fan(density: float) -> float:
        return 1.0 + 2.0 * math.floor(half / (math.tau / _per_turn(density)))

    density = settings.density_for(lambda d: brightness * scale / d / fan(d))
    count = math.dist(a, b) * density / scale
    if count * fan(density) > MAX_RAYS:
        raise UnreadableError(None, f"would have more than {MAX_RAYS} rays")
    normal = math.atan2(b[0] - a[0], a[1] - b[1]) + math.pi / 2.0
    ray_brightness = min(brightness * scale / density * (1.0 / fan(density)), 1.0)

    def ray_at(position: float, angle: float, fresh: bool = False) -> PlacedRay:
        origin = (a[0] + position * (b[0] - a[0]), a[1] + position * (b[1] - a[1]))
        return PlacedRay(
            origin, _direction(normal + angle), ray_brightness * (math.cos(angle) if lambert else 1.0), fresh
        )

    if random:
        if settings.seed is None:
            raise UnreadableError("random", "the scene has no randomSeed, so its rays differ on each run")
        draws = [(next(settings.numbers), next(settings.numbers)) for _ in range(math.ceil(count * fan(density)))]
        return [ray_at(u, (2.0 * v - 1.0) * half, fresh=i == 0) for i, (u, v) in enumerate(draws)]
    step = math.tau / _per_turn(density)
    angles = [0.0, *(sign * angle for angle in _angles(step, half, step) for sign in (1.0, -1.0))]
    return [ray_at((k + 0.5) / count, angle) for k in range(math.floor(count + 0.5)) for angle in angles]


EMISSIONS: dict[str, Emission] = {
    "SingleRay": _single_ray,
    "PointSource": _point_source,
    "AngleSource": _angle_source,
    "Beam": _beam,
}
