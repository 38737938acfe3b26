"""A study of a design over its motion, with and without its lens, and its progress."""

import numpy as np
import pytest

import solen.sensor
from solen.errors import DesignError
from solen.sensor import Case, DesignStudy, study
from solen.spec import Design, loads, template, with_values


def design(**values: object) -> Design:
    """The 860 nm example over three angles, with some values set; ``__`` stands for the dot of a key."""
    settings = {key.replace("__", "."): value for key, value in values.items()}
    return with_values(loads(template("paper-860")), {"motion.step_deg": 3.0, **settings})


@pytest.fixture(scope="module")
def fractions() -> list[float]:
    return []


@pytest.fixture(scope="module")
def paper(fractions: list[float]) -> DesignStudy:
    return study(design(), fractions.append)


@pytest.fixture(scope="module")
def flat(paper: DesignStudy) -> Case:
    assert paper.no_lens is not None
    return paper.no_lens


def test_both_cases_have_counts_and_powers_at_the_same_angles(paper: DesignStudy, flat: Case) -> None:
    assert paper.with_lens is not None
    assert paper.case is paper.with_lens
    assert paper.cases == {"lens": paper.with_lens, "no_lens": flat}
    assert paper.no_lens_refused is None
    assert paper.with_lens.sensor.has_lens
    assert not flat.sensor.has_lens
    for case in (paper.with_lens, flat):
        assert case.count is not None
        assert (case.count.mode, case.power.mode) == ("count", "power")
        for response in (case.count, case.power):
            assert list(response.angle_deg) == [-3.0, 0.0, 3.0]
        assert (case.count.rays == 100).all()
        assert (case.power.rays > 200).all()


def test_lens_separates_the_receivers_and_the_flat_face_does_not(paper: DesignStudy, flat: Case) -> None:
    assert paper.with_lens is not None
    assert paper.with_lens.power.contrast[0] > 0.99
    assert paper.with_lens.power.contrast[-1] < -0.99
    assert np.abs(flat.power.contrast).max() < 0.12


def test_slope_of_a_case_is_at_its_null(paper: DesignStudy, flat: Case) -> None:
    assert paper.with_lens is not None
    for case in (paper.with_lens, flat):
        assert case.null_deg == case.power.null_deg() == pytest.approx(0.0, abs=1e-3)
        assert case.null_deg is not None
        slope = case.sensor.slope_per_deg(case.null_deg)
        assert slope is not None
        assert (case.slope_per_deg, case.u_slope_per_deg) == (slope.value, slope.u_value)
        assert case.u_null_deg == 0.0  # by symmetry
    assert paper.with_lens.slope_per_deg is not None
    assert flat.slope_per_deg is not None
    assert paper.with_lens.slope_per_deg < -2.0 < flat.slope_per_deg < 0.0


def test_slope_does_not_depend_on_the_angles(paper: DesignStudy) -> None:
    assert paper.with_lens is not None
    for values in ({"motion.step_deg": 1.5}, {"motion.from_deg": 0.0}):
        case = study(with_values(paper.design, values)).with_lens
        assert case is not None
        assert case.slope_per_deg == pytest.approx(paper.with_lens.slope_per_deg, rel=0.05)


def test_slope_is_none_without_a_null() -> None:
    case = study(design(motion__from_deg=1.0, lens__shape="none")).case
    assert (case.null_deg, case.slope_per_deg) == (None, None)


def test_slope_is_none_without_light() -> None:
    case = study(design(material__absorption_per_mm=1000.0, lens__shape="none")).case
    assert (case.null_deg, case.slope_per_deg) == (None, None)


def test_progress_rises_to_one(paper: DesignStudy, fractions: list[float]) -> None:
    assert paper.with_lens is not None
    assert len(fractions) > 4
    assert fractions == sorted(fractions)
    assert 0.0 < fractions[0] < 0.2
    assert fractions[-1] == 1.0


def test_design_without_lens_has_one_case() -> None:
    fractions: list[float] = []
    result = study(design(lens__shape="none"), fractions.append)
    assert result.with_lens is None
    assert result.case is result.no_lens
    assert result.cases == {"no_lens": result.no_lens}
    assert result.no_lens_refused is None
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


