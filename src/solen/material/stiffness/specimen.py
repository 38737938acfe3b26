"""Dimensions of a specimen, their uncertainties, and the effect of friction on the platens.

Stress and strain require an area and a length. Options have priority over the values in a file, and their uncertainties
contribute to that of the modulus, E ∝ length/area. A block whose ends cannot slide on the platens cannot widen there;
it bulges and appears stiffer than its material. The effect depends on the shape factor, which is the area of one loaded
face divided by the area that is free to bulge.

`specimen_of` makes a `Specimen` from `Dimensions` and the metadata of a file; `bonded_ratio` returns the ratio of the
apparent to the true modulus of a block whose ends do not slide.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import Field, model_validator

from solen.errors import DataError
from solen.spec.strict import Finite, Options, refused
from solen.units import factor

_SHAPE_FACTORS = (0.0, 1 / 12, 1 / 8, 1 / 5.6, 1 / 4, 1 / 2.8, 1 / 2, 1 / 1.6)
_BONDED = (1.0, 1.066, 1.102, 1.153, 1.232, 1.387, 1.668, 1.985)
"""Ratio of the apparent to the true modulus of an incompressible square block with bonded ends, for the shape factors
above: from finite elements at small strain, extrapolated to a fine mesh, accurate to 0.3 %, which a test recomputes.
Gent and Lindley's formula of 1959, 1 + 2S², is valid for flat pads and gives 1.125 for a cube.
"""

_NUMBER = re.compile(r"([-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)\s*([^\d\s].*)?", re.IGNORECASE)
_WITH_UNIT = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]\s*")
_WORDS = {
    "width": "probenbreite b0, probenbreite, specimen width b0, specimen width, width, breite",
    "thickness": "probendicke a0, probendicke, specimen thickness a0, specimen thickness, thickness, dicke",
    "diameter": "probendurchmesser d0, probendurchmesser, specimen diameter d0, specimen diameter, diameter, "
    "durchmesser",
    "area": "probenquerschnitt s0, probenquerschnitt, querschnitt, specimen cross-section, specimen cross-section s0, "
    "cross-section, cross-sectional area, area",
    "length": "messlänge, messlänge l0, anfangsmesslänge l0, gauge length, gage length, gauge length l0, "
    "probenhöhe h0, probenhöhe, specimen height h0, specimen height, height, höhe, specimen length, length, "
    "einspannlänge, grip to grip separation at the start position, grip to grip separation, grip separation",
}
_FILE_SECTIONS = (("width", "thickness"), ("diameter",), ("area",))


class Dimensions(Options):
    """Specified dimensions of a specimen."""

    cube_mm: Finite | None = Field(None, gt=0.0)
    """Side of a compressed cube in mm, instead of the dimensions below."""
    length_mm: Finite | None = Field(None, gt=0.0)
    """Gauge length, or height in compression, in mm, by which the displacement is divided; overrides the strain in the
    file.
    """
    area_mm2: Finite | None = Field(None, gt=0.0)
    """Area of the cross-section before the test in mm²."""
    strip_width_mm: Finite | None = Field(None, gt=0.0)
    """Width of the cross-section in mm, with --thickness-mm."""
    thickness_mm: Finite | None = Field(None, gt=0.0)
    """Thickness of the cross-section in mm, with --strip-width-mm."""
    diameter_mm: Finite | None = Field(None, gt=0.0)
    """Diameter of a round cross-section in mm."""
    u_geometry_mm: Finite | None = Field(None, ge=0.0)
    """Standard uncertainty of each specified length in mm; the errors of the lengths are assumed independent."""

    @model_validator(mode="after")
    def _check_section(self) -> Self:
        sections = {
            "--area-mm2": self.area_mm2,
            "--diameter-mm": self.diameter_mm,
            "--cube-mm": self.cube_mm,
            "--strip-width-mm": self.strip_width_mm or self.thickness_mm,
        }
        given = [option for option, value in sections.items() if value is not None]
        if len(given) > 1:
            limit = f"is specified by {' and '.join(given)}"
            raise refused("cross-section", limit, remedy="omit all but one of them")
        if (self.strip_width_mm is None) != (self.thickness_mm is None):
            missing, other = "strip_width_mm", "--thickness-mm"
            if self.thickness_mm is None:
                missing, other = "thickness_mm", "--strip-width-mm"
            raise refused(missing, f"is required with {other}", remedy="specify both")
        if self.cube_mm is not None and self.length_mm is not None:
            raise refused("length_mm", "cannot be combined with --cube-mm", remedy="omit one of the two")
        return self


@dataclass(frozen=True)
class Specimen:
    """Dimensions for stress and strain; None for those that are specified neither by the user nor in the file.

    Attributes
    ----------
    length_mm, area_mm2
        Length and cross-section before the test.
    perimeter_mm
        Perimeter of the cross-section; that of a square if only the area is known.
    u_length, u_area
        Relative standard uncertainties; None if unknown.
    source
        Source of the dimensions, in words.
    area_error_per_mm
        Relative error of the area for an error of 1 mm in each of its sides or its diameter.
    is_cube, length_by_user
        Whether the user specified a cube, and a length.
    """

    length_mm: float | None
    area_mm2: float | None
    perimeter_mm: float | None
    u_length: float | None
    u_area: float | None
    source: str
    area_error_per_mm: float | None = None
    is_cube: bool = False
    length_by_user: bool = False

    @property
    def shape_factor(self) -> float | None:
        """Area of one loaded face divided by the area that is free to bulge; None if a dimension is unknown."""
        if self.length_mm is None or self.area_mm2 is None or self.perimeter_mm is None:
            return None
        return self.area_mm2 / (self.perimeter_mm * self.length_mm)


@dataclass(frozen=True)
class _Section:
    """Cross-section: area, perimeter, and relative error of the area for an error of 1 mm in each side or diameter."""

    area_mm2: float
    perimeter_mm: float
    error_per_mm: float


def specimen_of(dimensions: Dimensions, metadata: Mapping[str, str] | None = None) -> Specimen:
    """Return the specimen with the specified dimensions; others are read from the metadata of the file.

    Raises
    ------
    DataError
        If a length or area in the file is not positive.
    """
    in_file = _from_metadata(metadata or {})
    length, section = dimensions.cube_mm or dimensions.length_mm, _specified_section(dimensions)
    headings: list[str] = []
    if length is None and "length" in in_file:
        length, heading = in_file["length"]
        headings.append(heading)
    if section is None:
        names = next((names for names in _FILE_SECTIONS if set(names) <= in_file.keys()), ())
        section = _section(**{name: in_file[name][0] for name in names})
        headings += [in_file[name][1] for name in names]
    u_mm = dimensions.u_geometry_mm
    return Specimen(
        length_mm=length,
        area_mm2=section.area_mm2 if section else None,
        perimeter_mm=section.perimeter_mm if section else None,
        u_length=None if u_mm is None or length is None else u_mm / length,
        u_area=None if u_mm is None or section is None else u_mm * section.error_per_mm,
        source=", ".join([*_options(dimensions), *(f"{heading} in the file" for heading in headings)]),
        area_error_per_mm=None if section is None else section.error_per_mm,
        is_cube=dimensions.cube_mm is not None,
        length_by_user=dimensions.cube_mm is not None or dimensions.length_mm is not None,
    )


def bonded_ratio(shape_factor: float) -> float | None:
    """Return the ratio of the apparent to the true Young's modulus of a block with bonded ends.

    The result is None for a pad that is flatter than all pads in the table.
    """
    if not 0 < shape_factor <= _SHAPE_FACTORS[-1]:
        return None
    return float(np.interp(shape_factor, _SHAPE_FACTORS, _BONDED))


def number_in(text: str, unit: str, heading: str = "") -> float | None:
    """Return the number in an entry of metadata, converted to a unit; None if there is none.

    The unit follows the number (``11.4 mm``), or is in the heading (``Width (mm)``); default: ``unit``.
    """
    number = _NUMBER.fullmatch(text.strip().strip('"'))
    if number is None:
        return None
    with_unit = _WITH_UNIT.fullmatch(heading)
    scale = factor((number[2] or (with_unit[2] if with_unit else "") or unit).strip(), unit)
    return None if scale is None else float(number[1].replace(",", ".")) * scale


def _from_metadata(metadata: Mapping[str, str]) -> dict[str, tuple[float, str]]:
    """Return the dimensions in the metadata of a file, each with its heading."""
    plain = {_plain(heading): (heading, text) for heading, text in metadata.items()}
    dimensions: dict[str, tuple[float, str]] = {}
    for dimension, words in _WORDS.items():
        for word in words.split(", "):
            heading, text = plain.get(word, ("", ""))
            value = number_in(text, "mm^2" if dimension == "area" else "mm", heading)
            if value is None:
                continue
            if not 0 < value < math.inf:
                remedy = "specify the dimension as an option"
                raise DataError(heading, value=text, limit="must be above 0", remedy=remedy)
            dimensions[dimension] = (value, heading)
            break
    return dimensions


def _plain(heading: str) -> str:
    with_unit = _WITH_UNIT.fullmatch(heading)
    return " ".join((with_unit[1] if with_unit else heading).casefold().replace("_", " ").split())


def _specified_section(dimensions: Dimensions) -> _Section | None:
    if dimensions.cube_mm is not None:
        return _section(width=dimensions.cube_mm, thickness=dimensions.cube_mm)
    return _section(dimensions.strip_width_mm, dimensions.thickness_mm, dimensions.diameter_mm, dimensions.area_mm2)


def _section(
    width: float | None = None, thickness: float | None = None, diameter: float | None = None, area: float | None = None
) -> _Section | None:
    """Return the cross-section from its sides, its diameter, or its area, for which a square is assumed."""
    if area is not None:
        width = thickness = math.sqrt(area)
    if width is not None and thickness is not None:
        return _Section(width * thickness, 2 * (width + thickness), math.hypot(1 / width, 1 / thickness))
    if diameter is not None:
        return _Section(math.pi / 4 * diameter**2, math.pi * diameter, 2 / diameter)
    return None


def _options(dimensions: Dimensions) -> list[str]:
    """Return the specified dimensions in one string, written as options on the command line."""
    given = dimensions.model_dump(exclude_none=True, exclude={"u_geometry_mm"})
    options = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in given.items())
    return [options] if options else []
