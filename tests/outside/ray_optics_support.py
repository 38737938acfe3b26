"""The rays of sources in the simulator ricktu288/ray-optics at c5bf2e2, implemented independently of solen's import.

Its coordinates (x, y), with y down, are used as (x, z). The density d is ``rayModeDensity`` (0.1 by default), the scale
l is ``lengthScale``. A *beam* has rays every l/d along its line, the first at half a step from its end; a *point
source* has int(500 d) directions. Each ray has the brightness min(b/d, 1), or min(b l/d, 1) in a beam, half of it in
each polarisation. With "correct brightness", d increases by 1/500 until no brightness is limited to 1.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from solen.plane import Point, minus
from solen.scene import Rays

Object = dict[str, Any]


@dataclass(frozen=True)
class SceneFile:
    """A scene file of ray-optics."""

    data: dict[str, Any]

    def objects(self, kind: str) -> list[Object]:
        """Return the objects of a kind, in order."""
        return [item for item in self.data["objs"] if item["type"] == kind]

    @property
    def density(self) -> float:
        """Rays per unit of length, or per 1/500 of a full turn."""
        return float(self.data.get("rayModeDensity", 0.1))

    @property
    def scale(self) -> float:
        """Length scale."""
        return float(self.data.get("lengthScale", 1.0))


def load(folder: Path, name: str) -> SceneFile:
    """Return the scene with a name in ``raytrace/ray-optics_scenes``."""
    path = folder / "raytrace" / "ray-optics_scenes" / f"{name}.json"
    return SceneFile(json.loads(path.read_text(encoding="utf-8")))


def point(item: Object) -> Point:
    """Return the coordinates {x, y} as (x, z)."""
    return (float(item["x"]), float(item["y"]))


def beam(scene: SceneFile, item: Object) -> Rays:
    """Return the rays of a parallel beam, or of a beam with a fan of angles at each point."""
    (x1, z1), (x2, z2) = point(item["p1"]), point(item["p2"])
    n = math.dist((x1, z1), (x2, z2)) * scene.density / scene.scale
    normal = math.atan2(x2 - x1, z2 - z1) + math.pi / 2
    half_angle, step = math.radians(item.get("emisAngle", 0.0)) / 2, 2 * math.pi / int(scene.density * 500 or 1)
    angles = [
        0.0,
        *(
            k * step * sign
            for k in range(1, 1 + math.ceil(half_angle / step))
            for sign in (1, -1)
            if k * step < half_angle
        ),
    ]
    origins = [(x1 + i * (x2 - x1) / n, z1 + i * (z2 - z1) / n) for i in (k + 0.5 for k in range(math.floor(n + 0.5)))]
    brightness = item.get("brightness", 0.5) * scene.scale / scene.density / (1 + 2 * math.floor(half_angle / step))
    directions = [(math.sin(normal + angle), math.cos(normal + angle)) for angle in angles]
    return rays_of([(origin, direction) for origin in origins for direction in directions], brightness)


def point_source(scene: SceneFile, item: Object) -> Rays:
    """Return the rays of a point source, in all directions."""
    count = int(scene.density * 500)
    angles = [2 * math.pi * k / count for k in range(count)]
    return rays_of(
        [(point(item), (math.sin(a), math.cos(a))) for a in angles], item.get("brightness", 0.5) / scene.density
    )


def angle_source(scene: SceneFile, item: Object) -> Rays:
    """Return the rays from a point within an angle about a line."""
    brightness = item.get("brightness", 0.5)
    density = scene.density
    while scene.data.get("colorMode", "default") != "default" and brightness / density > 1:
        density += 1 / 500
    origin, direction = point(item["p1"]), minus(point(item["p2"]), point(item["p1"]))
    half_angle, step = math.radians(item["emisAngle"]) / 2, 2 * math.pi / int(density * 500)
    start_angle = math.atan2(direction[1], direction[0]) - half_angle
    angles = [start_angle + k * step for k in range(math.ceil((2 * half_angle - 1e-5) / step))]
    return rays_of([(origin, (math.cos(a), math.sin(a))) for a in angles], brightness / density)


def rays_of(rays: list[tuple[Point, Point]], brightness: float) -> Rays:
    """Return rays of equal brightness, at most 1."""
    origins, directions = zip(*rays, strict=True)
    return Rays(origins, directions, power=min(brightness, 1.0) * len(rays))
