"""Integration in space against sampled rays, closed forms, and sources of another size."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.scene import Emitter, Extrusion, Interface, Region, Scene
from solen.scene.sources import Ambient
from solen.scene.sources.pattern import CosinePower, PatternTable
from solen.sensor import Sensor
from solen.spec import loads, template, value_at, with_values
from solen.trace import Limits, Trace, derivative, integrate, trace
from solen.trace.adaptive import Lights, why_not
from solen.trace.cells import Cell, Cells
from solen.trace.cone import DOUBLE
from solen.trace.kernel.family import at_angles, heading
from solen.trace.kernel.paths import add_rays, integrate_path, path_buffers, trace_rays
from solen.trace.kernel.prism import NO_DRAW
from solen.trace.space import LightInSpace

CHIP = {
    "trace.dimension": "extruded",
    "emitter.pattern": "lambertian",
    "emitter.width_mm": 0.2,
    "emitter.height_mm": 0.2,
    "emitter.cone_deg": 120.0,
}


def sensor(**values: Any) -> Sensor:
    """The shipped design with a square chip, in space."""
    return Sensor.of(
        with_values(loads(template("paper-860")), CHIP | {key.replace("__", "."): v for key, v in values.items()})
    )


def bar(source: Emitter, index: float = 1.5, height_mm: tuple[float, float] | None = None) -> Scene:
    """A bar 4 mm wide, 12 mm long and 3 mm thick with a receiver at its far end."""
    corners = [(-2.0, 0.0), (2.0, 0.0), (2.0, 12.0), (-2.0, 12.0)]
    front, right, end, left = (Segment(corners[i], corners[(i + 1) % 4]) for i in range(4))
    walls = [Interface(n, c, "bar", "air") for n, c in (("front", front), ("right", right), ("left", left))]
    receiver = Interface("end", end, "bar", "air", "receiver", "end", height_mm=height_mm)
    regions = (Region("air", 1.0), Region("bar", index))
    return Scene(regions, (*walls, receiver), (source,), extrusion=Extrusion(3.0))


def chip(**values: Any) -> Emitter:
    return Emitter((0.0, -1.0), 0.0, 2**16, **({"width_mm": 0.4, "height_mm": 0.4, "cone_deg": 140.0} | values))


def agrees(integrated: Trace, sampled: Trace, sigmas: float = 4.0) -> None:
    """Every power of both within their uncertainties."""
    for name, reading in integrated.detectors.items():
        other = sampled.detectors[name]
        assert abs(reading.power - other.power) <= sigmas * math.hypot(reading.u_power, other.u_power), name
    assert abs(integrated.ledger.escaped - sampled.ledger.escaped) <= sigmas * 2e-3


def contrast(found: Trace) -> float:
    right, left = (found.detectors[name].power for name in ("right", "left"))
    return (right - left) / (right + left)


@pytest.mark.parametrize(("angle_deg", "expected"), [(-1.0, 0.2786), (-3.0, 0.6535)])
def test_the_chip_of_the_paper_s_design(angle_deg: float, expected: float) -> None:
    """Sampling with 2^20 rays gives 0.2786 and 0.6535 within 0.0002."""
    found = sensor().integrate(angle_deg, tolerance=2e-4)
    assert found.reached
    assert found.method == "adaptive"
    assert contrast(found) == pytest.approx(expected, abs=1e-3)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-6)


def test_a_turn_to_the_other_side_exchanges_the_receivers() -> None:
    """The design is symmetric; the cells are halved differently."""
    right, left = (sensor().integrate(angle, tolerance=5e-4) for angle in (-2.0, 2.0))
    u = math.hypot(right.u_power, left.u_power)
    assert abs(right.detectors["right"].power - left.detectors["left"].power) <= 4.0 * u
    assert abs(right.detectors["left"].power - left.detectors["right"].power) <= 4.0 * u


@pytest.mark.parametrize(
    "source",
    [
        chip(),
        chip(pattern=CosinePower(3.0)),
        chip(pattern=PatternTable((0.0, 30.0, 60.0, 80.0), (1.0, 1.1, 0.4, 0.0))),
        chip(pattern=PatternTable((0.0, 20.0, 50.0, 80.0), (0.0, 0.5, 1.0, 0.2))),
        chip(width_mm=0.0),
        chip(width_mm=0.0, height_mm=0.0),
        chip(y_mm=0.6),
        chip(height_mm=4.0),
        chip(cone_deg=300.0),
        chip(spectrum=((500.0, 1.0), (600.0, 3.0))),
    ],
    ids=[
        "chip",
        "narrow",
        "table",
        "dark on its axis",
        "line",
        "point",
        "raised",
        "higher than the body",
        "sideways",
        "two colours",
    ],
)
def test_a_bar_before_any_emitter(source: Emitter) -> None:
    scene = bar(source)
    found = integrate(scene, tolerance=5e-4)
    assert found.reached
    agrees(found, trace(scene, "power", sampling="sobol"))


@pytest.mark.parametrize("height_mm", [(-0.5, 0.5), (-1.5, 0.2), (0.4, 1.2)])
def test_a_receiver_of_a_height(height_mm: tuple[float, float]) -> None:
    scene = bar(chip(cone_deg=60.0, height_mm=1.5), height_mm=height_mm)
    found = integrate(scene, tolerance=1e-3)
    assert found.reached
    agrees(found, trace(scene, "power", sampling="sobol"))


def test_what_leaks_through_top_and_bottom_of_a_weak_body() -> None:
    """n below √2: what has a steeper rise than √(n² − 1) gets out."""
    scene = bar(chip(cone_deg=150.0), index=1.25)
    found = integrate(scene, tolerance=1e-3)
    assert found.reached
    agrees(found, trace(scene, "power", sampling="sobol"))


@pytest.mark.parametrize(
    ("scene", "index", "absorption_per_mm", "extrusion"),
    [
        (bar(chip(height_mm=2.0, cone_deg=60.0), height_mm=(-0.2, 0.2)), (1.0, 1.5), (0.0, 0.1), Extrusion(3.0)),
        (bar(chip(cone_deg=100.0)), (1.0, 1.2), (0.0, 0.1), Extrusion(3.0)),
        (bar(chip(y_mm=0.2)), (1.0, 1.5), (0.0, 0.3), Extrusion(1.0, 1.3, 1.5)),
        (bar(chip()), (1.0, 1.5), (0.1, 0.1), Extrusion(3.0)),
        (bar(chip()), (1.33, 1.5), (0.0, 0.0), Extrusion(3.0, 1.0, 1.5)),
    ],
    ids=["past a receiver on both sides", "leaky", "leaky to one side", "in a dark medium", "matched below"],
)
def test_what_becomes_of_light_that_is_not_detected(
    scene: Scene, index: tuple[float, float], absorption_per_mm: tuple[float, float], extrusion: Extrusion
) -> None:
    """Light that leaves at top and bottom was absorbed up to there and no further."""
    air, body = (Region(*one) for one in zip(("air", "bar"), index, absorption_per_mm, strict=True))
    scene = replace(scene, regions=(air, body), extrusion=extrusion)
    found, sampled = integrate(scene, tolerance=5e-4), trace(scene, "power", sampling="sobol")
    assert found.reached
    agrees(found, sampled)
    for name in ("escaped", "absorbed"):
        assert getattr(found.ledger, name) == pytest.approx(getattr(sampled.ledger, name), abs=2e-3)
    assert found.missed == pytest.approx(sampled.missed, abs=2e-3)
    assert found.leaked == pytest.approx(sampled.leaked, abs=2e-3)


def test_counting_in_space() -> None:
    scene = bar(chip())
    found = integrate(scene, "count", 1e-3)
    agrees(found, trace(scene, "count", sampling="sobol"))


def test_a_source_between_upright_faces_sends_all_there() -> None:
    """A chip inside a box of receivers: everything arrives, in proportion to the solid angles."""
    corners = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)]
    walls = tuple(
        Interface(f"w{i}", Segment(corners[i], corners[(i + 1) % 4]), "inside", "outside", "receiver", f"w{i}")
        for i in range(4)
    )
    source = Emitter((0.0, 0.0), 0.0, 100, cone_deg=360.0)
    regions = (Region("inside", 1.0), Region("outside", 1.0))
    scene = Scene(regions, walls, (source,), extrusion=Extrusion(4.0))
    found = integrate(scene, tolerance=1e-4)
    for reading in found.detectors.values():
        assert reading.power == pytest.approx(1.0 / 6.0, abs=2e-4)  # the cube's faces share the sphere
    assert found.ledger.escaped == pytest.approx(1.0 / 3.0, abs=3e-4)


def test_stated_uncertainties_hold() -> None:
    """Errors against a close integral are as large as u says."""
    rng = np.random.default_rng(3)
    shares = []
    for _ in range(4):
        one = sensor(
            material__index=float(rng.uniform(1.42, 1.56)),
            emitter__width_mm=float(rng.uniform(0.05, 0.4)),
            emitter__offset_mm=float(rng.normal(0.0, 0.05)),
        )
        angle_deg = float(rng.uniform(-3.0, 3.0))
        close = one.integrate(angle_deg, tolerance=5e-5)
        wide = one.integrate(angle_deg, tolerance=1e-3)
        shares += [
            (wide.detectors[name].power - close.detectors[name].power) / wide.u_power for name in ("right", "left")
        ]
    assert math.sqrt(np.mean(np.square(shares))) < 1.5
    assert max(map(abs, shares)) < 4.0


def test_trapped_light_is_integrated_with_its_tail_sampled() -> None:
    design = sensor(receivers__coupling="air-gap", receivers__gap_mm=0.5)
    found = design.integrate(-1.0, tolerance=2e-3)
    assert found.reached
    assert found.ledger.truncated < 1e-6
    agrees(found, trace(design.scene(-1.0, 2**16), "power", sampling="sobol", limits=Limits(1e-7)))


def test_light_on_receivers_of_a_height_is_sampled() -> None:
    """Whether a ray out of the plane meets one is a matter of its angle to the last digit."""
    for height_mm in (0.0, 0.2):
        design = sensor(emitter__height_mm=height_mm, receivers__height_mm=1.0)
        found = design.integrate(-1.0, tolerance=2e-3)
        assert found.reached
        agrees(found, trace(design.scene(-1.0, 2**16), "power", sampling="sobol", limits=Limits(1e-7)), 3.0)


def test_a_response_in_space_is_integrated() -> None:
    response = sensor().power((-1.0, 1.0))
    assert [one.method for one in response.traces] == ["adaptive", "adaptive"]
    assert response.contrast[0] == pytest.approx(-response.contrast[1], abs=2e-3)


def test_what_cannot_be_integrated_in_space() -> None:
    scene = bar(chip())
    ambient = replace(scene, sources=(Ambient((0.0, 6.0), 20.0, 100),))
    assert "Ambient" in why_not(ambient)
    with pytest.raises(DesignError, match="Ambient"):
        integrate(ambient)
    with pytest.raises(DesignError, match="Ambient"):
        derivative(lambda _: ambient, 1.0)
    with pytest.raises(DesignError, match="cone_deg"):
        integrate(bar(chip(cone_deg=0.0)))


def test_a_cell_in_which_both_rules_agree_by_chance() -> None:
    """A triangle of n = 1.33: a close integral gives 0.71617."""
    corners = [(-2.0, 0.0), (2.5, 0.5), (0.3, 7.0)]
    front, end, left = (Segment(corners[i], corners[(i + 1) % 3]) for i in range(3))
    walls = [Interface(n, c, "bar", "air") for n, c in (("front", front), ("left", left))]
    receiver = Interface("end", end, "bar", "air", "receiver", "end")
    source = replace(chip(cone_deg=120.0), point=(0.2, -1.0))
    scene = Scene((Region("air", 1.0), Region("bar", 1.33)), (*walls, receiver), (source,), extrusion=Extrusion(3.0))
    found = integrate(scene, tolerance=3e-4)
    assert found.detectors["end"].power == pytest.approx(0.71617, abs=2.0 * found.u_power)


def test_a_feature_at_the_border_of_a_cell() -> None:
    """Where the flat face's light changes its arm, beside a border between cells: 8 u were lost there."""
    flat = sensor(lens__shape="none")
    rough, close = (flat.integrate(0.25, tolerance=tolerance) for tolerance in (1e-4, 1e-5))
    agrees(rough, close)


