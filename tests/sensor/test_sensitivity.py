"""How the readings answer to the numbers of a design: against differences of integrals, and what is left out and why.

The differences share nothing with the derivatives but the integral: `Sensor.integrate` finds the pieces of the cone
anew in each of the four scenes.
"""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.errors import DesignError, SpecError
from solen.geometry import arm_angle_deg
from solen.sensor import OPTICAL_KEYS, Sensor, inert
from solen.spec import Design, dumps, loads, template, value_at, with_values

ANGLE_DEG = 0.2
KEYS = (
    *("body.arm_angle_deg", "body.arm_width_mm", "emitter.distance_mm"),
    *("material.index", "lens.half_width_mm", "lens.focus_mm"),
)
FEW = KEYS[:2]
RELATIVE, STEP = 1e-4, 1e-3
IN_SPACE = ("emitter.height_mm", "body.thickness_mm")
NOISE = 3e-10
"""What four integrals to 1e-11 may make of a difference, also of contrasts, before it is divided by the step."""


def design(**values: object) -> Design:
    """The 860 nm example with some values set; ``__`` stands for the dot of a key."""
    return with_values(loads(template("paper-860")), {key.replace("__", "."): value for key, value in values.items()})


@pytest.fixture(scope="module")
def paper() -> Sensor:
    return Sensor.of(design())


def integrated(one: Design, tolerance: float) -> NDArray[np.float64]:
    """Right and left power, and the contrast."""
    found = Sensor.of(one).integrate(ANGLE_DEG, tolerance=tolerance).detectors
    right, left = found["right"].power, found["left"].power
    return np.array([right, left, (right - left) / (right + left)])


def differences(one: Design, key: str, value: float, tolerance: float) -> NDArray[np.float64]:
    """Central differences of fourth order of right, left and contrast."""
    h = STEP * value
    near, far = (integrated(with_values(one, {key: value + n * h}), tolerance) for n in (1, 2))
    near, far = (
        near - integrated(with_values(one, {key: value - h}), tolerance),
        far - integrated(with_values(one, {key: value - 2 * h}), tolerance),
    )
    return np.asarray((8.0 * near - far) / (12.0 * h))


def compared(sensor: Sensor, keys: tuple[str, ...], tolerance: float = 1e-11) -> list[str]:
    """One line a key; fails where a derivative is off by more than it may be."""
    lines = []
    for row in sensor.sensitivity(keys, ANGLE_DEG):
        by_difference = differences(sensor.design, row.key, row.value, tolerance)
        assert row.reached
        for what, slope, other in zip(
            ("right", "left", "contrast"), (row.right, row.left, row.contrast), by_difference, strict=True
        ):
            off = abs(slope.value - other)
            lines.append(
                f"{row.key:21} {what:9} {slope.value:+.9f} {other:+.9f} {off / abs(other):.0e} {slope.u_value:.0e}"
            )
            assert off <= RELATIVE * abs(other), lines[-1]
            assert off <= slope.u_value + NOISE / (STEP * row.value), lines[-1]
    return lines


def test_two_keys_agree_with_differences_of_integrals(paper: Sensor) -> None:
    compared(paper, FEW)


@pytest.mark.evidence
def test_every_key_agrees_with_differences_of_integrals(paper: Sensor) -> None:
    print(f"\nat {ANGLE_DEG} deg, per unit: by derivative, by difference, relative distance, stated u")
    print("\n".join(compared(paper, KEYS)))


def touched(**film: object) -> Sensor:
    """Something of the body's own index touches both outer walls, behind a film or bare."""
    wall = {"face": "outer-*", "outside": "skin", "index": 1.44, **film}
    return Sensor.of(Design.model_validate({"name": "touched", "material": {"index": 1.44}, "wall": [wall]}))


def test_behind_a_film_of_air_the_index_of_what_touches_may_be_the_same() -> None:
    compared(touched(gap_um=0.3), ("material.index",), tolerance=1e-10)


def test_where_the_same_index_touches_the_search_for_pieces_comes_to_an_end() -> None:
    """On one side of the matched index light is reflected totally: pieces are lost there, and it is said."""
    sensor = touched()
    with pytest.raises(SpecError, match="a medium of the same index touches a wall"):
        sensor.sensitivity(["material.index"], ANGLE_DEG)
    found = sensor.derivative("material.index", ANGLE_DEG)
    assert not found.reached
    assert "within" in found.why


