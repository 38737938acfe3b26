"""Dispersion from refractometer values and a prior of polymers: values at the measured wavelengths, and coverage."""

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from solen.errors import DataError
from solen.material.index.literature import LINE_C, LINE_D, LINE_F, LINE_HELIUM, RESINS, materials
from solen.material.index.refractometer import Prior, prior_of, prior_of_abbe, refractometer

SHARP = Prior(50.0, 0.001, 0.1, 0.001, "nothing")


def test_at_the_measured_wavelength_the_index_is_the_measured_one() -> None:
    for nm in (LINE_D, 632.8, 450.0):
        result = refractometer(1.487, 0.0005, nm)
        n, u_n = result.fit.indices(nm)
        assert n[0] == pytest.approx(1.487, abs=1e-13)
        assert u_n[0] == pytest.approx(0.0005, rel=1e-9)
        assert result.chi2 == pytest.approx(0, abs=1e-12)
        assert result.fit.valid_nm == (400.0, 1000.0)


def test_the_formula_has_the_abbe_number_and_the_bend_of_a_sharp_prior() -> None:
    result = refractometer(1.487, 0.0005, prior=Prior(47.0, 5.0, 0.2, 0.1, "nothing")).fit
    d, f, c = (result.index(line) for line in (LINE_HELIUM, LINE_F, LINE_C))
    assert (d - 1) / (f - c) == pytest.approx(47.0, abs=1e-9)
    rise = result.C_um4 * ((LINE_F * 1e-3) ** -4 - (LINE_C * 1e-3) ** -4)
    assert rise / (f - c) == pytest.approx(0.2, abs=1e-9)


def test_the_covariance_equals_that_of_random_dispersions() -> None:
    """Compared with 2,000 formulas with random n, V and bend: their standard deviation has an uncertainty of 1.6 %."""
    rng = np.random.default_rng(1)
    prior = Prior(50.0, 5.0, 0.1, 0.1, "nothing")
    wavelengths = [405.0, 450.0, 700.0, 860.0, 1000.0]
    samples = []
    for n, abbe, bend in rng.normal((1.487, 50.0, 0.1), (0.001, 5.0, 0.1), (2000, 3)):
        sample = refractometer(n, 0.001, prior=Prior(abbe, 0.001, bend, 0.001, "random"))
        samples.append(sample.fit.indices(wavelengths)[0])
    u = refractometer(1.487, 0.001, prior=prior).fit.indices(wavelengths)[1]
    assert u == pytest.approx(np.std(samples, axis=0), rel=0.08)


DRAWS = 1000


@pytest.mark.parametrize("lines", [(LINE_D,), (LINE_F, LINE_D, LINE_C)])
def test_the_uncertainty_covers_the_true_index(lines: tuple[float, ...]) -> None:
    """Random materials from the prior, measured with independent errors and a common one: coverage of 95 ± 2.5 %."""
    rng, prior = np.random.default_rng(2), prior_of_abbe(52.0, 6.0)
    wavelengths = [450.0, LINE_D, 860.0]
    covered = np.zeros(3)
    for n, power, bend in rng.normal((1.49, 1 / 52.0, prior.bend), (0.02, 6.0 / 52.0**2, prior.u_bend), (DRAWS, 3)):
        truth = refractometer(n, 1e-6, prior=Prior(1 / power, 1e-3, bend, 1e-3, "random"))
        read = truth.fit.indices(lines)[0] + rng.normal(0, 5e-4, len(lines)) + rng.normal(0, 3e-4)
        value, u = refractometer(read, 5e-4, lines, u_shared=3e-4, prior=prior).fit.indices(wavelengths)
        covered += abs(value - truth.fit.indices(wavelengths)[0]) < 1.96 * u
    assert covered / DRAWS == pytest.approx(0.95, abs=0.025)


def test_the_prior_covers_the_literature_from_which_it_is_derived() -> None:
    """For each resin of the table, n at 450 and 860 nm predicted from n_D alone is nearly always within 2 u."""
    errors = []
    for material in materials(RESINS):
        if material.shape is not None and material.range_nm[1] >= 860:
            n, u_n = refractometer(float(material.index(LINE_D)), 2e-4).fit.indices([450.0, 860.0])
            errors += list(abs(n - material.index([450.0, 860.0])) / u_n)
    assert len(errors) >= 14
    assert np.mean(np.array(errors) < 2) > 0.85
    assert max(errors) < 3.3  # Loctite 3526, whose V = 29 is the smallest of eleven


def test_the_prior_is_the_mean_and_standard_deviation_of_the_table() -> None:
    acrylates = [shape.abbe for material in materials(("acrylate",)) if (shape := material.shape)]
    prior = prior_of(("acrylate",))
    power = 1 / np.array(acrylates)
    u_power = np.std(power, ddof=1) * np.sqrt(1 + 1 / len(acrylates))
    assert prior.power == pytest.approx((np.mean(power), u_power))
    assert prior.abbe == pytest.approx(1 / np.mean(power))
    assert (prior_of().abbe, prior_of().u_abbe) == pytest.approx((51, 16), abs=1)
    assert "11 Abbe numbers of acrylates and photoresins from 29 to 68" in prior_of().source


