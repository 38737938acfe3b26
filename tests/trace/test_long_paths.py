"""Rays that meet very many interfaces, come from far away, graze, or split again and again; in both tracers."""

import dataclasses
import math
from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.curve import Arc, CartesianOval, Segment
from solen.lens import OvalLens
from solen.plane import Point, heading
from solen.scene import Beam, Fan, Interface, Rays, Region, Scene, Source
from solen.trace import Limits, Path, Trace, trace, trace_reference

Tracer = Callable[..., Trace]

AIR, GLASS = Region("air", 1.0), Region("glass", 1.5)
LENS = OvalLens(1.0, 20.0, 2.0, 1.44)
both = pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])


def mirror_circle(source: Source, center: Point = (0.0, 0.0), radius_mm: float = 1.0, half: bool = False) -> Scene:
    """Closed circle of mirror, of one arc or of two halves."""
    arcs = [Arc(center, radius_mm, 0.0, 180.0), Arc(center, radius_mm, 180.0, 180.0)]
    curves = arcs if half else [Arc.circle(center, radius_mm)]
    mirrors = tuple(Interface(f"c{i}", curve, "air", "air", "mirror") for i, curve in enumerate(curves))
    return Scene((AIR,), mirrors, (source,))


def kept(result: Trace, rays: int, hits: int) -> None:
    """All rays are still inside after so many hits."""
    assert result.ledger.truncated == pytest.approx(1.0, abs=1e-12)
    assert (result.ledger.escaped, result.ledger.detected, result.ledger.absorbed) == (0.0, 0.0, 0.0)
    assert (result.hits, result.undefined) == (rays * hits, 0)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize(
    ("center", "radius_mm"), [((0.0, 0.0), 1.0), ((31.7, -12.9), 0.8), ((0.1, 0.2), 1e-3), ((-3.0, 7.0), 500.0)]
)
def test_a_circle_of_mirror_keeps_a_fan_for_ten_thousand_hits(center: Point, radius_mm: float, half: bool) -> None:
    source = Fan((center[0] + 0.3 * radius_mm, center[1] + 0.2 * radius_mm), 0.0, 360.0, 1000)
    kept(trace(mirror_circle(source, center, radius_mm, half), limits=Limits(max_hits=10_000)), 1000, 10_000)


@pytest.mark.parametrize("half", [False, True])
def test_the_reference_keeps_the_rays_of_a_fan_for_ten_thousand_hits(half: bool) -> None:
    source = Fan((0.3, 0.2), 0.0, 360.0, 7)
    kept(trace_reference(mirror_circle(source, half=half), limits=Limits(max_hits=10_000)), 7, 10_000)


@both
def test_a_ray_in_a_circle_keeps_its_distance_from_the_centre_and_the_circle(tracer: Tracer) -> None:
    made = mirror_circle(Fan((0.3, 0.2), 0.0, 360.0, 5), radius_mm=2.0)
    legs = tracer(made, limits=Limits(max_hits=10_000), legs=True).legs
    assert legs is not None
    away = legs["x_mm"] * legs["dz"] - legs["z_mm"] * legs["dx"]
    on_it = legs["hit"] > 0
    assert np.abs(np.hypot(legs["x_mm"], legs["z_mm"])[on_it] - 2.0).max() < 1e-12
    for ray in range(5):
        mine = away[legs["ray"] == ray]
        assert len(mine) == 10_000
        assert np.abs(mine - mine[0]).max() < 1e-9


@both
def test_total_reflection_keeps_a_ray_in_a_ball_of_glass(tracer: Tracer) -> None:
    ball = Interface("ball", Arc.circle((0.5, -0.5), 1.0), "glass", "air")
    rays = Rays(((1.45, -0.5), (0.5, 0.4)), (heading(0.0), heading(80.0)))
    kept(tracer(Scene((AIR, GLASS), (ball,), (rays,)), limits=Limits(max_hits=10_000)), 2, 10_000)


FAR = [1e4, 1e6]
"""10 m and 1 km."""


def lens_scene(source: Source, front: CartesianOval = LENS.front) -> Scene:
    """A front of the lens, and a black plane inside it; the body behind the front is open."""
    stop = Interface("stop", Segment((50.0, 15.0), (-50.0, 15.0)), "body", "body", "absorbing")
    regions = (AIR, Region("body", 1.44))
    return Scene(regions, (Interface("front", front, "body", "air"), stop), (source,), open_media=True)


