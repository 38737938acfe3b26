"""Files that are not images, lie about their size or were damaged: one line each, without taking memory."""

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


def tried(path: Path) -> Image | str:
    """The image, or the words of its refusal; any other error is raised."""
    try:
        return read_image(path, 2.0)
    except SolenError as refused:
        return str(refused)


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
def test_an_image_too_large_is_refused_from_its_header(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(LARGE[name])
    with pytest.raises(SolenError):
        read_image(path, 2.0)  # whatever is loaded lazily is loaded here
    tracemalloc.start()
    try:
        with pytest.raises(SolenError) as refused:
            read_image(path, 2.0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 5e6  # bytes; the smallest of these images would take 100 MB
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", [name for name in LARGE if name != "samples.tif"])
def test_it_says_how_large_and_what_to_do(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(LARGE[name])
    with pytest.raises(SolenError, match=r"megapixels.*crop"):
        read_image(path, 2.0)


NONE = {
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


@pytest.mark.parametrize("name", NONE)
def test_what_is_no_image_is_refused_in_one_line(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(NONE[name])
    with pytest.raises(SolenError) as refused:
        read_image(path, 2.0)
    assert path.name in str(refused.value)
    assert "\n" not in str(refused.value)


def test_an_animation_is_refused_by_the_number_of_its_frames(tmp_path: Path) -> None:
    from PIL import Image as Pillow

    frames = [Pillow.fromarray(small_levels(seed)) for seed in range(3)]
    for name in ("moving.gif", "moving.png", "moving.webp"):
        path = tmp_path / name
        frames[0].save(path, save_all=True, append_images=frames[1:])
        with pytest.raises(SolenError, match="3 frames"):
            read_image(path, 2.0)


@pytest.mark.parametrize("name", originals())
def test_an_image_cut_short_is_refused(name: str, tmp_path: Path) -> None:
    """Where it lost pixels: an image half of which is black has an edge that is none."""
    data = originals()[name]
    path = tmp_path / name
    for share in (0.1, 0.3, 0.5, 0.7, 0.9):
        path.write_bytes(data[: int(share * len(data))])
        found = tried(path)
        assert isinstance(found, str) or np.array_equal(np.rint(255 * found.grey), small_levels())


def test_a_list_of_pages_that_runs_in_a_circle_ends(tmp_path: Path) -> None:
    path = tmp_path / "looped.tif"
    path.write_bytes(looped_tiff())
    found = tried(path)
    assert "\n" not in found if isinstance(found, str) else found.shape == (48, 64)


def test_a_header_of_more_rows_or_columns_than_there_are_data_is_refused(tmp_path: Path) -> None:
    """Decoders fill what is missing, in black or in grey, and say nothing."""
    data = bytearray(originals()["deflated.tif"])
    with tifffile.TiffFile(io.BytesIO(bytes(data))) as opened:
        place, order = opened.pages.first.tags["ImageLength"].valueoffset, opened.byteorder
    data[place : place + 2] = (4800).to_bytes(2, "little" if order == "<" else "big")
    jpeg = bytearray(originals()["whole.jpg"])
    size = next(jpeg.find(bytes([0xFF, kind])) for kind in (0xC0, 0xC2) if bytes([0xFF, kind]) in jpeg) + 5
    jpeg[size + 2 : size + 4] = (9536).to_bytes(2, "big")
    for name, damaged, named in (("rows.tif", data, "1 of 100 parts"), ("wide.jpg", jpeg, "before its last rows")):
        (tmp_path / name).write_bytes(damaged)
        found = tried(tmp_path / name)
        assert isinstance(found, str)
        assert named in found


def fuzzed(folder: Path, name: str, count: int, seed: int) -> tuple[int, list[float]]:
    """How many damaged files were read all the same, and the time that each took; any other error is raised.

    What is read has no more pixels than the undamaged image, up to a factor: no header makes it work without bounds.
    """
    rng = np.random.default_rng(seed)
    data, path, read, seconds = originals()[name], folder / name, 0, []
    for damaged in mutations(data, count, rng):
        path.write_bytes(damaged)
        started = time.monotonic()
        found = tried(path)
        seconds.append(time.monotonic() - started)
        if isinstance(found, str):
            assert "\n" not in found
        else:
            read += 1
            assert np.isfinite(found.grey).all()
            assert found.grey.ndim == 2
            assert found.grey.size <= MAX_LARGER * small_levels().size
    return read, seconds


MAX_LARGER = 8


@pytest.mark.parametrize("name", originals())
def test_damaged_files_are_read_or_refused_and_nothing_else(name: str, tmp_path: Path) -> None:
    read, _ = fuzzed(tmp_path, name, 60, seed=1)
    assert read < 60


@pytest.mark.evidence
@pytest.mark.parametrize("name", originals())
def test_thousands_of_damaged_files(name: str, tmp_path: Path) -> None:
    read, seconds = fuzzed(tmp_path, name, 4000, seed=2)
    slowest = max(seconds) / np.median(seconds)
    print(f"{name}: 4000 damaged files, {4000 - read} refused, {read} read, the slowest took {slowest:.0f} medians")
    assert read < 4000


def test_a_damaged_tiff_says_nothing_beside_its_refusal(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "cut.ome.tif"
    path.write_bytes(originals()["whole.ome.tif"][:2000])
    assert isinstance(tried(path), str)
    assert caplog.records == []
