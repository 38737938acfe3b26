"""A specimen's dimensions, what they are uncertain by, and what rough platens do to a squat one.

The idea: stress and strain need an area and a length. They come from the user's options before the file's own
statement, and their uncertainty is the modulus's: E ∝ length/area. A block that is pressed between platens which hold
its ends cannot widen there, bulges, and appears stiffer than its material; how much depends on the shape factor, one
loaded area over the area that is free to bulge.

The interface: `Dimensions` are what is stated, `specimen_of` makes a `Specimen` of them and of a file's metadata;
`held_ends` is the apparent over the true modulus of a block that does not slip.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from solen.errors import DataError, SpecError
from solen.units import factor

_SHAPE_FACTORS = (0.0, 1 / 12, 1 / 8, 1 / 5.6, 1 / 4, 1 / 2.8, 1 / 2, 1 / 1.6)
_HELD = (1.0, 1.066, 1.102, 1.153, 1.232, 1.387, 1.668, 1.985)
"""Apparent over true modulus of an incompressible square block of that shape factor, ends held: finite elements at
small strain, extrapolated to a fine mesh, good to 0.3 %, which a test computes again. Gent and Lindley's formula of
1959, 1 + 2S², is made for flat pads and gives 1.125 for a cube."""

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
_UNITS = {"width": "mm", "thickness": "mm", "diameter": "mm", "area": "mm^2", "length": "mm"}


@dataclass(frozen=True)
class Dimensions:
    """What is stated of a specimen; None for what is not.

    Attributes
    ----------
    length_mm
        Length that the displacement is divided by: gauge length in tension, height in compression.
    area_mm2, width_mm, thickness_mm, diameter_mm
        Cross-section before the test, by itself or by its sides.
    cube_mm
        Side of a cube, instead of all of the above.
    u_mm
        Standard uncertainty of each measured length in mm, each read on its own; None where it is not known.
    """

    length_mm: float | None = None
    area_mm2: float | None = None
    width_mm: float | None = None
    thickness_mm: float | None = None
    diameter_mm: float | None = None
    cube_mm: float | None = None
    u_mm: float | None = None

    def __post_init__(self) -> None:
        for name in ("length_mm", "area_mm2", "width_mm", "thickness_mm", "diameter_mm", "cube_mm"):
            value = getattr(self, name)
            if value is not None and not 0 < value < math.inf:
                raise SpecError(_option(name), value=value, limit="must be above 0", remedy="measure the specimen")
        if self.u_mm is not None and not 0 <= self.u_mm < math.inf:
            raise SpecError("--u-geometry-mm", value=self.u_mm, limit="must be at least 0")
        ways = [self.area_mm2, self.diameter_mm, self.cube_mm, self.width_mm or self.thickness_mm]
        if sum(way is not None for way in ways) > 1:
            raise SpecError("cross-section", limit="is stated in more than one way", remedy="keep one of them")
        if (self.width_mm is None) != (self.thickness_mm is None):
            raise SpecError("cross-section", limit="needs both --width-mm and --thickness-mm")
        if self.cube_mm is not None and self.length_mm is not None:
            raise SpecError("--length-mm", limit="a cube's length is its side", remedy="drop one of the two")


@dataclass(frozen=True)
class Specimen:
    """Dimensions that stress and strain are made with; None for what neither the user nor the file states.

    Attributes
    ----------
    length_mm, area_mm2
        Before the test.
    perimeter_mm
        Around the cross-section; that of a square where only the area is known.
    u_length, u_area
        Relative standard uncertainties; None where not known.
    source
        Where the numbers come from, in words.
    area_error_per_mm
        How much of the area 1 mm of error in each of its sides or its diameter is, as a fraction.
    is_cube, length_by_user
        Whether the user says so, and states the length.
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
        """One loaded area over the area free to bulge; None where a dimension is not known."""
        if self.length_mm is None or self.area_mm2 is None or self.perimeter_mm is None:
            return None
        return self.area_mm2 / (self.perimeter_mm * self.length_mm)


@dataclass(frozen=True)
class _Section:
    """Area, perimeter, and how much of the area 1 mm of error in each of its lengths is, as a fraction."""

    area_mm2: float
    perimeter_mm: float
    error_per_mm: float


