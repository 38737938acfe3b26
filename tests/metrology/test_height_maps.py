"""Height maps: heights from levels, the pixel size, and one-line errors for invalid files."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from solen.errors import DataError, SpecError
from solen.metrology.height_map import read_height_map

RAMP = np.linspace(0.0, 100.0, 40 * 50).reshape(40, 50)


def text(values: Any, separator: str, decimal: str = ".") -> str:
    return "\n".join(separator.join(f"{cell:.4f}".replace(".", decimal) for cell in row) for row in values)


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), ("  ", ".")]
)
def test_reads_text_tables(separator: str, decimal: str, tmp_path: Path) -> None:
    path = tmp_path / "heights.csv"
    path.write_text("# simulated, um\n" + text(RAMP, separator, decimal), encoding="utf-8")
    height_map = read_height_map(path, 1.0, um_per_px=5.0)
    assert height_map.z_mm == pytest.approx(1e-3 * RAMP, abs=1e-7)
    assert height_map.scale.um_per_px == 5.0
    assert height_map.provenance.simulated
    assert height_map.provenance.metadata["z_um_per_level"] == "1"


def test_cells_without_height_are_nan(tmp_path: Path) -> None:
    path = tmp_path / "heights.csv"
    lines = text(RAMP, ",").splitlines()
    lines[3] = "NaN,," + lines[3].split(",", 2)[2]
    path.write_text("\n".join(lines), encoding="utf-8")
    height_map = read_height_map(path, 1.0, um_per_px=5.0)
    assert np.isnan(height_map.z_mm).sum() == 2
    assert np.isfinite(height_map.grey).all()
    assert any("have no height" in line for line in height_map.warnings)


@pytest.mark.parametrize("kind", [np.uint16, np.float32, np.int32, np.float64])
def test_reads_tiffs(kind: Any, tmp_path: Path) -> None:
    path = tmp_path / "heights.tif"
    tifffile.imwrite(path, RAMP.astype(kind), resolution=(1e4 / 4.0, 1e4 / 4.0), resolutionunit="CENTIMETER")
    height_map = read_height_map(path, 0.5)
    assert height_map.z_mm == pytest.approx(0.5e-3 * RAMP.astype(kind), abs=1e-8)
    assert height_map.scale.um_per_px == pytest.approx(4.0)


def tiff(values: Any, **options: Any) -> bytes:
    data = io.BytesIO()
    tifffile.imwrite(data, values, **options)
    return data.getvalue()


REJECTED: dict[str, tuple[str, bytes, str]] = {
    "no scale": ("a.tif", tiff(RAMP.astype(np.float32)), "pixel size"),
    "an image": ("a.tif", tiff(RAMP.astype(np.uint8)), "has 8 bits"),
    "a stack": ("a.tif", tiff(np.stack([RAMP, RAMP]).astype(np.float32), photometric="minisblack"), "2 planes"),
    "colours": ("a.tif", tiff(np.zeros((40, 50, 3), np.uint16), photometric="rgb"), "not a grid of heights"),
    "mostly empty": ("a.tif", tiff(np.where(RAMP < 5, RAMP, np.nan).astype(np.float32)), "5 % of its pixels"),
    "flat": ("a.tif", tiff(np.zeros((40, 50), np.float32)), "same height everywhere"),
    "small": ("a.tif", tiff(np.zeros((4, 5), np.float32)), "at least 32"),
    "damaged": ("a.tif", tiff(RAMP)[:90], "is damaged"),
    "another file": ("a.bin", b"\x89PNG not really", "neither a TIFF nor a table"),
    "empty": ("a.csv", b"", "is empty"),
    "a header": ("a.csv", b"x,y\n" * 40, "at least 32"),
    "words": ("a.csv", "\n".join([",".join(["one"] * 40)] * 40).encode(), "not a height"),
    "ragged": (
        "a.csv",
        (text(RAMP, ",") + "\n1,2").encode(),
        "row 41 contains 2 numbers, whereas the first row contains 50",
    ),
    "no UTF-8": ("a.csv", b"\xff\xfe1,2", "not UTF-8"),
}


@pytest.mark.parametrize("case", REJECTED)
def test_rejects_invalid_height_map(case: str, tmp_path: Path) -> None:
    name, data, part = REJECTED[case]
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(DataError) as error:
        read_height_map(path, 1.0, None if case == "no scale" else 5.0)
    assert part in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("z_um", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_height_of_a_level_is_positive(z_um: float, tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="z_um"):
        read_height_map(tmp_path / "none.tif", z_um, 5.0)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        read_height_map(tmp_path / "none.tif", 1.0, 5.0)
