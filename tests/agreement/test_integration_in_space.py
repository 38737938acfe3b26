"""Integration in space agrees with sampled rays, with closed forms and with closer integration."""

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
from solen.trace.adaptive import Lights, integration_obstacle
from solen.trace.cells import Cell, Cells
from solen.trace.cone import DOUBLE
from solen.trace.kernel.family import at_angles, heading
from solen.trace.kernel.paths import add_rays, integrate_path, path_buffers, trace_rays
from solen.trace.kernel.prism import NO_SAMPLE
from solen.trace.space import LightInSpace

CHIP = {
    "trace.dimension": "extruded",
    "emitter.pattern": "lambertian",
    "emitter.width_mm": 0.2,
    "emitter.height_mm": 0.2,
    "emitter.cone_deg": 120.0,
}


def sensor(**values: Any) -> Sensor:
    """Return the shipped design in space with a square chip; in keywords, ``__`` stands for a dot."""
    return Sensor.of(
        with_values(loads(template("paper-860")), CHIP | {key.replace("__", "."): v for key, v in values.items()})
    )


def bar(source: Emitter, index: float = 1.5, height_mm: tuple[float, float] | None = None) -> Scene:
    """Return a bar 4 mm wide, 12 mm long and 3 mm thick with a receiver at its far end."""
    corners = [(-2.0, 0.0), (2.0, 0.0), (2.0, 12.0), (-2.0, 12.0)]
    front, right, end, left = (Segment(corners[i], corners[(i + 1) % 4]) for i in range(4))
    walls = [Interface(n, c, "bar", "air") for n, c in (("front", front), ("right", right), ("left", left))]
    receiver = Interface("end", end, "bar", "air", "receiver", "end", height_mm=height_mm)
    regions = (Region("air", 1.0), Region("bar", index))
    return Scene(regions, (*walls, receiver), (source,), extrusion=Extrusion(3.0))


def chip(**values: Any) -> Emitter:
    return Emitter((0.0, -1.0), 0.0, 2**16, **({"width_mm": 0.4, "height_mm": 0.4, "cone_deg": 140.0} | values))


def check_agreement(integral: Trace, sampled: Trace, factor: float = 4.0) -> None:
    """Check that all powers agree within ``factor`` combined uncertainties."""
    for name, reading in integral.detectors.items():
        other = sampled.detectors[name]
        assert abs(reading.power - other.power) <= factor * math.hypot(reading.u_power, other.u_power), name
    assert abs(integral.ledger.escaped - sampled.ledger.escaped) <= factor * 2e-3


def contrast(trace: Trace) -> float:
    right, left = (trace.detectors[name].power for name in ("right", "left"))
    return (right - left) / (right + left)


@pytest.mark.parametrize(("angle_deg", "expected"), [(-1.0, 0.2786), (-3.0, 0.6535)])
def test_contrast_of_the_paper_design_with_a_chip(angle_deg: float, expected: float) -> None:
    """Sampling with 2²⁰ rays gives the expected values to 0.0002."""
    integral = sensor().integrate(angle_deg, tolerance=2e-4)
    assert integral.reached
    assert integral.method == "adaptive"
    assert contrast(integral) == pytest.approx(expected, abs=1e-3)
    assert integral.ledger.total == pytest.approx(1.0, abs=1e-6)


def test_opposite_angle_exchanges_the_receivers() -> None:
    """The design is symmetric, but the cells are halved differently."""
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
        "narrow pattern",
        "table",
        "dark on its axis",
        "line",
        "point",
        "displaced along y",
        "higher than the body",
        "wide cone",
        "two wavelengths",
    ],
)
def test_emitters(source: Emitter) -> None:
    scene = bar(source)
    integral = integrate(scene, tolerance=5e-4)
    assert integral.reached
    check_agreement(integral, trace(scene, "power", sampling="sobol"))


