"""Mistakes of a first table: swapped columns, wrong units, numbers that no print has."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, SpecError
from solen.material.cure import CureOptions, curve_of_discs
from solen.material.loss import guide_loss
from solen.pipeline.resin.exposures import exposures
from solen.recording import read


def discs(path: Path, unit_um: float = 1.0) -> Path:
    """Noisy discs of Dp 200 µm and Ec 10 mJ/cm², their thicknesses divided by `unit_um` under a header in µm."""
    rng = np.random.default_rng(5)
    rows = [
        f"{dose},{200.0 * math.log(dose / 10.0) * rng.normal(1.0, 0.03) / unit_um:.6f}"
        for dose in (15, 20, 40, 80)
        for _ in range(3)
    ]
    path.write_text("\n".join(["dose_mJ_per_cm2,thickness_um", *rows]) + "\n", encoding="utf-8")
    return path


def test_thicknesses_in_mm_under_a_header_in_um_are_warned_of(tmp_path: Path) -> None:
    wrong = curve_of_discs(read(discs(tmp_path / "wrong.csv", unit_um=1000.0)))
    assert any("check the unit of the thickness" in one for one in wrong.warnings)
    right = curve_of_discs(read(discs(tmp_path / "right.csv")))
    assert not any("check the unit" in one for one in right.warnings)


def test_swapped_columns_of_a_cut_back_are_warned_of(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    pairs = [(length, 10 ** (-length / 50) * rng.normal(1.0, 0.01)) for length in (10, 20, 30, 40, 50, 60)]
    told = []
    for header in ("length_mm,power_mW", "power_mW,length_mm"):
        file = tmp_path / f"{header[0]}.csv"
        file.write_text("\n".join([header, *(f"{a},{b:.5f}" for a, b in pairs)]) + "\n", encoding="utf-8")
        told.append(any("check which column is the length" in one for one in guide_loss(read(file)).warnings))
    assert told == [False, True]


@pytest.mark.parametrize(
    ("print_", "told"),
    [
        ({"exposure_s": 3.0, "layers": 100_000_000}, "layers = 100000000; must be at most 100000"),
        ({"burn_in_layers": 5, "burn_in_s": 20.0}, "burn_in_layers; needs --exposure-s"),
    ],
)
def test_layers_that_no_print_has(print_: dict[str, Any], told: str) -> None:
    with pytest.raises(SpecError, match=told):
        CureOptions(irradiance_mW_per_cm2=13.0, layer_um=50.0, **print_)


def test_spectra_without_exposures_are_told_what_to_have(tmp_path: Path) -> None:
    file = tmp_path / "layers.csv"
    file.write_text("wavelength_nm,film a,film b\n400,0.9,0.9\n500,0.9,0.9\n", encoding="utf-8")
    with pytest.raises(DataError, match="columns exposure_s, wavelength_nm and T"):
        exposures([file])
