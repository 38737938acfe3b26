"""Limitations of a working curve, as warnings with numbers; `cautions` returns them."""

import math

import numpy as np

from solen.material.cure.curve import SIGNIFICANCE, LeftOut, WorkingCurve, means_of
from solen.material.regression import chance, fitted, t_quantile
from solen.ranks import Caution, do_not_use, warning

_FAR = 3.0  # ratio of the lowest dose to the critical dose above which the latter is an extrapolation
_FEW_DF = 4.0
_SHOWN = 4


def cautions(curve: WorkingCurve) -> list[Caution]:
    """Return the limitations of a working curve as warnings."""
    return [*_of_discs(curve), *_of_shape(curve), *_of_intervals(curve), *_of_threshold(curve)]


def _of_discs(curve: WorkingCurve) -> list[Caution]:
    warnings = []
    by_reason: dict[str, list[LeftOut]] = {}
    for left in curve.left_out:
        by_reason.setdefault(left.reason, []).append(left)
    for reason, alike in by_reason.items():
        where = [
            f"row {left.disc.row} ({_size(left)} at {left.disc.dose_mJ_per_cm2:.3g} mJ/cm²)" for left in alike[:_SHOWN]
        ]
        more = f" and {len(alike) - _SHOWN} more" if len(alike) > _SHOWN else ""
        t = [abs(left.t) for left in alike if left.t is not None]
        off = f" by {min(t):.1f} standard errors or more; --keep-all keeps these discs" if t else ""
        warnings.append(warning(f"omitted ({reason}{off}): {', '.join(where)}{more}"))
    return warnings


def _size(left: LeftOut) -> str:
    thick = left.disc.thickness_um
    return "no number" if math.isnan(thick) else f"{thick:.3g} µm"


def _of_shape(curve: WorkingCurve) -> list[Caution]:
    lack = curve.lack_of_fit
    doses = {disc.dose_mJ_per_cm2 for disc in curve.used}
    if len(doses) == 2:
        return [warning("two doses cannot show whether the points lie on a line; add a third dose")]
    if lack is None:
        if len(curve.used) > len(doses):
            return []
        return [
            warning(
                "no dose was repeated, so the scatter of the discs and the linearity can be judged "
                "only from the deviations from the line; cure three discs at each dose"
            )
        ]
    if lack.p >= SIGNIFICANCE:
        return []
    return [
        warning(
            "the mean thicknesses deviate from the line by more than the scatter of their discs "
            f"(F = {lack.F:.1f}, expected by chance {chance(lack.p)}): {_bend(curve)}; each dose "
            "counts as one point for the intervals"
        )
    ]


def _bend(curve: WorkingCurve) -> str:
    """Describe the curvature of the mean thickness against the logarithm of dose."""
    means = means_of(curve.used)
    x = np.log([disc.dose_mJ_per_cm2 for disc in means])
    y = np.array([disc.thickness_um for disc in means])
    if len(x) < 4:
        return "a single line does not fit the points"
    fit = fitted(np.column_stack([np.ones(len(x)), x, (x - x.mean()) ** 2]), y)
    low, high = fit.interval((0.0, 0.0, 1.0))
    if low > 0.0:
        return "the points curve upwards, as expected if the light has several wavelengths or the resin bleaches"
    if high < 0.0:
        return (
            "the points curve downwards, as expected if oxygen consumes the first part of a "
            "dose or thick discs stop growing"
        )
    return "the points show no clear curvature: the conditions changed from dose to dose"


def _of_intervals(curve: WorkingCurve) -> list[Caution]:
    warnings = []
    if curve.fit.error_df < _FEW_DF:
        warnings.append(
            warning(
                f"the fit has {curve.fit.error_df} degrees of freedom, so each interval extends "
                f"at least {t_quantile(0.95, curve.fit.error_df):.1f} standard uncertainties to "
                "either side"
            )
        )
    if curve.interval95_Dp_um[0] <= 0.0 or curve.interval95_Ec_mJ_per_cm2 is None:
        warnings.append(
            do_not_use("the slope is too uncertain for an interval of the critical dose: use more widely spaced doses")
        )
    return warnings


def _of_threshold(curve: WorkingCurve) -> list[Caution]:
    warnings = []
    lowest, _ = curve.dose_range_mJ_per_cm2
    if lowest > _FAR * curve.Ec_mJ_per_cm2:
        warnings.append(
            warning(
                f"the critical dose is an extrapolation: the lowest dose, {lowest:.3g} mJ/cm², "
                f"is {lowest / curve.Ec_mJ_per_cm2:.1f} times the critical dose; add discs at lower "
                "doses"
            )
        )
    set_below = [disc for disc in curve.used if disc.dose_mJ_per_cm2 <= curve.Ec_mJ_per_cm2]
    if set_below:
        dose = min(disc.dose_mJ_per_cm2 for disc in set_below)
        warnings.append(
            warning(f"a disc set at {dose:.3g} mJ/cm², below the critical dose of {curve.Ec_mJ_per_cm2:.3g} mJ/cm²")
        )
    liquid = [left.disc.dose_mJ_per_cm2 for left in curve.left_out if left.disc.thickness_um == 0.0]
    if liquid and max(liquid) > curve.Ec_mJ_per_cm2:
        depth = float(curve.depth_um(max(liquid)))
        warnings.append(
            warning(
                f"no disc set at {max(liquid):.3g} mJ/cm², although the line predicts a thickness of {depth:.3g} µm"
            )
        )
    return warnings