@pytest.mark.parametrize("height_mm", [(-0.5, 0.5), (-1.5, 0.2), (0.4, 1.2)])
def test_receiver_lower_than_the_body(height_mm: tuple[float, float]) -> None:
    scene = bar(chip(cone_deg=60.0, height_mm=1.5), height_mm=height_mm)
    integral = integrate(scene, tolerance=1e-3)
    assert integral.reached
    check_agreement(integral, trace(scene, "power", sampling="sobol"))


def test_leak_through_top_and_bottom() -> None:
    """With n below √2, light leaks if its direction cosine along y exceeds √(n² − 1)."""
    scene = bar(chip(cone_deg=150.0), index=1.25)
    integral = integrate(scene, tolerance=1e-3)
    assert integral.reached
    check_agreement(integral, trace(scene, "power", sampling="sobol"))


@pytest.mark.parametrize(
    ("scene", "index", "absorption_per_mm", "extrusion"),
    [
        (bar(chip(height_mm=2.0, cone_deg=60.0), height_mm=(-0.2, 0.2)), (1.0, 1.5), (0.0, 0.1), Extrusion(3.0)),
        (bar(chip(cone_deg=100.0)), (1.0, 1.2), (0.0, 0.1), Extrusion(3.0)),
        (bar(chip(y_mm=0.2)), (1.0, 1.5), (0.0, 0.3), Extrusion(1.0, 1.3, 1.5)),
        (bar(chip()), (1.0, 1.5), (0.1, 0.1), Extrusion(3.0)),
        (bar(chip()), (1.33, 1.5), (0.0, 0.0), Extrusion(3.0, 1.0, 1.5)),
    ],
    ids=[
        "above and below a receiver",
        "leak",
        "leak through the bottom",
        "absorbing surroundings",
        "index-matched bottom",
    ],
)
def test_light_that_is_not_detected(
    scene: Scene, index: tuple[float, float], absorption_per_mm: tuple[float, float], extrusion: Extrusion
) -> None:
    """Light that leaks through top or bottom is absorbed only up to there."""
    air, body = (Region(*values) for values in zip(("air", "bar"), index, absorption_per_mm, strict=True))
    scene = replace(scene, regions=(air, body), extrusion=extrusion)
    integral, sampled = integrate(scene, tolerance=5e-4), trace(scene, "power", sampling="sobol")
    assert integral.reached
    check_agreement(integral, sampled)
    for name in ("escaped", "absorbed"):
        assert getattr(integral.ledger, name) == pytest.approx(getattr(sampled.ledger, name), abs=2e-3)
    assert integral.missed == pytest.approx(sampled.missed, abs=2e-3)
    assert integral.leaked == pytest.approx(sampled.leaked, abs=2e-3)


def test_counting_mode() -> None:
    scene = bar(chip())
    check_agreement(integrate(scene, "count", 1e-3), trace(scene, "count", sampling="sobol"))


def test_point_inside_a_cube() -> None:
    """Each face receives a sixth of the light of an isotropic point; light escapes through top and bottom."""
    corners = [(-2.0, -2.0), (2.0, -2.0), (2.0, 2.0), (-2.0, 2.0)]
    walls = tuple(
        Interface(f"w{i}", Segment(corners[i], corners[(i + 1) % 4]), "inside", "outside", "receiver", f"w{i}")
        for i in range(4)
    )
    source = Emitter((0.0, 0.0), 0.0, 100, cone_deg=360.0)
    regions = (Region("inside", 1.0), Region("outside", 1.0))
    scene = Scene(regions, walls, (source,), extrusion=Extrusion(4.0))
    integral = integrate(scene, tolerance=1e-4)
    for reading in integral.detectors.values():
        assert reading.power == pytest.approx(1.0 / 6.0, abs=2e-4)
    assert integral.ledger.escaped == pytest.approx(1.0 / 3.0, abs=3e-4)


