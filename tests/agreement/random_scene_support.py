"""Seeded random scenes: closed and nested bodies, mirrors, walls, receivers, monitors and sources.

Each body is in a cell of a grid, so that no two intersect. Bodies are star-shaped polygons with straight and curved
sides (some with a smaller body of another index inside), circles, and lenses with a Cartesian oval in front.
`random_scene` has only straight, circular and parabolic sides and a single wavelength. `motley_scene` has every type of
curve, including closed splines with and without corners and lenses with two conic faces; every other scene has
dispersive media and sources with spectra.
"""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from solen.curve import Arc, Bezier, CartesianOval, Conic, Curve, Parabola, Segment, Spline
from solen.lens.optics import tangency
from solen.material.dispersion import Cauchy
from solen.plane import Point, Rigid, along, heading, left_of, minus, unit
from solen.scene import (
    AngleTable,
    Beam,
    Chip,
    Coating,
    Fan,
    Gaussian,
    Grating,
    HarveyShack,
    Interface,
    Lambertian,
    Layer,
    Monitor,
    Rays,
    Region,
    Scatter,
    ScatterTable,
    Scene,
    Surface,
    Texture,
)
from solen.scene.model import Behaviour
from solen.scene.sources import Line, Source

CELL_MM = 12.0
RECEIVERS = ("a", "b", "c")
BEHAVIOURS: tuple[Behaviour, ...] = ("refracting", "mirror", "absorbing", "receiver")
BEHAVIOUR_PROBABILITIES = (0.76, 0.08, 0.06, 0.10)
SIDES = ("segment", "arc", "parabola")
EVERY_SIDE = (*SIDES, "conic", "bezier", "spline")
LINES_NM = (450.0, 550.0, 633.0, 850.0)


@dataclass
class Builder:
    """The parts of a scene that is being built."""

    rng: np.random.Generator
    interfaces: list[Interface] = field(default_factory=list)
    regions: list[Region] = field(default_factory=lambda: [Region("air", 1.0)])
    corners: list[Point] = field(default_factory=list)
    sides: tuple[str, ...] = SIDES
    is_dispersive: bool = False

    def region(self) -> str:
        """Add a medium and return its name."""
        name = f"medium-{len(self.regions)}"
        loss = float(self.rng.choice([0.0, 0.002, 0.03]))
        index = float(self.rng.uniform(1.2, 1.9))
        self.regions.append(Region(name, Cauchy(A=index, B_um2=0.01) if self.is_dispersive else index, loss))
        return name

    def add(self, curve: Curve, inside: str, outside: str, behaviour: Behaviour | None = None) -> None:
        """Add an interface of a given or random behaviour, its curve reversed at random."""
        behaviour = behaviour or random_behaviour(self.rng)
        receiver = str(self.rng.choice(RECEIVERS)) if behaviour == "receiver" else None
        left, right = inside, outside
        if self.rng.random() < 0.5:
            curve, left, right = curve.reversed(), outside, inside
        self.interfaces.append(Interface(f"i{len(self.interfaces)}", curve, left, right, behaviour, receiver))


def random_behaviour(rng: np.random.Generator) -> Behaviour:
    """Return a behaviour, drawn with its probability."""
    return BEHAVIOURS[int(rng.choice(len(BEHAVIOURS), p=BEHAVIOUR_PROBABILITIES))]


def side(rng: np.random.Generator, a: Point, b: Point, kinds: tuple[str, ...] = SIDES) -> Curve:
    """Return a side from a to b that bulges by at most 8 % of its length."""
    kind = rng.choice(list(kinds))
    if kind == "segment":
        return Segment(a, b)
    chord = minus(b, a)
    length, axis = math.hypot(*chord), unit(chord)
    if kind == "conic":
        return conic_side(rng, a, b)
    if kind in {"bezier", "spline"}:
        count = 2 if kind == "bezier" else int(rng.integers(1, 6))
        positions = np.arange(1, count + 1) / (count + 1)
        offsets = rng.uniform(-0.08, 0.08, count) * min(1.0, 3.0 / count)
        inner = [
            along(along(a, axis, length * position), left_of(axis), length * offset)
            for position, offset in zip(positions.tolist(), offsets.tolist(), strict=True)
        ]
        return Bezier(a, inner[0], inner[1], b) if kind == "bezier" else Spline.through([a, *inner, b])
    sag = float(rng.choice([-1, 1]) * rng.uniform(0.01, 0.08)) * length
    middle = along(along(a, axis, length / 2), left_of(axis), sag)
    if kind == "arc":
        return Arc.through(a, middle, b)
    return Parabola(middle, axis, sag / (length / 2) ** 2, -length / 2, length / 2)


