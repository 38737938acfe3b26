"""Scenes of a peer, rebuilt by hand through the public API, give the readings that the peer's own tests hold it to.

Tolerances, per bin in units of the brightest ray and for the running sum along the detector as a share of what was
recorded:

* scenes without partial reflection have the same rays on both sides: 1e-9 of a ray;
* scenes with it: the peer drops every branch below 0.01 and makes up for it by sending every k-th one with k times the
  power, so that a branch of 0.01 may be in a bin too many or too few. Rays there carry 0.056 to 1, such a branch is up
  to 0.18 of a ray: 0.25 of a ray per bin, and 1e-3 for the running sum, in which they cancel.
"""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from solen.curve import Arc, Parabola, Segment
from solen.plane import Point, dot, minus, right_of, unit
from solen.scene import Interface, Region, Scene
from solen.trace import Limits, Mode, trace
from tests.outside.peer_support import AIR, Object, Peer, arc_or_line, ball, listed, load, outline, point, walls

Built = tuple[tuple[Region, ...], tuple[Interface, ...]]
SAME = (1e-9, 1e-12)
WEAK_BRANCHES = (0.25, 1e-3)
FINE = Limits(min_weight=1e-9)


def nothing(_: Peer) -> Built:
    """A source and a detector alone."""
    return (AIR,), ()


def aperture(peer: Peer) -> Built:
    """A wall with a hole in it."""
    (item,) = peer.objects("Aperture")
    halves = ((item["p1"], item["p3"]), (item["p4"], item["p2"]))
    return (AIR,), tuple(
        Interface(f"half-{i}", Segment(point(a), point(b)), "air", "air", "absorbing")
        for i, (a, b) in enumerate(halves)
    )


def black_disc(peer: Peer) -> Built:
    (item,) = peer.objects("CircleBlocker")
    return (AIR,), (dataclasses.replace(ball("disc", item, "air"), behaviour="absorbing"),)


def polygon(peer: Peer) -> Built:
    (item,) = peer.objects("Glass")
    return (AIR, Region("glass", item["refIndex"])), outline("glass", item["path"])


def bow_and_triangles(peer: Peer) -> Built:
    """A four-sided outline that crosses itself is two triangles that touch in its crossing; below, two triangles."""
    bow, *triangles = peer.objects("Glass")
    a, b, c, d = bow["path"]
    crossing = {"x": a["x"], "y": b["y"], "arc": False}
    paths = [[a, b, crossing], [crossing, c, d], *(item["path"] for item in triangles)]
    glasses = [side for i, path in enumerate(paths) for side in outline(f"glass-{i}", path)]
    return (AIR, Region("glass", 1.5)), (*walls(peer), *glasses)


def ball_in_a_block(peer: Peer) -> Built:
    """Above, a ball that fills a hollow of a block of its own index; below, the same shape as one glass."""
    (item,) = peer.objects("CircleGlass")
    block, whole = peer.objects("Glass")
    (x, z), r = point(item["p1"]), math.dist(point(item["p1"]), point(item["p2"]))
    outer = Arc.through((x, z - r), (x - r, z), (x, z + r))
    joint = Arc.through((x, z + r), (x + r, z), (x, z - r))
    assert (outer.sweep_deg > 0) == (joint.sweep_deg > 0)
    in_ball = ("glass", "air", "block") if outer.sweep_deg > 0 else ("air", "glass", "block")
    ball_sides = (
        Interface("outer", outer, in_ball[0], in_ball[1]),
        Interface("joint", joint, *(("glass", "block") if outer.sweep_deg > 0 else ("block", "glass"))),
    )
    block_sides = [side for side in outline("block", block["path"], "block") if not isinstance(side.curve, Arc)]
    regions = (AIR, Region("glass", 1.5), Region("block", 1.5))
    return regions, (*walls(peer), *ball_sides, *block_sides, *outline("whole", whole["path"]))


def rounds(peer: Peer) -> Built:
    """Circles, however the peer describes them."""
    circles = [ball(f"circle-{i}", item) for i, item in enumerate(peer.objects("CircleGlass"))]
    custom = [
        Interface(f"custom-{i}", between(point(item["p1"]), point(item["p2"])), "glass", "air")
        for i, item in enumerate(peer.objects("CustomGlass"))
    ]
    parametric = [
        Interface(f"param-{i}", Arc.circle(point(item["origin"]), 50.0), "glass", "air")
        for i, item in enumerate(peer.objects("ParamGlass"))
    ]
    paths = [item["path"] for item in (*peer.objects("Glass"), *peer.objects("SphericalLens"))]
    drawn = [side for i, path in enumerate(paths) for side in outline(f"path-{i}", path)]
    return (AIR, Region("glass", 1.5)), (*walls(peer), *circles, *custom, *parametric, *drawn)


