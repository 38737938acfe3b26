"""Index of a layer on a substrate: inversion to rounding, derivatives, coverage, masks, and the routes from T alone."""

from typing import Any

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.index.masks import Reason
from solen.material.index.reading import Length, Reading, reading
from solen.material.index.routes import extinction_on_substrate
from solen.material.index.routes import lossless as lossless_route
from solen.material.index.routes import measured as measured_route
from solen.material.index.spectrum import IndexSpectrum
from solen.material.index.stack import Baseline, Setup, Side, Substrate, on_substrate
from solen.material.index.substrate import extinction, invert_lossless, invert_on_substrate, max_transmittance

NM = np.linspace(400.0, 900.0, 101)
UM2 = (NM * 1e-3) ** 2
PET = Substrate(1.54 + 0.0103 / UM2, 1.4e-6, 100.0)
FLAT = Substrate(1.57, 1.4e-6, 100.0)
RESIN = 1.47 + 0.0052 / UM2
LOSSY = 2e-5 * (400 / NM) ** 4  # an absorption tail
LAYER_UM = 25.0


def readings(n: Any, k: Any, h_um: float = LAYER_UM, sheet: Substrate = PET, **setup: Any) -> tuple[Any, Any]:
    return on_substrate(n, k, h_um, NM, Setup(sheet, **setup))


@pytest.mark.parametrize("side", ["layer", "substrate"])
@pytest.mark.parametrize("baseline", ["substrate", "air"])
@pytest.mark.parametrize("baseline_r", ["substrate", "air"])
def test_inversion_recovers_the_index(side: Side, baseline: Baseline, baseline_r: Baseline) -> None:
    setup: Any = {"side": side, "baseline": baseline, "baseline_r": baseline_r}
    for n, k, h_um in ((RESIN, LOSSY, 25.0), (RESIN - 0.08, 1e-6, 200.0), (RESIN + 0.12, 1e-4, 50.0), (1.4, 0.0, 25.0)):
        inverted = invert_on_substrate(*readings(n, k, h_um, **setup), NM, h_um, Setup(PET, **setup))
        assert inverted.n == pytest.approx(np.broadcast_to(n, NM.shape), abs=1e-13)
        assert inverted.k == pytest.approx(np.broadcast_to(k, NM.shape), abs=1e-15)


def test_the_other_index_yields_the_same_readings() -> None:
    t, r = readings(RESIN, LOSSY)
    result = invert_on_substrate(t, r, NM, LAYER_UM, Setup(PET))
    assert ((result.other_n > 1.03) & (result.other_n < 1.12)).all()
    again = invert_on_substrate(t, r, NM, LAYER_UM, Setup(PET, near=1.05))
    assert again.n == pytest.approx(result.other_n, abs=1e-12)
    assert again.other_n == pytest.approx(result.n, abs=1e-12)
    assert np.asarray(readings(again.n, again.k)) == pytest.approx(np.array([t, r]), abs=1e-12)


@pytest.mark.parametrize("side", ["layer", "substrate"])
@pytest.mark.parametrize("quantity", ["T", "R", "sheet_n", "sheet_k", "sheet_um", "thickness_um"])
def test_derivatives_equal_finite_differences(side: Side, quantity: str) -> None:
    """Central differences of the inversion: their relative error is about 1e-6, or rounding divided by the step."""
    t, r = readings(RESIN, LOSSY, side=side)
    step = {"T": 1e-5, "R": 1e-5, "sheet_n": 1e-5, "sheet_k": 1e-8, "sheet_um": 1e-3, "thickness_um": 1e-3}[quantity]

    def shifted(change: float) -> Any:
        d = {quantity: change}
        sheet_n, sheet_k = np.asarray(PET.n) + d.get("sheet_n", 0.0), 1.4e-6 + d.get("sheet_k", 0.0)
        sheet = Substrate(sheet_n, sheet_k, 100.0 + d.get("sheet_um", 0.0))
        h = LAYER_UM + d.get("thickness_um", 0.0)
        return invert_on_substrate(t + d.get("T", 0.0), r + d.get("R", 0.0), NM, h, Setup(sheet, side=side))

    inverted, up, down = invert_on_substrate(t, r, NM, LAYER_UM, Setup(PET, side=side)), shifted(step), shifted(-step)
    assert inverted.n_by[quantity] == pytest.approx((up.n - down.n) / (2 * step), rel=1e-5, abs=1e-9)
    assert inverted.k_by[quantity] == pytest.approx((up.k - down.k) / (2 * step), rel=1e-5, abs=1e-12)