@both
@pytest.mark.parametrize("distance_mm", FAR)
@pytest.mark.parametrize("turn_deg", [0.0, 5.0, -20.0])
def test_an_oval_is_met_from_far_away(tracer: Tracer, distance_mm: float, turn_deg: float) -> None:
    dx, dz = heading(turn_deg)
    ends = [(x - distance_mm * dx, LENS.depth_mm - distance_mm * dz) for x in (-1.9, 1.9)]
    result = tracer(lens_scene(Beam(ends[0], ends[1], turn_deg, 101)), legs=True)
    assert result.undefined == 0
    assert result.hits == 202
    assert result.ledger.absorbed == pytest.approx(1.0, abs=1e-14)
    for path in result.paths():
        assert path.interfaces == (0, 1)
        x, z = path.points_mm[1]
        assert z == pytest.approx(float(LENS.z_mm(x)), abs=1e-9)


@both
@pytest.mark.parametrize("distance_mm", FAR)
def test_an_oval_is_met_from_inside_from_far_away(tracer: Tracer, distance_mm: float) -> None:
    """The light's way back: rays that leave the body by the front, from beyond the focus."""
    made = lens_scene(Beam((-1.9, distance_mm), (1.9, distance_mm), 180.0, 51))
    result = tracer(dataclasses.replace(made, interfaces=made.interfaces[:1]), legs=True)
    assert result.undefined == 0
    for path in result.paths():
        assert path.interfaces[0] == 0
        x, z = path.points_mm[1]
        assert z == pytest.approx(float(LENS.z_mm(x)), abs=1e-9)


@both
@pytest.mark.parametrize("distance_mm", FAR)
def test_a_line_beside_an_oval_far_away_misses_it(tracer: Tracer, distance_mm: float) -> None:
    beside = Beam((2.001, -distance_mm), (40.0, -distance_mm), 0.0, 101)
    made = lens_scene(beside)
    stop = Interface("stop", made.interfaces[1].curve, "air", "air", "absorbing")
    result = tracer(dataclasses.replace(made, interfaces=(made.interfaces[0], stop)))
    assert result.undefined == 0
    assert result.hits == 101  # the black plane alone
    assert (result.ledger.escaped, result.ledger.detected) == (0.0, 0.0)


@both
@pytest.mark.parametrize(
    ("from_deg", "to_deg"), [(30.0, 10.0), (-5.0, -25.0), (20.0, -3.0), (-3.0, 20.0), (0.0, -30.0), (1.0, 0.5)]
)
def test_a_piece_of_an_oval_stops_what_falls_between_its_ends(tracer: Tracer, from_deg: float, to_deg: float) -> None:
    piece = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, 20.0, from_deg, to_deg)
    black = Interface("piece", piece, "air", "air", "absorbing")
    low, high = sorted((piece.start[0], piece.end[0]))
    lateral = [*np.linspace(-2.1, 2.1, 300), low - 1e-9, low + 1e-9, high - 1e-9, high + 1e-9]
    for height, up in ((-3.0, 1.0), (8.0, -1.0)):  # from outside and from inside
        rays = Rays(tuple((float(x), height) for x in lateral), ((0.0, up),) * len(lateral))
        result = tracer(Scene((AIR,), (black,), (rays,)), legs=True)
        stopped = {path.ray for path in result.paths() if path.fate == "absorbed"}
        assert stopped == {i for i, x in enumerate(lateral) if low < x < high}
    fan = Fan((0.0, -1.0), 0.0, 80.0, 800)  # none of its rays meets an end
    result = tracer(Scene((AIR,), (black,), (fan,)), legs=True)
    angles = 80.0 * ((np.arange(800) + 0.5) / 800 - 0.5)
    within = set(np.flatnonzero((angles > min(from_deg, to_deg)) & (angles < max(from_deg, to_deg))).tolist())
    assert {path.ray for path in result.paths() if path.fate == "absorbed"} == within


