"""The index in some light, and what fringes mean for a spectrum."""

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


def spectrum(u: float | None = 1e-3, dead: slice = slice(0, 0)) -> IndexSpectrum:
    r, t = forward(N, 1e-5, 50.0, NM)
    r[dead] = np.nan
    return measured(NM, reading(t, u), reading(r, u), Length(50.0))


def test_at_one_wavelength_it_is_the_index_there() -> None:
    found = index_in(spectrum(), lines([800.0], [1.0]))
    at = int(np.flatnonzero(NM == 800.0)[0])
    assert found.n == pytest.approx(N[at], abs=1e-12)
    assert found.u_n == pytest.approx(spectrum().n.u[at])
    assert (found.wavelength_nm, found.reason, found.bridged, found.outside) == (800.0, None, 0.0, 0.0)


def test_between_wavelengths_it_is_linear() -> None:
    found = index_in(spectrum(), lines([801.0], [3.0]))
    at = int(np.flatnonzero(NM == 800.0)[0])
    assert found.n == pytest.approx((N[at] + N[at + 1]) / 2, abs=1e-12)


def test_an_led_is_weighted_with_its_power() -> None:
    sigma = 30.0 / (2 * math.sqrt(2 * math.log(2)))
    found = index_in(spectrum(), led(850.0, 30.0))
    # mean of 1/λ² over a normal distribution, to fourth order in σ/λ; cut at three σ it is 1e-8 off
    expected = 1.48 + 5e3 / 850.0**2 * (1 + 3 * (sigma / 850) ** 2 + 15 * (sigma / 850) ** 4)
    assert found.n == pytest.approx(expected, abs=2e-7)
    assert found.wavelength_nm == pytest.approx(850.0, abs=1e-9)
    assert led(850.0, None).share.tolist() == [1.0]


def test_what_scatters_averages_out_and_what_is_common_does_not() -> None:
    rng = np.random.default_rng(1)
    r, t = forward(N, 1e-5, 50.0, NM)
    rows = r + rng.normal(0.0, 1e-3, (20, NM.size))
    noisy = measured(NM, reading(t, 0.0), reading(rows, 5e-4), Length(50.0))
    at, wide = index_in(noisy, lines([850.0], [1.0])), index_in(noisy, led(850.0, 30.0))
    assert at.u_random_n is not None
    assert wide.u_random_n is not None
    assert wide.u_common_n == pytest.approx(at.u_common_n, rel=0.05)
    assert wide.u_random_n < 0.4 * at.u_random_n
    assert wide.u_n == pytest.approx(math.hypot(wide.u_random_n, wide.u_common_n or 0.0))


def test_masked_wavelengths_are_bridged_and_reported() -> None:
    found = index_in(spectrum(dead=slice(74, 77)), led(850.0, 30.0))
    assert found.n == pytest.approx(index_in(spectrum(), led(850.0, 30.0)).n, abs=1e-6)
    assert 0.2 < found.bridged < 0.35


def test_light_that_was_not_measured_is_not_guessed_at() -> None:
    found = index_in(spectrum(), led(1000.0, 30.0))
    assert found.n is None
    assert found.reason == "50% of the light is outside 700 to 1000 nm, where n is known"
    assert index_in(spectrum(dead=slice(0, None)), led(850.0, 30.0)).reason == "n is masked at all wavelengths"


def test_without_a_known_uncertainty_none_is_claimed() -> None:
    found = index_in(spectrum(u=None), led(850.0, 30.0))
    assert found.n is not None
    assert found.u_n is None


def test_a_measured_spectrum_is_weighted_by_its_steps() -> None:
    light = measured_light([900.0, 840.0, 850.0], [1.0, 1.0, 1.0])
    assert light.wavelength_nm.tolist() == [840.0, 850.0, 900.0]
    assert light.weight.sum() == pytest.approx(1.0)
    assert light.weight[2] > light.weight[0]


@pytest.mark.parametrize(("nm", "power"), [([], []), ([800.0], [0.0]), ([800.0, 810.0], [1.0, -1.0]), ([0.0], [1.0])])
def test_light_that_is_none_is_refused(nm: list[float], power: list[float]) -> None:
    with pytest.raises(DataError, match="spectrum of the light; requires wavelengths above 0"):
        lines(nm, power)


def test_fringes_wider_than_the_bandwidth_are_warned_of() -> None:
    assert fringe_warnings(NM, N, 500.0, 5.0) == ()
    (line,) = fringe_warnings(NM, N, 25.0, 8.0)[:1]
    assert line.startswith(
        "do not use: fringes of a layer of 25 µm are 6.6 nm apart at 700 nm and 13 nm at 1000 nm, and from 772 nm"
    )
    assert "wider than the bandwidth of 8 nm" in line
    (coarse,) = fringe_warnings(NM[::4], N[::4], 25.0, 2.0)[1:]
    assert coarse.startswith("do not use: the wavelengths are 8 nm apart, which does not resolve the fringes")
    (unknown,) = fringe_warnings(NM, N, 25.0, None)
    assert "the instrument's bandwidth is not specified" in unknown
    assert len(fringe_warnings(NM[:1], N[:1], 25.0, 2.0)) == 2
    assert fringe_warnings(NM, np.full(NM.shape, np.nan), 25.0, 2.0) == ()
