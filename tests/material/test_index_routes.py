"""Routes to an index: their values, the reasons for masking, and the coverage of the stated uncertainty."""

from collections.abc import Callable

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.index.lossless_index import lossless_index
from solen.material.index.masks import Reason
from solen.material.index.reading import Length, combined, reading, student_t
from solen.material.index.routes import (
    AS_PUBLISHED,
    absorptance,
    as_published,
    is_absorbance,
    lossless,
    measured,
)
from solen.material.index.spectrum import IndexSpectrum
from solen.material.index.stack import forward

NM = np.linspace(400.0, 900.0, 501)
H = Length(25.0, 0.5)
LAYERS = ((1.489, 0.0), (1.52, 2e-4), (1.6, 2e-3))


def clear_layer(n: float = 1.489) -> tuple[FloatArray, FloatArray]:
    return forward(np.full(NM.shape, n), 0.0, 25.0, NM)


def only_warning(spectrum: IndexSpectrum, text: str) -> str:
    (line,) = [line for line in spectrum.warnings if text in line]
    return line


def test_without_noise_n_and_k_are_recovered() -> None:
    n, k = 1.48 + 5e3 / NM**2, 1e-5 + 1e-9 * (900 - NM)
    r, t = forward(n, k, 25.0, NM)
    spectrum = measured(NM, reading(t), reading(r), Length(25.0))
    assert np.abs(spectrum.n.value - n).max() < 1e-9
    assert np.abs(spectrum.k.value - k).max() < 1e-12
    assert set(spectrum.reason) == {None}
    assert spectrum.measurement


def test_without_specified_uncertainty_there_is_none() -> None:
    r, t = forward(1.5, 1e-5, 25.0, NM)
    spectrum = measured(NM, reading(t), reading(r, 0.001), H)
    assert np.isnan(spectrum.n.u).all()
    assert np.isnan(spectrum.k.u).all()
    assert "--u-T" in only_warning(spectrum, "the uncertainty of T is unknown")


@pytest.mark.parametrize("seed", range(5))
def test_with_noise_every_index_of_a_clear_layer_is_known_and_unbiased(seed: int) -> None:
    rng, draws = np.random.default_rng(seed), 4000
    nm = np.linspace(400.0, 900.0, draws)
    r, t = (value + rng.normal(0.0, 1e-3, draws) for value in forward(1.489, 0.0, 25.0, nm))
    spectrum = measured(nm, reading(t, 1e-3), reading(r, 1e-3), H)
    assert spectrum.n.known.all()
    # the curvature of n(R) causes a bias of n'' u²/2 ≈ 2e-5; the rest is the uncertainty of the mean
    assert abs(spectrum.n.value.mean() - 1.489) < 4 * 0.0039 / np.sqrt(draws) + 3e-5
    # half of the points have R + T > 1, and in none of the others does k exceed the noise
    assert 0.45 < np.mean(spectrum.k.codes == Reason.NEGATIVE) < 0.55
    assert not spectrum.k.known.any()
    assert spectrum.k_high95[spectrum.k.codes == Reason.NEGATIVE].min() > 0.0


def simulated(name: str, n: float, k: float, draws: int, u: float) -> IndexSpectrum:
    """Return a spectrum in which each wavelength is an independent random draw."""
    rng = np.random.default_rng(7)
    nm = np.full(draws, 600.0)
    exact = forward(np.full(draws, n), k, 25.0, nm)
    count = 3 if name == "repeats" else 1
    r, t, a = (value + rng.normal(0.0, u, (count, draws)) for value in (*exact, 1.0 - exact[0] - exact[1]))
    if name == "repeats":
        return measured(nm, reading(t), reading(r), Length(25.0))
    if name == "absorptance":
        return absorptance(nm, reading(t, u), reading(a, u), Length(25.0))
    return measured(nm, reading(t, u), reading(r, u), H) if name == "measured" else lossless(nm, reading(t, u))