def test_values_at_several_wavelengths_outweigh_the_prior() -> None:
    truth = refractometer(1.5, 1e-4, prior=Prior(40.0, 0.001, 0.3, 0.001, "nothing"))
    lines = [430.0, 486.13, 546.1, 589.3, 656.27, 780.0, 860.0]
    result = refractometer(truth.fit.indices(lines)[0], 2e-5, lines)
    assert result.abbe == pytest.approx(40.0, abs=0.2)
    assert result.u_abbe < 0.5
    assert result.bend == pytest.approx(0.3, abs=0.03)
    assert result.warnings == ()
    n, u_n = result.fit.indices(860.0)
    assert abs(n[0] - truth.fit.indices(860.0)[0]) < 2 * u_n[0] < 1e-4


def test_values_unlike_any_polymer_are_reported_or_refused() -> None:
    steep = refractometer([1.512, 1.49, 1.475], 5e-4, [450.0, 589.3, 860.0], prior=prior_of_abbe(60, 3))
    assert "disagree" in steep.warnings[0]
    assert "60 ± 3 from the prior" in steep.warnings[0]
    with pytest.raises(DataError, match=r"rise with .*wavelength"):
        refractometer([1.44, 1.49, 1.54], 1e-3, [450.0, 500.0, 860.0])


def test_the_uncertainty_due_to_a_single_wavelength_is_reported() -> None:
    (line,) = refractometer(1.487, 0.0005).warnings
    assert "a single wavelength" in line
    assert "u(n) = 0.0033 at 450 nm and 0.0024 at 860 nm" in line


def test_temperature_and_calibration_errors_are_common_to_all_wavelengths() -> None:
    plain = refractometer(1.487, 5e-4, prior=SHARP).fit.indices([500.0, 860.0])[1]
    warm = refractometer(1.487, 5e-4, prior=SHARP, u_temperature_k=5.0).fit.indices([500.0, 860.0])[1]
    elastic = refractometer(1.487, 5e-4, prior=SHARP, u_temperature_k=5.0, dn_dt_per_k=-3e-4).fit.indices([500.0])[1]
    assert warm == pytest.approx(np.hypot(plain, 1e-3), rel=0.02)  # a shift of n_D changes n_F − n_C, too
    assert elastic[0] == pytest.approx(np.hypot(plain[0], 1.5e-3), rel=0.02)
    wavelengths = np.linspace(420, 900, 40)
    n = refractometer(1.487, 5e-4, prior=SHARP).fit.indices(wavelengths)[0]
    shared = refractometer(n, 1e-4, wavelengths, u_shared=1e-3).fit.indices([600.0])[1]
    assert shared[0] == pytest.approx(1e-3, rel=0.02)


def test_the_order_of_values_does_not_matter() -> None:
    ascending = refractometer([1.5, 1.49, 1.485], [5e-4, 6e-4, 7e-4], [450.0, 589.3, 860.0])
    permuted = refractometer([1.485, 1.5, 1.49], [7e-4, 5e-4, 6e-4], [860.0, 450.0, 589.3])
    assert_allclose(ascending.fit.indices([450.0, 860.0]), permuted.fit.indices([450.0, 860.0]), rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ((0.9, 1e-3), "n = 0.9; must be above 1 and below 3"),
        ((np.nan, 1e-3), "n = nan; must be above 1 and below 3"),
        ((1.49, 0.0), "u_n = 0.0; must be above 0 and below 0.5"),
        ((1.49, 1e-3, 350.0), "wavelength_nm = 350.0; must be from 400 to 1000 nm"),
        (([1.49, 1.5], 1e-3), "2 indices, 1 wavelengths, 1 uncertainties"),
        (([], 1e-3, []), "0 indices, 0 wavelengths"),
        (([1.49, 1.5], [1e-3] * 3, [450.0, 600.0]), "2 indices, 2 wavelengths, 3 uncertainties"),
    ],
)
def test_refuses_invalid_values_in_one_line(arguments: Any, line: str) -> None:
    with pytest.raises(DataError) as error:
        refractometer(*arguments)
    assert line in str(error.value)
    assert len(str(error.value).splitlines()) == 1


def test_refuses_an_invalid_prior() -> None:
    with pytest.raises(DataError, match="Abbe number = 2; must be from 5 to 200"):
        prior_of_abbe(2, 0.5)
    with pytest.raises(DataError, match=r"uncertainty of the Abbe number = 40; must be above 0 and below .*25"):
        prior_of_abbe(50, 40)
    with pytest.raises(DataError, match=r"u_temperature_k = -1\.0; must be at least 0"):
        refractometer(1.49, 1e-3, u_temperature_k=-1.0)
    with pytest.raises(DataError, match=r"u_shared = -1\.0; must be at least 0"):
        refractometer(1.49, 1e-3, u_shared=-1.0)
