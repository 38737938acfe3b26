"""Files that are not images, claim a wrong size or are damaged: one-line errors, without allocating memory."""

import io
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import tifffile

from solen.errors import SolenError
from solen.metrology import Image, read_image
from tests.metrology.damaged_support import (
    jpeg_claiming,
    looped_tiff,
    mutations,
    originals,
    png_claiming,
    small_levels,
    tiff_claiming,
)
from tests.metrology.render.camera import png, tiff


def read_or_error(path: Path) -> Image | str:
    """Return the image or the text of its error; any unexpected error is raised."""
    try:
        return read_image(path, 2.0)
    except SolenError as error:
        return str(error)


LARGE = {
    "a.png": png_claiming(20_000, 20_000),
    "just.png": png_claiming(10_000, 10_000),
    "wide.png": png_claiming(2**31 - 1, 2**31 - 1, bits=16, colour=6),
    "a.tif": tiff_claiming(20_000, 20_000),
    "big-endian.tif": tiff_claiming(40_000, 40_000, big=True),
    "samples.tif": tiff_claiming(9_000, 9_000, samples=60_000, bits=64),
    "wide.tif": tiff_claiming(2**32 - 1, 2**32 - 1),
    "a.jpg": jpeg_claiming(65_000, 65_000),
}


@pytest.mark.parametrize("name", LARGE)
def test_rejects_large_image_from_header(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(LARGE[name])
    with pytest.raises(SolenError):
        read_image(path, 2.0)  # so that lazy imports are done
    tracemalloc.start()
    try:
        with pytest.raises(SolenError) as error:
            read_image(path, 2.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 5e6  # bytes; the smallest of these images would take 100 MB
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", [name for name in LARGE if name != "samples.tif"])
def test_error_names_size_and_remedy(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(LARGE[name])
    with pytest.raises(SolenError, match=r"megapixels.*crop"):
        read_image(path, 2.0)


REJECTED = {
    "empty.png": b"",
    "text.png": b"this is no image\n" * 40,
    "zeros.tif": bytes(4000),
    "only-magic.tif": b"II*\0",
    "only-magic.png": b"\x89PNG\r\n\x1a\n",
    "pixel.png": png(np.array([[7]], np.uint8), 2.0),
    "row.png": png(np.arange(200, dtype=np.uint8)[None, :], 2.0),
    "no-width.png": png_claiming(0, 100),
    "no-width.tif": tiff_claiming(0, 100),
    "not-a-number.tif": tiff(np.full((64, 64), np.nan, np.float32), 2.0),
    "some-not-numbers.tif": tiff(np.where(np.eye(64) > 0, np.nan, 0.5).astype(np.float32), 2.0),
    "infinite.tif": tiff(np.where(np.eye(64) > 0, np.inf, 0.5).astype(np.float32), 2.0),
    "pages.tif": tiff(np.stack([small_levels(1), small_levels(2), small_levels(3)]), 2.0),
    "complex.tif": tiff(small_levels().astype(np.complex64), 2.0),
}


@pytest.mark.parametrize("name", REJECTED)
def test_rejects_invalid_image_in_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(REJECTED[name])
    with pytest.raises(SolenError) as error:
        read_image(path, 2.0)
    assert path.name in str(error.value)
    assert "\n" not in str(error.value)


def test_rejects_animation_with_number_of_frames(tmp_path: Path) -> None:
    from PIL import Image as Pillow

    frames = [Pillow.fromarray(small_levels(seed)) for seed in range(3)]
    for name in ("moving.gif", "moving.png", "moving.webp"):
        path = tmp_path / name
        frames[0].save(path, save_all=True, append_images=frames[1:])
        with pytest.raises(SolenError, match="3 frames"):
            read_image(path, 2.0)


@pytest.mark.parametrize("name", originals())
def test_rejects_truncated_image(name: str, tmp_path: Path) -> None:
    """If pixels are lost, the border of the black part would look like an edge."""
    data = originals()[name]
    path = tmp_path / name
    for fraction in (0.1, 0.3, 0.5, 0.7, 0.9):
        path.write_bytes(data[: int(fraction * len(data))])
        outcome = read_or_error(path)
        assert isinstance(outcome, str) or np.array_equal(np.rint(255 * outcome.grey), small_levels())


def test_circular_list_of_pages_terminates(tmp_path: Path) -> None:
    path = tmp_path / "looped.tif"
    path.write_bytes(looped_tiff())
    outcome = read_or_error(path)
    assert "\n" not in outcome if isinstance(outcome, str) else outcome.shape == (48, 64)


def test_rejects_header_that_claims_missing_data(tmp_path: Path) -> None:
    """Decoders fill missing data with black or grey, without a warning."""
    data = bytearray(originals()["deflated.tif"])
    with tifffile.TiffFile(io.BytesIO(bytes(data))) as opened:
        position, order = opened.pages.first.tags["ImageLength"].valueoffset, opened.byteorder
    data[position : position + 2] = (4800).to_bytes(2, "little" if order == "<" else "big")
    jpeg = bytearray(originals()["whole.jpg"])
    size = next(jpeg.find(bytes([0xFF, kind])) for kind in (0xC0, 0xC2) if bytes([0xFF, kind]) in jpeg) + 5
    jpeg[size + 2 : size + 4] = (9536).to_bytes(2, "big")
    for name, damaged, part in (("rows.tif", data, "1 of 100 parts"), ("wide.jpg", jpeg, "before its last rows")):
        (tmp_path / name).write_bytes(damaged)
        outcome = read_or_error(tmp_path / name)
        assert isinstance(outcome, str)
        assert part in outcome


def read_damaged(folder: Path, name: str, count: int, seed: int) -> tuple[int, list[float]]:
    """Return the number of damaged files that were read, and the time each took; any unexpected error is raised.

    An image that is read has at most `MAX_GROWTH` times the pixels of the intact one: no header causes unlimited work.
    """
    rng = np.random.default_rng(seed)
    data, path, read, seconds = originals()[name], folder / name, 0, []
    for damaged in mutations(data, count, rng):
        path.write_bytes(damaged)
        started = time.monotonic()
        outcome = read_or_error(path)
        seconds.append(time.monotonic() - started)
        if isinstance(outcome, str):
            assert "\n" not in outcome
        else:
            read += 1
            assert np.isfinite(outcome.grey).all()
            assert outcome.grey.ndim == 2
            assert outcome.grey.size <= MAX_GROWTH * small_levels().size
    return read, seconds


MAX_GROWTH = 8


@pytest.mark.parametrize("name", originals())
def test_damaged_files_are_read_or_rejected(name: str, tmp_path: Path) -> None:
    read, _ = read_damaged(tmp_path, name, 60, seed=1)
    assert read < 60


@pytest.mark.evidence
@pytest.mark.parametrize("name", originals())
def test_thousands_of_damaged_files(name: str, tmp_path: Path) -> None:
    read, seconds = read_damaged(tmp_path, name, 4000, seed=2)
    slowest = max(seconds) / np.median(seconds)
    print(f"{name}: 4000 damaged files, {4000 - read} refused, {read} read, the slowest took {slowest:.0f} medians")
    assert read < 4000


def test_damaged_tiff_logs_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "cut.ome.tif"
    path.write_bytes(originals()["whole.ome.tif"][:2000])
    assert isinstance(read_or_error(path), str)
    assert caplog.records == []
