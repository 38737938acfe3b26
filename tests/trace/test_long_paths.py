"""Rays with many hits, from far away, at grazing incidence, and with many branches, in both tracers."""

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
both_tracers = pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])


def mirror_circle(source: Source, center: Point = (0.0, 0.0), radius_mm: float = 1.0, half: bool = False) -> Scene:
    """Return a circular mirror, made of one arc or of two halves."""
    arcs = [Arc(center, radius_mm, 0.0, 180.0), Arc(center, radius_mm, 180.0, 180.0)]
    curves = arcs if half else [Arc.circle(center, radius_mm)]
    mirrors = tuple(Interface(f"c{i}", curve, "air", "air", "mirror") for i, curve in enumerate(curves))
    return Scene((AIR,), mirrors, (source,))


def check_trapped(result: Trace, rays: int, hits: int) -> None:
    """Check that all rays are still inside after ``hits`` hits."""
    assert result.ledger.truncated == pytest.approx(1.0, abs=1e-12)
    assert (result.ledger.escaped, result.ledger.detected, result.ledger.absorbed) == (0.0, 0.0, 0.0)
    assert (result.hits, result.undefined) == (rays * hits, 0)


@pytest.mark.parametrize("half", [False, True])
@pytest.mark.parametrize(
    ("center", "radius_mm"), [((0.0, 0.0), 1.0), ((31.7, -12.9), 0.8), ((0.1, 0.2), 1e-3), ((-3.0, 7.0), 500.0)]
)
def test_ten_thousand_reflections_in_a_circular_mirror(center: Point, radius_mm: float, half: bool) -> None:
    source = Fan((center[0] + 0.3 * radius_mm, center[1] + 0.2 * radius_mm), 0.0, 360.0, 300)
    check_trapped(trace(mirror_circle(source, center, radius_mm, half), limits=Limits(max_hits=10_000)), 300, 10_000)


@pytest.mark.parametrize("half", [False, True])
def test_ten_thousand_reflections_in_the_reference(half: bool) -> None:
    source = Fan((0.3, 0.2), 0.0, 360.0, 3)
    check_trapped(trace_reference(mirror_circle(source, half=half), limits=Limits(max_hits=10_000)), 3, 10_000)


@both_tracers
def test_rays_in_a_circle_stay_tangent_to_a_smaller_circle(tracer: Tracer) -> None:
    scene = mirror_circle(Fan((0.3, 0.2), 0.0, 360.0, 3), radius_mm=2.0)
    segments = tracer(scene, limits=Limits(max_hits=10_000), segments=True).segments
    assert segments is not None
    distance = segments["x_mm"] * segments["dz"] - segments["z_mm"] * segments["dx"]
    reflected = segments["hit"] > 0
    assert np.abs(np.hypot(segments["x_mm"], segments["z_mm"])[reflected] - 2.0).max() < 1e-12
    for ray in range(3):
        of_ray = distance[segments["ray"] == ray]
        assert len(of_ray) == 10_000
        assert np.abs(of_ray - of_ray[0]).max() < 1e-9


@both_tracers
def test_ten_thousand_total_reflections_in_a_ball(tracer: Tracer) -> None:
    ball = Interface("ball", Arc.circle((0.5, -0.5), 1.0), "glass", "air")
    rays = Rays(((1.45, -0.5), (0.5, 0.4)), (heading(0.0), heading(80.0)))
    check_trapped(tracer(Scene((AIR, GLASS), (ball,), (rays,)), limits=Limits(max_hits=10_000)), 2, 10_000)


DISTANCES_MM = [1e4, 1e6]
"""10 m and 1 km."""


def lens_scene(source: Source, front: CartesianOval = LENS.front) -> Scene:
    """Return the face of a lens with an absorbing plane behind it; the body is unbounded."""
    stop = Interface("stop", Segment((50.0, 15.0), (-50.0, 15.0)), "body", "body", "absorbing")
    regions = (AIR, Region("body", 1.44))
    return Scene(regions, (Interface("front", front, "body", "air"), stop), (source,), open_media=True)


@both_tracers
@pytest.mark.parametrize("distance_mm", DISTANCES_MM)
@pytest.mark.parametrize("angle_deg", [0.0, 5.0, -20.0])
def test_hits_on_an_oval_from_far_away(tracer: Tracer, distance_mm: float, angle_deg: float) -> None:
    dx, dz = heading(angle_deg)
    ends = [(x - distance_mm * dx, LENS.depth_mm - distance_mm * dz) for x in (-1.9, 1.9)]
    result = tracer(lens_scene(Beam(ends[0], ends[1], angle_deg, 101)), segments=True)
    assert result.undefined == 0
    assert result.hits == 202
    assert result.ledger.absorbed == pytest.approx(1.0, abs=1e-14)
    for path in result.paths():
        assert path.interfaces == (0, 1)
        x, z = path.points_mm[1]
        assert z == pytest.approx(float(LENS.z_mm(x)), abs=1e-9)


