"""Scenes of ricktu288/ray-optics (at c5bf2e2) as numbers: its sources ray by ray, its detectors, its recorded readings.

The scenes are rebuilt by hand in the test from the numbers of the peer's JSON; what is here only says, once, how the
peer places rays and reads detectors. Its coordinates (x, y), y down, are used as (x, z): a reflection of the picture,
which changes no power.

Density d is ``rayModeDensity`` (0.1 where absent), scale l ``lengthScale``. A *beam* has rays every l/d along its line,
half a step from its first end; a *point source* has int(500 d) directions; each ray carries min(b/d, 1) (a beam's
min(b l/d, 1)), half of it in each polarisation. Under "correct brightness" d grows by 1/500 until nothing is cut to 1.
A *detector* counts power with the sign of ray × line, in bins of ``binSize`` from its first end, the last one cut off
at the line's end; recorded is the power of a bin divided by ``binSize``.
"""

import csv
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.curve import Arc, Curve, Segment
from solen.plane import Point, along, cross, minus, unit
from solen.scene import Interface, Monitor, Rays, Region, Scene
from solen.trace import Limits, Mode, Trace, trace

AIR = Region("air", 1.0)
Object = dict[str, Any]


@dataclass(frozen=True)
class Peer:
    """A scene of the peer: its JSON and the readings its own tests hold it to."""

    data: dict[str, Any]
    recorded: NDArray[np.float64]

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

    @property
    def bin_size(self) -> float:
        """Width of a bin of its only detector."""
        return float(self.objects("Detector")[0].get("binSize", 1))

    def sources(self) -> tuple[Rays, ...]:
        """All its sources."""
        kinds = {"Beam": beam, "PointSource": point_source, "AngleSource": angle_source, "SingleRay": single_ray}
        return tuple(kinds[item["type"]](self, item) for item in self.data["objs"] if item["type"] in kinds)

    def monitors(self) -> tuple[Monitor, ...]:
        """Its detector: the whole bins, and what is left of the line."""
        detector = self.objects("Detector")[0]
        start, end = point(detector["p1"]), point(detector["p2"])
        whole = math.floor(math.dist(start, end) / self.bin_size + 1e-9)
        last = along(start, unit(minus(end, start)), whole * self.bin_size)
        bins = Monitor("bins", start, last, whole)
        return (bins, Monitor("rest", last, end)) if math.dist(last, end) > 1e-6 else (bins,)

    def scene(self, regions: tuple[Region, ...], interfaces: tuple[Interface, ...]) -> Scene:
        """Scene of its sources and detector with the bodies given."""
        return Scene(regions, interfaces, self.sources(), self.monitors(), self.data["name"])

    def reading(self, scene: Scene, result: Trace) -> NDArray[np.float64]:
        """What solen reads, as the peer records it: power per length, positive along ray × line."""
        power = [*result.monitors["bins"].map]
        if "rest" in result.monitors:
            power.append(result.monitors["rest"].power)
        return -np.array(power) * scene.emitted / self.bin_size

    def compare(self, scene: Scene, mode: Mode, limits: Limits | None = None) -> "Deviation":
        """Trace and set against the record."""
        result = trace(scene, mode, limits)
        assert result.undefined == 0, result.undefined_at
        assert abs(result.ledger.total - 1) < 1e-12
        read = self.reading(scene, result)
        assert read.shape == self.recorded.shape
        off = read - self.recorded
        throughput = float(np.abs(self.recorded).sum())
        assert throughput > 0
        return Deviation(
            float(np.abs(off).max()) * self.bin_size / brightest(scene),
            float(np.abs(np.cumsum(off)).max()) / throughput,
            abs(float(off.sum())) / throughput,
        )


@dataclass(frozen=True)
class Deviation:
    """Largest deviation of a bin, in rays; of the running sum and of the total, as shares of all recorded power."""

    rays: float
    running: float
    total: float


def load(folder: Path, name: str) -> Peer:
    """Scene of that name under ``raytrace/ray-optics_scenes``."""
    place = folder / "raytrace" / "ray-optics_scenes" / name
    data = json.loads(place.with_suffix(".json").read_text(encoding="utf-8"))
    with place.with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return Peer(data, np.array([float(row["Irradiance"]) for row in rows]))


def point(item: Object) -> Point:
    """{x, y} as (x, z)."""
    return (float(item["x"]), float(item["y"]))


def brightest(scene: Scene) -> float:
    """Power of the brightest ray."""
    return max(source.power / source.rays for source in scene.sources)


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


def single_ray(_: Peer, item: Object) -> Rays:
    """One ray."""
    origin = point(item["p1"])
    return Rays((origin,), (minus(point(item["p2"]), origin),), item.get("brightness", 1.0))


def listed(rays: list[tuple[Point, Point]], each: float) -> Rays:
    """Rays of one brightness, at most 1."""
    origins, directions = zip(*rays, strict=True)
    return Rays(origins, directions, min(each, 1.0) * len(rays))


def wall(name: str, item: Object, left: str = "air", right: str = "air") -> Interface:
    """A blocker."""
    return Interface(name, Segment(point(item["p1"]), point(item["p2"])), left, right, "absorbing")


def walls(peer: Peer) -> tuple[Interface, ...]:
    """All blockers of a scene that stand in air."""
    return tuple(wall(f"blocker-{i}", item) for i, item in enumerate(peer.objects("Blocker")))


def outline(name: str, path: list[Object], inside: str = "glass", outside: str = "air") -> tuple[Interface, ...]:
    """A glass of straight and circular sides: corners, and points on arcs between two corners."""
    curves = _curves(path)
    area = sum(a[0] * b[1] - a[1] * b[0] for a, b in ((c.start, c.end) for c in curves)) + _bulges(curves)
    left, right = (inside, outside) if area > 0 else (outside, inside)
    return tuple(Interface(f"{name}-{i}", curve, left, right) for i, curve in enumerate(curves))


def ball(name: str, item: Object, inside: str = "glass", outside: str = "air") -> Interface:
    """A circle of the peer: centre and a point on it."""
    center, edge = point(item["p1"]), point(item["p2"])
    return Interface(name, Arc.circle(center, math.dist(center, edge)), inside, outside)


def arc_or_line(a: Point, middle: Point, b: Point) -> Curve:
    """Arc through three points; straight where they are on one line, as the peer has it."""
    straight = abs(cross(minus(middle, a), minus(b, a))) < 1e-9
    return Segment(a, b) if straight else Arc.through(a, middle, b)


def _curves(path: list[Object]) -> list[Curve]:
    curves: list[Curve] = []
    for i, item in enumerate(path):
        following, beyond = path[(i + 1) % len(path)], path[(i + 2) % len(path)]
        if item["arc"] or point(item) == point(following):
            continue
        if following["arc"]:
            curves.append(arc_or_line(point(item), point(following), point(beyond)))
        else:
            curves.append(Segment(point(item), point(following)))
    return curves


def _bulges(curves: list[Curve]) -> float:
    """Twice the area between arcs and their chords, positive where they bulge out of a counter-clockwise path."""
    total = 0.0
    for curve in curves:
        if isinstance(curve, Arc):
            sweep = math.radians(curve.sweep_deg)
            total += curve.radius_mm**2 * (sweep - math.sin(sweep))
    return total