@both
@pytest.mark.parametrize("mode", ["count", "power"])
@pytest.mark.parametrize("n", [1.0, 1.44, 1.5])
@pytest.mark.parametrize("cosine", [1e-3, 1e-6, 1e-8, 1e-10, 1e-12])
def test_matched_indices_let_a_grazing_ray_straight_on(tracer: Tracer, mode: str, n: float, cosine: float) -> None:
    direction = (math.sqrt((1 - cosine) * (1 + cosine)), cosine)
    faces = (
        Interface("flat", Segment((-1.0, 0.0), (1.0, 0.0)), "one", "other"),
        Interface("ball", Arc.circle((0.0, 1.0 + 2.0 * cosine), 1.0), "one", "one"),
    )
    regions = (Region("one", n), Region("other", n))
    source = Rays(((-0.5, -0.5 * cosine),), (direction,))
    half_space = Scene(regions, faces[:1], (source,), open_media=True)
    result = tracer(half_space, mode, Limits(min_weight=1e-15), legs=True)
    assert result.ledger.escaped == 1.0
    assert result.ledger.truncated < 1e-30  # what comes back is nothing but rounding
    (path,) = result.paths()
    assert path.interfaces == (0,)
    assert path.exit_direction is not None
    assert math.dist(path.exit_direction, direction) < 3e-16
    assert path.exit_direction[1] == pytest.approx(cosine, rel=1e-12)
    curved = tracer(Scene(regions, faces[1:], (Fan((-3.0, 0.0), -90.0, 60.0, 101),)), mode, legs=True)
    assert curved.ledger.escaped == pytest.approx(1.0, abs=1e-14)
    assert len(curved.paths()) == 101
    for path in curved.paths():
        assert path.exit_direction is not None
        assert math.dist(path.exit_direction, heading(-90.0 + 60.0 * ((path.ray + 0.5) / 101 - 0.5))) < 1e-14


def plates(source: Source, count: int, apart_mm: float = 0.1) -> Scene:
    """Plates of glass one above the other."""
    faces: list[Interface] = []
    ends: list[Interface] = []
    for i in range(count):
        low, high = 2 * i * apart_mm, (2 * i + 1) * apart_mm
        faces.append(Interface(f"front-{i}", Segment((-9.0, low), (9.0, low)), "glass", "air"))
        faces.append(Interface(f"back-{i}", Segment((-9.0, high), (9.0, high)), "air", "glass"))
        ends.append(Interface(f"right-{i}", Segment((9.0, low), (9.0, high)), "glass", "air"))
        ends.append(Interface(f"left-{i}", Segment((-9.0, high), (-9.0, low)), "glass", "air"))
    eye = Interface("eye", Segment((9.0, 8.0), (-9.0, 8.0)), "air", "air", "receiver", "eye")
    return Scene((AIR, GLASS), (*faces, eye, *ends), (source,))


def shells(source: Source, count: int = 3) -> Scene:
    """Balls in balls, of indices 1 and 1.5 in turn, closely nested."""
    regions = (AIR, *(Region(f"shell-{i}", 1.5 if i % 2 == 0 else 1.0) for i in range(count)))
    radii = [1.0 - 0.05 * i for i in range(count)]
    balls = [
        Interface(f"ball-{i}", Arc.circle((0.0, 0.0), radius), outer.name, inner.name)
        for i, (radius, (inner, outer)) in enumerate(zip(radii, pairwise(regions), strict=True))
    ]
    eye = Interface("eye", Segment((3.0, 3.0), (-3.0, 3.0)), "air", "air", "receiver", "eye")
    return Scene(regions, (*balls, eye), (source,))


@pytest.mark.parametrize("count", [1, 2])
def test_a_pile_of_plates_shares_power_as_its_closed_form_however_many_branches_wait(count: int) -> None:
    """Of 2 N faces without interference: T = (1 − R)/(1 + (2 N − 1) R); 500 rays split side by side."""
    eye = -0.5
    result = trace(plates(Beam((-5.0, eye), (5.0, eye), 0.0, 500), count), "power", Limits(min_weight=1e-12))
    one = trace_reference(plates(Rays(((0.0, eye),), ((0.0, 1.0),)), count), "power", Limits(min_weight=1e-12))
    through = (1 - 0.04) / (1 + (2 * count - 1) * 0.04)
    assert result.ledger.truncated < 1e-7
    assert result.ledger.total == pytest.approx(1.0, abs=1e-10)
    for reading in (one, result):
        assert reading.ledger.detected == pytest.approx(through, abs=1e-7)
    assert result.hits == 500 * one.hits
    assert result.ledger.truncated == pytest.approx(one.ledger.truncated, abs=1e-12)


def test_many_rays_that_split_often_are_each_what_they_are_alone() -> None:
    places = tuple((float(x), -2.0) for x in np.linspace(-1.05, 1.05, 200))
    limits = Limits(min_weight=1e-7)
    together = trace(shells(Rays(places, ((0.0, 1.0),) * 200)), "power", limits)
    alone = [trace(shells(Rays((place,), ((0.0, 1.0),))), "power", limits) for place in places]
    assert together.undefined == 0
    assert together.hits == sum(result.hits for result in alone)
    assert together.hits > 200 * 1000
    for part in ("detected", "escaped", "absorbed", "truncated"):
        mean = math.fsum(getattr(result.ledger, part) for result in alone) / 200
        assert getattr(together.ledger, part) == pytest.approx(mean, abs=1e-12)
    assert together.detectors["eye"].rays == sum(result.detectors["eye"].rays for result in alone)
    for i in (60, 190):
        truth = trace_reference(shells(Rays((places[i],), ((0.0, 1.0),))), "power", Limits(min_weight=1e-5))
        engine = trace(shells(Rays((places[i],), ((0.0, 1.0),))), "power", Limits(min_weight=1e-5))
        assert engine.hits == truth.hits
        assert engine.detectors["eye"].power == pytest.approx(truth.detectors["eye"].power, abs=1e-12)


