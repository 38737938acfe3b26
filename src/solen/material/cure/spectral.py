"""The spectral cure law, for a lamp that emits many wavelengths, compared with Jacobs' law.

Of each line of the lamp, the fraction e^(-z r/Dp) reaches the depth z. Dp is the penetration depth at the surface, and
r is the absorption of the line relative to the mean over all light there. Resin cures down to the depth C at which the
total dose equals Ec: E Σ w e^(-C r/Dp) = Ec with the power fractions w, which is Jacobs' C = Dp ln(E/Ec) if all r are 1
(Caplins et al., Influence of spectral bandwidth on the working curve in vat photopolymerization, Additive
Manufacturing, 2024). Both laws have two parameters, so their likelihoods can be compared directly.

`lamp_lines` reduces an `Attenuation` to a few lines, `transmitted` and `depth` evaluate the law, and `fit_spectral_law`
fits it to discs.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.material.cure.penetration import Attenuation
from solen.material.cure.working_curve_fit import MIN_SCATTER_THICKNESS, WorkingCurve
from solen.results import HIDDEN, Result, reported

Lines = tuple[tuple[float, float], ...]
"""For each line of a lamp, its fraction of the light at the surface, and its absorption relative to the mean there."""
ONE_LINE: Lines = ((1.0, 1.0),)
MAX_LINES = 48
MIN_LN_RATIO = 2.0
"""Smallest logarithm of the likelihood ratio at which one law is preferred: a ratio of 7 to 1."""
_MIN_DISCS = 5
_EXPONENTS = (0.0, 0.5, 1.0)  # powers of thickness with which the scatter of discs may grow
_MAX_ITERATIONS = 60


def lamp_lines(decay: Attenuation) -> Lines:
    """Return the lines of a lamp in a resin; lines with similar absorption are merged into one, `MAX_LINES` at most."""
    log = np.log(decay.per_um)
    edges = np.linspace(log.min(), log.max() + 1e-9, MAX_LINES + 1)
    bins = np.clip(np.digitize(log, edges) - 1, 0, MAX_LINES - 1)
    power = np.bincount(bins, decay.weight, MAX_LINES)
    absorbed = np.bincount(bins, decay.weight * decay.per_um, MAX_LINES)
    total, mean = float(power.sum()), float(absorbed.sum() / power.sum())
    return tuple((float(p) / total, float(a / p) / mean) for p, a in zip(power, absorbed, strict=True) if p > 0.0)


def transmitted(lines: Lines, depth: ArrayLike) -> FloatArray:
    """Return the fraction of the light that reaches depths in units of the penetration depth at the surface."""
    fraction, absorption = np.array(lines).T
    return np.asarray(np.exp(-np.asarray(depth, float)[..., None] * absorption) @ fraction)


def depth(lines: Lines, ln_ratio: ArrayLike) -> FloatArray:
    """Return the cure depth, in units of the penetration depth at the surface, from ln(dose / critical dose).

    Newton's method is applied to the logarithm of the transmitted light, which is a convex function of depth, so the
    iterates approach the root from one side.
    """
    fraction, absorption = np.array(lines).T
    wanted = np.asarray(ln_ratio, float)
    result = np.array(wanted)
    for _ in range(_MAX_ITERATIONS):
        power = fraction * np.exp(-result[..., None] * (absorption - absorption.min()))
        total = power.sum(axis=-1)
        step = (np.log(total) - result * absorption.min() + wanted) * total / (power @ absorption)
        result = result + step
        if np.all(np.abs(step) <= 1e-12 * (1.0 + np.abs(result))):
            break
    return np.asarray(result)


class SpectralFit(Result, kw_only=True):
    """The spectral cure law, fitted to the discs of a working curve.

    Attributes
    ----------
    lamp
        Source of the spectrum.
    Dp_um, u_Dp_um, Ec_mJ_per_cm2, u_Ec_mJ_per_cm2
        Penetration depth at the surface, critical dose, and their standard uncertainties from the scatter of the discs.
    liquid_Dp_um
        Penetration depth at the surface from the absorbance of the liquid.
    rms_um, jacobs_rms_um
        RMS residuals of the discs from this law, and from Jacobs' law.
    ln_likelihood_ratio
        Logarithm of the likelihood ratio of this law to Jacobs' law, with unknown scatter.
    """

    lamp: str
    lines: Lines = field(metadata=HIDDEN)
    Dp_um: float
    u_Dp_um: float
    Ec_mJ_per_cm2: float
    u_Ec_mJ_per_cm2: float
    liquid_Dp_um: float
    rms_um: float
    jacobs_rms_um: float
    ln_likelihood_ratio: float

    @reported
    def preferred(self) -> Literal["spectrum", "Jacobs"] | None:
        """The law that fits the discs better; None if both laws fit about equally well."""
        if abs(self.ln_likelihood_ratio) < MIN_LN_RATIO:
            return None
        return "spectrum" if self.ln_likelihood_ratio > 0.0 else "Jacobs"

    @reported
    def lamp_lines(self) -> tuple[tuple[float, float], ...]:
        """Lines of the lamp for a print process: fraction of the light, and absorption relative to the surface mean."""
        return self.lines

    def depth_um(self, dose: ArrayLike) -> FloatArray:
        """Return the cure depth for doses in mJ/cm²."""
        return self.Dp_um * depth(self.lines, np.log(np.asarray(dose, float) / self.Ec_mJ_per_cm2))

    def interior_mean_mJ_per_cm2(self, dose: float, layer_um: float) -> float:
        """Return the mean dose far inside a part, given the dose of a layer: E Dp Σ (w/r) / h."""
        fraction, absorption = np.array(self.lines).T
        return float(dose * self.Dp_um / layer_um * (fraction / absorption).sum())

    def print_through_um(self, dose: float, layer_um: float) -> float:
        """Return how far resin cures into a gap beyond the first of many layers; negative if it does not."""
        fraction, absorption = np.array(self.lines).T
        accumulated = fraction / -np.expm1(-absorption * layer_um / self.Dp_um)
        total = float(accumulated.sum())
        lines = tuple(zip((accumulated / total).tolist(), absorption.tolist(), strict=True))
        return float(self.Dp_um * depth(lines, math.log(dose * total / self.Ec_mJ_per_cm2))) - layer_um


def fit_spectral_law(curve: WorkingCurve, lines: Lines, liquid_Dp_um: float, lamp: str) -> SpectralFit:
    """Fit the spectral cure law to the discs of a working curve.

    For each law, the scatter model (constant, or growing with thickness) is the one with the maximum likelihood.

    Raises
    ------
    DataError
        If there are too few discs.
    """
    doses = np.array([disc.dose_mJ_per_cm2 for disc in curve.used])
    um = np.array([disc.thickness_um for disc in curve.used])
    if len(um) < _MIN_DISCS:
        limit = f"requires at least {_MIN_DISCS} discs, but the table has {len(um)}"
        raise DataError("--penetration", limit=limit, remedy="cure more discs")
    start = (math.log(curve.Dp_um), math.log(curve.Ec_mJ_per_cm2))
    spectral, jacobs = (_best(doses, um, law, start) for law in (lines, ONE_LINE))
    return SpectralFit(
        lamp=lamp,
        lines=lines,
        Dp_um=spectral.Dp_um,
        u_Dp_um=spectral.u_Dp_um,
        Ec_mJ_per_cm2=spectral.Ec,
        u_Ec_mJ_per_cm2=spectral.u_Ec,
        liquid_Dp_um=liquid_Dp_um,
        rms_um=spectral.rms_um,
        jacobs_rms_um=jacobs.rms_um,
        ln_likelihood_ratio=spectral.ln_likelihood - jacobs.ln_likelihood,
    )


@dataclass(frozen=True)
class _Fit:
    Dp_um: float
    Ec: float
    u_Dp_um: float
    u_Ec: float
    rms_um: float
    ln_likelihood: float


def _best(doses: FloatArray, um: FloatArray, lines: Lines, start: tuple[float, float]) -> _Fit:
    """Return the maximum-likelihood fit of a law over all scatter models."""
    residuals = _residuals(doses, um, lines)
    expected = um + residuals(np.asarray(least_squares(residuals, start, xtol=1e-12, ftol=1e-12).x))
    expected = np.maximum(expected, MIN_SCATTER_THICKNESS * um.max()) / um.max()
    fits = (_fit(doses, um, expected**exponent, lines, start) for exponent in _EXPONENTS)
    return max(fits, key=lambda fit: fit.ln_likelihood)


def _residuals(doses: FloatArray, um: FloatArray, lines: Lines) -> Callable[[FloatArray], FloatArray]:
    def residuals(values: FloatArray) -> FloatArray:
        return np.asarray(math.exp(values[0]) * depth(lines, np.log(doses) - values[1]) - um)

    return residuals


def _fit(doses: FloatArray, um: FloatArray, sd: FloatArray, lines: Lines, start: tuple[float, float]) -> _Fit:
    """Fit discs whose scatter is proportional to ``sd``."""
    residuals = _residuals(doses, um, lines)

    def weighted(values: FloatArray) -> FloatArray:
        return residuals(values) / sd

    fit = least_squares(weighted, start, xtol=1e-12, ftol=1e-12)
    count, squares = len(um), 2.0 * float(fit.cost)
    jac = np.asarray(fit.jac, dtype=float)
    u = np.sqrt(np.diag(np.linalg.inv(jac.T @ jac)) * squares / (count - 2))
    Dp, Ec = (math.exp(value) for value in fit.x)
    rms = float(np.sqrt(np.mean((fit.fun * sd) ** 2)))
    ln_likelihood = -0.5 * count * math.log(squares / count) - float(np.log(sd).sum())
    return _Fit(Dp, Ec, Dp * float(u[0]), Ec * float(u[1]), rms, ln_likelihood)
