"""Modulus: regression against its formula, coverage of its interval, ranges, secants, strength and break."""

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

BARE = specimen_of(Dimensions())
STRAIN = np.linspace(0, 0.01, 401)


def straight(modulus: float = 1000.0, noise: float = 0.0, seed: int = 1) -> StressStrain:
    stress = modulus * STRAIN + noise * np.random.default_rng(seed).standard_normal(len(STRAIN))
    return as_test(STRAIN, stress, BARE, "tension")


def test_the_slope_is_that_of_every_point_of_the_range_both_ends_included() -> None:
    made = straight(noise=0.05)
    found = young(made, (0.0005, 0.0025))
    inside = (made.strain >= 0.0005) & (made.strain <= 0.0025)
    assert found.points == inside.sum() == 81
    slope, intercept = np.polyfit(made.strain[inside], made.stress_MPa[inside], 1)
    assert found.modulus_MPa == pytest.approx(slope, rel=1e-9)
    assert found.intercept_MPa == pytest.approx(intercept, rel=1e-6)


def test_its_interval_covers_the_truth_at_its_nominal_rate() -> None:
    inside = 0
    for seed in range(1000):
        low, high = young(straight(noise=0.05, seed=seed), (0.0005, 0.0025)).interval95_modulus_MPa
        inside += low < 1000 < high
    assert 0.93 < inside / 1000 < 0.975  # standard error 0.7 %; correlation, where estimated, can only widen


def test_dimensions_add_to_the_uncertainty() -> None:
    stated = Dimensions(strip_width_mm=6, thickness_mm=3, length_mm=30, u_geometry_mm=0.06)
    made = as_test(STRAIN, 1000 * STRAIN, specimen_of(stated), "tension")
    by_force = replace(made, area_used=True, from_displacement=True)
    found = young(by_force, (0.001, 0.005))
    assert found.u_dimensions_MPa == pytest.approx(1000 * math.hypot(0.01, 0.02, 0.002))
    assert found.u_modulus_MPa == pytest.approx(found.u_dimensions_MPa, rel=1e-6)
    assert young(made, (0.001, 0.005)).u_dimensions_MPa is None  # the file's own stress and strain need none


@pytest.mark.parametrize("mode", [UNIAXIAL, PLANAR, EQUIBIAXIAL], ids=lambda mode: mode.name)
def test_every_mode_gives_youngs_modulus(mode: Mode) -> None:
    strain = np.linspace(0, 0.002, 50)
    stress = model("neo-hookean").stress([0.2], mode, 1 + strain)
    found = young(as_test(strain, stress, BARE, mode.name), (0.0, 0.001))
    assert found.modulus_MPa == pytest.approx(1.2, rel=4e-3)  # bends by a few times the strain
    assert ideal_ratio(mode, 1, (0.0, 0.001)) == pytest.approx(found.modulus_MPa / 1.2, rel=1e-3)


def test_an_ideal_rubbers_slope_over_a_wide_range() -> None:
    """In compression steeper, in tension flatter than at zero strain: chords of (λ - λ⁻²)/3."""

    def stress(strain: float) -> float:
        return (1 + strain - (1 + strain) ** -2) / 3

    assert ideal_ratio(UNIAXIAL, -1, (0.02, 0.1)) == pytest.approx((stress(-0.02) - stress(-0.1)) / 0.08)
    assert ideal_ratio(UNIAXIAL, 1, (0.05, 0.25)) == pytest.approx((stress(0.25) - stress(0.05)) / 0.2)


def test_default_ranges() -> None:
    assert default_range(straight()) == (0.0005, 0.0025)
    wide = np.linspace(0, 0.6, 6001)
    noisy = wide + 0.001 * np.random.default_rng(1).standard_normal(6001)
    assert default_range(as_test(wide, noisy, BARE, "tension")) == (0.02, 0.1)  # 0.25 % is not resolved: 0.0025 ± 0.001
    wide = wide[::30]
    assert default_range(as_test(-wide, -wide, BARE, "compression")) == (0.02, 0.1)
    assert default_range(as_test(wide[::10], wide[::10], BARE, "tension")) == (0.0, 0.5)
    low, high = default_range(as_test(wide[::40], wide[::40], BARE, "tension"))
    assert low == 0
    assert high == pytest.approx(wide[160])


