"""Pixel size: from the metadata of a file or from the user, and never guessed.

A wrong scale makes every length wrong without any visible sign, so only values written by a measuring program are
trusted. Microscope software writes its calibration (OME-XML, ImageJ) or a fine resolution tag; office and photo
programs write 72 or 300 dpi into every file, which only defines its size on paper.

Public names: `Scale`, `Tag`, `choose_scale`, `ScaleOptions` and `ScaleFile`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import tomli_w
from pydantic import Field, model_validator

from solen.errors import DataError, SolenError, SpecError
from solen.files import read_text
from solen.ranks import Caution, warning
from solen.spec.strict import (
    Above0,
    Finite,
    Migrations,
    NotBelow0,
    NotNegative,
    Options,
    Positive,
    Strict,
    error_context,
    migrated,
    parse_toml,
)

SCALE_SCHEMA = 1
SCALE_MIGRATIONS: Migrations = {}
Count = Annotated[int, Field(strict=True, ge=1)]
MAX_DIFFERENCE = 0.01
"""Maximum relative difference of scales that are treated as equal."""
MAX_TAG_UM = 20.0
"""Pixel size above which a plain resolution tag (below 1,270 dpi) is meant for printing, not written by a
microscope.
"""
CLICK_PX, MIN_BAR_PX = 1.0, 10.0
"""Standard uncertainty of a clicked position, and the shortest scale bar."""
MAX_SIDE_DIFFERENCE = 1e-3
"""Maximum relative difference between the sides of a square pixel."""
REMEDY = (
    "measure a stage micrometer at the same magnification (solen print scale) and "
    "pass the result with --scale or --um-per-px"
)
UM = {"m": 1e6, "cm": 1e4, "mm": 1e3, "um": 1.0, "µm": 1.0, "μm": 1.0, "nm": 1e-3, "pm": 1e-6, "inch": 25_400.0}
UM |= {"in": 25_400.0, "micron": 1.0, "microns": 1.0, "micrometer": 1.0, "millimeter": 1e3, "Å": 1e-4}
UM |= {"\\u00b5m": 1.0, "\\u00B5m": 1.0}


class ScaleFile(Strict):
    """Scale of an objective, as `solen print scale` measured it."""

    error: ClassVar[type[SolenError]] = DataError

    objective: str = Field("", description="Name of the objective and camera.")
    um_per_px: Positive = Field(description="Pixel size in the object plane, µm.")
    u_um_per_px: NotNegative = Field(description="Standard uncertainty of the pixel size, µm.")
    columns: Count = Field(description="Number of columns of the image in which the pixel size was measured.")
    rows: Count = Field(description="Number of rows of that image.")
    source: str = Field("", description="Reference standard used for the measurement.")
    simulated: bool = Field(False, description="Whether the image was simulated.")


def read_scale(path: Path) -> ScaleFile:
    """Read the scale from a file that `solen print scale` wrote; raise `DataError` if it is not a scale file."""
    data = migrated(
        parse_toml(read_text(path, DataError), str(path), DataError),
        str(path),
        current=SCALE_SCHEMA,
        migrations=SCALE_MIGRATIONS,
        error=DataError,
    )
    with error_context(str(path)):
        return ScaleFile(**data)


def scale_text(scale: ScaleFile) -> str:
    """Return the TOML text of a scale for `read_scale`."""
    return tomli_w.dumps({"schema": SCALE_SCHEMA, **scale.model_dump()})


class ScaleOptions(Options):
    """Pixel size as specified by the user."""

    scale: Path | None = None
    """File with the objective's scale, written by solen print scale; instead of --um-per-px."""

    um_per_px: Annotated[Finite, Field(ge=1e-4, le=1e4)] | None = None
    """Size of a pixel in µm; it takes precedence over the value in the file."""
    u_um_per_px: NotBelow0 | None = None
    """Standard uncertainty of the size of a pixel, µm."""
    bar: tuple[Finite, Finite, Finite, Finite, Above0] | None = None
    """Ends of a scale bar, or two marks, in pixels from the upper left corner, and their distance: X0 Y0 X1 Y1 UM;
    instead of --um-per-px. Each end is assumed to be accurate to a pixel.
    """

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: dict[str, Any]) -> dict[str, Any]:
        for name in ("scale", "bar"):
            if data.get(name) is not None:
                cls._check_exclusive(data, name)
        if data.get("bar") is not None:
            return data | _scale_of_bar(data["bar"])
        if data.get("scale") is None:
            return data
        scale = read_scale(Path(data["scale"]))
        return data | {"um_per_px": scale.um_per_px, "u_um_per_px": scale.u_um_per_px}

    @classmethod
    def _check_exclusive(cls, data: dict[str, Any], name: str) -> None:
        """Raise `SpecError` if the pixel size is specified twice."""
        for key in ("um_per_px", "u_um_per_px", *(("scale",) if name == "bar" else ())):
            if data.get(key) is not None:
                option = f"--{key.replace('_', '-')}"
                limit = f"is already determined by --{name}"
                raise SpecError(option, value=str(data[key]), limit=limit, remedy="omit one of the two options")

    @model_validator(mode="after")
    def _unset_derived_fields(self) -> Self:
        if self.scale is not None or self.bar is not None:
            self.model_fields_set.difference_update(("um_per_px", "u_um_per_px"))  # set by the file or the bar
        return self

    def rescaling_warnings(self, rows: int, columns: int) -> list[Caution]:
        """Return a warning if an image is a resized version of the one in which the scale was measured."""
        if self.scale is None:
            return []
        reference = read_scale(self.scale)
        factor = columns / reference.columns
        if columns == reference.columns or abs(rows / reference.rows / factor - 1.0) > MAX_DIFFERENCE:
            return []
        return [
            warning(
                f"the image has {columns} x {rows} pixels, and the scale was measured in an image of "
                f"{reference.columns} x {reference.rows}: if this image was binned or rescaled, its pixel size is "
                f"{reference.um_per_px / factor:.6g} µm"
            )
        ]