def between(a: Point, b: Point) -> Arc:
    """Circle on a diameter."""
    return Arc.circle((0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])), math.dist(a, b) / 2)


def black_edge(peer: Peer, level: float, glass: tuple[float, float], sides: tuple[str, str]) -> list[Interface]:
    """A blocker along x at a level, on which a glass ends from one x to another; ``sides`` below and above it in z."""
    (item,) = [item for item in peer.objects("Blocker") if item["p1"]["y"] == level]
    (x0, x3), (x1, x2) = (item["p1"]["x"], item["p2"]["x"]), glass
    below, above = sides
    parts = ((x0, x1, "air", "air"), (x1, x2, above, below), (x2, x3, "air", "air"))
    return [
        Interface(f"blocker-{level}-{a}", Segment((a, level), (b, level)), left, right, "absorbing")
        for a, b, left, right in parts
    ]


def black_edges(peer: Peer, glass: tuple[float, float]) -> list[Interface]:
    """Blockers on the top, between and below two glasses one above the other."""
    low, middle, high = sorted(item["p1"]["y"] for item in peer.objects("Blocker"))
    return [
        *black_edge(peer, low, glass, ("air", "glass")),
        *black_edge(peer, middle, glass, ("glass", "glass")),
        *black_edge(peer, high, glass, ("glass", "air")),
    ]


def hollow_blocks(peer: Peer) -> Built:
    """Blocks of 1.25 with a round hole: a body of 0.8 times that, or a slit outline; blockers on the blocks' edges."""
    upper, lower = peer.objects("Glass")
    (hole,) = peer.objects("CircleGlass")
    xs = sorted({corner["x"] for corner in upper["path"]})
    levels = [sorted({corner["y"] for corner in upper["path"]}), [400.0, 480.0]]
    faces = [
        Interface(f"face-{x}-{a}", Segment((x, a), (x, b)), *(("air", "glass") if x == xs[0] else ("glass", "air")))
        for x in xs
        for a, b in levels
    ]
    round_corners = [point(corner) for corner in lower["path"] if corner["arc"]]
    holes = (ball("hole-0", hole, "hole", "glass"), Interface("hole-1", between(*round_corners), "hole", "glass"))
    regions = (AIR, Region("glass", upper["refIndex"]), Region("hole", upper["refIndex"] * hole["refIndex"]))
    return regions, (*black_edges(peer, (xs[0], xs[-1])), *faces, *holes)


def plano_convex(peer: Peer) -> Built:
    """A spherical lens, and the same as a glass with an arc; blockers on their flat edges."""
    paths = [item["path"] for item in (*peer.objects("SphericalLens"), *peer.objects("Glass"))]
    sides = [side for i, path in enumerate(paths) for side in outline(f"lens-{i}", path)]
    faces = [side for side in sides if side.curve.start[1] != side.curve.end[1]]
    return (AIR, Region("glass", 1.5)), (*black_edges(peer, (730.0, 780.0)), *faces)


def mirrors(peer: Peer) -> Built:
    """Straight, circular and colinear mirrors, and a parametric one of two half circles."""
    flat = [Segment(point(item["p1"]), point(item["p2"])) for item in peer.objects("Mirror")]
    bent = [*peer.objects("ArcMirror"), *peer.objects("ParabolicMirror")]
    curved = [arc_or_line(point(item["p1"]), point(item["p3"]), point(item["p2"])) for item in bent]
    halves = [half for item in peer.objects("ParamMirror") for half in half_circles(item)]
    made = [Interface(f"mirror-{i}", c, "air", "air", "mirror") for i, c in enumerate([*flat, *curved, *halves])]
    return (AIR,), (*walls(peer), *made)


def half_circles(item: Object) -> tuple[Arc, Arc]:
    """The peer's equations: 50 (cos t, sin t) up to π, then 25 (cos t − 1, sin t) up to 2π."""
    x, z = point(item["origin"])
    assert [piece["tMin"] for piece in item["pieces"]] == pytest.approx([0, math.pi])
    return Arc((x, z), 50.0, 0.0, 180.0), Arc((x - 25.0, z), 25.0, 180.0, 180.0)


