"""Spectra with their uncertainty: repeat measurements, specified accuracy, and errors common to all wavelengths.

Two kinds of error have different effects and are treated separately. Scatter from wavelength to wavelength averages out
over the spectrum of an LED or in a fit; a shift of the entire spectrum, due to a drifting lamp or a photometer that
reads 0.2 % high, does not. Repeats show both: their scatter about their mean offsets is the first kind, the scatter of
the offsets the second. Repeats that drift in one direction are not independent: their mean is no more accurate than a
single repeat.

Few repeats determine the scatter at a single wavelength poorly; neighbouring wavelengths have similar scatter, so their
variances are pooled. An uncertainty from few repeats is widened by Student's t, so that the standard uncertainty covers
68.27 % and the expanded one 95 % (GUM, JCGM 100:2008, annex G); the degrees of freedom of sums follow Welch and
Satterthwaite.

`reading` returns a `Reading` of a spectrum; `Length` is a thickness, `Contribution` is a part of an uncertainty, and
`combined` adds several contributions.
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

_MIN_POINTS = 8  # smallest number of wavelengths at which offsets are distinguished from scatter
_NEIGHBOURS = 21  # number of wavelengths whose scatter is pooled
_MAX_OFFSETS = 3.0  # scatter of the offsets, relative to that expected from noise, above which it is significant


@dataclass(frozen=True, eq=False)
class Contribution:
    """A part of an uncertainty: its signed value, degrees of freedom, and whether it is common to all wavelengths."""

    u: FloatArray
    df: float
    common: bool


@dataclass(frozen=True, eq=False)
class Reading:
    """A spectrum, the mean of its repeats, with its uncertainty.

    Attributes
    ----------
    value
        Mean of the repeats as a fraction, shape (n,).
    u_random
        Standard error of the mean due to scatter from wavelength to wavelength, shape (n,).
    u_common
        Standard errors common to all wavelengths, from repeats and from the specified accuracy, shape (2, n).
    df, df_random
        Degrees of freedom of the common error from repeats, and of the scatter; inf for a single spectrum.
    known
        Whether there are repeats or a specified accuracy; otherwise no uncertainty is reported.
    repeats
        Number of averaged spectra.
    warnings
        Warnings, one sentence each.
    """

    value: FloatArray
    u_random: FloatArray
    u_common: FloatArray
    df: float = np.inf
    df_random: float = np.inf
    known: bool = True
    repeats: int = 1
    warnings: tuple[Caution, ...] = ()

    def contributions(self, slope: FloatArray | float) -> list[Contribution]:
        """Return the contributions to the uncertainty of a quantity whose derivative is ``slope``; NaN if unknown."""
        factor = 1.0 if self.known else np.nan
        u_repeats, u_accuracy = self.u_common
        with np.errstate(invalid="ignore"):  # slopes may be infinite where no light is transmitted
            return [
                Contribution(np.asarray(slope * self.u_random * factor), self.df_random, False),
                Contribution(np.asarray(slope * u_repeats), self.df, True),
                Contribution(np.asarray(slope * u_accuracy), np.inf, True),
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
            limit = f"must be at least 0 and below the thickness, {self.um:g} µm"
            raise DataError("uncertainty of the thickness", value=f"{self.u_um:g} µm", limit=limit)


@dataclass(frozen=True, eq=False)
class Combined:
    """Combined uncertainty from independent contributions.

    Attributes
    ----------
    random
        Part that scatters from wavelength to wavelength, not widened, shape (n,).
    parts
        Contributions that are common to all wavelengths, with their signs, not widened, shape (parts, n).
    df
        Effective degrees of freedom, shape (n,).
    """

    random: FloatArray
    parts: FloatArray
    df: FloatArray

    def bound(self, level: float) -> FloatArray:
        """Return the half-width of the interval with this coverage."""
        u = np.sqrt(self.random**2 + (self.parts**2).sum(axis=0))
        return np.asarray(student_t(level, self.df) * u)

    @property
    def u(self) -> FloatArray:
        """Standard uncertainty, with a coverage of 68.27 %."""
        return self.bound(ONE_SIGMA)

    @property
    def u_random(self) -> FloatArray:
        """Part of `u` that scatters from wavelength to wavelength."""
        return student_t(ONE_SIGMA, self.df) * self.random

    @property
    def common(self) -> FloatArray:
        """Common parts of `u`: the covariance of two wavelengths is the sum of their products over the parts."""
        return student_t(ONE_SIGMA, self.df) * self.parts


def reading(repeats: ArrayLike, u_accuracy: ArrayLike | None = None, *, name: str = "the reading") -> Reading:
    """Return the mean of repeat measurements of a spectrum, with an uncertainty from their scatter and the accuracy.

    Parameters
    ----------
    repeats
        Fractions, shape (n,) for one spectrum, (repeats, n) for several.
    u_accuracy
        Standard uncertainty due to the accuracy of the instrument, a single number or one per wavelength, fully
        correlated between wavelengths; for a limit ± a use a/√3.
    name
        Name of the quantity in messages.
    """
    rows = np.atleast_2d(np.asarray(repeats, dtype=float))
    count, points = rows.shape
    u = np.broadcast_to(np.asarray(0.0 if u_accuracy is None else u_accuracy, dtype=float), points)
    if (invalid := u[(u < 0.0) | (u >= 1.0)]).size:
        limit = "must be a fraction of at least 0 and below 1"
        raise DataError(f"specified uncertainty of {name}", value=float(invalid[0]), limit=limit)
    if count == 1:
        zeros = np.zeros(points)
        return Reading(rows[0], zeros, np.stack([zeros, u]), known=u_accuracy is not None)
    mean, scatter, offset, warnings = _scatter(rows, name)
    common = np.stack([np.full(points, offset), u])
    df = count - 1.0
    pooled = 1 if points < _MIN_POINTS else min(_NEIGHBOURS, points)
    return Reading(mean, scatter / np.sqrt(count), common, df, df * pooled, repeats=count, warnings=warnings)


def combined(parts: Sequence[Contribution], points: int) -> Combined:
    """Return the root sum of squares of independent contributions."""
    values = np.array([part.u for part in parts]).reshape(len(parts), points)
    common = np.array([part.common for part in parts], dtype=bool)
    square = (values**2).sum(axis=0)
    fourth = sum((part.u**4 / part.df for part in parts), np.zeros(points))
    with np.errstate(divide="ignore", invalid="ignore"):
        df = np.where(fourth > 0.0, square**2 / fourth, np.inf)
    return Combined(np.sqrt((values[~common] ** 2).sum(axis=0)), values[common], df)


def student_t(level: float, df: ArrayLike) -> FloatArray:
    """Return the half-width, in standard deviations, of the interval of Student's t with this coverage."""
    df = np.asarray(df, dtype=float)
    half_width = np.where(np.isnan(df), np.nan, float(-ndtri(0.5 - level / 2.0)))
    finite = np.isfinite(df)
    half_width[finite] = stdtrit(df[finite], 0.5 + level / 2.0)
    return half_width


