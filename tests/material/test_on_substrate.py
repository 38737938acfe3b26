"""A layer on a substrate, backward: forth and back to rounding, derivatives, coverage, masks, and what T alone says."""

from typing import Any

import numpy as np
import pytest

from solen.errors import DataError
from solen.material.index.case import Errors
from solen.material.index.stack import Baseline, Side, Substrate, on_substrate
from solen.material.index.substrate import OnSubstrate, invert
from solen.material.index.transmittance import extinction, lossless

NM = np.linspace(400.0, 900.0, 101)
UM2 = (NM * 1e-3) ** 2
PET = Substrate(1.54 + 0.0103 / UM2, 1.4e-6, 100.0)
RESIN = 1.47 + 0.0052 / UM2
LOSSY = 2e-5 * (400 / NM) ** 4  # an absorption tail
LAYER_UM = 25.0


def measured(n: Any, k: Any, h_um: float = LAYER_UM, sheet: Substrate = PET, **way: Any) -> tuple[Any, Any]:
    return on_substrate(n, k, h_um, NM, sheet, **way)


@pytest.mark.parametrize("side", ["layer", "substrate"])
@pytest.mark.parametrize("baseline", ["substrate", "air"])
@pytest.mark.parametrize("baseline_r", ["substrate", "air"])
def test_forth_and_back_is_where_it_began(side: Side, baseline: Baseline, baseline_r: Baseline) -> None:
    way: Any = {"side": side, "baseline": baseline, "baseline_r": baseline_r}
    for n, k, h_um in ((RESIN, LOSSY, 25.0), (RESIN - 0.08, 1e-6, 200.0), (RESIN + 0.12, 1e-4, 50.0), (1.4, 0.0, 25.0)):
        found = invert(*measured(n, k, h_um, **way), NM, h_um, PET, **way)
        assert found.n == pytest.approx(np.broadcast_to(n, NM.shape), abs=1e-13)
        # k of 1e-17 and below its truth of 0 is masked as not resolved: nothing is clipped
        told = ~np.isnan(found.k)
        assert found.k[told] == pytest.approx(np.broadcast_to(k, NM.shape)[told], abs=1e-15)
        assert told.all() or np.all(k == 0)


def test_the_other_index_fits_the_same_readings() -> None:
    t, r = measured(RESIN, LOSSY)
    found = invert(t, r, NM, LAYER_UM, PET)
    assert ((found.other_n > 1.03) & (found.other_n < 1.12)).all()
    again = invert(t, r, NM, LAYER_UM, PET, near=1.05)
    assert again.n == pytest.approx(found.other_n, abs=1e-12)
    assert again.other_n == pytest.approx(found.n, abs=1e-12)
    assert np.asarray(measured(again.n, again.k)) == pytest.approx(np.array([t, r]), abs=1e-12)


def test_derivatives_are_those_of_moved_readings() -> None:
    """Central differences of the whole inversion; their own error is of the order 1e-7."""
    t, r = measured(RESIN, LOSSY)
    step = 1e-5

    def n_of(dt: float = 0.0, dr: float = 0.0, sheet: Substrate = PET) -> Any:
        return invert(t + dt, r + dr, NM, LAYER_UM, sheet).n

    found = invert(t, r, NM, LAYER_UM, PET)
    assert found.n_by_t == pytest.approx((n_of(dt=step) - n_of(dt=-step)) / (2 * step), rel=1e-6)
    assert found.n_by_r == pytest.approx((n_of(dr=step) - n_of(dr=-step)) / (2 * step), rel=1e-6)
    up, down = (Substrate(np.asarray(PET.n) + s, PET.k, 100.0) for s in (step, -step))
    moved = (n_of(sheet=up) - n_of(sheet=down)) / (2 * step)
    assert found.n_by_substrate == pytest.approx(moved, rel=1e-6)


def test_an_error_of_the_substrate_is_one_of_the_layer() -> None:
    """What the docs tell of a resin near 1.48 on PET at 600 nm."""
    i = int(np.argmin(abs(NM - 600)))
    found = invert(*measured(RESIN, LOSSY), NM, LAYER_UM, PET)
    assert found.n_by_substrate[i] == pytest.approx(-1.15, abs=0.05)
    assert found.n_by_r[i] == pytest.approx(9.1, abs=0.3)
    assert found.n_by_t[i] == pytest.approx(-0.8, abs=0.05)
    alone = lossless(measured(RESIN, 0.0)[0], NM, PET)
    assert alone.n_by_t[i] == pytest.approx(-9.0, abs=0.3)
    assert alone.n_by_substrate[i] == pytest.approx(1.09, abs=0.05)


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
    true = on_substrate(n, k, h, nm, Substrate(sheet_n, 1.4e-6, 100.0), side=side)
    t, r = (read + noise * rng.standard_normal(draws) for read in true)
    sheet = Substrate(1.57, 1.4e-6, 100.0, u_n=u_sheet)
    found = invert(t, r, nm, 25.0, sheet, Errors(noise, noise, thickness_um=u_h), side=side)
    assert not np.isnan(found.n).any()
    for value, truth, u in ((found.n, n, found.u_n), (found.k, k, found.u_k)):
        covered = np.mean(abs(value - truth) < 1.96 * u)
        assert covered == pytest.approx(0.95, abs=0.02)


