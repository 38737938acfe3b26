"""Derivatives of readings with respect to numbers of a design agree with differences of integrals; inert numbers.

The differences share only the integral with the derivatives: `Sensor.integrate` finds the pieces of the cone anew in
each of the four scenes.
"""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.errors import DesignError, SpecError
from solen.geometry import arm_angle_deg
from solen.sensor import OPTICAL_KEYS, Sensor, why_inert
from solen.spec import Design, dumps, loads, template, value_at, with_values

ANGLE_DEG = 0.2
KEYS = (
    *("body.arm_angle_deg", "body.arm_width_mm", "emitter.distance_mm"),
    *("material.index", "lens.half_width_mm", "lens.focus_mm"),
)
TWO_KEYS = KEYS[:2]
MAX_RELATIVE_ERROR, STEP = 1e-4, 1e-3
IN_SPACE = ("emitter.height_mm", "body.thickness_mm")
NOISE = 3e-10
"""Error of a difference of integrals to 1e-11, also of contrasts, before it is divided by the step."""


def design(**values: object) -> Design:
    """The 860 nm example with some values set; ``__`` stands for the dot of a key."""
    return with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})


@pytest.fixture(scope="module")
def paper() -> Sensor:
    return Sensor.of(design())


def integrated(design_to_trace: Design, tolerance: float) -> NDArray[np.float64]:
    """Right and left power, and contrast."""
    detectors = Sensor.of(design_to_trace).integrate(ANGLE_DEG, tolerance=tolerance).detectors
    right, left = detectors["right"].power, detectors["left"].power
    return np.array([right, left, (right - left) / (right + left)])


def differences(design_to_trace: Design, key: str, value: float, tolerance: float) -> NDArray[np.float64]:
    """Central differences of fourth order of right, left and contrast."""
    h = STEP * value
    near, far = (integrated(with_values(design_to_trace, {key: value + n * h}), tolerance) for n in (1, 2))
    near, far = (
        near - integrated(with_values(design_to_trace, {key: value - h}), tolerance),
        far - integrated(with_values(design_to_trace, {key: value - 2 * h}), tolerance),
    )
    return np.asarray((8.0 * near - far) / (12.0 * h))


def check_derivatives(sensor: Sensor, keys: tuple[str, ...], tolerance: float = 1e-11) -> list[str]:
    """Check derivatives against differences, and return a line for each."""
    lines = []
    for row in sensor.sensitivity(keys, ANGLE_DEG):
        by_difference = differences(sensor.design, row.key, row.value, tolerance)
        assert row.reached
        for quantity, slope, difference in zip(
            ("right", "left", "contrast"), (row.right, row.left, row.contrast), by_difference, strict=True
        ):
            error = abs(slope.value - difference)
            values = f"{slope.value:+.9f} {difference:+.9f} {error / abs(difference):.0e} {slope.u_value:.0e}"
            lines.append(f"{row.key:21} {quantity:9} {values}")
            assert error <= MAX_RELATIVE_ERROR * abs(difference), lines[-1]
            assert error <= slope.u_value + NOISE / (STEP * row.value), lines[-1]
    return lines


def test_two_derivatives_agree_with_differences_of_integrals(paper: Sensor) -> None:
    check_derivatives(paper, TWO_KEYS)


@pytest.mark.evidence
def test_all_derivatives_agree_with_differences_of_integrals(paper: Sensor) -> None:
    print(f"\nat {ANGLE_DEG} deg, per unit: derivative, difference, relative error, uncertainty")
    print("\n".join(check_derivatives(paper, KEYS)))


def sensor_with_contact(**film: object) -> Sensor:
    """Sensor with a medium of the body's index on both outer walls, directly or behind a film."""
    wall = {"face": "outer-*", "outside": "skin", "index": 1.44, **film}
    return Sensor.of(Design.model_validate({"name": "touched", "material": {"index": 1.44}, "wall": [wall]}))


def test_matched_index_behind_a_film_of_air_has_a_derivative() -> None:
    check_derivatives(sensor_with_contact(gap_um=0.3), ("material.index",), tolerance=1e-10)


def test_search_for_pieces_ends_at_a_matched_index() -> None:
    """Above the matched index, light is reflected totally, so that pieces are missing on one side of it."""
    sensor = sensor_with_contact()
    with pytest.raises(SpecError, match="a medium with the same index touches a wall"):
        sensor.sensitivity(["material.index"], ANGLE_DEG)
    result = sensor.derivative("material.index", ANGLE_DEG)
    assert not result.reached
    assert "within" in result.why


