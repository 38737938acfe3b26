"""TIFF files of microscopes: OME-TIFF, ImageJ, and plain TIFF with a resolution, read by tifffile."""

import io
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.metrology.raster import (
    Plane,
    check_size,
    check_vision,
    float_levels,
    is_simulated,
    luminance,
    readable,
    upright,
)
from solen.metrology.scale import Tag, in_um
from solen.ranks import Caution

if TYPE_CHECKING:
    import tifffile

MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
UNIT_UM = {2: 25_400.0, 3: 10_000.0, 4: 1_000.0, 5: 1.0}
"""ResolutionUnit in µm: inch and centimetre of TIFF 6.0, millimetre and micrometre of later writers."""
AXES = {"Z": "a z-stack of {} planes", "T": "{} times", "C": "{} channels", "Q": "{} pages", "I": "{} pages"}
WHITE_IS_ZERO, PALETTE = 0, 3
MAX_SAMPLES = 4
"""Maximum number of samples per pixel: red, green, blue and alpha."""


@contextmanager
def opened_tiff(file: str, data: bytes) -> "Iterator[tifffile.TiffFile]":
    """Open a TIFF; raise `DataError` if it is damaged, and `OutputError` without the extra ``vision``."""
    check_vision(file)
    import tifffile

    logger = logging.getLogger("tifffile")  # the errors that it logs are also raised
    before, logger.disabled = logger.disabled, True
    try:
        with readable(file), tifffile.TiffFile(io.BytesIO(data)) as opened:
            check_size(file, opened.pages.first.imagewidth, opened.pages.first.imagelength)
            yield opened
    finally:
        logger.disabled = before


def read_tiff(file: str, data: bytes) -> Plane:
    """Read the plane of a TIFF.

    Raises
    ------
    DataError
        If the file is damaged or has several planes.
    OutputError
        If the extra ``vision`` is not installed.
    """
    with opened_tiff(file, data) as opened:
        if not opened.series:
            raise DataError(file, limit="contains no image", remedy="export it again")
        page: Any = opened.pages.first
        if page.samplesperpixel > MAX_SAMPLES:
            raise DataError(file, limit=f"has {page.samplesperpixel} values per pixel", remedy="export one plane")
        _check_planes(file, opened, opened.series[0])
        grey, bits, cautions = _grey(file, page, _decoded(file, data, page))
        tags, instrument, date = recorded_metadata(opened)
        software = str(page.software or "")
        return Plane(
            upright(grey, int(_value(page, "Orientation", 1))),
            bits,
            tags,
            "imagej-tiff" if opened.is_imagej else "ome-tiff" if opened.is_ome else "tiff",
            instrument or " ".join(str(_value(page, name, "")).strip() for name in ("Make", "Model")).strip(),
            date or str(_value(page, "DateTime", "")),
            {"software": software} if software else {},
            is_simulated(page.description, str(opened.imagej_metadata or ""), software),
            cautions,
        )


def recorded_metadata(opened: "tifffile.TiffFile") -> tuple[tuple[Tag, ...], str, str]:
    """Return the pixel sizes recorded in a TIFF, and the instrument and date in its OME-XML, empty if missing."""
    tags, instrument, date = _ome(opened.ome_metadata or "") if opened.is_ome else ((), "", "")
    return (*tags, *_imagej(opened), *_resolution(opened)), instrument, date


def _check_planes(file: str, opened: "tifffile.TiffFile", series: Any) -> None:
    """Raise `DataError`, naming the axis, for more than one plane; the levels of a pyramid are treated as one."""
    for axis, size in zip(series.axes, series.shape, strict=True):
        if axis not in "YXS" and size > 1:
            what = AXES.get(axis, "{} planes along " + axis).format(size)
            raise DataError(file, limit=f"contains {what}", remedy="export the single plane to be measured")
    if len(opened.series) > 1:
        shapes = {stored.shape for stored in opened.series}
        limit = f"contains {len(opened.series)} images of {len(shapes)} size{'s' * (len(shapes) > 1)}"
        raise DataError(file, limit=limit, remedy="export the image to be measured")


