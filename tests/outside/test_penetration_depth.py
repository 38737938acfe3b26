"""Penetration depth from an absorbance, compared with published working curves of the same resin.

The absorbance of PR48 over 93 µm and the spectrum of an Asiga Pico Plus were measured in 2015; the working curves are
those of Bennett (2017) and Kolibaba (2024) at 365, 385 and 405 nm. Batch, lamp bandwidth and changes of the resin
during curing differ, so the values need not agree; the tests establish by how much they do.
"""

import csv
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.material.cure.penetration import Attenuation, attenuation
from solen.material.cure.spectral import lamp_lines, transmitted
from solen.material.index.illuminant import Illuminant, led, measured_light
from solen.recording import read, spectra

PATH_UM = 93.0


@pytest.fixture(scope="module")
def resin(outside: Path) -> tuple[FloatArray, FloatArray]:
    """Return wavelengths and absorbances of PR48."""
    file = outside / "working_curve" / "gregnordin" / "pr48_2015-07-27.csv"
    (spectrum,) = spectra(read(file, columns=("wavelength_nm", "absorbance")))
    return spectrum.wavelength_nm, spectrum.channel.values


@pytest.fixture(scope="module")
def asiga(outside: Path) -> Illuminant:
    """Return the illuminant of the printer, with a peak at 412 nm; the noise outside it has both signs."""
    file = outside / "working_curve" / "gregnordin" / "asiga_2015-06-27.csv"
    (spectrum,) = spectra(read(file, columns=("wavelength_nm", "power")))
    assert spectrum.channel.values.min() < 0.0
    return measured_light(spectrum.wavelength_nm, spectrum.channel.values)


@pytest.fixture(scope="module")
def published(outside: Path) -> list[tuple[float, float, float]]:
    """Return wavelength, Dp and its uncertainty (NaN if not published) of the working curves of PR48."""
    with (outside / "working_curve" / "published_Dp_Ec.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["resin"].startswith("PR48")]
    return [(float(row["wavelength_nm"]), float(row["Dp_um"]), float(row["Dp_unc_um"] or "nan")) for row in rows]


def attenuation_at(resin: tuple[FloatArray, FloatArray], nm: float, fwhm_nm: float | None = None) -> Attenuation:
    return attenuation(PATH_UM, *resin, led(nm, fwhm_nm))


def test_single_wavelength_follows_formula(resin: tuple[FloatArray, FloatArray]) -> None:
    for nm in (365.0, 385.0, 405.0):
        expected = PATH_UM / (float(np.interp(nm, *resin)) * math.log(10.0))
        assert attenuation_at(resin, nm).local_um() == pytest.approx(expected, rel=1e-12)


def test_ratios_to_published_values(
    resin: tuple[FloatArray, FloatArray], published: list[tuple[float, float, float]]
) -> None:
    """Where absorbance varies slowly the two agree; at 405 nm, on an edge, the computed Dp is 1.6 to 2 times larger."""
    computed = {nm: attenuation_at(resin, nm).local_um() for nm in (365.0, 385.0, 405.0)}
    assert computed == pytest.approx({365.0: 34.7, 385.0: 43.5, 405.0: 108.9}, abs=0.1)
    published_dp = sorted((nm, dp) for nm, dp, _ in published)
    assert published_dp == [(365.0, 42.0), (385.0, 39.2), (405.0, 53.0), (405.0, 69.3)]
    ratios = [computed[nm] / dp for nm, dp in published_dp]
    assert ratios == pytest.approx([0.83, 1.11, 2.05, 1.57], abs=0.01)
    (kolibaba,) = [(dp, u) for nm, dp, u in published if nm == 385.0]
    assert abs(computed[385.0] - kolibaba[0]) < 2.0 * kolibaba[1]


def test_published_value_at_405_nm_is_that_of_shorter_wavelength(resin: tuple[FloatArray, FloatArray]) -> None:
    """The absorbance has the values for 69.3 and 53 µm at 397 and 391 nm."""
    falling = resin[0] > 370.0
    for dp, nm in ((69.3, 397.0), (53.0, 391.0)):
        absorbance = PATH_UM / (dp * math.log(10.0))
        result = np.interp(-absorbance, -resin[1][falling][:150], resin[0][falling][:150])
        assert result == pytest.approx(nm, abs=0.7)


def test_light_of_printer_does_not_decay_exponentially(resin: tuple[FloatArray, FloatArray], asiga: Illuminant) -> None:
    """The spectrum extends from strong to negligible absorption of PR48, so Dp increases indefinitely with depth."""
    result = attenuation(PATH_UM, *resin, asiga)
    assert result.local_um() == pytest.approx(158.6, abs=0.2)
    assert result.between_um(25.0, 200.0) == pytest.approx(255.9, abs=0.3)
    dp_um = [result.local_um(depth) for depth in (0.0, 100.0, 200.0, 400.0)]
    assert all(following > 1.3 * previous for previous, following in pairwise(dp_um))
    single = attenuation_at(resin, asiga.mean_nm).local_um()
    assert result.local_um() < single  # at the surface, the strongly absorbed light dominates


def test_dp_of_measured_lamp_increases_with_depth(resin: tuple[FloatArray, FloatArray], asiga: Illuminant) -> None:
    """The expected values are sums over the measured spectra, independent of solen; a few lines reproduce the decay."""
    absorption_per_um = np.interp(asiga.wavelength_nm, *resin) * math.log(10.0) / PATH_UM
    weight = asiga.weight / asiga.weight.sum()
    surface_dp_um = 1.0 / float(weight @ absorption_per_um)
    remaining = weight * np.exp(-300.0 * absorption_per_um)
    dp_at_300_um = float(remaining.sum() / (remaining @ absorption_per_um))
    assert (surface_dp_um, dp_at_300_um) == pytest.approx((158.6, 494.6), abs=0.5)
    result = attenuation(PATH_UM, *resin, asiga)
    assert (result.local_um(), result.local_um(300.0)) == pytest.approx((surface_dp_um, dp_at_300_um), rel=1e-9)
    for depth_um in (50.0, 100.0, 200.0, 300.0, 500.0):
        expected = float(weight @ np.exp(-depth_um * absorption_per_um))
        assert float(transmitted(lamp_lines(result), depth_um / surface_dp_um)) == pytest.approx(expected, rel=1e-3)
