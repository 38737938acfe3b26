"""Cure law for the spectrum of a lamp: compared with integrals over it, and recovered from simulated discs."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.cure import CureOptions
from solen.material.cure.penetration import Attenuation, PenetrationOptions
from solen.material.cure.spectral import ONE_LINE, depth, fit_spectral_law, lamp_lines, transmitted
from solen.material.cure.working_curve_fit import working_curve
from solen.pipeline.resin.cure import cure
from solen.pipeline.resin.penetration import penetration

NM = np.linspace(372.0, 452.0, 801)
DOSES = np.repeat([15.0, 25.0, 40.0, 65.0, 105.0, 170.0, 280.0], 3)


def light() -> FloatArray:
    """Return the spectrum of a lamp with a centre of 412 nm and a full width of 26 nm."""
    return np.asarray(np.exp(-4.0 * np.log(2.0) * ((NM - 412.0) / 26.0) ** 2))


def per_um() -> FloatArray:
    """Return the absorption of a resin, which decreases by a factor of about 100 over the spectrum of the lamp."""
    return 0.012 * 10.0 ** (-(NM - 412.0) / 22.0) + 1.5e-3


def integrated_dose(um: float) -> float:
    """Return the fraction of the lamp's light at a depth, by the trapezoidal rule."""
    return float(np.trapezoid(light() * np.exp(-per_um() * um), NM) / np.trapezoid(light(), NM))


def cured_um(dose: float, Ec: float) -> float:
    return float(brentq(lambda um: dose * integrated_dose(um) - Ec, 0.0, 5000.0, xtol=1e-10))


def decay() -> Attenuation:
    return Attenuation(NM, light() / light().sum(), per_um())


def surface_um() -> float:
    return float(np.trapezoid(light(), NM) / np.trapezoid(light() * per_um(), NM))


def test_a_few_lines_represent_the_spectrum() -> None:
    lines = lamp_lines(decay())
    assert len(lines) <= 48
    assert sum(weight for weight, _ in lines) == pytest.approx(1.0)
    assert sum(weight * absorption for weight, absorption in lines) == pytest.approx(1.0)
    for um in (10.0, 50.0, 100.0, 200.0, 300.0, 500.0):
        assert float(transmitted(lines, um / surface_um())) == pytest.approx(integrated_dose(um), rel=5e-3)


def test_local_penetration_depth_equals_the_slope_of_the_integral() -> None:
    def local(um: float) -> float:
        ends = (integrated_dose(um - 0.01), integrated_dose(um + 0.01))
        return 0.02 / float(np.log(ends[0] / ends[1]))

    assert decay().local_um(300.0) == pytest.approx(local(300.0), rel=5e-3)
    assert decay().local_um(300.0) > 2.0 * decay().local_um()


def test_the_depth_is_where_the_dose_is_critical() -> None:
    lines = lamp_lines(decay())
    for dose in (8.0, 20.0, 100.0, 1000.0):
        um = surface_um() * float(depth(lines, np.log(dose / 6.0)))
        assert dose * float(transmitted(lines, um / surface_um())) == pytest.approx(6.0, rel=1e-9)
        assert um == pytest.approx(cured_um(dose, 6.0), rel=5e-3)
    assert np.allclose(depth(ONE_LINE, [-0.5, 0.0, 2.0]), [-0.5, 0.0, 2.0])
    assert float(depth(lines, -0.3)) < 0.0


def test_discs_cured_by_a_lamp_prefer_the_spectral_law_and_recover_its_parameters() -> None:
    lines, covered, ratios = lamp_lines(decay()), 0, []
    true = np.array([cured_um(dose, 6.0) for dose in DOSES])
    for seed in range(40):
        um = true * (1.0 + 0.02 * np.random.default_rng(seed).standard_normal(true.size))
        fit = fit_spectral_law(working_curve(DOSES, um, keep_all=True), lines, surface_um(), "lamp")
        assert fit.preferred == "spectrum"
        covered += abs(fit.Dp_um - surface_um()) < 2.09 * fit.u_Dp_um
        ratios.append(fit.Dp_um / surface_um())
    assert covered >= 34, "95 % of 40 intervals"
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.01)


