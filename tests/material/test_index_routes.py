"""Routes to an index: what they give, what they mask and why, and whether the stated uncertainty holds."""

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


def clear(n: float = 1.489) -> tuple[FloatArray, FloatArray]:
    return forward(np.full(NM.shape, n), 0.0, 25.0, NM)


def only(spectrum: IndexSpectrum, word: str) -> str:
    (found,) = [line for line in spectrum.warnings if word in line]
    return found


def test_without_noise_a_layer_comes_back() -> None:
    n, k = 1.48 + 5e3 / NM**2, 1e-5 + 1e-9 * (900 - NM)
    r, t = forward(n, k, 25.0, NM)
    found = measured(NM, reading(t), reading(r), Length(25.0))
    assert np.abs(found.n.value - n).max() < 1e-9
    assert np.abs(found.k.value - k).max() < 1e-12
    assert set(found.reason) == {None}
    assert found.measurement


def test_without_a_stated_uncertainty_none_is_claimed() -> None:
    r, t = forward(1.5, 1e-5, 25.0, NM)
    found = measured(NM, reading(t), reading(r, 0.001), H)
    assert np.isnan(found.n.u).all()
    assert np.isnan(found.k.u).all()
    assert "specify it with --u-T, or provide repeats" in only(found, "the uncertainty of T is unknown")


@pytest.mark.parametrize("seed", range(5))
def test_a_clear_layer_with_noise_keeps_every_index_and_is_unbiased(seed: int) -> None:
    rng, draws = np.random.default_rng(seed), 4000
    nm = np.linspace(400.0, 900.0, draws)
    r, t = (value + rng.normal(0.0, 1e-3, draws) for value in forward(1.489, 0.0, 25.0, nm))
    found = measured(nm, reading(t, 1e-3), reading(r, 1e-3), H)
    assert found.n.known.all()
    # the curvature of n(R) biases by n'' u²/2 ≈ 2e-5; the rest is the mean's own scatter
    assert abs(found.n.value.mean() - 1.489) < 4 * 0.0039 / np.sqrt(draws) + 3e-5
    # half of the points have R + T > 1, and none of the others a k that is more than noise
    assert 0.45 < np.mean(found.k.why == Reason.NEGATIVE) < 0.55
    assert not found.k.known.any()
    assert found.k_high95[found.k.why == Reason.NEGATIVE].min() > 0.0


def simulated(name: str, n: float, k: float, draws: int, u: float) -> IndexSpectrum:
    """A spectrum of which each wavelength is a draw of its own."""
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
def test_the_stated_uncertainty_covers_the_truth_as_often_as_it_says(name: str, n: float, k: float) -> None:
    draws = 2000
    found = simulated(name, n, k, draws, 1e-3)
    assert found.n.known.mean() > 0.998
    error = np.abs(found.n.value - n)[found.n.known]
    for bound, level in ((found.n.u, 0.6827), (found.n.u95, 0.95)):
        covered = float(np.mean(error <= bound[found.n.known]))
        scatter = 4 * np.sqrt(level * (1 - level) / draws)  # of the coverage itself, four standard deviations
        # Student's t for a sum of several small samples is an approximation that errs to the safe side
        assert -scatter < covered - level < scatter + (0.02 if name == "repeats" else 0.0)


def test_the_extinction_is_covered_with_the_thickness_in_it() -> None:
    draws, k, u_h = 1000, 2e-3, 0.5
    rng = np.random.default_rng(11)
    r, t = forward(1.5, k, 25.0, 600.0)
    hits = []
    for h in 25.0 + rng.normal(0.0, u_h, draws):
        one, other = (reading([float(value) + rng.normal(0.0, 1e-3)], 1e-3) for value in (t, r))
        found = measured([600.0], one, other, Length(h, u_h))
        hits.append((abs(found.k.value[0] - k) <= found.k.u[0], found.k_low95[0] <= k <= found.k_high95[0]))
    assert np.mean(hits, axis=0) == pytest.approx((0.6827, 0.95), abs=0.05)