def test_search_for_pieces_has_a_limit(paper: Sensor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.trace.cone.MAX_MOVED_SEGMENTS", 1000)
    assert not paper.derivative("body.arm_width_mm", ANGLE_DEG).reached


def test_rows_are_the_numbers_of_the_design_ranked_by_effect(paper: Sensor) -> None:
    rows = paper.sensitivity(angle_deg=ANGLE_DEG)
    inert_keys = {"emitter.wavelength_nm", "emitter.width_mm", "lens.design_index", "receivers.gap_mm"}
    inert_keys |= {"emitter.height_mm", "body.thickness_mm"}
    assert {row.key for row in rows} == set(OPTICAL_KEYS) - inert_keys
    for row in rows:
        value = value_at(paper.design, row.key)
        assert row.value == (arm_angle_deg(paper.design) if row.key == "body.arm_angle_deg" else value)
    effects = [abs(row.contrast.value) * row.tolerance for row in rows if row.reached]
    assert effects == sorted(effects, reverse=True)
    steepest = max((row for row in rows if row.reached), key=lambda row: abs(row.contrast.value))
    assert (steepest.key, rows[0].key) == (
        "body.stem_curve_per_mm",
        "emitter.offset_mm",
    )  # by unit, and by effect
    assert rows[0].tolerance == paper.design.tolerance.emitter_offset_mm
    assert rows[-1].key == "material.absorption_per_mm"
    assert not rows[-1].reached
    assert math.isnan(rows[-1].contrast.value)
    assert "both sides of 0" in str(rows[-1].why)


def test_length_of_lossless_straight_arms_has_no_effect(paper: Sensor) -> None:
    (arms,) = paper.sensitivity(["body.arm_length_mm"], ANGLE_DEG)
    for slope in (arms.right, arms.left, arms.contrast):  # light in the arms reaches their ends
        assert abs(slope.value) <= 5.0 * slope.u_value < 1e-6


def test_opposite_angles_swap_the_receivers(paper: Sensor) -> None:
    (row,), (opposite,) = (paper.sensitivity(["body.arm_width_mm"], angle) for angle in (ANGLE_DEG, -ANGLE_DEG))
    assert row.right.value == pytest.approx(opposite.left.value, abs=1e-6)
    assert row.contrast.value == pytest.approx(-opposite.contrast.value, abs=1e-6)


@pytest.mark.parametrize(
    ("values", "without", "active"),
    [
        ({}, {"emitter.wavelength_nm", "lens.design_index", "receivers.gap_mm"}, set()),
        (
            {"material__resin": "pmma"},
            {"material.index", "material.absorption_per_mm", "lens.design_index", "receivers.gap_mm"},
            {"emitter.wavelength_nm"},
        ),
        (
            {"lens__shape": "none"},
            {"lens.focus_mm", "lens.design_index", "emitter.wavelength_nm", "receivers.gap_mm"},
            {"lens.half_width_mm"},
        ),
        (
            {"lens__design_index": 1.49, "receivers__coupling": "air-gap", "receivers__gap_mm": 0.5},
            {"emitter.wavelength_nm"},
            {"lens.design_index", "receivers.gap_mm"},
        ),
    ],
)
def test_numbers_without_an_effect_of_their_own_are_inert(
    values: dict[str, object], without: set[str], active: set[str]
) -> None:
    sensor = Sensor.of(design(**values))
    assert {key for key in OPTICAL_KEYS if why_inert(sensor, key)} == without | {
        "emitter.width_mm",
        *IN_SPACE,
    }  # the emitter is a point in the plane
    assert not any(why_inert(sensor, key) for key in active)
    for key in without:
        with pytest.raises(SpecError, match="omit "):
            sensor.sensitivity([key])


@pytest.mark.parametrize("key", ["emitter.rays", "lens.shape", "body.bogus", "bogus", "motion.pivot", "name"])
def test_refuses_keys_that_are_not_real_numbers(paper: Sensor, key: str) -> None:
    with pytest.raises(SpecError, match=key):
        paper.sensitivity([key])


def test_value_at_its_limit_has_no_derivative() -> None:
    (row,) = Sensor.of(design(emitter__cone_deg=360)).sensitivity(["emitter.cone_deg"], ANGLE_DEG)
    assert not row.reached
    assert "both sides of 360" in str(row.why)


def test_contrast_has_no_derivative_without_light() -> None:
    (row,) = Sensor.of(design(material__absorption_per_mm=1000.0)).sensitivity(["body.arm_width_mm"])
    assert row.reached
    assert row.right.value == 0.0
    assert math.isnan(row.contrast.value)


def test_refuses_light_that_cannot_be_integrated_in_one_line() -> None:
    sensor = Sensor.of(design(receivers__coupling="air-gap", receivers__gap_mm=0.5))
    with pytest.raises(DesignError, match=r"light at 0\.2 deg") as error_info:
        sensor.sensitivity(["body.arm_width_mm"], ANGLE_DEG)
    assert str(error_info.value).endswith("try another angle")


def test_progress_reaches_1(paper: Sensor) -> None:
    fractions: list[float] = []
    paper.sensitivity(TWO_KEYS, ANGLE_DEG, fractions.append)
    assert fractions == [0.5, 1.0]


def test_trace_options_are_passed_on(paper: Sensor) -> None:
    result = paper.trace(ANGLE_DEG, "roulette", 64, sampling="sobol", seed=3, position_bins=2, angle_bins=5)
    assert (result.mode, result.method, result.rays) == ("roulette", "sobol", 64)
    assert result.detectors["left"].power_by_position.shape == (1, 2)
    assert result.detectors["left"].power_by_angle.shape == (5,)
    assert paper.trace(ANGLE_DEG, "power", 64, precision="single").single_error is not None


def test_chip_in_space_has_derivatives() -> None:
    """The derivative agrees with a difference of integrals."""
    sensor = Sensor.of(loads(template()))
    (row,) = sensor.sensitivity(["emitter.offset_mm"], -1.0)
    ends = [Sensor.of(with_values(sensor.design, {row.key: offset})) for offset in (-0.01, 0.01)]
    low, high = (end.power([-1.0], tolerance=1e-5).contrast[0] for end in ends)
    assert row.reached
    assert row.contrast.value == pytest.approx((high - low) / 0.02, abs=row.contrast.u_value + 3e-3)
    assert row.contrast.u_value < 1e-2 * abs(row.contrast.value)


def test_refuses_derivatives_of_scattered_light_in_space() -> None:
    scattering = loads(dumps(loads(template())) + '\n[[wall]]\nface = "stem-*"\nscatter = "lambertian"\n')
    with pytest.raises(DesignError, match=r"sensitivity; .*a scene that scatters"):
        Sensor.of(scattering).sensitivity()