def _scale_of_bar(bar: Any) -> dict[str, float]:
    """Return the pixel size from two points and their distance, with its uncertainty; empty for invalid values."""
    try:
        x0, z0, x1, z1, length_um = map(float, bar)
    except (TypeError, ValueError):
        return {}
    if length_um <= 0.0:
        return {}
    px = math.hypot(x1 - x0, z1 - z0)
    if px < MIN_BAR_PX:
        limit = f"has ends {px:.3g} pixels apart; at least {MIN_BAR_PX:g} are needed to determine the pixel size"
        raise SpecError("--bar", limit=limit, remedy="use a longer bar, or marks farther apart")
    return {"um_per_px": length_um / px, "u_um_per_px": length_um / px * math.sqrt(2.0) * CLICK_PX / px}


@dataclass(frozen=True)
class Scale:
    """Size of a pixel.

    Attributes
    ----------
    um_per_px
        Side of a square pixel in the object, µm.
    u_um_per_px
        Its standard uncertainty; None if none is specified.
    origin
        Source of the value: ``given``, ``OME-XML PhysicalSizeX``, ``ImageJ``, ``TIFF XResolution``, …
    """

    um_per_px: float
    u_um_per_px: float | None = None
    origin: str = "given"

    @property
    def u_relative(self) -> float:
        """Relative standard uncertainty; 0 if none is specified."""
        return (self.u_um_per_px or 0.0) / self.um_per_px


@dataclass(frozen=True)
class Tag:
    """Pixel size as stored in a file.

    Attributes
    ----------
    origin
        Name of the tag.
    x_um, y_um
        Size of a pixel along a row and along a column.
    calibrated
        Whether a measuring program wrote it as a calibration; otherwise it is a resolution that any program may write.
    """

    origin: str
    x_um: float
    y_um: float
    calibrated: bool = False

    @property
    def rejection(self) -> str:
        """Reason why the tag is not a scale; empty if it is valid."""
        sizes = (self.x_um, self.y_um)
        if not all(math.isfinite(size) and size > 0.0 for size in sizes):
            return f"{self.origin} is not a pixel size"
        if abs(self.x_um / self.y_um - 1.0) > MAX_SIDE_DIFFERENCE:
            return f"{self.origin} specifies pixels of {self.x_um:.6g} by {self.y_um:.6g} µm, which are not square"
        if not self.calibrated and self.x_um > MAX_TAG_UM:
            return (
                f"{self.origin} specifies {25_400.0 / self.x_um:.4g} dpi, or {self.x_um:.4g} µm "
                "per pixel: this is the print size, which office programs write into every file, "
                "not the scale of the object"
            )
        return ""


def choose_scale(file: str, tags: Sequence[Tag], options: ScaleOptions) -> tuple[Scale, list[Caution]]:
    """Return the scale of an image, with warnings.

    The user's value takes precedence, with a warning if a usable tag differs by more than `MAX_DIFFERENCE`: a wrong tag
    must not make an image unusable, and an outline of known size reveals a wrong value.

    Raises
    ------
    DataError
        If the image has no scale, or only an invalid one.
    SpecError
        If the specified uncertainty is half the pixel size or more.
    """
    usable = sorted((tag for tag in tags if not tag.rejection), key=lambda tag: not tag.calibrated)
    if options.um_per_px is not None:
        scale, warnings = Scale(options.um_per_px, options.u_um_per_px), _contradictions(options.um_per_px, usable)
    elif usable:
        first, warnings = usable[0], _ambiguities(usable)
        scale = Scale(0.5 * (first.x_um + first.y_um), options.u_um_per_px, first.origin)
    else:
        reasons = [tag.rejection for tag in tags]
        raise DataError(file, limit=reasons[0] if reasons else "does not specify the pixel size", remedy=REMEDY)
    if scale.u_relative >= 0.5:
        limit = f"must be below half of {scale.um_per_px:g} µm per pixel"
        raise SpecError("--u-um-per-px", value=scale.u_um_per_px, limit=limit)
    return scale, warnings


def _contradictions(um_per_px: float, usable: Sequence[Tag]) -> list[Caution]:
    return [
        warning(
            f"--um-per-px {um_per_px:g} is used although {tag.origin} specifies {tag.x_um:.6g} "
            f"({100.0 * (um_per_px / tag.x_um - 1.0):+.1f} %): one of them is wrong"
        )
        for tag in usable
        if abs(um_per_px / tag.x_um - 1.0) > MAX_DIFFERENCE
    ]


def _ambiguities(usable: Sequence[Tag]) -> list[Caution]:
    """Return warnings about the first tag, which is used."""
    first = usable[0]
    warnings = [
        warning(
            f"{other.origin} specifies {other.x_um:.6g} µm per pixel, whereas {first.origin} specifies "
            f"{first.x_um:.6g}: {first.origin} is used"
        )
        for other in usable[1:]
        if abs(other.x_um / first.x_um - 1.0) > MAX_DIFFERENCE
    ]
    if not first.calibrated:
        warnings.append(
            warning(
                f"{first.x_um:.6g} µm per pixel is taken from {first.origin}, which any program may have written: "
                "check it against a scale bar, or set --um-per-px"
            )
        )
    return warnings


def in_um(size: float, unit: str) -> float | None:
    """Return a size in µm, or None if the unit is not a unit of length, such as ``pixel``."""
    factor = UM.get(unit.strip()) or UM.get(unit.strip().casefold())
    return None if factor is None else size * factor
