"""Working curve Dc = Dp ln(E/Ec), the thickness of cured discs against dose, with its uncertainty.

Light decays exponentially with depth, and resin cures where the dose exceeds a threshold (Jacobs, Rapid Prototyping &
Manufacturing, 1992, chapter 4). The thickness is therefore linear in the logarithm of the dose, a + b ln E, with Dp = b
and ln Ec = −a/b. Thick discs often scatter more than thin ones: with ``scatter="auto"`` the scatter is assumed to grow
with the power 0, ½ or 1 of the thickness, whichever has the maximum likelihood. The intervals follow from the
residuals, so they are valid even if that choice is wrong (decision 0028). Ec is the dose at which the line crosses
zero; its interval is Fieller's, which is not symmetric. Outliers are excluded by Rosner's test and listed. If the mean
thickness at a dose is below a specified limit, all discs of that dose are omitted.

The model assumes a single wavelength, a resin that does not bleach, and an effect of the dose that is independent of
the irradiance; it includes neither oxygen inhibition nor diffusion. If any of these effects matters, the points deviate
from a straight line, which the lack-of-fit test reports.

`working_curve` returns a `WorkingCurve`, whose methods compute values and intervals for a dose or a depth.
`solen.material.cure.cautions` describes its limitations in sentences.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.regression import (
    LinearFit,
    f_tail,
    fitted,
    group_means,
    group_numbers,
    rosner_outliers,
    t_quantile,
)
from solen.results import HIDDEN, Result, reported

Scatter = Literal["auto", "proportional", "constant"]
EXPONENTS = {"auto": (0.0, 0.5, 1.0), "proportional": (1.0,), "constant": (0.0,)}
"""Exponents of the power laws by which the scatter may grow with thickness, keyed by scatter model."""
MIN_SCATTER_THICKNESS = 0.05
"""Thickness, as a fraction of that of the thickest disc, below which the scatter is assumed not to decrease further."""
MAX_OUTLIER_FRACTION = 0.2
"""Maximum fraction of the discs that may be excluded; one disc may always be excluded."""
DOSE_RANGE_MJ_PER_CM2, MAX_THICKNESS_UM = (1e-6, 1e9), 1e6
"""Limits of doses and thicknesses."""
SIGNIFICANCE = 0.05
"""The mean thicknesses are reported to deviate from the line if the p-value is below this level."""
_MAX_ITERATIONS, _TOLERANCE = 30, 1e-9
_MAX_LN_EC = 100.0  # largest magnitude of the logarithm of a critical dose in mJ/cm²
_MAX_LN = 700.0  # largest logarithm of a dose that does not overflow


@dataclass(frozen=True)
class Disc:
    """A cured disc: its dose, its thickness, and its row in the table, counted from 1."""

    dose_mJ_per_cm2: float
    thickness_um: float
    row: int


@dataclass(frozen=True)
class OmittedDisc:
    """A disc that is omitted from the fit, with the reason; ``t`` is an outlier's deletion residual, otherwise None."""

    disc: Disc
    reason: str
    t: float | None = None


@dataclass(frozen=True)
class LackOfFit:
    """Lack-of-fit test: F = variance of the mean thicknesses about the line / variance of discs of equal dose."""

    F: float
    df: tuple[int, int]
    p: float


