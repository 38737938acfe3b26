"""Least-squares fit of process parameters and image scales to measured features of coupons.

`CouponFit.solve` returns the `Solution`.
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

PRIOR_FACTOR = 3.0
"""Ratio of the uncertainty of the prior to the reported uncertainty of the previous process."""
MAX_GROWTH = 10.0
"""Prior standard uncertainty of the growth of walls in pixels, which is practically no prior."""
DEFAULT_U: dict[str, float] = {
    "sigma_um": 10.0,
    "response_scale": 0.2,
    "Ec_mJ_per_cm2": 5.0,
    "shrinkage_percent": 2.0,
    "shrinkage_z_percent": 2.0,
}
"""Uncertainties of the previous process if its file contains none."""
_MISSING_UM = 200.0  # residual of a feature that the model does not print


@dataclass(frozen=True)
class FittedFeature:
    """A feature in the fit: its drawn and measured sizes, and its modelled size at the scale of the image.

    ``u_measured_mm`` excludes the uncertainty of the scale, which is common to all features of an image.
    """

    kind: Kind
    nominal_mm: float
    measured_mm: float
    u_measured_mm: float
    printed_mm: float


@dataclass(frozen=True, eq=False)
class Solution:
    """Best-fit parameters and scale errors, their covariance, and the goodness of the fit."""

    values: FloatArray
    covariance: FloatArray
    chi2: float
    df: int
    scale: float


class CouponFit:
    """Least-squares fit in which the growth of a straight wall replaces the critical dose, to reduce correlations."""

    def __init__(
        self, process: Process, used: tuple[tuple[int, MeasuredFeature], ...], scales: Scales, keys: tuple[str, ...]
    ) -> None:
        self.process, self.scales, self.keys = process, scales, keys
        self.used = tuple(feature for _, feature in used)
        drawn = [(feature.kind, feature.nominal_mm, feature.diameter_mm) for feature in self.used]
        distinct = list(dict.fromkeys(drawn))
        self._distinct = [self.used[drawn.index(key)] for key in distinct]
        self._distinct_index = np.array([distinct.index(key) for key in drawn], dtype=np.intp)
        self.parameters = tuple("growth_um" if key == "Ec_mJ_per_cm2" else key for key in keys)
        self._measured = np.array([1e3 * (feature.measured_mm or 0.0) for feature in self.used])
        self._u = 1e3 * scales.u_own_mm(used)
        pitches = [coupon for coupon in scales.coupons if coupon.pitch_ratio is not None]
        self._pitch = np.array([coupon.pitch_ratio or 1.0 for coupon in pitches])
        self._u_pitch = np.array([coupon.u_pitch_ratio or 1.0 for coupon in pitches])
        settings = process.process
        start = {key: float(getattr(settings, key)) for key in keys} | {"growth_um": growth_um(settings)}
        u_prior = {key: PRIOR_FACTOR * (process.uncertainty.get(key) or DEFAULT_U[key]) for key in keys}
        u_prior["growth_um"] = MAX_GROWTH * settings.pixel_um
        low, high = _bounds(settings)
        self.low, self.high = (np.array([bounds[key] for key in self.parameters]) for bounds in (low, high))
        self.start = np.clip([start[key] for key in self.parameters], self.low, self.high)
        self.u_prior = np.array([u_prior[key] for key in self.parameters])
        self._scale_whitening = np.linalg.inv(np.linalg.cholesky(scales.covariance))

    def solve(self) -> Solution:
        """Return the least-squares solution; excess scatter of the features increases the covariance."""
        count, scales = len(self.parameters), len(self.scales.of)
        bounds = (np.append(self.low, np.full(scales, -0.5)), np.append(self.high, np.full(scales, 0.5)))
        solution = least_squares(
            self.residuals,
            np.append(self.start, np.zeros(scales)),
            self.jacobian,
            bounds=bounds,
            x_scale=np.append(self.u_prior, np.sqrt(np.diag(self.scales.covariance))),
            xtol=1e-5,
            ftol=1e-7,
            max_nfev=50,
        )
        measured = len(self.used) + len(self._pitch)
        jacobian, chi2 = np.asarray(solution.jac), float(np.sum(solution.fun[:measured] ** 2))
        prior = jacobian[measured:].T @ jacobian[measured:]
        determined = count + scales - float(np.trace(np.linalg.inv(jacobian.T @ jacobian) @ prior))
        df = max(round(measured - determined), 1)
        scale = max(1.0, math.sqrt(chi2 / df))
        covariance = np.linalg.inv(jacobian[:measured].T @ jacobian[:measured] / scale**2 + prior)
        return Solution(np.asarray(solution.x), covariance, chi2, df, scale)

    def settings(self, values: FloatArray) -> Settings:
        """Return the settings with the given parameter values."""
        changed = dict(zip(self.parameters, values.tolist(), strict=True))
        growth = changed.pop("growth_um")
        blurred = self.process.process.model_copy(update=changed)
        halo_um = max(blurred.halo_um, blurred.blur_um)
        return with_growth(blurred.model_copy(update={"halo_um": halo_um}), growth)

    def _printed_um(self, settings: Settings) -> FloatArray:
        """Return the modelled sizes (n,)."""
        return np.asarray(1e3 * printed_mm(settings, self._distinct)[self._distinct_index])

    def _image_um(self, settings: Settings, errors: FloatArray) -> FloatArray:
        """Return the modelled sizes (n,) in images with these scale errors."""
        return np.asarray(self._printed_um(settings) * (1.0 + errors[self.scales.rows]))

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return the residuals of features, distances and priors, each divided by its uncertainty."""
        count = len(self.parameters)
        numbers, errors = values[:count], values[count:]
        settings = self.settings(numbers)
        sizes = self._image_um(settings, errors)
        size = np.where(np.isnan(sizes), _MISSING_UM, sizes - self._measured) / self._u
        pitch = (1.0 - 1e-2 * settings.shrinkage_percent) * (1.0 + errors[self.scales.pitches]) - self._pitch
        prior = (numbers - self.start) / self.u_prior
        return np.concatenate([size, pitch / self._u_pitch, prior, self._scale_whitening @ errors])

    def jacobian(self, values: FloatArray) -> FloatArray:
        """Return the derivatives of the residuals: finite differences for the parameters, exact for the scales."""
        count, rows, pitches = len(self.parameters), len(self.used), len(self._pitch)
        numbers, residuals = values[:count], self.residuals(values)
        result = np.zeros((len(residuals), len(values)))
        for i, size in enumerate(1e-4 * self.u_prior):
            step = size if numbers[i] + size <= self.high[i] else -size
            result[:, i] = (self.residuals(values + step * np.eye(len(values))[i]) - residuals) / step
        settings = self.settings(numbers)
        sizes = np.nan_to_num(self._printed_um(settings))
        result[np.arange(rows), count + self.scales.rows] = sizes / self._u
        shrunk = 1.0 - 1e-2 * settings.shrinkage_percent
        result[rows + np.arange(pitches), count + self.scales.pitches] = shrunk / self._u_pitch
        result[rows + pitches + count :, count:] = self._scale_whitening
        return result

    def fitted(self, values: FloatArray) -> tuple[FittedFeature, ...]:
        """Return the features with their modelled sizes at the scales of their images."""
        count = len(self.parameters)
        sizes = 1e-3 * self._image_um(self.settings(values[:count]), values[count:])
        rows = zip(self.used, 1e-3 * self._u, sizes, strict=True)
        return tuple(
            FittedFeature(feature.kind, feature.nominal_mm, feature.measured_mm or math.nan, float(u), float(size))
            for feature, u, size in rows
        )

    def u_Ec(self, values: FloatArray, covariance: FloatArray) -> float:
        """Return the uncertainty of the critical dose, to first order."""
        gradient = np.empty(len(values))
        for i, step in enumerate(1e-3 * self.u_prior):
            change = step * np.eye(len(values))[i]
            more, less = (self.settings(values + sign * change).Ec_mJ_per_cm2 for sign in (1.0, -1.0))
            gradient[i] = (more - less) / (2.0 * step)
        return math.sqrt(float(gradient @ covariance @ gradient))


def _bounds(settings: Settings) -> tuple[dict[str, float], dict[str, float]]:
    """Return the lower and upper bounds of the parameters."""
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