def test_an_index_error_of_the_substrate_propagates_to_the_layer() -> None:
    """The values that docs/index-routes.md gives for a resin near 1.48 on PET at 600 nm."""
    i = int(np.argmin(abs(NM - 600)))
    result = invert_on_substrate(*readings(RESIN, LOSSY), NM, LAYER_UM, Setup(PET))
    assert result.n_by["sheet_n"][i] == pytest.approx(-1.15, abs=0.05)
    assert result.n_by["R"][i] == pytest.approx(9.1, abs=0.3)
    assert result.n_by["T"][i] == pytest.approx(-0.8, abs=0.05)
    lossless = invert_lossless(readings(RESIN, 0.0)[0], NM, Setup(PET))
    assert lossless.n_by["T"][i] == pytest.approx(-9.0, abs=0.3)
    assert lossless.n_by["sheet_n"][i] == pytest.approx(1.09, abs=0.05)


@pytest.mark.parametrize("side", ["layer", "substrate"])
def test_the_stated_uncertainty_covers_the_true_index(side: Side) -> None:
    """1,000 measurements at one wavelength with independent errors of T, R, the thickness and the substrate's index.

    95 % intervals cover 95 ± 2 %, three times √(0.05·0.95/1000) = 0.7 %. u(n) is 0.02, small enough for linear
    propagation although a second index, which fits equally well, is 0.4 away.
    """
    draws, rng = 1000, np.random.default_rng(11)
    noise, u_sheet, u_h = 1e-3, 0.01, 0.5
    nm, n, k = np.full(draws, 600.0), 1.49, 1e-4
    sheet_n, h = 1.57 + u_sheet * rng.standard_normal(draws), 25 + u_h * rng.standard_normal(draws)
    true = on_substrate(n, k, h, nm, Setup(Substrate(sheet_n, 1.4e-6, 100.0), side=side))
    t, r = (reading(read + noise * rng.standard_normal(draws), noise) for read in true)
    setup = Setup(Substrate(1.57, 1.4e-6, 100.0, u_n=u_sheet), side)
    result = measured_route(nm, t, r, Length(25.0, u_h), setup)
    assert result.n.known.all()
    for estimate, truth in ((result.n, n), (result.k, k)):
        assert np.mean(abs(estimate.value - truth) < estimate.u95) == pytest.approx(0.95, abs=0.02)


def evaluated(
    t: Any, r: Any, sheet: Substrate = PET, u: float | None = None, nm: Any = NM, **setup: Any
) -> IndexSpectrum:
    t, r = (reading(np.broadcast_to(np.asarray(read, dtype=float), np.shape(nm)), u) for read in (t, r))
    return measured_route(nm, t, r, Length(LAYER_UM), Setup(sheet, **setup))


def test_common_errors_are_separated_from_random_ones() -> None:
    sheet = Substrate(PET.n, PET.k, 100.0, u_n=0.02, u_k=1e-6, u_thickness_um=2.0)
    t, r = readings(RESIN, 1e-4)
    noise = np.full(NM.shape, 1e-3)
    read_t, read_r = (Reading(read, noise, np.stack([0 * noise, 2 * noise])) for read in (t, r))
    result = measured_route(NM, read_t, read_r, Length(LAYER_UM, 1.0), Setup(sheet))
    inverted = invert_on_substrate(t, r, NM, LAYER_UM, Setup(sheet))
    u_random = 1e-3 * np.hypot(inverted.n_by["T"], inverted.n_by["R"])
    assert result.n.u_random == pytest.approx(u_random, rel=1e-9)
    uncertainties = {"sheet_n": 0.02, "sheet_k": 1e-6, "sheet_um": 2.0, "thickness_um": 1.0}
    common = [2 * u_random, *(inverted.n_by[name] * u for name, u in uncertainties.items())]
    assert result.n.u_common**2 == pytest.approx(sum(part**2 for part in common), rel=1e-9)
    assert result.n.u**2 == pytest.approx(u_random**2 + result.n.u_common**2, rel=1e-9)
    assert (abs(result.correlation) <= 1).all()
    assert not any("assumed to be exact" in line for line in result.warnings)
    assert any("assumed to be exact" in line for line in evaluated(t, r).warnings)
    assert any("specify it with --u-T and --u-R" in line for line in evaluated(t, r).warnings)


