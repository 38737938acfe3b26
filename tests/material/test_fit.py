"""Fitted formulas: exact points are reproduced, uncertainties cover the truth, undetermined fits are refused."""

import json
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


def indices(model: Dispersion, nm: Any = NM) -> NDArray[np.float64]:
    return np.array([model.index(float(wavelength)) for wavelength in nm])


def test_points_of_a_formula_recover_it() -> None:
    result = fit("cauchy", NM, indices(RESIN), 1e-4)
    assert isinstance(result.model, Cauchy)
    assert (result.model.A, result.model.B_um2, result.model.C_um4) == pytest.approx((1.47, 0.0046, 0.00012), abs=1e-12)
    assert (result.terms, result.points) == (3, 101)
    assert result.rms < 1e-14
    single = fit("sellmeier", NM, indices(ONE), 1e-4)
    assert isinstance(single.model, Sellmeier)
    assert (*single.model.B, *single.model.C_um2) == pytest.approx((1.18, 0.0113), abs=1e-12)
    assert single.terms == 1
    nm = np.linspace(300, 2500, 300)
    two = fit("sellmeier", nm, indices(WIDE, nm), 1e-6)
    assert isinstance(two.model, Sellmeier)
    assert two.terms == 2
    assert (*two.model.B, *two.model.C_um2) == pytest.approx((1.0, 0.01, 0.01, 11.0), rel=1e-6)


def test_points_in_the_ultraviolet_determine_two_terms() -> None:
    truth = Sellmeier(B=(0.9, 0.25), C_um2=(0.006, 0.03))
    nm = np.linspace(200, 1000, 400)
    result = fit("sellmeier", nm, indices(truth, nm), 1e-7)
    assert isinstance(result.model, Sellmeier)
    assert (*result.model.B, *result.model.C_um2) == pytest.approx((0.9, 0.25, 0.006, 0.03), rel=1e-4)


@pytest.mark.parametrize("kind", list(FITS))
def test_order_and_gaps_do_not_matter_and_residuals_keep_the_order_of_the_points(kind: str) -> None:
    rng = np.random.default_rng(2)
    n = indices(ONE) + 1e-3 * rng.standard_normal(NM.size)
    ordered = fit(kind, NM, n, 1e-3)
    order = rng.permutation(NM.size)
    with_gaps = np.insert(n[order], [10, 40], np.nan)
    permuted = fit(kind, np.insert(NM[order], [10, 40], 555.0), with_gaps, 1e-3)
    assert permuted.model.index(600) == pytest.approx(ordered.model.index(600), abs=1e-13)
    assert permuted.model.u_index(600) == pytest.approx(ordered.model.u_index(600), rel=1e-9)
    assert np.array_equal(np.isnan(permuted.residuals), np.isnan(with_gaps))
    assert permuted.points == 101
    u_gap = np.where(np.arange(101) == 5, np.nan, 1e-3)
    assert fit(kind, NM, n, u_gap).points == 100
    assert ordered.model.valid_nm == pytest.approx((400.0, 900.0))


def test_the_covariance_equals_that_of_numpys_polynomial_fit() -> None:
    """A linear fit in 1/λ², which is accurate enough for two terms."""
    rng = np.random.default_rng(3)
    u = rng.uniform(1e-3, 3e-3, NM.size)
    n = indices(RESIN) + u * rng.standard_normal(NM.size)
    x = (NM * 1e-3) ** -2
    slope, covariance = np.polyfit(x, n, 1, w=1 / u, cov="unscaled")
    result = fit("cauchy", NM, n, u, terms=2)
    assert isinstance(result.model, Cauchy)
    assert (result.model.B_um2, result.model.A) == pytest.approx(slope, rel=1e-10)
    assert result.widened == 1
    assert np.array(result.model.covariance)[:2, :2] == pytest.approx(covariance[::-1, ::-1], rel=1e-9)


DRAWS = 1000  # 95 ± 2 %: three times √(0.05·0.95/1000)


