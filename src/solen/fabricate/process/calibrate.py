"""Calibration of a print process from measured coupons: blur, critical dose at edges, and shrinkage.

Modelled sizes are fitted to measured sizes by least squares, weighted by their uncertainties
(`solen.fabricate.process.coupon_fit`). The previous process is a prior with three times its reported uncertainty, so
parameters that the coupons cannot determine stay unchanged, with a warning. The scale of each image is another unknown
(`solen.fabricate.process.scales`): scale and shrinkage multiply all sizes equally, so shrinkage is as uncertain as the
scale. Large features determine edge growth and scaling; only features about as small as the blur separate the blur from
the critical dose. Washing moves edges in the same way as the critical dose, so its value is kept.

The fitted critical dose is an effective value: together with the blur it reproduces the measured edges. The critical
dose of a working curve is a different quantity, which is more suitable for depths.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.coupon_fit import CouponFit, FittedFeature, Solution
from solen.fabricate.process.features import MeasuredCoupon, MeasuredFeature, printed_mm
from solen.fabricate.process.process_file import Calibration, Process
from solen.fabricate.process.scales import U_SCALE, FittedScale, Scales
from solen.fabricate.process.settings import Settings
from solen.ranks import Caution, note, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, reported

FITTED = ("Ec_mJ_per_cm2", "shrinkage_percent")
"""Parameters fitted in addition to the blur width (or, for a response, its scale)."""
INSEPARABLE = 0.9
"""Absolute correlation above which two parameters count as inseparable."""
DETERMINED = 0.5
"""Fraction by which the coupons must reduce the prior variance of a parameter that counts as determined."""
MIN_FEATURES = 3
_DOUBT = 2.0


@dataclass(frozen=True)
class CalibratedNumber:
    """A process parameter with its standard uncertainty before and after calibration; ``key`` ends in the unit.

    ``growth_um`` replaces the critical dose: it is the growth of a straight wall beyond its image.
    """

    key: str
    value: float
    u: float
    u_before: float

    @property
    def learned(self) -> float:
        """Fraction of the prior variance that the coupons removed."""
        return 1.0 - (self.u / self.u_before) ** 2


class PrinterCalibration(Result):
    """A calibrated process, and how well it explains the coupons.

    Attributes
    ----------
    process
        The process, with its calibration.
    simulated
        Whether sizes were computed rather than measured.
    numbers
        Fitted parameters.
    covariance
        Covariance of the parameters, (p, p).
    Ec_mJ_per_cm2, u_Ec_mJ_per_cm2
        Effective critical dose and its standard uncertainty.
    given, features
        Number of features in the files, and the features used.
    scales
        Scale of each image, measured divided by true.
    chi2, df
        Chi-square, and number of measured values minus the number of parameters that they determine.
    scale
        Factor by which uncertainties are increased if features scatter more than reported; 1 otherwise.
    disagree
        Features that are resolved only in the model or only in the measurement.
    sources, warnings
        Feature files, and limits of the conclusions.
    """

    process: Process = field(metadata=HIDDEN)
    simulated: bool
    numbers: tuple[CalibratedNumber, ...]
    covariance: FloatArray = field(metadata=HIDDEN)
    Ec_mJ_per_cm2: float
    u_Ec_mJ_per_cm2: float
    given: int
    features: tuple[FittedFeature, ...]
    scales: tuple[FittedScale, ...]
    chi2: float
    df: int
    scale: float
    disagree: tuple[MeasuredFeature, ...]
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]

    @reported
    def name(self) -> str:
        """Name of the process."""
        return self.process.name

    @reported
    def settings(self) -> Settings:
        """Values of the process."""
        return self.process.process

    @reported
    def correlation(self) -> FloatArray:
        """Correlations of the parameters, (p, p)."""
        u = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(u, u))

    @reported
    def rms_um(self) -> float:
        """Root mean square of printed minus measured sizes."""
        off_um = [1e3 * (feature.printed_mm - feature.measured_mm) for feature in self.features]
        return float(np.sqrt(np.nanmean(np.square(off_um))))


def calibrated(process: Process, coupons: Sequence[MeasuredCoupon], name: str) -> PrinterCalibration:
    """Fit a process to measured coupons.

    Parameters
    ----------
    process
        Prior process.
    coupons
        Features of each image, printed with that process.
    name
        Source of the parameters, for the process file.

    Raises
    ------
    DataError
        If there are too few features with a size, or the model prints none of them.
    """
    features = [feature for coupon in coupons for feature in coupon.features]
    used = tuple(
        (number, feature)
        for number, coupon in enumerate(coupons)
        for feature in coupon.features
        if feature.resolved and feature.measured_mm is not None and feature.u_measured_mm is not None
    )
    lateral = sum(feature.kind != "step" for _, feature in used)
    if lateral < MIN_FEATURES:
        limit = f"must have at least {MIN_FEATURES} pillars, holes or gaps with a measured size"
        raise DataError("coupons", value=f"{lateral} of {len(features)} features", limit=limit)
    keys = (process.process.blur_key, *FITTED) + (("shrinkage_z_percent",) if lateral < len(used) else ())
    problem = CouponFit(process, used, Scales.among(coupons, used), keys)
    fit = problem.solved()
    return _calibration(problem, fit, coupons, name)


def _calibration(problem: CouponFit, fit: Solution, coupons: Sequence[MeasuredCoupon], name: str) -> PrinterCalibration:
    """Return the result with its warnings."""
    count = len(problem.sought)
    values, covariance = fit.values[:count], fit.covariance[:count, :count]
    settings, u = problem.settings(values), np.sqrt(np.diag(fit.covariance))
    u_of_Ec = problem.u_of_Ec(values, covariance)
    rows = zip(problem.sought, values, u, problem.before, strict=False)
    simulated = any(coupon.source is not None and coupon.source.simulated for coupon in coupons)
    features = [feature for coupon in coupons for feature in coupon.features]
    calibration = PrinterCalibration(
        process=_process(problem, settings, covariance, u_of_Ec, name, simulated),
        simulated=simulated,
        numbers=tuple(CalibratedNumber(key, float(x), float(one), float(before)) for key, x, one, before in rows),
        covariance=covariance,
        Ec_mJ_per_cm2=settings.Ec_mJ_per_cm2,
        u_Ec_mJ_per_cm2=u_of_Ec,
        given=len(features),
        features=problem.fitted(fit.values),
        scales=problem.scales.fitted(fit.values[count:], u[count:]),
        chi2=fit.chi2,
        df=fit.df,
        scale=fit.scale,
        disagree=_disagreeing(settings, features),
        sources=tuple(coupon.source for coupon in coupons if coupon.source is not None),
        warnings=(warning("the features are simulated, not measured"),) if simulated else (),
    )
    more = (*_of_scales(calibration), *_unknown(calibration), *_inseparable(calibration), *_of_fit(calibration))
    return replace(calibration, warnings=(*calibration.warnings, *more))


def _process(
    problem: CouponFit, settings: Settings, covariance: FloatArray, u_of_Ec: float, name: str, simulated: bool
) -> Process:
    """Return the calibrated process, as written to its file."""
    before, count = problem.process, len(problem.used)
    data = before.model_dump()
    data["process"] = settings.model_dump()
    made = "simulated coupons" if simulated else "measured coupons"
    for key, variance in zip(problem.keys, np.diag(covariance).tolist(), strict=True):
        data["uncertainty"][key] = u_of_Ec if key == "Ec_mJ_per_cm2" else math.sqrt(variance)
        data["source"][key] = f"calibration: {count} features of {made}, {name}"
    data["name"] = f"{before.name}, calibrated on {name}"
    data["calibration"] = Calibration(
        keys=problem.sought,
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        features=count,
        simulated=simulated,
    ).model_dump()
    return Process(**data)


def _disagreeing(settings: Settings, features: Sequence[MeasuredFeature]) -> tuple[MeasuredFeature, ...]:
    there = ~np.isnan(printed_mm(settings, features))
    return tuple(
        feature for feature, is_there in zip(features, there.tolist(), strict=True) if is_there != feature.resolved
    )


def _of_scales(fit: PrinterCalibration) -> list[Caution]:
    unstated = list(dict.fromkeys(scale.file for scale in fit.scales if not scale.stated))
    if not unstated:
        return []
    return [
        warning(
            f"{', '.join(unstated)}: the scale uncertainty is not specified; {100.0 * U_SCALE:g} % is assumed, which "
            "limits shrinkage: determine it with a stage micrometer and use --u-um-per-px (--u-z-um for heights)"
        )
    ]


def _unknown(fit: PrinterCalibration) -> list[Caution]:
    return [
        warning(
            f"these coupons do not determine {number.key}: it keeps its prior value, {number.value:.3g} "
            f"± {number.u:.2g}"
        )
        for number in fit.numbers
        if number.learned < DETERMINED
    ]


def _inseparable(fit: PrinterCalibration) -> list[Caution]:
    """Warn of parameters that change all coupons in the same way."""
    warnings = [
        note(
            "washing, critical dose, exposure and scattering move edges in the same way and cannot be separated here: "
            f"Ec_mJ_per_cm2 is an effective value for edges at wash_um = {fit.settings.wash_um:g}, not valid for "
            "depths; only the growth of walls is determined, and it is kept"
        )
    ]
    for i, j in combinations(range(len(fit.numbers)), 2):
        correlation = float(fit.correlation[i, j])
        if abs(correlation) > INSEPARABLE:
            warnings.append(
                warning(
                    f"{fit.numbers[i].key} and {fit.numbers[j].key} can hardly be separated (correlation "
                    f"{correlation:+.2f}): measure features with a wider range of sizes"
                )
            )
    return warnings


def _of_fit(fit: PrinterCalibration) -> list[Caution]:
    warnings = []
    if fit.scale > _DOUBT:
        warnings.append(
            warning(
                f"features deviate by {fit.scale:.2g} times their reported uncertainty (rms {fit.rms_um:.2g} µm): "
                "either the model does not describe them, or their uncertainty is underestimated; uncertainties were "
                "increased by this factor"
            )
        )
    if fit.disagree:
        listed = ", ".join(f"{feature.kind} of {feature.nominal_mm:g} mm" for feature in fit.disagree[:6])
        more = "" if len(fit.disagree) <= 6 else f" and {len(fit.disagree) - 6} more"
        warnings.append(
            warning(f"the model and the coupons disagree on whether these features are resolved: {listed}{more}")
        )
    return warnings
