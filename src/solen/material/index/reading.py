"""Measured values with their uncertainty: repeats, specified accuracy, and errors common to an entire spectrum.

Two kinds of error act differently and are kept separate. Scatter from wavelength to wavelength averages out over an
LED's spectrum or in a fit; a shift of the entire spectrum, from a drifting lamp or a photometer that reads 0.2 % high,
does not. Repeats show both: their scatter about their own offsets is the first kind, the scatter of the offsets the
second. Repeats that drift in one direction are not independent: their mean is no more accurate than a single repeat.

Few repeats determine the scatter at a single wavelength poorly; neighbouring wavelengths scatter alike, so their
variances are pooled. An uncertainty from few repeats is widened by Student's t, so that the standard uncertainty covers
68.27 % and the expanded one 95 % (GUM, JCGM 100:2008, annex G); the degrees of freedom of sums follow Welch and
Satterthwaite.

`reading` returns a `Reading` of a spectrum; `Length` is a thickness, `Share` a contribution to an uncertainty, and
`combined` the sum of contributions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d
from scipy.special import ndtri, stdtrit

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.ranks import Caution, warning

ONE_SIGMA = 0.682689492137086
"""Fraction of a normal distribution within one standard deviation."""

_APART = 8  # number of wavelengths from which offsets of whole spectra are distinguished from scatter
_NEIGHBOURS = 21  # number of wavelengths whose scatter is pooled
_DRIFT = 3.0  # multiple of the expected scatter above which offsets are significant


@dataclass(frozen=True, eq=False)
class Share:
    """A part of an uncertainty: signed contribution, degrees of freedom, and whether all wavelengths share it."""

    u: FloatArray
    freedom: float
    common: bool


@dataclass(frozen=True, eq=False)
class Reading:
    """A quantity along a spectrum, the mean of its repeats.

    Attributes
    ----------
    value
        Mean of the repeats as a fraction, shape (n,).
    u_random
        Standard error of the scatter from wavelength to wavelength, shape (n,).
    u_common
        Standard errors common to all wavelengths, from repeats and from the stated accuracy, shape (2, n).
    freedom, freedom_random
        Degrees of freedom of the common error from repeats, and of the scatter; inf for a single spectrum.
    known
        Whether there are repeats or a stated accuracy; otherwise no uncertainty is reported.
    repeats
        Number of averaged spectra.
    remarks
        Warnings, in sentences.
    """

    value: FloatArray
    u_random: FloatArray
    u_common: FloatArray
    freedom: float = np.inf
    freedom_random: float = np.inf
    known: bool = True
    repeats: int = 1
    remarks: tuple[Caution, ...] = ()

    def shares(self, slope: FloatArray | float) -> list[Share]:
        """Return the contributions to a quantity that depends on the reading with this slope; NaN if unknown."""
        unknown = 1.0 if self.known else np.nan
        by_repeats, stated = self.u_common
        with np.errstate(invalid="ignore"):  # slopes may be infinite where no light is transmitted
            return [
                Share(np.asarray(slope * self.u_random * unknown), self.freedom_random, False),
                Share(np.asarray(slope * by_repeats), self.freedom, True),
                Share(np.asarray(slope * stated), np.inf, True),
            ]


@dataclass(frozen=True)
class Length:
    """A thickness in µm, with its standard uncertainty or None."""

    um: float
    u_um: float | None = None

    def __post_init__(self) -> None:
        if not 0.0 < self.um < np.inf:
            raise DataError("thickness", value=f"{self.um:g} µm", limit="must be finite and above 0")
        if self.u_um is not None and not 0.0 <= self.u_um < self.um:
            limit = f"must be at least 0 and below the thickness of {self.um:g} µm"
            raise DataError("uncertainty of the thickness", value=f"{self.u_um:g} µm", limit=limit)


@dataclass(frozen=True, eq=False)
class Combined:
    """Combined uncertainty of independent parts.

    Attributes
    ----------
    random
        Part that scatters from wavelength to wavelength, not widened, shape (n,).
    parts
        The individual common parts, with their signs, not widened, shape (parts, n).
    freedom
        Effective degrees of freedom, shape (n,).
    """

    random: FloatArray
    parts: FloatArray
    freedom: FloatArray

    def bound(self, level: float) -> FloatArray:
        """Return the half-width of the interval with this coverage."""
        raw = np.sqrt(self.random**2 + (self.parts**2).sum(axis=0))
        return np.asarray(student(level, self.freedom) * raw)

    @property
    def u(self) -> FloatArray:
        """Standard uncertainty, with a coverage of 68.27 %."""
        return self.bound(ONE_SIGMA)

    @property
    def u_random(self) -> FloatArray:
        """Part of `u` that scatters from wavelength to wavelength."""
        return student(ONE_SIGMA, self.freedom) * self.random

    @property
    def common(self) -> FloatArray:
        """Common parts of `u`: the covariance of two wavelengths is the sum of their products over the parts."""
        return student(ONE_SIGMA, self.freedom) * self.parts


def reading(repeats: ArrayLike, u_stated: ArrayLike | None = None, *, name: str = "the reading") -> Reading:
    """Return the mean of a spectrum's repeats, with an uncertainty from their scatter and the specified accuracy.

    Parameters
    ----------
    repeats
        Fractions, shape (n,) for one spectrum, (repeats, n) for several.
    u_stated
        Standard uncertainty of the instrument, a single number or one per wavelength, fully correlated between
        wavelengths; for a limit ± a use a/√3.
    name
        Name of the quantity in messages.
    """
    rows = np.atleast_2d(np.asarray(repeats, dtype=float))
    count, points = rows.shape
    stated = np.broadcast_to(np.asarray(0.0 if u_stated is None else u_stated, dtype=float), points)
    if ((stated < 0.0) | (stated >= 1.0)).any():
        limit = "must be a fraction of at least 0 and below 1"
        raise DataError(f"specified uncertainty of {name}", value=f"{np.nanmax(np.abs(stated)):g}", limit=limit)
    if count == 1:
        nothing = np.zeros(points)
        return Reading(rows[0], nothing, np.stack([nothing, stated]), known=u_stated is not None)
    mean, scatter, offset, remarks = _scatter(rows, name)
    common = np.stack([np.full(points, offset), stated])
    freedom = count - 1.0
    together = 1 if points < _APART else min(_NEIGHBOURS, points)
    return Reading(mean, scatter / np.sqrt(count), common, freedom, freedom * together, repeats=count, remarks=remarks)


def combined(parts: Sequence[Share], points: int) -> Combined:
    """Return the root sum of squares of independent parts of an uncertainty."""
    values = np.array([part.u for part in parts]).reshape(len(parts), points)
    common = np.array([part.common for part in parts], dtype=bool)
    square = (values**2).sum(axis=0)
    fourth = sum((part.u**4 / part.freedom for part in parts), np.zeros(points))
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.where(fourth > 0.0, square**2 / fourth, np.inf)
    return Combined(np.sqrt((values[~common] ** 2).sum(axis=0)), values[common], freedom)


def student(level: float, freedom: ArrayLike) -> FloatArray:
    """Return the half-width, in standard deviations, of the interval of Student's t with this coverage."""
    freedom = np.asarray(freedom, dtype=float)
    found = np.where(np.isnan(freedom), np.nan, float(-ndtri(0.5 - level / 2.0)))
    few = np.isfinite(freedom)
    found[few] = stdtrit(freedom[few], 0.5 + level / 2.0)
    return found