@both_tracers
@pytest.mark.parametrize("distance_mm", DISTANCES_MM)
def test_hits_on_an_oval_from_inside_from_far_away(tracer: Tracer, distance_mm: float) -> None:
    """The rays start behind the focus and leave the body through its face."""
    scene = lens_scene(Beam((-1.9, distance_mm), (1.9, distance_mm), 180.0, 51))
    result = tracer(dataclasses.replace(scene, interfaces=scene.interfaces[:1]), segments=True)
    assert result.undefined == 0
    for path in result.paths():
        assert path.interfaces[0] == 0
        x, z = path.points_mm[1]
        assert z == pytest.approx(float(LENS.z_mm(x)), abs=1e-9)


@both_tracers
@pytest.mark.parametrize("distance_mm", DISTANCES_MM)
def test_rays_beside_an_oval_miss_it_from_far_away(tracer: Tracer, distance_mm: float) -> None:
    scene = lens_scene(Beam((2.001, -distance_mm), (40.0, -distance_mm), 0.0, 101))
    stop = Interface("stop", scene.interfaces[1].curve, "air", "air", "absorbing")
    result = tracer(dataclasses.replace(scene, interfaces=(scene.interfaces[0], stop)))
    assert result.undefined == 0
    assert result.hits == 101  # on the absorbing plane only
    assert (result.ledger.escaped, result.ledger.detected) == (0.0, 0.0)


@both_tracers
@pytest.mark.parametrize(
    ("from_deg", "to_deg"), [(30.0, 10.0), (-5.0, -25.0), (20.0, -3.0), (-3.0, 20.0), (0.0, -30.0), (1.0, 0.5)]
)
def test_part_of_an_oval_is_met_between_its_ends(tracer: Tracer, from_deg: float, to_deg: float) -> None:
    piece = CartesianOval((0.0, 0.0), (0.0, 1.0), 1.0, 1.44, 1.0, 20.0, from_deg, to_deg)
    face = Interface("piece", piece, "air", "air", "absorbing")
    low, high = sorted((piece.start[0], piece.end[0]))
    lateral = [*np.linspace(-2.1, 2.1, 300), low - 1e-9, low + 1e-9, high - 1e-9, high + 1e-9]
    for height, dz in ((-3.0, 1.0), (8.0, -1.0)):  # from outside and from inside
        rays = Rays(tuple((float(x), height) for x in lateral), ((0.0, dz),) * len(lateral))
        result = tracer(Scene((AIR,), (face,), (rays,)), segments=True)
        absorbed = {path.ray for path in result.paths() if path.fate == "absorbed"}
        assert absorbed == {i for i, x in enumerate(lateral) if low < x < high}
    fan = Fan((0.0, -1.0), 0.0, 80.0, 800)  # none of its rays meets an end
    result = tracer(Scene((AIR,), (face,), (fan,)), segments=True)
    angles = 80.0 * ((np.arange(800) + 0.5) / 800 - 0.5)
    expected = set(np.flatnonzero((angles > min(from_deg, to_deg)) & (angles < max(from_deg, to_deg))).tolist())
    assert {path.ray for path in result.paths() if path.fate == "absorbed"} == expected


