"""Cycles: turning points, hysteresis compared with its integral, residual strain, softening."""

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.stiffness import (
    Dimensions,
    as_test,
    cycles_of,
    loading_branch,
    loading_curve,
    relative_to_last_cycle,
    softening,
    specimen_of,
)
from solen.material.stiffness.cycles import branches
from solen.material.stiffness.stress_strain import StressStrain

NO_DIMENSIONS = specimen_of(Dimensions())


def cycled(peaks: tuple[float, ...] = (0.4, 0.4, 0.4), noise: float = 0.0, sign: int = 1) -> StressStrain:
    """Return linear loading, softer after the first cycle, and parabolic unloading to the residual strain."""
    strain, stress, start, residual = [], [], 0.0, 0.05
    for peak in peaks:
        up = np.linspace(start, peak, 400)
        rising = 2 * up if start == 0 else 1.8 * (up - start) * peak / (peak - start)
        down = np.linspace(peak, residual, 400)
        falling = rising[-1] * ((down - residual) / (peak - residual)) ** 2
        strain += [up, down[1:]]
        stress += [rising, falling[1:]]
        start = residual
    noisy = np.concatenate(strain) + noise * np.random.default_rng(2).standard_normal(sum(map(len, strain)))
    return as_test(sign * noisy, np.concatenate(stress), NO_DIMENSIONS, "tension" if sign > 0 else "compression")


@pytest.mark.parametrize("sign", [1, -1])
def test_energies_equal_the_integrals(sign: int) -> None:
    first, second, third = cycles_of(cycled(sign=sign))
    assert (first.number, second.number, third.number) == (1, 2, 3)
    assert first.work_in_mJ_per_mm3 == pytest.approx(2 * 0.4**2 / 2, rel=1e-5)
    assert first.work_out_mJ_per_mm3 == pytest.approx(0.8 * 0.35 / 3, rel=1e-4)
    assert first.dissipated_mJ_per_mm3 == pytest.approx(0.16 - 0.8 * 0.35 / 3, rel=1e-4)
    assert second.work_in_mJ_per_mm3 == pytest.approx(0.72 * 0.35 / 2, rel=1e-4)
    assert first.loss_fraction == pytest.approx(1 - 0.8 * 0.35 / 3 / 0.16, rel=1e-4)
    assert first.peak_strain == pytest.approx(0.4)
    assert first.peak_stress_MPa == pytest.approx(0.8)
    assert first.stress_at_half_MPa == pytest.approx(0.4)
    # a line through the unloading curve from 5 to 1 % of the peak stress, at 22.4 to 10 % of the strain
    fraction = np.linspace(0.1, 0.05**0.5, 1000)
    assert first.residual_strain == pytest.approx(0.05 + 0.35 * np.polyfit(0.8 * fraction**2, fraction, 1)[1], abs=1e-3)


def test_an_elastic_cycle_has_no_residual_strain() -> None:
    strain = np.concatenate([np.linspace(0, 0.4, 500), np.linspace(0.4, 0, 500)])
    (cycle,) = cycles_of(as_test(strain, 3 * strain, NO_DIMENSIONS, "tension"))
    assert cycle.residual_strain == pytest.approx(0, abs=1e-9)
    assert cycle.dissipated_mJ_per_mm3 == pytest.approx(0, abs=1e-9)


def test_softening_compares_the_last_with_the_first_cycle() -> None:
    softened = softening(cycles_of(cycled()))
    assert softened is not None
    assert softened.cycles == 3
    assert softened.peak_stress == pytest.approx(0.1, abs=1e-6)
    assert softened.stress_at_half == pytest.approx(1 - 0.72 * 0.15 / 0.35 / 0.4, abs=1e-3)
    assert softened.work_in == pytest.approx(1 - 0.126 / 0.16, rel=1e-3)
    assert softening(cycles_of(cycled((0.4,)))) is None
    assert softening(cycles_of(cycled((0.4, 0.2)))) is None  # different amplitudes cannot be compared


def test_noise_is_not_counted_as_cycles() -> None:
    assert len(cycles_of(cycled(noise=0.003))) == 3


def test_an_unfinished_cycle_has_no_unloading() -> None:
    complete = cycled((0.4, 0.4))
    cut = as_test(complete.strain[:1100], complete.stress_MPa[:1100], NO_DIMENSIONS, "tension")
    last = cycles_of(cut)[-1]
    assert last.work_out_mJ_per_mm3 is None
    assert last.loss_fraction is None
    assert last.residual_strain is None


def test_branches_ignore_small_reversals() -> None:
    strain = np.array([0, 1, 2, 1.95, 3, 1, 0.5, 2, 2.1])
    assert branches(strain) == [(0, 4), (4, 6), (6, 8)]
    assert branches(np.arange(5.0)) == [(0, 4)]


def test_first_and_last_loading_branch() -> None:
    test = cycled()
    assert loading_branch(test) == slice(0, 400)
    assert loading_branch(test, "last").start == cycles_of(test)[-1].start


def test_refuses_a_strain_that_only_decreases() -> None:
    falling = np.linspace(0.5, 0, 60)
    with pytest.raises(DataError, match=r"decreases from 0\.5 to 0"):
        loading_branch(as_test(falling, falling, NO_DIMENSIONS, "tension"))


def test_strain_and_stress_are_relative_to_the_residual_strain_of_the_previous_cycle() -> None:
    """With the residual stretch λ, the reference length increases by λ and the area decreases: F/A₁ = F/A₀ · λ."""
    test = cycled()
    relative = relative_to_last_cycle(test)
    residual = 1 + (cycles_of(test)[-2].residual_strain or 0)
    np.testing.assert_allclose(relative.stretch * residual, test.stretch)
    np.testing.assert_allclose(relative.stress_MPa, test.stress_MPa * residual)
    np.testing.assert_allclose(relative.true_stress_MPa, test.true_stress_MPa)  # does not depend on the reference
    assert relative_to_last_cycle(cycled((0.4,))).strain is not None


def test_the_loading_curve_is_reduced_to_means() -> None:
    """Means over intervals preserve a straight line; the curve ends at the largest stress."""
    strain = np.concatenate([np.linspace(0, 0.4, 5000), np.linspace(0.4, 0.6, 50)])
    stress = np.where(strain <= 0.4, 3 * strain, 0.5)
    curve = loading_curve(as_test(strain, stress, NO_DIMENSIONS, "tension"))
    assert len(curve.stretch) == 50
    np.testing.assert_allclose(curve.stress_MPa, 3 * (curve.stretch - 1), rtol=1e-9)
    assert curve.stretch.max() <= 1.4
