"""Calibration of a process by measured coupons: values, uncertainties and warnings."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.errors import DataError
from solen.fabricate.process import (
    Calibration,
    MeasuredCoupon,
    MeasuredFeature,
    PrinterCalibration,
    Process,
    Settings,
    SharedScale,
    calibrated,
    default_process,
    parsed_process,
    predicted,
    printed_mm,
    process_text,
)
from solen.fabricate.process.features import disc
from solen.fabricate.process.growth import growth_um
from tests.fabricate.print_support import ring, round_target, settings

PILLARS = (1.0, 0.5, 0.3, 0.2, 0.14, 0.1, 0.06)
GAPS = (0.5, 0.3, 0.2, 0.15, 0.1)
HOLES = (1.4, 1.5, 1.65, 0.4, 0.2)
U_MM = 0.003


def designed_features(*, steps: bool = False) -> list[MeasuredFeature]:
    groups = {"pillar": PILLARS, "gap": GAPS, "hole": HOLES} | ({"step": (0.1, 0.5, 1.0)} if steps else {})
    return [
        MeasuredFeature(kind, nominal, None, None, resolved=True)  # type: ignore[arg-type]  # keys of a dict
        for kind, sizes in groups.items()
        for nominal in sizes
    ]


def measured(
    features: list[MeasuredFeature], sizes: NDArray[np.float64], rng: np.random.Generator
) -> list[MeasuredFeature]:
    """Return features with simulated measurements of printed sizes."""
    return [
        dataclasses.replace(feature, measured_mm=None, resolved=False)
        if np.isnan(size)
        else dataclasses.replace(feature, measured_mm=float(size + U_MM * rng.standard_normal()), u_measured_mm=U_MM)
        for feature, size in zip(features, sizes, strict=True)
    ]


def coupon(features: list[MeasuredFeature], u_scale: float | None = 1e-4, **values: Any) -> list[MeasuredCoupon]:
    """Return a single image of features."""
    return [MeasuredCoupon(tuple(features), SharedScale(5.0, u_scale), SharedScale(0.1, u_scale), **values)]


def standardised_errors(result: PrinterCalibration, true: list[float]) -> NDArray[np.float64]:
    """Return the errors of calibrated numbers, divided by their uncertainties."""
    return np.array([(number.value - value) / number.u for number, value in zip(result.numbers, true, strict=True)])


@pytest.fixture(scope="module")
def true() -> Settings:
    return settings(sigma_um=22.0, Ec_mJ_per_cm2=3.2, shrinkage_percent=0.4, shrinkage_z_percent=2.0)


def test_a_blurred_disc_at_its_centre_and_at_its_edge() -> None:
    for radius in (5.0, 30.0, 200.0):
        centre = disc(np.zeros(1), np.array([radius]), 15.0)
        assert centre == pytest.approx(1.0 - np.exp(-0.5 * (radius / 15.0) ** 2), abs=1e-7)
    # the edge of a large disc differs from a straight one by its curvature, σ/(2R)/√(2π) = 0.0002
    assert disc(np.array([15e3]), np.array([15e3]), 15.0) == pytest.approx(0.5, abs=3e-4)


def test_the_integral_of_a_blurred_disc_is_its_area() -> None:
    r = np.linspace(0.0, 220.0, 2201)
    light = disc(r, np.full_like(r, 60.0), 20.0)
    assert float(np.trapezoid(2 * np.pi * r * light, r)) == pytest.approx(np.pi * 60.0**2, rel=1e-5)


def test_large_features_grow_by_twice_the_growth_of_a_wall(true: Settings) -> None:
    flat = true.model_copy(update={"shrinkage_percent": 0.0})
    features = [MeasuredFeature("pillar", 8.0, None, None, True), MeasuredFeature("hole", 8.0, None, None, True)]
    pillar, hole = printed_mm(flat, features)
    # the curvature of a radius of 4 mm within a halo of 60 µm: 60²/(2 · 4000) = 0.5 µm
    assert 0.5e3 * (pillar - 8.0) == pytest.approx(growth_um(flat), abs=0.6)
    assert 0.5e3 * (8.0 - hole) == pytest.approx(growth_um(flat), abs=0.6)


def test_small_features_are_not_printed(true: Settings) -> None:
    features = [
        MeasuredFeature("pillar", 0.01, None, None, True),
        MeasuredFeature("gap", 0.05, None, None, True),
        MeasuredFeature("hole", 0.05, None, None, True),
        MeasuredFeature("step", 0.01, None, None, True),
    ]
    assert np.isnan(printed_mm(true, features)).all()


@pytest.fixture(scope="module")
def calibration(true: Settings) -> PrinterCalibration:
    features = designed_features(steps=True)
    return calibrated(
        default_process(), coupon(measured(features, printed_mm(true, features), np.random.default_rng(3))), "test"
    )


def test_recovers_the_process_that_printed_the_coupons(true: Settings, calibration: PrinterCalibration) -> None:
    values = [22.0, growth_um(true), 0.4, 2.0]
    keys = ["sigma_um", "growth_um", "shrinkage_percent", "shrinkage_z_percent"]
    assert [number.key for number in calibration.numbers] == keys
    assert np.all(np.abs(standardised_errors(calibration, values)) < 3.5)  # exceeded with a probability of 1 in 2000
    assert calibration.numbers[1].u < 0.6  # 20 sizes with 3 µm determine an edge to 3/2/√20 µm
    assert calibration.scale < 1.5
    assert not calibration.disagree
    assert calibration.process.uncertainty["sigma_um"] == pytest.approx(calibration.numbers[0].u)
    assert calibration.process.source["Ec_mJ_per_cm2"].startswith("calibration: ")
    assert parsed_process(process_text(calibration.process), "copy") == calibration.process


@pytest.mark.evidence
def test_uncertainties_are_calibrated(true: Settings) -> None:
    """The standardised errors of 60 calibrations have a spread of 1; the bounds are exceeded in 1 % of all cases."""
    features, rng = designed_features(), np.random.default_rng(11)
    sizes, values = printed_mm(true, features), [22.0, growth_um(true), 0.4]
    errors = []
    for _ in range(60):
        result = calibrated(default_process(), coupon(measured(features, sizes, rng)), "test")
        errors.append(standardised_errors(result, values))
    spread = np.std(errors, axis=0)
    print("spread of standardised errors", spread, "mean", np.mean(errors, axis=0))
    assert np.all((spread > 0.75) & (spread < 1.25))


def test_the_calibrated_growth_is_kept_if_other_parameters_vary(calibration: PrinterCalibration) -> None:
    """After a calibration, the uncertainty of washing and exposure hardly affects a part."""
    before, after = default_process(), calibration.process
    assert after.keeps_growth
    target = round_target(0.4)
    u_before, u_after = (
        predicted([ring(0.4)], target, process, 1.0, height_um=500.0).contributions_um for process in (before, after)
    )
    assert u_before["wash_um"] == pytest.approx(10.0, abs=0.1)
    assert u_after["wash_um"] < 2.0  # due to the difference of the edge of a small disc from a straight wall
    assert u_after["growth_um"] < 0.6
    assert "Ec_mJ_per_cm2" not in u_after


def test_large_features_alone_do_not_determine_the_blur(true: Settings) -> None:
    features = [MeasuredFeature("hole", 1.4 + 0.05 * i, None, None, True) for i in range(6)]
    result = calibrated(
        default_process(), coupon(measured(features, printed_mm(true, features), np.random.default_rng(2))), "holes"
    )
    assert any("sigma_um" in text and "prior" in text for text in result.warnings)
    assert any("cannot be determined separately" in text for text in result.warnings)


def test_excess_scatter_increases_uncertainties_and_is_reported(true: Settings) -> None:
    features = designed_features()
    sizes = printed_mm(true, features) + np.random.default_rng(8).normal(0.0, 0.02, len(features))
    result = calibrated(default_process(), coupon(measured(features, sizes, np.random.default_rng(2))), "rough")
    assert result.scale > 2.0
    assert any("uncertaint" in text and "times" in text for text in result.warnings)


def test_names_features_that_contradict_the_process(true: Settings) -> None:
    features = measured(designed_features(), printed_mm(true, designed_features()), np.random.default_rng(2))
    open_gap = MeasuredFeature("gap", 0.04, 0.03, U_MM, resolved=True)
    result = calibrated(default_process(), coupon([*features, open_gap]), "gap")
    assert open_gap in result.disagree
    assert any("gap of 0.04 mm" in text for text in result.warnings)


def test_refuses_too_few_features() -> None:
    with pytest.raises(DataError, match="at least 3"):
        calibrated(default_process(), coupon([MeasuredFeature("pillar", 1.0, 1.05, 0.01, resolved=True)]), "one")


def test_refuses_an_invalid_covariance() -> None:
    with pytest.raises(DataError, match="covariance"):
        Calibration(keys=("sigma_um", "growth_um"), covariance=((1.0, 2.0), (2.0, 1.0)))
    with pytest.raises(DataError, match="colour"):
        Calibration(keys=("colour",), covariance=((1.0,),))


def test_changing_a_calibrated_value_discards_the_calibration() -> None:
    process = Process(
        name="test",
        process=settings(),
        uncertainty={"sigma_um": 1.0, "wash_um": 2.0},
        calibration=Calibration(keys=("sigma_um",), covariance=((1.0,),)),
    )
    assert process.with_settings(pixel_um=30.0).calibration is not None
    changed = process.with_settings(sigma_um=30.0)
    assert changed.calibration is None
    assert changed.uncertainty == {"wash_um": 2.0}
    keys, covariance = process.covariance()
    assert keys == ("sigma_um", "wash_um")
    assert covariance.tolist() == [[1.0, 0.0], [0.0, 4.0]]
