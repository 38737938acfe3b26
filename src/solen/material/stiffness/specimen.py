"""Dimensions of a specimen, their uncertainties, and the effect of rough platens on a squat specimen.

Stress and strain require an area and a length. The user's options have priority over the file's values, and their
uncertainties enter the modulus: E ∝ length/area. A block pressed between platens that hold its ends cannot widen there,
bulges, and appears stiffer than its material; the effect depends on the shape factor, a single loaded area over the
area that is free to bulge.

`specimen_of` makes a `Specimen` from `Dimensions` and a file's metadata; `held_ends` returns the apparent over the true
modulus of a block that does not slip.
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
_HELD = (1.0, 1.066, 1.102, 1.153, 1.232, 1.387, 1.668, 1.985)
"""Apparent over true modulus of an incompressible square block with held ends, by shape factor: finite elements at
small strain, extrapolated to a fine mesh, accurate to 0.3 %, which a test recomputes. Gent and Lindley's formula
of 1959, 1 + 2S², is made for flat pads and gives 1.125 for a cube.
"""

_NUMBER = re.compile(r"([-+]?\d+(?:[.,]\d+)?(?:e[-+]?\d+)?)\s*([^\d\s].*)?", re.IGNORECASE)
_HEADED = re.compile(r"(.*?)\s*[(\[]([^()\[\]]*)[)\]]\s*")
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
    """Stated dimensions of a specimen."""

    cube_mm: Finite | None = Field(None, gt=0.0)
    """Side of a compressed cube, instead of all of the following."""
    length_mm: Finite | None = Field(None, gt=0.0)
    """Gauge length, or height in compression, by which the displacement is divided; overrides the file's strain."""
    area_mm2: Finite | None = Field(None, gt=0.0)
    """Cross-section before the test in mm²."""
    strip_width_mm: Finite | None = Field(None, gt=0.0)
    """Width of the cross-section, with --thickness-mm."""
    thickness_mm: Finite | None = Field(None, gt=0.0)
    """Thickness of the cross-section, with --strip-width-mm."""
    diameter_mm: Finite | None = Field(None, gt=0.0)
    """Diameter of a round cross-section."""
    u_geometry_mm: Finite | None = Field(None, ge=0.0)
    """Standard uncertainty of each of these lengths, assuming independent errors."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        statements = [self.area_mm2, self.diameter_mm, self.cube_mm, self.strip_width_mm or self.thickness_mm]
        if sum(statement is not None for statement in statements) > 1:
            raise refused("area_mm2", "the cross-section is specified in more than one way", remedy="keep one of them")
        if (self.strip_width_mm is None) != (self.thickness_mm is None):
            raise refused("strip_width_mm", "a cross-section requires both --strip-width-mm and --thickness-mm")
        if self.cube_mm is not None and self.length_mm is not None:
            raise refused("length_mm", "a cube's length is its side", remedy="remove one of the two")
        return self


@dataclass(frozen=True)
class Specimen:
    """Dimensions for stress and strain; None for those that neither the user nor the file states.

    Attributes
    ----------
    length_mm, area_mm2
        Length and cross-section before the test.
    perimeter_mm
        Perimeter of the cross-section; that of a square if only the area is known.
    u_length, u_area
        Relative standard uncertainties; None if not known.
    source
        Origin of the numbers, in words.
    area_error_per_mm
        Relative error of the area per 1 mm of error in each of its sides or its diameter.
    is_cube, length_by_user
        Whether the user states a cube, and a length.
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
        """One loaded area over the area free to bulge; None if a dimension is not known."""
        if self.length_mm is None or self.area_mm2 is None or self.perimeter_mm is None:
            return None
        return self.area_mm2 / (self.perimeter_mm * self.length_mm)


@dataclass(frozen=True)
class _Section:
    """Area, perimeter, and relative error of the area per 1 mm of error in each of its lengths."""

    area_mm2: float
    perimeter_mm: float
    error_per_mm: float


