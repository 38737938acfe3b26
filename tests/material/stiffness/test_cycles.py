"""Cycles: turning points, hysteresis against its integral, residual strain, softening."""

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

BARE = specimen_of(Dimensions())


def cycled(peaks: tuple[float, ...] = (0.4, 0.4, 0.4), noise: float = 0.0, sign: int = 1) -> StressStrain:
    """Loading 2e, the first time; after it 1.8 (e - r); unloading 2e²/peak falls to nothing at the residual strain."""
    strain, stress, left = [], [], 0.0
    for peak in peaks:
        up = np.linspace(left, peak, 400)
        rising = 2 * up if left == 0 else 1.8 * (up - left) * peak / (peak - left)
        residual = 0.05
        down = np.linspace(peak, residual, 400)
        falling = rising[-1] * ((down - residual) / (peak - residual)) ** 2
        strain += [up, down[1:]]
        stress += [rising, falling[1:]]
        left = residual
    made = np.concatenate(strain) + noise * np.random.default_rng(2).standard_normal(sum(map(len, strain)))
    return as_test(sign * made, np.concatenate(stress), BARE, "tension" if sign > 0 else "compression")


@pytest.mark.parametrize("sign", [1, -1])
def test_energies_are_the_integrals(sign: int) -> None:
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
    # a line through the unloading from 5 to 1 % of the peak, that is, from 22.4 to 10 % of the way
    way = np.linspace(0.1, 0.05**0.5, 1000)
    assert first.residual_strain == pytest.approx(0.05 + 0.35 * np.polyfit(0.8 * way**2, way, 1)[1], abs=1e-3)


def test_what_is_elastic_leaves_no_strain() -> None:
    strain = np.concatenate([np.linspace(0, 0.4, 500), np.linspace(0.4, 0, 500)])
    (found,) = cycles_of(as_test(strain, 3 * strain, BARE, "tension"))
    assert found.residual_strain == pytest.approx(0, abs=1e-9)
    assert found.dissipated_mJ_per_mm3 == pytest.approx(0, abs=1e-9)


def test_softening_compares_last_with_first() -> None:
    found = softening(cycles_of(cycled()))
    assert found is not None
    assert found.cycles == 3
    assert found.peak_stress == pytest.approx(0.1, abs=1e-6)
    assert found.stress_at_half == pytest.approx(1 - 0.72 * 0.15 / 0.35 / 0.4, abs=1e-3)
    assert found.work_in == pytest.approx(1 - 0.126 / 0.16, rel=1e-3)
    assert softening(cycles_of(cycled((0.4,)))) is None
    assert softening(cycles_of(cycled((0.4, 0.2)))) is None  # another amplitude is no softening


def test_noise_makes_no_cycles() -> None:
    assert len(cycles_of(cycled(noise=0.003))) == 3


def test_an_unfinished_cycle_has_no_unloading() -> None:
    whole = cycled((0.4, 0.4))
    cut = as_test(whole.strain[:1100], whole.stress_MPa[:1100], BARE, "tension")
    last = cycles_of(cut)[-1]
    assert last.work_out_mJ_per_mm3 is None
    assert last.loss_fraction is None
    assert last.residual_strain is None


def test_branches_of_a_plain_sequence() -> None:
    strain = np.array([0, 1, 2, 1.95, 3, 1, 0.5, 2, 2.1])
    assert branches(strain) == [(0, 4), (4, 6), (6, 8)]
    assert branches(np.arange(5.0)) == [(0, 4)]


def test_first_and_last_loading() -> None:
    made = cycled()
    assert loading_branch(made) == slice(0, 400)
    assert loading_branch(made, "last").start == cycles_of(made)[-1].start


def test_a_strain_that_only_falls_is_refused() -> None:
    falling = np.linspace(0.5, 0, 60)
    with pytest.raises(DataError, match=r"falls from 0\.5 to 0 and never rises; include the loading"):
        loading_branch(as_test(falling, falling, BARE, "tension"))


def test_a_later_cycle_is_counted_from_what_the_earlier_left() -> None:
    """Stretch over stretch, and force over the area that is left: F/A₁ = F/A₀ · λ_left."""
    made = cycled()
    again = relative_to_last_cycle(made)
    left = 1 + (cycles_of(made)[-2].residual_strain or 0)
    np.testing.assert_allclose(again.stretch * left, made.stretch)
    np.testing.assert_allclose(again.stress_MPa, made.stress_MPa * left)
    np.testing.assert_allclose(again.true_stress_MPa, made.true_stress_MPa)  # force over present area: the same
    assert relative_to_last_cycle(cycled((0.4,))).strain is not None


def test_a_curve_to_fit_is_no_denser_than_it_needs() -> None:
    """Means over steps keep a straight line straight, and the largest stress ends it."""
    strain = np.concatenate([np.linspace(0, 0.4, 5000), np.linspace(0.4, 0.6, 50)])
    stress = np.where(strain <= 0.4, 3 * strain, 0.5)
    found = loading_curve(as_test(strain, stress, BARE, "tension"))
    assert len(found.stretch) == 50
    np.testing.assert_allclose(found.stress_MPa, 3 * (found.stretch - 1), rtol=1e-9)
    assert found.stretch.max() <= 1.4
