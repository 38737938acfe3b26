"""The index averaged over a light spectrum, and warnings about fringes in a spectrum."""

import math

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.index import Length, forward, measured, reading
from solen.material.index.fringes import fringe_warnings
from solen.material.index.illuminant import index_in, led, lines, measured_light
from solen.material.index.spectrum import IndexSpectrum

NM = np.arange(700.0, 1001.0, 2.0)
N = 1.48 + 5e3 / NM**2


def spectrum(u: float | None = 1e-3, missing: slice = slice(0, 0)) -> IndexSpectrum:
    r, t = forward(N, 1e-5, 50.0, NM)
    r[missing] = np.nan
    return measured(NM, reading(t, u), reading(r, u), Length(50.0))


def test_at_a_single_wavelength_it_is_the_index_at_that_wavelength() -> None:
    result = index_in(spectrum(), lines([800.0], [1.0]))
    position = int(np.flatnonzero(NM == 800.0)[0])
    assert result.n == pytest.approx(N[position], abs=1e-12)
    assert result.u_n == pytest.approx(spectrum().n.u[position])
    assert (result.wavelength_nm, result.reason, result.bridged, result.outside) == (800.0, None, 0.0, 0.0)


def test_between_wavelengths_it_is_interpolated_linearly() -> None:
    result = index_in(spectrum(), lines([801.0], [3.0]))
    position = int(np.flatnonzero(NM == 800.0)[0])
    assert result.n == pytest.approx((N[position] + N[position + 1]) / 2, abs=1e-12)


def test_the_spectrum_of_an_led_is_weighted_by_its_power() -> None:
    sigma = 30.0 / (2 * math.sqrt(2 * math.log(2)))
    result = index_in(spectrum(), led(850.0, 30.0))
    # mean of 1/λ² over a normal distribution to fourth order in σ/λ; truncation at three σ changes it by 1e-8
    expected = 1.48 + 5e3 / 850.0**2 * (1 + 3 * (sigma / 850) ** 2 + 15 * (sigma / 850) ** 4)
    assert result.n == pytest.approx(expected, abs=2e-7)
    assert result.wavelength_nm == pytest.approx(850.0, abs=1e-9)
    assert led(850.0, None).weight.tolist() == [1.0]


def test_random_errors_average_out_and_common_errors_do_not() -> None:
    rng = np.random.default_rng(1)
    r, t = forward(N, 1e-5, 50.0, NM)
    rows = r + rng.normal(0.0, 1e-3, (20, NM.size))
    noisy = measured(NM, reading(t, 0.0), reading(rows, 5e-4), Length(50.0))
    line, band = index_in(noisy, lines([850.0], [1.0])), index_in(noisy, led(850.0, 30.0))
    assert line.u_random_n is not None
    assert band.u_random_n is not None
    assert band.u_common_n == pytest.approx(line.u_common_n, rel=0.05)
    assert band.u_random_n < 0.4 * line.u_random_n
    assert band.u_n == pytest.approx(math.hypot(band.u_random_n, band.u_common_n or 0.0))


def test_masked_wavelengths_are_interpolated_and_their_fraction_is_reported() -> None:
    result = index_in(spectrum(missing=slice(74, 77)), led(850.0, 30.0))
    assert result.n == pytest.approx(index_in(spectrum(), led(850.0, 30.0)).n, abs=1e-6)
    assert 0.2 < result.bridged < 0.35


def test_light_outside_the_measured_range_yields_no_index() -> None:
    result = index_in(spectrum(), led(1000.0, 30.0))
    assert result.n is None
    assert result.reason == "50% of the light is outside 700 to 1000 nm, where n is known"
    assert index_in(spectrum(missing=slice(0, None)), led(850.0, 30.0)).reason == "n is masked at all wavelengths"


def test_without_known_uncertainty_there_is_none() -> None:
    result = index_in(spectrum(u=None), led(850.0, 30.0))
    assert result.n is not None
    assert result.u_n is None


def test_a_measured_spectrum_is_weighted_by_its_steps() -> None:
    light = measured_light([900.0, 840.0, 850.0], [1.0, 1.0, 1.0])
    assert light.wavelength_nm.tolist() == [840.0, 850.0, 900.0]
    assert light.weight.sum() == pytest.approx(1.0)
    assert light.weight[2] > light.weight[0]


@pytest.mark.parametrize(("nm", "power"), [([], []), ([800.0], [0.0]), ([800.0, 810.0], [1.0, -1.0]), ([0.0], [1.0])])
def test_refuses_an_invalid_light_spectrum(nm: list[float], power: list[float]) -> None:
    with pytest.raises(DataError, match="spectrum of the light; requires wavelengths above 0"):
        lines(nm, power)


def test_warns_of_fringes_wider_than_the_bandwidth() -> None:
    assert fringe_warnings(NM, N, 500.0, 5.0) == ()
    (line,) = fringe_warnings(NM, N, 25.0, 8.0)[:1]
    assert line.startswith("do not use: ")
    for value in ("25 µm", "6.6 nm", "700 nm", "13 nm", "1000 nm", "772 nm", "bandwidth, 8 nm"):
        assert value in line
    (coarse,) = fringe_warnings(NM[::4], N[::4], 25.0, 2.0)[1:]
    assert coarse.startswith("do not use: the wavelengths are 8 nm apart")
    (unknown,) = fringe_warnings(NM, N, 25.0, None)
    assert "bandwidth" in unknown
    assert len(fringe_warnings(NM[:1], N[:1], 25.0, 2.0)) == 2
    assert fringe_warnings(NM, np.full(NM.shape, np.nan), 25.0, 2.0) == ()
