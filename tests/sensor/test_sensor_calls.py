"""One design as plain calls: what follows from it at once, and its readings at an angle."""

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


def test_a_sensor_has_its_material_and_the_lens_cut_for_it(paper: Sensor) -> None:
    assert paper.material.index == 1.44
    assert isinstance(paper.lens, OvalLens)
    assert paper.lens.design_index == 1.44
    assert paper.has_lens


def test_scenes_are_remembered_but_not_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.sensor.sensor.RECENT_SCENES", 3)
    sensor = Sensor.of(design())
    first = sensor.scene(0.5)
    assert sensor.scene(0.5) is first
    assert sensor.scene(0.5, 7) is not first
    for angle_deg in (1.0, 1.5, 2.0):
        sensor.scene(angle_deg)
    assert sensor.scene(0.5) is not first
    assert sensor.scene(0.5) == first


def test_a_lens_is_cut_for_the_design_index_where_that_differs_from_the_material() -> None:
    sensor = Sensor.of(design(lens__design_index=1.49))
    assert isinstance(sensor.lens, OvalLens)
    assert (sensor.material.index, sensor.lens.design_index) == (1.44, 1.49)


def test_a_sensor_that_cannot_be_is_refused() -> None:
    with pytest.raises(DesignError, match="tangency"):
        Sensor.of(design(lens__half_width_mm=2.95))
    with pytest.raises(DataError, match="did you mean pmma"):
        Sensor.of(design(material__resin="pmna"))


def test_without_lens_is_the_same_design_with_a_flat_face(paper: Sensor) -> None:
    flat = paper.without_lens
    assert isinstance(flat.lens, FlatFace)
    assert not flat.has_lens
    assert flat.design == with_values(paper.design, {"lens.shape": "none"})
    assert flat.material == paper.material
    assert flat.body().area_mm2() == pytest.approx(paper.body().area_mm2(), rel=0.05)
    assert paper.without_lens is flat


def test_a_trace_takes_the_design_s_rays_and_mode_unless_set_otherwise() -> None:
    sensor = Sensor.of(design(trace__mode="power", emitter__rays=40))
    plain = sensor.trace()
    assert (plain.mode, plain.rays) == ("power", 40)
    told = sensor.trace(1.0, "count", 60)
    assert (told.mode, told.rays) == ("count", 60)
    assert plain.legs is None
    assert len(sensor.trace(legs=True).paths()) > 0


@pytest.mark.parametrize("angle_deg", [-2.0, 0.25, 1.0])
def test_turning_the_other_way_swaps_the_receivers(paper: Sensor, angle_deg: float) -> None:
    one, other = paper.trace(angle_deg, "power", 500), paper.trace(-angle_deg, "power", 500)
    assert one.detectors["right"].power == pytest.approx(other.detectors["left"].power, abs=1e-9)
    assert one.detectors["left"].power == pytest.approx(other.detectors["right"].power, abs=1e-9)


def test_a_count_is_of_whole_rays_of_the_design(paper: Sensor) -> None:
    response = paper.count([-3.0, 0.0])
    assert response.mode == "count"
    assert list(response.angle_deg) == [-3.0, 0.0]
    assert list(response.rays) == [100, 100]
    assert all(math.isnan(u) for u in response.u_power)
    for share in (*response.right, *response.left):
        assert share * 100 == pytest.approx(round(share * 100), abs=1e-9)
    assert response.right[0] > 0.5
    assert response.left[0] == 0.0


def test_power_at_the_design_s_angles_is_what_the_integral_is() -> None:
    sensor = Sensor.of(design(motion__step_deg=3.0))
    response = sensor.power()
    assert list(response.angle_deg) == [-3.0, 0.0, 3.0]
    found = sensor.integrate(-3.0)
    assert response.right[0] == found.detectors["right"].power
    assert response.u_power[0] == found.u_power
    assert response.rays[0] == found.rays


@pytest.mark.parametrize("values", [{}, {"lens__shape": "none"}, {"emitter__offset_mm": 0.3}])
@pytest.mark.parametrize("angle_deg", [-3.0, -1.75, 0.25, 2.0])
def test_an_integral_holds_against_many_rays(values: dict[str, object], angle_deg: float) -> None:
    sensor = Sensor.of(design(**values))
    found = sensor.integrate(angle_deg)
    assert found.reached
    assert found.u_power <= POINT_TOLERANCE
    many = sensor.trace(angle_deg, "power", MANY_RAYS)
    for name, reading in found.detectors.items():
        assert reading.power == pytest.approx(many.detectors[name].power, abs=found.u_power + 20 / MANY_RAYS)


def test_a_looser_tolerance_takes_fewer_rays(paper: Sensor) -> None:
    loose, tight = paper.integrate(-3.0, tolerance=1e-2), paper.integrate(-3.0, tolerance=1e-9)
    assert loose.rays < tight.rays
    assert tight.u_power <= 1e-9
    for name, reading in loose.detectors.items():
        assert reading.power == pytest.approx(tight.detectors[name].power, abs=loose.u_power + tight.u_power)


def test_the_slope_is_between_two_integrals(paper: Sensor) -> None:
    def contrast(angle_deg: float) -> float:
        found = paper.integrate(angle_deg).detectors
        right, left = found["right"].power, found["left"].power
        return (right - left) / (right + left)

    assert SLOPE_DEG == 0.04
    chord = (contrast(0.3 + 0.02) - contrast(0.3 - 0.02)) / 0.04
    slope = paper.slope_per_deg(0.3)
    assert slope is not None
    assert slope.value == pytest.approx(chord, rel=1e-12)
    near = (contrast(0.3 + 0.002) - contrast(0.3 - 0.002)) / 0.004
    assert abs(slope.value - near) <= slope.u_value < 0.05 * abs(near)


def test_the_slope_is_that_of_the_curve_where_it_is_taken(paper: Sensor) -> None:
    low, _, high = paper.power([-0.01, 0.0, 0.01]).contrast
    here, there = paper.slope_per_deg(0.0), paper.slope_per_deg(2.5)
    assert here is not None
    assert there is not None
    assert here.value == pytest.approx((high - low) / 0.02, rel=0.05)
    assert abs(there.value) < 0.01


def test_the_slope_is_missing_without_light() -> None:
    assert Sensor.of(design(material__absorption_per_mm=1000.0)).slope_per_deg(0.0) is None


def test_light_of_endless_ways_is_integrated_with_its_tail_sampled() -> None:
    """Turned about a point far up the stem, the emitter's light gets in beside the lens and finds no end of ways."""
    sensor = Sensor.of(design(motion__pivot=[0.0, 20.0]))
    assert sensor.integrate(-3.0).reached
    response = sensor.power([-5.0])
    assert response.traces[0].method == "adaptive"
    assert 1e-7 < response.u_power[0] < 2e-4
    many = sensor.trace(-5.0, "power", 2**18, sampling="sobol")
    u = math.hypot(response.u_power[0], many.u_power)
    assert response.right[0] == pytest.approx(many.detectors["right"].power, abs=4.0 * u)
