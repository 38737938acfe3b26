"""Warnings about the limitations of a working curve; `cautions` returns them."""

import math

import numpy as np

from solen.material.cure.working_curve_fit import SIGNIFICANCE, OmittedDisc, WorkingCurve, means_of
from solen.material.regression import fitted, frequency, t_quantile
from solen.ranks import Caution, do_not_use, warning

_MAX_EXTRAPOLATION = 3.0  # largest ratio of the lowest dose to the critical dose that causes no warning
_MIN_DF = 4.0
_MAX_SHOWN = 4  # number of discs that a warning lists


def cautions(curve: WorkingCurve) -> list[Caution]:
    """Return warnings about the limitations of a working curve."""
    return [*_disc_warnings(curve), *_shape_warnings(curve), *_interval_warnings(curve), *_threshold_warnings(curve)]


def _disc_warnings(curve: WorkingCurve) -> list[Caution]:
    warnings = []
    by_reason: dict[str, list[OmittedDisc]] = {}
    for omitted in curve.left_out:
        by_reason.setdefault(omitted.reason, []).append(omitted)
    for reason, group in by_reason.items():
        discs = [
            f"row {omitted.disc.row} ({_size(omitted)} at {omitted.disc.dose_mJ_per_cm2:.3g} mJ/cm²)"
            for omitted in group[:_MAX_SHOWN]
        ]
        more = f" and {len(group) - _MAX_SHOWN} more" if len(group) > _MAX_SHOWN else ""
        t = [abs(omitted.t) for omitted in group if omitted.t is not None]
        deviation = f" by {min(t):.1f} standard errors or more; --keep-all includes these discs" if t else ""
        warnings.append(warning(f"omitted ({reason}{deviation}): {', '.join(discs)}{more}"))
    return warnings


def _size(omitted: OmittedDisc) -> str:
    um = omitted.disc.thickness_um
    return "no number" if math.isnan(um) else f"{um:.3g} µm"


def _shape_warnings(curve: WorkingCurve) -> list[Caution]:
    lack = curve.lack_of_fit
    doses = {disc.dose_mJ_per_cm2 for disc in curve.used}
    if len(doses) == 2:
        return [warning("two doses cannot show whether the points are on a straight line; add a third dose")]
    if lack is None:
        if len(curve.used) > len(doses):
            return []
        return [
            warning(
                "no dose was repeated, so scatter of the discs and deviations from a straight line cannot be "
                "distinguished; cure three discs at each dose"
            )
        ]
    if lack.p >= SIGNIFICANCE:
        return []
    return [
        warning(
            "the mean thicknesses deviate from the line by more than the scatter of their discs explains "
            f"(F = {lack.F:.1f}, expected by chance {frequency(lack.p)}): {_curvature(curve)}; for the intervals, each "
            "dose is treated as one point"
        )
    ]


def _curvature(curve: WorkingCurve) -> str:
    """Describe the curvature of the mean thickness against the logarithm of dose."""
    means = means_of(curve.used)
    x = np.log([disc.dose_mJ_per_cm2 for disc in means])
    y = np.array([disc.thickness_um for disc in means])
    if len(x) < 4:
        return "a straight line does not fit the points"
    fit = fitted(np.column_stack([np.ones(len(x)), x, (x - x.mean()) ** 2]), y)
    low, high = fit.interval((0.0, 0.0, 1.0))
    if low > 0.0:
        return "the points curve upwards, as expected if the light has several wavelengths or the resin bleaches"
    if high < 0.0:
        return (
            "the points curve downwards, as expected if oxygen inhibits the cure at the beginning of an exposure "
            "or thick discs stop growing"
        )
    return "the points show no clear curvature: the conditions probably changed from dose to dose"


def _interval_warnings(curve: WorkingCurve) -> list[Caution]:
    warnings = []
    if curve.fit.error_df < _MIN_DF:
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


def _threshold_warnings(curve: WorkingCurve) -> list[Caution]:
    warnings = []
    lowest, _ = curve.dose_range_mJ_per_cm2
    if lowest > _MAX_EXTRAPOLATION * curve.Ec_mJ_per_cm2:
        warnings.append(
            warning(
                f"the critical dose is an extrapolation: the lowest dose, {lowest:.3g} mJ/cm², "
                f"is {lowest / curve.Ec_mJ_per_cm2:.1f} times the critical dose; add discs at lower "
                "doses"
            )
        )
    cured_below = [disc for disc in curve.used if disc.dose_mJ_per_cm2 <= curve.Ec_mJ_per_cm2]
    if cured_below:
        dose = min(disc.dose_mJ_per_cm2 for disc in cured_below)
        warnings.append(
            warning(f"a disc cured at {dose:.3g} mJ/cm², below the critical dose of {curve.Ec_mJ_per_cm2:.3g} mJ/cm²")
        )
    liquid = [omitted.disc.dose_mJ_per_cm2 for omitted in curve.left_out if omitted.disc.thickness_um == 0.0]
    if liquid and max(liquid) > curve.Ec_mJ_per_cm2:
        depth = float(curve.depth_um(max(liquid)))
        warnings.append(
            warning(
                f"no disc cured at {max(liquid):.3g} mJ/cm², although the line predicts a thickness of {depth:.3g} µm"
            )
        )
    return warnings