def test_errors_are_consistent_with_uncertainties() -> None:
    """The errors are differences from an integral with a lower tolerance."""
    rng = np.random.default_rng(3)
    ratios = []
    for _ in range(4):
        random_sensor = sensor(
            material__index=float(rng.uniform(1.42, 1.56)),
            emitter__width_mm=float(rng.uniform(0.05, 0.4)),
            emitter__offset_mm=float(rng.normal(0.0, 0.05)),
        )
        angle_deg = float(rng.uniform(-3.0, 3.0))
        exact = random_sensor.integrate(angle_deg, tolerance=5e-5)
        coarse = random_sensor.integrate(angle_deg, tolerance=1e-3)
        ratios += [
            (coarse.detectors[name].power - exact.detectors[name].power) / coarse.u_power for name in ("right", "left")
        ]
    assert math.sqrt(np.mean(np.square(ratios))) < 1.5
    assert max(map(abs, ratios)) < 4.0


def test_trapped_light() -> None:
    """Its tail is sampled."""
    gap = sensor(receivers__coupling="air-gap", receivers__gap_mm=0.5)
    integral = gap.integrate(-1.0, tolerance=2e-3)
    assert integral.reached
    assert integral.ledger.truncated < 1e-6
    check_agreement(integral, trace(gap.scene(-1.0, 2**16), "power", sampling="sobol", limits=Limits(1e-7)))


@pytest.mark.parametrize("height_mm", [0.0, 0.2])
def test_low_receivers_of_a_sensor(height_mm: float) -> None:
    """Whether a skew ray meets one depends on the last digits of its angle, so that this light is sampled."""
    low = sensor(emitter__height_mm=height_mm, receivers__height_mm=1.0)
    integral = low.integrate(-1.0, tolerance=2e-3)
    assert integral.reached
    check_agreement(integral, trace(low.scene(-1.0, 2**16), "power", sampling="sobol", limits=Limits(1e-7)), 3.0)


def test_response_is_integrated() -> None:
    response = sensor().power((-1.0, 1.0))
    assert [trace.method for trace in response.traces] == ["adaptive", "adaptive"]
    assert response.contrast[0] == pytest.approx(-response.contrast[1], abs=2e-3)


def test_refuses_ambient_light_and_empty_cones() -> None:
    scene = bar(chip())
    ambient = replace(scene, sources=(Ambient((0.0, 6.0), 20.0, 100),))
    assert "Ambient" in integration_obstacle(ambient)
    with pytest.raises(DesignError, match="Ambient"):
        integrate(ambient)
    with pytest.raises(DesignError, match="Ambient"):
        derivative(lambda _: ambient, 1.0)
    with pytest.raises(DesignError, match="cone_deg"):
        integrate(bar(chip(cone_deg=0.0)))


def test_cell_in_which_both_rules_agree_by_chance() -> None:
    """For this triangle with n = 1.33, an integral with a lower tolerance gives 0.71617."""
    corners = [(-2.0, 0.0), (2.5, 0.5), (0.3, 7.0)]
    front, end, left = (Segment(corners[i], corners[(i + 1) % 3]) for i in range(3))
    walls = [Interface(n, c, "bar", "air") for n, c in (("front", front), ("left", left))]
    receiver = Interface("end", end, "bar", "air", "receiver", "end")
    source = replace(chip(cone_deg=120.0), point=(0.2, -1.0))
    scene = Scene((Region("air", 1.0), Region("bar", 1.33)), (*walls, receiver), (source,), extrusion=Extrusion(3.0))
    integral = integrate(scene, tolerance=3e-4)
    assert integral.detectors["end"].power == pytest.approx(0.71617, abs=2.0 * integral.u_power)


def test_feature_at_the_edge_of_a_cell() -> None:
    """Light from the flat face changes from one arm to the other next to a cell edge; the error there was once 8 u."""
    flat = sensor(lens__shape="none")
    coarse, exact = (flat.integrate(0.25, tolerance=tolerance) for tolerance in (1e-4, 1e-5))
    check_agreement(coarse, exact)


