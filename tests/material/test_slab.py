"""A slab and its inversion: compared with the formulas at fifty digits, analytic cases and finite differences."""

import math
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from solen.material.index import high_precision, inversion
from solen.material.index.fringes import fringe_spacing_nm
from solen.material.index.inversion import AirInversion, invert, invert_many, slopes
from solen.material.index.stack import forward, interface_reflectance

LAYERS = [
    (1.5, 0.0, 25.0, 860.0),
    (1.489, 1e-9, 25.0, 500.0),
    (1.44, 2e-7, 200.0, 405.0),
    (1.56, 1e-4, 50.0, 860.0),
    (1.7, 0.02, 100.0, 3000.0),
    (1.4, 0.3, 200.0, 7000.0),
    (3.44, 0.0, 500.0, 2400.0),
    (1.001, 1e-6, 25.0, 600.0),
]


@pytest.mark.parametrize(("n", "k", "h", "wavelength"), LAYERS)
def test_the_forward_model_equals_the_reference_to_rounding(n: float, k: float, h: float, wavelength: float) -> None:
    expected = high_precision.layer(n, k, h, wavelength)
    # the relative rounding error of e^(−x) is x times that of x
    depth = 4 * math.pi * k * h * 1e3 / wavelength
    for value, exact in zip(forward(n, k, h, wavelength), expected, strict=True):
        assert float(value) == pytest.approx(float(exact), rel=1e-15 * (4 + depth))


@pytest.mark.parametrize(("n", "k", "h", "wavelength"), [layer for layer in LAYERS if layer[1] < 0.1])
def test_the_reference_inverts_itself(n: float, k: float, h: float, wavelength: float) -> None:
    inverted_n, inverted_k = high_precision.index(*high_precision.layer(n, k, h, wavelength), h, wavelength)
    assert abs(inverted_n - Decimal(n)) < Decimal("1e-30")
    assert abs(inverted_k - Decimal(k)) < Decimal("1e-30")


@pytest.mark.parametrize(("n", "k", "h", "wavelength"), LAYERS)
def test_the_inverse_is_exact_to_rounding(n: float, k: float, h: float, wavelength: float) -> None:
    r, t = forward(n, k, h, wavelength)
    inverted = invert(r, t, h, wavelength)
    assert float(inverted.n) == pytest.approx(n, abs=1e-13)  # near n = 1, n − 1 is proportional to the root of R
    assert float(inverted.k) == pytest.approx(k, abs=1e-16 * wavelength / h)


@given(st.floats(0.001, 0.6), st.floats(1e-12, 1.0), st.floats(1, 1000), st.floats(200, 20000))
def test_any_reflectance_and_transmittance_invert_as_at_fifty_digits(
    r: float, t: float, h: float, wavelength: float
) -> None:
    inverted = invert(r, t, h, wavelength)
    try:
        n, k = high_precision.index(r, t, h, wavelength)
    except ArithmeticError:  # no n, as k is too large for this R
        assert np.isnan(inverted.n)
        return
    scale = wavelength / (4e3 * math.pi * h)
    assert float(inverted.k) == pytest.approx(float(k), abs=1e-14 * scale, rel=1e-14)
    root = float(n - (1 + Decimal(float(inverted.face))) / (1 - Decimal(float(inverted.face))))
    if root > 1e-3:  # at the branch point, only the root of the rounding error is reached
        assert float(inverted.n) == pytest.approx(float(n), rel=1e-12)


def test_a_clear_slab_has_the_closed_form() -> None:
    n = np.linspace(1.2, 4.0, 50)
    r, t = forward(n, 0.0, 25.0, 500.0)
    np.testing.assert_allclose(t, 2 * n / (n**2 + 1), rtol=1e-15)
    np.testing.assert_allclose(r + t, 1.0, rtol=1e-15)


def test_a_layer_of_air_does_not_reflect_and_an_opaque_one_reflects_at_its_front_face() -> None:
    assert [float(fraction) for fraction in forward(1.0, 0.0, 25.0, 500.0)] == [0.0, 1.0]
    r, t = forward(1.5, 1.0, 1e6, 500.0)
    assert (float(t), float(r)) == (0.0, float(interface_reflectance(1.0, 0.0, 1.5, 1.0)))


@given(st.floats(1.0, 4.0), st.floats(0.0, 1.0), st.floats(1, 1000), st.floats(200, 20000))
def test_no_slab_generates_light(n: float, k: float, h: float, wavelength: float) -> None:
    r, t = forward(n, k, h, wavelength)
    assert r >= 0.0
    assert t >= 0.0
    assert r + t <= 1.0 + 1e-15


