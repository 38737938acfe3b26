"""Images of all kinds become grey values with a scale, or are rejected with the reason."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image as Pillow
from PIL import PngImagePlugin

from solen.errors import DataError, SolenError, SpecError
from solen.metrology import read_image

RAMP = np.tile(np.linspace(10, 240, 64).astype(np.uint8), (48, 1))


def save(path: Path, values: NDArray[Any] = RAMP, **options: Any) -> Path:
    tifffile.imwrite(path, values, **options)
    return path


def error_of(path: Path, um_per_px: float | None = None, error: type[SolenError] = DataError) -> str:
    with pytest.raises(error) as raised:
        read_image(path, um_per_px)
    assert "\n" not in str(raised.value)
    return str(raised.value)


def test_scale_of_ome_tiff(tmp_path: Path) -> None:
    metadata = {"axes": "YX", "PhysicalSizeX": 0.65, "PhysicalSizeXUnit": "µm", "PhysicalSizeY": 0.65}
    image = read_image(save(tmp_path / "a.ome.tif", metadata=metadata | {"PhysicalSizeYUnit": "µm"}))
    assert image.um_per_px == pytest.approx(0.65)
    assert image.scale.origin == "OME-XML PhysicalSizeX"
    assert image.shape == (48, 64)
    assert image.bits == 8
    np.testing.assert_allclose(image.grey, RAMP / 255.0)
    assert image.provenance.format == "ome-tiff"


def test_ome_sizes_in_other_units(tmp_path: Path) -> None:
    metadata = {"axes": "YX", "PhysicalSizeX": 650.0, "PhysicalSizeXUnit": "nm"}
    metadata |= {"PhysicalSizeY": 650.0, "PhysicalSizeYUnit": "nm"}
    assert read_image(save(tmp_path / "a.ome.tif", metadata=metadata)).um_per_px == pytest.approx(0.65)


@pytest.mark.parametrize("unit", ["um", "micron", "\\u00B5m"])
def test_scale_of_imagej_tiff(tmp_path: Path, unit: str) -> None:
    path = save(tmp_path / "a.tif", imagej=True, resolution=(0.5, 0.5), metadata={"unit": unit})
    image = read_image(path)
    assert image.um_per_px == pytest.approx(2.0)
    assert image.scale.origin == "ImageJ"


def test_imagej_without_unit_has_no_scale(tmp_path: Path) -> None:
    assert "--um-per-px" in error_of(save(tmp_path / "a.tif", imagej=True, resolution=(1.0, 1.0)))


def test_uses_fine_resolution_tag_with_warning(tmp_path: Path) -> None:
    image = read_image(save(tmp_path / "a.tif", resolution=(5000.0, 5000.0), resolutionunit="CENTIMETER"))
    assert image.um_per_px == pytest.approx(2.0)
    assert any("TIFF XResolution" in warning for warning in image.warnings)


@pytest.mark.parametrize("dpi", [72, 96, 300, 600, 1200])
def test_print_resolution_is_not_a_scale(tmp_path: Path, dpi: int) -> None:
    path = save(tmp_path / "a.tif", resolution=(dpi, dpi), resolutionunit="INCH")
    assert f"{dpi} dpi" in error_of(path)
    assert read_image(path, 2.0).um_per_px == 2.0
    for suffix in ("png", "jpg"):
        Pillow.fromarray(RAMP).save(tmp_path / f"a.{suffix}", dpi=(dpi, dpi))
        assert "dpi" in error_of(tmp_path / f"a.{suffix}")


def test_image_without_scale_names_option(tmp_path: Path) -> None:
    for suffix in ("png", "jpg", "bmp", "tif"):
        path = tmp_path / f"a.{suffix}"
        Pillow.fromarray(RAMP).save(path)
        assert "--um-per-px" in error_of(path)


def test_scale_of_png_in_metres(tmp_path: Path) -> None:
    Pillow.fromarray(RAMP).save(tmp_path / "a.png", dpi=(12_700, 12_700))
    assert read_image(tmp_path / "a.png").um_per_px == pytest.approx(2.0, rel=1e-4)


def test_specified_scale_takes_precedence_over_tag(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", imagej=True, resolution=(0.5, 0.5), metadata={"unit": "um"})
    close, distant = read_image(path, 2.01), read_image(path, 2.1)
    assert close.um_per_px == 2.01
    assert not close.warnings
    assert distant.um_per_px == 2.1
    assert any("ImageJ specifies 2 (+5.0 %)" in warning for warning in distant.warnings)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), 1e9])
def test_rejects_invalid_scale(tmp_path: Path, bad: float) -> None:
    assert "um_per_px" in error_of(save(tmp_path / "a.tif"), bad, SpecError)


def test_rejects_pixels_that_are_not_square(tmp_path: Path) -> None:
    path = save(tmp_path / "a.tif", resolution=(5000.0, 5100.0), resolutionunit="CENTIMETER")
    assert "not square" in error_of(path)


@pytest.mark.parametrize(
    ("axes", "shape", "name"),
    [("ZYX", (7, 48, 64), "z-stack of 7 planes"), ("TYX", (5, 48, 64), "5 times"), ("CYX", (2, 48, 64), "2 channels")],
)
def test_rejects_several_planes_by_name(tmp_path: Path, axes: str, shape: tuple[int, ...], name: str) -> None:
    path = save(tmp_path / "a.ome.tif", np.zeros(shape, np.uint8), metadata={"axes": axes}, photometric="minisblack")
    assert name in error_of(path, 2.0)


def test_rejects_animation(tmp_path: Path) -> None:
    frames = [Pillow.fromarray(RAMP), Pillow.fromarray(RAMP[:, ::-1].copy())]
    frames[0].save(tmp_path / "a.gif", save_all=True, append_images=frames[1:])
    assert "2 frames" in error_of(tmp_path / "a.gif", 2.0)


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_rejects_too_large_image(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    Pillow.new("1", (10_000, 10_000)).save(path)
    assert "100 megapixels" in error_of(path, 2.0)


def test_reads_sixteen_bits_colour_and_inverted_grey(tmp_path: Path) -> None:
    deep = (RAMP.astype(np.uint16) * 257).astype(np.uint16)
    assert read_image(save(tmp_path / "a.tif", deep), 1.0).bits == 16
    np.testing.assert_allclose(read_image(tmp_path / "a.tif", 1.0).grey, RAMP / 255.0)
    Pillow.fromarray(deep).save(tmp_path / "deep.png")
    np.testing.assert_allclose(read_image(tmp_path / "deep.png", 1.0).grey, RAMP / 255.0)
    inverted = read_image(save(tmp_path / "b.tif", RAMP, photometric="miniswhite"), 1.0)
    np.testing.assert_allclose(inverted.grey, 1.0 - RAMP / 255.0)
    colour = np.stack([RAMP, RAMP // 2, RAMP // 4], axis=2)
    read = read_image(save(tmp_path / "c.tif", colour, photometric="rgb"), 1.0)
    np.testing.assert_allclose(read.grey, colour @ [0.2126, 0.7152, 0.0722] / 255.0)
    assert any("coloured" in warning for warning in read.warnings)


@pytest.mark.parametrize("compression", ["tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg"])
def test_reads_compressed_tiff(tmp_path: Path, compression: str) -> None:
    Pillow.fromarray(RAMP).save(tmp_path / "a.tif", compression=compression)
    np.testing.assert_allclose(read_image(tmp_path / "a.tif", 1.0).grey, RAMP / 255.0, atol=0.02)


def test_floating_point_levels_are_unchanged(tmp_path: Path) -> None:
    values = (RAMP / 255.0).astype(np.float32)
    np.testing.assert_allclose(read_image(save(tmp_path / "a.tif", values), 1.0).grey, values)
    values[3, 3] = np.nan
    assert "not finite" in error_of(save(tmp_path / "b.tif", values), 1.0)


def test_applies_exif_rotation(tmp_path: Path) -> None:
    exif = Pillow.Exif()
    exif[0x0112] = 6  # rotate clockwise by 90°
    Pillow.fromarray(RAMP).save(tmp_path / "a.jpg", exif=exif, quality=95)
    turned = read_image(tmp_path / "a.jpg", 1.0).grey
    assert turned.shape == (64, 48)
    assert turned[0].mean() < turned[-1].mean()


def test_simulated_image_is_marked(tmp_path: Path) -> None:
    metadata = PngImagePlugin.PngInfo()
    metadata.add_text("Description", "simulated micrograph")
    Pillow.fromarray(RAMP).save(tmp_path / "a.png", pnginfo=metadata)
    assert read_image(tmp_path / "a.png", 1.0).provenance.simulated
    assert read_image(save(tmp_path / "a.tif", description="simulated micrograph"), 1.0).provenance.simulated


def test_reports_saturated_camera(tmp_path: Path) -> None:
    bright = np.minimum(RAMP.astype(int) + 60, 255).astype(np.uint8)
    image = read_image(save(tmp_path / "a.tif", bright), 1.0)
    assert image.ceiling == 1.0
    assert any("is saturated" in warning for warning in image.warnings)


@pytest.mark.parametrize("content", [b"", b"no image", b"II*\0junk", b"\x89PNG\r\n\x1a\nrest", b"\xff\xd8\xff\xe0zz"])
def test_damaged_file_gives_one_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.tif"
    path.write_bytes(content)
    assert error_of(path, 1.0)


def test_truncated_file_gives_one_line(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (200, 200)).astype(np.uint8)
    for suffix in ("png", "jpg", "tif"):
        path = tmp_path / f"a.{suffix}"
        Pillow.fromarray(noise).save(path)
        path.write_bytes(path.read_bytes()[:-9000])
        assert error_of(path, 1.0)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert "no such file" in error_of(tmp_path / "none.tif")
    assert "folder" in error_of(tmp_path)
