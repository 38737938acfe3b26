"""Toe compensation: a known slack is recovered within its uncertainty, and curves without slack are not shifted."""

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

NO_DIMENSIONS = specimen_of(Dimensions())


def slack(strain: np.ndarray, shift: float) -> np.ndarray:
    """Return the strain of the specimen: quadratic while slack is taken up, and from 2·shift on smaller by shift."""
    if shift == 0:
        return strain
    return np.where(strain < 2 * shift, strain**2 / (4 * shift), strain - shift)


def compression_test(shift: float, *, gap: float = 0.0, noise: float = 0.0, kind: str = "neo-hookean") -> StressStrain:
    """Return a compression test of a rubber of 0.9 MPa with a gap and slack."""
    parameters = {"neo-hookean": [0.15], "yeoh": [0.15, 0.015, 0.004], "mooney-rivlin": [0.11, 0.04]}[kind]
    strain = np.linspace(0, 0.45, 3000)
    compression = slack(np.maximum(strain - gap, 0), shift)
    stress = model(kind).stress(parameters, UNIAXIAL, 1 - compression)
    stress += noise * np.random.default_rng(8).standard_normal(len(strain))
    return as_test(-strain, stress, NO_DIMENSIONS, "compression")


@pytest.mark.parametrize("shift", [0.005, 0.02, 0.05])
def test_the_toe_of_a_neo_hookean_curve_is_found(shift: float) -> None:
    toe = find_toe(compression_test(shift))
    assert toe.shift == pytest.approx(-shift, abs=1e-6)  # the tangent is identical to the curve
    assert 0.5 * shift < toe.end < max(2 * shift, 0.025)  # determined to one of its steps of stress


@pytest.mark.parametrize("kind", ["neo-hookean", "yeoh", "mooney-rivlin"])
@pytest.mark.parametrize("shift", [0.02, 0.04])
def test_a_toe_with_noise_is_found_to_within_0_6_per_cent_strain(kind: str, shift: float) -> None:
    toe = find_toe(compression_test(shift, noise=0.001, kind=kind))  # limited by the curvature
    assert toe.shift == pytest.approx(-shift, abs=0.006)
    assert toe.u_shift is not None
    assert 0 < toe.u_shift < 0.006


def test_a_gap_before_contact_is_found() -> None:
    toe = find_toe(compression_test(0.005, gap=0.08, noise=0.0005))
    assert toe.shift == pytest.approx(-0.085, abs=0.002)


@pytest.mark.parametrize("kind", ["neo-hookean", "yeoh", "mooney-rivlin"])
@pytest.mark.parametrize("noise", [0.0, 0.001])
def test_a_curve_without_toe_is_not_shifted(kind: str, noise: float) -> None:
    assert abs(find_toe(compression_test(0, noise=noise, kind=kind)).shift) < 0.0015


def test_the_toe_of_a_plastic_follows_the_standards() -> None:
    """At small strains, the tangent is a straight line, and its intercept is the shift."""
    strain = np.linspace(0, 0.02, 1500)
    stress = 2000 * slack(strain, 0.001)
    toe = find_toe(as_test(strain, stress, NO_DIMENSIONS, "tension"))
    assert toe.shift == pytest.approx(0.001, rel=0.01)


def test_a_record_that_begins_under_load_is_shifted_back() -> None:
    strain = np.linspace(0, 0.02, 1500)
    toe = find_toe(as_test(strain, 2000 * strain + 1, NO_DIMENSIONS, "tension"))
    assert toe.shift == pytest.approx(-0.0005, rel=5e-3)  # limited by the curvature of the tangent


def test_a_slope_that_keeps_increasing_is_not_compensated() -> None:
    strain = np.linspace(0, 0.5, 1000)
    toe = find_toe(as_test(strain, np.expm1(12 * strain), NO_DIMENSIONS, "tension"))
    assert toe.shift == 0
    assert "keeps increasing" in toe.note


def test_a_toe_requires_enough_points() -> None:
    strain = np.linspace(0, 0.1, 9)
    assert "too few points" in find_toe(as_test(strain, strain, NO_DIMENSIONS, "tension")).note


def test_the_modulus_after_compensation_is_that_of_the_material() -> None:
    """Slack shifts the strain range; compensation restores it."""
    without_slack = evaluate(compression_test(0), StiffnessOptions(strain_range_percent=(5, 15), toe="none"))
    compensated = evaluate(
        compression_test(0.03, noise=0.0005), StiffnessOptions(strain_range_percent=(5, 15), toe="always")
    )
    uncompensated = evaluate(
        compression_test(0.03, noise=0.0005), StiffnessOptions(strain_range_percent=(5, 15), toe="none")
    )
    assert compensated.young.modulus_MPa == pytest.approx(without_slack.young.modulus_MPa, rel=0.01)
    assert uncompensated.young.modulus_MPa < 0.96 * without_slack.young.modulus_MPa
    assert float(np.min(1 - compensated.fitted.stretch)) >= compensated.toe.end  # the toe itself is not fitted
