"""A study: a design over its motion, with lens and without, and what it tells while it goes on."""

import numpy as np
import pytest

import solen.sensor
from solen.errors import DesignError
from solen.sensor import Case, DesignStudy, study
from solen.spec import Design, loads, template, with_values


def design(**values: object) -> Design:
    """The 860 nm example over three angles, with some values set; ``__`` stands for the dot of a key."""
    wanted = {key.replace("__", "."): value for key, value in values.items()}
    return with_values(loads(template("paper-860")), {"motion.step_deg": 3.0, **wanted})


@pytest.fixture(scope="module")
def told() -> list[float]:
    return []


@pytest.fixture(scope="module")
def paper(told: list[float]) -> DesignStudy:
    return study(design(), told.append)


@pytest.fixture(scope="module")
def flat(paper: DesignStudy) -> Case:
    assert paper.no_lens is not None
    return paper.no_lens


def test_both_cases_are_counted_and_in_power_at_the_same_angles(paper: DesignStudy, flat: Case) -> None:
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


def test_the_lens_separates_the_receivers_and_the_flat_face_does_not(paper: DesignStudy, flat: Case) -> None:
    assert paper.with_lens is not None
    assert paper.with_lens.power.contrast[0] > 0.99
    assert paper.with_lens.power.contrast[-1] < -0.99
    assert np.abs(flat.power.contrast).max() < 0.12


def test_the_slope_of_a_case_is_at_its_null(paper: DesignStudy, flat: Case) -> None:
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


def test_the_slope_does_not_depend_on_the_sweep(paper: DesignStudy) -> None:
    assert paper.with_lens is not None
    for values in ({"motion.step_deg": 1.5}, {"motion.from_deg": 0.0}):
        case = study(with_values(paper.design, values)).with_lens
        assert case is not None
        assert case.slope_per_deg == pytest.approx(paper.with_lens.slope_per_deg, rel=0.05)


def test_without_a_null_there_is_no_slope() -> None:
    case = study(design(motion__from_deg=1.0, lens__shape="none")).case
    assert (case.null_deg, case.slope_per_deg) == (None, None)


def test_in_the_dark_there_is_no_slope() -> None:
    case = study(design(material__absorption_per_mm=1000.0, lens__shape="none")).case
    assert (case.null_deg, case.slope_per_deg) == (None, None)


def test_progress_rises_to_one(paper: DesignStudy, told: list[float]) -> None:
    assert paper.with_lens is not None
    assert len(told) > 4
    assert told == sorted(told)
    assert 0.0 < told[0] < 0.2
    assert told[-1] == 1.0


def test_a_design_without_lens_has_one_case() -> None:
    told: list[float] = []
    found = study(design(lens__shape="none"), told.append)
    assert found.with_lens is None
    assert found.case is found.no_lens
    assert found.cases == {"no_lens": found.no_lens}
    assert found.no_lens_refused is None
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_a_motion_that_breaks_the_body_is_refused_before_the_first_ray(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_ray(*_: object, **__: object) -> None:
        raise AssertionError("traced")

    monkeypatch.setattr("solen.sensor.sensor.trace", no_ray)
    told: list[float] = []
    with pytest.raises(DesignError, match="inside the body"):
        study(design(motion__moves=["emitter"], motion__pivot=[30.0, 0.0]), told.append)
    assert told == []


@pytest.mark.parametrize(
    "values",
    [
        {"emitter__cone_deg": 1.0},
        {"emitter__rays": 1},
        {"receivers__coupling": "air-gap", "receivers__gap_mm": 0.5, "motion__step_deg": 10.0},
        {"material__absorption_per_mm": 0.02},
        {"motion__moves": ["emitter"]},
        {"motion__pivot": [0.0, 20.0]},
        {"motion__step_deg": 10.0},
        {"motion__from_deg": 1.0, "motion__step_deg": 2.0},
    ],
    ids=str,
)
def test_odd_designs_are_studied_and_every_ledger_closes(values: dict[str, object]) -> None:
    found = study(design(**values))
    for case in (found.with_lens, found.no_lens):
        assert case is not None
        for response in (case.count, case.power):
            assert response is not None
            assert len(response.traces) == len(found.design.motion.angles_deg())
            for trace, right, left in zip(response.traces, response.right, response.left, strict=True):
                assert abs(trace.ledger.total - 1.0) < 1e-12
                assert right + left == pytest.approx(trace.ledger.detected, abs=1e-12)


def test_absorption_takes_light_from_the_power_and_not_from_the_count() -> None:
    clear, dim = study(design(lens__shape="none")), study(design(lens__shape="none", material__absorption_per_mm=0.02))
    assert clear.no_lens is not None
    assert dim.no_lens is not None
    assert (dim.no_lens.power.right < 0.6 * clear.no_lens.power.right).all()
    assert clear.no_lens.count is not None
    assert dim.no_lens.count is not None
    assert (dim.no_lens.count.right == clear.no_lens.count.right).all()


def test_the_null_of_a_decentred_chip_is_within_its_uncertainty() -> None:
    found = study(design(lens__shape="cartesian-oval", emitter__offset_mm=0.02, emitter__width_mm=0.2)).case
    assert found.null_deg is not None
    assert found.u_null_deg is not None
    low, high = found.null_deg - 0.05, found.null_deg + 0.05
    ends = found.sensor.power([low, high], tolerance=2e-6).contrast
    true = low + 0.1 * ends[0] / (ends[0] - ends[1])
    assert 0.0 < abs(true - found.null_deg) <= found.u_null_deg < 0.01


def test_of_a_symmetric_sensor_one_side_is_traced_and_the_other_is_its_mirror_image() -> None:
    sensor = solen.sensor.Sensor.of(design(emitter__width_mm=0.2))
    assert sensor.is_symmetric
    assert not sensor.set(offset_mm=0.01).is_symmetric
    assert not sensor.set(pivot=[0.5, 3.0]).is_symmetric
    both = sensor.power([-1.0, 0.0, 1.0])
    assert both.contrast[0] == -both.contrast[2] != 0.0
    assert both.contrast[1] == 0.0
    other = sensor.power([1.0])
    assert other.contrast[0] == pytest.approx(both.contrast[2], abs=both.u_contrast[2] + other.u_contrast[0])


def test_a_sensor_that_works_is_studied_though_its_flat_face_would_not() -> None:
    odd = design(motion__pivot=[30.0, 0.0])
    sensor = solen.sensor.Sensor.of(odd)
    for angle_deg in odd.motion.angles_deg():
        sensor.body(angle_deg)
    told: list[float] = []
    found = study(odd, told.append)
    assert found.with_lens is not None
    assert found.case is found.with_lens
    assert found.cases == {"lens": found.with_lens}
    assert found.no_lens is None
    with pytest.raises(DesignError) as refusal:
        sensor.without_lens.check()
    assert found.no_lens_refused == str(refusal.value)
    assert told == sorted(told)
    assert told[-1] == 1.0
