"""OceanView's and SpectraSuite's text files: every number of a plain reading."""

from pathlib import Path

import numpy as np
import pytest

from solen.errors import DataError
from solen.recording import read

WAVES = [round(178.2 + 0.38 * n - 1e-5 * n**2, 3) for n in range(50)]
VALUES = [round(1200.0 + 300.0 * np.sin(0.3 * n), 2) for n in range(50)]


def ocean(program: str = "OceanView", mark: str = ".") -> str:
    """A file as the programs write it."""
    rows = [f"{wave:.3f}\t{value:.2f}".replace(".", mark) for wave, value in zip(WAVES, VALUES, strict=True)]
    stated = ["Date: Sun Mar 01 10:22:33 CET 2026", "User: nobody", "Spectrometer: USB4F00001"]
    if program == "OceanView":
        head = ["Data from film_Absorbance_001.txt Node", "", *stated, "Integration Time (sec): 1.000000E-1"]
        head += ["XAxis mode: Wavelengths", f"Number of Pixels in Spectrum: {len(rows)}"]
        return "\r\n".join([*head, ">>>>>Begin Spectral Data<<<<<", *rows, ""])
    head = ["SpectraSuite Data File", "++++++++++++++++++++++++++++++++++++", *stated]
    head += [f"Number of Pixels in Processed Spectrum: {len(rows)}"]
    ends = ">>>>>{} Processed Spectral Data<<<<<"
    return "\r\n".join([*head, ends.format("Begin"), *rows, ends.format("End"), ""])


def saved(folder: Path, text: str) -> Path:
    (folder / "file.txt").write_text(text, encoding="utf-8", newline="")
    return folder / "file.txt"


@pytest.mark.parametrize("program", ["OceanView", "SpectraSuite"])
@pytest.mark.parametrize("mark", [".", ","])
def test_numbers_are_those_of_a_plain_reading(tmp_path: Path, program: str, mark: str) -> None:
    found = read(saved(tmp_path, ocean(program, mark)))
    assert found.provenance.format == "ocean"
    assert found.provenance.instrument == "USB4F00001"
    assert found.need("wavelength").values.tolist() == WAVES
    assert found.channel("spectrum").values.tolist() == VALUES
    assert any("does not say whether its values are" in line for line in found.warnings)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ("Spectrum: 50", "Spectrum: 51", "50 rows, .* 51"),
        ("XAxis mode: Wavelengths", "XAxis mode: Raman Shifts", "Raman Shifts"),
        ("178.200\t", "187.200\t", "increase, or decrease"),
        ("178.200\t", "178.200", "line 10"),
        ("178.200", "17x.200", "line 10"),
    ],
)
def test_what_is_damaged_is_refused_with_its_line(tmp_path: Path, before: str, after: str, words: str) -> None:
    text = ocean()
    assert before in text
    with pytest.raises(DataError, match=words):
        read(saved(tmp_path, text.replace(before, after, 1)))