def test_what_all_wavelengths_share_is_kept_apart() -> None:
    sheet = Substrate(PET.n, PET.k, 100.0, u_n=0.02, u_k=1e-6, u_thickness_um=2.0)
    errors = Errors(1e-3, 2e-3, 5e-4, 1e-3, 1.0)
    found = invert(*measured(RESIN, 1e-4), NM, LAYER_UM, sheet, errors)
    assert found.shared.names == (
        "T, calibration",
        "R, calibration",
        "index of the substrate",
        "extinction of the substrate",
        "thickness of the substrate",
        "thickness of the layer",
    )
    apart = (found.n_by_t * 1e-3) ** 2 + (found.n_by_r * 2e-3) ** 2
    assert found.u_n**2 == pytest.approx(apart + (found.shared.n**2).sum(axis=0), rel=1e-12)
    assert found.shared.n[2] == pytest.approx(found.n_by_substrate * 0.02, rel=1e-12)
    assert found.shared.k[5] == pytest.approx(-1e-4 / LAYER_UM, rel=1e-3)  # k is a loss divided by h
    nothing = invert(*measured(RESIN, 1e-4), NM, LAYER_UM, PET)
    assert nothing.shared.names == ()
    assert nothing.shared.n.shape == (0, NM.size)
    assert (nothing.u_n == 0).all()


def only(t: float, r: float, sheet: Substrate = PET, errors: Errors | None = None, **way: Any) -> OnSubstrate:
    one = Substrate(float(np.asarray(sheet.n)[40]) if np.ndim(sheet.n) else sheet.n, sheet.k, sheet.thickness_um)
    return invert([t], [r], [600.0], LAYER_UM, one, errors, **way)


def test_what_cannot_be_told_is_masked_with_its_reason() -> None:
    t, r = (float(one) for one in on_substrate(1.49, 0.0, LAYER_UM, 600.0, Substrate(1.57, 1.4e-6, 100.0)))
    least = float(on_substrate(1.253, 0.0, LAYER_UM, 600.0, Substrate(1.57, 1.4e-6, 100.0)).R)
    sheet = Substrate(1.57, 1.4e-6, 100.0)
    for found, reason in (
        (only(np.nan, r), "no reading"),
        (only(-0.01, r), "T = -0.01 and R = "),
        (only(t, 0.0), "are not those of a layer"),
        (only(1.0243, least - 1e-3, sheet), "no index from 1 to 3 reads T = 1.0243"),
        (only(t + 0.01, r, sheet, Errors(1e-3, 1e-3)), "more light than came in: k = -"),
        (only(1.0165, least + 3e-4, sheet, Errors(1e-3, 1e-3)), "two indices fit within the uncertainty, 1."),
    ):
        assert reason in found.reason_n[0]
        assert found.reason_k == found.reason_n
        assert np.isnan([found.n[0], found.u_n[0], found.k[0], found.u_k[0]]).all()


def test_a_k_below_its_uncertainty_is_not_resolved_and_n_stays() -> None:
    t, r = (float(one) for one in on_substrate(1.49, 1e-7, LAYER_UM, 600.0, Substrate(1.57, 1.4e-6, 100.0)))
    sheet = Substrate(1.57, 1.4e-6, 100.0)
    found = only(t, r, sheet, Errors(1e-3, 1e-3))
    assert found.reason_n == ("",)
    assert found.n[0] == pytest.approx(1.49, abs=1e-12)
    assert found.reason_k[0].startswith("k is not resolved: 1e-07 with an uncertainty of ")
    assert np.isnan(found.k[0])
    assert found.u_k[0] > 1e-6
    brighter = only(t + 1e-3, r, sheet, Errors(1e-3, 1e-3))  # R + T of more than 1, within the noise
    assert not np.isnan(brighter.n[0])
    assert np.isnan(brighter.k[0])


def test_gaps_do_not_reach_their_neighbours() -> None:
    t, r = (np.array(one) for one in measured(RESIN, LOSSY))
    t[7], r[50] = np.nan, np.nan
    found = invert(t, r, NM, LAYER_UM, PET)
    gaps = np.zeros(NM.shape, dtype=bool)
    gaps[[7, 50]] = True
    assert np.array_equal(np.isnan(found.n), gaps)
    assert found.n[~gaps] == pytest.approx(RESIN[~gaps], abs=1e-13)


