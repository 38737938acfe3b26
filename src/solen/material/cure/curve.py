"""The working curve: thickness of cured discs against dose, Dc = Dp ln(E/Ec), and how well it is known.

The idea (Jacobs, Rapid Prototyping & Manufacturing, 1992, chapter 4): light falls off exponentially with depth and
resin sets where the dose exceeds a threshold, so thickness is a straight line in the logarithm of dose, a + b ln E with
Dp = b and ln Ec = −a/b. Discs scatter, thick ones often more and thin soft ones badly: with ``scatter="auto"`` the
scatter is taken as growing with a power 0, ½ or 1 of thickness, whichever is likeliest, and the intervals come from the
residuals, so that they hold where that guess is wrong (decision 0028). Ec is where the line crosses zero: its interval
is Fieller's, which is not symmetric. Outliers are set aside by a stated rule and listed;
doses are left out whole, never disc by disc, where their mean thickness is below a stated limit.

The model knows one wavelength, a resin that does not bleach, and a dose that counts the same however fast it comes; no
oxygen that uses up the first of it, and no diffusion. Where these matter the points bend, and the test of fit says so.

The interface: `working_curve` gives a `WorkingCurve`; its methods answer at a dose or for a depth, with intervals;
`cautions` says in sentences what does not follow.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.regression import LinearFit, bad_points, f_tail, fitted, group_means, ranks, t_quantile
from solen.results import HIDDEN, Result, reported

Scatter = Literal["auto", "proportional", "constant"]
EXPONENTS = {"auto": (0.0, 0.5, 1.0), "proportional": (1.0,), "constant": (0.0,)}
"""Powers of thickness that scatter may grow with."""
THINNEST = 0.05
"""Share of the thickest disc below which scatter is that of a disc of this thickness."""
MOST_OUTLIERS = 0.2
"""Share of the discs, at least one disc, that may be set aside."""
DOSES_MJ_PER_CM2, THICKEST_UM = (1e-6, 1e9), 1e6
"""Limits of doses and thicknesses."""
SIGNIFICANCE = 0.05
"""Chance below which the doses' means are off the line."""
_ROUNDS, _SETTLED = 30, 1e-9


@dataclass(frozen=True)
class Disc:
    """A cured disc: its dose, its thickness, and its place in the table, from 1 on."""

    dose_mJ_per_cm2: float
    thickness_um: float
    row: int


@dataclass(frozen=True)
class LeftOut:
    """A disc that the curve does without, and why; ``t`` is its deletion residual where that is the reason."""

    disc: Disc
    reason: str
    t: float | None = None


@dataclass(frozen=True)
class LackOfFit:
    """Doses' means about the line against discs about their mean: ratio of variances, and how likely by chance."""

    F: float
    df: tuple[int, int]
    p: float


