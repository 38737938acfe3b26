"""One design as function calls: its material, lens and scenes, and its traces, integrals and slopes."""

import math

import pytest

from solen.errors import DataError, DesignError
from solen.lens import FlatFace, OvalLens
from solen.sensor import SLOPE_DEG, Sensor
from solen.spec import Design, loads, template, with_values
from solen.trace.adaptive import POINT_TOLERANCE

MANY_RAYS = 2**20 + 3


def design(**values: object) -> Design:
    """The 860 nm example with some values set; ``__`` stands for the dot of a key."""
    return with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})


@pytest.fixture(scope="module")
def paper() -> Sensor:
    return Sensor.of(design())


def test_sensor_has_its_material_and_a_lens_designed_for_it(paper: Sensor) -> None:
    assert paper.material.index == 1.44
    assert isinstance(paper.lens, OvalLens)
    assert paper.lens.design_index == 1.44
    assert paper.has_lens


def test_cache_of_scenes_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.sensor.sensor.RECENT_SCENES", 3)
    sensor = Sensor.of(design())
    first = sensor.scene(0.5)
    assert sensor.scene(0.5) is first
    assert sensor.scene(0.5, 7) is not first
    for angle_deg in (1.0, 1.5, 2.0):
        sensor.scene(angle_deg)
    assert sensor.scene(0.5) is not first
    assert sensor.scene(0.5) == first


def test_lens_is_designed_for_the_design_index() -> None:
    sensor = Sensor.of(design(lens__design_index=1.49))
    assert isinstance(sensor.lens, OvalLens)
    assert (sensor.material.index, sensor.lens.design_index) == (1.44, 1.49)


def test_refuses_impossible_sensors() -> None:
    with pytest.raises(DesignError, match="tangent to the oval"):
        Sensor.of(design(lens__half_width_mm=2.95))
    with pytest.raises(DataError, match="did you mean pmma"):
        Sensor.of(design(material__resin="pmna"))


def test_without_lens_is_the_design_with_a_flat_face(paper: Sensor) -> None:
    flat = paper.without_lens
    assert isinstance(flat.lens, FlatFace)
    assert not flat.has_lens
    assert flat.design == with_values(paper.design, {"lens.shape": "none"})
    assert flat.material == paper.material
    assert flat.body().area_mm2() == pytest.approx(paper.body().area_mm2(), rel=0.05)
    assert paper.without_lens is flat


def test_trace_has_the_rays_and_mode_of_the_design_by_default() -> None:
    sensor = Sensor.of(design(trace__mode="power", emitter__rays=40))
    plain = sensor.trace()
    assert (plain.mode, plain.rays) == ("power", 40)
    with_options = sensor.trace(1.0, "count", 60)
    assert (with_options.mode, with_options.rays) == ("count", 60)
    assert plain.segments is None
    assert len(sensor.trace(segments=True).paths()) > 0


@pytest.mark.parametrize("angle_deg", [-2.0, 0.25, 1.0])
def test_opposite_angles_swap_the_receivers(paper: Sensor, angle_deg: float) -> None:
    trace, opposite = paper.trace(angle_deg, "power", 500), paper.trace(-angle_deg, "power", 500)
    assert trace.detectors["right"].power == pytest.approx(opposite.detectors["left"].power, abs=1e-9)
    assert trace.detectors["left"].power == pytest.approx(opposite.detectors["right"].power, abs=1e-9)


def test_count_traces_the_rays_of_the_design(paper: Sensor) -> None:
    response = paper.count([-3.0, 0.0])
    assert response.mode == "count"
    assert list(response.angle_deg) == [-3.0, 0.0]
    assert list(response.rays) == [100, 100]
    assert all(math.isnan(u) for u in response.u_power)
    for fraction in (*response.right, *response.left):
        assert fraction * 100 == pytest.approx(round(fraction * 100), abs=1e-9)
    assert response.right[0] > 0.5
    assert response.left[0] == 0.0


def test_power_is_integrated_at_the_angles_of_the_design() -> None:
    sensor = Sensor.of(design(motion__step_deg=3.0))
    response = sensor.power()
    assert list(response.angle_deg) == [-3.0, 0.0, 3.0]
    integrated = sensor.integrate(-3.0)
    assert response.right[0] == integrated.detectors["right"].power
    assert response.u_power[0] == integrated.u_power
    assert response.rays[0] == integrated.rays


@pytest.mark.parametrize("values", [{}, {"lens__shape": "none"}, {"emitter__offset_mm": 0.3}])
@pytest.mark.parametrize("angle_deg", [-3.0, -1.75, 0.25, 2.0])
def test_integral_agrees_with_many_rays(values: dict[str, object], angle_deg: float) -> None:
    sensor = Sensor.of(design(**values))
    integrated = sensor.integrate(angle_deg)
    assert integrated.reached
    assert integrated.u_power <= POINT_TOLERANCE
    traced = sensor.trace(angle_deg, "power", MANY_RAYS)
    for name, reading in integrated.detectors.items():
        assert reading.power == pytest.approx(traced.detectors[name].power, abs=integrated.u_power + 20 / MANY_RAYS)


def test_larger_tolerance_takes_fewer_rays(paper: Sensor) -> None:
    loose, tight = paper.integrate(-3.0, tolerance=1e-2), paper.integrate(-3.0, tolerance=1e-9)
    assert loose.rays < tight.rays
    assert tight.u_power <= 1e-9
    for name, reading in loose.detectors.items():
        assert reading.power == pytest.approx(tight.detectors[name].power, abs=loose.u_power + tight.u_power)


def test_slope_is_the_chord_between_two_integrals(paper: Sensor) -> None:
    def contrast(angle_deg: float) -> float:
        detectors = paper.integrate(angle_deg).detectors
        right, left = detectors["right"].power, detectors["left"].power
        return (right - left) / (right + left)

    assert SLOPE_DEG == 0.04
    chord = (contrast(0.3 + 0.02) - contrast(0.3 - 0.02)) / 0.04
    slope = paper.slope_per_deg(0.3)
    assert slope is not None
    assert slope.value == pytest.approx(chord, rel=1e-12)
    near = (contrast(0.3 + 0.002) - contrast(0.3 - 0.002)) / 0.004
    assert abs(slope.value - near) <= slope.u_value < 0.05 * abs(near)


def test_slope_is_that_of_the_curve_at_the_angle(paper: Sensor) -> None:
    low, _, high = paper.power([-0.01, 0.0, 0.01]).contrast
    at_null, at_saturation = paper.slope_per_deg(0.0), paper.slope_per_deg(2.5)
    assert at_null is not None
    assert at_saturation is not None
    assert at_null.value == pytest.approx((high - low) / 0.02, rel=0.05)
    assert abs(at_saturation.value) < 0.01


def test_slope_is_none_without_light() -> None:
    assert Sensor.of(design(material__absorption_per_mm=1000.0)).slope_per_deg(0.0) is None


def test_trapped_light_is_integrated_with_a_sampled_remainder() -> None:
    """With a pivot far up the stem, light enters beside the lens and is trapped for arbitrarily many reflections."""
    sensor = Sensor.of(design(motion__pivot=[0.0, 20.0]))
    assert sensor.integrate(-3.0).reached
    response = sensor.power([-5.0])
    assert response.traces[0].method == "adaptive"
    assert 1e-7 < response.u_power[0] < 2e-4
    sampled = sensor.trace(-5.0, "power", 2**18, sampling="sobol")
    u = math.hypot(response.u_power[0], sampled.u_power)
    assert response.right[0] == pytest.approx(sampled.detectors["right"].power, abs=4.0 * u)