def conic_side(rng: np.random.Generator, a: Point, b: Point) -> Conic:
    """Return a random part of a random conic that bulges by at most 8 %, moved and scaled to run from a to b."""
    while True:
        curvature, constant = float(rng.choice([-1, 1])), float(rng.choice([rng.uniform(-4, 2), -1.0, 0.0]))
        middle, half = float(rng.uniform(-0.6, 0.6)), float(rng.uniform(0.05, 0.4))
        if abs(middle) + half < 0.9 / math.sqrt(max(1.0 + constant, 1.0)):
            curve = Conic((0.0, 0.0), (0.0, 1.0), curvature, constant, middle - half, middle + half)
            start, end = curve.start, curve.end
            across = np.asarray(left_of(unit(minus(end, start))))
            bulge = (curve.points(np.linspace(0, 1, 41)) - np.asarray(start)) @ across
            scale = math.dist(a, b) / math.dist(start, end)
            if np.max(np.abs(bulge)) * scale < 0.08 * math.dist(a, b):
                break
    (cx, cz), (gx, gz) = unit(minus(end, start)), unit(minus(b, a))
    rotation = Rigid(cx * gx + cz * gz, cx * gz - cz * gx)
    x, z = rotation.vector((scale * start[0], scale * start[1]))
    vertex = (a[0] - x, a[1] - z)
    axis = unit(rotation.vector((0.0, 1.0)))
    return Conic(vertex, axis, curvature / scale, constant, (middle - half) * scale, (middle + half) * scale)


def polygon(rng: np.random.Generator, center: Point, radius_mm: float) -> list[Point]:
    """Return the corners of a star-shaped polygon, counter-clockwise."""
    n = int(rng.integers(5, 9))
    angles = (np.arange(n) + rng.uniform(-0.3, 0.3, n)) * 2 * math.pi / n + rng.uniform(0, 2 * math.pi)
    radii = radius_mm * rng.uniform(0.75, 1.0, n)
    return [
        (center[0] + r * math.cos(a), center[1] + r * math.sin(a))
        for r, a in zip(radii.tolist(), angles.tolist(), strict=True)
    ]