class WorkingCurve(Result, kw_only=True):
    """Result of `working_curve`.

    Attributes
    ----------
    fit
        Of thickness in µm against (1, ln E), E in mJ/cm².
    scatter_exponent
        Power of thickness that the scatter of discs grows with.
    sd_thickness_um, mean_thickness_um
        Standard deviation of discs of the mean thickness, and that.
    used, left_out
        Discs that the line is for, and the others.
    lack_of_fit
        None if fewer than three doses, or no replicates, are left.
    by_dose
        Whether the doses' means were fitted in place of discs, because these scatter less than their means do.
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
        """Its standard uncertainty."""
        return self.fit.u((0.0, 1.0))

    @reported
    def interval95_Dp_um(self) -> tuple[float, float]:
        """Its 95 % interval."""
        return self.fit.interval((0.0, 1.0))

    @property
    def ln_Ec(self) -> float:
        """Logarithm of the critical dose in mJ/cm²."""
        return float(-self.fit.parameters[0] / self.fit.parameters[1])

    @reported
    def Ec_mJ_per_cm2(self) -> float:
        """Critical dose, at which the first resin sets."""
        return math.exp(self.ln_Ec)

    @reported
    def u_ln_Ec(self) -> float:
        """Standard uncertainty of its logarithm, to first order."""
        return math.sqrt(self.covariance_ln[1, 1])

    @reported
    def interval95_Ec_mJ_per_cm2(self) -> tuple[float, float] | None:
        """Its 95 % interval; None if the slope is too uncertain to have one."""
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
        """Number of discs that the line is for."""
        return len(self.used)

    @reported
    def doses(self) -> int:
        """Number of their doses."""
        return len({disc.dose_mJ_per_cm2 for disc in self.used})

    @reported
    def dose_range_mJ_per_cm2(self) -> tuple[float, float]:
        """Lowest and highest of them."""
        doses = [disc.dose_mJ_per_cm2 for disc in self.used]
        return min(doses), max(doses)

    def depth_um(self, dose: ArrayLike) -> FloatArray:
        """Cure depth at a dose in mJ/cm²; negative below the critical dose, where nothing sets."""
        return np.asarray(self.fit.parameters[0] + self.fit.parameters[1] * np.log(np.asarray(dose, float)))

    def half_width_um(self, dose: ArrayLike, *, of_one_disc: bool = False) -> FloatArray:
        """Half width of the 95 % interval of the cure depth at a dose: of the curve, or of one more disc."""
        doses = np.atleast_1d(np.asarray(dose, float))
        halves = []
        for ln_dose, depth in zip(np.log(doses).tolist(), self.depth_um(doses).tolist(), strict=True):
            more = self.disc_sigma_um(depth) ** 2 if of_one_disc else 0.0
            contrast = (1.0, ln_dose)
            halves.append(t_quantile(0.95, self.fit.df(contrast)) * math.sqrt(self.fit.u(contrast) ** 2 + more))
        return np.reshape(halves, np.shape(dose))

    def disc_sigma_um(self, depth_um: float) -> float:
        """Standard deviation of discs of a thickness."""
        thick = max(depth_um, THINNEST * max(disc.thickness_um for disc in self.used))
        return float(self.sd_thickness_um * (thick / self.mean_thickness_um) ** self.scatter_exponent)

    def dose_mJ_per_cm2(self, depth_um: float) -> float:
        """Dose that cures to a depth; infinite where it overflows."""
        ln_dose = (depth_um - self.fit.parameters[0]) / self.fit.parameters[1]
        return math.exp(ln_dose) if ln_dose < _LARGEST_LN else math.inf

    def dose_interval95(self, depth_um: float) -> tuple[float, float] | None:
        """95 % interval of the dose that cures to a depth; None if the slope is too uncertain to have one.

        All doses at which the curve may be that deep (Fieller, Journal of the Royal Statistical Society B 16, 175,
        1954).
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
        return (math.exp(low), math.exp(high)) if high < _LARGEST_LN else None