def test_where_k_is_not_resolved_its_upper_bound_still_holds() -> None:
    draws, k = 4000, 1e-6
    rng = np.random.default_rng(3)
    nm = np.full(draws, 600.0)
    r, t = (value + rng.normal(0.0, 1e-3, draws) for value in forward(np.full(draws, 1.5), k, 25.0, nm))
    found = measured(nm, reading(t, 1e-3), reading(r, 1e-3), Length(25.0))
    unresolved = np.isin(found.k.why, (Reason.SMALL, Reason.NEGATIVE))
    assert unresolved.all()
    assert np.isnan(found.k.value[unresolved]).all()
    assert np.isfinite(found.k.u[unresolved]).all()
    # one-sided, with k ≥ 0 as all that is known before: never below 95 %
    assert np.mean(found.k_high95[unresolved] >= k) > 0.95
    assert (found.k_low95[unresolved] == 0.0).all()


def test_a_k_that_noise_alone_does_not_make_is_resolved() -> None:
    nm, u = np.linspace(500.0, 900.0, 400), 1e-3
    rng = np.random.default_rng(5)
    k = np.where(nm < 520.0, 2e-4, 1e-6)
    r, t = (value + rng.normal(0.0, u, nm.size) for value in forward(1.5, k, 25.0, nm))
    found = measured(nm, reading(t, u), reading(r, u), Length(25.0))
    assert found.k.known[nm < 520.0].all()
    assert found.k.known[nm > 520.0].mean() < 0.02


def test_more_light_than_went_in_is_reported_where_only_all_wavelengths_together_show_it() -> None:
    nm = np.linspace(500.0, 900.0, 200)
    rng = np.random.default_rng(6)
    r, t = (rng.normal(value, 2e-3, (5, nm.size)) for value in forward(1.5, 0.0, 25.0, nm))
    fine, bright = (measured(nm, reading(t + off), reading(r), Length(25.0)) for off in (0.0, 2e-3))
    assert not any("below 0" in text and "mean over all wavelengths" in text for text in fine.warnings)
    assert only(bright, "mean over all wavelengths")
    assert "below 0" in only(bright, "mean over all wavelengths")


def test_an_opaque_layer_has_a_lower_bound_of_k() -> None:
    k = 0.05
    r, t = forward(1.5, k, 25.0, [600.0])
    found = measured([600.0], reading(t, 1e-3), reading(r, 1e-3), Length(25.0))
    assert found.reason == (f"k: {Reason.DARK.words}",)
    assert found.n.value[0] == pytest.approx(1.5, abs=1e-9)
    assert 0.0 < found.k_low95[0] < k
    assert np.isnan(found.k_high95[0])


def test_light_that_never_came_through_is_masked() -> None:
    r, t = forward(1.5, 5.0, 25.0, [600.0])
    assert float(t[0]) == 0.0
    found = measured([600.0, 600.0], reading([0.0, 1e-310]), reading([float(r[0])] * 2), Length(25.0))
    assert found.reason == ("n, k: T is not above 0", "n, k: R does not exceed R_F: no light was transmitted")


def test_masks_tell_their_reason() -> None:
    r = [0.05, -0.001, 1.0, 0.20, np.nan, 0.05, 0.10, 0.0800]
    t = [0.90, 0.9000, 0.5, -0.1, 0.900, np.nan, 0.95, 0.9220]
    found = measured(np.full(8, 500.0), reading(t, 1e-3), reading(r, 1e-3), Length(25.0))
    assert found.reason == (
        None,
        "n, k: R is not between 0 and 1",
        "n, k: R is not between 0 and 1",
        "n, k: T is not above 0",
        "n, k: no number was measured here",
        "n, k: no number was measured here",
        "n, k: R + T exceeds 1 by more than three standard uncertainties",
        "k: not resolved: R + T exceeds 1, but within its uncertainty",
    )
    masked = ~found.n.known
    for values in (found.n.value, found.n.u, found.k.value, found.k.u, found.k_high95):
        assert np.isnan(values[masked]).all()
    assert "masked at 2 of 8 wavelengths: R is not between 0 and 1" in only(found, "not between 0 and 1")


def test_a_negative_discriminant_is_masked() -> None:
    found = measured([5000.0], reading([0.02]), reading([0.02]), Length(1.0))
    assert found.reason == ("n, k: no index fits: the expression under the square root in n is negative",)


