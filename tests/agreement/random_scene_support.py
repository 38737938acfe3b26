"""Random scenes with a seed: closed bodies of every curve, nested ones, mirrors, walls, receivers, monitors, sources.

Bodies stand in the cells of a grid, so that none cross: star-shaped polygons with straight, circular and parabolic
sides (some with a smaller body of another index within), circles, and lens bodies with a Cartesian oval in front.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from solen.curve import Arc, CartesianOval, Curve, Parabola, Segment
from solen.lens.optics import tangency
from solen.plane import Point, Rigid, along, left_of, minus, unit
from solen.scene import Beam, Fan, Interface, Monitor, Rays, Region, Scene
from solen.scene.model import Behaviour, Source

CELL_MM = 12.0
RECEIVERS = ("a", "b", "c")
BEHAVIOURS: tuple[Behaviour, ...] = ("refracting", "mirror", "absorbing", "receiver")
SHARES = (0.76, 0.08, 0.06, 0.10)


@dataclass
class Builder:
    """A scene in the making."""

    rng: np.random.Generator
    interfaces: list[Interface] = field(default_factory=list)
    regions: list[Region] = field(default_factory=lambda: [Region("air", 1.0)])
    corners: list[Point] = field(default_factory=list)

    def region(self) -> str:
        """Name of a new medium."""
        name = f"medium-{len(self.regions)}"
        loss = float(self.rng.choice([0.0, 0.002, 0.03]))
        self.regions.append(Region(name, float(self.rng.uniform(1.2, 1.9)), loss))
        return name

    def add(self, curve: Curve, inside: str, outside: str, behaviour: Behaviour | None = None) -> None:
        """An interface of a random behaviour, walked either way."""
        behaviour = behaviour or random_behaviour(self.rng)
        receiver = str(self.rng.choice(RECEIVERS)) if behaviour == "receiver" else None
        left, right = inside, outside
        if self.rng.random() < 0.5:
            curve, left, right = curve.reversed(), outside, inside
        self.interfaces.append(Interface(f"i{len(self.interfaces)}", curve, left, right, behaviour, receiver))


def random_behaviour(rng: np.random.Generator) -> Behaviour:
    """A behaviour by its share."""
    return BEHAVIOURS[int(rng.choice(len(BEHAVIOURS), p=SHARES))]


def side(rng: np.random.Generator, a: Point, b: Point) -> Curve:
    """A straight, circular or parabolic side from a to b, bulging by at most 8 % of its length."""
    kind = rng.choice(["segment", "arc", "parabola"])
    if kind == "segment":
        return Segment(a, b)
    chord = minus(b, a)
    length, axis = math.hypot(*chord), unit(chord)
    sag = float(rng.choice([-1, 1]) * rng.uniform(0.01, 0.08)) * length
    middle = along(along(a, axis, length / 2), left_of(axis), sag)
    if kind == "arc":
        return Arc.through(a, middle, b)
    return Parabola(middle, axis, sag / (length / 2) ** 2, -length / 2, length / 2)


def polygon(rng: np.random.Generator, center: Point, radius_mm: float) -> list[Point]:
    """Corners of a star-shaped polygon, counter-clockwise."""
    n = int(rng.integers(5, 9))
    angles = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * math.pi / n + rng.uniform(0, 2 * math.pi)
    radii = radius_mm * rng.uniform(0.75, 1.0, n)
    return [
        (center[0] + r * math.cos(a), center[1] + r * math.sin(a))
        for r, a in zip(radii.tolist(), angles.tolist(), strict=True)
    ]


def add_polygon(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """A polygon with curved sides; returns its medium."""
    inside = build.region()
    corners = polygon(build.rng, center, radius_mm)
    build.corners.extend(corners)
    for a, b in pairwise([*corners, corners[0]]):
        build.add(side(build.rng, a, b), inside, outside)
    return inside


def add_circle(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """A whole circle."""
    inside = build.region()
    build.add(Arc.circle(center, radius_mm), inside, outside, "refracting")
    return inside


def add_lens(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """An oval front, two flared parabolic sides and a straight back, turned at random: a cousin of the Y's stem."""
    inside = build.region()
    n2 = build.regions[-1].index
    image_mm = float(build.rng.uniform(8, 25))
    edge_deg = float(build.rng.uniform(0.4, 0.9)) * min(25.0, tangency(1.0, n2, 2.0, image_mm)[0])
    front = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, n2, 2.0, image_mm, edge_deg, -edge_deg)
    (left_x, left_z), (right_x, right_z) = front.start, front.end
    length = float(build.rng.uniform(0.5, 0.9)) * radius_mm
    flare = float(build.rng.uniform(-0.01, 0.02))
    right = Parabola((right_x, right_z), (0.0, 1.0), flare, 0.0, length)
    left = Parabola((left_x, left_z), (0.0, 1.0), -flare, length, 0.0)
    turn = Rigid.about((0.0, 2.0), float(build.rng.uniform(0, 360)))
    shift = Rigid(shift=(center[0], center[1] - 2.0))
    for curve in (front, right, Segment(right.end, left.start), left):
        placed = curve.moved(turn).moved(shift)
        build.corners.append(placed.start)
        build.add(placed, inside, outside, "refracting" if curve is front else None)
    return inside