def test_the_search_for_pieces_has_a_bound(paper: Sensor, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("solen.trace.cone.MAX_LEGS_AGAIN", 1000)
    assert not paper.derivative("body.arm_width_mm", ANGLE_DEG).reached


def test_rows_are_of_the_design_s_own_numbers_and_what_matters_most_comes_first(paper: Sensor) -> None:
    rows = paper.sensitivity(angle_deg=ANGLE_DEG)
    left_out = {"emitter.wavelength_nm", "emitter.width_mm", "lens.design_index", "receivers.gap_mm"}
    left_out |= {"emitter.height_mm", "body.thickness_mm"}
    assert {row.key for row in rows} == set(OPTICAL_KEYS) - left_out
    for row in rows:
        stated = value_at(paper.design, row.key)
        assert row.value == (arm_angle_deg(paper.design) if row.key == "body.arm_angle_deg" else stated)
    effects = [abs(row.contrast.value) * row.tolerance for row in rows if row.reached]
    assert effects == sorted(effects, reverse=True)
    steepest = max((row for row in rows if row.reached), key=lambda row: abs(row.contrast.value))
    assert (steepest.key, rows[0].key) == (
        "body.stem_curve_per_mm",
        "emitter.offset_mm",
    )  # by raw unit, and by what matters
    assert rows[0].tolerance == paper.design.tolerance.emitter_offset_mm
    assert rows[-1].key == "material.absorption_per_mm"
    assert not rows[-1].reached
    assert math.isnan(rows[-1].contrast.value)
    assert "both sides of 0" in str(rows[-1].why)


def test_a_part_of_the_body_behind_the_light_changes_nothing(paper: Sensor) -> None:
    (arms,) = paper.sensitivity(["body.arm_length_mm"], ANGLE_DEG)
    for slope in (arms.right, arms.left, arms.contrast):  # straight arms without loss: the light is theirs already
        assert abs(slope.value) <= 5.0 * slope.u_value < 1e-6


def test_a_mirror_image_swaps_the_receivers(paper: Sensor) -> None:
    (one,), (other,) = (paper.sensitivity(["body.arm_width_mm"], angle) for angle in (ANGLE_DEG, -ANGLE_DEG))
    assert one.right.value == pytest.approx(other.left.value, abs=1e-6)
    assert one.contrast.value == pytest.approx(-other.contrast.value, abs=1e-6)


@pytest.mark.parametrize(
    ("values", "without", "live"),
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
def test_numbers_without_a_part_of_their_own_are_left_out(
    values: dict[str, object], without: set[str], live: set[str]
) -> None:
    sensor = Sensor.of(design(**values))
    assert {key for key in OPTICAL_KEYS if inert(sensor, key)} == without | {
        "emitter.width_mm",
        *IN_SPACE,
    }  # it is a point in the plane
    assert not any(inert(sensor, key) for key in live)
    for key in without:
        with pytest.raises(SpecError, match="omit it"):
            sensor.sensitivity([key])


@pytest.mark.parametrize("key", ["emitter.rays", "lens.shape", "body.bogus", "bogus", "motion.pivot", "name"])
def test_what_is_no_real_number_is_refused(paper: Sensor, key: str) -> None:
    with pytest.raises(SpecError, match=key):
        paper.sensitivity([key])


def test_a_value_at_its_limit_says_so() -> None:
    (row,) = Sensor.of(design(emitter__cone_deg=360)).sensitivity(["emitter.cone_deg"], ANGLE_DEG)
    assert not row.reached
    assert "both sides of 360" in str(row.why)


def test_in_the_dark_there_is_no_contrast_to_change() -> None:
    (row,) = Sensor.of(design(material__absorption_per_mm=1000.0)).sensitivity(["body.arm_width_mm"])
    assert row.reached
    assert row.right.value == 0.0
    assert math.isnan(row.contrast.value)


def test_light_that_cannot_be_integrated_is_one_line() -> None:
    sensor = Sensor.of(design(receivers__coupling="air-gap", receivers__gap_mm=0.5))
    with pytest.raises(DesignError, match=r"light at 0\.2 deg") as refusal:
        sensor.sensitivity(["body.arm_width_mm"], ANGLE_DEG)
    assert str(refusal.value).endswith("try another angle")


def test_progress_is_reported_to_its_end(paper: Sensor) -> None:
    told: list[float] = []
    paper.sensitivity(FEW, ANGLE_DEG, told.append)
    assert told == [0.5, 1.0]


def test_options_of_a_trace_are_passed_on(paper: Sensor) -> None:
    found = paper.trace(ANGLE_DEG, "roulette", 64, sampling="sobol", seed=3, position_bins=2, angle_bins=5)
    assert (found.mode, found.method, found.rays) == ("roulette", "sobol", 64)
    assert found.detectors["left"].power_by_position.shape == (1, 2)
    assert found.detectors["left"].power_by_angle.shape == (5,)
    assert paper.trace(ANGLE_DEG, "power", 64, precision="single").single_error is not None


def test_a_chip_in_space_has_derivatives() -> None:
    """Held to a difference of close integrals."""
    sensor = Sensor.of(loads(template()))
    (row,) = sensor.sensitivity(["emitter.offset_mm"], -1.0)
    ends = [Sensor.of(with_values(sensor.design, {row.key: half})) for half in (-0.01, 0.01)]
    low, high = (end.power([-1.0], tolerance=1e-5).contrast[0] for end in ends)
    assert row.reached
    assert row.contrast.value == pytest.approx((high - low) / 0.02, abs=row.contrast.u_value + 3e-3)
    assert row.contrast.u_value < 1e-2 * abs(row.contrast.value)


def test_light_in_space_that_is_not_integrated_has_no_derivative() -> None:
    rough = loads(dumps(loads(template())) + '\n[[wall]]\nface = "stem-*"\nscatter = "lambertian"\n')
    with pytest.raises(DesignError, match="sensitivity = 'a scene that scatters'"):
        Sensor.of(rough).sensitivity()
