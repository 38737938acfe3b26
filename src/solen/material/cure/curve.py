"""Working curve Dc = Dp ln(E/Ec), the thickness of cured discs against dose, with its uncertainty.

Light decays exponentially with depth, and resin sets where the dose exceeds a threshold (Jacobs, Rapid Prototyping &
Manufacturing, 1992, chapter 4). The thickness is therefore linear in the logarithm of the dose, a + b ln E, with Dp = b
and ln Ec = −a/b. Thick discs often scatter more than thin ones, and thin soft ones scatter badly: with
``scatter="auto"`` the scatter is assumed to grow with the power 0, ½ or 1 of the thickness, whichever has the maximum
likelihood. The intervals follow from the residuals, so they are valid even if that choice is wrong (decision 0028). Ec
is the dose at which the line crosses zero; its interval is Fieller's, which is not symmetric. Outliers are excluded by
a documented rule and listed. Doses whose mean thickness is below a specified limit are omitted entirely, never disc by
disc.

The model assumes a single wavelength, a resin that does not bleach, and a dose whose effect is independent of the rate;
it includes neither oxygen inhibition nor diffusion. If any of these effects matters, the points deviate from a line,
which the lack-of-fit test reports.

`working_curve` returns a `WorkingCurve`, whose methods compute values and intervals for a dose or a depth. `cautions`
describes the limitations in sentences.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.regression import LinearFit, f_tail, fitted, group_means, ranks, rosner_outliers, t_quantile
from solen.results import HIDDEN, Result, reported

Scatter = Literal["auto", "proportional", "constant"]
EXPONENTS = {"auto": (0.0, 0.5, 1.0), "proportional": (1.0,), "constant": (0.0,)}
"""Powers of the thickness that the scatter may follow."""
MIN_SCATTER_THICKNESS = 0.05
"""Discs thinner than this fraction of the thickest disc are assumed to scatter like a disc of this thickness."""
MAX_OUTLIERS = 0.2
"""Maximum fraction of the discs that may be excluded; one disc may always be excluded."""
DOSES_MJ_PER_CM2, THICKEST_UM = (1e-6, 1e9), 1e6
"""Limits of doses and thicknesses."""
SIGNIFICANCE = 0.05
"""The mean thicknesses are reported to deviate from the line if the p-value is below this probability."""
_ROUNDS, _SETTLED = 30, 1e-9


@dataclass(frozen=True)
class Disc:
    """A cured disc: its dose, its thickness, and its row in the table, counted from 1."""

    dose_mJ_per_cm2: float
    thickness_um: float
    row: int


@dataclass(frozen=True)
class LeftOut:
    """A disc that is omitted from the fit, with the reason; ``t`` is an outlier's deletion residual, otherwise None."""

    disc: Disc
    reason: str
    t: float | None = None


