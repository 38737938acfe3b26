"""Fitted formulas: exact points come back exactly, uncertainties cover the truth, what is not known is refused."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solen.errors import DataError
from solen.material import Cauchy, Dispersion, Sellmeier
from solen.material.index.fit import FITS, Fit, fit
from solen.material.index.formulas import OnePole, UnfitError

NM = np.linspace(400.0, 900.0, 101)
RESIN = Cauchy(A=1.47, B_um2=0.0046, C_um4=0.00012)
ONE = Sellmeier(B=(1.18,), C_um2=(0.0113,))
WIDE = Sellmeier(B=(1.0, 0.01), C_um2=(0.01, 11.0))


def at(model: Dispersion, nm: Any = NM) -> NDArray[np.float64]:
    return np.array([model.index(float(one)) for one in nm])


def test_points_of_a_formula_give_that_formula_back() -> None:
    found = fit("cauchy", NM, at(RESIN), 1e-4)
    assert isinstance(found.model, Cauchy)
    assert (found.model.A, found.model.B_um2, found.model.C_um4) == pytest.approx((1.47, 0.0046, 0.00012), abs=1e-12)
    assert (found.terms, found.points) == (3, 101)
    assert found.rms < 1e-14
    one = fit("sellmeier", NM, at(ONE), 1e-4)
    assert isinstance(one.model, Sellmeier)
    assert (*one.model.B, *one.model.C_um2) == pytest.approx((1.18, 0.0113), abs=1e-12)
    assert one.terms == 1
    nm = np.linspace(300, 2500, 300)
    two = fit("sellmeier", nm, at(WIDE, nm), 1e-6)
    assert isinstance(two.model, Sellmeier)
    assert two.terms == 2
    assert (*two.model.B, *two.model.C_um2) == pytest.approx((1.0, 0.01, 0.01, 11.0), rel=1e-6)


def test_two_terms_in_the_ultraviolet_are_found_where_points_reach_there() -> None:
    truth = Sellmeier(B=(0.9, 0.25), C_um2=(0.006, 0.03))
    nm = np.linspace(200, 1000, 400)
    found = fit("sellmeier", nm, at(truth, nm), 1e-7)
    assert isinstance(found.model, Sellmeier)
    assert (*found.model.B, *found.model.C_um2) == pytest.approx((0.9, 0.25, 0.006, 0.03), rel=1e-4)


@pytest.mark.parametrize("kind", list(FITS))
def test_order_and_gaps_do_not_matter_and_residuals_stand_where_their_points_stood(kind: str) -> None:
    rng = np.random.default_rng(2)
    n = at(ONE) + 1e-3 * rng.standard_normal(NM.size)
    whole = fit(kind, NM, n, 1e-3)
    mixed = rng.permutation(NM.size)
    gaps = np.insert(n[mixed], [10, 40], np.nan)
    again = fit(kind, np.insert(NM[mixed], [10, 40], 555.0), gaps, 1e-3)
    assert again.model.index(600) == pytest.approx(whole.model.index(600), abs=1e-13)
    assert again.model.u_index(600) == pytest.approx(whole.model.u_index(600), rel=1e-9)
    assert np.array_equal(np.isnan(again.residuals), np.isnan(gaps))
    assert again.points == 101
    u_gap = np.where(np.arange(101) == 5, np.nan, 1e-3)
    assert fit(kind, NM, n, u_gap).points == 100
    assert whole.model.valid_nm == pytest.approx((400.0, 900.0))


def test_the_covariance_is_that_of_a_plain_least_squares_fit() -> None:
    """Against numpy's polynomial fit in 1/λ², which is good enough for two terms."""
    rng = np.random.default_rng(3)
    u = rng.uniform(1e-3, 3e-3, NM.size)
    n = at(RESIN) + u * rng.standard_normal(NM.size)
    x = (NM * 1e-3) ** -2
    slope, covariance = np.polyfit(x, n, 1, w=1 / u, cov="unscaled")
    found = fit("cauchy", NM, n, u, terms=2)
    assert isinstance(found.model, Cauchy)
    assert (found.model.B_um2, found.model.A) == pytest.approx(slope, rel=1e-10)
    assert found.widened == 1
    assert np.array(found.model.covariance)[:2, :2] == pytest.approx(covariance[::-1, ::-1], rel=1e-9)


DRAWS = 1000  # 95 ± 2 %: three times √(0.05·0.95/1000)


