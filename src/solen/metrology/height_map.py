"""Height maps: heights on a grid of pixels, from a TIFF of a profiler or depth-from-focus microscope, or a text table.

There is no common tag for the height of one level, so the user must specify it (`z_um`, µm for one level or unit); it
is never guessed. The pixel size comes from the file's own tags or from the user, as with an image. Pixels without a
height (NaN, an empty cell) are not filled in.

`read_height_map` returns a `HeightMap`.
"""

import hashlib
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy import ndimage

from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.metrology.image import Image, read_image
from solen.metrology.raster import check_size, is_simulated, read_bytes
from solen.metrology.scale import Scale, ScaleOptions, Tag, choose_scale
from solen.metrology.tiff import MAGIC, opened_tiff, recorded_metadata
from solen.ranks import Caution, warning
from solen.recording import Provenance
from solen.spec.strict import Finite

TEXT = (".csv", ".txt", ".tsv", ".asc", ".xyz")
EMPTY = {"", "nan", "-", "--", "---", "***", "bad", "n/a", "null"}
HEADER_BYTES = 4000
"""Number of bytes at the start of a text table that are searched for a simulation mark."""
MIN_VALID = 0.2
"""Minimum fraction of the pixels that must have a height."""


class HeightMapOptions(ScaleOptions):
    """Pixel size and height scale of a height map."""

    z_um: Annotated[Finite, Field(gt=0, le=1e4)] | None = None
    """Height of one level or unit of a height map, µm; without it the file is read as an image."""
    u_z_um: Annotated[Finite, Field(ge=0, le=1e4)] | None = None
    """Standard uncertainty of the height of one level or unit, µm."""


@dataclass(frozen=True, eq=False)
class HeightMap:
    """A map of heights.

    Attributes
    ----------
    z_mm
        Shape (rows, columns), mm; NaN for pixels without a height.
    scale
        Size of a pixel.
    provenance
        The file.
    warnings
        Warnings about the map.
    z_um, u_z_um
        Height of a level or unit of the file, µm, and its standard uncertainty; None if not specified.
    """

    z_mm: FloatArray
    scale: Scale
    provenance: Provenance
    warnings: tuple[Caution, ...] = ()
    z_um: float = 1.0
    u_z_um: float | None = None

    @property
    def u_z_relative(self) -> float:
        """Relative standard uncertainty of heights due to their scale; 0 if none is specified."""
        return (self.u_z_um or 0.0) / self.z_um

    @cached_property
    def filled_mm(self) -> FloatArray:
        """Heights (rows, columns), with gaps filled by the nearest height."""
        holes = ~np.isfinite(self.z_mm)
        if not holes.any():
            return self.z_mm
        nearest = ndimage.distance_transform_edt(holes, return_distances=False, return_indices=True)
        return np.asarray(self.z_mm[tuple(np.asarray(nearest))])

    @cached_property
    def grey(self) -> FloatArray:
        """Heights (rows, columns) scaled to 0 to 1 as an image, with gaps filled by the nearest height."""
        low, high = np.percentile(self.filled_mm, [0.1, 99.9])
        return np.asarray((self.filled_mm - low) / max(float(high - low), 1e-12))


def is_text(path: Path) -> bool:
    """Return whether the file name is that of a text table."""
    return path.suffix.casefold() in TEXT


def read_height_map(
    path: Path,
    z_um: float,
    um_per_px: float | None = None,
    u_um_per_px: float | None = None,
    u_z_um: float | None = None,
) -> HeightMap:
    """Read the heights from a file: a TIFF of integers or floating-point numbers, or a text table.

    Parameters
    ----------
    path
        The file.
    z_um
        Height of one level or unit of the file, µm.
    um_per_px, u_um_per_px
        Size of a pixel and its standard uncertainty; they take precedence over the values in the file.
    u_z_um
        Standard uncertainty of ``z_um``.

    Raises
    ------
    DataError
        If the file cannot be read, is not a grid of heights, is too large, or contains no scale.
    SpecError
        If a specified number is not a valid height or pixel size.
    OutputError
        If the file is a TIFF and the extra ``vision`` is not installed.
    """
    options = HeightMapOptions(z_um=z_um, um_per_px=um_per_px, u_um_per_px=u_um_per_px, u_z_um=u_z_um)
    data, file = read_bytes(path), str(path)
    if data[:4] in MAGIC:
        levels, tags, kind, simulated = _of_tiff(file, data)
    elif is_text(path):
        levels, tags, kind = _of_text(file, data), (), "height-map-text"
        simulated = is_simulated(
            *(line for line in data[:HEADER_BYTES].decode("utf-8", "replace").splitlines() if "#" in line)
        )
    else:
        raise DataError(
            file, limit="is neither a TIFF nor a table of numbers", remedy="export a TIFF or a table of the heights"
        )
    valid = np.isfinite(levels)
    if valid.mean() < MIN_VALID:
        limit = f"has heights in only {100 * valid.mean():.0f} % of its pixels; {100 * MIN_VALID:.0f} % are needed"
        raise DataError(file, limit=limit, remedy="measure the coupon again with more light, or crop the map to it")
    if float(np.nanmax(levels)) == float(np.nanmin(levels)):
        raise DataError(file, limit="has the same height everywhere", remedy="export the heights, not a mask")
    scale, warnings = choose_scale(file, tags, options)
    if not valid.all():
        warnings.append(warning(f"{100.0 * (1.0 - valid.mean()):.2g} % of the pixels of the height map have no height"))
    size = {"rows": str(levels.shape[0]), "columns": str(levels.shape[1]), "z_um_per_level": f"{z_um:g}"}
    sha256 = hashlib.sha256(data).hexdigest()
    source = Provenance(file=path.name, sha256=sha256, format=kind, metadata=size, simulated=simulated)
    return HeightMap(levels * z_um * 1e-3, scale, source, tuple(warnings), z_um, u_z_um)


