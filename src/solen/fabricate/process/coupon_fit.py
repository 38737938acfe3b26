"""Least-squares fit of process parameters and image scales to measured coupon features.

`CouponFit.solved` returns the `Solution` for the features used.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from solen.arrays import FloatArray
from solen.fabricate.process.features import Kind, MeasuredFeature, printed_mm
from solen.fabricate.process.growth import growth_um, with_growth
from solen.fabricate.process.process_file import Process
from solen.fabricate.process.scales import Scales
from solen.fabricate.process.settings import Settings

WEAK = 3.0
"""Factor by which the reported uncertainty of the previous process is multiplied for the prior."""
MAX_GROWTH = 10.0
"""Prior standard uncertainty of the wall growth, in pixels: practically no prior."""
WIDE: dict[str, float] = {
    "sigma_um": 10.0,
    "response_scale": 0.2,
    "Ec_mJ_per_cm2": 5.0,
    "shrinkage_percent": 2.0,
    "shrinkage_z_percent": 2.0,
}
"""Prior uncertainties for a process file that contains none."""
_LOST_UM = 200.0  # residual of a feature that the model does not print, in µm


@dataclass(frozen=True)
class FittedFeature:
    """A feature used in the fit: its drawn and measured sizes, and the modelled size at the image scale.

    ``u_measured_mm`` excludes the scale uncertainty, which is common to all features of an image.
    """

    kind: Kind
    nominal_mm: float
    measured_mm: float
    u_measured_mm: float
    printed_mm: float


@dataclass(frozen=True, eq=False)
class Solution:
    """Best-fitting parameters and scale errors, their covariance, and the goodness of fit."""

    values: FloatArray
    covariance: FloatArray
    chi2: float
    df: int
    scale: float


class CouponFit:
    """Least-squares fit in which the growth of a straight wall replaces the critical dose for better separation."""

    def __init__(
        self, process: Process, used: tuple[tuple[int, MeasuredFeature], ...], scales: Scales, keys: tuple[str, ...]
    ) -> None:
        self.process, self.scales, self.keys = process, scales, keys
        self.used = tuple(feature for _, feature in used)
        drawn = [(one.kind, one.nominal_mm, one.diameter_mm) for one in self.used]
        distinct = list(dict.fromkeys(drawn))
        self._distinct = [self.used[drawn.index(one)] for one in distinct]
        self._which = np.array([distinct.index(one) for one in drawn], dtype=np.intp)
        self.sought = tuple("growth_um" if key == "Ec_mJ_per_cm2" else key for key in keys)
        self._measured = np.array([1e3 * (feature.measured_mm or 0.0) for feature in self.used])
        self._u = 1e3 * scales.u_own_mm(used)
        pitches = [coupon for coupon in scales.coupons if coupon.pitch_ratio is not None]
        self._pitch = np.array([coupon.pitch_ratio or 1.0 for coupon in pitches])
        self._u_pitch = np.array([coupon.u_pitch_ratio or 1.0 for coupon in pitches])
        settings = process.process
        start = {key: float(getattr(settings, key)) for key in keys} | {"growth_um": growth_um(settings)}
        before = {key: WEAK * (process.uncertainty.get(key) or WIDE[key]) for key in keys}
        before["growth_um"] = MAX_GROWTH * settings.pixel_um
        low, high = _ends(settings)
        self.low, self.high = (np.array([ends[key] for key in self.sought]) for ends in (low, high))
        self.start = np.clip([start[key] for key in self.sought], self.low, self.high)
        self.before = np.array([before[key] for key in self.sought])
        self._scales_whitened = np.linalg.inv(np.linalg.cholesky(scales.covariance))

    def solved(self) -> Solution:
        """Solve by least squares; features with more scatter have less weight, while the priors keep their weights."""
        count, scales = len(self.sought), len(self.scales.of)
        ends = (np.append(self.low, np.full(scales, -0.5)), np.append(self.high, np.full(scales, 0.5)))
        solution = least_squares(
            self.residuals,
            np.append(self.start, np.zeros(scales)),
            self.jacobian,
            bounds=ends,
            x_scale=np.append(self.before, np.sqrt(np.diag(self.scales.covariance))),
            xtol=1e-5,
            ftol=1e-7,
            max_nfev=50,
        )
        measured = len(self.used) + len(self._pitch)
        jacobian, chi2 = np.asarray(solution.jac), float(np.sum(solution.fun[:measured] ** 2))
        known = jacobian[measured:].T @ jacobian[measured:]
        learned = count + scales - float(np.trace(np.linalg.inv(jacobian.T @ jacobian) @ known))
        df = max(round(measured - learned), 1)
        scale = max(1.0, math.sqrt(chi2 / df))
        covariance = np.linalg.inv(jacobian[:measured].T @ jacobian[:measured] / scale**2 + known)
        return Solution(np.asarray(solution.x), covariance, chi2, df, scale)

    def settings(self, values: FloatArray) -> Settings:
        """Return the process with the given parameter values."""
        changed = dict(zip(self.sought, values.tolist(), strict=True))
        growth = changed.pop("growth_um")
        blurred = self.process.process.model_copy(update=changed)
        halo_um = max(blurred.halo_um, blurred.blur_um)
        return with_growth(blurred.model_copy(update={"halo_um": halo_um}), growth)

    def _printed_um(self, settings: Settings) -> FloatArray:
        """Return modelled sizes (n,); they are equal for images of the same coupon."""
        return np.asarray(1e3 * printed_mm(settings, self._distinct)[self._which])

    def _seen_um(self, settings: Settings, errors: FloatArray) -> FloatArray:
        """Return sizes (n,) as they appear in images with these scales."""
        return np.asarray(self._printed_um(settings) * (1.0 + errors[self.scales.rows]))

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return the residuals of features, distances and priors, each divided by its uncertainty."""
        count = len(self.sought)
        numbers, errors = values[:count], values[count:]
        settings = self.settings(numbers)
        sizes = self._seen_um(settings, errors)
        off = np.where(np.isnan(sizes), _LOST_UM, sizes - self._measured)
        apart = (1.0 - 1e-2 * settings.shrinkage_percent) * (1.0 + errors[self.scales.pitches]) - self._pitch
        before = (numbers - self.start) / self.before
        return np.concatenate([off / self._u, apart / self._u_pitch, before, self._scales_whitened @ errors])

    def jacobian(self, values: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals: finite differences for the parameters, exact for the scales."""
        count, rows, pitches = len(self.sought), len(self.used), len(self._pitch)
        numbers, here = values[:count], self.residuals(values)
        result = np.zeros((len(here), len(values)))
        for i, step in enumerate(1e-4 * self.before):
            way = step if numbers[i] + step <= self.high[i] else -step
            result[:, i] = (self.residuals(values + way * np.eye(len(values))[i]) - here) / way
        settings = self.settings(numbers)
        sizes = np.nan_to_num(self._printed_um(settings))
        result[np.arange(rows), count + self.scales.rows] = sizes / self._u
        shrunk = 1.0 - 1e-2 * settings.shrinkage_percent
        result[rows + np.arange(pitches), count + self.scales.pitches] = shrunk / self._u_pitch
        result[rows + pitches + count :, count:] = self._scales_whitened
        return result

    def fitted(self, values: FloatArray) -> tuple[FittedFeature, ...]:
        """Return the features with the sizes that the model predicts at the scales of their images."""
        count = len(self.sought)
        sizes = 1e-3 * self._seen_um(self.settings(values[:count]), values[count:])
        rows = zip(self.used, 1e-3 * self._u, sizes, strict=True)
        return tuple(
            FittedFeature(one.kind, one.nominal_mm, one.measured_mm or math.nan, float(u), float(size))
            for one, u, size in rows
        )

    def u_of_Ec(self, values: FloatArray, covariance: FloatArray) -> float:
        """Return the uncertainty of the critical dose, to first order."""
        slope = np.empty(len(values))
        for i, step in enumerate(1e-3 * self.before):
            ends = [self.settings(values + sign * step * np.eye(len(values))[i]).Ec_mJ_per_cm2 for sign in (1.0, -1.0)]
            slope[i] = (ends[0] - ends[1]) / (2.0 * step)
        return math.sqrt(float(slope @ covariance @ slope))


def _ends(settings: Settings) -> tuple[dict[str, float], dict[str, float]]:
    """Return the bounds of the fit."""
    pixel = settings.pixel_um
    low = {
        "sigma_um": 0.1 * pixel,
        "response_scale": 0.3,
        "growth_um": -2.0 * pixel,
        "shrinkage_percent": -19.0,
        "shrinkage_z_percent": -19.0,
    }
    high = {
        "sigma_um": 20.0 * pixel,
        "response_scale": 3.0,
        "growth_um": 15.0 * pixel,
        "shrinkage_percent": 19.0,
        "shrinkage_z_percent": 19.0,
    }
    return low, high