@pytest.mark.parametrize(
    ("kind", "truth", "terms"), [("cauchy", RESIN, 3), ("cauchy", RESIN, None), ("sellmeier", ONE, 1)]
)
def test_the_uncertainty_covers_the_true_index(kind: str, truth: Dispersion, terms: int | None) -> None:
    """Independent noise at each point, and two common errors, an offset and a tilt."""
    rng = np.random.default_rng(5)
    u, nm = 1e-3, NM[::2]
    shared = np.array([np.full(nm.size, 2e-4), 2e-4 * (nm - 650) / 250])
    wavelengths = (410.0, 500.0, 650.0, 860.0)
    expected = indices(truth, wavelengths)
    covered = np.zeros(len(wavelengths))
    for _ in range(DRAWS):
        n = unchecked_indices(truth, nm) + u * rng.standard_normal(nm.size) + rng.standard_normal(2) @ shared
        value, u_value = fit(kind, nm, n, u, shared=shared, terms=terms).model.indices(wavelengths)
        covered += abs(value - expected) < 1.96 * u_value
    # the third term is selected in half of the draws, the worst case for the coverage: 92.2 to 95 % in 3,000 draws
    assert covered / DRAWS == pytest.approx(0.95, abs=0.02 if terms else 0.045)


def unchecked_indices(model: Dispersion, nm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the indices without the checks of each wavelength, for speed."""
    um = nm * 1e-3
    if isinstance(model, Cauchy):
        return np.asarray(model.A + model.B_um2 / um**2 + model.C_um4 / um**4)
    assert isinstance(model, Sellmeier)
    return np.sqrt(1 + sum(b * um**2 / (um**2 - c) for b, c in zip(model.B, model.C_um2, strict=True)))


def test_common_errors_do_not_average_out() -> None:
    for count in (20, 2000):
        nm = np.linspace(400, 900, count)
        result = fit("cauchy", nm, indices(RESIN, nm), 1e-4, shared=0.01, terms=2)
        assert result.model.u_index(650) == pytest.approx(0.01, rel=1e-3)
    tilted = fit("cauchy", NM, indices(Cauchy(A=1.47, B_um2=0.005)), 1e-6, shared=1e-3 * (NM * 1e-3) ** -2, terms=2)
    assert isinstance(tilted.model, Cauchy)
    assert np.sqrt(np.array(tilted.model.covariance)[1][1]) == pytest.approx(1e-3, rel=1e-3)  # an error of B alone


def test_scatter_above_the_specified_uncertainty_increases_the_covariance() -> None:
    rng = np.random.default_rng(7)
    n = indices(RESIN) + 5e-3 * rng.standard_normal(NM.size)
    result, correct = fit("cauchy", NM, n, 1e-3, terms=2), fit("cauchy", NM, n, 5e-3, terms=2)
    assert result.chi2_reduced == pytest.approx(25, rel=0.4)
    assert result.widened == pytest.approx(5, rel=0.2)
    assert "multiplied by" in result.warnings[0]
    assert correct.widened == 1
    assert correct.warnings == ()
    assert result.model.u_index(650) == pytest.approx(correct.model.u_index(650), rel=0.2)


def test_correlated_neighbours_increase_the_covariance() -> None:
    """Noise averaged over five neighbours and scaled to the same variance: a fifth of the points are independent."""
    rng = np.random.default_rng(8)
    nm, width = np.linspace(400, 900, 1001), 5
    estimates = []
    for _ in range(200):
        noise = np.convolve(rng.standard_normal(nm.size + width - 1), np.ones(width) / np.sqrt(width), "valid")
        result = fit("cauchy", nm, unchecked_indices(RESIN, nm) + 1e-3 * noise, 1e-3, terms=2)
        estimates.append((result.model.index(650), result.model.u_index(650)))
    value, u = np.array(estimates).T
    assert result.neighbours == pytest.approx(0.8, abs=0.05)
    # the factor (1+ρ)/(1−ρ) assumes an exponential correlation: 9 instead of 5, a conservative estimate
    assert np.sqrt(np.mean(u**2)) == pytest.approx(value.std(), rel=0.45)
    assert np.sqrt(np.mean(u**2)) > value.std()


def test_without_specified_uncertainties_the_scatter_is_used() -> None:
    rng = np.random.default_rng(9)
    result = fit("cauchy", NM, indices(RESIN) + 2e-3 * rng.standard_normal(NM.size), terms=2)
    known = fit("cauchy", NM, indices(RESIN) + 2e-3 * rng.standard_normal(NM.size), 2e-3, terms=2)
    assert result.chi2_reduced is None
    assert result.model.u_index(600) == pytest.approx(known.model.u_index(600), rel=0.2)
    assert "scatter" in result.warnings[0]


def test_the_number_of_terms_is_what_the_points_determine() -> None:
    rng = np.random.default_rng(10)
    noise = rng.standard_normal(NM.size)
    assert fit("cauchy", NM, indices(RESIN) + 1e-2 * noise, 1e-2).terms == 2
    fine = fit("cauchy", NM, indices(RESIN) + 1e-5 * noise, 1e-5)
    assert fine.terms == 3
    assert fine.aicc[3] < fine.aicc[2]
    coarse = fit("sellmeier", NM, indices(ONE) + 1e-3 * noise, 1e-3)
    assert coarse.terms == 1
    assert 2 in coarse.refused


def test_aicc_agrees_with_its_definition() -> None:
    rng = np.random.default_rng(12)
    n = indices(RESIN) + 1e-3 * rng.standard_normal(NM.size)
    result = fit("cauchy", NM, n, 1e-3)
    for terms, score in result.aicc.items():
        candidate = fit("cauchy", NM, n, 1e-3, terms=terms)
        assert candidate.chi2_reduced is not None
        chi2 = candidate.chi2_reduced * (NM.size - terms)
        largest = fit("cauchy", NM, n, 1e-3, terms=3)
        assert largest.chi2_reduced is not None
        rho = max(largest.neighbours, 0)
        independent = NM.size * (1 - rho) / (1 + rho)
        expected = chi2 / max(1, largest.chi2_reduced) * independent / NM.size + 2 * terms
        assert score == pytest.approx(expected + 2 * terms * (terms + 1) / (independent - terms - 1), rel=1e-9)


def test_an_index_that_rises_with_wavelength_is_reported_or_refused() -> None:
    rising = 1.5 - 0.005 * (NM * 1e-3) ** -2
    result = fit("cauchy", NM, rising, 1e-4)
    assert "rises by 0.025 from 400 to 900 nm" in result.warnings[0]
    with pytest.raises(DataError, match=r"sellmeier fit .*rises"):
        fit("sellmeier", NM, rising, 1e-4)


def test_a_resonance_within_or_near_the_range_is_reported() -> None:
    near = Sellmeier(B=(0.9,), C_um2=(0.37**2,))
    assert "resonance at 370 nm" in fit("sellmeier", NM, indices(near), 1e-6, terms=1).warnings[0]
    form = OnePole(NM * 1e-3)
    with pytest.raises(UnfitError, match="has its resonance inside the range"):
        form.check(np.array([0.3, -0.4]))  # the line of 1/(n² − 1) crosses zero within the range


def error_line(*arguments: Any, **options: Any) -> str:
    with pytest.raises(DataError) as error:
        fit(*arguments, **options)
    line = str(error.value)
    assert len(line.splitlines()) == 1
    return line


def test_refuses_invalid_and_undetermined_fits_in_one_line() -> None:
    n = indices(RESIN)
    assert error_line("spline", NM, n).startswith("fit = 'spline'; must be one of cauchy, sellmeier")
    assert error_line("cauchy", NM, n, terms=4) == "terms of cauchy = 4; must be one of 1, 2, 3"
    assert "must be one-dimensional and of equal length" in error_line("cauchy", NM, n[:-1])
    assert error_line("cauchy", NM, n, 0.0).startswith("u_n = 0.0; must be above 0")
    assert error_line("cauchy", -NM, n).startswith("wavelength = -900.0; must be above 0 nm")
    too_few = error_line("cauchy", [500, 600, 500], [1.5, 1.49, 1.5], terms=3)
    assert too_few.startswith("cauchy fit with 3 terms; ")
    assert "2 different wavelengths" in too_few
    assert "0 different wavelengths" in error_line("cauchy", NM, np.full(101, np.nan))
    assert "0.9" in error_line("sellmeier", NM, np.where(NM < 401, 0.9, n))
    assert "index at " in error_line("cauchy", NM, n - 0.6, 1e-4)
    assert "two terms" in error_line("sellmeier", NM, n + 1e-3 * np.sin(NM), 1e-3, terms=2)
    assert "500 to 500.049 nm" in error_line(
        "cauchy", 500 + 1e-3 * np.arange(50), 1.5 + 1e-9 * np.arange(50), 1e-3, terms=3
    )


def test_the_result_is_written_as_json() -> None:
    result: Fit = fit("sellmeier", NM, indices(ONE), 1e-4)
    data = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert data["model"]["kind"] == "sellmeier"
    assert Sellmeier(**result.model.model_dump()) == result.model
    assert data["terms"] == 1
