"""Modulus: regression compared with its formula, coverage of its interval, ranges, secants, strength and break."""

import math
from dataclasses import replace

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.stiffness import (
    EQUIBIAXIAL,
    PLANAR,
    UNIAXIAL,
    Dimensions,
    Mode,
    StiffnessOptions,
    as_test,
    default_range,
    evaluate,
    extremes,
    ideal_ratio,
    mean_modulus,
    model,
    secant,
    specimen_of,
    young,
)
from solen.material.stiffness.stress_strain import StressStrain

NO_DIMENSIONS = specimen_of(Dimensions())
STRAIN = np.linspace(0, 0.01, 401)


def linear_test(modulus: float = 1000.0, noise: float = 0.0, seed: int = 1) -> StressStrain:
    stress = modulus * STRAIN + noise * np.random.default_rng(seed).standard_normal(len(STRAIN))
    return as_test(STRAIN, stress, NO_DIMENSIONS, "tension")


def test_the_modulus_is_the_slope_over_all_points_of_the_range() -> None:
    test = linear_test(noise=0.05)
    result = young(test, (0.0005, 0.0025))
    inside = (test.strain >= 0.0005) & (test.strain <= 0.0025)
    assert result.points == inside.sum() == 81
    slope, intercept = np.polyfit(test.strain[inside], test.stress_MPa[inside], 1)
    assert result.modulus_MPa == pytest.approx(slope, rel=1e-9)
    assert result.intercept_MPa == pytest.approx(intercept, rel=1e-6)


def test_the_interval_of_the_modulus_covers_the_truth() -> None:
    covered = 0
    for seed in range(1000):
        low, high = young(linear_test(noise=0.05, seed=seed), (0.0005, 0.0025)).interval95_modulus_MPa
        covered += low < 1000 < high
    assert 0.93 < covered / 1000 < 0.975  # standard error 0.7 %; an estimated correlation can only widen the interval


def test_dimensions_contribute_to_the_uncertainty() -> None:
    strip = Dimensions(strip_width_mm=6, thickness_mm=3, length_mm=30, u_geometry_mm=0.06)
    test = as_test(STRAIN, 1000 * STRAIN, specimen_of(strip), "tension")
    from_force = replace(test, area_used=True, from_displacement=True)
    result = young(from_force, (0.001, 0.005))
    assert result.u_dimensions_MPa == pytest.approx(1000 * math.hypot(0.01, 0.02, 0.002))
    assert result.u_modulus_MPa == pytest.approx(result.u_dimensions_MPa, rel=1e-6)
    assert young(test, (0.001, 0.005)).u_dimensions_MPa is None  # stress and strain in the file require no dimensions


@pytest.mark.parametrize("mode", [UNIAXIAL, PLANAR, EQUIBIAXIAL], ids=lambda mode: mode.name)
def test_every_mode_yields_youngs_modulus(mode: Mode) -> None:
    strain = np.linspace(0, 0.002, 50)
    stress = model("neo-hookean").stress([0.2], mode, 1 + strain)
    result = young(as_test(strain, stress, NO_DIMENSIONS, mode.name), (0.0, 0.001))
    assert result.modulus_MPa == pytest.approx(1.2, rel=4e-3)  # relative curvature of a few times the strain
    assert ideal_ratio(mode, 1, (0.0, 0.001)) == pytest.approx(result.modulus_MPa / 1.2, rel=1e-3)


def test_slope_of_an_ideal_rubber_over_a_wide_range() -> None:
    """Higher in compression and lower in tension than at zero strain: chords of (λ − λ⁻²)/3."""

    def stress(strain: float) -> float:
        return (1 + strain - (1 + strain) ** -2) / 3

    assert ideal_ratio(UNIAXIAL, -1, (0.02, 0.1)) == pytest.approx((stress(-0.02) - stress(-0.1)) / 0.08)
    assert ideal_ratio(UNIAXIAL, 1, (0.05, 0.25)) == pytest.approx((stress(0.25) - stress(0.05)) / 0.2)


def test_default_ranges() -> None:
    assert default_range(linear_test()) == (0.0005, 0.0025)
    strain = np.linspace(0, 0.6, 6001)
    noisy = strain + 0.001 * np.random.default_rng(1).standard_normal(6001)
    noisy_test = as_test(strain, noisy, NO_DIMENSIONS, "tension")
    assert default_range(noisy_test) == (0.02, 0.1)  # 0.25 % strain is not resolved, 0.0025 ± 0.001
    strain = strain[::30]
    assert default_range(as_test(-strain, -strain, NO_DIMENSIONS, "compression")) == (0.02, 0.1)
    assert default_range(as_test(strain[::10], strain[::10], NO_DIMENSIONS, "tension")) == (0.0, 0.5)
    low, high = default_range(as_test(strain[::40], strain[::40], NO_DIMENSIONS, "tension"))
    assert low == 0
    assert high == pytest.approx(strain[160])