def test_parts_of_a_path_with_different_fates() -> None:
    """Light on one path may leave above a gap or stay in the body, depending on its height."""
    gap = sensor(receivers__coupling="air-gap", receivers__gap_mm=0.5, emitter__width_mm=0.3, emitter__height_mm=0.3)
    light = Lights.of(gap.scene(1.7), "power", Limits(1e-6)).each[0]
    assert isinstance(light, LightInSpace)
    family = light.families[0]._replace(rules=light.families[0].rules._replace(min_weight=0.5, max_hits=4))
    buffers, total = path_buffers(light.columns), np.empty(light.columns)
    for rise, angle in ((0.05, 0.2), (0.6, 0.1), (0.8, 0.3)):
        path = at_angles(family, angle, 0.0, rise, family.low, family.high)
        buffers.counts[:] = 0
        integrate_path(DOUBLE, light.walls, path, buffers, light.ends, 64, 1e-4, 1e-5, 1e-3, total)
        assert buffers.counts[0] < 2000, "jumps are not halved without end"
        mean = np.zeros(light.columns)
        for u in np.linspace(family.low, family.high, 2001)[:-1] + (family.high - family.low) / 4000:
            buffers.counts[3], buffers.u[0] = 0, u
            add_rays(DOUBLE, light.walls, path, buffers, heading(path, u), 0, 1)
            mean += buffers.value[0] / 2000
        assert total / (family.high - family.low) == pytest.approx(mean, abs=1e-3)


def test_jump_at_which_two_rules_agree() -> None:
    """All light of a point changes from one arm to the other at a certain angle out of the plane."""
    point = sensor(
        emitter__width_mm=0.0, emitter__height_mm=0.2, emitter__cone_deg=60.0, emitter__distance_mm=1.3724548543384098,
        emitter__offset_mm=0.03957445733338537, material__index=1.5168110610361751, lens__focus_mm=27.464176665316607,
        body__stem_length_mm=16.51118078773456, body__arm_width_mm=2.7325136520062268,
        body__thickness_mm=4.960004042937881,
    )  # fmt: skip
    for angle_deg in (-1.7, -1.6725, -1.65):
        coarse, exact = (point.integrate(angle_deg, tolerance=tolerance) for tolerance in (1e-4, 5e-6))
        check_agreement(coarse, exact)


def test_height_interval_reflected_by_rounding_error() -> None:
    """This integration once did not end, because an interval of heights was divided at its own end repeatedly."""
    skin = sensor(
        emitter__width_mm=0.228,
        emitter__height_mm=0.229,
        emitter__cone_deg=170.0,
        emitter__offset_mm=-0.025,
        body__thickness_mm=4.94,
        wall=[{"face": "stem-*", "outside": "skin", "index": 1.40}],
    )
    assert skin.integrate(-3.08, tolerance=3e-4).reached


@pytest.mark.parametrize(
    ("hits", "height_mm"),
    [(1, None), (2, None), (1, (0.4, 1.2)), (3, (0.4, 1.2)), (12, (0.4, 1.2)), (3, (-0.5, 0.5)), (12, (-0.5, 0.5))],
)
def test_tail_contains_all_unfinished_light(hits: int, height_mm: tuple[float, float] | None) -> None:
    """For every ray, the sampled power is that of its unfinished light, and the total power is 1."""
    scene = bar(chip(cone_deg=60.0, height_mm=1.5), height_mm=height_mm)
    lights = Lights.of(scene, "power", Limits())
    light = lights.each[0]
    rules = lights.rules._replace(min_weight=0.02, max_hits=hits)
    tail = light.tail(rules)
    buffers = path_buffers(tail.columns)
    launch = light.source.launch_at(np.random.default_rng(hits).random((400, 4)), 400, True)
    unfinished = 0.0
    assert launch.dy is not None
    for i in range(400):
        buffers.start[:2] = launch.x_mm[i], launch.z_mm[i], launch.dx[i], launch.dy[i], launch.dz[i]
        for n, draw in ((0, NO_SAMPLE), (1, i)):
            trace_rays(DOUBLE, tail.walls, tail.family_of(0), buffers, n, n + 1, draw, 10_000)
        buffers.counts[3], (exact, sampled) = 0, buffers.value[:2]
        assert sampled[-1] == pytest.approx(exact[-1], abs=1e-12)
        assert math.fsum(sampled[:-3]) == pytest.approx(sampled[-1], abs=1e-9)
        assert math.fsum(exact[:-3]) + exact[-1] == pytest.approx(1.0, abs=1e-9)
        unfinished += exact[-1]
    assert unfinished > 0.1