def test_parts_of_one_path_that_end_apart() -> None:
    """Light of one path may leave above a gap or stay, by its height: the part that waits is looked at too."""
    gap = sensor(receivers__coupling="air-gap", receivers__gap_mm=0.5, emitter__width_mm=0.3, emitter__height_mm=0.3)
    light = Lights.of(gap.scene(1.7), "power", Limits(1e-6)).each[0]
    assert isinstance(light, LightInSpace)
    family = light.families[0]._replace(rules=light.families[0].rules._replace(min_weight=0.5, max_hits=4))
    buffers, total = path_buffers(light.columns), np.empty(light.columns)
    for rise, angle in ((0.05, 0.2), (0.6, 0.1), (0.8, 0.3)):
        path = at_angles(family, angle, 0.0, rise, family.low, family.high)
        buffers.counts[:] = 0
        integrate_path(DOUBLE, light.walls, path, buffers, light.ends, 64, 1e-4, 1e-5, 1e-3, total)
        assert buffers.counts[0] < 2000, "no jump is halved without end"
        brute = np.zeros(light.columns)
        for u in np.linspace(family.low, family.high, 4001)[:-1] + (family.high - family.low) / 8000:
            buffers.counts[3], buffers.u[0] = 0, u
            add_rays(DOUBLE, light.walls, path, buffers, heading(path, u), 0, 1)
            brute += buffers.value[0] / 4000
        assert total / (family.high - family.low) == pytest.approx(brute, abs=1e-3)


