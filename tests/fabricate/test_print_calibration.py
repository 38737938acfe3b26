"""A process from measured coupons: what it finds, how sure it is, and what it says it cannot tell."""

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


def drawn(*, steps: bool = False) -> list[MeasuredFeature]:
    groups = {"pillar": PILLARS, "gap": GAPS, "hole": HOLES} | ({"step": (0.1, 0.5, 1.0)} if steps else {})
    return [
        MeasuredFeature(kind, nominal, None, None, resolved=True)  # type: ignore[arg-type]  # kinds by name
        for kind, sizes in groups.items()
        for nominal in sizes
    ]


def measured(
    features: list[MeasuredFeature], sizes: NDArray[np.float64], rng: np.random.Generator
) -> list[MeasuredFeature]:
    """What a microscope would find of printed sizes."""
    return [
        dataclasses.replace(one, measured_mm=None, resolved=False)
        if np.isnan(size)
        else dataclasses.replace(one, measured_mm=float(size + U_MM * rng.standard_normal()), u_measured_mm=U_MM)
        for one, size in zip(features, sizes, strict=True)
    ]


def coupon(features: list[MeasuredFeature], u_scale: float | None = 1e-4, **more: Any) -> list[MeasuredCoupon]:
    """One image of these features."""
    return [MeasuredCoupon(tuple(features), SharedScale(5.0, u_scale), SharedScale(0.1, u_scale), **more)]


def off_in_u(found: PrinterCalibration, wanted: list[float]) -> NDArray[np.float64]:
    """Errors of the numbers in their uncertainties."""
    return np.array([(one.value - right) / one.u for one, right in zip(found.numbers, wanted, strict=True)])


@pytest.fixture(scope="module")
def true() -> Settings:
    return settings(sigma_um=22.0, Ec_mJ_per_cm2=3.2, shrinkage_percent=0.4, shrinkage_z_percent=2.0)


def test_a_blurred_disc_in_its_middle_and_far_from_its_edge() -> None:
    for radius in (5.0, 30.0, 200.0):
        middle = disc(np.zeros(1), np.array([radius]), 15.0)
        assert middle == pytest.approx(1.0 - np.exp(-0.5 * (radius / 15.0) ** 2), abs=1e-7)
    # a wide disc's edge is a straight one's but for its curvature, σ/(2R)/√(2π) = 0.0002
    assert disc(np.array([15e3]), np.array([15e3]), 15.0) == pytest.approx(0.5, abs=3e-4)


def test_a_blurred_disc_keeps_its_light() -> None:
    """Its integral over the plane is its area."""
    r = np.linspace(0.0, 220.0, 2201)
    found = disc(r, np.full_like(r, 60.0), 20.0)
    assert float(np.trapezoid(2 * np.pi * r * found, r)) == pytest.approx(np.pi * 60.0**2, rel=1e-5)


def test_large_features_grow_by_twice_the_growth_of_a_wall(true: Settings) -> None:
    flat = true.model_copy(update={"shrinkage_percent": 0.0})
    features = [MeasuredFeature("pillar", 8.0, None, None, True), MeasuredFeature("hole", 8.0, None, None, True)]
    pillar, hole = printed_mm(flat, features)
    # the halo of some 60 um sees the curvature of a radius of 4 mm: 60²/(2 · 4000) = 0.5 um
    assert 0.5e3 * (pillar - 8.0) == pytest.approx(growth_um(flat), abs=0.6)
    assert 0.5e3 * (8.0 - hole) == pytest.approx(growth_um(flat), abs=0.6)


def test_small_things_vanish_and_close(true: Settings) -> None:
    features = [
        MeasuredFeature("pillar", 0.01, None, None, True),
        MeasuredFeature("gap", 0.05, None, None, True),
        MeasuredFeature("hole", 0.05, None, None, True),
        MeasuredFeature("step", 0.01, None, None, True),
    ]
    assert np.isnan(printed_mm(true, features)).all()


@pytest.fixture(scope="module")
def found(true: Settings) -> PrinterCalibration:
    features = drawn(steps=True)
    return calibrated(
        default_process(), coupon(measured(features, printed_mm(true, features), np.random.default_rng(3))), "test"
    )


