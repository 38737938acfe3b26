"""How a peer, ricktu288/ray-optics at c5bf2e2, places its rays: a second reading of its rule, beside solen's own.

Its coordinates (x, y), y down, are used as (x, z). Density d is ``rayModeDensity`` (0.1 where absent), scale l
``lengthScale``. A *beam* has rays every l/d along its line, half a step from its first end; a *point source* has
int(500 d) directions; each ray carries min(b/d, 1) (a beam's min(b l/d, 1)), half of it in each polarisation. Under
"correct brightness" d grows by 1/500 until nothing is cut to 1.
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
class Peer:
    """A scene of the peer: its JSON."""

    data: dict[str, Any]

    def objects(self, kind: str) -> list[Object]:
        """Its objects of a kind, in order."""
        return [item for item in self.data["objs"] if item["type"] == kind]

    @property
    def density(self) -> float:
        """Rays per unit of length, and per 1/500 of a turn."""
        return float(self.data.get("rayModeDensity", 0.1))

    @property
    def scale(self) -> float:
        """Its length scale."""
        return float(self.data.get("lengthScale", 1.0))


def load(folder: Path, name: str) -> Peer:
    """Scene of that name under ``raytrace/ray-optics_scenes``."""
    place = folder / "raytrace" / "ray-optics_scenes" / f"{name}.json"
    return Peer(json.loads(place.read_text(encoding="utf-8")))


def point(item: Object) -> Point:
    """{x, y} as (x, z)."""
    return (float(item["x"]), float(item["y"]))


def beam(peer: Peer, item: Object) -> Rays:
    """Parallel beam, or one with a fan of angles at each place."""
    (x1, z1), (x2, z2) = point(item["p1"]), point(item["p2"])
    n = math.dist((x1, z1), (x2, z2)) * peer.density / peer.scale
    normal = math.atan2(x2 - x1, z2 - z1) + math.pi / 2
    half, step = math.radians(item.get("emisAngle", 0.0)) / 2, 2 * math.pi / int(peer.density * 500 or 1)
    angles = [
        0.0,
        *(k * step * sign for k in range(1, 1 + math.ceil(half / step)) for sign in (1, -1) if k * step < half),
    ]
    places = [(x1 + i * (x2 - x1) / n, z1 + i * (z2 - z1) / n) for i in (k + 0.5 for k in range(math.floor(n + 0.5)))]
    each = item.get("brightness", 0.5) * peer.scale / peer.density / (1 + 2 * math.floor(half / step))
    directions = [(math.sin(normal + angle), math.cos(normal + angle)) for angle in angles]
    return listed([(place, direction) for place in places for direction in directions], each)


def point_source(peer: Peer, item: Object) -> Rays:
    """All directions from a point."""
    count = int(peer.density * 500)
    angles = [2 * math.pi * k / count for k in range(count)]
    return listed(
        [(point(item), (math.sin(a), math.cos(a))) for a in angles], item.get("brightness", 0.5) / peer.density
    )


def angle_source(peer: Peer, item: Object) -> Rays:
    """Some directions from a point, about a line."""
    brightness = item.get("brightness", 0.5)
    density = peer.density
    while peer.data.get("colorMode", "default") != "default" and brightness / density > 1:
        density += 1 / 500
    origin, aim = point(item["p1"]), minus(point(item["p2"]), point(item["p1"]))
    half, step = math.radians(item["emisAngle"]) / 2, 2 * math.pi / int(density * 500)
    first = math.atan2(aim[1], aim[0]) - half
    angles = [first + k * step for k in range(math.ceil((2 * half - 1e-5) / step))]
    return listed([(origin, (math.cos(a), math.sin(a))) for a in angles], brightness / density)


def listed(rays: list[tuple[Point, Point]], each: float) -> Rays:
    """Rays of one brightness, at most 1."""
    origins, directions = zip(*rays, strict=True)
    return Rays(origins, directions, power=min(each, 1.0) * len(rays))