class WorkingCurve(Result, kw_only=True):
    """Result of `working_curve`.

    Attributes
    ----------
    fit
        Fit of the thickness in µm to (1, ln E), with E in mJ/cm².
    scatter_exponent
        Exponent of the power law by which the scatter of the discs grows with thickness.
    sd_thickness_um, mean_thickness_um
        Standard deviation of discs with the mean thickness, and the mean thickness.
    used, left_out
        Discs included in the fit, and omitted discs.
    lack_of_fit
        Lack-of-fit test; None if fewer than three doses, or no replicates, remain.
    by_dose
        Whether the mean thicknesses at each dose were fitted instead of the discs, because they deviate from the line
        by more than the scatter of the discs explains.
    """

    fit: LinearFit = field(metadata=HIDDEN)
    scatter_exponent: float
    sd_thickness_um: float
    mean_thickness_um: float
    used: tuple[Disc, ...]
    left_out: tuple[OmittedDisc, ...]
    lack_of_fit: LackOfFit | None
    by_dose: bool

    @reported
    def Dp_um(self) -> float:
        """Penetration depth."""
        return float(self.fit.parameters[1])

    @reported
    def u_Dp_um(self) -> float:
        """Standard uncertainty of the penetration depth."""
        return self.fit.u((0.0, 1.0))

    @reported
    def interval95_Dp_um(self) -> tuple[float, float]:
        """95 % interval of the penetration depth."""
        return self.fit.interval((0.0, 1.0))

    @property
    def ln_Ec(self) -> float:
        """Logarithm of the critical dose in mJ/cm²."""
        return float(-self.fit.parameters[0] / self.fit.parameters[1])

    @reported
    def Ec_mJ_per_cm2(self) -> float:
        """Critical dose, the lowest dose at which resin cures."""
        return math.exp(self.ln_Ec)

    @reported
    def u_ln_Ec(self) -> float:
        """Standard uncertainty of the logarithm of the critical dose, to first order."""
        return math.sqrt(self.covariance_ln[1, 1])

    @reported
    def interval95_Ec_mJ_per_cm2(self) -> tuple[float, float] | None:
        """95 % interval of the critical dose; None if the slope is too uncertain for an interval to exist."""
        return self.dose_interval95(0.0)

    @reported
    def covariance_ln(self) -> FloatArray:
        """Covariance of (Dp, ln Ec), shape (2, 2), to first order."""
        slope = self.Dp_um
        jacobian = np.array([[0.0, 1.0], [-1.0 / slope, -self.ln_Ec / slope]])
        return np.asarray(jacobian @ self.fit.covariance @ jacobian.T)

    @reported
    def covariance(self) -> FloatArray:
        """Covariance of (Dp, Ec), shape (2, 2), to first order."""
        scale = np.array([1.0, self.Ec_mJ_per_cm2])
        return self.covariance_ln * np.outer(scale, scale)

    @reported
    def discs(self) -> int:
        """Number of fitted discs."""
        return len(self.used)

    @reported
    def doses(self) -> int:
        """Number of different doses of the fitted discs."""
        return len({disc.dose_mJ_per_cm2 for disc in self.used})

    @reported
    def dose_range_mJ_per_cm2(self) -> tuple[float, float]:
        """Lowest and highest doses of the fitted discs."""
        doses = [disc.dose_mJ_per_cm2 for disc in self.used]
        return min(doses), max(doses)

    def depth_um(self, dose: ArrayLike) -> FloatArray:
        """Return the cure depth at a dose in mJ/cm²; negative below the critical dose, where nothing cures."""
        return np.asarray(self.fit.parameters[0] + self.fit.parameters[1] * np.log(np.asarray(dose, float)))

    def half_width_um(self, dose: ArrayLike, *, of_one_disc: bool = False) -> FloatArray:
        """Return the half width of the 95 % interval of the cure depth at a dose, for the curve or for a new disc."""
        doses = np.atleast_1d(np.asarray(dose, float))
        halves = []
        for ln_dose, depth in zip(np.log(doses).tolist(), self.depth_um(doses).tolist(), strict=True):
            disc_variance = self.disc_sigma_um(depth) ** 2 if of_one_disc else 0.0
            contrast = (1.0, ln_dose)
            u = math.sqrt(self.fit.u(contrast) ** 2 + disc_variance)
            halves.append(t_quantile(0.95, self.fit.df(contrast)) * u)
        return np.reshape(halves, np.shape(dose))

    def disc_sigma_um(self, depth_um: float) -> float:
        """Return the standard deviation of discs of a given thickness."""
        um = max(depth_um, MIN_SCATTER_THICKNESS * max(disc.thickness_um for disc in self.used))
        return float(self.sd_thickness_um * (um / self.mean_thickness_um) ** self.scatter_exponent)

    def dose_mJ_per_cm2(self, depth_um: float) -> float:
        """Return the dose that cures resin to a depth; infinite if it overflows."""
        ln_dose = (depth_um - self.fit.parameters[0]) / self.fit.parameters[1]
        return math.exp(ln_dose) if ln_dose < _MAX_LN else math.inf

    def dose_interval95(self, depth_um: float) -> tuple[float, float] | None:
        """Return the 95 % interval of the dose that cures resin to a depth; None if the slope is too uncertain.

        The interval contains all doses at which the 95 % interval of the cure depth includes that depth (Fieller,
        Journal of the Royal Statistical Society B 16, 175, 1954).
        """
        (a, b), covariance = self.fit.parameters, self.fit.covariance
        ln_dose = (depth_um - a) / b
        t2 = t_quantile(0.95, self.fit.df((1.0, ln_dose))) ** 2
        quadratic = b**2 - t2 * covariance[1, 1]
        if not quadratic > 0.0:
            return None
        half_linear = (a - depth_um) * b - t2 * covariance[0, 1]
        constant = (a - depth_um) ** 2 - t2 * covariance[0, 0]
        root = math.sqrt(max(half_linear**2 - quadratic * constant, 0.0))
        low, high = (-half_linear - root) / quadratic, (-half_linear + root) / quadratic
        return (math.exp(low), math.exp(high)) if high < _MAX_LN else None