def test_a_spectrum_that_makes_light_everywhere_is_masked_everywhere() -> None:
    r, t = clear()
    found = measured(NM, reading(t + 0.005, 1e-3), reading(r, 1e-3), H)
    assert set(found.n.why) == {Reason.ENERGY}


@pytest.mark.parametrize(("excess", "masked"), [(0.012, False), (0.014, True)])
def test_where_no_uncertainty_is_stated_that_of_usual_instruments_judges(excess: float, masked: bool) -> None:
    found = measured([500.0], reading([0.92 + excess]), reading([0.08]), Length(25.0))
    assert bool(found.n.why[0] == Reason.ENERGY) is masked


def test_two_indices_that_fit_are_reported() -> None:
    r, t = forward(0.95, 0.3, 2.0, [9000.0])
    found = measured([9000.0], reading(t), reading(r), Length(2.0))
    assert found.reason == ("n: two indices fit equally well, as happens inside strong absorption bands",)
    assert found.k.value[0] == pytest.approx(0.3, abs=1e-12)


def test_the_published_numbers_are_reproduced_and_labelled() -> None:
    found = as_published([450.0, 500.0, 860.0], reading([0.8473, 0.8685, 0.8889], 1e-3), Length(25.0))
    assert found.n.value.round(2).tolist() == [1.54, 1.49, 1.44]
    assert (found.mode, found.measurement) == ("as-published", False)
    assert found.warnings[0] == AS_PUBLISHED
    assert "not valid as a measurement" in AS_PUBLISHED
    assert np.isnan(found.n.u).all()
    assert np.isnan(found.k.value).all()
    assert found.reason == ("k: not measured: R was computed from T alone",) * 3
    # what the same transmittances would be of clear layers: nothing like it, and falling with the wavelength too
    assert found.lossless.value == pytest.approx(lossless_index([0.8473, 0.8685, 0.8889]))


def test_a_clear_layer_read_as_published_is_an_artefact() -> None:
    r, t = forward(1.5, 0.0, 25.0, [600.0])
    assert [float(t[0]), float(r[0])] == pytest.approx([0.92308, 0.07692], abs=5e-6)
    found = as_published([600.0], reading(t), Length(25.0))
    assert found.reflectance[0] == pytest.approx(0.04216, abs=5e-6)
    assert found.n.value[0] == pytest.approx(1.351, abs=5e-4)
    dark = as_published([600.0, 600.0], reading([0.13712, 0.13714]), Length(25.0))
    assert dark.n.why.tolist() == [Reason.REFLECTANCE, Reason.NONE]


def test_silicon_read_as_published_is_far_off() -> None:
    found = as_published([2400.0], reading([0.5333]), Length(500.0))
    assert found.n.value[0] == pytest.approx(2.197, abs=5e-4)
    assert found.lossless.value[0] == pytest.approx(3.461, abs=5e-3)


@pytest.mark.parametrize(("kind", "base"), [("log10", np.log(10.0)), ("ln", 1.0)])
def test_an_absorbance_is_no_absorptance(kind: str, base: float) -> None:
    rng = np.random.default_rng(1)
    _, t = forward(1.49, 1e-5, 25.0, NM)
    a = np.round(-np.log(t + rng.normal(0.0, 2e-4, NM.size)) / base, 4)
    assert is_absorbance(a, t, base)
    line = f"this A: it is an absorbance, −{kind} T, .* n\\(650 nm\\) = 1.5.*; measure R; or use --mode lossless"
    with pytest.raises(DataError, match=line):
        absorptance(NM, reading(t), reading(a), H)


def test_a_reflectance_that_was_made_of_the_transmittance_is_none() -> None:
    _, t = forward(1.49, 1e-5, 25.0, NM)
    made = np.round(1.0 - t + np.log10(t), 5)
    with pytest.raises(DataError, match="does not follow from this R: it is 1 − T \\+ log10 T"):
        measured(NM, reading(t), reading(made), H)


def test_an_absorptance_is_none_by_mistake() -> None:
    for k in (0.0, 1e-5, 1e-4, 1e-3):
        r, t = forward(1.49, k, 25.0, NM)
        assert not is_absorbance(1.0 - r - t, t)
        assert not is_absorbance(1.0 - r - t, t, 1.0)