def add_body(build: Builder, center: Point) -> None:
    """A body in its cell, perhaps with another one within."""
    kind = build.rng.choice(["polygon", "polygon", "circle", "lens"])
    radius_mm = float(build.rng.uniform(3.5, 5.0))
    if kind == "lens":
        add_lens(build, center, radius_mm, "air")
        return
    add = add_polygon if kind == "polygon" else add_circle
    inside = add(build, center, radius_mm, "air")
    if build.rng.random() < 0.6:
        within = add_circle if build.rng.random() < 0.5 else add_polygon
        core = within(build, center, 0.35 * radius_mm, inside)
        if build.rng.random() < 0.3:
            add_circle(build, center, 0.1 * radius_mm, core)


def add_walls(build: Builder) -> None:
    """Open mirrors, walls and receivers around the bodies, and mostly a box that closes the scene."""
    reach = CELL_MM * 1.75  # bodies reach 17 mm, an inward bulge takes 8 % of 42 mm
    box = [(-reach, -reach), (reach, -reach), (reach, reach), (-reach, reach)]
    for a, b in pairwise([*box, box[0]]):
        if build.rng.random() < 0.6:
            behaviour = BEHAVIOURS[int(build.rng.integers(1, 4))]
            build.add(side(build.rng, a, b), "air", "air", behaviour)


def sources(build: Builder, rays: int, nearest_corner_mm: float) -> tuple[Source, ...]:
    """Fans outside and inside bodies, a beam, and rays aimed at corners."""
    rng = build.rng
    inside: Point = (float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.1, 0.1)))
    outside: Point = (CELL_MM / 2 + float(rng.uniform(-0.3, 0.3)), CELL_MM / 2 + float(rng.uniform(-0.3, 0.3)))
    s_share = float(rng.uniform(0, 1))
    targets = [build.corners[int(rng.integers(len(build.corners)))] for _ in range(rays)]
    aims = [aimed(rng, outside, corner, nearest_corner_mm) for corner in targets]
    return (
        Fan(inside, float(rng.uniform(0, 360)), 360.0, rays),
        Fan(outside, float(rng.uniform(0, 360)), 360.0, rays, 2.0, s_share),
        Beam((-CELL_MM, -CELL_MM * 1.4), (CELL_MM, -CELL_MM * 1.4), float(rng.uniform(-30, 30)), rays, 0.5),
        Rays((outside,) * rays, tuple(aims), 0.3, s_share),
    )


def aimed(rng: np.random.Generator, origin: Point, corner: Point, nearest_mm: float) -> Point:
    """Direction that misses a corner by ``nearest_mm`` to 1e-3 mm, on either side."""
    direction = unit(minus(corner, origin))
    miss_mm = float(rng.choice([-1, 1]) * 10 ** rng.uniform(math.log10(nearest_mm), -3))
    return minus(along(corner, left_of(direction), miss_mm), origin)


def random_scene(seed: int, rays: int, nearest_corner_mm: float = 1e-8) -> Scene:
    """Scene of that number, ``rays`` rays from each of its four sources; one of them aims at corners, to miss them."""
    build = Builder(np.random.default_rng(seed))
    add_body(build, (0.0, 0.0))
    add_polygon(build, (-CELL_MM, CELL_MM), 4.0, "air")
    for x, z in ((1, 0), (1, 1), (0, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)):
        if build.rng.random() < 0.35:
            add_body(build, (x * CELL_MM, z * CELL_MM))
    add_walls(build)
    heights = build.rng.uniform(-15, 15, (3, 2)).tolist()
    monitors = tuple(
        Monitor(f"m{i}", (-20.0, a), (20.0, b), bins)
        for i, ((a, b), bins) in enumerate(zip(heights, (0, 7, 50), strict=True))
    )
    return Scene(
        tuple(build.regions),
        tuple(build.interfaces),
        sources(build, rays, nearest_corner_mm),
        monitors,
        f"random {seed}",
    )