def working_curve(
    dose: ArrayLike,
    thickness_um: ArrayLike,
    *,
    scatter: Scatter = "auto",
    min_thickness_um: float | None = None,
    keep_all: bool = False,
    rows: Sequence[int] | None = None,
) -> WorkingCurve:
    """Fit Dc = Dp ln(E/Ec) to discs.

    Parameters
    ----------
    dose
        Dose of each disc in mJ/cm², shape (n,).
    thickness_um
        Thickness of each disc, shape (n,). Discs with NaN (not measured) or 0 (nothing cured) are omitted and listed.
    scatter
        Scatter of the discs: proportional to thickness, constant, or to be estimated.
    min_thickness_um
        Doses whose discs have a lower mean thickness are omitted.
    keep_all
        Include outliers.
    rows
        Row number of each disc, used in messages; by default they count from 1.

    Raises
    ------
    DataError
        If a dose is not above 0; if a thickness is negative or implausibly large; if fewer than two doses or three
        discs remain; or if the thickness does not grow with the dose.
    """
    discs = _discs(dose, thickness_um, rows)
    omitted = _unusable(discs) + _too_thin(discs, min_thickness_um)
    used = _without(discs, omitted)
    _check_count(used, omitted)
    if not keep_all:
        omitted += _outliers(used, scatter)
        used = _without(discs, omitted)
    fit, exponent = _fit(used, scatter)
    lack = _lack_of_fit(used, exponent, fit)
    by_dose = lack is not None and lack.p < SIGNIFICANCE
    if by_dose:
        fit, exponent = _fit(means_of(used), scatter)
    a, b = fit.parameters
    if not (b > 0.0 and abs(a) < _MAX_LN_EC * b):
        limit = f"the thickness must increase with the dose, and Ec must be finite (slope: {b:.3g} µm per factor of e)"
        remedy = "check whether the columns are swapped, or use more widely spaced doses"
        raise DataError("working curve", limit=limit, remedy=remedy)
    mean_um = float(np.mean([disc.thickness_um for disc in used]))
    return WorkingCurve(
        fit=fit,
        scatter_exponent=exponent,
        sd_thickness_um=fit.sigma * mean_um**exponent,
        mean_thickness_um=mean_um,
        used=used,
        left_out=tuple(omitted),
        lack_of_fit=lack,
        by_dose=by_dose,
    )


def _discs(dose: ArrayLike, thickness_um: ArrayLike, rows: Sequence[int] | None) -> tuple[Disc, ...]:
    doses, um = np.asarray(dose, float), np.asarray(thickness_um, float)
    row_numbers = list(range(1, len(doses) + 1) if rows is None else rows)
    (low, high), max_um = DOSE_RANGE_MJ_PER_CM2, MAX_THICKNESS_UM
    for name, values, invalid, limit in (
        ("dose", doses, ~((doses >= low) & (doses <= high)), f"must be from {low:g} to {high:g} mJ/cm²"),
        ("thickness", um, (um < 0.0) | (um > max_um), f"must be from 0 to {max_um:g} µm"),
    ):
        if invalid.any():
            first = int(np.flatnonzero(invalid)[0])
            value = f"{values[first]:g} (row {row_numbers[first]})"
            raise DataError(f"working curve: {name}", value=value, limit=limit, remedy="correct or remove the row")
    return tuple(map(Disc, doses.tolist(), um.tolist(), row_numbers))


def _unusable(discs: tuple[Disc, ...]) -> list[OmittedDisc]:
    return [
        OmittedDisc(disc, "nothing cured" if disc.thickness_um == 0.0 else "no thickness")
        for disc in discs
        if not disc.thickness_um > 0.0
    ]


def _too_thin(discs: tuple[Disc, ...], min_um: float | None) -> list[OmittedDisc]:
    """Return the discs of doses whose mean thickness is below a limit."""
    if min_um is None:
        return []
    usable = tuple(disc for disc in discs if disc.thickness_um > 0.0)
    thin = {mean.dose_mJ_per_cm2: mean.thickness_um for mean in means_of(usable) if mean.thickness_um < min_um}
    return [
        OmittedDisc(disc, f"the mean thickness at its dose is {thin[disc.dose_mJ_per_cm2]:.3g} µm, below {min_um:g} µm")
        for disc in usable
        if disc.dose_mJ_per_cm2 in thin
    ]


def _without(discs: tuple[Disc, ...], omitted: list[OmittedDisc]) -> tuple[Disc, ...]:
    rows = {entry.disc.row for entry in omitted}
    return tuple(disc for disc in discs if disc.row not in rows)


