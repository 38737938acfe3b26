"""A micrograph as grey values with a scale.

Any supported file (a TIFF with a microscope's metadata, a PNG, a photograph) is converted to one plane of grey values
in [0, 1] with a pixel size, or is rejected with the reason: several planes, no scale, too large. The format, the size
and the number of planes are read from the header before any pixel is decoded.

`read_image` returns an `Image`. TIFF needs the extra ``vision``.
"""

import hashlib
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.metrology.raster import Plane, read_bytes, read_raster
from solen.metrology.scale import Scale, ScaleOptions, choose_scale
from solen.metrology.tiff import MAGIC, read_tiff
from solen.ranks import Caution, warning
from solen.recording import Provenance

SATURATED_FRACTION = 1e-3
"""Fraction of pixels at the image's highest level above which the camera may have been saturated."""


@dataclass(frozen=True, eq=False)
class Image:
    """One plane of grey values.

    Attributes
    ----------
    grey
        Shape (rows, columns): 0 to 1 over the file's range; the first row is at the top.
    scale
        Size of a pixel.
    bits
        Number of bits of a stored grey value; None for floating-point numbers.
    ceiling
        Grey value at which the camera was saturated; infinite if no part of the image is saturated.
    provenance
        The file.
    warnings
        Warnings about the image.
    """

    grey: FloatArray
    scale: Scale
    bits: int | None
    ceiling: float
    provenance: Provenance
    warnings: tuple[Caution, ...] = ()

    @property
    def um_per_px(self) -> float:
        """Side of a pixel in the object plane, µm."""
        return self.scale.um_per_px

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        return self.grey.shape[0], self.grey.shape[1]


def read_image(
    path: Path, um_per_px: float | None = None, u_um_per_px: float | None = None, *, options: ScaleOptions | None = None
) -> Image:
    """Read an image from a file: TIFF, OME-TIFF, PNG, JPEG, BMP, or another format that Pillow reads.

    Parameters
    ----------
    path
        The file.
    um_per_px
        Size of a pixel in µm; overrides the file's value.
    u_um_per_px
        Standard uncertainty of this size, or of the file's value.
    options
        Both of these, or a scale file; instead of the two parameters above.

    Raises
    ------
    DataError
        If the file cannot be read, contains several planes, is too large or too small, or contains no scale.
    SpecError
        If a specified number cannot be a pixel size.
    OutputError
        If the file is a TIFF and the extra ``vision`` is not installed.
    """
    options = options or ScaleOptions(um_per_px=um_per_px, u_um_per_px=u_um_per_px)
    plane, source = read_plane(path)
    scale, warnings = choose_scale(str(path), plane.tags, options)
    ceiling = _ceiling(plane.grey)
    warnings += [*options.rescaling_warnings(*plane.grey.shape), *plane.warnings]
    if np.isfinite(ceiling):
        fraction = float(np.mean(plane.grey >= ceiling))
        warnings.append(warning(f"{100.0 * fraction:.2g} % of the image is saturated: edges there are not measured"))
    return Image(plane.grey, scale, plane.bits, ceiling, source, tuple(warnings))


def read_plane(path: Path) -> tuple[Plane, Provenance]:
    """Read the grey values of an image without their scale, and their provenance; errors are those of `read_image`."""
    data = read_bytes(path)
    plane = (read_tiff if data[:4] in MAGIC else read_raster)(str(path), data)
    rows, columns = plane.grey.shape
    source = Provenance(
        file=path.name,
        sha256=hashlib.sha256(data).hexdigest(),
        format=plane.format,
        instrument=plane.instrument,
        date=plane.date,
        metadata=dict(plane.metadata) | {"rows": str(rows), "columns": str(columns)},
        simulated=plane.simulated,
    )
    return plane, source


def png_of(path: Path) -> bytes:
    """Return the grey values of an image as an 8-bit PNG for a browser; errors are those of `read_image`."""
    from PIL import Image as PillowImage

    plane, _ = read_plane(path)
    grey = plane.grey - float(np.nanmin(plane.grey))
    levels = np.asarray(255.0 * grey / max(float(np.nanmax(grey)), 1e-12)).astype(np.uint8)
    written = BytesIO()
    PillowImage.fromarray(levels).save(written, "PNG", compress_level=1)
    return written.getvalue()


def as_image(grey: FloatArray, um_per_px: float, *, u_um_per_px: float | None = None, name: str = "array") -> Image:
    """Return an array (rows, columns) of grey values 0 to 1 as an image; raise `DataError` if it is invalid."""
    if grey.ndim != 2 or not np.isfinite(grey).all():
        raise DataError(name, value=grey.shape, limit="must be rows and columns of finite grey values")
    scale, _ = choose_scale(name, (), ScaleOptions(um_per_px=um_per_px, u_um_per_px=u_um_per_px))
    return Image(np.asarray(grey, dtype=np.float64), scale, None, _ceiling(grey), Provenance(file=name, format="array"))


def binned(grey: FloatArray, factor: int) -> FloatArray:
    """Return the means of blocks of ``factor`` by ``factor`` pixels; incomplete blocks are omitted."""
    if factor == 1:
        return grey
    rows, columns = grey.shape[0] // factor, grey.shape[1] // factor
    blocks = grey[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _ceiling(grey: FloatArray) -> float:
    """Return the highest level if so many pixels have it that the camera was saturated, otherwise infinity.

    An image of one level, or of two levels such as a mask, is not considered saturated.
    """
    highest, lowest = float(grey.max()), float(grey.min())
    at_top = grey >= highest
    if highest <= lowest or not SATURATED_FRACTION < float(at_top.mean()) < 1.0:
        return float("inf")
    below = grey[~at_top]
    step = highest - float(below.max())  # without saturation, each of the highest levels has few pixels
    neighbours = float(np.mean((grey >= highest - 3.0 * step) & ~at_top))
    return highest if float(at_top.mean()) > 3.0 * neighbours and float(below.max()) > lowest else float("inf")