@pytest.mark.parametrize(
    ("name", "n", "k"),
    [
        ("lossless", 1.489, 0.0),
        *((name, n, k) for name in ("measured", "absorptance", "repeats") for n, k in LAYERS),
    ],
)
def test_the_stated_uncertainty_covers_the_true_index(name: str, n: float, k: float) -> None:
    draws = 2000
    spectrum = simulated(name, n, k, draws, 1e-3)
    assert spectrum.n.known.mean() > 0.998
    error = np.abs(spectrum.n.value - n)[spectrum.n.known]
    for bound, level in ((spectrum.n.u, 0.6827), (spectrum.n.u95, 0.95)):
        covered = float(np.mean(error <= bound[spectrum.n.known]))
        scatter = 4 * np.sqrt(level * (1 - level) / draws)  # four standard deviations of the coverage
        # Student's t for a sum of several small samples is a conservative approximation
        assert -scatter < covered - level < scatter + (0.02 if name == "repeats" else 0.0)


def test_the_uncertainty_of_k_includes_that_of_the_thickness() -> None:
    draws, k, u_h = 1000, 2e-3, 0.5
    rng = np.random.default_rng(11)
    r, t = forward(1.5, k, 25.0, 600.0)
    hits = []
    for h in 25.0 + rng.normal(0.0, u_h, draws):
        read_t, read_r = (reading([float(value) + rng.normal(0.0, 1e-3)], 1e-3) for value in (t, r))
        spectrum = measured([600.0], read_t, read_r, Length(h, u_h))
        hits.append((abs(spectrum.k.value[0] - k) <= spectrum.k.u[0], spectrum.k_low95[0] <= k <= spectrum.k_high95[0]))
    assert np.mean(hits, axis=0) == pytest.approx((0.6827, 0.95), abs=0.05)


def test_the_upper_bound_of_an_unresolved_k_covers_the_truth() -> None:
    draws, k = 4000, 1e-6
    rng = np.random.default_rng(3)
    nm = np.full(draws, 600.0)
    r, t = (value + rng.normal(0.0, 1e-3, draws) for value in forward(np.full(draws, 1.5), k, 25.0, nm))
    spectrum = measured(nm, reading(t, 1e-3), reading(r, 1e-3), Length(25.0))
    unresolved = np.isin(spectrum.k.codes, (Reason.SMALL, Reason.NEGATIVE))
    assert unresolved.all()
    assert np.isnan(spectrum.k.value[unresolved]).all()
    assert np.isfinite(spectrum.k.u[unresolved]).all()
    # one-sided with k ≥ 0 as the only prior knowledge: the coverage is at least 95 %
    assert np.mean(spectrum.k_high95[unresolved] >= k) > 0.95
    assert (spectrum.k_low95[unresolved] == 0.0).all()


def test_a_k_above_the_noise_is_resolved() -> None:
    nm, u = np.linspace(500.0, 900.0, 400), 1e-3
    rng = np.random.default_rng(5)
    k = np.where(nm < 520.0, 2e-4, 1e-6)
    r, t = (value + rng.normal(0.0, u, nm.size) for value in forward(1.5, k, 25.0, nm))
    spectrum = measured(nm, reading(t, u), reading(r, u), Length(25.0))
    assert spectrum.k.known[nm < 520.0].all()
    assert spectrum.k.known[nm > 520.0].mean() < 0.02


def test_an_energy_excess_is_reported_if_only_the_mean_over_wavelengths_shows_it() -> None:
    nm = np.linspace(500.0, 900.0, 200)
    rng = np.random.default_rng(6)
    r, t = (rng.normal(value, 2e-3, (5, nm.size)) for value in forward(1.5, 0.0, 25.0, nm))
    exact, bright = (measured(nm, reading(t + offset), reading(r), Length(25.0)) for offset in (0.0, 2e-3))
    assert not any("below 0" in text and "mean over all wavelengths" in text for text in exact.warnings)
    assert only_warning(bright, "mean over all wavelengths")
    assert "below 0" in only_warning(bright, "mean over all wavelengths")