def test_refuses_empty_and_invalid_ranges() -> None:
    with pytest.raises(DataError, match=r"2 to 5 %; contains 0 points .* 1 %"):
        young(linear_test(), (0.02, 0.05))
    for strain_range in ((0.05, 0.02), (-0.1, 0.1), (math.nan, 0.1)):
        with pytest.raises(DataError, match="must be two numbers of at least 0 in ascending order"):
            young(linear_test(), strain_range)


def test_secants() -> None:
    test = as_test(STRAIN, 1000 * STRAIN - 2e4 * STRAIN**2, NO_DIMENSIONS, "tension")
    assert secant(test, 0.005) == pytest.approx(900)
    assert secant(test, 0.00501) == pytest.approx(1000 - 2e4 * 0.00501, rel=1e-5)
    assert secant(test, 0.5) is None


def test_strength_and_break() -> None:
    """The break is at the first point below 60 % of the largest stress."""
    strain = np.linspace(0, 1, 101)
    stress = np.where(strain <= 0.9, strain, 0.9 - 8 * (strain - 0.9))
    result = extremes(as_test(strain, stress, NO_DIMENSIONS, "tension"))
    assert result.strength_MPa == pytest.approx(0.9)
    assert result.strain_at_strength == pytest.approx(0.9)
    assert result.strain_at_break == pytest.approx(0.95)
    unbroken = extremes(as_test(strain, strain, NO_DIMENSIONS, "tension"))
    assert unbroken.strain_at_break is None
    unloaded = np.concatenate([strain, strain[::-1]])
    assert extremes(as_test(unloaded, unloaded, NO_DIMENSIONS, "tension")).strain_at_break is None


def test_specimens_are_treated_as_replicates() -> None:
    result = mean_modulus([young(linear_test(modulus), (0.001, 0.005)) for modulus in (990.0, 1000.0, 1010.0)])
    assert result.modulus_MPa == pytest.approx(1000)
    assert result.sd_modulus_MPa == pytest.approx(10)
    assert result.u_modulus_MPa == pytest.approx(10 / math.sqrt(3))
    t_quantile = 4.3027  # of two degrees of freedom
    assert result.interval95_modulus_MPa[1] == pytest.approx(1000 + t_quantile * 10 / math.sqrt(3), rel=1e-4)
    single = mean_modulus([young(linear_test(), (0.001, 0.005))])
    assert single.sd_modulus_MPa is None


def test_specimens_that_agree_by_chance_keep_their_own_uncertainty() -> None:
    equal = [young(linear_test(noise=0.5, seed=seed), (0.001, 0.005)) for seed in (3, 3)]
    assert mean_modulus(equal).u_modulus_MPa == pytest.approx(equal[0].u_modulus_MPa / math.sqrt(2))


@pytest.mark.parametrize(
    ("preload", "from_displacement", "note"),
    [("0.2 N", True, "preload"), ("", False, "the file contains the strain")],
)
def test_toe_auto_relies_on_preload_and_measured_strain(preload: str, from_displacement: bool, note: str) -> None:
    test = replace(linear_test(), preload=preload, from_displacement=from_displacement)
    assert note in evaluate(test, StiffnessOptions()).toe.note
    assert evaluate(test, StiffnessOptions(toe="none")).toe.note == "no toe compensation, as requested"


def test_warnings_contain_numbers() -> None:
    strain = np.linspace(0, 0.4, 300)
    compressed = as_test(-strain, -1.2 * strain, specimen_of(Dimensions(cube_mm=10)), "compression")
    warnings = evaluate(replace(compressed, area_used=True, from_displacement=True), StiffnessOptions()).warnings
    for values in (
        ("shape factor 0.25", "23 %", "0.81 to 1 times"),
        ("0.05 mm", "0.7 %"),
        ("1.2e+03 N/mm", "1 %"),
        ("2 to 10 % strain", "14 %"),
    ):
        assert any(all(value in warning for value in values) for warning in warnings), values
    lubricated = evaluate(compressed, StiffnessOptions(lubricated=True)).warnings
    assert not any("friction" in warning for warning in lubricated)
