"""Spectra of a recording: wavelengths in nm, values as ratios, and units, which are not guessed."""

from pathlib import Path

import pytest

from solen.errors import DataError
from solen.recording import read, spectra


def saved(folder: Path, text: str) -> Path:
    path = folder / "table.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_trace_belongs_to_wavelengths_on_its_left(tmp_path: Path) -> None:
    text = "Wavelength (nm),a_T_pct,Wellenlänge [µm],b R (%),c (Abs)\n500,90,1,8,0.1\n400,80,2,9,0.2\n"
    first, second, third = spectra(read(saved(tmp_path, text)))
    assert first.wavelength_nm.tolist() == [500.0, 400.0]
    assert second.wavelength_nm.tolist() == third.wavelength_nm.tolist() == [1000.0, 2000.0]
    assert first.channel.quantity == "transmittance"
    assert second.channel.quantity == "reflectance"
    assert first.ratio().tolist() == pytest.approx([0.9, 0.8], rel=1e-15)


def test_percentage_needs_unit(tmp_path: Path) -> None:
    fraction, percentage = spectra(read(saved(tmp_path, "wavelength_nm,T,R\n400,0.91,8.1\n500,0.92,8.2\n")))
    assert fraction.ratio().tolist() == [0.91, 0.92]
    with pytest.raises(DataError, match=r"R = 8.2; has no unit, and is not a fraction; write R \(%\)"):
        percentage.ratio()
