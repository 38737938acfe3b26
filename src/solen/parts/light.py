"""Light of a design's emitter: from the keys of the design, otherwise from the part that it names.

A design contains only the author's choices. Values from a datasheet or a file are looked up here once and stored as
plain numbers in `Light`.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from solen.errors import DataError
from solen.files import read_text
from solen.parts.datasheet import EmitterPart, library_part, load_part
from solen.spec import Design, Emitter
from solen.spec.light import pattern_problem

FWHM_PER_SIGMA = 2.0 * math.sqrt(2.0 * math.log(2.0))
HERMITE_NODES = (
    (0.0, 0.533333333333333333),
    (1.355626179974266, 0.222075922005612),
    (2.856970013872806, 0.011257411327720),
)
"""Gauss–Hermite nodes in standard deviations, from the centre outwards, with their weights."""
MAX_PEAK_DIFFERENCE_NM = 40.0
"""Maximum difference between the peak wavelength of a part and a specified wavelength without a warning."""
DEFAULT_CONES_DEG = {"fan": 120.0, "uniform": 180.0, "lambertian": 180.0, "table": 360.0}
"""Default full opening angle of each pattern."""

Kind = Literal["fan", "uniform", "lambertian", "table"]


@dataclass(frozen=True)
class Light:
    """The light of a design's emitter.

    Attributes
    ----------
    wavelength_nm
        Wavelength at which the lens is designed and the index is evaluated.
    spectrum
        Wavelengths in nm with their weights; empty for a single wavelength.
    pattern, exponent, table
        Kind of pattern, exponent m of cos^m, and pairs of an angle in degrees and a relative intensity.
    cone_deg
        Full opening angle.
    width_mm, height_mm
        Size of the chip across the axis and along y.
    ray_file
        Path of a ray file that replaces all of these values except the wavelength.
    source
        Origin of these values: the part and its document, or the design.
    warnings
        A warning if the specified wavelength contradicts the part.
    """

    wavelength_nm: float
    spectrum: tuple[tuple[float, float], ...] = ()
    pattern: Kind = "fan"
    exponent: float = 1.0
    table: tuple[tuple[float, float], ...] = ()
    cone_deg: float = 120.0
    width_mm: float = 0.0
    height_mm: float = 0.0
    ray_file: Path | None = None
    source: str = "the design's [emitter]"
    warnings: tuple[str, ...] = ()


def light_of(design: Design) -> Light:
    """Return the light of a design's emitter.

    Raises
    ------
    DataError
        If the part or pattern file cannot be found or read, or the part is not an emitter.
    """
    emitter, part = design.emitter, _part(design)
    table = _table(design, part)
    pattern: Kind = "table" if table else emitter.pattern
    wavelength_nm = emitter.wavelength_nm
    if not emitter.sets("wavelength_nm"):
        wavelength_nm = _mean_nm(emitter) or (part.peak_nm.nominal if part else wavelength_nm)
    return Light(
        wavelength_nm=wavelength_nm,
        spectrum=_spectrum(emitter, part, wavelength_nm),
        pattern=pattern,
        exponent=emitter.exponent,
        table=table,
        cone_deg=emitter.cone_deg if emitter.sets("cone_deg") else DEFAULT_CONES_DEG[pattern],
        width_mm=_size("width_mm", emitter, part),
        height_mm=_size("height_mm", emitter, part),
        ray_file=design.file_of(emitter.ray_file),
        source=f"{part.name}: {part.document}" if part else "the design's [emitter]",
        warnings=_contradiction(part, wavelength_nm),
    )


def _contradiction(part: EmitterPart | None, wavelength_nm: float) -> tuple[str, ...]:
    """Return a warning if the part does not emit light of the specified wavelength."""
    if part is None or abs(part.peak_nm.nominal - wavelength_nm) <= MAX_PEAK_DIFFERENCE_NM:
        return ()
    return (
        f"emitter.part {part.name} emits at {part.peak_nm.nominal:g} nm, but the light is traced at the specified "
        f"{wavelength_nm:g} nm; omit emitter.wavelength_nm and emitter.spectrum, or use a part that emits at this "
        "wavelength",
    )


def gaussian_lines(peak_nm: float, fwhm_nm: float) -> tuple[tuple[float, float], ...]:
    """Return five lines over which the mean of any polynomial up to degree 9 is that over a Gaussian spectrum."""
    sigma = fwhm_nm / FWHM_PER_SIGMA
    sides = [(sign * step, weight) for step, weight in HERMITE_NODES for sign in ((-1.0, 1.0) if step else (1.0,))]
    return tuple((peak_nm + sigma * step, weight) for step, weight in sorted(sides))


def _part(design: Design) -> EmitterPart | None:
    name = design.emitter.part
    if name is None:
        return None
    path = design.part_file
    part = library_part(name) if path is None else load_part(path)
    if not isinstance(part, EmitterPart):
        raise DataError("emitter.part", value=part.name, limit=f"is a {part.kind}, not an emitter")
    return part


def _mean_nm(emitter: Emitter) -> float | None:
    """Return the mean wavelength of a specified spectrum."""
    if not emitter.spectrum:
        return None
    return sum(nm * weight for nm, weight in emitter.spectrum) / sum(weight for _, weight in emitter.spectrum)


def _spectrum(emitter: Emitter, part: EmitterPart | None, peak_nm: float) -> tuple[tuple[float, float], ...]:
    """Return the specified spectral lines, or those of a Gaussian spectrum with the specified or the part's width."""
    if emitter.spectrum:
        return tuple(sorted(emitter.spectrum))
    fwhm_nm = emitter.fwhm_nm
    if fwhm_nm is None and part is not None and part.fwhm_nm is not None:
        fwhm_nm = part.fwhm_nm.nominal
    return gaussian_lines(peak_nm, fwhm_nm) if fwhm_nm else ()


def _table(design: Design, part: EmitterPart | None) -> tuple[tuple[float, float], ...]:
    """Return the table of the pattern: from the design or its file, otherwise from the part."""
    emitter = design.emitter
    path = design.file_of(emitter.pattern_file)
    if path is not None:
        return read_pattern(path)
    if emitter.pattern_table is not None:
        return emitter.pattern_table
    if part is not None and not emitter.sets("pattern"):
        return tuple(zip(part.pattern.angle_deg, part.pattern.relative, strict=True))
    return ()


def _size(name: Literal["width_mm", "height_mm"], emitter: Emitter, part: EmitterPart | None) -> float:
    quantity = getattr(part, name, None)
    if quantity is not None and not emitter.sets(name):
        return float(quantity.nominal)
    return float(getattr(emitter, name))


def read_pattern(path: Path) -> tuple[tuple[float, float], ...]:
    """Return angles in degrees and relative intensities from a text file: two numbers per line, ``#`` begins a comment.

    Raises
    ------
    DataError
        If the file cannot be read, a line is invalid, or the angles are not in ascending order from 0.
    """
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(read_text(path, DataError).splitlines(), start=1):
        words = line.partition("#")[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            angle, relative = (float(word) for word in words)
        except ValueError:
            limit = "must be an angle in degrees and a relative intensity"
            raise DataError(f"{path}: line {number}", value=line.strip(), limit=limit) from None
        rows.append((angle, relative))
    if problem := pattern_problem(rows):
        raise DataError(str(path), limit=problem)
    return tuple(rows)