def test_an_opaque_layer_has_a_lower_bound_of_k() -> None:
    k = 0.05
    r, t = forward(1.5, k, 25.0, [600.0])
    spectrum = measured([600.0], reading(t, 1e-3), reading(r, 1e-3), Length(25.0))
    assert spectrum.reason == (f"k: {Reason.DARK.words}",)
    assert spectrum.n.value[0] == pytest.approx(1.5, abs=1e-9)
    assert 0.0 < spectrum.k_low95[0] < k
    assert np.isnan(spectrum.k_high95[0])


def test_wavelengths_without_transmitted_light_are_masked() -> None:
    r, t = forward(1.5, 5.0, 25.0, [600.0])
    assert float(t[0]) == 0.0
    spectrum = measured([600.0, 600.0], reading([0.0, 1e-310]), reading([float(r[0])] * 2), Length(25.0))
    assert spectrum.reason == tuple(f"n, k: {reason.words}" for reason in (Reason.TRANSMITTANCE, Reason.OPAQUE))


def test_masked_wavelengths_have_a_reason() -> None:
    r = [0.05, -0.001, 1.0, 0.20, np.nan, 0.05, 0.10, 0.0800]
    t = [0.90, 0.9000, 0.5, -0.1, 0.900, np.nan, 0.95, 0.9220]
    spectrum = measured(np.full(8, 500.0), reading(t, 1e-3), reading(r, 1e-3), Length(25.0))
    assert spectrum.reason == (
        None,
        f"n, k: {Reason.REFLECTANCE.words}",
        f"n, k: {Reason.REFLECTANCE.words}",
        f"n, k: {Reason.TRANSMITTANCE.words}",
        f"n, k: {Reason.MISSING.words}",
        f"n, k: {Reason.MISSING.words}",
        f"n, k: {Reason.ENERGY.words}",
        f"k: {Reason.NEGATIVE.words}",
    )
    masked = ~spectrum.n.known
    for values in (spectrum.n.value, spectrum.n.u, spectrum.k.value, spectrum.k.u, spectrum.k_high95):
        assert np.isnan(values[masked]).all()
    assert "masked at 2 of 8 wavelengths: R is not between 0 and 1" in only_warning(spectrum, "not between 0 and 1")


def test_a_negative_discriminant_is_masked() -> None:
    spectrum = measured([5000.0], reading([0.02]), reading([0.02]), Length(1.0))
    assert spectrum.reason == (f"n, k: {Reason.DISCRIMINANT.words}",)


def test_a_spectrum_with_r_plus_t_above_1_is_masked_everywhere() -> None:
    r, t = clear_layer()
    spectrum = measured(NM, reading(t + 0.005, 1e-3), reading(r, 1e-3), H)
    assert set(spectrum.n.codes) == {Reason.ENERGY}


@pytest.mark.parametrize(("excess", "masked"), [(0.012, False), (0.014, True)])
def test_without_specified_uncertainty_that_of_typical_instruments_is_assumed(excess: float, masked: bool) -> None:
    spectrum = measured([500.0], reading([0.92 + excess]), reading([0.08]), Length(25.0))
    assert bool(spectrum.n.codes[0] == Reason.ENERGY) is masked


def test_an_ambiguous_index_is_masked() -> None:
    r, t = forward(0.95, 0.3, 2.0, [9000.0])
    spectrum = measured([9000.0], reading(t), reading(r), Length(2.0))
    assert spectrum.reason == (f"n: {Reason.AMBIGUOUS.words}",)
    assert spectrum.k.value[0] == pytest.approx(0.3, abs=1e-12)