def specimen_of(stated: Dimensions, metadata: Mapping[str, str] | None = None) -> Specimen:
    """Return the specimen from the user's statements, completed by the file's metadata.

    Raises
    ------
    DataError
        If a length or area stated by the file is not positive.
    """
    in_file = _from_metadata(metadata or {})
    length, section = stated.cube_mm or stated.length_mm, _stated_section(stated)
    headings: list[str] = []
    if length is None and "length" in in_file:
        length, heading = in_file["length"]
        headings.append(heading)
    if section is None:
        names = next((names for names in _FILE_SECTIONS if set(names) <= in_file.keys()), ())
        section = _section(**{name: in_file[name][0] for name in names})
        headings += [in_file[name][1] for name in names]
    u_mm = stated.u_geometry_mm
    return Specimen(
        length_mm=length,
        area_mm2=section.area_mm2 if section else None,
        perimeter_mm=section.perimeter_mm if section else None,
        u_length=None if u_mm is None or length is None else u_mm / length,
        u_area=None if u_mm is None or section is None else u_mm * section.error_per_mm,
        source=", ".join([*_options(stated), *(f"{heading} of the file" for heading in headings)]),
        area_error_per_mm=None if section is None else section.error_per_mm,
        is_cube=stated.cube_mm is not None,
        length_by_user=stated.cube_mm is not None or stated.length_mm is not None,
    )


def held_ends(shape_factor: float) -> float | None:
    """Return apparent over true Young's modulus of a block with held ends; None for a flat pad beyond the table."""
    if not 0 < shape_factor <= _SHAPE_FACTORS[-1]:
        return None
    return float(np.interp(shape_factor, _SHAPE_FACTORS, _HELD))


def number_in(text: str, unit: str, heading: str = "") -> float | None:
    """Return the number stated in metadata, in a unit; None if there is none.

    The unit follows the number (``11.4 mm``), or is in its heading (``Width (mm)``); default: ``unit``.
    """
    stated = _NUMBER.fullmatch(text.strip().strip('"'))
    if stated is None:
        return None
    headed = _HEADED.fullmatch(heading)
    scale = factor((stated[2] or (headed[2] if headed else "") or unit).strip(), unit)
    return None if scale is None else float(stated[1].replace(",", ".")) * scale


def _from_metadata(metadata: Mapping[str, str]) -> dict[str, tuple[float, str]]:
    """Return the dimensions that a file states, each with its heading."""
    plain = {_plain(heading): (heading, text) for heading, text in metadata.items()}
    dimensions: dict[str, tuple[float, str]] = {}
    for dimension, words in _WORDS.items():
        for word in words.split(", "):
            heading, text = plain.get(word, ("", ""))
            value = number_in(text, "mm^2" if dimension == "area" else "mm", heading)
            if value is None:
                continue
            if not 0 < value < math.inf:
                raise DataError(
                    heading, value=text, limit="must be above 0", remedy="specify the dimension as an option"
                )
            dimensions[dimension] = (value, heading)
            break
    return dimensions


def _plain(heading: str) -> str:
    headed = _HEADED.fullmatch(heading)
    return " ".join((headed[1] if headed else heading).casefold().replace("_", " ").split())


def _stated_section(stated: Dimensions) -> _Section | None:
    if stated.cube_mm is not None:
        return _section(width=stated.cube_mm, thickness=stated.cube_mm)
    return _section(stated.strip_width_mm, stated.thickness_mm, stated.diameter_mm, stated.area_mm2)


def _section(
    width: float | None = None, thickness: float | None = None, diameter: float | None = None, area: float | None = None
) -> _Section | None:
    """Return the cross-section from its sides, its diameter, or its area, which is assumed to be square."""
    if area is not None:
        width = thickness = math.sqrt(area)
    if width is not None and thickness is not None:
        return _Section(width * thickness, 2 * (width + thickness), math.hypot(1 / width, 1 / thickness))
    if diameter is not None:
        return _Section(math.pi / 4 * diameter**2, math.pi * diameter, 2 / diameter)
    return None


def _options(stated: Dimensions) -> list[str]:
    """Return the user's options, written as on the command line."""
    given = stated.model_dump(exclude_none=True, exclude={"u_geometry_mm"})
    words = " ".join(f"--{name.replace('_', '-')} {value:g}" for name, value in given.items())
    return [words] if words else []