def add_polygon(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """Add a polygon with curved sides and return its medium."""
    inside = build.region()
    corners = polygon(build.rng, center, radius_mm)
    build.corners.extend(corners)
    for a, b in pairwise([*corners, corners[0]]):
        build.add(side(build.rng, a, b, build.sides), inside, outside)
    return inside


def add_circle(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """Add a circle and return its medium."""
    inside = build.region()
    build.add(Arc.circle(center, radius_mm), inside, outside, "refracting")
    return inside


def add_lens(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """Add a body like the stem of a Y, rotated at random: an oval front, flared parabolic sides, a straight back."""
    inside = build.region()
    n2 = build.regions[-1].index_at(LINES_NM[0])
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


def add_outline(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """Add a body bounded by a closed spline, which is smooth or has the corners of a polygon with curved sides."""
    inside = build.region()
    corners = polygon(build.rng, center, radius_mm)
    if build.rng.random() < 0.5:
        curve = Spline.through(np.asarray(center) + 0.85 * (np.asarray(corners) - np.asarray(center)), closed=True)
    else:
        ends = zip(corners, [*corners[1:], corners[0]], strict=True)
        sides = [side(build.rng, a, b, ("bezier",)) for a, b in ends]
        controls = [control for curve in sides if isinstance(curve, Bezier) for control in curve.controls]
        curve = Spline((controls[0][0], *(point for control in controls for point in control[1:])))
        build.corners.extend(corners)
    build.add(curve, inside, outside)
    return inside


def add_conic_lens(build: Builder, center: Point, radius_mm: float, outside: str) -> str:
    """Add a lens with two conic faces, convex or concave, which meet in an edge or are joined by straight flanks."""
    inside, rng = build.region(), build.rng
    height = float(rng.uniform(0.5, 0.8)) * radius_mm
    faces = []
    for axis_z in (1.0, -1.0):
        constant = float(rng.choice([rng.uniform(-5, 1), -1.0, 0.0]))
        curvature = float(rng.uniform(0.05, 0.8)) / (height * math.sqrt(max(1.0 + constant, 1.0)))
        curvature *= float(rng.choice([1.0, 1.0, -0.5]))
        faces.append(Conic((0.0, 0.0), (0.0, axis_z), curvature, constant, -height, height))
    sags = [float(face.sag_mm(np.array(height))) for face in faces]
    flank = float(rng.choice([0.0, 0.3])) * radius_mm if sum(sags) > 0.5 else 0.5 * radius_mm
    thickness = sags[0] + flank + sags[1]
    front, back = (replace(face, vertex=(0.0, z)) for face, z in zip(faces, (0.0, thickness), strict=True))
    outline: list[Curve] = [front, back]
    if flank > 0.0:
        outline = [front, Segment(front.end, back.start), back, Segment(back.end, front.start)]
    turn = Rigid.about((0.0, 0.5 * thickness), float(rng.uniform(0, 360)))
    shift = Rigid(shift=(center[0], center[1] - 0.5 * thickness))
    for curve in outline:
        placed = curve.moved(turn).moved(shift)
        build.corners.append(placed.start)
        build.add(placed, inside, outside)
    return inside


def add_motley(build: Builder, center: Point) -> None:
    """Add a body of any kind in a cell, at random with another one inside."""
    kinds = (add_polygon, add_outline, add_conic_lens, add_lens, add_circle)
    kind = kinds[int(build.rng.choice(len(kinds), p=[0.4, 0.25, 0.15, 0.1, 0.1]))]
    radius_mm = float(build.rng.uniform(3.5, 5.0))
    inside = kind(build, center, radius_mm, "air")
    if kind in {add_polygon, add_circle, add_outline} and build.rng.random() < 0.5:
        add_inner = (add_outline, add_polygon, add_circle)[int(build.rng.integers(3))]
        add_inner(build, center, 0.35 * radius_mm, inside)


def add_body(build: Builder, center: Point) -> None:
    """Add a body in a cell, at random with others inside."""
    kind = build.rng.choice(["polygon", "polygon", "circle", "lens"])
    radius_mm = float(build.rng.uniform(3.5, 5.0))
    if kind == "lens":
        add_lens(build, center, radius_mm, "air")
        return
    add = add_polygon if kind == "polygon" else add_circle
    inside = add(build, center, radius_mm, "air")
    if build.rng.random() < 0.6:
        add_inner = add_circle if build.rng.random() < 0.5 else add_polygon
        core = add_inner(build, center, 0.35 * radius_mm, inside)
        if build.rng.random() < 0.3:
            add_circle(build, center, 0.1 * radius_mm, core)


def add_walls(build: Builder) -> None:
    """Add mirrors, absorbing walls and receivers on random sides of a square around the bodies."""
    half = CELL_MM * 1.75  # bodies extend to 17 mm, and a side bulges inwards by at most 8 % of 42 mm
    box = [(-half, -half), (half, -half), (half, half), (-half, half)]
    for a, b in pairwise([*box, box[0]]):
        if build.rng.random() < 0.6:
            behaviour = BEHAVIOURS[int(build.rng.integers(1, 4))]
            build.add(side(build.rng, a, b, build.sides), "air", "air", behaviour)


def sources(build: Builder, rays: int, nearest_corner_mm: float) -> tuple[Source, ...]:
    """Return fans outside and inside bodies, a beam, and rays that almost meet corners."""
    rng = build.rng
    inside: Point = (float(rng.uniform(-0.1, 0.1)), float(rng.uniform(-0.1, 0.1)))
    outside: Point = (CELL_MM / 2 + float(rng.uniform(-0.3, 0.3)), CELL_MM / 2 + float(rng.uniform(-0.3, 0.3)))
    s_share = float(rng.uniform(0, 1))
    targets = [build.corners[int(rng.integers(len(build.corners)))] for _ in range(rays)]
    aims = [aimed(rng, outside, corner, nearest_corner_mm) for corner in targets]
    return (
        Fan(inside, float(rng.uniform(0, 360)), 360.0, rays),
        Fan(outside, float(rng.uniform(0, 360)), 360.0, rays, power=2.0, s_share=s_share),
        Beam((-CELL_MM, -CELL_MM * 1.4), (CELL_MM, -CELL_MM * 1.4), float(rng.uniform(-30, 30)), rays, power=0.5),
        Rays((outside,) * rays, tuple(aims), power=0.3, s_share=s_share),
    )


def aimed(rng: np.random.Generator, origin: Point, corner: Point, nearest_mm: float) -> Point:
    """Return a direction that misses a corner by ``nearest_mm`` to 1e-3 mm, on either side."""
    direction = unit(minus(corner, origin))
    miss_mm = float(rng.choice([-1, 1]) * 10 ** rng.uniform(math.log10(nearest_mm), -3))
    return minus(along(corner, left_of(direction), miss_mm), origin)


def random_scene(seed: int, rays: int, nearest_corner_mm: float = 1e-8) -> Scene:
    """Return the scene of a seed, with four sources of ``rays`` rays each; those of one source almost meet corners."""
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


def motley_scene(seed: int, rays: int, nearest_corner_mm: float = 1e-8) -> Scene:
    """Return the scene of a seed with every type of curve and five sources of ``rays`` rays each."""
    rng = np.random.default_rng(seed)
    build = Builder(rng, sides=EVERY_SIDE, is_dispersive=bool(seed % 2))
    add_motley(build, (0.0, 0.0))
    add_polygon(build, (-CELL_MM, CELL_MM), 4.0, "air")
    for x, z in ((1, 0), (1, 1), (0, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)):
        if rng.random() < 0.35:
            add_motley(build, (x * CELL_MM, z * CELL_MM))
    add_walls(build)
    chip = Chip((6.1, -6.3), 0.8, float(rng.uniform(0, 360)), 200.0, rays, power=0.7, s_share=float(rng.uniform(0, 1)))
    all_sources: tuple[Source, ...] = (*sources(build, rays, nearest_corner_mm), chip)
    if build.is_dispersive:
        all_sources = tuple(replace(source, spectrum=_spectrum(rng)) for source in all_sources)
    heights = rng.uniform(-15, 15, (2, 2)).tolist()
    monitors = tuple(
        Monitor(f"m{i}", (-20.0, a), (20.0, b), bins)
        for i, ((a, b), bins) in enumerate(zip(heights, (0, 50), strict=True))
    )
    return Scene(tuple(build.regions), tuple(build.interfaces), all_sources, monitors, f"motley {seed}")


def treated_scene(seed: int, rays: int) -> Scene:
    """Return a motley scene with rough, coated, grey and textured surfaces, splitters and scattering media."""
    scene, rng = motley_scene(seed, rays), np.random.default_rng((seed, 77))
    sources = scene.sources
    if not scene.wavelengths_nm:
        sources = tuple(replace(source, spectrum=((633.0, 1.0),)) for source in sources)
    regions = tuple(
        replace(
            region, scattering_per_mm=float(rng.choice([0.0, 0.05, 0.2])), anisotropy=float(rng.uniform(-0.5, 0.95))
        )
        if region.name != "air"
        else region
        for region in scene.regions
    )
    interfaces = tuple(_treated(rng, interface) for interface in scene.interfaces)
    return replace(scene, sources=sources, regions=regions, interfaces=interfaces)


def _treated(rng: np.random.Generator, interface: Interface) -> Interface:
    """Return an interface with a random surface that its behaviour supports, or without one."""
    if rng.random() < 0.3:
        return interface
    low, high = (float(nm) for nm in rng.uniform(400.0, 900.0, 2))
    band = (low, high) if rng.random() < 0.3 else None
    if interface.behaviour in {"absorbing", "receiver"}:
        return replace(interface, surface=Surface(band_nm=band))
    one_medium = interface.left == interface.right
    scatters: list[Scatter | None] = [
        None,
        Lambertian(float(rng.random())),
        Gaussian(float(rng.uniform(0.01, 0.5)), float(rng.random())),
        HarveyShack(float(rng.uniform(0.01, 0.3)), float(rng.uniform(0.8, 4.0)), float(rng.random())),
        ScatterTable((0.0, 0.1, 0.4, 1.5), tuple(map(float, rng.uniform(0.1, 1.0, 4))), float(rng.random())),
    ]
    surface = Surface(
        reflectance=float(rng.uniform(0.3, 1.0)),
        transmitted=float(rng.random()),
        partial=bool(rng.random() < 0.8),
        band_nm=band,
        scatter=scatters[int(rng.integers(5))],
        texture=Texture(50.0, float(rng.uniform(0.0, 3.0))) if rng.random() < 0.3 else None,
    )
    if interface.behaviour == "mirror" and isinstance(interface.curve, Segment) and rng.random() < 0.5:
        focused = replace(surface, focal_mm=float(rng.choice([-8.0, 15.0])))
        return replace(interface, behaviour="lens" if one_medium else "mirror", surface=focused)
    if interface.behaviour == "mirror" and one_medium and rng.random() < 0.4:
        efficiencies = rng.dirichlet(np.ones(5)).tolist()
        orders = tuple(zip((0, 1, -1, 2), efficiencies, strict=False))
        grating = Grating(float(rng.uniform(200.0, 1500.0)), orders, bool(rng.random() < 0.5))
        return replace(interface, behaviour="grating", surface=Surface(grating=grating))
    if interface.behaviour == "mirror" and one_medium and rng.random() < 0.5:
        return replace(interface, behaviour="splitter", surface=surface)
    if interface.behaviour == "refracting" and rng.random() < 0.4:
        films = (Layer(float(rng.uniform(1.0, 2.5)), float(rng.uniform(0.0, 300.0)), float(rng.choice([0.0, 0.2]))),)
        surface = replace(surface, coating=Coating(films + (Layer(1.0, 120.0),) * int(rng.integers(2))))
    elif rng.random() < 0.4:
        tables = [_table(rng, is_transmitting=interface.behaviour == "refracting") for _ in range(2)]
        surface = replace(surface, table=tables[0], table_right=tables[1])
    return replace(interface, surface=surface)


def _table(rng: np.random.Generator, is_transmitting: bool) -> AngleTable:
    fractions = rng.dirichlet(np.ones(3), (2, 4))
    columns = [tuple(map(float, fractions[i, :, j])) for j in range(2) for i in range(2)]
    transmitted = columns[2:] if is_transmitting else [(), ()]
    return AngleTable((0.0, 20.0, 60.0, 90.0), columns[0], transmitted[0], columns[1], transmitted[1])


def _spectrum(rng: np.random.Generator) -> tuple[Line, ...]:
    """Return a spectrum of one to three lines."""
    lines = rng.choice(len(LINES_NM), int(rng.integers(1, 4)), replace=False)
    return tuple((LINES_NM[int(i)], float(rng.uniform(0.2, 1.0))) for i in sorted(lines))


def one_body(seed: int, rays: int) -> Scene:
    """Return a refracting body in a circular receiver; half of the rays start inside the body, half outside."""
    rng = np.random.default_rng(seed)
    build = Builder(rng, sides=EVERY_SIDE)
    add = (add_polygon, add_polygon, add_outline, add_conic_lens)[int(rng.integers(4))]
    inside = add(build, (0.0, 0.0), 5.0, "air")
    build.regions[-1] = Region(inside, float(rng.uniform(1.3, 1.7)))
    body = tuple(replace(face, behaviour="refracting", receiver=None) for face in build.interfaces)
    heading_deg = float(rng.uniform(0, 360))
    outside = along((0.0, 0.0), heading(heading_deg), -7.0)
    sources = (Fan((0.01, 0.02), 0.0, 360.0, rays // 2), Fan(outside, heading_deg, 90.0, rays - rays // 2))
    return Scene(tuple(build.regions), (*body, *curtains(0.2, inside), ring()), sources, name=f"body {seed}")


def curtains(inner_mm: float, inside: str) -> tuple[Interface, ...]:
    """Return two circles without optical effect: a ray that has crossed one has a known medium, so leaks show up."""
    inner, outer = (Arc.circle((0.0, 0.0), radius_mm) for radius_mm in (inner_mm, 6.5))
    return Interface("inner curtain", inner, inside, inside), Interface("outer curtain", outer, "air", "air")


def ring() -> Interface:
    """Return a circular receiver around the scene."""
    return Interface("ring", Arc.circle((0.0, 0.0), 8.0), "air", "air", "receiver", "ring")


def many_bodies(seed: int, along_x: int, along_z: int, rays: int) -> Scene:
    """Return a grid of cells, each with a small body of a random kind, and sources between and beside them."""
    rng = np.random.default_rng(seed)
    build = Builder(rng, sides=EVERY_SIDE)
    for i in range(along_x):
        for j in range(along_z):
            add_motley(build, (i * CELL_MM, j * CELL_MM))
    low, high = (-0.6 * CELL_MM, -0.6 * CELL_MM), ((along_x - 0.4) * CELL_MM, (along_z - 0.4) * CELL_MM)
    frame = [low, (high[0], low[1]), high, (low[0], high[1])]
    ends = zip(frame, [*frame[1:], frame[0]], strict=True)
    frames = tuple(
        Interface(f"f{i}", Segment(a, b), "air", "air", "receiver", "frame") for i, (a, b) in enumerate(ends)
    )
    start = ((along_x // 2 - 0.5) * CELL_MM, (along_z // 2 - 0.5) * CELL_MM)
    fans = (Fan(start, 0.0, 360.0, rays - rays // 2), Fan(along(low, (1.0, 1.0), 0.1), -45.0, 89.0, rays // 2))
    return Scene(tuple(build.regions), (*build.interfaces, *frames), fans, name=f"bodies {seed}")