def _check_count(used: tuple[Disc, ...], omitted: list[OmittedDisc]) -> None:
    doses = {disc.dose_mJ_per_cm2 for disc in used}
    if len(doses) >= 2 and len(used) >= 3:
        return
    counts = f"discs: {len(used)}, doses: {len(doses)}" + (f"; {len(omitted)} discs omitted" if omitted else "")
    limit = f"requires at least 3 discs at 2 doses ({counts})"
    raise DataError("working curve", limit=limit, remedy="cure three discs at each of at least five doses")


def means_of(discs: tuple[Disc, ...]) -> tuple[Disc, ...]:
    """Return one disc per dose, with the mean thickness at that dose."""
    doses = [disc.dose_mJ_per_cm2 for disc in discs]
    rows: dict[float, int] = {}
    for disc in discs:
        rows.setdefault(disc.dose_mJ_per_cm2, disc.row)
    means = group_means(doses, [disc.thickness_um for disc in discs])
    return tuple(Disc(dose, mean, rows[dose]) for dose, mean in means.items())


def _columns(discs: tuple[Disc, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of the doses, and the thicknesses."""
    return np.log([disc.dose_mJ_per_cm2 for disc in discs]), np.array([disc.thickness_um for disc in discs])


def _weights(x: FloatArray, y: FloatArray, exponent: float) -> FloatArray:
    """Return weights from the fitted thicknesses; weights from measured thicknesses would favour thin discs."""
    weights = np.ones(len(y))
    previous = 0.0
    for _ in range(1 if exponent == 0.0 else _MAX_ITERATIONS):
        total, mean = weights.sum(), weights @ x / weights.sum()
        slope = float(weights @ ((x - mean) * y) / (weights @ (x - mean) ** 2))
        line = weights @ y / total + slope * (x - mean)
        weights = np.maximum(line, MIN_SCATTER_THICKNESS * max(float(line.max()), float(y.max()))) ** (-2.0 * exponent)
        if abs(slope - previous) <= _TOLERANCE * abs(slope):
            break
        previous = slope
    return weights


def _most_likely(x: FloatArray, y: FloatArray, scatter: Scatter) -> tuple[LinearFit, float]:
    """Return the maximum-likelihood fit and its scatter exponent."""
    design = np.column_stack([np.ones(len(x)), x])
    fits = {exponent: fitted(design, y, weights=_weights(x, y, exponent)) for exponent in EXPONENTS[scatter]}
    best = min(fits, key=lambda exponent: fits[exponent].criterion)
    return fits[best], best


def _fit(discs: tuple[Disc, ...], scatter: Scatter) -> tuple[LinearFit, float]:
    """Return the maximum-likelihood fit and its exponent, with robust intervals if the exponent is estimated."""
    x, y = _columns(discs)
    fit, exponent = _most_likely(x, y, scatter)
    if scatter != "auto" or fit.sigma == 0.0:
        return fit, exponent
    design = np.column_stack([np.ones(len(x)), x])
    return fitted(design, y, weights=_weights(x, y, exponent), robust=True), exponent


def _outliers(used: tuple[Disc, ...], scatter: Scatter) -> list[OmittedDisc]:
    """Return the outliers; if most discs of a dose deviate together, the line is wrong and the discs are kept."""
    max_outliers = min(max(1, int(MAX_OUTLIER_FRACTION * len(used))), len(used) - 4)
    if max_outliers < 1:
        return []
    x, y = _columns(used)
    outliers = rosner_outliers(lambda keep: _most_likely(x[keep], y[keep], scatter)[0], len(used), max_outliers)
    doses = [disc.dose_mJ_per_cm2 for disc in used]
    outlying = [doses[number] for number in outliers]
    minority = {dose for dose in outlying if 2 * outlying.count(dose) <= doses.count(dose) or doses.count(dose) == 1}
    remaining = {dose for number, dose in enumerate(doses) if number not in outliers or dose not in minority}
    return [
        OmittedDisc(used[number], "outlier", t)
        for number, t in outliers.items()
        if doses[number] in minority and len(remaining) > 1
    ]


def _lack_of_fit(used: tuple[Disc, ...], exponent: float, fit: LinearFit) -> LackOfFit | None:
    """Test whether the means at each dose deviate from the line by more than the scatter of the discs explains."""
    x, y = _columns(used)
    weights = _weights(x, y, exponent)
    group = group_numbers(x.tolist())
    counts = np.bincount(group)
    means = np.bincount(group, weights=y) / counts
    between, within = len(counts) - 2, len(y) - len(counts)
    pure_error = float(weights @ (y - means[group]) ** 2)
    if between < 1 or within < 1 or not pure_error > 0.0:
        return None
    a, b = fit.parameters
    misfit = float(weights @ (means[group] - a - b * x) ** 2)
    ratio = (misfit / between) / (pure_error / within)
    return LackOfFit(ratio, (between, within), f_tail(ratio, between, within))
