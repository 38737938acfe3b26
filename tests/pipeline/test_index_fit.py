"""The uncertainty of the formula that goes with an index, where little is known of each point's own scatter."""

import numpy as np
import pytest

from solen.material.index import Length, forward, measured, reading
from solen.material.index.fit import Fit
from solen.material.index.formula import formula_through

NM = np.arange(450.0, 901.0, 5.0)
N = 1.48 + 4500.0 / NM**2
AT = (480.0, 650.0, 860.0)
DRAWS = 150


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_a_formula_through_few_repeats_covers_the_truth(repeats: int) -> None:
    """Of 3 × 150 correlated answers 95 % are inside in the mean; 90 % allow for chance and for normal quantiles."""
    rng = np.random.default_rng(repeats)
    r, t = forward(N, 1e-5, 25.0, NM)
    truth = 1.48 + 4500.0 / np.array(AT) ** 2
    off = []
    for _ in range(DRAWS):
        many_r, many_t = (one + rng.normal(0.0, 1e-3, (repeats, NM.size)) for one in (r, t))
        found, _ = formula_through(measured(NM, reading(many_t), reading(many_r), Length(25.0)), "cauchy", 2)
        assert isinstance(found, Fit)
        n, u = found.model.indices(AT)
        off.append((n - truth) / u)
    assert np.mean(np.abs(off) < 1.96) > 0.90
    assert np.mean(np.abs(off) < 1.0) < 0.85  # nor is it so wide that it says nothing


def test_repeats_that_agree_to_the_digit_at_one_wavelength_do_not_decide_the_formula() -> None:
    """Equal readings there are chance: the point weighs as much as its neighbours."""
    rng = np.random.default_rng(1)
    r, t = forward(N, 1e-5, 25.0, NM)
    many_r, many_t = (one + rng.normal(0.0, 1e-3, (3, NM.size)) for one in (r, t))
    many_r[:, 45], many_t[:, 45] = r[45] + 2e-3, t[45]  # 0.008 in n
    found, _ = formula_through(measured(NM, reading(many_t), reading(many_r), Length(25.0)), "cauchy", 2)
    assert isinstance(found, Fit)
    n, u = found.model.indices(NM[45])
    assert n[0] == pytest.approx(N[45], abs=3.0 * u[0])
    assert u[0] > 1e-4
