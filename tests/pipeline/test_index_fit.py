"""Uncertainty of a formula fitted to an index with few repeats per wavelength."""

import numpy as np
import pytest

from solen.material.index import Length, forward, measured, reading
from solen.material.index.fit import Fit
from solen.material.index.formula import formula_through

NM = np.arange(450.0, 901.0, 5.0)
N = 1.48 + 4500.0 / NM**2
WAVELENGTHS = (480.0, 650.0, 860.0)
DRAWS = 80


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_a_formula_from_few_repeats_covers_the_true_index(repeats: int) -> None:
    """The coverage of 3 × 80 correlated values is 95 % on average; 90 % allows for chance and normal quantiles."""
    rng = np.random.default_rng(repeats)
    r, t = forward(N, 1e-5, 25.0, NM)
    truth = 1.48 + 4500.0 / np.array(WAVELENGTHS) ** 2
    errors = []
    for _ in range(DRAWS):
        repeated_r, repeated_t = (values + rng.normal(0.0, 1e-3, (repeats, NM.size)) for values in (r, t))
        fitted, _ = formula_through(measured(NM, reading(repeated_t), reading(repeated_r), Length(25.0)), "cauchy", 2)
        assert isinstance(fitted, Fit)
        n, u = fitted.model.indices(WAVELENGTHS)
        errors.append((n - truth) / u)
    assert np.mean(np.abs(errors) < 1.96) > 0.90
    assert np.mean(np.abs(errors) < 1.0) < 0.85  # the intervals are not much too wide


def test_repeats_that_agree_at_one_wavelength_do_not_dominate_the_formula() -> None:
    """Equal readings occur by chance: the point has the same weight as its neighbours."""
    rng = np.random.default_rng(1)
    r, t = forward(N, 1e-5, 25.0, NM)
    repeated_r, repeated_t = (values + rng.normal(0.0, 1e-3, (3, NM.size)) for values in (r, t))
    repeated_r[:, 45], repeated_t[:, 45] = r[45] + 2e-3, t[45]  # 0.008 in n
    fitted, _ = formula_through(measured(NM, reading(repeated_t), reading(repeated_r), Length(25.0)), "cauchy", 2)
    assert isinstance(fitted, Fit)
    n, u = fitted.model.indices(NM[45])
    assert n[0] == pytest.approx(N[45], abs=3.0 * u[0])
    assert u[0] > 1e-4