def test_a_jump_on_which_two_rules_agree() -> None:
    """The whole focus of a point changes its arm at one angle out of the plane: that is a jump."""
    point = sensor(
        emitter__width_mm=0.0, emitter__height_mm=0.2, emitter__cone_deg=60.0, emitter__distance_mm=1.3724548543384098,
        emitter__offset_mm=0.03957445733338537, material__index=1.5168110610361751, lens__focus_mm=27.464176665316607,
        body__stem_length_mm=16.51118078773456, body__arm_width_mm=2.7325136520062268,
        body__thickness_mm=4.960004042937881,
    )  # fmt: skip
    for angle_deg in (-1.7, -1.6725, -1.65):
        rough, close = (point.integrate(angle_deg, tolerance=tolerance) for tolerance in (1e-4, 1e-6))
        agrees(rough, close)


def test_a_part_of_the_heights_that_waits_for_a_reflection_by_rounding() -> None:
    """This integration never ended: a part of the heights was divided at its own end, again and again."""
    one = sensor(
        emitter__width_mm=0.228,
        emitter__height_mm=0.229,
        emitter__cone_deg=170.0,
        emitter__offset_mm=-0.025,
        body__thickness_mm=4.94,
        wall=[{"face": "stem-*", "outside": "skin", "index": 1.40}],
    )
    assert one.integrate(-3.08, tolerance=3e-4).reached


