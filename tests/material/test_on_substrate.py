"""A layer on a substrate, backward: forth and back to rounding, derivatives, coverage, masks, and what T alone says."""

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


def measured(n: Any, k: Any, h_um: float = LAYER_UM, sheet: Substrate = PET, **way: Any) -> tuple[Any, Any]:
    return on_substrate(n, k, h_um, NM, Setup(sheet, **way))


@pytest.mark.parametrize("side", ["layer", "substrate"])
@pytest.mark.parametrize("baseline", ["substrate", "air"])
@pytest.mark.parametrize("baseline_r", ["substrate", "air"])
def test_forth_and_back_is_where_it_began(side: Side, baseline: Baseline, baseline_r: Baseline) -> None:
    way: Any = {"side": side, "baseline": baseline, "baseline_r": baseline_r}
    for n, k, h_um in ((RESIN, LOSSY, 25.0), (RESIN - 0.08, 1e-6, 200.0), (RESIN + 0.12, 1e-4, 50.0), (1.4, 0.0, 25.0)):
        found = invert_on_substrate(*measured(n, k, h_um, **way), NM, h_um, Setup(PET, **way))
        assert found.n == pytest.approx(np.broadcast_to(n, NM.shape), abs=1e-13)
        assert found.k == pytest.approx(np.broadcast_to(k, NM.shape), abs=1e-15)


def test_the_other_index_fits_the_same_readings() -> None:
    t, r = measured(RESIN, LOSSY)
    found = invert_on_substrate(t, r, NM, LAYER_UM, Setup(PET))
    assert ((found.other_n > 1.03) & (found.other_n < 1.12)).all()
    again = invert_on_substrate(t, r, NM, LAYER_UM, Setup(PET, near=1.05))
    assert again.n == pytest.approx(found.other_n, abs=1e-12)
    assert again.other_n == pytest.approx(found.n, abs=1e-12)
    assert np.asarray(measured(again.n, again.k)) == pytest.approx(np.array([t, r]), abs=1e-12)


@pytest.mark.parametrize("side", ["layer", "substrate"])
@pytest.mark.parametrize("what", ["T", "R", "sheet_n", "sheet_k", "sheet_um", "thickness_um"])
def test_derivatives_are_those_of_moved_readings(side: Side, what: str) -> None:
    """Central differences of the whole inversion; they err by some 1e-6 of a derivative, or by rounding over a step."""
    t, r = measured(RESIN, LOSSY, side=side)
    step = {"T": 1e-5, "R": 1e-5, "sheet_n": 1e-5, "sheet_k": 1e-8, "sheet_um": 1e-3, "thickness_um": 1e-3}[what]

    def moved(by: float) -> Any:
        d = {what: by}
        sheet_n, sheet_k = np.asarray(PET.n) + d.get("sheet_n", 0.0), 1.4e-6 + d.get("sheet_k", 0.0)
        sheet = Substrate(sheet_n, sheet_k, 100.0 + d.get("sheet_um", 0.0))
        h = LAYER_UM + d.get("thickness_um", 0.0)
        return invert_on_substrate(t + d.get("T", 0.0), r + d.get("R", 0.0), NM, h, Setup(sheet, side=side))

    found, up, down = invert_on_substrate(t, r, NM, LAYER_UM, Setup(PET, side=side)), moved(step), moved(-step)
    assert found.n_by[what] == pytest.approx((up.n - down.n) / (2 * step), rel=1e-5, abs=1e-9)
    assert found.k_by[what] == pytest.approx((up.k - down.k) / (2 * step), rel=1e-5, abs=1e-12)


def test_an_error_of_the_substrate_is_one_of_the_layer() -> None:
    """What the page on routes tells of a resin near 1.48 on PET at 600 nm."""
    i = int(np.argmin(abs(NM - 600)))
    found = invert_on_substrate(*measured(RESIN, LOSSY), NM, LAYER_UM, Setup(PET))
    assert found.n_by["sheet_n"][i] == pytest.approx(-1.15, abs=0.05)
    assert found.n_by["R"][i] == pytest.approx(9.1, abs=0.3)
    assert found.n_by["T"][i] == pytest.approx(-0.8, abs=0.05)
    alone = invert_lossless(measured(RESIN, 0.0)[0], NM, Setup(PET))
    assert alone.n_by["T"][i] == pytest.approx(-9.0, abs=0.3)
    assert alone.n_by["sheet_n"][i] == pytest.approx(1.09, abs=0.05)


