"""A micrograph as grey values with a scale.

The idea: whatever the file is (a TIFF with its microscope's metadata, a PNG, a photograph), it becomes one plane of
grey values in [0, 1] with the size of a pixel, or it is refused with the reason: several planes, no scale, too large.
What a file is, how large it is and how many planes it has is read from its header, before any pixel is decoded.

The interface: `read_image` gives an `Image`. TIFF needs the extra ``vision``.
"""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solen.errors import DataError
from solen.metrology import picture, tiff
from solen.metrology.planes import Plane
from solen.metrology.scale import Scale, decided
from solen.recording import Provenance

LARGEST_MB = 1_000
CLIPPED_SHARE = 1e-3
"""A level that so many pixels share, the highest of the picture, is where the camera was at its limit."""


@dataclass(frozen=True)
class Image:
    """One plane of grey values.

    Attributes
    ----------
    grey
        Shape (rows, columns), 0 to 1 of the file's range; a photograph's rows run downwards.
    scale
        Size of a pixel.
    bits
        Per grey value, as stored; None for numbers with a point.
    ceiling
        Grey value at which the camera was saturated; infinite where none of the picture is.
    provenance
        The file.
    warnings
        What must be said of the picture.
    """

    grey: NDArray[np.float64]
    scale: Scale
    bits: int | None
    ceiling: float
    provenance: Provenance
    warnings: tuple[str, ...] = ()

    @property
    def um_per_px(self) -> float:
        """Side of a pixel in the object, µm."""
        return self.scale.um_per_px

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.grey.shape[0], self.grey.shape[1]


def read_image(path: Path, um_per_px: float | None = None, u_um_per_px: float | None = None) -> Image:
    """Picture of a file: TIFF, OME-TIFF, PNG, JPEG, BMP, or another that Pillow reads.

    Parameters
    ----------
    path
        The file.
    um_per_px
        Size of a pixel in µm; it counts before what the file says.
    u_um_per_px
        Its standard uncertainty, or that of what the file says.

    Raises
    ------
    DataError
        Where the file cannot be read, holds several planes, is too large or too small, or says no scale.
    SpecError
        Where the numbers given are no size of a pixel.
    OutputError
        Where a TIFF is to be read without the extra ``vision``.
    """
    data = _bytes(path)
    plane = (tiff.read if data[:4] in tiff.MAGIC else picture.read)(str(path), data)
    scale, said = decided(str(path), plane.tags, um_per_px, u_um_per_px)
    grey = plane.grey
    warnings = [*said, *plane.warnings]
    ceiling = _ceiling(grey)
    if np.isfinite(ceiling):
        share = float(np.mean(grey >= ceiling))
        warnings.append(f"{100.0 * share:.2g} % of the picture is at the camera's limit: edges there are not measured")
    source = Provenance(
        file=path.name,
        sha256=hashlib.sha256(data).hexdigest(),
        format=plane.format,
        instrument=plane.instrument,
        date=plane.date,
        metadata=dict(plane.metadata) | {"rows": str(grey.shape[0]), "columns": str(grey.shape[1])},
        simulated=plane.simulated,
    )
    return Image(grey, scale, plane.bits, ceiling, source, tuple(warnings))


def as_image(
    grey: NDArray[np.float64], um_per_px: float, *, u_um_per_px: float | None = None, name: str = "array"
) -> Image:
    """Picture of an array (rows, columns) in memory, grey values 0 to 1; `DataError` where it is none."""
    if grey.ndim != 2 or not np.isfinite(grey).all():
        raise DataError(name, value=grey.shape, limit="must be rows and columns of finite grey values")
    scale, _ = decided(name, (), um_per_px, u_um_per_px)
    return Image(np.asarray(grey, dtype=np.float64), scale, None, _ceiling(grey), Provenance(file=name, format="array"))


def _bytes(path: Path) -> bytes:
    """Bytes of a file; `DataError` where it cannot be read."""
    try:
        if not path.is_file():
            limit, remedy = ("is a folder or a device", "name a file") if path.exists() else ("no such file", "")
            raise DataError(str(path), limit=limit, remedy=remedy or "check the path")
        size = path.stat().st_size
        if size > LARGEST_MB * 1_000_000:
            limit = f"has {size / 1e6:.0f} MB; at most {LARGEST_MB} MB are read"
            raise DataError(str(path), limit=limit, remedy="crop it to the lens")
        data = path.read_bytes()
    except (OSError, ValueError) as bad:
        reason = getattr(bad, "strerror", None) or bad
        raise DataError(str(path), limit=f"cannot be read: {reason}", remedy="check its name and permissions") from None
    if not data:
        raise DataError(str(path), limit="is empty", remedy="export it again")
    return data


def _ceiling(grey: NDArray[np.float64]) -> float:
    """Highest level where so many pixels share it that it is the camera's limit; infinite otherwise.

    A picture of one level, and one of two as a mask is, has no limit: its levels are no camera's.
    """
    highest, lowest = float(grey.max()), float(grey.min())
    at_it = grey >= highest
    if highest <= lowest or not CLIPPED_SHARE < float(at_it.mean()) < 1.0:
        return float("inf")
    below = grey[~at_it]
    step = highest - float(below.max())  # of a spread that ends by itself the last levels hold few pixels each
    neighbours = float(np.mean((grey >= highest - 3.0 * step) & ~at_it))
    return highest if float(at_it.mean()) > 3.0 * neighbours and float(below.max()) > lowest else float("inf")


__all__ = ["Image", "Plane", "Scale", "as_image", "read_image"]