def _decoded(file: str, data: bytes, page: Any) -> NDArray[Any]:
    """Return the pixels of the page; Pillow decodes them if tifffile needs another package for the compression."""
    parts, needed = sum(count > 0 for count in page.databytecounts), math.prod(page.chunked)
    if not page.is_contiguous and parts < needed:  # tifffile reads missing parts as black
        raise DataError(file, value=f"{parts} of {needed} parts", limit="is incomplete", remedy="export it again")
    try:
        return np.asarray(page.asarray())
    except ValueError as bad:
        if "imagecodecs" not in str(bad):
            raise
    from PIL import Image as Pillow

    with Pillow.open(io.BytesIO(data)) as opened:
        values = np.asarray(opened)
    if values.dtype == bool:
        values = values.astype(np.uint8) * 255
    if values.shape[:2] != (page.imagelength, page.imagewidth):
        raise DataError(file, limit="has an unsupported compression", remedy="save it without compression")
    return values


def _grey(file: str, page: Any, values: NDArray[Any]) -> tuple[FloatArray, int | None, tuple[Caution, ...]]:
    values = np.squeeze(values)
    if page.photometric == PALETTE:
        values = np.moveaxis(np.asarray(page.colormap)[:, values], 0, -1)
    if values.ndim == 3 and values.shape[0] in (3, 4) and values.shape[2] not in (3, 4):
        values = np.moveaxis(values, 0, -1)  # colours as separate planes
    if values.ndim == 3 and values.shape[2] == 4:
        values = values[..., :3]
    if values.ndim not in (2, 3) or (values.ndim == 3 and values.shape[2] != 3):
        raise DataError(file, value=values.shape, limit="is neither a grey nor an RGB image")
    if values.dtype.kind == "f":
        levels, bits = float_levels(file, values), None
    elif values.dtype.kind in "ub":
        bits = 1 if values.dtype.kind == "b" else int(values.dtype.itemsize * 8)
        levels = values.astype(np.float64) / (2.0**bits - 1.0)
    else:
        raise DataError(file, value=str(values.dtype), limit="has an unsupported pixel format")
    grey, cautions = luminance(levels) if levels.ndim == 3 else (levels, ())
    return (1.0 - grey if page.photometric == WHITE_IS_ZERO else grey), bits, cautions


def _value(page: Any, name: str, otherwise: Any) -> Any:
    """Return the value of a tag of the page, or ``otherwise`` if the page lacks the tag."""
    tag = page.tags.get(name)
    return otherwise if tag is None else tag.value


def _ome(xml: str) -> tuple[tuple[Tag, ...], str, str]:
    import ome_types

    model = ome_types.from_xml(xml, validate=False)
    image, microscope = model.images[0], model.instruments[0].microscope if model.instruments else None
    sizes = [
        in_um(float(size), getattr(unit, "value", str(unit)))
        for size, unit in (
            (image.pixels.physical_size_x, image.pixels.physical_size_x_unit),
            (image.pixels.physical_size_y, image.pixels.physical_size_y_unit),
        )
        if size is not None
    ]
    tags = (Tag("OME-XML PhysicalSizeX", size, sizes[-1] or size, calibrated=True) for size in sizes[:1] if size)
    names = (getattr(microscope, "manufacturer", None), getattr(microscope, "model", None))
    date = "" if image.acquisition_date is None else image.acquisition_date.isoformat()
    return tuple(tags), " ".join(name for name in names if name), date


def _per_unit(page: Any) -> tuple[float, float] | None:
    """Return the pixels per unit along a row and a column, from the resolution tags."""
    per_unit = []
    for name in ("XResolution", "YResolution"):
        value = _value(page, name, None)
        if not isinstance(value, tuple) or value[0] <= 0 or value[1] <= 0:
            return None
        per_unit.append(value[0] / value[1])
    return per_unit[0], per_unit[1]


def _imagej(opened: "tifffile.TiffFile") -> tuple[Tag, ...]:
    """Return the pixel size if ImageJ recorded a unit for the resolution tags."""
    metadata, per_unit = opened.imagej_metadata, _per_unit(opened.pages.first)
    if not opened.is_imagej or not metadata or per_unit is None:
        return ()
    sizes = [in_um(1.0 / number, str(metadata.get("unit", ""))) for number in per_unit]
    if sizes[0] is None or sizes[1] is None:
        return ()
    return (Tag("ImageJ", sizes[0], sizes[1], calibrated=True),)


def _resolution(opened: "tifffile.TiffFile") -> tuple[Tag, ...]:
    """Return the pixel size if the resolution tags specify a unit of length and ImageJ did not write the file."""
    page = opened.pages.first
    per_unit, unit_um = _per_unit(page), UNIT_UM.get(int(_value(page, "ResolutionUnit", 2)))
    if per_unit is None or unit_um is None or opened.is_imagej:
        return ()
    return (Tag("TIFF XResolution", unit_um / per_unit[0], unit_um / per_unit[1]),)