@dataclass(frozen=True)
class LackOfFit:
    """Lack-of-fit test: variance of the means at each dose over that of the discs about their mean, and p-value."""

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
        Power of the thickness with which the discs' scatter grows.
    sd_thickness_um, mean_thickness_um
        Standard deviation of discs with the mean thickness, and the mean thickness.
    used, left_out
        Discs included in the fit, and omitted discs.
    lack_of_fit
        Lack-of-fit test; None if fewer than three doses, or no replicates, remain.
    by_dose
        Whether the means at each dose were fitted instead of the discs, because the means scatter more than the discs
        explain.
    """

    fit: LinearFit = field(metadata=HIDDEN)
    scatter_exponent: float
    sd_thickness_um: float
    mean_thickness_um: float
    used: tuple[Disc, ...]
    left_out: tuple[LeftOut, ...]
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
        """Critical dose, the lowest dose at which resin sets."""
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
        """Return the cure depth at a dose in mJ/cm²; negative below the critical dose, where nothing sets."""
        return np.asarray(self.fit.parameters[0] + self.fit.parameters[1] * np.log(np.asarray(dose, float)))

    def half_width_um(self, dose: ArrayLike, *, of_one_disc: bool = False) -> FloatArray:
        """Return the half width of the 95 % interval of the cure depth at a dose, for the curve or one more disc."""
        doses = np.atleast_1d(np.asarray(dose, float))
        halves = []
        for ln_dose, depth in zip(np.log(doses).tolist(), self.depth_um(doses).tolist(), strict=True):
            more = self.disc_sigma_um(depth) ** 2 if of_one_disc else 0.0
            contrast = (1.0, ln_dose)
            halves.append(t_quantile(0.95, self.fit.df(contrast)) * math.sqrt(self.fit.u(contrast) ** 2 + more))
        return np.reshape(halves, np.shape(dose))

    def disc_sigma_um(self, depth_um: float) -> float:
        """Return the standard deviation of discs of a given thickness."""
        thick = max(depth_um, MIN_SCATTER_THICKNESS * max(disc.thickness_um for disc in self.used))
        return float(self.sd_thickness_um * (thick / self.mean_thickness_um) ** self.scatter_exponent)

    def dose_mJ_per_cm2(self, depth_um: float) -> float:
        """Return the dose that cures to a depth; infinite if it overflows."""
        ln_dose = (depth_um - self.fit.parameters[0]) / self.fit.parameters[1]
        return math.exp(ln_dose) if ln_dose < _MAX_LN else math.inf

    def dose_interval95(self, depth_um: float) -> tuple[float, float] | None:
        """Return the 95 % interval of the dose that cures to a depth; None if the slope is too uncertain to have one.

        The interval contains all doses at which the curve may reach that depth (Fieller, Journal of the Royal
        Statistical Society B 16, 175, 1954).
        """
        (a, b), covariance = self.fit.parameters, self.fit.covariance
        at = (depth_um - a) / b
        t2 = t_quantile(0.95, self.fit.df((1.0, at))) ** 2
        square = b**2 - t2 * covariance[1, 1]
        if not square > 0.0:
            return None
        half = (a - depth_um) * b - t2 * covariance[0, 1]
        rest = (a - depth_um) ** 2 - t2 * covariance[0, 0]
        root = math.sqrt(max(half**2 - square * rest, 0.0))
        low, high = (-half - root) / square, (-half + root) / square
        return (math.exp(low), math.exp(high)) if high < _MAX_LN else None


_FLATTEST = 100.0  # largest magnitude of the logarithm of a critical dose in mJ/cm²
_MAX_LN = 700.0  # above it a dose overflows


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
        Thickness of each disc, shape (n,). Discs with NaN (not measured) or 0 (nothing set) are omitted and listed.
    scatter
        How the discs scatter: proportional to thickness, constant, or to be estimated.
    min_thickness_um
        Doses whose discs have a lower mean thickness are omitted.
    keep_all
        Keep outliers.
    rows
        Row number of each disc, used in messages; by default they count from 1.

    Raises
    ------
    DataError
        If a dose is not above 0; if a thickness is negative or implausibly large; if fewer than two doses or three
        discs remain; or if the thickness does not grow with the dose.
    """
    discs = _discs(dose, thickness_um, rows)
    out = _unusable(discs) + _too_thin(discs, min_thickness_um)
    used = _without(discs, out)
    _refuse_too_few(used, out)
    if not keep_all:
        out += _outliers(used, scatter)
        used = _without(discs, out)
    fit, exponent = _fit(used, scatter)
    lack = _lack_of_fit(used, exponent, fit)
    by_dose = lack is not None and lack.p < SIGNIFICANCE
    if by_dose:
        fit, exponent = _fit(means_of(used), scatter)
    a, b = fit.parameters
    if not (b > 0.0 and abs(a) < _FLATTEST * b):
        doses = [disc.dose_mJ_per_cm2 for disc in used]
        raise DataError(
            "working curve: slope",
            value=f"{b:.3g} µm per factor of e in dose, from {min(doses):.3g} to {max(doses):.3g} mJ/cm²",
            limit="the thickness must increase with the dose, and Ec must be finite",
            remedy="check which column is which, or use more widely spaced doses",
        )
    at = float(np.mean([disc.thickness_um for disc in used]))
    return WorkingCurve(
        fit=fit,
        scatter_exponent=exponent,
        sd_thickness_um=fit.sigma * at**exponent,
        mean_thickness_um=at,
        used=used,
        left_out=tuple(out),
        lack_of_fit=lack,
        by_dose=by_dose,
    )


def _discs(dose: ArrayLike, thickness_um: ArrayLike, rows: Sequence[int] | None) -> tuple[Disc, ...]:
    doses, thick = np.asarray(dose, float), np.asarray(thickness_um, float)
    places = list(range(1, len(doses) + 1) if rows is None else rows)
    (least, most), thickest = DOSES_MJ_PER_CM2, THICKEST_UM
    for name, values, bad in (
        ("dose", doses, ~((doses >= least) & (doses <= most))),
        ("thickness", thick, (thick < 0.0) | (thick > thickest)),
    ):
        if bad.any():
            first = int(np.flatnonzero(bad)[0])
            limit = f"must be from {least:g} to {most:g} mJ/cm²" if name == "dose" else f"must be 0 to {thickest:g} µm"
            where = f"{values[first]:g} (row {places[first]})"
            raise DataError(f"working curve: {name}", value=where, limit=limit, remedy="correct or remove the row")
    return tuple(Disc(*one) for one in zip(doses.tolist(), thick.tolist(), places, strict=True))


def _unusable(discs: tuple[Disc, ...]) -> list[LeftOut]:
    return [
        LeftOut(disc, "nothing set" if disc.thickness_um == 0.0 else "no thickness")
        for disc in discs
        if not disc.thickness_um > 0.0
    ]


def _too_thin(discs: tuple[Disc, ...], least_um: float | None) -> list[LeftOut]:
    """Return the discs of doses whose mean thickness is below a limit."""
    if least_um is None:
        return []
    whole = [disc for disc in discs if disc.thickness_um > 0.0]
    thin = {mean.dose_mJ_per_cm2: mean.thickness_um for mean in means_of(tuple(whole)) if mean.thickness_um < least_um}
    return [
        LeftOut(disc, f"the mean thickness at its dose is {thin[disc.dose_mJ_per_cm2]:.3g} µm, below {least_um:g} µm")
        for disc in whole
        if disc.dose_mJ_per_cm2 in thin
    ]


