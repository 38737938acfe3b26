"""Headers: what is a unit and what only looks like one; what a word means beside its unit."""

import pytest

from solen.recording.words import heading, is_label, stated_unit
from solen.units import factor, is_unit


@pytest.mark.parametrize(
    ("text", "name", "unit", "quantity"),
    [
        ("wavelength_nm", "wavelength", "nm", "wavelength"),
        ("Wellenlänge [nm]", "Wellenlänge", "nm", "wavelength"),
        ("λ (nm)", "λ", "nm", "wavelength"),
        ("λ (-)", "λ", "1", "stretch"),
        ("%T", "T", "%", "transmittance"),
        ("T %", "T", "%", "transmittance"),
        ("T (%)", "T", "%", "transmittance"),
        ("Baseline 100%T", "Baseline 100%T", "%", "transmittance"),
        ("Transmittance (T)", "Transmittance", "", "transmittance"),
        ("Reflectance (R)", "Reflectance", "", "reflectance"),
        ("Absorbance (a.u.)", "Absorbance", "", "absorbance"),
        ("left (a.u.)", "left", "a.u.", ""),
        ("left (Ohm)", "left", "ohm", ""),
        ("Angle (Deg)", "Angle", "Deg", "angle"),
        ("T (°C)", "T", "°C", "temperature"),
        ("Temperatur / K", "Temperatur", "K", "temperature"),
        ("R (kΩ)", "R", "kΩ", "resistance"),
        ("t_s", "t", "s", "time"),
        ("t / s", "t", "s", "time"),
        ("t (µm)", "t", "µm", "thickness"),
        ("R_s", "R_s", "", ""),
        ("sample_A", "sample_A", "", ""),
        ("sample A", "sample A", "", ""),
        ("film 1", "film 1", "", ""),
        ("film_1", "film_1", "", ""),
        ("film (1)", "film (1)", "", ""),
        ("film (new)", "film (new)", "", ""),
        ("film (A)", "film (A)", "", ""),
        ("detector 1 (V)", "detector 1", "V", ""),
        ("b R (%)", "b R", "%", ""),
        ("b (V)", "b", "V", ""),
        ("T (K)", "T", "K", "temperature"),
        ("Force (F)", "Force", "", "force"),
        ("F/N", "F", "N", "force"),
        ("Standardkraft in N", "Standardkraft", "N", "force"),
        ("Standardweg", "Standardweg", "", "displacement"),
        ("Engineering Stress (MPa)", "Engineering Stress", "MPa", "stress"),
        ("True Strain", "True Strain", "", "true strain"),
        ("stress_N_per_mm2", "stress", "N/mm2", "stress"),
        ("dose_mJ_per_cm2", "dose", "mJ/cm2", "exposure"),
        ("Ec_mJ_cm2", "Ec", "mJ/cm2", ""),
        ("E (mJ/cm²)", "E", "mJ/cm²", "exposure"),
        ("E-Modul [MPa]", "E-Modul", "MPa", "modulus"),
        ("absorption_per_mm", "absorption", "1/mm", ""),
        ("loss_dB_per_cm", "loss", "dB/cm", ""),
        ("power_dBm", "power", "dBm", "power"),
        ("U (V)", "U", "V", "voltage"),
        ("strain_percent", "strain", "percent", "strain"),
        ("a / b", "a / b", "", ""),
        ("x" * 500, "x" * 500, "", ""),
    ],
)
def test_name_unit_and_quantity(text: str, name: str, unit: str, quantity: str) -> None:
    found = heading(text)
    assert (found.name, found.unit, found.quantity) == (name, unit, quantity)


@pytest.mark.parametrize(
    ("text", "quantity"), [("T", "transmittance"), ("film_R", "reflectance"), ("A", ""), ("h", "")]
)
def test_letters_beside_a_wavelength_are_an_opticians(text: str, quantity: str) -> None:
    assert heading(text, optical=True).quantity == (quantity or heading(text).quantity)


def test_a_row_of_units_counts() -> None:
    assert heading("Traverse abs.", "[mm]").unit == "mm"
    assert heading("Dehnung", "-").unit == "1"
    assert heading("t", "µm").quantity == "thickness"


def test_which_texts_are_units() -> None:
    assert all(map(stated_unit, ["N/mm²", "%", "mW/cm2", "1/cm", "cm^-1", "-", "µm", "μm", "sek", "°"]))
    assert not any(map(stated_unit, ["R", "T", "abc", "Probe", "", "a.u.", "2", "N or kN", "m" * 200]))


def test_columns_that_name_their_rows() -> None:
    assert all(map(is_label, ["Replicate", "build_orientation", "Sample", "Ausrichtung", "orientation (deg)"]))
    assert not any(map(is_label, ["thickness_um", "power", "sample thickness"]))


@pytest.mark.parametrize(
    ("unit", "wanted", "expected"),
    [
        ("µm", "nm", 1000.0),
        ("μm", "mm", 0.001),
        ("%", "1", 0.01),
        ("%T", "1", 0.01),
        ("percent", "1", 0.01),
        ("N/mm²", "MPa", 1.0),
        ("kN", "N", 1000.0),
        ("mJ/cm²", "mJ/cm**2", 1.0),
        ("dB/cm", "dB/cm", 1.0),
        ("min", "s", 60.0),
        ("mm", "N", None),
        ("", "nm", None),
        ("dB", "1", None),
        ("°C", "K", None),
        ("°C", "°C", 1.0),
        ("nonsense", "1", None),
    ],
)
def test_factors(unit: str, wanted: str, expected: float | None) -> None:
    assert factor(unit, wanted) == expected  # to the last digit: 1000 and not 999.9999999999999


def test_an_empty_text_is_the_unit_of_a_pure_number() -> None:
    assert is_unit("")
    assert factor("", "%") == 100.0