def _pooled(variance: FloatArray) -> FloatArray:
    """Return the mean variance over neighbouring points; NaN where a point has none."""
    known = np.isfinite(variance)
    width = min(_NEIGHBOURS, variance.size)
    sums, counts = (
        uniform_filter1d(values, width, mode="nearest") for values in (np.where(known, variance, 0.0), 1.0 * known)
    )
    return np.where(known, sums / np.where(known, np.maximum(counts, 1.0 / width), 1.0), np.nan)


def _scatter(rows: FloatArray, name: str) -> tuple[FloatArray, FloatArray, float, tuple[Caution, ...]]:
    """Return the mean, the scatter of the rows about their offsets, the error of the mean offset, and warnings."""
    count, points = rows.shape
    mean = rows.mean(axis=0)
    if points < _MIN_POINTS:
        return mean, rows.std(axis=0, ddof=1), 0.0, ()
    offsets = np.nanmean(rows - mean, axis=1)
    scatter = np.sqrt(_pooled(((rows - mean - offsets[:, None]) ** 2).sum(axis=0) / (count - 1)))
    sd = float(offsets.std(ddof=1))
    expected = float(np.sqrt(np.nanmean(scatter**2) / points))
    steps = np.diff(offsets)
    drifts = count > 2 and sd > _MAX_OFFSETS * expected and bool((steps > 0).all() or (steps < 0).all())
    if not drifts:
        return mean, scatter, sd / np.sqrt(count), ()
    first, last = (float(np.nanmean(rows[i])) for i in (0, -1))
    text = (
        f"the {count} repeat measurements of {name} drift in one direction, on average from {first:.5f} to "
        f"{last:.5f}: they are not independent, so the uncertainty of a single measurement is "
        "used, not that of their mean"
    )
    return mean, scatter, sd, (warning(text),)
