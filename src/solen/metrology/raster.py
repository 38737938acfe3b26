"""Images as one plane of grey values, with the checks common to all formats; Pillow reads PNG, JPEG, BMP and others."""

import io
import math
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, UnidentifiedImageError
from PIL import Image as Pillow

from solen import files
from solen.arrays import FloatArray
from solen.errors import DataError, SolenError
from solen.extras import need
from solen.metrology.scale import Tag
from solen.ranks import Caution, warning

MAX_MB = 1_000
MAX_PIXELS = 100_000_000
MIN_SIDE_PX = 32
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of red, green and blue in the luminance (ITU-R BT.709)."""
MAX_CHANNEL_DIFFERENCE = 0.02
"""Mean difference between the channels above which an image is coloured."""
BITS = {"1": 1, "L": 8, "LA": 8, "P": 8, "RGB": 8, "RGBA": 8, "CMYK": 8, "YCbCr": 8, "I;16": 16, "I;16B": 16, "I": 16}
CONVERTED = {"1": "L", "LA": "RGBA", "P": "RGBA", "CMYK": "RGB", "YCbCr": "RGB"}
EXIF_UM = {2: 25_400.0, 3: 10_000.0}
LOSSY = {"JPEG", "MPO", "WEBP"}
BLOCK, NO_DATA = 8, 128
"""Number of rows in a block of a JPEG, and the value that Pillow gives to pixels without data."""
ORIENTATIONS: dict[int, Callable[[FloatArray], FloatArray]] = {
    2: np.fliplr,
    3: lambda a: np.rot90(a, 2),
    4: np.flipud,
    5: np.transpose,
    6: lambda a: np.rot90(a, -1),
    7: lambda a: np.rot90(a, 2).T,
    8: np.rot90,
}
"""Rotations and reflections that make an image upright, keyed by orientation tag (TIFF 6.0)."""


@dataclass(frozen=True, eq=False)
class Plane:
    """Grey values, shape (rows, columns), 0 to 1 of the file's range, and the metadata of the file."""

    grey: FloatArray
    bits: int | None
    tags: tuple[Tag, ...]
    format: str
    instrument: str = ""
    date: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False
    warnings: tuple[Caution, ...] = ()


def read_bytes(path: Path) -> bytes:
    """Return the bytes of a file; raise `DataError` if it cannot be read, is empty or exceeds `MAX_MB`."""
    return files.read_bytes(path, DataError, max_mb=MAX_MB, remedy="crop it to the part")


def check_size(file: str, columns: int, rows: int) -> None:
    """Raise `DataError` if an image is too large to be decoded or too small to show anything."""
    if columns * rows >= MAX_PIXELS:
        limit = f"has {columns * rows / 1e6:.0f} megapixels ({columns} x {rows}); it must have fewer than 100"
        raise DataError(file, limit=limit, remedy="crop it to the part, or bin it by two and double --um-per-px")
    if min(columns, rows) < MIN_SIDE_PX:
        raise DataError(
            file, limit=f"has {columns} x {rows} pixels; at least {MIN_SIDE_PX} in each direction are needed"
        )


def check_vision(what: str) -> None:
    """Raise `OutputError` if the extra ``vision`` is not installed."""
    need("skimage", "tifffile", "ome_types", what=what)


