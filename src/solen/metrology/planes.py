"""One plane of a picture as a reader gives it, and the checks that hold for every format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from solen.errors import DataError
from solen.extras import need
from solen.metrology.scale import Tag

LARGEST_PIXELS = 100_000_000
SMALLEST = 32
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Weights of red, green and blue in brightness (ITU-R BT.709)."""
COLOURED = 0.02
"""Channels that differ by less are those of a grey picture."""


@dataclass(frozen=True)
class Plane:
    """Grey values, shape (rows, columns), 0 to 1 of the file's range, and what the file says of them."""

    grey: NDArray[np.float64]
    bits: int | None
    tags: tuple[Tag, ...]
    format: str
    instrument: str = ""
    date: str = ""
    metadata: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False
    warnings: tuple[str, ...] = ()


def check_size(file: str, columns: int, rows: int) -> None:
    """`DataError` where a picture is too large to be decoded or too small to show anything."""
    if columns * rows >= LARGEST_PIXELS:
        limit = f"has {columns * rows / 1e6:.0f} megapixels ({columns} x {rows}); it must be below 100"
        raise DataError(file, limit=limit, remedy="crop it to the lens, or bin it by two and double --um-per-px")
    if min(columns, rows) < SMALLEST:
        raise DataError(file, limit=f"has {columns} x {rows} pixels; at least {SMALLEST} each way are needed")


def brightness(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Brightness of (rows, columns, 3), and a warning where the picture is coloured."""
    spread = float(np.mean(values.max(axis=2) - values.min(axis=2)))
    warning = "the picture is coloured: its luminance is measured, which a lens's colour fringes can shift"
    return values @ LUMINANCE, (warning,) if spread > COLOURED else ()


def upright(grey: NDArray[np.float64], orientation: int) -> NDArray[np.float64]:
    """Picture turned and mirrored as its orientation tag (1 to 8, TIFF 6.0) says that it is to be looked at."""
    ways: dict[int, Callable[[NDArray[np.float64]], NDArray[np.float64]]] = {
        2: np.fliplr,
        4: np.flipud,
        5: np.transpose,
        8: np.rot90,
    }
    ways |= {3: lambda a: np.rot90(a, 2), 6: lambda a: np.rot90(a, -1), 7: lambda a: np.rot90(a, 2).T}
    return np.ascontiguousarray(ways[orientation](grey)) if orientation in ways else grey


def is_simulated(*texts: str) -> bool:
    """Whether a file says of itself that it was computed."""
    return any("simulated" in text.casefold() or "synthetic" in text.casefold() for text in texts)


def check_vision(what: str) -> None:
    """`OutputError` where the extra ``vision`` is not installed."""
    need("skimage", "tifffile", "ome_types", what=what)
