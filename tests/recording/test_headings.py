"""Column headers: units, strings that only look like units, and the meaning of words with a unit."""

import pytest

from solen.recording.headings import heading, is_label, is_measurement_unit
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
    result = heading(text)
    assert (result.name, result.unit, result.quantity) == (name, unit, quantity)


@pytest.mark.parametrize(
    ("text", "quantity"), [("T", "transmittance"), ("film_R", "reflectance"), ("A", ""), ("h", "")]
)
def test_optical_meaning_of_letters(text: str, quantity: str) -> None:
    assert heading(text, optical=True).quantity == (quantity or heading(text).quantity)


def test_unit_row_determines_quantity() -> None:
    assert heading("Traverse abs.", "[mm]").unit == "mm"
    assert heading("Dehnung", "-").unit == "1"
    assert heading("t", "µm").quantity == "thickness"


def test_measurement_units() -> None:
    assert all(map(is_measurement_unit, ["N/mm²", "%", "mW/cm2", "1/cm", "cm^-1", "-", "µm", "μm", "sek", "°"]))
    assert not any(map(is_measurement_unit, ["R", "T", "abc", "Probe", "", "a.u.", "2", "N or kN", "m" * 200]))


def test_label_columns() -> None:
    assert all(map(is_label, ["Replicate", "build_orientation", "Sample", "Ausrichtung", "orientation (deg)"]))
    assert not any(map(is_label, ["thickness_um", "power", "sample thickness"]))


@pytest.mark.parametrize(
    ("unit", "target", "expected"),
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
def test_conversion_factors(unit: str, target: str, expected: float | None) -> None:
    assert factor(unit, target) == expected  # exactly: 1000 and not 999.9999999999999


def test_empty_string_is_dimensionless() -> None:
    assert is_unit("")
    assert factor("", "%") == 100.0