@pytest.mark.parametrize("side", ["layer", "substrate"])
def test_the_stated_uncertainty_covers_the_truth(side: Side) -> None:
    """1,000 measurements at one wavelength, each with its own errors of T, R, both thicknesses and the substrate.

    95 % intervals cover 95 ± 2 %: three times √(0.05·0.95/1000) = 0.7 %; u(n) ends at 0.02, small enough for linear
    propagation beside a second index 0.4 away.
    """
    draws, rng = 1000, np.random.default_rng(11)
    noise, u_sheet, u_h = 1e-3, 0.01, 0.5
    nm, n, k = np.full(draws, 600.0), 1.49, 1e-4
    sheet_n, h = 1.57 + u_sheet * rng.standard_normal(draws), 25 + u_h * rng.standard_normal(draws)
    true = on_substrate(n, k, h, nm, Setup(Substrate(sheet_n, 1.4e-6, 100.0), side=side))
    t, r = (reading(read + noise * rng.standard_normal(draws), noise) for read in true)
    setup = Setup(Substrate(1.57, 1.4e-6, 100.0, u_n=u_sheet), side)
    found = measured_route(nm, t, r, Length(25.0, u_h), setup)
    assert found.n.known.all()
    for one, truth in ((found.n, n), (found.k, k)):
        assert np.mean(abs(one.value - truth) < one.u95) == pytest.approx(0.95, abs=0.02)


def told(t: Any, r: Any, sheet: Substrate = PET, u: float | None = None, nm: Any = NM, **way: Any) -> IndexSpectrum:
    t, r = (reading(np.broadcast_to(np.asarray(read, dtype=float), np.shape(nm)), u) for read in (t, r))
    return measured_route(nm, t, r, Length(LAYER_UM), Setup(sheet, **way))


def test_what_all_wavelengths_share_is_kept_apart() -> None:
    sheet = Substrate(PET.n, PET.k, 100.0, u_n=0.02, u_k=1e-6, u_thickness_um=2.0)
    t, r = measured(RESIN, 1e-4)
    noise = np.full(NM.shape, 1e-3)
    read_t, read_r = (Reading(read, noise, np.stack([0 * noise, 2 * noise])) for read in (t, r))
    found = measured_route(NM, read_t, read_r, Length(LAYER_UM, 1.0), Setup(sheet))
    plain = invert_on_substrate(t, r, NM, LAYER_UM, Setup(sheet))
    own = 1e-3 * np.hypot(plain.n_by["T"], plain.n_by["R"])
    assert found.n.u_random == pytest.approx(own, rel=1e-9)
    shared = [2 * own, *(plain.n_by[what] * u for what, u in (("sheet_n", 0.02), ("sheet_k", 1e-6), ("sheet_um", 2.0)))]
    shared.append(plain.n_by["thickness_um"])
    assert found.n.u_common**2 == pytest.approx(sum(one**2 for one in shared), rel=1e-9)
    assert found.n.u**2 == pytest.approx(own**2 + found.n.u_common**2, rel=1e-9)
    assert (abs(found.correlation) <= 1).all()
    assert not any("assumed exact" in line for line in found.warnings)
    assert any("assumed exact" in line for line in told(t, r).warnings)
    assert any("specify it with --u-T and --u-R" in line for line in told(t, r).warnings)


def one(t: float, r: float, sheet: Substrate = FLAT, u: float | None = None) -> IndexSpectrum:
    return told(t, r, sheet, u, np.array([600.0]))