def specimen_of(stated: Dimensions, metadata: Mapping[str, str] | None = None) -> Specimen:
    """Specimen by what the user states, and for what is missing by the file's metadata.

    Raises
    ------
    DataError
        Where the file's statement is no length or area above 0.
    """
    found = _from_metadata(metadata or {})
    length = stated.cube_mm or stated.length_mm or (found.get("length", (None, ""))[0])
    section = _section(stated, found)
    u_mm = stated.u_mm
    words = [_said(stated), *(f"{name} of the file" for name in _used(stated, found))]
    return Specimen(
        length_mm=length,
        area_mm2=section.area_mm2 if section else None,
        perimeter_mm=section.perimeter_mm if section else None,
        u_length=None if u_mm is None or length is None else u_mm / length,
        u_area=None if u_mm is None or section is None else u_mm * section.error_per_mm,
        source=", ".join(filter(None, words)),
        area_error_per_mm=None if section is None else section.error_per_mm,
        is_cube=stated.cube_mm is not None,
        length_by_user=stated.cube_mm is not None or stated.length_mm is not None,
    )


def held_ends(shape_factor: float) -> float | None:
    """Apparent over true Young's modulus of a block whose ends cannot widen; None for a flat pad beyond the table."""
    if not 0 < shape_factor <= _SHAPE_FACTORS[-1]:
        return None
    return float(np.interp(shape_factor, _SHAPE_FACTORS, _HELD))


def number_in(text: str, unit: str, heading: str = "") -> float | None:
    """Number that a piece of metadata states, in a unit; None where it states none.

    The unit stands after the number (``11.4 mm``), or in its heading (``Width (mm)``); none means ``unit`` itself.
    """
    stated = _NUMBER.fullmatch(text.strip().strip('"'))
    if stated is None:
        return None
    headed = _HEADED.fullmatch(heading)
    scale = factor((stated[2] or (headed[2] if headed else "") or unit).strip(), unit)
    return None if scale is None else float(stated[1].replace(",", ".")) * scale


def _from_metadata(metadata: Mapping[str, str]) -> dict[str, tuple[float, str]]:
    """Dimensions that a file states, each with the words it does so."""
    plain = {_plain(heading): (heading, text) for heading, text in metadata.items()}
    found: dict[str, tuple[float, str]] = {}
    for dimension, words in _WORDS.items():
        for word in words.split(", "):
            heading, text = plain.get(word, ("", ""))
            value = number_in(text, _UNITS[dimension], heading)
            if value is None:
                continue
            if not 0 < value < math.inf:
                raise DataError(heading, value=text, limit="must be above 0", remedy="state the dimension as an option")
            found[dimension] = (value, heading)
            break
    return found


def _plain(heading: str) -> str:
    headed = _HEADED.fullmatch(heading)
    return " ".join((headed[1] if headed else heading).casefold().replace("_", " ").split())


def _section(stated: Dimensions, found: Mapping[str, tuple[float, str]]) -> _Section | None:
    """Cross-section, by what the user states before what the file does."""
    if stated.cube_mm is not None:
        return _rectangle(stated.cube_mm, stated.cube_mm)
    if stated.area_mm2 is not None:
        return _rectangle(math.sqrt(stated.area_mm2), math.sqrt(stated.area_mm2))
    if stated.width_mm is not None and stated.thickness_mm is not None:
        return _rectangle(stated.width_mm, stated.thickness_mm)
    if stated.diameter_mm is not None:
        return _circle(stated.diameter_mm)
    if "width" in found and "thickness" in found:
        return _rectangle(found["width"][0], found["thickness"][0])
    if "diameter" in found:
        return _circle(found["diameter"][0])
    return _rectangle(math.sqrt(found["area"][0]), math.sqrt(found["area"][0])) if "area" in found else None


def _rectangle(first: float, second: float) -> _Section:
    return _Section(first * second, 2 * (first + second), math.hypot(1 / first, 1 / second))


def _circle(diameter: float) -> _Section:
    return _Section(math.pi / 4 * diameter**2, math.pi * diameter, 2 / diameter)


def _used(stated: Dimensions, found: Mapping[str, tuple[float, str]]) -> list[str]:
    """Headings of the file that are used."""
    names = []
    if stated.cube_mm is None and stated.length_mm is None and "length" in found:
        names.append("length")
    if all(each is None for each in (stated.cube_mm, stated.area_mm2, stated.width_mm, stated.diameter_mm)):
        pair = {"width", "thickness"} <= set(found)
        names += ["width", "thickness"] if pair else [n for n in ("diameter", "area") if n in found][:1]
    return [found[name][1] for name in names]


def _said(stated: Dimensions) -> str:
    names = ("cube_mm", "length_mm", "area_mm2", "width_mm", "thickness_mm", "diameter_mm")
    return " ".join(f"{_option(n)} {getattr(stated, n):g}" for n in names if getattr(stated, n) is not None)


def _option(name: str) -> str:
    return "--" + name.replace("_", "-")
