"""Image scales as unknowns of a calibration: a scale error is common to all lengths of an image.

If the scale of an image has the relative error e, every length in it is multiplied by 1 + e. Treated as independent
noise, this error would average out over features, which it does not. Each image therefore has one such unknown (a
height map has a second one for its heights), with the reported uncertainty as its prior. Images with the same pixel
size have the same calibration of the objective: their errors are nearly the same, and many such images determine
the scale no better than a single image.

`Scales` contains the unknowns of coupons; `FittedScale` is a scale after the fit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from solen.arrays import FloatArray, IndexArray
from solen.fabricate.process.features import MeasuredCoupon, MeasuredFeature, SharedScale

Axis = Literal["lateral", "vertical"]
U_SCALE = 0.03
"""Relative standard uncertainty that is assumed for a scale if none is specified."""
MIN_U = 1e-6
"""Minimum relative standard uncertainty of a scale."""
SHARED_VARIANCE = 0.9
"""Fraction of the variance that images with the same pixel size have in common."""


@dataclass(frozen=True)
class FittedScale:
    """Fitted scale of the lengths or heights of an image, measured divided by true, and its prior uncertainty."""

    file: str
    axis: Axis
    factor: float
    u_factor: float
    u_before: float
    stated: bool


@dataclass(frozen=True, eq=False)
class Scales:
    """Unknown scale errors, one for each image and axis.

    Attributes
    ----------
    of
        Index of the coupon, and axis, of each unknown.
    rows
        For each feature in the fit, the index (n,) of its unknown scale error.
    pitches
        For each coupon with measured distances, the index (m,) of its unknown scale error.
    """

    coupons: tuple[MeasuredCoupon, ...]
    of: tuple[tuple[int, Axis], ...]
    rows: IndexArray
    pitches: IndexArray

    @classmethod
    def among(cls, coupons: Sequence[MeasuredCoupon], used: Sequence[tuple[int, MeasuredFeature]]) -> "Scales":
        """Return the unknown scale errors of features; each feature is given with the index of its coupon."""
        keys = [(number, axis_of(feature)) for number, feature in used]
        pitches: list[tuple[int, Axis]] = [
            (number, "lateral") for number, coupon in enumerate(coupons) if coupon.pitch_ratio is not None
        ]
        distinct = tuple(dict.fromkeys([*keys, *pitches]))
        indices = [np.array([distinct.index(key) for key in group], dtype=np.intp) for group in (keys, pitches)]
        return cls(tuple(coupons), distinct, *indices)

    def u_own_mm(self, used: Sequence[tuple[int, MeasuredFeature]]) -> FloatArray:
        """Return the standard uncertainties (n,) of features without those of the scales."""
        u_scales = (self._scale(number, axis_of(feature)).u_relative or 0.0 for number, feature in used)
        return np.array([feature.own_u_mm(u) for (_, feature), u in zip(used, u_scales, strict=True)])

    @property
    def covariance(self) -> FloatArray:
        """Prior covariance of the errors."""
        u = np.array([self.u_prior(key) for key in self.of])
        correlation = np.array([[self._correlation(first, second) for second in self.of] for first in self.of])
        return np.asarray(u[:, None] * correlation * u[None, :]) if len(u) else np.zeros((0, 0))

    def u_prior(self, key: tuple[int, Axis]) -> float:
        """Return the relative standard uncertainty of a scale before the fit."""
        u = self._scale(*key).u_relative
        return U_SCALE if u is None else max(u, MIN_U)

    def fitted(self, errors: FloatArray, u: FloatArray) -> tuple[FittedScale, ...]:
        """Return the fitted scales."""
        return tuple(
            FittedScale(
                file=self.coupons[key[0]].name,
                axis=key[1],
                factor=1.0 + float(error),
                u_factor=float(u_error),
                u_before=self.u_prior(key),
                stated=self._scale(*key).u_relative is not None,
            )
            for key, error, u_error in zip(self.of, errors, u, strict=True)
        )

    def _scale(self, number: int, axis: Axis) -> SharedScale:
        coupon = self.coupons[number]
        return coupon.lateral if axis == "lateral" else coupon.vertical

    def _correlation(self, first: tuple[int, Axis], second: tuple[int, Axis]) -> float:
        if first == second:
            return 1.0
        is_shared = first[1] == second[1] and self._scale(*first).size_um == self._scale(*second).size_um
        return SHARED_VARIANCE if is_shared else 0.0


def axis_of(feature: MeasuredFeature) -> Axis:
    """Return the axis of the scale that applies to the size of a feature."""
    return "vertical" if feature.kind == "step" else "lateral"