def test_what_cannot_be_known_is_masked_with_its_reason() -> None:
    t, r = (float(read) for read in on_substrate(1.49, 0.0, LAYER_UM, 600.0, Setup(FLAT)))
    least = float(on_substrate(1.253, 0.0, LAYER_UM, 600.0, Setup(FLAT)).R)
    for found, why in (
        (one(np.nan, r), Reason.MISSING),
        (one(-0.01, r), Reason.TRANSMITTANCE),
        (one(t, 0.0), Reason.REFLECTANCE),
        (one(1.0243, least - 1e-3), Reason.NO_FIT),
        (one(t + 0.01, r, FLAT, 1e-3), Reason.BRIGHT),
        (one(1.0165, least + 3e-4, FLAT, 1e-3), Reason.INDISTINCT),
    ):
        assert (found.n.why[0], found.k.why[0]) == (why, why)
        assert np.isnan([found.n.value[0], found.n.u[0], found.k.value[0], found.k.u[0]]).all()
        assert any("n is masked at 1 of 1 wavelengths" in line for line in found.warnings)
        assert found.reason[0] is not None


def test_a_k_below_its_uncertainty_is_not_resolved_and_n_stays() -> None:
    t, r = (float(read) for read in on_substrate(1.49, 1e-7, LAYER_UM, 600.0, Setup(FLAT)))
    found = one(t, r, FLAT, 1e-3)
    assert found.n.value[0] == pytest.approx(1.49, abs=1e-12)
    assert found.k.why[0] == Reason.SMALL
    assert np.isnan(found.k.value[0])
    assert found.k.u[0] > 1e-6
    assert found.k_low95[0] == 0
    assert found.k_high95[0] > found.k.u[0]
    brighter = one(t + 1e-3, r, FLAT, 1e-3)  # more light out than in, within the noise
    assert brighter.n.known[0]
    assert brighter.k.why[0] == Reason.BELOW


def test_reflecting_more_than_the_bare_sheet_is_no_reason_to_mask() -> None:
    t, r = measured(RESIN + 0.15, 1e-5, baseline_r="substrate")
    assert (r > 1).any()
    assert told(t, r, baseline_r="substrate").n.value == pytest.approx(RESIN + 0.15, abs=1e-13)


def test_gaps_do_not_reach_their_neighbours() -> None:
    t, r = (np.array(read) for read in measured(RESIN, LOSSY))
    t[7], r[50] = np.nan, np.nan
    found = told(t, r)
    gaps = np.zeros(NM.shape, dtype=bool)
    gaps[[7, 50]] = True
    assert np.array_equal(np.isnan(found.n.value), gaps)
    assert found.n.value[~gaps] == pytest.approx(RESIN[~gaps], abs=1e-13)


def test_a_long_spectrum_is_inverted_in_blocks_to_the_same_numbers() -> None:
    t, r = (np.tile(read, 50) for read in measured(RESIN, LOSSY))
    sheet, nm = Substrate(np.tile(PET.n, 50), PET.k, 100.0), np.tile(NM, 50)
    assert invert_on_substrate(t, r, nm, LAYER_UM, Setup(sheet)).n == pytest.approx(np.tile(RESIN, 50), abs=1e-13)
    clear = np.tile(measured(RESIN, 0.0)[0], 50)
    assert invert_lossless(clear, nm, Setup(sheet)).n == pytest.approx(np.tile(RESIN, 50), abs=1e-12)
    assert max_transmittance(nm, Setup(sheet)).shape == nm.shape


@pytest.mark.parametrize("baseline", ["substrate", "air"])
def test_a_lossless_layer_is_determined_by_t_alone(baseline: Baseline) -> None:
    setup = Setup(PET, baseline=baseline)
    t = on_substrate(RESIN, 0.0, LAYER_UM, NM, setup).T
    found = invert_lossless(t, NM, setup)
    assert found.n == pytest.approx(RESIN, abs=1e-12)
    assert pytest.approx(t, abs=1e-12) == on_substrate(found.other_n, 0.0, LAYER_UM, NM, setup).T
    spectrum = lossless_route(NM, reading(t, 1e-4), setup)
    assert spectrum.mode == "lossless"
    assert spectrum.n.value == pytest.approx(RESIN, abs=1e-12)
    assert spectrum.n.u == pytest.approx(abs(found.n_by["T"]) * 1e-4, rel=1e-9)
    assert (spectrum.k.why == Reason.ASSUMED).all()
    both = told(*on_substrate(RESIN, 0.0, LAYER_UM, NM, Setup(PET, baseline=baseline)), baseline=baseline)
    assert both.lossless.value == pytest.approx(RESIN, abs=1e-12)