def test_calibration_finds_the_process_that_printed_the_coupons(true: Settings, found: PrinterCalibration) -> None:
    wanted = [22.0, growth_um(true), 0.4, 2.0]
    assert [one.key for one in found.numbers] == [
        *("sigma_um", "growth_um", "shrinkage_percent", "shrinkage_z_percent")
    ]
    assert np.all(np.abs(off_in_u(found, wanted)) < 3.5)  # one in two thousand by chance
    assert found.numbers[1].u < 0.6  # 20 sizes known to 3 um tell an edge to 3/2/√20
    assert found.scale < 1.5
    assert not found.disagree
    assert found.process.uncertainty["sigma_um"] == pytest.approx(found.numbers[0].u)
    assert found.process.source["Ec_mJ_per_cm2"].startswith("calibration: ")
    assert parsed_process(process_text(found.process), "again") == found.process


@pytest.mark.evidence
def test_calibrated_intervals_hold_what_they_say(true: Settings) -> None:
    """Errors of 60 calibrations have a spread of one uncertainty; by chance 60 leave the bounds once in 100."""
    features, rng = drawn(), np.random.default_rng(11)
    sizes, wanted = printed_mm(true, features), [22.0, growth_um(true), 0.4]
    off = []
    for _ in range(60):
        found = calibrated(default_process(), coupon(measured(features, sizes, rng)), "test")
        off.append(off_in_u(found, wanted))
    spread = np.std(off, axis=0)
    print("spread of standardised errors", spread, "mean", np.mean(off, axis=0))
    assert np.all((spread > 0.75) & (spread < 1.25))


def test_what_is_calibrated_is_kept_when_other_numbers_vary(found: PrinterCalibration) -> None:
    """The growth of walls is known: what washing or exposure may be no longer moves the lens."""
    before, after = default_process(), found.process
    assert after.keeps_growth
    target = round_target(0.4)
    told = {
        name: predicted([ring(0.4)], target, one, 1.0, height_um=500.0).contributions_um
        for name, one in (("before", before), ("after", after))
    }
    assert told["before"]["wash_um"] == pytest.approx(10.0, abs=0.1)
    assert told["after"]["wash_um"] < 2.0  # 10 um, but for what the edge of so small a disc is unlike a wall
    assert told["after"]["growth_um"] < 0.6
    assert "Ec_mJ_per_cm2" not in told["after"]


def test_large_features_alone_do_not_tell_the_blur(true: Settings) -> None:
    features = [MeasuredFeature("hole", 1.4 + 0.05 * i, None, None, True) for i in range(6)]
    found = calibrated(
        default_process(), coupon(measured(features, printed_mm(true, features), np.random.default_rng(2))), "holes"
    )
    assert any("sigma_um" in text and "keeps its prior value" in text for text in found.warnings)
    assert any("cannot be separated" in text for text in found.warnings)


def test_scatter_beyond_what_is_stated_widens_and_is_reported(true: Settings) -> None:
    features = drawn()
    sizes = printed_mm(true, features) + np.random.default_rng(8).normal(0.0, 0.02, len(features))
    found = calibrated(default_process(), coupon(measured(features, sizes, np.random.default_rng(2))), "rough")
    assert found.scale > 2.0
    assert any("times their reported uncertainty" in text for text in found.warnings)


def test_features_that_should_not_be_there_are_named(true: Settings) -> None:
    features = measured(drawn(), printed_mm(true, drawn()), np.random.default_rng(2))
    there = MeasuredFeature("gap", 0.04, 0.03, U_MM, resolved=True)
    found = calibrated(default_process(), coupon([*features, there]), "odd")
    assert there in found.disagree
    assert any("gap of 0.04 mm" in text for text in found.warnings)


def test_too_few_features_are_refused() -> None:
    with pytest.raises(DataError, match="at least 3 pillars, holes or gaps"):
        calibrated(default_process(), coupon([MeasuredFeature("pillar", 1.0, 1.05, 0.01, resolved=True)]), "one")


def test_a_covariance_must_be_one() -> None:
    with pytest.raises(DataError, match="symmetric"):
        Calibration(keys=("sigma_um", "growth_um"), covariance=((1.0, 2.0), (2.0, 1.0)))
    with pytest.raises(DataError, match="must be some of"):
        Calibration(keys=("colour",), covariance=((1.0,),))


def test_values_set_by_hand_leave_the_calibration_behind() -> None:
    one = Process(
        name="one",
        process=settings(),
        uncertainty={"sigma_um": 1.0, "wash_um": 2.0},
        calibration=Calibration(keys=("sigma_um",), covariance=((1.0,),)),
    )
    assert one.with_settings(pixel_um=30.0).calibration is not None
    changed = one.with_settings(sigma_um=30.0)
    assert changed.calibration is None
    assert changed.uncertainty == {"wash_um": 2.0}
    keys, covariance = one.covariance()
    assert keys == ("sigma_um", "wash_um")
    assert covariance.tolist() == [[1.0, 0.0], [0.0, 4.0]]