def parabolic_mirror(peer: Peer) -> Built:
    (item,) = peer.objects("ParabolicMirror")
    a, b, vertex = (point(item[name]) for name in ("p1", "p2", "p3"))
    axis, half = unit(minus(b, a)), math.dist(a, b) / 2
    height = dot(minus(vertex, a), right_of(axis))
    return (AIR,), (
        Interface("mirror", Parabola(vertex, axis, -height / half**2, -half, half), "air", "air", "mirror"),
    )


SCENES: dict[str, tuple[Callable[[Peer], Built], Mode, tuple[float, float]]] = {
    "blocker/Aperture/default": (aperture, "count", SAME),
    "blocker/CircleBlocker/default": (black_disc, "count", SAME),
    "glass/Glass/partialReflect_off": (polygon, "count", SAME),
    "glass/Glass/weak": (polygon, "power", WEAK_BRANCHES),
    "glass/Glass/equiv_hole": (hollow_blocks, "power", WEAK_BRANCHES),
    "glass/Glass/equiv_nonsimple": (bow_and_triangles, "power", WEAK_BRANCHES),
    "glass/CircleGlass/equiv_merge": (ball_in_a_block, "power", WEAK_BRANCHES),
    "glass/CustomGlass/equiv_circle": (rounds, "power", WEAK_BRANCHES),
    "glass/ParamGlass/equiv_circle": (rounds, "power", WEAK_BRANCHES),
    "glass/SphericalLens/equiv_plano_convex": (plano_convex, "power", WEAK_BRANCHES),
    "mirror/ArcMirror/colinear": (mirrors, "count", SAME),
    "mirror/BeamSplitter/truncate_correctBrightness": (mirrors, "count", SAME),
    "mirror/ParabolicMirror/colinear": (mirrors, "count", SAME),
    "mirror/ParabolicMirror/parallel": (parabolic_mirror, "count", SAME),
    "mirror/ParamMirror/equiv_arc": (mirrors, "count", SAME),
    "lightSource/AngleSource/correctBrightness": (nothing, "count", SAME),
    "lightSource/AngleSource/symmetric": (nothing, "count", SAME),
    "lightSource/Beam/brightness": (nothing, "count", SAME),
    "lightSource/Beam/emisAngle": (nothing, "count", SAME),
    "lightSource/PointSource/brightness": (nothing, "count", SAME),
    "lightSource/SingleRay/brightness": (nothing, "count", SAME),
}


@pytest.mark.parametrize("name", SCENES)
def test_readings_are_those_that_the_peer_recorded(
    name: str, outside: Path, record_property: Callable[[str, object], None]
) -> None:
    build, mode, (rays, running) = SCENES[name]
    peer = load(outside, name)
    deviation = peer.compare(peer.scene(*build(peer)), mode, FINE)
    record_property("deviation", str(deviation))
    print(f"{name}: {deviation}")
    assert deviation.rays <= rays
    assert deviation.running <= running
    assert deviation.total <= running


def test_a_prism_of_colours(outside: Path) -> None:
    """321 rays of one wavelength each through a plane of Cauchy's index; none reflected to the detector."""
    peer = load(outside, "glass/PlaneGlass/cauchy")
    (plane,), (module,) = peer.objects("PlaneGlass"), peer.objects("ModuleObj")
    start, aim = (point(item) for item in module["points"])
    source = listed([(start, minus(aim, start))], module["params"]["brightness"] / 320)
    a, b = point(plane["p1"]), point(plane["p2"])
    along_it = unit(minus(b, a))
    far = [(a[0] + t * along_it[0], a[1] + t * along_it[1]) for t in (-1e4, 1e4)]
    read = np.zeros_like(peer.recorded)
    for wavelength_nm in range(380, 701):
        index = 1.5 + plane["cauchyB"] / (wavelength_nm * 1e-3) ** 2
        surface = Interface("plane", Segment(far[0], far[1]), "glass", "air")
        scene = Scene((AIR, Region("glass", index)), (surface,), (source,), peer.monitors(), open_media=True)
        read += peer.reading(scene, trace(scene, "power"))
    np.testing.assert_allclose(read, peer.recorded, rtol=1e-9, atol=1e-12)