def at_one_wavelength(t: float, r: float, u: float | None = None) -> IndexSpectrum:
    return evaluated(t, r, FLAT, u, np.array([600.0]))


def test_undetermined_indices_are_masked_with_their_reason() -> None:
    t, r = (float(read) for read in on_substrate(1.49, 0.0, LAYER_UM, 600.0, Setup(FLAT)))
    min_r = float(on_substrate(1.253, 0.0, LAYER_UM, 600.0, Setup(FLAT)).R)
    for result, reason in (
        (at_one_wavelength(np.nan, r), Reason.MISSING),
        (at_one_wavelength(-0.01, r), Reason.TRANSMITTANCE),
        (at_one_wavelength(t, 0.0), Reason.REFLECTANCE),
        (at_one_wavelength(1.0243, min_r - 1e-3), Reason.NO_FIT),
        (at_one_wavelength(t + 0.01, r, 1e-3), Reason.BRIGHT),
        (at_one_wavelength(1.0165, min_r + 3e-4, 1e-3), Reason.INDISTINCT),
    ):
        assert (result.n.codes[0], result.k.codes[0]) == (reason, reason)
        assert np.isnan([result.n.value[0], result.n.u[0], result.k.value[0], result.k.u[0]]).all()
        assert any("n is masked at 1 of 1 wavelengths" in line for line in result.warnings)
        assert result.reason[0] is not None


def test_a_k_below_its_uncertainty_is_masked_but_n_is_not() -> None:
    t, r = (float(read) for read in on_substrate(1.49, 1e-7, LAYER_UM, 600.0, Setup(FLAT)))
    result = at_one_wavelength(t, r, 1e-3)
    assert result.n.value[0] == pytest.approx(1.49, abs=1e-12)
    assert result.k.codes[0] == Reason.SMALL
    assert np.isnan(result.k.value[0])
    assert result.k.u[0] > 1e-6
    assert result.k_low95[0] == 0
    assert result.k_high95[0] > result.k.u[0]
    brighter = at_one_wavelength(t + 1e-3, r, 1e-3)  # T + R above 1, within the noise
    assert brighter.n.known[0]
    assert brighter.k.codes[0] == Reason.BELOW


def test_a_reflectance_above_that_of_the_bare_sheet_is_not_masked() -> None:
    t, r = readings(RESIN + 0.15, 1e-5, baseline_r="substrate")
    assert (r > 1).any()
    assert evaluated(t, r, baseline_r="substrate").n.value == pytest.approx(RESIN + 0.15, abs=1e-13)


def test_gaps_do_not_affect_neighbouring_wavelengths() -> None:
    t, r = (np.array(read) for read in readings(RESIN, LOSSY))
    t[7], r[50] = np.nan, np.nan
    result = evaluated(t, r)
    gaps = np.zeros(NM.shape, dtype=bool)
    gaps[[7, 50]] = True
    assert np.array_equal(np.isnan(result.n.value), gaps)
    assert result.n.value[~gaps] == pytest.approx(RESIN[~gaps], abs=1e-13)


def test_a_long_spectrum_is_inverted_in_blocks_to_the_same_values() -> None:
    t, r = (np.tile(read, 50) for read in readings(RESIN, LOSSY))
    sheet, nm = Substrate(np.tile(PET.n, 50), PET.k, 100.0), np.tile(NM, 50)
    assert invert_on_substrate(t, r, nm, LAYER_UM, Setup(sheet)).n == pytest.approx(np.tile(RESIN, 50), abs=1e-13)
    clear = np.tile(readings(RESIN, 0.0)[0], 50)
    assert invert_lossless(clear, nm, Setup(sheet)).n == pytest.approx(np.tile(RESIN, 50), abs=1e-12)
    assert max_transmittance(nm, Setup(sheet)).shape == nm.shape


@pytest.mark.parametrize("baseline", ["substrate", "air"])
def test_t_alone_determines_the_index_of_a_lossless_layer(baseline: Baseline) -> None:
    setup = Setup(PET, baseline=baseline)
    t = on_substrate(RESIN, 0.0, LAYER_UM, NM, setup).T
    result = invert_lossless(t, NM, setup)
    assert result.n == pytest.approx(RESIN, abs=1e-12)
    assert pytest.approx(t, abs=1e-12) == on_substrate(result.other_n, 0.0, LAYER_UM, NM, setup).T
    spectrum = lossless_route(NM, reading(t, 1e-4), setup)
    assert spectrum.mode == "lossless"
    assert spectrum.n.value == pytest.approx(RESIN, abs=1e-12)
    assert spectrum.n.u == pytest.approx(abs(result.n_by["T"]) * 1e-4, rel=1e-9)
    assert (spectrum.k.codes == Reason.ASSUMED).all()
    both = evaluated(*on_substrate(RESIN, 0.0, LAYER_UM, NM, Setup(PET, baseline=baseline)), baseline=baseline)
    assert both.lossless.value == pytest.approx(RESIN, abs=1e-12)


