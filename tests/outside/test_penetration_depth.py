"""Penetration depth from an absorbance beside published working curves of the same resin.

PR48's absorbance was measured over 93 µm in 2015, with the spectrum of an Asiga Pico Plus beside it; its working curves
are those of Bennett (2017) and Kolibaba (2024), at 365, 385 and 405 nm. A batch, a lamp's width and what the setting
resin does lie between the two, so they need not agree; by how much they do is what is tested.
"""

import csv
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.material.cure.penetration import Attenuation, attenuation
from solen.material.cure.spectral import lamp_lines, left
from solen.material.index.illuminant import Illuminant, led, measured_light
from solen.recording import read, spectra

PATH_UM = 93.0


@pytest.fixture(scope="module")
def resin(outside: Path) -> tuple[FloatArray, FloatArray]:
    """Wavelengths and absorbances of PR48."""
    file = outside / "working_curve" / "gregnordin" / "pr48_2015-07-27.csv"
    (found,) = spectra(read(file, columns=("wavelength_nm", "absorbance")))
    return found.wavelength_nm, found.channel.values


@pytest.fixture(scope="module")
def asiga(outside: Path) -> Illuminant:
    """Illuminant of the printer, its peak at 412 nm; the noise beside it lies on both sides of 0."""
    file = outside / "working_curve" / "gregnordin" / "asiga_2015-06-27.csv"
    (found,) = spectra(read(file, columns=("wavelength_nm", "power")))
    assert found.channel.values.min() < 0.0
    return measured_light(found.wavelength_nm, found.channel.values)


@pytest.fixture(scope="module")
def published(outside: Path) -> list[tuple[float, float, float]]:
    """Wavelength, Dp and its uncertainty (NaN: not told) of PR48's published working curves."""
    with (outside / "working_curve" / "published_Dp_Ec.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["resin"].startswith("PR48")]
    return [(float(row["wavelength_nm"]), float(row["Dp_um"]), float(row["Dp_unc_um"] or "nan")) for row in rows]


def at(resin: tuple[FloatArray, FloatArray], nm: float, fwhm_nm: float | None = None) -> Attenuation:
    return attenuation(PATH_UM, *resin, led(nm, fwhm_nm))


def test_one_wavelength_is_the_formula(resin: tuple[FloatArray, FloatArray]) -> None:
    for nm in (365.0, 385.0, 405.0):
        expected = PATH_UM / (float(np.interp(nm, *resin)) * math.log(10.0))
        assert at(resin, nm).local_um() == pytest.approx(expected, rel=1e-12)


def test_beside_the_published_values(
    resin: tuple[FloatArray, FloatArray], published: list[tuple[float, float, float]]
) -> None:
    """Where absorbance changes slowly the two agree; at 405 nm, on its edge, it gives 1.6 to 2 times more."""
    ours = {nm: at(resin, nm).local_um() for nm in (365.0, 385.0, 405.0)}
    assert ours == pytest.approx({365.0: 34.7, 385.0: 43.5, 405.0: 108.9}, abs=0.1)
    theirs = sorted((nm, dp) for nm, dp, _ in published)
    assert theirs == [(365.0, 42.0), (385.0, 39.2), (405.0, 53.0), (405.0, 69.3)]
    ratios = [ours[nm] / dp for nm, dp in theirs]
    assert ratios == pytest.approx([0.83, 1.11, 2.05, 1.57], abs=0.01)
    (kolibaba,) = [(dp, u) for nm, dp, u in published if nm == 385.0]
    assert abs(ours[385.0] - kolibaba[0]) < 2.0 * kolibaba[1]


def test_the_published_value_at_405_nm_is_that_of_a_shorter_wavelength(resin: tuple[FloatArray, FloatArray]) -> None:
    """What the absorbance has to be for 69.3 and 53 µm, it is at 397 and at 391 nm."""
    falling = resin[0] > 370.0
    for dp, nm in ((69.3, 397.0), (53.0, 391.0)):
        needed = PATH_UM / (dp * math.log(10.0))
        found = np.interp(-needed, -resin[1][falling][:150], resin[0][falling][:150])
        assert found == pytest.approx(nm, abs=0.7)


def test_the_printer_s_light_is_no_exponential(resin: tuple[FloatArray, FloatArray], asiga: Illuminant) -> None:
    """Its spectrum reaches from where PR48 absorbs to where it hardly does: Dp rises with depth without end."""
    found = attenuation(PATH_UM, *resin, asiga)
    assert found.local_um() == pytest.approx(158.6, abs=0.2)
    assert found.between_um(25.0, 200.0) == pytest.approx(255.9, abs=0.3)
    local = [found.local_um(depth) for depth in (0.0, 100.0, 200.0, 400.0)]
    assert all(after > 1.3 * before for before, after in pairwise(local))
    single = at(resin, asiga.mean_nm).local_um()
    assert found.local_um() < single  # what absorbs most counts most at the surface


def test_a_measured_lamp_has_a_dp_that_grows_with_depth_and_few_lines_keep_it(
    resin: tuple[FloatArray, FloatArray], asiga: Illuminant
) -> None:
    """By sums over the measured spectra that use nothing of solen's."""
    taken = np.interp(asiga.wavelength_nm, *resin) * math.log(10.0) / PATH_UM
    weight = asiga.share / asiga.share.sum()
    surface = 1.0 / float(weight @ taken)
    lit = weight * np.exp(-300.0 * taken)
    deep = float(lit.sum() / (lit @ taken))
    assert (surface, deep) == pytest.approx((158.6, 494.6), abs=0.5)
    found = attenuation(PATH_UM, *resin, asiga)
    assert (found.local_um(), found.local_um(300.0)) == pytest.approx((surface, deep), rel=1e-9)
    for um in (50.0, 100.0, 200.0, 300.0, 500.0):
        wanted = float(weight @ np.exp(-um * taken))
        assert float(left(lamp_lines(found), um / surface)) == pytest.approx(wanted, rel=1e-3)