@pytest.mark.parametrize(
    ("kind", "truth", "terms"), [("cauchy", RESIN, 3), ("cauchy", RESIN, None), ("sellmeier", ONE, 1)]
)
def test_the_stated_uncertainty_covers_the_truth(kind: str, truth: Dispersion, terms: int | None) -> None:
    """Noise of its own at each point, and two errors of all points, one an offset and one that tilts."""
    rng = np.random.default_rng(5)
    u, nm = 1e-3, NM[::2]
    shared = np.array([np.full(nm.size, 2e-4), 2e-4 * (nm - 650) / 250])
    where = (410.0, 500.0, 650.0, 860.0)
    expected = at(truth, where)
    inside = np.zeros(len(where))
    for _ in range(DRAWS):
        n = at_nm(truth, nm) + u * rng.standard_normal(nm.size) + rng.standard_normal(2) @ shared
        value, u_value = fit(kind, nm, n, u, shared=shared, terms=terms).model.indices(where)
        inside += abs(value - expected) < 1.96 * u_value
    # this third term is as often dropped as kept, where the choice errs most: 92.2 to 95 % in 3,000 draws by hand
    assert inside / DRAWS == pytest.approx(0.95, abs=0.02 if terms else 0.045)


def at_nm(model: Dispersion, nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """As `at`, without the checks of each wavelength."""
    um = nm * 1e-3
    if isinstance(model, Cauchy):
        return np.asarray(model.A + model.B_um2 / um**2 + model.C_um4 / um**4)
    assert isinstance(model, Sellmeier)
    return np.sqrt(1 + sum(b * um**2 / (um**2 - c) for b, c in zip(model.B, model.C_um2, strict=True)))


def test_what_all_points_share_does_not_average_out() -> None:
    for many in (20, 2000):
        nm = np.linspace(400, 900, many)
        found = fit("cauchy", nm, at(RESIN, nm), 1e-4, shared=0.01, terms=2)
        assert found.model.u_index(650) == pytest.approx(0.01, rel=1e-3)
    tilted = fit("cauchy", NM, at(Cauchy(A=1.47, B_um2=0.005)), 1e-6, shared=1e-3 * (NM * 1e-3) ** -2, terms=2)
    assert isinstance(tilted.model, Cauchy)
    assert np.sqrt(np.array(tilted.model.covariance)[1][1]) == pytest.approx(1e-3, rel=1e-3)  # an error of B alone


def test_scatter_beyond_the_stated_uncertainty_widens_the_covariance() -> None:
    rng = np.random.default_rng(7)
    n = at(RESIN) + 5e-3 * rng.standard_normal(NM.size)
    found, told = fit("cauchy", NM, n, 1e-3, terms=2), fit("cauchy", NM, n, 5e-3, terms=2)
    assert found.chi2_reduced == pytest.approx(25, rel=0.4)
    assert found.widened == pytest.approx(5, rel=0.2)
    assert "multiplied by" in found.warnings[0]
    assert told.widened == 1
    assert told.warnings == ()
    assert found.model.u_index(650) == pytest.approx(told.model.u_index(650), rel=0.2)


def test_neighbours_that_err_together_widen_it_too() -> None:
    """A moving mean of five: fluctuations are as large as their points', and a fifth of the points is independent."""
    rng = np.random.default_rng(8)
    nm, width = np.linspace(400, 900, 1001), 5
    spread = []
    for _ in range(200):
        noise = np.convolve(rng.standard_normal(nm.size + width - 1), np.ones(width) / np.sqrt(width), "valid")
        found = fit("cauchy", nm, at_nm(RESIN, nm) + 1e-3 * noise, 1e-3, terms=2)
        spread.append((found.model.index(650), found.model.u_index(650)))
    value, stated = np.array(spread).T
    assert found.neighbours == pytest.approx(0.8, abs=0.05)
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(value.std(), rel=0.45)  # (1+ρ)/(1−ρ) of a short memory: 9 for 5
    assert np.sqrt(np.mean(stated**2)) > value.std()


def test_without_uncertainties_they_come_from_the_scatter() -> None:
    rng = np.random.default_rng(9)
    found = fit("cauchy", NM, at(RESIN) + 2e-3 * rng.standard_normal(NM.size), terms=2)
    known = fit("cauchy", NM, at(RESIN) + 2e-3 * rng.standard_normal(NM.size), 2e-3, terms=2)
    assert found.chi2_reduced is None
    assert found.model.u_index(600) == pytest.approx(known.model.u_index(600), rel=0.2)
    assert "from scatter alone" in found.warnings[0]


def test_the_number_of_terms_is_what_the_points_support() -> None:
    rng = np.random.default_rng(10)
    noise = rng.standard_normal(NM.size)
    assert fit("cauchy", NM, at(RESIN) + 1e-2 * noise, 1e-2).terms == 2
    fine = fit("cauchy", NM, at(RESIN) + 1e-5 * noise, 1e-5)
    assert fine.terms == 3
    assert fine.aicc[3] < fine.aicc[2]
    coarse = fit("sellmeier", NM, at(ONE) + 1e-3 * noise, 1e-3)
    assert coarse.terms == 1
    assert "do not distinguish two terms" in coarse.refused[2] or "a single term suffices" in coarse.refused[2]


def test_aicc_is_what_it_is_defined_as() -> None:
    rng = np.random.default_rng(12)
    n = at(RESIN) + 1e-3 * rng.standard_normal(NM.size)
    found = fit("cauchy", NM, n, 1e-3)
    for terms, score in found.aicc.items():
        one = fit("cauchy", NM, n, 1e-3, terms=terms)
        assert one.chi2_reduced is not None
        chi2 = one.chi2_reduced * (NM.size - terms)
        rest = fit("cauchy", NM, n, 1e-3, terms=3)
        assert rest.chi2_reduced is not None
        rho = max(rest.neighbours, 0)
        apart = NM.size * (1 - rho) / (1 + rho)
        expected = chi2 / max(1, rest.chi2_reduced) * apart / NM.size + 2 * terms
        assert score == pytest.approx(expected + 2 * terms * (terms + 1) / (apart - terms - 1), rel=1e-9)


def test_an_index_that_rises_is_reported_or_refused() -> None:
    rising = 1.5 - 0.005 * (NM * 1e-3) ** -2
    found = fit("cauchy", NM, rising, 1e-4)
    assert "rises by 0.025 from 400 to 900 nm" in found.warnings[0]
    with pytest.raises(DataError, match="has no resonance that would produce this index, which rises"):
        fit("sellmeier", NM, rising, 1e-4)


def test_a_resonance_among_or_near_the_points_is_reported() -> None:
    near = Sellmeier(B=(0.9,), C_um2=(0.37**2,))
    assert "the resonance at 370 nm is close to the points" in fit("sellmeier", NM, at(near), 1e-6, terms=1).warnings[0]
    form = OnePole(NM * 1e-3)
    with pytest.raises(UnfitError, match="has its resonance inside the range"):
        form.check(np.array([0.3, -0.4]))  # the line of 1/(n² − 1) crosses zero among the points


def told(*args: Any, **named: Any) -> str:
    with pytest.raises(DataError) as refusal:
        fit(*args, **named)
    line = str(refusal.value)
    assert len(line.splitlines()) == 1
    return line


def test_what_cannot_be_fitted_is_refused_in_one_line() -> None:
    n = at(RESIN)
    assert told("spline", NM, n) == "fit = 'spline'; must be one of cauchy, sellmeier"
    assert told("cauchy", NM, n, terms=4) == "terms of cauchy = 4; must be one of 1, 2, 3"
    assert "must be rows of equal length" in told("cauchy", NM, n[:-1])
    assert told("cauchy", NM, n, 0.0).startswith("u_n = 0.0; must be above 0")
    assert told("cauchy", -NM, n).startswith("wavelength = -900.0; must be above 0 nm")
    limit = "has 2 different wavelengths but requires at least 4"
    line = f"cauchy fit of 3 terms; {limit}; use fewer terms or the other formula"
    assert told("cauchy", [500, 600, 500], [1.5, 1.49, 1.5], terms=3) == line
    assert "has 0 different wavelengths" in told("cauchy", NM, np.full(101, np.nan))
    assert "requires indices above 1, but one index is 0.9" in told("sellmeier", NM, np.where(NM < 401, 0.9, n))
    assert "index at " in told("cauchy", NM, n - 0.6, 1e-4)
    assert "two terms" in told("sellmeier", NM, n + 1e-3 * np.sin(NM), 1e-3, terms=2)
    assert "too short a range" in told("cauchy", 500 + 1e-3 * np.arange(50), 1.5 + 1e-9 * np.arange(50), 1e-3, terms=3)


def test_the_result_is_plain_data() -> None:
    import json

    found: Fit = fit("sellmeier", NM, at(ONE), 1e-4)
    data = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert data["model"]["kind"] == "sellmeier"
    assert Sellmeier(**found.model.model_dump()) == found.model
    assert data["terms"] == 1