@both_tracers
@pytest.mark.parametrize("mode", ["count", "power"])
@pytest.mark.parametrize("n", [1.0, 1.44, 1.5])
@pytest.mark.parametrize("cosine", [1e-3, 1e-6, 1e-8, 1e-10, 1e-12])
def test_index_matching_does_not_deflect_grazing_rays(tracer: Tracer, mode: str, n: float, cosine: float) -> None:
    direction = (math.sqrt((1 - cosine) * (1 + cosine)), cosine)
    faces = (
        Interface("plane", Segment((-1.0, 0.0), (1.0, 0.0)), "upper", "lower"),
        Interface("ball", Arc.circle((0.0, 1.0 + 2.0 * cosine), 1.0), "upper", "upper"),
    )
    regions = (Region("upper", n), Region("lower", n))
    source = Rays(((-0.5, -0.5 * cosine),), (direction,))
    half_space = Scene(regions, faces[:1], (source,), open_media=True)
    result = tracer(half_space, mode, Limits(min_weight=1e-15), segments=True)
    assert result.ledger.escaped == 1.0
    assert result.ledger.truncated < 1e-30  # the reflected power is only rounding error
    (path,) = result.paths()
    assert path.interfaces == (0,)
    assert path.exit_direction is not None
    assert math.dist(path.exit_direction, direction) < 3e-16
    assert path.exit_direction[1] == pytest.approx(cosine, rel=1e-12)
    curved = tracer(Scene(regions, faces[1:], (Fan((-3.0, 0.0), -90.0, 60.0, 101),)), mode, segments=True)
    assert curved.ledger.escaped == pytest.approx(1.0, abs=1e-14)
    assert len(curved.paths()) == 101
    for path in curved.paths():
        assert path.exit_direction is not None
        assert math.dist(path.exit_direction, heading(-90.0 + 60.0 * ((path.ray + 0.5) / 101 - 0.5))) < 1e-14


def plates(source: Source, count: int, thickness_mm: float = 0.1) -> Scene:
    """Return a stack of glass plates with air gaps of the same thickness."""
    faces: list[Interface] = []
    ends: list[Interface] = []
    for i in range(count):
        low, high = 2 * i * thickness_mm, (2 * i + 1) * thickness_mm
        faces.append(Interface(f"front-{i}", Segment((-9.0, low), (9.0, low)), "glass", "air"))
        faces.append(Interface(f"back-{i}", Segment((-9.0, high), (9.0, high)), "air", "glass"))
        ends.append(Interface(f"right-{i}", Segment((9.0, low), (9.0, high)), "glass", "air"))
        ends.append(Interface(f"left-{i}", Segment((-9.0, high), (-9.0, low)), "glass", "air"))
    eye = Interface("eye", Segment((9.0, 8.0), (-9.0, 8.0)), "air", "air", "receiver", "eye")
    return Scene((AIR, GLASS), (*faces, eye, *ends), (source,))


def shells(source: Source, count: int = 3) -> Scene:
    """Return concentric balls with thin shells and alternating indices of 1 and 1.5."""
    regions = (AIR, *(Region(f"shell-{i}", 1.5 if i % 2 == 0 else 1.0) for i in range(count)))
    radii = [1.0 - 0.05 * i for i in range(count)]
    balls = [
        Interface(f"ball-{i}", Arc.circle((0.0, 0.0), radius), outer.name, inner.name)
        for i, (radius, (inner, outer)) in enumerate(zip(radii, pairwise(regions), strict=True))
    ]
    eye = Interface("eye", Segment((3.0, 3.0), (-3.0, 3.0)), "air", "air", "receiver", "eye")
    return Scene(regions, (*balls, eye), (source,))


@pytest.mark.parametrize("count", [1, 2])
def test_power_through_a_stack_of_plates(count: int) -> None:
    """N plates without interference transmit T = (1 − R)/(1 + (2 N − 1) R); 500 rays are split in blocks."""
    z = -0.5
    result = trace(plates(Beam((-5.0, z), (5.0, z), 0.0, 500), count), "power", Limits(min_weight=1e-12))
    single = trace_reference(plates(Rays(((0.0, z),), ((0.0, 1.0),)), count), "power", Limits(min_weight=1e-12))
    transmittance = (1 - 0.04) / (1 + (2 * count - 1) * 0.04)
    assert result.ledger.truncated < 1e-7
    assert result.ledger.total == pytest.approx(1.0, abs=1e-10)
    for traced in (single, result):
        assert traced.ledger.detected == pytest.approx(transmittance, abs=1e-7)
    assert result.hits == 500 * single.hits
    assert result.ledger.truncated == pytest.approx(single.ledger.truncated, abs=1e-12)


def test_rays_with_many_branches_agree_with_single_rays() -> None:
    origins = tuple((float(x), -2.0) for x in np.linspace(-1.05, 1.05, 200))
    limits = Limits(min_weight=1e-7)
    block = trace(shells(Rays(origins, ((0.0, 1.0),) * 200)), "power", limits)
    single = [trace(shells(Rays((origin,), ((0.0, 1.0),))), "power", limits) for origin in origins]
    assert block.undefined == 0
    assert block.hits == sum(result.hits for result in single)
    assert block.hits > 200 * 1000
    for fate in ("detected", "escaped", "absorbed", "truncated"):
        mean = math.fsum(getattr(result.ledger, fate) for result in single) / 200
        assert getattr(block.ledger, fate) == pytest.approx(mean, abs=1e-12)
    assert block.detectors["eye"].rays == sum(result.detectors["eye"].rays for result in single)
    for i in (60, 190):
        scene = shells(Rays((origins[i],), ((0.0, 1.0),)))
        reference, engine = (tracer(scene, "power", Limits(min_weight=1e-5)) for tracer in (trace_reference, trace))
        assert engine.hits == reference.hits
        assert engine.detectors["eye"].power == pytest.approx(reference.detectors["eye"].power, abs=1e-12)