def test_discs_cured_at_one_wavelength_prefer_jacobs_law() -> None:
    rng = np.random.default_rng(3)
    um = 90.0 * np.log(DOSES / 6.0) * (1.0 + 0.02 * rng.standard_normal(DOSES.size))
    fit = fit_spectral_law(working_curve(DOSES, um, keep_all=True), lamp_lines(decay()), 90.0, "lamp")
    assert fit.preferred == "Jacobs"
    laser = fit_spectral_law(working_curve(DOSES, um, keep_all=True), ONE_LINE, 90.0, "laser")
    assert laser.preferred is None
    assert laser.rms_um == pytest.approx(laser.jacobs_rms_um)


def test_the_dose_inside_a_part_is_the_sum_over_its_layers() -> None:
    um = np.array([cured_um(dose, 6.0) for dose in DOSES]) * (1.0 + 1e-3 * np.sin(np.arange(DOSES.size)))
    fit = fit_spectral_law(working_curve(DOSES, um, keep_all=True), lamp_lines(decay()), surface_um(), "lamp")
    heights = np.linspace(0.0, 25.0, 51)
    doses = np.array([sum(26.0 * integrated_dose(25.0 * later + z) for later in range(160)) for z in heights])
    mean = float(np.trapezoid(doses, heights) / 25.0)
    assert fit.interior_mean_mJ_per_cm2(26.0, 25.0) == pytest.approx(mean, rel=0.02)
    print_through = brentq(
        lambda z: sum(26.0 * integrated_dose(25.0 * (later + 1) + z) for later in range(160)) - 6.0, 0.0, 3000.0
    )
    assert fit.print_through_um(26.0, 25.0) == pytest.approx(float(print_through), rel=0.02)


def test_the_command_compares_it_with_jacobs_law(tmp_path: Path) -> None:
    nm = np.arange(360.0, 470.0, 1.0)
    absorbance = np.interp(nm, NM, per_um()) * 93.0 / np.log(10.0)
    np.savetxt(tmp_path / "resin.csv", np.column_stack([nm, absorbance]), delimiter=",",
               header="wavelength_nm,absorbance", comments="")  # fmt: skip
    liquid, without_lamp = tmp_path / "liquid.json", tmp_path / "without.json"
    penetration(
        tmp_path / "resin.csv", options=PenetrationOptions(path_um=93.0, led_nm=412.0, led_fwhm_nm=20.0), out=liquid
    )
    penetration(tmp_path / "resin.csv", options=PenetrationOptions(path_um=93.0), out=without_lamp)
    um = np.array([cured_um(dose, 6.0) for dose in DOSES])
    np.savetxt(tmp_path / "discs.csv", np.column_stack([DOSES, um * (1.0 + 0.01 * np.sin(7.0 * np.arange(um.size)))]),
               delimiter=",", header="dose_mJ_per_cm2,thickness_um", comments="")  # fmt: skip
    options = CureOptions(irradiance_mW_per_cm2=13.0, layer_um=25.0, exposure_s=2.0)
    result = cure([tmp_path / "discs.csv"], options=options, penetration=liquid, out=tmp_path / "cure.json").result
    assert result.in_lamp is not None
    assert result.in_lamp_exposure is not None
    assert result.in_lamp.preferred == "spectrum"
    assert result.Dp_um > 1.2 * result.in_lamp.Dp_um
    assert result.in_lamp_exposure.interior_over_jacobs != pytest.approx(1.0, abs=0.02)
    assert any("spectrum" in text for text in result.warnings)
    assert json.loads((tmp_path / "cure.json").read_text(encoding="utf-8"))["in_lamp"]["lamp_lines"]
    with pytest.raises(DataError, match="no lamp"):
        cure([tmp_path / "discs.csv"], options=options, penetration=without_lamp)
    inconsistent = options.model_copy(update={"wavelength_nm": 460.0})
    with pytest.raises(DataError, match=r"460 nm.*41"):
        cure([tmp_path / "discs.csv"], options=inconsistent, penetration=liquid)
