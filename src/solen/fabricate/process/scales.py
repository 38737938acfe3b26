"""Image scales as unknowns of a calibration: the scale error is common to all lengths of an image.

If the scale of an image has the relative error e, every length in it is multiplied by 1 + e. Treated as independent
noise, this error would average out over features, which it does not. Each image therefore has one such unknown (a
height map has a second one for its heights), with the reported uncertainty as its prior. Images with the same pixel
size were taken with one calibration of one objective: their errors are nearly the same, and many such images determine
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
"""Relative standard uncertainty assumed for a scale if none is specified."""
EXACT = 1e-6
"""Relative uncertainty of a scale that is specified as exact."""
SHARED = 0.9
"""Fraction of the variance that images with the same pixel size have in common."""


@dataclass(frozen=True)
class FittedScale:
    """Fitted scale of lengths or heights in an image: measured divided by true, and its relative prior uncertainty."""

    file: str
    axis: Axis
    factor: float
    u_factor: float
    u_before: float
    stated: bool


@dataclass(frozen=True, eq=False)
class Scales:
    """Unknown scale errors, one for each image and axis, with their features and distances.

    Attributes
    ----------
    of
        Number of the coupon, and the axis.
    rows
        Shape (n,): the unknown of each used feature.
    pitches
        Shape (m,): the unknown of each coupon whose distances are used.
    """

    coupons: tuple[MeasuredCoupon, ...]
    of: tuple[tuple[int, Axis], ...]
    rows: IndexArray
    pitches: IndexArray

    @classmethod
    def among(cls, coupons: Sequence[MeasuredCoupon], used: Sequence[tuple[int, MeasuredFeature]]) -> "Scales":
        """Return the unknowns of the used features, each specified with the number of its coupon."""
        keys = [(number, axis_of(feature)) for number, feature in used]
        pitches: list[tuple[int, Axis]] = [
            (number, "lateral") for number, coupon in enumerate(coupons) if coupon.pitch_ratio is not None
        ]
        distinct = tuple(dict.fromkeys([*keys, *pitches]))
        rows, places = (np.array([distinct.index(key) for key in some], dtype=np.intp) for some in (keys, pitches))
        return cls(tuple(coupons), distinct, rows, places)

    def u_own_mm(self, used: Sequence[tuple[int, MeasuredFeature]]) -> FloatArray:
        """Return standard uncertainties (n,) of features, excluding scale uncertainties."""
        return np.array([one.own_u_mm(self._stated(number, axis_of(one)).u_relative or 0.0) for number, one in used])

    @property
    def covariance(self) -> FloatArray:
        """Prior covariance of the errors."""
        u = np.array([self.u_before(key) for key in self.of])
        together = np.array([[self._alike(one, other) for other in self.of] for one in self.of])
        return np.asarray(u[:, None] * together * u[None, :]) if len(u) else np.zeros((0, 0))

    def u_before(self, key: tuple[int, Axis]) -> float:
        """Return the relative standard uncertainty of a scale before the fit."""
        stated = self._stated(*key).u_relative
        return U_SCALE if stated is None else max(stated, EXACT)

    def fitted(self, errors: FloatArray, u: FloatArray) -> tuple[FittedScale, ...]:
        """Return the fitted scales."""
        return tuple(
            FittedScale(
                self.coupons[key[0]].name,
                key[1],
                1.0 + float(error),
                float(u_error),
                self.u_before(key),
                self._stated(*key).u_relative is not None,
            )
            for key, error, u_error in zip(self.of, errors, u, strict=True)
        )

    def _stated(self, number: int, axis: Axis) -> SharedScale:
        coupon = self.coupons[number]
        return coupon.lateral if axis == "lateral" else coupon.vertical

    def _alike(self, one: tuple[int, Axis], other: tuple[int, Axis]) -> float:
        if one == other:
            return 1.0
        same = one[1] == other[1] and self._stated(*one).size_um == self._stated(*other).size_um
        return SHARED if same else 0.0


def axis_of(feature: MeasuredFeature) -> Axis:
    """Return the axis of the scale that applies to the size of a feature."""
    return "vertical" if feature.kind == "step" else "lateral"