def _without(discs: tuple[Disc, ...], out: list[LeftOut]) -> tuple[Disc, ...]:
    rows = {left.disc.row for left in out}
    return tuple(disc for disc in discs if disc.row not in rows)


def _refuse_too_few(used: tuple[Disc, ...], out: list[LeftOut]) -> None:
    doses = {disc.dose_mJ_per_cm2 for disc in used}
    if len(doses) >= 2 and len(used) >= 3:
        return
    discs = f"{len(used)} discs at {len(doses)} doses" + (f" ({len(out)} omitted)" if out else "")
    remedy = "cure three discs at each of at least five doses"
    raise DataError("working curve: points", value=discs, limit="requires at least 3 discs at 2 doses", remedy=remedy)


def means_of(discs: tuple[Disc, ...]) -> tuple[Disc, ...]:
    """Return one disc per dose, with the mean thickness at that dose."""
    doses = [disc.dose_mJ_per_cm2 for disc in discs]
    rows: dict[float, int] = {}
    for disc in discs:
        rows.setdefault(disc.dose_mJ_per_cm2, disc.row)
    means = group_means(doses, [disc.thickness_um for disc in discs])
    return tuple(Disc(dose, mean, rows[dose]) for dose, mean in means.items())


def _columns(discs: tuple[Disc, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of dose, and the thicknesses."""
    return np.log([disc.dose_mJ_per_cm2 for disc in discs]), np.array([disc.thickness_um for disc in discs])


def _weights(x: FloatArray, y: FloatArray, exponent: float) -> FloatArray:
    """Return weights from the fitted thickness; the measured one would favour discs that came out thin."""
    weights = np.ones(len(y))
    while_settling = 1 if exponent == 0.0 else _ROUNDS
    before = 0.0
    for _ in range(while_settling):
        total, mean = weights.sum(), weights @ x / weights.sum()
        slope = float(weights @ ((x - mean) * y) / (weights @ (x - mean) ** 2))
        line = weights @ y / total + slope * (x - mean)
        weights = np.maximum(line, MIN_SCATTER_THICKNESS * max(float(line.max()), float(y.max()))) ** (-2.0 * exponent)
        if abs(slope - before) <= _SETTLED * abs(slope):
            break
        before = slope
    return weights


def _most_likely(x: FloatArray, y: FloatArray, scatter: Scatter) -> tuple[LinearFit, float]:
    """Return the maximum-likelihood fit and its scatter exponent."""
    design = np.column_stack([np.ones(len(x)), x])
    tried = {e: fitted(design, y, weights=_weights(x, y, e)) for e in EXPONENTS[scatter]}
    best = min(tried, key=lambda exponent: tried[exponent].criterion)
    return tried[best], best


def _fit(discs: tuple[Disc, ...], scatter: Scatter) -> tuple[LinearFit, float]:
    """Return the maximum-likelihood fit and its exponent; if scatter is a guess, residuals give the intervals."""
    x, y = _columns(discs)
    fit, exponent = _most_likely(x, y, scatter)
    if scatter != "auto" or fit.sigma == 0.0:
        return fit, exponent
    design = np.column_stack([np.ones(len(x)), x])
    return fitted(design, y, weights=_weights(x, y, exponent), guessed=True), exponent


def _outliers(used: tuple[Disc, ...], scatter: Scatter) -> list[LeftOut]:
    """Return the outliers. If most discs at a dose deviate together, the line is at fault and the discs are kept."""
    most = min(max(1, int(MAX_OUTLIERS * len(used))), len(used) - 4)
    if most < 1:
        return []
    x, y = _columns(used)
    outliers = rosner_outliers(lambda keep: _most_likely(x[keep], y[keep], scatter)[0], len(used), most)
    doses = [disc.dose_mJ_per_cm2 for disc in used]
    off = [doses[number] for number in outliers]
    alone = {dose for dose in off if 2 * off.count(dose) <= doses.count(dose) or doses.count(dose) == 1}
    left = {dose for number, dose in enumerate(doses) if number not in outliers or dose not in alone}
    return [
        LeftOut(used[number], "outlier", t)
        for number, t in outliers.items()
        if doses[number] in alone and len(left) > 1
    ]


def _lack_of_fit(used: tuple[Disc, ...], exponent: float, fit: LinearFit) -> LackOfFit | None:
    """Test whether the means at each dose deviate from the line by more than the scatter of the discs explains."""
    x, y = _columns(used)
    weights = _weights(x, y, exponent)
    of = ranks(x.tolist())
    counts = np.bincount(of)
    means = np.bincount(of, weights=y) / counts
    between, within = len(counts) - 2, len(y) - len(counts)
    pure = float(weights @ (y - means[of]) ** 2)
    if between < 1 or within < 1 or not pure > 0.0:
        return None
    a, b = fit.parameters
    misfit = float(weights @ (means[of] - a - b * x) ** 2)
    ratio = (misfit / between) / (pure / within)
    return LackOfFit(ratio, (between, within), f_tail(ratio, between, within))