@both_tracers
@pytest.mark.parametrize("mode", ["count", "power"])
def test_segments_are_ordered_by_ray_branch_and_hit(tracer: Tracer, mode: str) -> None:
    scene = shells(Fan((0.0, -2.0), 0.0, 60.0, 9))
    segments = tracer(scene, mode, Limits(min_weight=1e-3), segments=True).segments
    assert segments is not None
    order = [(int(segment["ray"]), int(segment["branch"]), int(segment["hit"])) for segment in segments]
    assert order == sorted(set(order))
    assert {ray for ray, _, _ in order} == set(range(9))
    for (ray, branch, hit), (next_ray, next_branch, next_hit) in pairwise(order):
        if (ray, branch) == (next_ray, next_branch):
            assert next_hit == hit + 1
        else:
            assert next_branch == (branch + 1 if ray == next_ray else 0)


@both_tracers
def test_counting_mode_has_one_branch_per_ray(tracer: Tracer) -> None:
    paths = tracer(shells(Fan((0.0, -2.0), 0.0, 60.0, 9)), segments=True).paths()
    assert [(path.ray, path.branch, path.parent) for path in paths] == [(ray, 0, -1) for ray in range(9)]


def branch_by_branch(segments: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    """Yield the segments of each branch."""
    new = (np.diff(segments["ray"]) != 0) | (np.diff(segments["branch"]) != 0)
    yield from np.split(segments, np.flatnonzero(new) + 1)


@both_tracers
def test_branch_starts_at_its_parent_with_part_of_its_power(tracer: Tracer) -> None:
    result = tracer(shells(Fan((0.1, -2.0), 3.0, 60.0, 7)), "power", Limits(min_weight=1e-4), segments=True)
    assert result.segments is not None
    branches = {
        (int(segments[0]["ray"]), int(segments[0]["branch"])): segments
        for segments in branch_by_branch(result.segments)
    }
    assert len(branches) > 70
    for (ray, branch), segments in branches.items():
        parent = int(segments[0]["parent"])
        assert set(segments["parent"]) == {parent}
        if branch == 0:
            assert parent == -1
            assert segments[0]["hit"] == 0
            continue
        assert 0 <= parent < branch
        of_parent = branches[ray, parent]
        hit = int(segments[0]["hit"])
        (before,) = of_parent[of_parent["hit"] == hit - 1]
        (after,) = of_parent[of_parent["hit"] == hit]
        end = (before["x_mm"] + before["length_mm"] * before["dx"], before["z_mm"] + before["length_mm"] * before["dz"])
        start = (float(segments[0]["x_mm"]), float(segments[0]["z_mm"]))
        assert math.dist(end, start) < 1e-12
        assert (after["x_mm"], after["z_mm"]) == start
        powers = [float(segment["power_s"] + segment["power_p"]) for segment in (before, after, segments[0])]
        assert powers[1] + powers[2] == pytest.approx(powers[0], rel=1e-12)  # the media do not absorb
        assert powers[1] >= powers[2]  # the stronger part keeps the branch number


@both_tracers
def test_paths_have_the_number_of_their_parent(tracer: Tracer) -> None:
    result = tracer(plates(Rays(((0.0, -0.5),), ((0.0, 1.0),)), 1), "power", Limits(min_weight=1e-4), segments=True)
    paths: dict[int, Path] = {path.branch: path for path in result.paths()}
    assert list(paths) == list(range(len(paths)))
    assert (paths[0].parent, paths[0].interfaces, paths[0].fate) == (-1, (0, 1, 2), "detected")
    assert paths[0].power == 1.0
    for branch, path in paths.items():
        if branch > 0:
            parent = paths[path.parent]
            assert parent.branch < branch
            assert path.power < parent.power
            assert path.points_mm[0].tolist() in parent.points_mm.tolist()
    reflected = [path.power for path in paths.values() if path.parent == 0]
    assert sorted(reflected) == pytest.approx([0.96 * 0.04, 0.04], abs=1e-15)