def test_a_long_spectrum_is_inverted_in_blocks_to_the_same_numbers() -> None:
    t, r = (np.tile(one, 50) for one in measured(RESIN, LOSSY))
    sheet = Substrate(np.tile(PET.n, 50), PET.k, 100.0)
    found = invert(t, r, np.tile(NM, 50), LAYER_UM, sheet)
    assert found.n == pytest.approx(np.tile(RESIN, 50), abs=1e-13)
    assert lossless(np.tile(measured(RESIN, 0.0)[0], 50), np.tile(NM, 50), sheet).n == pytest.approx(
        np.tile(RESIN, 50), abs=1e-12
    )


def test_a_lossless_layer_is_told_by_t_alone() -> None:
    for baseline in ("substrate", "air"):
        t = on_substrate(RESIN, 0.0, LAYER_UM, NM, PET, baseline=baseline).T
        found = lossless(t, NM, PET, Errors(1e-4), baseline=baseline)
        assert found.n == pytest.approx(RESIN, abs=1e-12)
        assert found.u_n == pytest.approx(abs(found.n_by_t) * 1e-4, rel=1e-12)
    other = on_substrate(found.other_n, 0.0, LAYER_UM, NM, PET, baseline="air").T
    assert other == pytest.approx(t, abs=1e-12)


def test_any_loss_makes_the_lossless_index_an_upper_bound() -> None:
    t = measured(RESIN, 2e-5)[0]
    found = lossless(t, NM, PET)
    assert (found.n > RESIN).all()
    assert (found.other_n < RESIN)[~np.isnan(found.other_n)].all()


def test_what_t_alone_cannot_tell_is_masked_with_its_reason() -> None:
    sheet = Substrate(1.57, 1.4e-6, 100.0)
    found = lossless([np.nan, 1.03, 0.6, 1.0243], [600.0] * 4, sheet, Errors(1e-3))
    assert np.isnan(found.n).all()
    assert np.isnan(found.u_n).all()
    assert found.reason[0] == "no reading"
    assert found.reason[1].startswith("T = 1.03 is above 1.0243")
    assert found.reason[2] == "T = 0.6 needs loss, or an index above 3"
    assert found.reason[3].startswith("two indices fit within the uncertainty")


def test_a_known_index_leaves_t_to_tell_k() -> None:
    t = measured(RESIN, LOSSY)[0]
    found = extinction(t, RESIN, NM, LAYER_UM, PET)
    assert found.k == pytest.approx(LOSSY, abs=1e-16)
    sheet = Substrate(PET.n, PET.k, 100.0, u_n=0.02)
    wide = extinction(t, RESIN, NM, LAYER_UM, sheet, Errors(1e-3, thickness_um=1.0), u_n=0.005)
    assert wide.shared.names == ("index of the layer", "index of the substrate", "thickness of the layer")
    step = 1e-6
    moved = (extinction(t, RESIN + step, NM, LAYER_UM, PET).k - extinction(t, RESIN - step, NM, LAYER_UM, PET).k) / 2
    assert wide.shared.k[0] == pytest.approx(moved / step * 0.005, rel=1e-6)
    blind = extinction([0.0, np.nan, 1.0], 1.5, 600.0, LAYER_UM, Substrate(1.57, 0.0, 100.0), Errors(1e-2))
    assert blind.reason[:2] == ("no reading of a layer",) * 2
    assert "k is not resolved" in blind.reason[2]
    assert np.isnan(blind.k).all()


def test_readings_of_the_paper_against_pet_are_no_clear_layer() -> None:
    """T of 0.8889 at 860 nm against the sheet: no clear layer reads so little, one with a heavy loss does."""
    sheet = Substrate(1.554, 1e-6, 100.0, u_n=0.03)
    alone = lossless([0.8889], [860.0], sheet)
    assert np.isnan(alone.n[0]) or alone.n[0] > 2.0
    loss = extinction([0.8889], [1.48], [860.0], LAYER_UM, sheet, u_n=0.02)
    per_mm = 4 * np.pi * loss.k[0] / 860e-6
    assert per_mm == pytest.approx(5.1, abs=0.3)  # base e: 22 dB/mm, and no guide of centimetres


@pytest.mark.parametrize(("nm", "um", "line"), [(0.0, 25.0, "wavelength = 0.0"), (600.0, -1.0, "thickness = -1.0")])
def test_what_is_no_measurement_is_refused(nm: float, um: float, line: str) -> None:
    with pytest.raises(DataError, match=line):
        invert([1.0], [0.1], [nm], um, Substrate(1.57, 0.0, 100.0))
    with pytest.raises(DataError, match="must be one row each"):
        invert([[1.0]], [[0.1]], [[600.0]], 25.0, Substrate(1.57, 0.0, 100.0))