def read_image_or_height_map(path: Path, options: HeightMapOptions) -> Image | HeightMap:
    """Read a height map if ``z_um`` is specified, otherwise an image; raise `SpecError` for a text table without it."""
    if options.z_um is not None:
        return read_height_map(path, options.z_um, options.um_per_px, options.u_um_per_px, options.u_z_um)
    if options.u_z_um is not None:
        limit, remedy = "has no effect without --z-um", "specify both, or omit --u-z-um"
        raise SpecError("--u-z-um", value=options.u_z_um, limit=limit, remedy=remedy)
    if is_text(path):
        raise SpecError(
            "--z-um",
            limit="is required, because a table of numbers is a height map",
            remedy="set --z-um to the height of one unit of the table, in µm",
        )
    return read_image(path, options=options)


def _of_tiff(file: str, data: bytes) -> tuple[FloatArray, tuple[Tag, ...], str, bool]:
    """Return the levels of the file, its recorded pixel sizes, its format, and whether it is marked as simulated."""
    with opened_tiff(file, data) as opened:
        page: Any = opened.pages.first
        if len(opened.pages) > 1:
            limit = f"contains {len(opened.pages)} planes"
            raise DataError(file, limit=limit, remedy="export only the height map, not the stack")
        levels = _levels(file, np.squeeze(np.asarray(page.asarray())))
        simulated = is_simulated(str(page.description), str(page.software or ""))
        return levels, recorded_metadata(opened)[0], "height-map-tiff", simulated


def _levels(file: str, values: NDArray[Any]) -> FloatArray:
    if values.ndim != 2:
        raise DataError(file, value=values.shape, limit="is not a grid of heights: one number per pixel is needed")
    if values.dtype.kind not in "uif":
        raise DataError(file, value=str(values.dtype), limit="has an unsupported pixel format")
    if values.dtype.itemsize == 1:
        limit = "has 8 bits, at most 256 heights: it is a rendering of a height map"
        raise DataError(file, limit=limit, remedy="export the heights with 16 bits or as floating-point numbers")
    levels = values.astype(np.float64)
    levels[~np.isfinite(levels)] = np.nan
    return levels


def _of_text(file: str, data: bytes) -> FloatArray:
    """Return the numbers of a table without a header, one row of pixels per line; lines starting with # are skipped."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as bad:
        raise DataError(file, limit=f"is not UTF-8 text (byte {bad.start})", remedy="save it as UTF-8 text") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise DataError(file, limit="is empty", remedy="export it again")
    split = _splitter(lines[0])
    rows = [split(line) for line in lines]
    check_size(file, len(rows[0]), len(rows))
    for number, row in enumerate(rows, 1):
        if len(row) != len(rows[0]):
            limit = f"row {number} contains {len(row)} numbers, whereas the first row contains {len(rows[0])}"
            raise DataError(file, limit=limit, remedy="export one line for each row of pixels")
    try:
        return np.array([[_height(cell) for cell in row] for row in rows])
    except ValueError as bad:
        raise DataError(
            file, limit=f"{bad}, which is not a height", remedy="remove headers, or start them with #"
        ) from None


def _splitter(line: str) -> Callable[[str], list[str]]:
    """Return a function that splits lines at semicolons or tabs (decimal commas allowed), commas, or white space."""
    for separator in ";\t":
        if separator in line:
            return lambda row: row.replace(",", ".").strip("\r\n").split(separator)
    if "," in line:
        return lambda row: row.split(",")
    return lambda row: re.split(r"\s+", row.strip())


def _height(cell: str) -> float:
    cell = cell.strip().casefold()
    if cell in EMPTY:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        raise ValueError(f"contains {cell[:30]!r}") from None
    return value if math.isfinite(value) else math.nan