def test_the_published_values_are_reproduced_and_labelled() -> None:
    spectrum = as_published([450.0, 500.0, 860.0], reading([0.8473, 0.8685, 0.8889], 1e-3), Length(25.0))
    assert spectrum.n.value.round(2).tolist() == [1.54, 1.49, 1.44]
    assert (spectrum.mode, spectrum.measurement) == ("as-published", False)
    assert spectrum.warnings[0] == AS_PUBLISHED
    assert "not valid as a measurement" in AS_PUBLISHED
    assert np.isnan(spectrum.n.u).all()
    assert np.isnan(spectrum.k.value).all()
    assert spectrum.reason == (f"k: {Reason.PUBLISHED.words}",) * 3
    # a clear layer with the same transmittances would have very different indices
    assert spectrum.lossless.value == pytest.approx(lossless_index([0.8473, 0.8685, 0.8889]))


def test_evaluating_a_clear_layer_as_published_yields_an_artefact() -> None:
    r, t = forward(1.5, 0.0, 25.0, [600.0])
    assert [float(t[0]), float(r[0])] == pytest.approx([0.92308, 0.07692], abs=5e-6)
    spectrum = as_published([600.0], reading(t), Length(25.0))
    assert spectrum.reflectance[0] == pytest.approx(0.04216, abs=5e-6)
    assert spectrum.n.value[0] == pytest.approx(1.351, abs=5e-4)
    dark = as_published([600.0, 600.0], reading([0.13712, 0.13714]), Length(25.0))
    assert dark.n.codes.tolist() == [Reason.REFLECTANCE, Reason.NONE]


def test_evaluating_silicon_as_published_yields_a_wrong_index() -> None:
    spectrum = as_published([2400.0], reading([0.5333]), Length(500.0))
    assert spectrum.n.value[0] == pytest.approx(2.197, abs=5e-4)
    assert spectrum.lossless.value[0] == pytest.approx(3.461, abs=5e-3)


@pytest.mark.parametrize(("kind", "base"), [("log10", np.log(10.0)), ("ln", 1.0)])
def test_refuses_an_absorbance_in_place_of_an_absorptance(kind: str, base: float) -> None:
    rng = np.random.default_rng(1)
    _, t = forward(1.49, 1e-5, 25.0, NM)
    a = np.round(-np.log(t + rng.normal(0.0, 2e-4, NM.size)) / base, 4)
    assert is_absorbance(a, t, base)
    line = f"−{kind} T, .* n\\(650 nm\\) = 1.5.*--mode lossless"
    with pytest.raises(DataError, match=line):
        absorptance(NM, reading(t), reading(a), H)


def test_refuses_a_reflectance_computed_from_the_transmittance() -> None:
    _, t = forward(1.49, 1e-5, 25.0, NM)
    computed = np.round(1.0 - t + np.log10(t), 5)
    with pytest.raises(DataError, match="1 − T \\+ log10 T"):
        measured(NM, reading(t), reading(computed), H)


def test_an_absorptance_is_not_mistaken_for_an_absorbance() -> None:
    for k in (0.0, 1e-5, 1e-4, 1e-3):
        r, t = forward(1.49, k, 25.0, NM)
        assert not is_absorbance(1.0 - r - t, t)
        assert not is_absorbance(1.0 - r - t, t, 1.0)


def test_absorptance_recovers_n_and_k_but_amplifies_the_error_of_t() -> None:
    r, t = forward(1.5, 1e-4, 25.0, NM)
    spectrum = absorptance(NM, reading(t, 1e-3), reading(1.0 - r - t, 0.0), Length(25.0))
    assert np.abs(spectrum.n.value - 1.5).max() < 1e-9
    assert np.abs(spectrum.k.value - 1e-4).max() < 1e-12
    assert spectrum.n.u[-1] == pytest.approx(0.0042, rel=0.06)
    both = measured(NM, reading(t, 1e-3), reading(r, 0.0), Length(25.0))
    assert both.n.u[-1] == pytest.approx(0.00031, rel=0.05)


