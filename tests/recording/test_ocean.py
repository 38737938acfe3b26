"""Text files of OceanView and SpectraSuite."""

from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import read

WAVES = [round(178.2 + 0.38 * n - 1e-5 * n**2, 3) for n in range(50)]
VALUES = [round(1200.0 + 300.0 * np.sin(0.3 * n), 2) for n in range(50)]


def ocean(program: str = "OceanView", mark: str = ".") -> str:
    """Return a file in the form of the programs."""
    rows = [f"{wave:.3f}\t{value:.2f}".replace(".", mark) for wave, value in zip(WAVES, VALUES, strict=True)]
    entries = ["Date: Sun Mar 01 10:22:33 CET 2026", "User: nobody", "Spectrometer: USB4F00001"]
    if program == "OceanView":
        head = ["Data from film_Absorbance_001.txt Node", "", *entries, "Integration Time (sec): 1.000000E-1"]
        head += ["XAxis mode: Wavelengths", f"Number of Pixels in Spectrum: {len(rows)}"]
        return "\r\n".join([*head, ">>>>>Begin Spectral Data<<<<<", *rows, ""])
    head = ["SpectraSuite Data File", "++++++++++++++++++++++++++++++++++++", *entries]
    head += [f"Number of Pixels in Processed Spectrum: {len(rows)}"]
    ends = ">>>>>{} Processed Spectral Data<<<<<"
    return "\r\n".join([*head, ends.format("Begin"), *rows, ends.format("End"), ""])


def saved(folder: Path, text: str) -> Path:
    (folder / "file.txt").write_text(text, encoding="utf-8", newline="")
    return folder / "file.txt"


@pytest.mark.parametrize("program", ["OceanView", "SpectraSuite"])
@pytest.mark.parametrize("mark", [".", ","])
def test_reads_all_numbers(tmp_path: Path, program: str, mark: str) -> None:
    recording = read(saved(tmp_path, ocean(program, mark)))
    assert recording.provenance.format == "ocean"
    assert recording.provenance.instrument == "USB4F00001"
    assert recording.need("wavelength").values.tolist() == WAVES
    assert recording.channel("spectrum").values.tolist() == VALUES
    assert any("does not specify whether its values are" in line for line in recording.warnings)


@pytest.mark.parametrize(
    ("before", "after", "part"),
    [
        ("Spectrum: 50", "Spectrum: 51", "50 rows, .* 51"),
        ("XAxis mode: Wavelengths", "XAxis mode: Raman Shifts", "Raman Shifts"),
        ("178.200\t", "187.200\t", "ascending or descending order"),
        ("178.200\t", "178.200", "line 10"),
        ("178.200", "17x.200", "line 10"),
    ],
)
def test_rejects_damage_with_line(tmp_path: Path, before: str, after: str, part: str) -> None:
    text = ocean()
    assert before in text
    with pytest.raises(DataError, match=part):
        read(saved(tmp_path, text.replace(before, after, 1)))