@both
@pytest.mark.parametrize("mode", ["count", "power"])
def test_legs_are_in_the_order_of_ray_branch_and_hit(tracer: Tracer, mode: str) -> None:
    made = shells(Fan((0.0, -2.0), 0.0, 60.0, 9))
    legs = tracer(made, mode, Limits(min_weight=1e-3), legs=True).legs
    assert legs is not None
    order = [(int(leg["ray"]), int(leg["branch"]), int(leg["hit"])) for leg in legs]
    assert order == sorted(set(order))
    assert {ray for ray, _, _ in order} == set(range(9))
    for (ray, branch, hit), (next_ray, next_branch, next_hit) in pairwise(order):
        if (ray, branch) == (next_ray, next_branch):
            assert next_hit == hit + 1
        else:
            assert next_branch == (branch + 1 if ray == next_ray else 0)


@both
def test_counting_has_one_branch_a_ray_and_no_parents(tracer: Tracer) -> None:
    paths = tracer(shells(Fan((0.0, -2.0), 0.0, 60.0, 9)), legs=True).paths()
    assert [(path.ray, path.branch, path.parent) for path in paths] == [(ray, 0, -1) for ray in range(9)]


def branch_by_branch(legs: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """Legs of one branch after the other."""
    new = (np.diff(legs["ray"]) != 0) | (np.diff(legs["branch"]) != 0)
    yield from np.split(legs, np.flatnonzero(new) + 1)


@both
def test_a_branch_begins_where_its_parent_was_split_and_takes_its_power_from_it(tracer: Tracer) -> None:
    result = tracer(shells(Fan((0.1, -2.0), 3.0, 60.0, 7)), "power", Limits(min_weight=1e-4), legs=True)
    assert result.legs is not None
    branches = {(int(legs[0]["ray"]), int(legs[0]["branch"])): legs for legs in branch_by_branch(result.legs)}
    assert len(branches) > 70
    for (ray, branch), legs in branches.items():
        parent = int(legs[0]["parent"])
        assert set(legs["parent"]) == {parent}
        if branch == 0:
            assert parent == -1
            assert legs[0]["hit"] == 0
            continue
        assert 0 <= parent < branch
        above = branches[ray, parent]
        split = int(legs[0]["hit"])
        (before,) = above[above["hit"] == split - 1]
        (after,) = above[above["hit"] == split]
        end = (before["x_mm"] + before["length_mm"] * before["dx"], before["z_mm"] + before["length_mm"] * before["dz"])
        start = (float(legs[0]["x_mm"]), float(legs[0]["z_mm"]))
        assert math.dist(end, start) < 1e-12
        assert (after["x_mm"], after["z_mm"]) == start
        powers = [float(leg["power_s"] + leg["power_p"]) for leg in (before, after, legs[0])]
        assert powers[1] + powers[2] == pytest.approx(powers[0], rel=1e-12)  # nothing is absorbed here
        assert powers[1] >= powers[2]  # the stronger part keeps the number


@both
def test_paths_tell_the_branch_they_were_split_off(tracer: Tracer) -> None:
    result = tracer(plates(Rays(((0.0, -0.5),), ((0.0, 1.0),)), 1), "power", Limits(min_weight=1e-4), legs=True)
    paths: dict[int, Path] = {path.branch: path for path in result.paths()}
    assert list(paths) == list(range(len(paths)))
    assert (paths[0].parent, paths[0].interfaces, paths[0].fate) == (-1, (0, 1, 2), "detected")
    assert paths[0].power == 1.0
    for branch, path in paths.items():
        if branch > 0:
            above = paths[path.parent]
            assert above.branch < branch
            assert path.power < above.power
            assert path.points_mm[0].tolist() in above.points_mm.tolist()
    backs = [path for path in paths.values() if path.parent == 0]
    assert sorted(path.power for path in backs) == pytest.approx([0.96 * 0.04, 0.04], abs=1e-15)