@pytest.mark.parametrize(
    ("hits", "height_mm"),
    [(1, None), (2, None), (1, (0.4, 1.2)), (3, (0.4, 1.2)), (12, (0.4, 1.2)), (3, (-0.5, 0.5)), (12, (-0.5, 0.5))],
)
def test_the_tail_takes_up_all_that_is_left(hits: int, height_mm: tuple[float, float] | None) -> None:
    """Ray by ray, what is sampled beyond the rules adds up to what was left there, and to all of the light with it."""
    scene = bar(chip(cone_deg=60.0, height_mm=1.5), height_mm=height_mm)
    lights = Lights.of(scene, "power", Limits())
    light = lights.each[0]
    rules = lights.rules._replace(min_weight=0.02, max_hits=hits)
    tail = light.tail(rules)
    buffers, columns = path_buffers(tail.columns), tail.columns
    launch = light.source.launch_at(np.random.default_rng(hits).random((400, 4)), 400, True)
    left, sampled = np.zeros(columns), np.zeros(columns)
    assert launch.dy is not None
    for i in range(400):
        buffers.start[:2] = launch.x_mm[i], launch.z_mm[i], launch.dx[i], launch.dy[i], launch.dz[i]
        for n, draw in ((0, NO_DRAW), (1, i)):
            trace_rays(DOUBLE, tail.walls, tail.family_of(0), buffers, n, n + 1, draw, 10_000)
        buffers.counts[3], (exact, rest) = 0, buffers.value[:2]
        assert rest[-1] == pytest.approx(exact[-1], abs=1e-12)
        assert math.fsum(rest[:-3]) == pytest.approx(rest[-1], abs=1e-9)
        assert math.fsum(exact[:-3]) + exact[-1] == pytest.approx(1.0, abs=1e-9)
        left, sampled = left + exact, sampled + rest
    assert left[-1] > 0.1, "something is left"