_FLATTEST = 100.0  # logarithm of a critical dose in mJ/cm² beyond which it is none
_LARGEST_LN = 700.0  # beyond it a dose overflows


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
        In mJ/cm², shape (n,), one entry a disc.
    thickness_um
        Shape (n,); NaN where none was measured, 0 where nothing set: both are left out and listed.
    scatter
        How discs scatter: as a share of their thickness, by the same everywhere, or to be found.
    min_thickness_um
        Doses whose discs are thinner on average are left out.
    keep_all
        Keep outliers.
    rows
        Name of each disc's position; by default they count from 1.

    Raises
    ------
    DataError
        For a dose that is not above 0, a negative thickness, or one beyond any print; where fewer than two
        doses or three discs are left; where thickness does not grow with dose.
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
            value=f"{b:.3g} µm per factor e of dose from {min(doses):.3g} to {max(doses):.3g} mJ/cm²",
            limit="thickness must grow with dose, or Ec is out of reach",
            remedy="check which column is which, or take doses further apart",
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
    """Discs of the doses whose discs are on average thinner than a limit."""
    if least_um is None:
        return []
    whole = [disc for disc in discs if disc.thickness_um > 0.0]
    thin = {mean.dose_mJ_per_cm2: mean.thickness_um for mean in means_of(tuple(whole)) if mean.thickness_um < least_um}
    return [
        LeftOut(disc, f"its dose's discs are {thin[disc.dose_mJ_per_cm2]:.3g} µm thick, below {least_um:g} µm")
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
    discs = f"{len(used)} discs at {len(doses)} doses" + (f" ({len(out)} left out)" if out else "")
    remedy = "cure discs at five doses or more, three of each"
    raise DataError("working curve: points", value=discs, limit="needs 3 discs at 2 doses at least", remedy=remedy)


def means_of(discs: tuple[Disc, ...]) -> tuple[Disc, ...]:
    """One disc for each dose, as thick as those there are on average."""
    doses = [disc.dose_mJ_per_cm2 for disc in discs]
    rows: dict[float, int] = {}
    for disc in discs:
        rows.setdefault(disc.dose_mJ_per_cm2, disc.row)
    means = group_means(doses, [disc.thickness_um for disc in discs])
    return tuple(Disc(dose, mean, rows[dose]) for dose, mean in means.items())


def _columns(discs: tuple[Disc, ...]) -> tuple[FloatArray, FloatArray]:
    """Logarithms of dose, and thicknesses."""
    return np.log([disc.dose_mJ_per_cm2 for disc in discs]), np.array([disc.thickness_um for disc in discs])


def _weights(x: FloatArray, y: FloatArray, exponent: float) -> FloatArray:
    """Weights by the fitted thickness: those by the measured one favour discs that came out thin."""
    weights = np.ones(len(y))
    while_settling = 1 if exponent == 0.0 else _ROUNDS
    before = 0.0
    for _ in range(while_settling):
        total, mean = weights.sum(), weights @ x / weights.sum()
        slope = float(weights @ ((x - mean) * y) / (weights @ (x - mean) ** 2))
        line = weights @ y / total + slope * (x - mean)
        weights = np.maximum(line, THINNEST * max(float(line.max()), float(y.max()))) ** (-2.0 * exponent)
        if abs(slope - before) <= _SETTLED * abs(slope):
            break
        before = slope
    return weights


def _likeliest(x: FloatArray, y: FloatArray, scatter: Scatter) -> tuple[LinearFit, float]:
    """Likeliest fit, and its exponent of scatter."""
    design = np.column_stack([np.ones(len(x)), x])
    tried = {e: fitted(design, y, weights=_weights(x, y, e)) for e in EXPONENTS[scatter]}
    best = min(tried, key=lambda exponent: tried[exponent].criterion)
    return tried[best], best


def _fit(discs: tuple[Disc, ...], scatter: Scatter) -> tuple[LinearFit, float]:
    """Likeliest fit with its intervals from the residuals where scatter is a guess, and its exponent of scatter."""
    x, y = _columns(discs)
    fit, exponent = _likeliest(x, y, scatter)
    if scatter != "auto" or fit.sigma == 0.0:
        return fit, exponent
    design = np.column_stack([np.ones(len(x)), x])
    return fitted(design, y, weights=_weights(x, y, exponent), guessed=True), exponent


def _outliers(used: tuple[Disc, ...], scatter: Scatter) -> list[LeftOut]:
    """Outliers. Where most discs of a dose deviate together, the line is at fault, and they stay."""
    most = min(max(1, int(MOST_OUTLIERS * len(used))), len(used) - 4)
    if most < 1:
        return []
    x, y = _columns(used)
    outliers = bad_points(lambda keep: _likeliest(x[keep], y[keep], scatter)[0], len(used), most)
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
    """Whether doses' means are further off the line than their discs' scatter explains."""
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
