"""A refractometer's value and what is expected of polymers: exact where measured, covering where expected."""

from typing import Any

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.index.literature import LINE_C, LINE_D, LINE_F, LINE_HELIUM, RESINS, materials
from solen.material.index.refractometer import Prior, prior_of, prior_of_abbe, refractometer

SHARP = Prior(50.0, 0.001, 0.1, 0.001, "nothing")


def test_where_it_was_measured_the_index_is_the_measured_one() -> None:
    for nm in (LINE_D, 632.8, 450.0):
        found = refractometer(1.487, 0.0005, nm)
        n, u_n = found.fit.indices(nm)
        assert n[0] == pytest.approx(1.487, abs=1e-13)
        assert u_n[0] == pytest.approx(0.0005, rel=1e-9)
        assert found.chi2 == pytest.approx(0, abs=1e-12)
        assert found.fit.valid_nm == (400.0, 1000.0)


def test_the_formula_has_the_abbe_number_and_the_bend_that_it_was_given() -> None:
    found = refractometer(1.487, 0.0005, prior=Prior(47.0, 5.0, 0.2, 0.1, "nothing")).fit
    d, f, c = (found.index(line) for line in (LINE_HELIUM, LINE_F, LINE_C))
    assert (d - 1) / (f - c) == pytest.approx(47.0, abs=1e-9)
    rise = found.C_um4 * ((LINE_F * 1e-3) ** -4 - (LINE_C * 1e-3) ** -4)
    assert rise / (f - c) == pytest.approx(0.2, abs=1e-9)


def test_the_covariance_is_the_spread_of_drawn_dispersions() -> None:
    """Against 2,000 formulas with drawn n, V and s; the spread of so many is known to 1.6 %, curvature adds some."""
    rng = np.random.default_rng(1)
    prior = Prior(50.0, 5.0, 0.1, 0.1, "nothing")
    at = [405.0, 450.0, 700.0, 860.0, 1000.0]
    drawn = []
    for n, abbe, share in rng.normal((1.487, 50.0, 0.1), (0.001, 5.0, 0.1), (2000, 3)):
        one = refractometer(n, 0.001, prior=Prior(abbe, 0.001, share, 0.001, "drawn"))
        drawn.append(one.fit.indices(at)[0])
    assert refractometer(1.487, 0.001, prior=prior).fit.indices(at)[1] == pytest.approx(np.std(drawn, axis=0), rel=0.08)


DRAWS = 1000


@pytest.mark.parametrize("lines", [(LINE_D,), (LINE_F, LINE_D, LINE_C)])
def test_the_stated_uncertainty_covers_the_truth(lines: tuple[float, ...]) -> None:
    """Materials drawn from the prior, measured with errors of their own and one that all values share: 95 ± 2.5 %."""
    rng, prior = np.random.default_rng(2), prior_of_abbe(52.0, 6.0)
    at = [450.0, LINE_D, 860.0]
    inside = np.zeros(3)
    for n, power, share in rng.normal((1.49, 1 / 52.0, prior.bend), (0.02, 6.0 / 52.0**2, prior.u_bend), (DRAWS, 3)):
        truth = refractometer(n, 1e-6, prior=Prior(1 / power, 1e-3, share, 1e-3, "drawn"))
        read = truth.fit.indices(lines)[0] + rng.normal(0, 5e-4, len(lines)) + rng.normal(0, 3e-4)
        value, u = refractometer(read, 5e-4, lines, u_shared=3e-4, prior=prior).fit.indices(at)
        inside += abs(value - truth.fit.indices(at)[0]) < 1.96 * u
    assert inside / DRAWS == pytest.approx(0.95, abs=0.025)


def test_the_prior_covers_the_literature_it_was_made_of() -> None:
    """Each resin of the table by its n_D alone: n at 450 and 860 nm is where it is stated to be, 2 u nearly always."""
    far = []
    for one in materials(RESINS):
        if one.shape is not None and one.range_nm[1] >= 860:
            n, u_n = refractometer(float(one.index(LINE_D)), 2e-4).fit.indices([450.0, 860.0])
            far += list(abs(n - one.index([450.0, 860.0])) / u_n)
    assert len(far) >= 14
    assert np.mean(np.array(far) < 2) > 0.85
    assert max(far) < 3.3  # Loctite 3526, with V = 29 the least of eleven