@pytest.mark.parametrize(
    "key",
    [
        "lens.half_width_mm",
        pytest.param("emitter.offset_mm", marks=pytest.mark.evidence),
        pytest.param("body.arm_width_mm", marks=pytest.mark.evidence),
    ],
)
def test_derivatives_in_space_are_those_of_close_integrals(key: str) -> None:
    """Of moving edges too: what a lens edge gains at its rim is nothing anywhere else."""
    design = sensor()
    found = design.derivative(key, 1.0)
    assert found.reached
    value, step = (0.0, 0.02) if key == "emitter.offset_mm" else (value_at(design.design, key), 0.04)
    ends = [
        Sensor.of(with_values(design.design, {key: value + s * step})).integrate(1.0, tolerance=2e-5) for s in (-1, 1)
    ]
    for name, slope in found.detectors.items():
        difference = (ends[1].detectors[name].power - ends[0].detectors[name].power) / (2.0 * step)
        u = math.hypot(ends[0].u_power, ends[1].u_power) / (2.0 * step)
        assert slope.value == pytest.approx(difference, abs=3.0 * math.hypot(u, slope.u_value) + 0.01 * abs(difference))
        assert slope.u_value < 0.005 * max(abs(slope.value) for slope in found.detectors.values())


@pytest.mark.evidence
def test_derivatives_of_trapped_light_are_taken_over_wide_steps() -> None:
    """A hundredth of the distance changes the light behind an air gap by less than its samples are off by."""
    gap = {"receivers.coupling": "air-gap", "receivers.gap_mm": 0.3, "emitter.width_mm": 0.2}
    design = Sensor.of(with_values(sensor().design, gap))
    found = design.derivative("emitter.distance_mm", 0.4)
    value, step = value_at(design.design, "emitter.distance_mm"), 0.2
    low, high = (
        Sensor.of(with_values(design.design, {"emitter.distance_mm": value + sign * step})).integrate(
            0.4, tolerance=1e-4
        )
        for sign in (-1, 1)
    )
    largest = max(abs(slope.value) for slope in found.detectors.values())
    for name, slope in found.detectors.items():
        difference = (high.detectors[name].power - low.detectors[name].power) / (2.0 * step)
        print(f"\n{name}: {slope.value:.4f} +- {slope.u_value:.4f} per mm, plain difference {difference:.4f}")
        u = math.hypot(low.u_power, high.u_power) / (2.0 * step)
        assert slope.value == pytest.approx(difference, abs=2.0 * math.hypot(u, slope.u_value) + 0.02 * largest)
        assert slope.u_value < 0.25 * largest


def test_sums_of_cells_hold_however_small_what_is_left_becomes() -> None:
    value = np.array([0.25, 0.75])
    bounds, apart = (0.0, 1.0, 0.0, 1.0), np.array([value, value])
    cells = Cells([Cell(bounds, value, apart, (0.1, 0.0), 0.1, 1)])
    for n in range(200):
        cells.worst()
        small = 10.0 ** -min(n / 10.0 + 1.0, 12.0)
        for _ in range(2):
            cells.add(Cell(bounds, small * value, apart, (small, 0.0), small, 1))
    exact = sum(cell.error**2 for cell in cells)
    assert cells.u(1.0) == pytest.approx(math.sqrt(2.0 * exact), rel=1e-3)
    assert cells.value == pytest.approx(sum(cell.value for cell in cells), rel=1e-6)