def test_a_lossless_estimate_is_an_upper_bound() -> None:
    r, t = forward(1.5, 1e-5, 25.0, NM)
    assert r.size == t.size
    spectrum = lossless(NM, reading(t, 1e-3))
    assert (spectrum.n.value > 1.5).all()
    assert set(spectrum.reason) == {f"k: {Reason.ASSUMED.words}"}
    line = only_warning(spectrum, "lossless")
    assert "upper bound" in line
    assert "too high by 0.004" in line
    without_reflection = lossless(NM, reading(np.full(NM.shape, 1.004)))
    assert without_reflection.reason[0] == f"n, k: {Reason.NO_REFLECTION.words}"


def test_common_errors_of_a_spectrum_are_separated_from_random_ones() -> None:
    r, t = clear_layer(1.5)
    rng = np.random.default_rng(2)
    offsets = np.array([[0.003], [-0.002], [0.0], [-0.001]])
    ts, rs = t + offsets, r + rng.normal(0.0, 5e-4, (4, NM.size))
    spectrum = measured(NM, reading(ts, 1e-4), reading(rs, 1e-4), Length(25.0))
    np.testing.assert_allclose(np.hypot(spectrum.n.u_random, spectrum.n.u_common), spectrum.n.u, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt((spectrum.n.common**2).sum(axis=0)), spectrum.n.u_common, rtol=1e-12)
    by_offsets = 0.3125 * offsets.std(ddof=1) / 2.0
    assert np.median(spectrum.n.u_common) == pytest.approx(np.hypot(by_offsets, 1e-4 * 3.925), rel=0.15)


def test_a_drift_of_repeats_is_reported_and_not_averaged() -> None:
    _, t = clear_layer(1.5)
    rng = np.random.default_rng(4)
    stationary = t + rng.normal(0.0, 5e-4, (5, NM.size))
    assert reading(stationary).warnings == ()
    drifting = reading(stationary + np.linspace(0.0, 2e-3, 5)[:, None], name="T")
    assert "the 5 repeat measurements of T drift in one direction" in drifting.warnings[0]
    assert "from 0.92" in drifting.warnings[0]
    assert drifting.u_common[0, 0] == pytest.approx(np.linspace(0.0, 2e-3, 5).std(ddof=1), rel=0.1)
    alternating = reading(stationary + np.array([[0.0], [2e-3], [0.0], [2e-3], [1e-3]]))
    assert alternating.warnings == ()


def test_few_repeats_increase_the_uncertainty() -> None:
    assert student_t(0.682689492137086, np.array([1.0, 2.0, np.inf])) == pytest.approx([1.8373, 1.3213, 1.0], abs=1e-4)
    assert student_t(0.95, 4.0) == pytest.approx(2.7764, abs=1e-4)
    pair = reading(np.array([[0.9, 0.9], [0.91, 0.92]]))
    assert pair.u_random == pytest.approx([0.005, 0.01])
    assert pair.df == 1.0


def test_without_contributions_the_uncertainty_is_zero() -> None:
    assert combined([], 3).u.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: Length(0.0), "thickness = '0 µm'; must be finite and above 0"),
        (lambda: Length(float("nan")), "thickness = 'nan µm'"),
        (lambda: Length(25.0, 30.0), "uncertainty of the thickness = '30 µm'; must be at least 0 and below"),
        (
            lambda: reading([0.9], 1.5, name="T"),
            "specified uncertainty of T = 1.5; must be a fraction of at least 0 and below 1",
        ),
        (
            lambda: reading([0.9], -0.1, name="R"),
            "specified uncertainty of R = -0.1; must be a fraction of at least 0",
        ),
    ],
)
def test_refuses_invalid_numbers(make: Callable[[], object], line: str) -> None:
    with pytest.raises(DataError) as error:
        make()
    assert str(error.value).startswith(line)