def test_by_absorptance_a_layer_comes_back_and_the_error_of_t_counts_twice() -> None:
    r, t = forward(1.5, 1e-4, 25.0, NM)
    found = absorptance(NM, reading(t, 1e-3), reading(1.0 - r - t, 0.0), Length(25.0))
    assert np.abs(found.n.value - 1.5).max() < 1e-9
    assert np.abs(found.k.value - 1e-4).max() < 1e-12
    assert found.n.u[-1] == pytest.approx(0.0042, rel=0.06)
    both = measured(NM, reading(t, 1e-3), reading(r, 0.0), Length(25.0))
    assert both.n.u[-1] == pytest.approx(0.00031, rel=0.05)


def test_a_lossless_estimate_is_an_upper_bound() -> None:
    r, t = forward(1.5, 1e-5, 25.0, NM)
    assert r.size == t.size
    found = lossless(NM, reading(t, 1e-3))
    assert (found.n.value > 1.5).all()
    assert set(found.reason) == {"k: not measured: this route assumes k = 0"}
    assert "upper bound; if 0.1 % of the light is absorbed or scattered, n is too high by 0.004" in only(
        found, "lossless"
    )
    assert lossless(NM, reading(np.full(NM.shape, 1.004))).reason[0] == (
        "n, k: T is not below 1: no reflection remains to determine an index"
    )


def test_what_is_common_to_a_spectrum_is_kept_apart() -> None:
    r, t = clear(1.5)
    rng = np.random.default_rng(2)
    offsets = np.array([[0.003], [-0.002], [0.0], [-0.001]])
    ts, rs = t + offsets, r + rng.normal(0.0, 5e-4, (4, NM.size))
    found = measured(NM, reading(ts, 1e-4), reading(rs, 1e-4), Length(25.0))
    np.testing.assert_allclose(np.hypot(found.n.u_random, found.n.u_common), found.n.u, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt((found.n.common**2).sum(axis=0)), found.n.u_common, rtol=1e-12)
    by_offsets = 0.3125 * offsets.std(ddof=1) / 2.0
    assert np.median(found.n.u_common) == pytest.approx(np.hypot(by_offsets, 1e-4 * 3.925), rel=0.15)


def test_repeats_that_drift_are_reported_and_not_averaged_away() -> None:
    _, t = clear(1.5)
    rng = np.random.default_rng(4)
    still = t + rng.normal(0.0, 5e-4, (5, NM.size))
    assert reading(still).warnings == ()
    moving = reading(still + np.linspace(0.0, 2e-3, 5)[:, None], name="T")
    assert moving.warnings[0].startswith("the 5 repeats of T drift in one direction, on average from 0.92")
    assert moving.u_common[0, 0] == pytest.approx(np.linspace(0.0, 2e-3, 5).std(ddof=1), rel=0.1)
    back_and_forth = reading(still + np.array([[0.0], [2e-3], [0.0], [2e-3], [1e-3]]))
    assert back_and_forth.warnings == ()


def test_few_repeats_widen_the_uncertainty() -> None:
    assert student_t(0.682689492137086, np.array([1.0, 2.0, np.inf])) == pytest.approx([1.8373, 1.3213, 1.0], abs=1e-4)
    assert student_t(0.95, 4.0) == pytest.approx(2.7764, abs=1e-4)
    one = reading(np.array([[0.9, 0.9], [0.91, 0.92]]))
    assert one.u_random == pytest.approx([0.005, 0.01])
    assert one.df == 1.0


def test_nothing_uncertain_has_no_uncertainty() -> None:
    found = combined([], 3)
    assert found.u.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: Length(0.0), "thickness = '0 µm'; must be finite and above 0"),
        (lambda: Length(float("nan")), "thickness = 'nan µm'"),
        (lambda: Length(25.0, 30.0), "uncertainty of the thickness = '30 µm'; must be at least 0 and below"),
        (
            lambda: reading([0.9], 1.5, name="T"),
            "specified uncertainty of T = '1.5'; must be a fraction of at least 0 and below 1",
        ),
        (
            lambda: reading([0.9], -0.1, name="R"),
            "specified uncertainty of R = '0.1'; must be a fraction of at least 0",
        ),
    ],
)
def test_bad_numbers_are_refused(make: object, line: str) -> None:
    assert callable(make)
    with pytest.raises(DataError) as refusal:
        make()
    assert str(refusal.value).startswith(line)
