"""PNG, JPEG, BMP and others, by Pillow."""

import io
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, UnidentifiedImageError
from PIL import Image as Pillow

from solen.errors import DataError
from solen.metrology.planes import Plane, brightness, check_size, is_simulated, upright
from solen.metrology.scale import Tag

BITS = {"1": 1, "L": 8, "LA": 8, "P": 8, "RGB": 8, "RGBA": 8, "CMYK": 8, "YCbCr": 8, "I;16": 16, "I;16B": 16, "I": 16}
PLAIN = {"1": "L", "LA": "RGBA", "P": "RGBA", "CMYK": "RGB", "YCbCr": "RGB"}
EXIF_UM = {2: 25_400.0, 3: 10_000.0}
LOSSY = {"JPEG", "MPO", "WEBP"}


def read(file: str, data: bytes) -> Plane:
    """Plane of a picture; `DataError` where it is none, has several frames, or is damaged."""
    with _readable(file), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Pillow warns of size below the limit that is checked here
        with Pillow.open(io.BytesIO(data)) as opened:
            check_size(file, *opened.size)
            frames = getattr(opened, "n_frames", 1)
            if frames > 1 and opened.format != "MPO":  # of a phone's MPO the first is the picture
                raise DataError(file, limit=f"holds {frames} frames", remedy="export the one to measure as TIFF or PNG")
            tags, orientation = _tags(opened), int(opened.getexif().get(ExifTags.Base.Orientation, 1))
            grey, bits, said = _grey(file, opened)
            texts = {
                key: value for key, value in opened.info.items() if isinstance(key, str) and isinstance(value, str)
            }
            kind = opened.format or "picture"
            instrument, date = _camera(opened)
    if kind in LOSSY:
        said = (*said, f"{kind} is compressed with loss: its blocks of 8 pixels shift edges; TIFF or PNG does not")
    return Plane(
        upright(grey, orientation),
        bits,
        tags,
        kind.lower(),
        instrument,
        date,
        texts,
        is_simulated(*texts.values()),
        said,
    )


def _grey(file: str, opened: Pillow.Image) -> tuple[NDArray[np.float64], int | None, tuple[str, ...]]:
    mode = opened.mode
    plain = opened.convert(PLAIN[mode]) if mode in PLAIN else opened
    values = np.asarray(plain)
    if mode == "F":
        return float_levels(file, values), None, ()
    bits = BITS.get(mode)
    if bits is None:
        raise DataError(file, value=mode, limit="is a kind of pixel that is not read", remedy="save it as 8 or 16 bits")
    top = 65_535.0 if bits == 16 else 255.0
    levels = values.astype(np.float64) / top
    if levels.ndim == 2:
        return levels, bits, ()
    if levels.shape[2] == 4:
        if float(levels[..., 3].min()) < 1.0:
            raise DataError(file, limit="is transparent in places", remedy="save it without an alpha channel")
        levels = levels[..., :3]
    grey, said = brightness(levels)
    return grey, bits, said


def float_levels(file: str, values: NDArray[np.generic]) -> NDArray[np.float64]:
    """Numbers with a point as levels from 0 to 1: as they are where they lie there, else from least to greatest."""
    levels = values.astype(np.float64)
    if not np.isfinite(levels).all():
        raise DataError(file, limit="holds pixels that are not finite", remedy="export it again")
    low, high = float(levels.min()), float(levels.max())
    return levels if low >= 0.0 and high <= 1.0 else (levels - low) / max(high - low, 1e-300)


def _tags(opened: Pillow.Image) -> tuple[Tag, ...]:
    """What the file says of its resolution: PNG pHYs and JFIF density as dpi, Exif's own."""
    found = []
    kind = opened.format or "picture"
    dpi = opened.info.get("dpi")
    if dpi is not None and min(dpi) > 0.0:
        name = {"PNG": "PNG pHYs", "JPEG": "JPEG density"}.get(kind, f"{kind} resolution")
        found.append(Tag(name, 25_400.0 / float(dpi[0]), 25_400.0 / float(dpi[1])))
    exif = opened.getexif()
    x, y = (exif.get(tag) for tag in (ExifTags.Base.XResolution, ExifTags.Base.YResolution))
    per_unit = EXIF_UM.get(exif.get(ExifTags.Base.ResolutionUnit, 2))
    if x and y and per_unit is not None and not math.isnan(float(x)) and float(x) > 0.0 and float(y) > 0.0:
        found.append(Tag("Exif XResolution", per_unit / float(x), per_unit / float(y)))
    return tuple(found)


def _camera(opened: Pillow.Image) -> tuple[str, str]:
    exif = opened.getexif()
    words = (str(exif.get(tag, "")).strip() for tag in (ExifTags.Base.Make, ExifTags.Base.Model))
    return " ".join(word for word in words if word), str(exif.get(ExifTags.Base.DateTime, ""))


@contextmanager
def _readable(file: str) -> Iterator[None]:
    """Turn what Pillow raises into one line; its decoders raise nearly anything for a damaged file."""
    try:
        yield
    except DataError:
        raise
    except Pillow.DecompressionBombError:
        raise DataError(file, limit="has far more than 100 megapixels", remedy="crop it to the lens") from None
    except UnidentifiedImageError:
        raise DataError(file, limit="is no picture that can be read", remedy="save it as TIFF or PNG") from None
    except Exception as bad:
        raise DataError(file, limit=f"is damaged: {bad}", remedy="export it again") from None