def test_refuses_an_impossible_motion_before_the_first_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_ray(*_: object, **__: object) -> None:
        raise AssertionError("traced")

    monkeypatch.setattr("solen.sensor.sensor.trace", no_ray)
    fractions: list[float] = []
    with pytest.raises(DesignError, match="inside the body"):
        study(design(motion__moves=["emitter"], motion__pivot=[30.0, 0.0]), fractions.append)
    assert fractions == []


@pytest.mark.parametrize(
    "values",
    [
        {"emitter__cone_deg": 1.0},
        {"emitter__rays": 1},
        {
            "receivers__coupling": "air-gap",
            "receivers__gap_mm": 0.5,
            "material__absorption_per_mm": 0.2,
            "motion__step_deg": 10.0,
        },
        {"material__absorption_per_mm": 0.02},
        {"motion__moves": ["emitter"]},
        {"motion__pivot": [0.0, 20.0]},
        {"motion__step_deg": 10.0},
        {"motion__from_deg": 1.0, "motion__step_deg": 2.0},
    ],
    ids=str,
)
def test_ledgers_of_unusual_designs_are_complete(values: dict[str, object]) -> None:
    result = study(design(**values))
    for case in (result.with_lens, result.no_lens):
        assert case is not None
        for response in (case.count, case.power):
            assert response is not None
            assert len(response.traces) == len(result.design.motion.angles_deg())
            for trace, right, left in zip(response.traces, response.right, response.left, strict=True):
                assert abs(trace.ledger.total - 1.0) < 1e-12
                assert right + left == pytest.approx(trace.ledger.detected, abs=1e-12)


def test_absorption_reduces_the_power_and_not_the_count() -> None:
    clear, dim = study(design(lens__shape="none")), study(design(lens__shape="none", material__absorption_per_mm=0.02))
    assert clear.no_lens is not None
    assert dim.no_lens is not None
    assert (dim.no_lens.power.right < 0.6 * clear.no_lens.power.right).all()
    assert clear.no_lens.count is not None
    assert dim.no_lens.count is not None
    assert (dim.no_lens.count.right == clear.no_lens.count.right).all()


def test_null_of_a_decentred_chip_is_within_its_uncertainty() -> None:
    result = study(design(lens__shape="cartesian-oval", emitter__offset_mm=0.02, emitter__width_mm=0.2)).case
    assert result.null_deg is not None
    assert result.u_null_deg is not None
    low, high = result.null_deg - 0.05, result.null_deg + 0.05
    ends = result.sensor.power([low, high], tolerance=2e-6).contrast
    true = low + 0.1 * ends[0] / (ends[0] - ends[1])
    assert 0.0 < abs(true - result.null_deg) <= result.u_null_deg < 0.01


def test_symmetric_sensor_is_traced_on_one_side() -> None:
    sensor = solen.sensor.Sensor.of(design(emitter__width_mm=0.2))
    assert sensor.is_symmetric
    assert not sensor.set(offset_mm=0.01).is_symmetric
    assert not sensor.set(pivot=[0.5, 3.0]).is_symmetric
    both = sensor.power([-1.0, 0.0, 1.0])
    assert both.contrast[0] == -both.contrast[2] != 0.0
    assert both.contrast[1] == 0.0
    alone = sensor.power([1.0])
    assert alone.contrast[0] == pytest.approx(both.contrast[2], abs=both.u_contrast[2] + alone.u_contrast[0])


def test_sensor_is_studied_if_its_flat_face_cannot_be_built() -> None:
    off_axis = design(motion__pivot=[30.0, 0.0])
    sensor = solen.sensor.Sensor.of(off_axis)
    for angle_deg in off_axis.motion.angles_deg():
        sensor.body(angle_deg)
    fractions: list[float] = []
    result = study(off_axis, fractions.append)
    assert result.with_lens is not None
    assert result.case is result.with_lens
    assert result.cases == {"lens": result.with_lens}
    assert result.no_lens is None
    with pytest.raises(DesignError) as error_info:
        sensor.without_lens.check()
    assert result.no_lens_refused == str(error_info.value)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