def _of_neighbours(variance: FloatArray) -> FloatArray:
    """Return the mean variance over neighbours; NaN where a point has none."""
    known = np.isfinite(variance)
    width = min(_NEIGHBOURS, variance.size)
    sums, counts = (
        uniform_filter1d(one, width, mode="nearest") for one in (np.where(known, variance, 0.0), 1.0 * known)
    )
    return np.where(known, sums / np.where(known, np.maximum(counts, 1.0 / width), 1.0), np.nan)


def _scatter(rows: FloatArray, name: str) -> tuple[FloatArray, FloatArray, float, tuple[Caution, ...]]:
    """Return the mean, the scatter of a row about its offset, the standard error of the mean offset, and remarks."""
    count, points = rows.shape
    mean = rows.mean(axis=0)
    if points < _APART:
        return mean, rows.std(axis=0, ddof=1), 0.0, ()
    offsets = np.nanmean(rows - mean, axis=1)
    scatter = np.sqrt(_of_neighbours(((rows - mean - offsets[:, None]) ** 2).sum(axis=0) / (count - 1)))
    spread = float(offsets.std(ddof=1))
    expected = float(np.sqrt(np.nanmean(scatter**2) / points))
    steps = np.diff(offsets)
    drifts = count > 2 and spread > _DRIFT * expected and bool((steps > 0).all() or (steps < 0).all())
    if not drifts:
        return mean, scatter, spread / np.sqrt(count), ()
    first, last = (float(np.nanmean(rows[i])) for i in (0, -1))
    remark = warning(
        f"the {count} repeats of {name} drift in one direction, on average from {first:.5f} to "
        f"{last:.5f}: the repeats are not independent, so the uncertainty of a single repeat is "
        "used, not that of their mean"
    )
    return mean, scatter, spread, (remark,)