@pytest.mark.parametrize(
    "key",
    [
        "lens.half_width_mm",
        pytest.param("emitter.offset_mm", marks=pytest.mark.evidence),
        pytest.param("body.arm_width_mm", marks=pytest.mark.evidence),
    ],
)
def test_derivatives_agree_with_differences_of_integrals(key: str) -> None:
    """The derivative with respect to the lens width comes entirely from its edges."""
    base = sensor()
    derivative = base.derivative(key, 1.0)
    assert derivative.reached
    value, step = (0.0, 0.02) if key == "emitter.offset_mm" else (value_at(base.design, key), 0.04)
    low, high = (base.set({key: value + sign * step}).integrate(1.0, tolerance=1e-4) for sign in (-1, 1))
    for name, slope in derivative.detectors.items():
        difference = (high.detectors[name].power - low.detectors[name].power) / (2.0 * step)
        u = math.hypot(low.u_power, high.u_power) / (2.0 * step)
        assert slope.value == pytest.approx(difference, abs=3.0 * math.hypot(u, slope.u_value) + 0.01 * abs(difference))
        assert slope.u_value < 0.005 * max(abs(slope.value) for slope in derivative.detectors.values())


@pytest.mark.evidence
def test_derivatives_of_trapped_light() -> None:
    """A change of 1 % in the distance would change the light behind an air gap by less than the sampling error."""
    gap = sensor(receivers__coupling="air-gap", receivers__gap_mm=0.3)
    derivative = gap.derivative("emitter.distance_mm", 0.4)
    value, step = value_at(gap.design, "emitter.distance_mm"), 0.2
    low, high = (
        gap.set({"emitter.distance_mm": value + sign * step}).integrate(0.4, tolerance=1e-4) for sign in (-1, 1)
    )
    largest = max(abs(slope.value) for slope in derivative.detectors.values())
    for name, slope in derivative.detectors.items():
        difference = (high.detectors[name].power - low.detectors[name].power) / (2.0 * step)
        print(f"\n{name}: {slope.value:.4f} +- {slope.u_value:.4f} per mm, difference {difference:.4f}")
        u = math.hypot(low.u_power, high.u_power) / (2.0 * step)
        assert slope.value == pytest.approx(difference, abs=2.0 * math.hypot(u, slope.u_value) + 0.02 * largest)
        assert slope.u_value < 0.25 * largest


def test_sums_of_cells_remain_accurate_for_small_errors() -> None:
    value = np.array([0.25, 0.75])
    bounds, differences = (0.0, 1.0, 0.0, 1.0), np.array([value, value])
    cells = Cells([Cell(bounds, value, differences, (0.1, 0.0), 0.1, 1)])
    for n in range(200):
        cells.pop_largest()
        error = 10.0 ** -min(n / 10.0 + 1.0, 12.0)
        for _ in range(2):
            cells.add(Cell(bounds, error * value, differences, (error, 0.0), error, 1))
    squares = sum(cell.error**2 for cell in cells)
    assert cells.total_error(1.0) == pytest.approx(math.sqrt(2.0 * squares), rel=1e-3)
    assert cells.value == pytest.approx(sum(cell.value for cell in cells), rel=1e-6)
