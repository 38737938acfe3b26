"""Toes: a known slack is found within its stated uncertainty, and none is found where there is none."""

import numpy as np
import pytest

from solen.material.stiffness import (
    UNIAXIAL,
    Dimensions,
    StiffnessOptions,
    StressStrain,
    as_test,
    evaluate,
    find_toe,
    model,
    specimen_of,
)

BARE = specimen_of(Dimensions())


def slack(strain: np.ndarray, shift: float) -> np.ndarray:
    """What the specimen feels while slack is taken up quadratically; from 2·shift on it lags by shift."""
    if shift == 0:
        return strain
    return np.where(strain < 2 * shift, strain**2 / (4 * shift), strain - shift)


def pressed(shift: float, *, gap: float = 0.0, noise: float = 0.0, kind: str = "neo-hookean") -> StressStrain:
    """A compressed rubber, 0.9 MPa, behind a gap and slack."""
    parameters = {"neo-hookean": [0.15], "yeoh": [0.15, 0.015, 0.004], "mooney-rivlin": [0.11, 0.04]}[kind]
    strain = np.linspace(0, 0.45, 3000)
    felt = slack(np.maximum(strain - gap, 0), shift)
    stress = model(kind).stress(parameters, UNIAXIAL, 1 - felt)
    stress += noise * np.random.default_rng(8).standard_normal(len(strain))
    return as_test(-strain, stress, BARE, "compression")


@pytest.mark.parametrize("shift", [0.005, 0.02, 0.05])
def test_a_toe_before_a_neo_hookean_curve_is_found(shift: float) -> None:
    found = find_toe(pressed(shift))
    assert found.shift == pytest.approx(-shift, abs=1e-6)  # the tangent is the curve itself
    assert 0.5 * shift < found.end < max(2 * shift, 0.025)  # known to one of its steps of stress


@pytest.mark.parametrize("kind", ["neo-hookean", "yeoh", "mooney-rivlin"])
@pytest.mark.parametrize("shift", [0.02, 0.04])
def test_a_toe_under_noise_is_found_to_half_a_per_cent_of_strain(kind: str, shift: float) -> None:
    found = find_toe(pressed(shift, noise=0.001, kind=kind))  # a tangent to a curve that bends is off by its bending
    assert found.shift == pytest.approx(-shift, abs=0.006)
    assert found.u_shift is not None
    assert 0 < found.u_shift < 0.006


def test_a_gap_before_contact_is_found() -> None:
    found = find_toe(pressed(0.005, gap=0.08, noise=0.0005))
    assert found.shift == pytest.approx(-0.085, abs=0.002)


@pytest.mark.parametrize("kind", ["neo-hookean", "yeoh", "mooney-rivlin"])
@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_no_toe_is_made_up(kind: str, noise: float) -> None:
    assert abs(find_toe(pressed(0, noise=noise, kind=kind)).shift) < 0.0015


def test_a_plastic_is_treated_as_the_standards_say() -> None:
    """Small strains: the tangent is a straight line, and its crossing is the shift."""
    strain = np.linspace(0, 0.02, 1500)
    stress = 2000 * slack(strain, 0.001)
    found = find_toe(as_test(strain, stress, BARE, "tension"))
    assert found.shift == pytest.approx(0.001, rel=0.01)


def test_a_record_that_begins_under_load_is_counted_from_before_it() -> None:
    strain = np.linspace(0, 0.02, 1500)
    found = find_toe(as_test(strain, 2000 * strain + 1, BARE, "tension"))
    assert found.shift == pytest.approx(-0.0005, rel=5e-3)  # the tangent bends by the strain itself


def test_a_slope_that_keeps_rising_is_left_alone() -> None:
    strain = np.linspace(0, 0.5, 1000)
    found = find_toe(as_test(strain, np.expm1(12 * strain), BARE, "tension"))
    assert found.shift == 0
    assert "keeps rising" in found.note


def test_few_points_are_no_toe() -> None:
    strain = np.linspace(0, 0.1, 9)
    assert "too few points" in find_toe(as_test(strain, strain, BARE, "tension")).note


def test_the_modulus_after_compensation_is_the_materials() -> None:
    """Slack shifts a range of strain; compensated, it is the same range again."""
    clean = evaluate(pressed(0), StiffnessOptions(strain_range_percent=(5, 15), toe="none"))
    slacked = evaluate(pressed(0.03, noise=0.0005), StiffnessOptions(strain_range_percent=(5, 15), toe="always"))
    left = evaluate(pressed(0.03, noise=0.0005), StiffnessOptions(strain_range_percent=(5, 15), toe="none"))
    assert slacked.young.modulus_MPa == pytest.approx(clean.young.modulus_MPa, rel=0.01)
    assert left.young.modulus_MPa < 0.96 * clean.young.modulus_MPa
    assert float(np.min(1 - slacked.fitted.stretch)) >= slacked.toe.end  # the toe itself is not fitted
