"""Typical mistakes in tables and options: swapped columns, wrong units, impossible numbers."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DataError, SpecError
from solen.material.cure import CureOptions, curve_of_discs
from solen.material.index.layer import index_of_layer
from solen.material.index.options import IndexOptions
from solen.material.index.stack import forward
from solen.material.loss import CutbackOptions, guide_loss
from solen.pipeline.resin.exposures import exposures
from solen.recording import read


def discs(path: Path, unit_um: float = 1.0) -> Path:
    """Write noisy discs of Dp = 200 µm and Ec = 10 mJ/cm², with thicknesses in `unit_um` under a header in µm."""
    rng = np.random.default_rng(5)
    rows = [
        f"{dose},{200.0 * math.log(dose / 10.0) * rng.normal(1.0, 0.03) / unit_um:.6f}"
        for dose in (15, 20, 40, 80)
        for _ in range(3)
    ]
    path.write_text("\n".join(["dose_mJ_per_cm2,thickness_um", *rows]) + "\n", encoding="utf-8")
    return path


def test_warns_of_thicknesses_in_mm_under_a_header_in_um(tmp_path: Path) -> None:
    wrong = curve_of_discs(read(discs(tmp_path / "wrong.csv", unit_um=1000.0)))
    right = curve_of_discs(read(discs(tmp_path / "right.csv")))
    assert "mm under a header in µm" in wrong.warnings[0]
    assert f"{right.Dp_um:.3g} µm" in wrong.warnings[0]
    assert not any("header" in line for line in right.warnings)


def guides(path: Path, header: str, reading: Callable[[float], float], scale: float = 1.0) -> Path:
    """Write noisy guides of 1.3 dB/cm, whose power is converted by ``reading``."""
    rng = np.random.default_rng(6)
    rows = [f"{mm * scale},{reading(10 ** (-0.013 * mm) * rng.normal(1, 0.01)):.5f}" for mm in (10, 20, 30, 40, 50, 60)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_warns_first_of_lengths_in_mm_under_a_header_in_um(tmp_path: Path) -> None:
    loss = guide_loss(read(guides(tmp_path / "a.csv", "length_um,power_mW", lambda power: power)))
    assert "mm under a header in µm" in loss.warnings[0]
    assert "1.3" in loss.warnings[0]


def test_voltages_that_fall_with_light_require_the_dark_reading(tmp_path: Path) -> None:
    file = guides(tmp_path / "a.csv", "length_mm,voltage_V", lambda power: 5.0 - 4.0 * power)
    with pytest.raises(DataError, match=r"light lowers the voltage.* 4.\d+ V, with --dark"):
        guide_loss(read(file))
    assert guide_loss(read(file), CutbackOptions(dark=5.0)).loss_dB_per_cm == pytest.approx(1.3, abs=0.05)


@pytest.mark.parametrize(
    ("header", "names", "scale", "line"),
    [
        ("wavelength_nm,T,R", "TR", 1.0, ""),
        ("wavelength_nm,T,R", "RT", 1.0, r"swapped: .*, swapped n = 1.49"),
        ("wavelength_nm,T (%),R (%)", "RT", 100.0, "swapped"),
        ("wavelength_nm,T (%),R (%)", "TR", 1.0, r"fractions under a header in %: .* as fractions n = 1.49"),
        ("wavelength_nm,T (%)", "T", 1.0, r"fractions under a header in %: .* as fractions n = 1.49"),
        ("wavelength_nm,T (%)", "T", 100.0, ""),
    ],
)
def test_refuses_swapped_columns_and_wrong_units_of_spectra(
    header: str, names: str, scale: float, line: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(1)
    rows = []
    for nm in range(500, 900, 10):
        r, t = (float(value) * scale * rng.normal(1.0, 1e-3) for value in forward(1.49, 1e-6, 25.0, nm))
        rows.append(",".join([str(nm), *(f"{t if name == 'T' else r:.6f}" for name in names)]))
    file = tmp_path / "a.csv"
    file.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    options = IndexOptions(thickness_um=25.0, baseline="air")
    if line:
        with pytest.raises(DataError, match=line):
            index_of_layer(read(file), options)
    else:
        assert np.nanmedian(index_of_layer(read(file), options).n) == pytest.approx(1.49, abs=5e-3)


def test_warns_of_swapped_columns_of_a_cut_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    pairs = [(length, 10 ** (-length / 50) * rng.normal(1.0, 0.01)) for length in (10, 20, 30, 40, 50, 60)]
    warned = []
    for header in ("length_mm,power_mW", "power_mW,length_mm"):
        file = tmp_path / f"{header[0]}.csv"
        file.write_text("\n".join([header, *(f"{a},{b:.5f}" for a, b in pairs)]) + "\n", encoding="utf-8")
        warned.append(any("check which column is the length" in line for line in guide_loss(read(file)).warnings))
    assert warned == [False, True]


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"exposure_s": 3.0, "layers": 100_000_000}, "layers = 100000000; must be at most 100000"),
        ({"burn_in_layers": 5, "burn_in_s": 20.0}, "burn_in_layers; requires --exposure-s"),
    ],
)
def test_refuses_impossible_layers(options: dict[str, Any], line: str) -> None:
    with pytest.raises(SpecError, match=line):
        CureOptions(irradiance_mW_per_cm2=13.0, layer_um=50.0, **options)


def test_refuses_spectra_without_exposures(tmp_path: Path) -> None:
    file = tmp_path / "layers.csv"
    file.write_text("wavelength_nm,film a,film b\n400,0.9,0.9\n500,0.9,0.9\n", encoding="utf-8")
    with pytest.raises(DataError, match="columns exposure_s, wavelength_nm and T"):
        exposures([file])