def test_any_loss_makes_the_lossless_index_an_upper_bound() -> None:
    t = measured(RESIN, 2e-5)[0]
    found = invert_lossless(t, NM, Setup(PET))
    assert (found.n > RESIN).all()
    assert (found.other_n < RESIN)[~np.isnan(found.other_n)].all()


def test_what_t_alone_cannot_tell_is_masked_with_its_reason() -> None:
    found = lossless_route(np.full(5, 600.0), reading([np.nan, 0.0, 1.03, 0.6, 1.0243], 1e-3), Setup(FLAT))
    reasons = [Reason.MISSING, Reason.TRANSMITTANCE, Reason.TOO_CLEAR, Reason.TOO_DARK, Reason.INDISTINCT]
    assert found.n.why.tolist() == reasons
    assert np.isnan(found.n.value).all()
    assert max_transmittance([600.0], Setup(FLAT))[0] == pytest.approx(1.0243, abs=1e-4)


def test_a_known_index_leaves_t_to_tell_k() -> None:
    t = measured(RESIN, LOSSY)[0]
    found = extinction(t, RESIN, NM, LAYER_UM, Setup(PET))
    assert found.k == pytest.approx(LOSSY, abs=1e-16)
    for what, step in (("n", 1e-6), ("thickness_um", 1e-3)):
        d = {what: step}
        up, down = (
            extinction(t, RESIN + s * d.get("n", 0.0), NM, LAYER_UM + s * d.get("thickness_um", 0.0), Setup(PET)).k
            for s in (1, -1)
        )
        assert found.k_by[what] == pytest.approx((up - down) / (2 * step), rel=1e-5)
    sheet = Substrate(PET.n, PET.k, 100.0, u_n=0.02)
    wide = extinction_on_substrate(NM, reading(t, 1e-3), RESIN, Length(LAYER_UM, 1.0), Setup(sheet), u_n=0.005)
    parts = [found.k_by["T"] * 1e-3, found.k_by["n"] * 0.005, found.k_by["sheet_n"] * 0.02, found.k_by["thickness_um"]]
    assert wide.u == pytest.approx(np.sqrt(sum(part**2 for part in parts)), rel=1e-9)
    blind = extinction_on_substrate(
        np.full(4, 600.0), reading([0.0, np.nan, 1.0, 1.2], 1e-2), 1.5, Length(LAYER_UM), Setup(FLAT)
    )
    assert blind.why.tolist() == [Reason.TRANSMITTANCE, Reason.MISSING, Reason.SMALL, Reason.BRIGHT]


def test_readings_of_the_paper_against_pet_are_no_clear_layer() -> None:
    """T of 0.8889 at 860 nm against the sheet: no clear layer reads so little, one with a heavy loss does."""
    sheet = Substrate(1.554, 1e-6, 100.0, u_n=0.03)
    alone = invert_lossless([0.8889], [860.0], Setup(sheet))
    assert np.isnan(alone.n[0]) or alone.n[0] > 2.0
    loss = extinction([0.8889], [1.48], [860.0], LAYER_UM, Setup(sheet))
    per_mm = 4 * np.pi * loss.k[0] / 860e-6
    assert per_mm == pytest.approx(5.1, abs=0.3)  # base e: 22 dB/mm, and no guide of centimetres


@pytest.mark.parametrize(("nm", "um", "line"), [(0.0, 25.0, "wavelength = 0.0"), (600.0, -1.0, "thickness = -1.0")])
def test_what_is_no_measurement_is_refused(nm: float, um: float, line: str) -> None:
    with pytest.raises(DataError, match=line):
        invert_on_substrate([1.0], [0.1], [nm], um, Setup(FLAT))
    with pytest.raises(DataError, match="must each be a single row"):
        invert_on_substrate([[1.0]], [[0.1]], [[600.0]], 25.0, Setup(FLAT))
