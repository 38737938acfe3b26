"""Wavelengths in ångström."""

from pathlib import Path

import pytest

import solen


@pytest.mark.parametrize("unit", ["Å", "angstrom"])
def test_wavelengths_in_angstrom_are_converted(unit: str, tmp_path: Path) -> None:
    rows = "".join(f"{4300 + 100 * row},0.9\n" for row in range(8))
    (tmp_path / "layer.csv").write_text(f"wavelength ({unit}),T\n{rows}", encoding="utf-8")
    assert solen.read(tmp_path / "layer.csv").channels[0].to("nm") == pytest.approx(
        [430.0 + 10.0 * n for n in range(8)]
    )
