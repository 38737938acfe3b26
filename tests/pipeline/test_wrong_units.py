"""Mistakes of a first table: swapped columns, wrong units, numbers that no print has."""

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
    right = curve_of_discs(read(discs(tmp_path / "right.csv")))
    assert f"mm under a header in µm: Dp would be {right.Dp_um:.3g} µm" in wrong.warnings[0]
    assert not any("header" in one for one in right.warnings)


def guides(path: Path, header: str, reading: Callable[[float], float], scale: float = 1.0) -> Path:
    """Noisy guides of 1.3 dB/cm, read in some way."""
    rng = np.random.default_rng(6)
    rows = [f"{mm * scale},{reading(10 ** (-0.013 * mm) * rng.normal(1, 0.01)):.5f}" for mm in (10, 20, 30, 40, 50, 60)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def test_lengths_in_mm_under_a_header_in_um_are_guessed_first(tmp_path: Path) -> None:
    found = guide_loss(read(guides(tmp_path / "a.csv", "length_um,power_mW", lambda power: power)))
    assert "look like values in mm under a header in µm: the loss would be 1.3" in found.warnings[0]


def test_voltages_that_fall_with_light_are_refused_until_the_dark_one_is_stated(tmp_path: Path) -> None:
    file = guides(tmp_path / "a.csv", "length_mm,voltage_V", lambda power: 5.0 - 4.0 * power)
    with pytest.raises(DataError, match=r"light lowers the voltage.*--dark X, where X is 4.\d+ V or above"):
        guide_loss(read(file))
    assert guide_loss(read(file), CutbackOptions(dark=5.0)).loss_dB_per_cm == pytest.approx(1.3, abs=0.05)


@pytest.mark.parametrize(
    ("header", "names", "scale", "told"),
    [
        ("wavelength_nm,T,R", "TR", 1.0, ""),
        ("wavelength_nm,T,R", "RT", 1.0, "appear to be swapped: as named they give .*, swapped 1.49"),
        ("wavelength_nm,T (%),R (%)", "RT", 100.0, "appear to be swapped"),
        ("wavelength_nm,T (%),R (%)", "TR", 1.0, "fractions under a header in %: .* as fractions 1.49"),
        ("wavelength_nm,T (%)", "T", 1.0, "fractions under a header in %: .* as fractions 1.49"),
        ("wavelength_nm,T (%)", "T", 100.0, ""),
    ],
)
def test_spectra_that_make_sense_only_otherwise_are_refused(
    header: str, names: str, scale: float, told: str, tmp_path: Path
) -> None:
    rng = np.random.default_rng(1)
    rows = []
    for nm in range(500, 900, 10):
        r, t = (float(one) * scale * rng.normal(1.0, 1e-3) for one in forward(1.49, 1e-6, 25.0, nm))
        rows.append(",".join([str(nm), *(f"{t if name == 'T' else r:.6f}" for name in names)]))
    file = tmp_path / "a.csv"
    file.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    options = IndexOptions(thickness_um=25.0, baseline="air")
    if told:
        with pytest.raises(DataError, match=told):
            index_of_layer(read(file), options)
    else:
        assert np.nanmedian(index_of_layer(read(file), options).n) == pytest.approx(1.49, abs=5e-3)


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


def test_spectra_without_exposures_are_refused_with_what_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "layers.csv"
    file.write_text("wavelength_nm,film a,film b\n400,0.9,0.9\n500,0.9,0.9\n", encoding="utf-8")
    with pytest.raises(DataError, match="columns exposure_s, wavelength_nm and T"):
        exposures([file])