def test_sensitivities_of_a_polymer_equal_the_analytic_ones() -> None:
    n_by, _ = slopes(*forward(1.5, 0.0, 50.0, 860.0), 50.0, 860.0)
    # analytically, at k = 0: R = 2F/(1 + F), T = (1 − F)/(1 + F), and n follows from F alone
    assert float(n_by["R"]) == pytest.approx(3.9125, rel=1e-12)
    assert float(n_by["T"]) == pytest.approx(-0.3125, rel=1e-12)
    assert float(n_by["T"] - n_by["R"]) * 0.001 == pytest.approx(-0.0042, abs=5e-5)  # R by difference


@given(st.floats(1.2, 3.5), st.floats(1e-9, 0.02), st.floats(10, 300), st.floats(300, 3000), st.sampled_from(range(3)))
def test_slopes_agree_with_finite_differences_at_fifty_digits(
    n: float, k: float, h: float, wavelength: float, which: int
) -> None:
    values = [*high_precision.layer(n, k, h, wavelength), Decimal(h)]
    assume(values[1] > Decimal("1e-6"))  # R − R_F, as published, loses twice as many digits as T
    step = values[which] * Decimal("1e-20")
    low, high = list(values), list(values)
    low[which] -= step
    high[which] += step
    down, up = (high_precision.index(r, t, h, wavelength) for r, t, h in (low, high))
    r, t, _ = (float(value) for value in values)
    name = ("R", "T", "thickness_um")[which]
    pair = [by[name] for by in slopes(r, t, h, wavelength)]
    for slope, lower, upper in zip(pair, down, up, strict=True):
        # the slope of n with h is proportional to k: if k is lost in rounding, the slope is lost too
        assert float(slope) == pytest.approx(float((upper - lower) / (2 * step)), rel=1e-6, abs=1e-12)


def test_the_index_hardly_depends_on_the_thickness() -> None:
    r, t = forward(1.5, 1e-5, 50.0, 860.0)
    n = invert(r, t, np.array([25.0, 50.0, 200.0]), 860.0).n
    assert float(np.ptp(n)) < 2e-9


@pytest.mark.parametrize(("r", "t"), [(0.0, 0.9), (1.0, 0.1), (-0.01, 0.9), (0.05, 0.0), (0.05, -0.1), (np.nan, 0.9)])
def test_impossible_readings_yield_no_index(r: float, t: float) -> None:
    inverted = invert(r, t, 25.0, 500.0)
    assert np.isnan(inverted.n)


def test_excess_light_yields_a_negative_k_and_an_index() -> None:
    inverted = invert(0.0800, 0.9300, 25.0, 500.0)
    assert float(inverted.k) < 0.0
    assert float(inverted.tau) > 1.0
    assert float(inverted.n) == pytest.approx(1.51, abs=0.01)


def test_the_other_index_fits_equally_well() -> None:
    r, t = forward(1.3, 0.5, 5.0, 8000.0)
    inverted = invert(r, t, 5.0, 8000.0)
    again = forward(inverted.other_n, inverted.k, 5.0, 8000.0)
    np.testing.assert_allclose(again, (r, t), rtol=1e-13)


@pytest.mark.parametrize("shape", [(), (7,), (3, 1, 5), (2, 0), (40, 1000)])
def test_many_values_are_inverted_as_each_alone(shape: tuple[int, ...]) -> None:
    rng = np.random.default_rng(5)
    r, t = rng.uniform(0.03, 0.2, shape), rng.uniform(0.2, 0.95, shape)
    wavelength = np.linspace(400.0, 900.0, shape[-1]) if shape else 500.0
    n, k = invert_many(r, t, 30.0, wavelength)
    inverted: AirInversion = invert(r, t, 30.0, wavelength)
    np.testing.assert_array_equal(n, inverted.n)
    np.testing.assert_array_equal(k, inverted.k)
    assert n.shape == shape


def test_many_values_are_inverted_on_several_cores_into_given_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inversion, "MIN_PARALLEL_SIZE", 0)
    monkeypatch.setattr("os.cpu_count", lambda: 3)
    rng = np.random.default_rng(6)
    r, t = rng.uniform(0.03, 0.2, (7, 11)), rng.uniform(0.2, 0.95, (7, 11))
    out = np.empty((7, 11)), np.empty((7, 11))
    n, k = invert_many(r, t, 30.0, 500.0, out)
    assert n is out[0]
    np.testing.assert_array_equal(n, invert(r, t, 30.0, 500.0).n)
    np.testing.assert_array_equal(k, invert(r, t, 30.0, 500.0).k)


def test_fringes_of_a_thin_layer() -> None:
    assert float(fringe_spacing_nm(1.494, 25.0, 860.0)) == pytest.approx(9.9, abs=0.005)