def test_the_prior_is_the_mean_and_spread_of_the_table() -> None:
    acrylates = [shape.abbe for one in materials(("acrylate",)) if (shape := one.shape)]
    found = prior_of(("acrylate",))
    power = 1 / np.array(acrylates)
    spread = np.std(power, ddof=1) * np.sqrt(1 + 1 / len(acrylates))
    assert found.power == pytest.approx((np.mean(power), spread))
    assert found.abbe == pytest.approx(1 / np.mean(power))
    assert (prior_of().abbe, prior_of().u_abbe) == pytest.approx((51, 16), abs=1)
    assert "11 Abbe numbers of acrylates and photoresins from 29 to 68" in prior_of().source


def test_values_at_several_wavelengths_outweigh_the_prior() -> None:
    truth = refractometer(1.5, 1e-4, prior=Prior(40.0, 0.001, 0.3, 0.001, "nothing"))
    lines = [430.0, 486.13, 546.1, 589.3, 656.27, 780.0, 860.0]
    found = refractometer(truth.fit.indices(lines)[0], 2e-5, lines)
    assert found.abbe == pytest.approx(40.0, abs=0.2)
    assert found.u_abbe < 0.5
    assert found.bend == pytest.approx(0.3, abs=0.03)
    assert found.warnings == ()
    n, u_n = found.fit.indices(860.0)
    assert abs(n[0] - truth.fit.indices(860.0)[0]) < 2 * u_n[0] < 1e-4


def test_values_that_no_polymer_has_are_reported_or_refused() -> None:
    steep = refractometer([1.512, 1.49, 1.475], 5e-4, [450.0, 589.3, 860.0], prior=prior_of_abbe(60, 3))
    assert "values and prior disagree" in steep.warnings[0]
    assert "prior 60 ± 3" in steep.warnings[0]
    with pytest.raises(DataError, match="the values rise with the wavelength, or fall more than those of any polymer"):
        refractometer([1.44, 1.49, 1.54], 1e-3, [450.0, 500.0, 860.0])


def test_what_a_single_wavelength_leaves_open_is_reported() -> None:
    (line,) = refractometer(1.487, 0.0005).warnings
    assert "one wavelength was measured" in line
    assert "u(n) = 0.0033 at 450 nm and 0.0024 at 860 nm" in line


def test_temperature_and_calibration_shift_all_wavelengths_together() -> None:
    plain = refractometer(1.487, 5e-4, prior=SHARP).fit.indices([500.0, 860.0])[1]
    warm = refractometer(1.487, 5e-4, prior=SHARP, u_temperature_k=5.0).fit.indices([500.0, 860.0])[1]
    elastic = refractometer(1.487, 5e-4, prior=SHARP, u_temperature_k=5.0, dn_dt_per_k=-3e-4).fit.indices([500.0])[1]
    assert warm == pytest.approx(np.hypot(plain, 1e-3), rel=0.02)  # a shift of n_D is one of n_F − n_C, too
    assert elastic[0] == pytest.approx(np.hypot(plain[0], 1.5e-3), rel=0.02)
    many = np.linspace(420, 900, 40)
    n = refractometer(1.487, 5e-4, prior=SHARP).fit.indices(many)[0]
    shared = refractometer(n, 1e-4, many, u_shared=1e-3).fit.indices([600.0])[1]
    assert shared[0] == pytest.approx(1e-3, rel=0.02)


def test_the_order_of_values_does_not_matter() -> None:
    one = refractometer([1.5, 1.49, 1.485], [5e-4, 6e-4, 7e-4], [450.0, 589.3, 860.0])
    other = refractometer([1.485, 1.5, 1.49], [7e-4, 5e-4, 6e-4], [860.0, 450.0, 589.3])
    for a, b in zip(one.fit.indices([450.0, 860.0]), other.fit.indices([450.0, 860.0]), strict=True):
        assert a == pytest.approx(b, rel=1e-9)


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
def test_what_is_no_value_is_refused_in_one_line(arguments: Any, line: str) -> None:
    with pytest.raises(DataError) as refusal:
        refractometer(*arguments)
    assert line in str(refusal.value)
    assert len(str(refusal.value).splitlines()) == 1


def test_what_is_no_prior_is_refused() -> None:
    with pytest.raises(DataError, match="Abbe number = 2; must be from 5 to 200"):
        prior_of_abbe(2, 0.5)
    with pytest.raises(
        DataError, match=r"uncertainty of the Abbe number = 40; must be above 0 and below half of V = 50"
    ):
        prior_of_abbe(50, 40)
    with pytest.raises(DataError, match=r"u_temperature_k = -1\.0; must be at least 0"):
        refractometer(1.49, 1e-3, u_temperature_k=-1.0)
    with pytest.raises(DataError, match=r"u_shared = -1\.0; must be at least 0"):
        refractometer(1.49, 1e-3, u_shared=-1.0)