def test_with_loss_the_lossless_index_is_an_upper_bound() -> None:
    t = readings(RESIN, 2e-5)[0]
    result = invert_lossless(t, NM, Setup(PET))
    assert (result.n > RESIN).all()
    assert (result.other_n < RESIN)[~np.isnan(result.other_n)].all()


def test_indices_that_t_alone_cannot_determine_are_masked_with_their_reason() -> None:
    result = lossless_route(np.full(5, 600.0), reading([np.nan, 0.0, 1.03, 0.6, 1.0243], 1e-3), Setup(FLAT))
    reasons = [Reason.MISSING, Reason.TRANSMITTANCE, Reason.TOO_CLEAR, Reason.TOO_DARK, Reason.INDISTINCT]
    assert result.n.codes.tolist() == reasons
    assert np.isnan(result.n.value).all()
    assert max_transmittance([600.0], Setup(FLAT))[0] == pytest.approx(1.0243, abs=1e-4)


def test_with_a_known_index_t_determines_k() -> None:
    t = readings(RESIN, LOSSY)[0]
    result = extinction(t, RESIN, NM, LAYER_UM, Setup(PET))
    assert result.k == pytest.approx(LOSSY, abs=1e-16)
    for quantity, step in (("n", 1e-6), ("thickness_um", 1e-3)):
        d = {quantity: step}
        up, down = (
            extinction(t, RESIN + s * d.get("n", 0.0), NM, LAYER_UM + s * d.get("thickness_um", 0.0), Setup(PET)).k
            for s in (1, -1)
        )
        assert result.k_by[quantity] == pytest.approx((up - down) / (2 * step), rel=1e-5)
    sheet = Substrate(PET.n, PET.k, 100.0, u_n=0.02)
    with_u = extinction_on_substrate(NM, reading(t, 1e-3), RESIN, Length(LAYER_UM, 1.0), Setup(sheet), u_n=0.005)
    parts = [
        result.k_by["T"] * 1e-3,
        result.k_by["n"] * 0.005,
        result.k_by["sheet_n"] * 0.02,
        result.k_by["thickness_um"],
    ]
    assert with_u.u == pytest.approx(np.sqrt(sum(part**2 for part in parts)), rel=1e-9)
    masked = extinction_on_substrate(
        np.full(4, 600.0), reading([0.0, np.nan, 1.0, 1.2], 1e-2), 1.5, Length(LAYER_UM), Setup(FLAT)
    )
    assert masked.codes.tolist() == [Reason.TRANSMITTANCE, Reason.MISSING, Reason.SMALL, Reason.BRIGHT]


def test_readings_of_the_paper_relative_to_pet_require_a_loss() -> None:
    """No clear layer has T = 0.8889 relative to the sheet at 860 nm, but one with a high loss does."""
    sheet = Substrate(1.554, 1e-6, 100.0, u_n=0.03)
    lossless = invert_lossless([0.8889], [860.0], Setup(sheet))
    assert np.isnan(lossless.n[0]) or lossless.n[0] > 2.0
    loss = extinction([0.8889], [1.48], [860.0], LAYER_UM, Setup(sheet))
    per_mm = 4 * np.pi * loss.k[0] / 860e-6
    assert per_mm == pytest.approx(5.1, abs=0.3)  # base e, 22 dB/mm: impossible for a guide of centimetres


@pytest.mark.parametrize(("nm", "um", "line"), [(0.0, 25.0, "wavelength = 0.0"), (600.0, -1.0, "thickness = -1.0")])
def test_refuses_invalid_wavelength_thickness_and_shape(nm: float, um: float, line: str) -> None:
    with pytest.raises(DataError, match=line):
        invert_on_substrate([1.0], [0.1], [nm], um, Setup(FLAT))
    with pytest.raises(DataError, match="must be one-dimensional"):
        invert_on_substrate([[1.0]], [[0.1]], [[600.0]], 25.0, Setup(FLAT))
