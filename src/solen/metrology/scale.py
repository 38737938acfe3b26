"""How large a pixel is: taken from what the file says of itself or from the user, and never guessed.

The idea: a wrong scale makes every length wrong without a trace, so a number that was not written by a measuring
program is not believed. A microscope's program writes its calibration (OME-XML, ImageJ) or a fine resolution tag;
office and photo programs write 72 or 300 dpi into every file, which says how large to print it.

The interface: `Scale`; `Tag`, what a file says; `decided`, what follows from the tags and the user's own number.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from solen.errors import DataError, SpecError

SAME = 0.01
"""Relative: scales that differ by no more agree."""
COARSEST_TAG_UM = 20.0
"""A plain resolution tag coarser than this (1,270 dpi) is one for printing, not one of a microscope."""
SQUARE = 1e-3
"""Relative: pixels whose sides differ by more are not square."""
REMEDY = "measure a stage micrometer at the same magnification and give its scale: --um-per-px"
UM = {"m": 1e6, "cm": 1e4, "mm": 1e3, "um": 1.0, "µm": 1.0, "μm": 1.0, "nm": 1e-3, "pm": 1e-6, "inch": 25_400.0}
UM |= {"in": 25_400.0, "micron": 1.0, "microns": 1.0, "micrometer": 1.0, "millimeter": 1e3, "Å": 1e-4}
UM |= {"\\u00b5m": 1.0, "\\u00B5m": 1.0}


@dataclass(frozen=True)
class Scale:
    """Size of a pixel.

    Attributes
    ----------
    um_per_px
        Side of a square pixel in the object, µm.
    u_um_per_px
        Its standard uncertainty; None where nobody states one.
    origin
        Where it comes from: ``given``, ``OME-XML PhysicalSizeX``, ``ImageJ``, ``TIFF XResolution``, …
    """

    um_per_px: float
    u_um_per_px: float | None = None
    origin: str = "given"

    def as_dict(self) -> dict[str, Any]:
        """The same as plain data, for JSON."""
        return {"um_per_px": self.um_per_px, "u_um_per_px": self.u_um_per_px, "origin": self.origin}


@dataclass(frozen=True)
class Tag:
    """Size of a pixel as a file states it.

    Attributes
    ----------
    origin
        Name of the tag.
    x_um, y_um
        Size of a pixel along a row and along a column.
    calibrated
        Whether a measuring program wrote it as a calibration; if not it is a resolution that any program may write.
    """

    origin: str
    x_um: float
    y_um: float
    calibrated: bool = False
    doubt: str = field(default="", init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "doubt", self._doubt())

    def _doubt(self) -> str:
        """Why the tag is no scale; empty where it is one."""
        sizes = (self.x_um, self.y_um)
        if not all(math.isfinite(size) and size > 0.0 for size in sizes):
            return f"{self.origin} holds no size of a pixel"
        if abs(self.x_um / self.y_um - 1.0) > SQUARE:
            return f"{self.origin} says that pixels are {self.x_um:.6g} by {self.y_um:.6g} µm, which are not square"
        if not self.calibrated and self.x_um > COARSEST_TAG_UM:
            return (
                f"{self.origin} says {25_400.0 / self.x_um:.4g} dpi, or {self.x_um:.4g} µm per pixel: how large to "
                "print it, as office programs write into every file, and not how large the object is"
            )
        return ""


def decided(
    file: str, tags: Sequence[Tag], um_per_px: float | None, u_um_per_px: float | None
) -> tuple[Scale, list[str]]:
    """Scale of a picture, and what must be said of it.

    The user's number counts where there is one, with a warning where a usable tag differs by more than `SAME`: a wrong
    tag must not lock a picture up, and an outline of a known size shows a wrong number at once.

    Raises
    ------
    DataError
        Where the picture has no scale, or only one that is none.
    SpecError
        Where the user's number is no size of a pixel.
    """
    usable = sorted((tag for tag in tags if not tag.doubt), key=lambda tag: not tag.calibrated)
    if um_per_px is not None:
        return _given(um_per_px, u_um_per_px, usable)
    if not usable:
        doubts = [tag.doubt for tag in tags]
        raise DataError(file, limit=doubts[0] if doubts else "says nowhere how large a pixel is", remedy=REMEDY)
    first = usable[0]
    warnings = [
        f"{other.origin} says {other.x_um:.6g} µm per pixel and {first.origin} {first.x_um:.6g}: the latter is taken"
        for other in usable[1:]
        if abs(other.x_um / first.x_um - 1.0) > SAME
    ]
    if not first.calibrated:
        warnings.append(
            f"{first.x_um:.6g} µm per pixel is taken from {first.origin}, which any program may have written: "
            "check it against a scale bar, or give --um-per-px"
        )
    return Scale(0.5 * (first.x_um + first.y_um), _uncertainty(u_um_per_px, first.x_um), first.origin), warnings


def _given(um_per_px: float, u_um_per_px: float | None, usable: Sequence[Tag]) -> tuple[Scale, list[str]]:
    if not (math.isfinite(um_per_px) and 1e-4 <= um_per_px <= 1e4):
        raise SpecError("--um-per-px", value=um_per_px, limit="must be from 0.0001 to 10000 µm")
    warnings = [
        f"--um-per-px {um_per_px:g} is taken although {tag.origin} says {tag.x_um:.6g} "
        f"({100.0 * (um_per_px / tag.x_um - 1.0):+.1f} %): one of them is wrong"
        for tag in usable
        if abs(um_per_px / tag.x_um - 1.0) > SAME
    ]
    return Scale(um_per_px, _uncertainty(u_um_per_px, um_per_px)), warnings


def _uncertainty(u_um_per_px: float | None, um_per_px: float) -> float | None:
    if u_um_per_px is not None and not 0.0 <= u_um_per_px < 0.5 * um_per_px:
        limit = f"must be from 0 to below half of {um_per_px:g} µm per pixel"
        raise SpecError("--u-um-per-px", value=u_um_per_px, limit=limit)
    return u_um_per_px


def in_um(size: float, unit: str) -> float | None:
    """Size in µm; None where the unit is none of length, as ``pixel``."""
    factor = UM.get(unit.strip()) or UM.get(unit.strip().casefold())
    return None if factor is None else size * factor