def test_ranges_that_hold_nothing_are_refused() -> None:
    with pytest.raises(
        DataError, match="contains 0 points of the loading branch, but 3 are needed; the test reaches 1 %"
    ):
        young(straight(), (0.02, 0.05))
    for bad in ((0.05, 0.02), (-0.1, 0.1), (math.nan, 0.1)):
        with pytest.raises(DataError, match="strain range in percent"):
            young(straight(), bad)


def test_secants() -> None:
    made = as_test(STRAIN, 1000 * STRAIN - 2e4 * STRAIN**2, BARE, "tension")
    assert secant(made, 0.005) == pytest.approx(900)
    assert secant(made, 0.00501) == pytest.approx(1000 - 2e4 * 0.00501, rel=1e-5)
    assert secant(made, 0.5) is None


def test_strength_and_break() -> None:
    """Broken at the first point below 60 % of the largest stress, which a machine that stops there records last."""
    strain = np.linspace(0, 1, 101)
    stress = np.where(strain <= 0.9, strain, 0.9 - 8 * (strain - 0.9))
    found = extremes(as_test(strain, stress, BARE, "tension"))
    assert found.strength_MPa == pytest.approx(0.9)
    assert found.strain_at_strength == pytest.approx(0.9)
    assert found.strain_at_break == pytest.approx(0.95)
    whole = extremes(as_test(strain, strain, BARE, "tension"))
    assert whole.strain_at_break is None
    unloaded = np.concatenate([strain, strain[::-1]])
    assert extremes(as_test(unloaded, unloaded, BARE, "tension")).strain_at_break is None


def test_specimens_are_replicates() -> None:
    found = mean_modulus([young(straight(m), (0.001, 0.005)) for m in (990.0, 1000.0, 1010.0)])
    assert found.modulus_MPa == pytest.approx(1000)
    assert found.sd_modulus_MPa == pytest.approx(10)
    assert found.u_modulus_MPa == pytest.approx(10 / math.sqrt(3))
    assert found.interval95_modulus_MPa[1] == pytest.approx(
        1000 + 4.3027 * 10 / math.sqrt(3), rel=1e-4
    )  # t of 2 degrees
    alone = mean_modulus([young(straight(), (0.001, 0.005))])
    assert alone.sd_modulus_MPa is None


def test_specimens_that_agree_by_chance_are_not_better_than_each_of_them() -> None:
    alike = [young(straight(noise=0.5, seed=seed), (0.001, 0.005)) for seed in (3, 3)]
    assert mean_modulus(alike).u_modulus_MPa == pytest.approx(alike[0].u_modulus_MPa / math.sqrt(2))


@pytest.mark.parametrize(("preload", "displaced", "told"), [("0.2 N", True, "preload"), ("", False, "strain itself")])
def test_toe_auto_trusts_the_machine(preload: str, displaced: bool, told: str) -> None:
    made = replace(straight(), preload=preload, from_displacement=displaced)
    assert told in evaluate(made, StiffnessOptions()).toe.note
    assert evaluate(made, StiffnessOptions(toe="none")).toe.note == "no toe compensation, as requested"


def test_warnings_carry_numbers() -> None:
    strain = np.linspace(0, 0.4, 300)
    pressed = as_test(-strain, -1.2 * strain, specimen_of(Dimensions(cube_mm=10)), "compression")
    told = " | ".join(evaluate(replace(pressed, area_used=True, from_displacement=True), StiffnessOptions()).warnings)
    assert "shape factor 0.25: if the platens hold the ends, the modulus appears up to 23 % too high" in told
    assert "0.81 to 1 times this" in told
    assert "0.05 mm on each side would make the area uncertain by 0.7 %" in told
    assert "stiffness is 1.2e+03 N/mm, the modulus is 1 % too low" in told
    assert "over 2 to 10 % strain an ideal rubber's slope is 14 % higher" in told
    slid = evaluate(pressed, StiffnessOptions(lubricated=True)).warnings
    assert not any("platens" in each for each in slid)
