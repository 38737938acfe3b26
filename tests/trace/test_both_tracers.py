"""Behaviour of both tracers, the reference and the compiled engine."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.plane import Point, heading
from solen.scene import Beam, Fan, Interface, Monitor, Rays, Region, Scene, Source
from solen.scene.model import Behaviour
from solen.trace import Limits, Mode, Trace, trace, trace_reference
from solen.trace.result import MODES

Tracer = Callable[..., Trace]

AIR, GLASS, SMOKE = Region("air", 1.0), Region("glass", 1.5), Region("smoke", 1.0, 0.25)
UP = Rays(((0.0, -1.0),), ((0.0, 1.0),))
NORMAL = 0.04
"""Reflectance of glass at normal incidence."""
both_tracers = pytest.mark.parametrize("tracer", [trace, trace_reference], ids=["engine", "reference"])
modes = pytest.mark.parametrize("mode", MODES)
deterministic_modes = pytest.mark.parametrize("mode", ["count", "power"])


def line(
    name: str,
    z: float,
    left: str = "air",
    right: str = "air",
    behaviour: Behaviour = "refracting",
    receiver: str | None = None,
    half: float = 10.0,
) -> Interface:
    """Return a horizontal face at z, from −half to half, whose left side (the front of a receiver) is the upper one."""
    return Interface(name, Segment((-half, z), (half, z)), left, right, behaviour, receiver)


def scene(*interfaces: Interface, source: Source = UP, monitors: tuple[Monitor, ...] = ()) -> Scene:
    """Return a scene with unbounded media."""
    return Scene((AIR, GLASS, SMOKE), interfaces, (source,), monitors, open_media=True)


def slab(source: Source = UP, inside: str = "glass", *more: Interface) -> Scene:
    """Return a plate between z = 0 and z = 1."""
    return scene(line("front", 0.0, inside, "air"), line("back", 1.0, "air", inside), *more, source=source)


def box(source: Source, behaviour: Behaviour = "mirror", medium: str = "air") -> Scene:
    """Return a closed unit square with its interior on the left."""
    corners: list[Point] = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0)]
    sides = [Interface(f"side-{i}", Segment(corners[i], corners[i + 1]), medium, "air", behaviour) for i in range(4)]
    return scene(*sides, source=source)


def fates(result: Trace) -> tuple[float, float, float, float]:
    return (result.ledger.detected, result.ledger.escaped, result.ledger.absorbed, result.ledger.truncated)


@both_tracers
@modes
def test_rays_escape_from_an_empty_scene(tracer: Tracer, mode: Mode) -> None:
    result = tracer(scene(), mode)
    assert fates(result) == (0.0, 1.0, 0.0, 0.0)
    assert (result.mode, result.rays, result.hits, result.undefined) == (mode, 1, 0, 0)
    assert (result.detectors, result.monitors, result.undefined_at_mm) == ({}, {}, ())
    assert result.segments is None
    assert result.paths() == []


@both_tracers
@modes
def test_receiver_detects_on_its_left_and_absorbs_on_its_right(tracer: Tracer, mode: Mode) -> None:
    down = Rays(((0.0, 5.0),), ((0.0, -1.0),))
    eye = line("eye", 2.0, behaviour="receiver", receiver="eye")
    front, back = tracer(scene(eye, source=down), mode), tracer(scene(eye), mode)
    assert fates(front) == (1.0, 0.0, 0.0, 0.0)
    assert (front.detectors["eye"].power, front.detectors["eye"].rays) == (1.0, 1)
    assert fates(back) == (0.0, 0.0, 1.0, 0.0)
    assert (back.detectors["eye"].power, back.detectors["eye"].rays) == (0.0, 0)


@both_tracers
def test_receiver_with_two_faces(tracer: Tracer) -> None:
    low = Interface("low", Segment((1.0, 2.0), (-1.0, 2.0)), "air", "air", "receiver", "eye")
    high = Interface("high", Segment((3.0, 4.0), (1.5, 4.0)), "air", "air", "receiver", "eye")
    result = tracer(scene(high, low, source=Rays(((0.0, 0.0), (2.0, 0.0)), ((0.0, 1.0),) * 2, power=4.0)))
    assert (result.detectors["eye"].power, result.detectors["eye"].rays) == (1.0, 2)


@both_tracers
@modes
@pytest.mark.parametrize("down", [False, True])
def test_absorbing_face_absorbs_on_both_sides(tracer: Tracer, mode: Mode, down: bool) -> None:
    source = Rays(((0.0, 5.0),), ((0.0, -1.0),)) if down else UP
    assert fates(tracer(scene(line("wall", 2.0, behaviour="absorbing"), source=source), mode)) == (0.0, 0.0, 1.0, 0.0)


@both_tracers
@modes
@pytest.mark.parametrize("down", [False, True])
def test_mirror_reflects_on_both_sides(tracer: Tracer, mode: Mode, down: bool) -> None:
    ray = Rays(((0.0, 5.0),), ((0.6, -0.8),)) if down else Rays(((0.0, -1.0),), ((0.6, 0.8),))
    result = tracer(scene(line("wall", 2.0, "glass", "air", "mirror"), source=ray), mode, segments=True)
    (path,) = result.paths()
    assert path.exit_direction == pytest.approx((0.6, 0.8 if down else -0.8), abs=1e-15)
    assert path.fate == "escaped"
    assert path.interfaces == (0,)
    assert fates(result) == (0.0, 1.0, 0.0, 0.0)


@both_tracers
def test_counting_mode_refracts_without_splitting(tracer: Tracer) -> None:
    ray = Rays(((0.0, -1.0),), (heading(-30.0),))
    (path,) = tracer(slab(ray), segments=True).paths()
    inside = math.asin(0.5 / 1.5)
    assert path.points_mm[1] == pytest.approx([math.tan(math.radians(30)), 0.0], abs=1e-15)
    assert path.points_mm[2] == pytest.approx([math.tan(math.radians(30)) + math.tan(inside), 1.0], abs=1e-15)
    assert path.exit_direction == pytest.approx(heading(-30.0), abs=1e-15)
    assert path.interfaces == (0, 1)
    assert (path.ray, path.branch, path.power) == (0, 0, 1.0)


@both_tracers
def test_counting_mode_reflects_totally_above_the_critical_angle(tracer: Tracer) -> None:
    ray = Rays(((0.0, 0.5),), (heading(-50.0),))
    result = tracer(slab(ray), limits=Limits(max_hits=5), segments=True)
    assert fates(result) == (0.0, 0.0, 0.0, 1.0)
    assert result.hits == 5
    (path,) = result.paths()
    assert path.points_mm[1:, 1] == pytest.approx([1.0, 0.0, 1.0, 0.0, 1.0], abs=1e-14)
    assert path.fate == "truncated"
    assert path.exit_direction is None


@both_tracers
def test_incoherent_slab(tracer: Tracer) -> None:
    eye = line("eye", -2.0, behaviour="receiver", receiver="eye")
    result = tracer(slab(UP, "glass", eye), "power", Limits(min_weight=1e-12))
    assert result.detectors["eye"].power == pytest.approx(2 * NORMAL / (1 + NORMAL), abs=1e-11)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert result.ledger.escaped == pytest.approx((1 - NORMAL) / (1 + NORMAL), abs=1e-11)


@both_tracers
@pytest.mark.parametrize(("s_share", "reflected"), [(1.0, ((1.5**2 - 1) / (1.5**2 + 1)) ** 2), (0.0, 0.0)])
def test_polarisations_are_separate(tracer: Tracer, s_share: float, reflected: float) -> None:
    brewster_deg = math.degrees(math.atan(1.5))
    ray = Rays(((0.0, -1.0),), (heading(-brewster_deg),), s_share=s_share)
    eye = line("eye", -2.0, behaviour="receiver", receiver="eye")
    result = tracer(scene(line("front", 0.0, "glass", "air"), eye, source=ray), "power")
    assert result.detectors["eye"].power == pytest.approx(reflected, abs=1e-15)


@both_tracers
def test_roulette_follows_one_branch_with_all_power(tracer: Tracer) -> None:
    result = tracer(slab(Fan((0.0, -1.0), 0.0, 160.0, 40)), "roulette", segments=True)
    assert result.segments is not None
    assert not np.any(result.segments["branch"])
    assert result.segments["power_s"] + result.segments["power_p"] == pytest.approx(1 / 40, abs=1e-15)
    assert fates(result) == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=1e-14)
    upwards = sum(path.exit_direction is not None and path.exit_direction[1] > 0.0 for path in result.paths())
    assert 0 < upwards < 40


@pytest.mark.parametrize("s_share", [0.0, 0.5, 1.0])
def test_mean_of_roulette_agrees_with_splitting(s_share: float) -> None:
    """The difference for oblique light through a plate is within 5 standard errors."""
    eye = line("eye", 5.0, behaviour="receiver", receiver="eye", half=50.0)
    eye = dataclasses.replace(eye, curve=eye.curve.reversed())
    rays = 40_000
    plate = slab(Beam((-1.0, -1.0), (1.0, -1.0), 70.0, rays, s_share=s_share), "glass", eye)
    single = dataclasses.replace(plate, sources=(Beam((0.0, -1.0), (0.0, -1.0), 70.0, 1, s_share=s_share),))
    exact, reading = trace(single, "power").detectors["eye"].power, trace(plate, "roulette", seed=7).detectors["eye"]
    sigma = math.sqrt(exact * (1.0 - exact) / rays)
    assert 0.4 < exact < 0.999
    assert reading.power == pytest.approx(exact, abs=5.0 * sigma + 1e-6)
    assert 0.4 * sigma < reading.u_power < 2.0 * sigma  # from sixteen groups, with a relative error of about 0.2


def test_roulette_paths_depend_on_the_seed_but_not_on_the_tracer() -> None:
    plate = slab(Fan((0.0, -1.0), 0.0, 160.0, 300))
    paths = [
        [(path.ray, path.interfaces, path.fate) for path in tracer(plate, "roulette", seed=seed, segments=True).paths()]
        for tracer, seed in ((trace, 3), (trace_reference, 3), (trace, 4), (trace_reference, 4), (trace, 2**62))
    ]
    assert paths[0] == paths[1]
    assert paths[2] == paths[3]
    assert paths[0] != paths[2] != paths[4] != paths[0]


@both_tracers
def test_absorption_applies_except_in_counting_mode(tracer: Tracer) -> None:
    plate = slab(UP, "smoke")
    transmittance = math.exp(-0.25)
    for mode in ("power", "roulette"):
        expected = (0.0, transmittance, 1 - transmittance, 0.0)
        assert fates(tracer(plate, mode)) == pytest.approx(expected, abs=1e-15)
    assert fates(tracer(plate, "count")) == (0.0, 1.0, 0.0, 0.0)


@both_tracers
def test_light_in_an_unbounded_absorbing_medium_is_absorbed(tracer: Tracer) -> None:
    half_space = scene(line("front", 0.0, "smoke", "air"))
    for mode in ("power", "roulette"):
        assert fates(tracer(half_space, mode)) == (0.0, 0.0, 1.0, 0.0)
    assert fates(tracer(half_space, "count")) == (0.0, 1.0, 0.0, 0.0)


@both_tracers
@modes
@pytest.mark.parametrize("max_hits", [1, 2, 17])
def test_rays_are_truncated_after_max_hits(tracer: Tracer, mode: Mode, max_hits: int) -> None:
    result = tracer(box(Fan((0.31, 0.42), 10.0, 50.0, 9)), mode, Limits(max_hits=max_hits))
    assert fates(result) == pytest.approx((0.0, 0.0, 0.0, 1.0), abs=1e-15)
    assert result.hits == 9 * max_hits


@both_tracers
def test_branches_below_the_minimum_weight_are_truncated(tracer: Tracer) -> None:
    high = tracer(slab(), "power", Limits(min_weight=0.05))
    assert fates(high) == pytest.approx((0.0, 0.96 * 0.96, 0.0, NORMAL + 0.96 * NORMAL), abs=1e-15)
    low = tracer(slab(), "power", Limits(min_weight=1e-3))
    assert 0 < low.ledger.truncated < 0.002
    assert low.ledger.total == pytest.approx(1.0, abs=1e-14)


@both_tracers
def test_weights_are_relative_to_the_power_of_the_ray(tracer: Tracer) -> None:
    weak, strong = Fan((0.0, -1.0), 0.0, 1.0, 1, power=1e-9), Fan((0.0, -1.0), 0.0, 1.0, 3, power=9.0)
    result = tracer(dataclasses.replace(slab(weak), sources=(weak, strong)), "power")
    assert result.ledger.total == pytest.approx(1.0, abs=1e-14)
    assert result.ledger.truncated < 1e-5
    assert result.rays == 4


@both_tracers
@deterministic_modes
def test_undefined_rays_are_counted_and_located(tracer: Tracer, mode: Mode) -> None:
    inconsistent = scene(line("front", 0.0, "glass", "air"), line("back", 1.0, "air", "smoke"))
    result = tracer(inconsistent, mode, segments=True)
    assert result.undefined == 1
    assert len(result.undefined_at_mm) == 1
    assert result.undefined_at_mm[0] == pytest.approx((0.0, 1.0), abs=1e-15)
    expected = 1.0 if mode == "count" else 1 - NORMAL
    assert result.ledger.truncated == pytest.approx(expected, abs=1e-15)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-15)
    assert result.segments is not None
    assert 4 in result.segments["fate"]


@both_tracers
def test_at_most_sixteen_locations_are_stored(tracer: Tracer) -> None:
    faces = (line("front", 0.0, "glass", "air"), line("back", 1.0, "air", "smoke"))
    result = tracer(scene(*faces, source=Beam((-1.0, -1.0), (1.0, -1.0), 0.0, 40)))
    assert result.undefined == 40
    assert len(result.undefined_at_mm) == 16
    assert result.undefined_at_mm[0] == pytest.approx((-0.975, 1.0))


@both_tracers
def test_first_face_determines_the_medium_of_a_ray(tracer: Tracer) -> None:
    result = tracer(slab(Rays(((0.0, 0.5),), ((0.0, 1.0),))), "power", Limits(min_weight=1e-12))
    assert result.undefined == 0
    assert result.ledger.escaped == pytest.approx(1.0, abs=1e-11)


MONITOR = Monitor("m", (-2.0, 0.5), (2.0, 0.5), 4)


@both_tracers
@deterministic_modes
def test_monitor_reads_net_power_towards_its_left(tracer: Tracer, mode: Mode) -> None:
    plate = slab(Beam((-1.0, -1.0), (1.0, -1.0), 0.0, 8))
    without = tracer(plate, mode)
    reversed_monitor = Monitor("back", MONITOR.end, MONITOR.start, 4)
    result = tracer(dataclasses.replace(plate, monitors=(MONITOR, reversed_monitor)), mode)
    assert fates(result) == pytest.approx(fates(without), abs=1e-14)
    assert result.hits == without.hits
    forward, back = result.monitors["m"], result.monitors["back"]
    net = 1.0 if mode == "count" else (1 - NORMAL) / (1 + NORMAL)
    assert forward.power == pytest.approx(net, abs=2e-6)
    assert back.power == pytest.approx(-net, abs=2e-6)
    assert forward.power_by_bin == pytest.approx([0.0, net / 2, net / 2, 0.0], abs=2e-6)
    assert back.power_by_bin == pytest.approx(-forward.power_by_bin[::-1], abs=1e-15)
    assert forward.rays >= 8
    assert result.detectors == {}


@both_tracers
def test_bins_of_a_monitor_are_equal_and_end_at_its_ends(tracer: Tracer) -> None:
    monitor = Monitor("m", (0.0, 0.0), (3.0, 4.0), 5)
    rays = Rays(tuple((0.6 * t, 0.8 * t - 1.0) for t in (0.5, 1.5, 1.6, 4.5, 5.5)), ((0.0, 1.0),) * 5)
    result = tracer(scene(source=rays, monitors=(monitor,)))
    assert result.monitors["m"].power_by_bin == pytest.approx([0.2, 0.4, 0.0, 0.0, 0.2], abs=1e-15)
    assert result.monitors["m"].power == pytest.approx(0.8, abs=1e-15)
    assert result.monitors["m"].rays == 4


@both_tracers
def test_monitor_reads_the_power_remaining_at_its_position(tracer: Tracer) -> None:
    monitors = (MONITOR, Monitor("behind", (-2.0, 3.0), (2.0, 3.0)))
    crossed = tracer(dataclasses.replace(slab(UP, "smoke"), monitors=monitors), "power").monitors
    assert crossed["m"].power == pytest.approx(math.exp(-0.125), abs=1e-15)
    assert crossed["behind"].power == pytest.approx(math.exp(-0.25), abs=1e-15)
    assert crossed["behind"].power_by_bin.shape == (0,)


@both_tracers
def test_monitor_behind_a_wall_reads_zero(tracer: Tracer) -> None:
    wall = line("wall", 0.2, behaviour="absorbing")
    result = tracer(scene(wall, monitors=(MONITOR,)), "power")
    assert (result.monitors["m"].power, result.monitors["m"].rays) == (0.0, 0)


@both_tracers
@modes
def test_paths_of_all_branches(tracer: Tracer, mode: Mode) -> None:
    result = tracer(slab(Fan((0.0, -1.0), 0.0, 60.0, 6)), mode, Limits(min_weight=1e-3), segments=True)
    paths = result.paths()
    assert [(path.ray, path.branch) for path in paths] == sorted({(path.ray, path.branch) for path in paths})
    assert {path.ray for path in paths} == set(range(6))
    ends = {"escaped", "truncated"} if mode == "power" else {"escaped"}
    assert result.segments is not None
    for segment in result.segments:
        assert math.hypot(segment["dx"], segment["dz"]) == pytest.approx(1.0, abs=1e-12)
    for path in paths:
        assert path.fate in ends
        assert (path.exit_direction is None) == (path.fate != "escaped")
        for point, interface in zip(path.points_mm[1:], path.interfaces, strict=False):
            assert point[1] == pytest.approx(float(interface), abs=1e-12)  # front at 0, back at 1
    assert all(path.power == pytest.approx(1 / 6) for path in paths if path.branch == 0)


@both_tracers
def test_path_that_escapes_along_an_axis_causes_no_warning(tracer: Tracer) -> None:
    (path,) = tracer(scene(line("front", 0.0, "glass", "air")), segments=True).paths()
    assert path.points_mm.tolist() == [[0.0, -1.0], [0.0, 0.0]]
    assert path.exit_direction == (0.0, 1.0)


@both_tracers
def test_segments_add_up_to_the_ledger(tracer: Tracer) -> None:
    plate = slab(Fan((0.0, -1.0), 0.0, 60.0, 5), "glass", line("wall", 3.0, behaviour="absorbing"))
    result = tracer(plate, "power", segments=True)
    assert result.segments is not None
    power = result.segments["power_s"] + result.segments["power_p"]
    assert power[result.segments["fate"] == 3].sum() == pytest.approx(result.ledger.absorbed, abs=1e-12)
    assert power[result.segments["fate"] == 2].sum() == pytest.approx(result.ledger.escaped, abs=1e-12)


@both_tracers
@settings(max_examples=25, deadline=None)
@given(
    n=st.floats(1.0, 3.0),
    loss=st.floats(0.0, 2.0),
    axis=st.floats(-180, 180),
    radius=st.floats(0.2, 2.0),
    power=st.floats(0.1, 10),
    s_share=st.floats(0, 1),
)
def test_ledger_is_complete(
    tracer: Tracer, n: float, loss: float, axis: float, radius: float, power: float, s_share: float
) -> None:
    regions = (AIR, Region("ball", n, loss))
    ball = Interface("ball", Arc.circle((0.0, 0.0), radius), "ball", "air")
    eye = Interface("eye", Segment((3.0, 3.0), (-3.0, 3.0)), "air", "air", "receiver", "eye")
    source = Fan((0.5, -2.5), axis, 90.0, 7, power=power, s_share=s_share)
    for mode in MODES:
        result = tracer(Scene(regions, (ball, eye), (source,)), mode, Limits(max_hits=60))
        assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
        assert result.undefined == 0
        assert result.ledger.detected == pytest.approx(result.detectors["eye"].power, abs=1e-14)
        assert min(fates(result)) >= 0.0


@pytest.mark.parametrize("min_weight", [0.0, 1e-16, 1.0, -1e-6, math.nan, math.inf])
def test_refuses_invalid_min_weight(min_weight: float) -> None:
    with pytest.raises(DesignError, match="min_weight"):
        Limits(min_weight=min_weight)


@pytest.mark.parametrize("max_hits", [0, -3, math.nan, 2.5])
def test_refuses_invalid_max_hits(max_hits: int) -> None:
    with pytest.raises(DesignError, match="max_hits"):
        Limits(max_hits=max_hits)


@both_tracers
def test_refuses_unknown_mode(tracer: Tracer) -> None:
    with pytest.raises(DesignError, match="must be one of count, power"):
        tracer(scene(), "guess")


@both_tracers
def test_no_light_escapes_from_a_circular_mirror(tracer: Tracer) -> None:
    circle = Interface("c", Arc.circle((0.0, 0.0), 1.0), "air", "air", "mirror")
    sine, cosine = math.sin(math.radians(60)), math.cos(math.radians(60))
    triangle = Rays(((1 - 0.5 * sine, 0.5 * cosine),), ((-sine, cosine),))
    result = tracer(scene(circle, source=triangle), limits=Limits(max_hits=2000))
    assert result.ledger.escaped == 0.0


@both_tracers
def test_no_light_escapes_from_a_square_of_mirrors(tracer: Tracer) -> None:
    result = tracer(box(Fan((0.3, 0.4), 0.0, 360.0, 31)), limits=Limits(max_hits=1000))
    assert result.ledger.truncated == pytest.approx(1.0, abs=1e-12)
    assert result.undefined == 0


@pytest.mark.parametrize("z", [0.0, 1e-10])
def test_refuses_monitor_on_an_interface(z: float) -> None:
    with pytest.raises(DesignError, match="monitor m; must not overlap an interface, but lies on front"):
        scene(line("front", 0.0, "glass", "air"), monitors=(Monitor("m", (-9.0, z), (9.0, z)),))


@pytest.mark.parametrize("angle_deg", [-11.0, -7.0, -3.0, 3.0, 7.0, 11.0])
@pytest.mark.parametrize("offset_mm", [1e-6, -1e-6])
@both_tracers
def test_monitor_close_to_an_interface_counts_every_ray(tracer: Tracer, angle_deg: float, offset_mm: float) -> None:
    monitor = Monitor("m", (-9.0, offset_mm), (9.0, offset_mm))
    for rays in range(1, 40):
        fan = Fan((0.1, -1.0), angle_deg, 20.0, rays)
        half_space = scene(line("front", 0.0, "glass", "air"), source=fan, monitors=(monitor,))
        assert tracer(half_space).monitors["m"].rays == rays