@contextmanager
def readable(file: str) -> Iterator[None]:
    """Convert any error of a decoder, which may raise almost anything, to a one-line error; suppress warnings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except SolenError:
        raise
    except Pillow.DecompressionBombError:
        raise DataError(file, limit="has far more than 100 megapixels", remedy="crop it to the part") from None
    except UnidentifiedImageError:
        raise DataError(file, limit="is not a readable image", remedy="save it as TIFF or PNG") from None
    except Exception as bad:
        raise DataError(file, limit=f"is damaged: {bad}", remedy="export it again") from None


def luminance(values: FloatArray) -> tuple[FloatArray, tuple[Caution, ...]]:
    """Return the luminance of (rows, columns, 3), and a warning if the image is coloured."""
    spread = float(np.mean(values.max(axis=2) - values.min(axis=2)))
    caution = warning("the image is coloured: its luminance is evaluated, and colour fringes of a lens can shift edges")
    return values @ LUMINANCE, (caution,) if spread > MAX_CHANNEL_DIFFERENCE else ()


def upright(grey: FloatArray, orientation: int) -> FloatArray:
    """Return an image rotated and reflected according to its orientation tag (1 to 8)."""
    return np.ascontiguousarray(ORIENTATIONS[orientation](grey)) if orientation in ORIENTATIONS else grey


def is_simulated(*texts: str) -> bool:
    """Return whether a file is marked as simulated."""
    return any("simulated" in text.casefold() or "synthetic" in text.casefold() for text in texts)


def float_levels(file: str, values: NDArray[np.generic]) -> FloatArray:
    """Return floating-point numbers as levels: unchanged if they are from 0 to 1, otherwise scaled to that range."""
    levels = values.astype(np.float64)
    if not np.isfinite(levels).all():
        raise DataError(file, limit="contains pixels that are not finite", remedy="export it again")
    low, high = float(levels.min()), float(levels.max())
    return levels if low >= 0.0 and high <= 1.0 else (levels - low) / max(high - low, 1e-300)


def read_raster(file: str, data: bytes) -> Plane:
    """Return the plane of an image that Pillow reads; raise `DataError` if it has several frames or is damaged."""
    with readable(file), Pillow.open(io.BytesIO(data)) as opened:
        check_size(file, *opened.size)
        frames = getattr(opened, "n_frames", 1)
        if frames > 1 and opened.format != "MPO":  # the first frame of a phone's MPO is the image
            raise DataError(
                file, limit=f"contains {frames} frames", remedy="export the image to be measured as TIFF or PNG"
            )
        kind, exif = opened.format or "image", opened.getexif()
        tags = _tags(opened, kind)
        grey, bits, cautions = _grey(file, opened)
        texts = {key: value for key, value in opened.info.items() if isinstance(key, str) and isinstance(value, str)}
        camera = (str(exif.get(tag, "")).strip() for tag in (ExifTags.Base.Make, ExifTags.Base.Model))
        if kind in LOSSY:
            lossy = f"{kind} compression is lossy: its blocks of 8 pixels shift edges; save images as TIFF or PNG"
            cautions = (*cautions, warning(lossy))
        return Plane(
            upright(grey, int(exif.get(ExifTags.Base.Orientation, 1))),
            bits,
            tags,
            kind.lower(),
            " ".join(name for name in camera if name),
            str(exif.get(ExifTags.Base.DateTime, "")),
            texts,
            is_simulated(*texts.values()),
            cautions,
        )


def _grey(file: str, opened: Pillow.Image) -> tuple[FloatArray, int | None, tuple[Caution, ...]]:
    mode = opened.mode
    plain = opened.convert(CONVERTED[mode]) if mode in CONVERTED else opened
    values = np.asarray(plain)
    if opened.format in {"JPEG", "MPO"} and np.all(values[-BLOCK:] == NO_DATA):
        raise DataError(file, limit="is damaged: its data end before its last rows", remedy="export it again")
    if mode == "F":
        return float_levels(file, values), None, ()
    bits = BITS.get(mode)
    if bits is None:
        raise DataError(file, value=mode, limit="has an unsupported pixel format", remedy="save it as 8 or 16 bits")
    top = 65_535.0 if bits == 16 else 255.0
    levels = values.astype(np.float64) / top
    if levels.ndim == 2:
        return levels, bits, ()
    if levels.shape[2] == 4:
        if float(levels[..., 3].min()) < 1.0:
            raise DataError(file, limit="is partly transparent", remedy="save it without an alpha channel")
        levels = levels[..., :3]
    grey, cautions = luminance(levels)
    return grey, bits, cautions


def _tags(opened: Pillow.Image, kind: str) -> tuple[Tag, ...]:
    """Return the resolutions recorded in the file: PNG pHYs or JFIF density, which Pillow gives in dpi, and Exif."""
    tags = []
    dpi = opened.info.get("dpi")
    if dpi is not None and min(dpi) > 0.0:
        name = {"PNG": "PNG pHYs", "JPEG": "JPEG density"}.get(kind, f"{kind} resolution")
        tags.append(Tag(name, 25_400.0 / float(dpi[0]), 25_400.0 / float(dpi[1])))
    exif = opened.getexif()
    x, y = (exif.get(tag) for tag in (ExifTags.Base.XResolution, ExifTags.Base.YResolution))
    per_unit = EXIF_UM.get(exif.get(ExifTags.Base.ResolutionUnit, 2))
    if x and y and per_unit is not None and not math.isnan(float(x)) and float(x) > 0.0 and float(y) > 0.0:
        tags.append(Tag("Exif XResolution", per_unit / float(x), per_unit / float(y)))
    return tuple(tags)
