"""Calibration of a print process from measured coupons: blur, critical dose at edges, and shrinkage.

The model is fitted to measured sizes by least squares, weighted by their uncertainties
(`solen.fabricate.process.coupon_fit`). The previous process is a prior with three times its reported uncertainty, so
that parameters that the coupons cannot determine stay unchanged, with a warning. The scale of each image is a further
unknown (`solen.fabricate.process.scales`): scale and shrinkage multiply all sizes equally, so that shrinkage is as
uncertain as the scale. Large features determine the growth of edges and the shrinkage; only features as small as the
blur separate the blur from the critical dose. Washing moves edges in the same way as the critical dose, so its value is
kept.

The fitted critical dose is an effective value, which reproduces the measured edges together with the blur. It differs
from the critical dose of a working curve, which is more suitable for depths.
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
"""Parameters that are fitted in addition to the blur width (or the scale of a pixel response)."""
MAX_CORRELATION = 0.9
"""Maximum absolute correlation of two parameters without a warning."""
MIN_VARIANCE_REDUCTION = 0.5
"""Minimum fractional reduction of the prior variance at which the coupons determine a parameter."""
MIN_FEATURES = 3
_MAX_SCATTER = 2.0  # maximum ratio of scatter to reported uncertainty without a warning


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
    def variance_reduction(self) -> float:
        """Fraction by which the coupons reduced the prior variance."""
        return 1.0 - (self.u / self.u_before) ** 2


class PrinterCalibration(Result):
    """A calibrated process, and how well it describes the coupons.

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
        Scale of each image, as measured divided by true size.
    chi2, df
        Chi-square, and degrees of freedom (parameters that follow from their prior do not reduce them).
    scale
        Factor by which uncertainties are increased because features scatter more than reported; otherwise 1.
    disagree
        Features that are resolved in the model or in the measurement, but not in both.
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
        """RMS difference between modelled and measured sizes."""
        differences_um = [1e3 * (feature.printed_mm - feature.measured_mm) for feature in self.features]
        return float(np.sqrt(np.nanmean(np.square(differences_um))))


def calibrated(process: Process, coupons: Sequence[MeasuredCoupon], name: str) -> PrinterCalibration:
    """Fit a process to measured coupons.

    Parameters
    ----------
    process
        Prior process.
    coupons
        Features of each image of coupons printed with that process.
    name
        Description of the coupons, for the sources in the process file.

    Raises
    ------
    DataError
        If too few features have a measured size, or the model prints none of them.
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
        required = f"must have at least {MIN_FEATURES} pillars, holes or gaps with a measured size"
        raise DataError("coupons", limit=f"{required}, but only {lateral} of {len(features)} features qualify")
    keys = (process.process.blur_key, *FITTED) + (("shrinkage_z_percent",) if lateral < len(used) else ())
    problem = CouponFit(process, used, Scales.among(coupons, used), keys)
    return _calibration(problem, problem.solve(), coupons, name)


def _calibration(problem: CouponFit, fit: Solution, coupons: Sequence[MeasuredCoupon], name: str) -> PrinterCalibration:
    """Return the result of a calibration, with its warnings."""
    count = len(problem.parameters)
    values, covariance = fit.values[:count], fit.covariance[:count, :count]
    settings, u = problem.settings(values), np.sqrt(np.diag(fit.covariance))
    u_Ec = problem.u_Ec(values, covariance)
    rows = zip(problem.parameters, values, u, problem.u_prior, strict=False)
    simulated = any(coupon.source is not None and coupon.source.simulated for coupon in coupons)
    features = [feature for coupon in coupons for feature in coupon.features]
    calibration = PrinterCalibration(
        process=_process(problem, settings, covariance, u_Ec, name, simulated),
        simulated=simulated,
        numbers=tuple(CalibratedNumber(key, float(x), float(u_x), float(before)) for key, x, u_x, before in rows),
        covariance=covariance,
        Ec_mJ_per_cm2=settings.Ec_mJ_per_cm2,
        u_Ec_mJ_per_cm2=u_Ec,
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
    warnings = (
        *calibration.warnings,
        *_scale_warnings(calibration),
        *_undetermined(calibration),
        *_correlated(calibration),
        *_fit_warnings(calibration),
    )
    return replace(calibration, warnings=warnings)


def _process(
    problem: CouponFit, settings: Settings, covariance: FloatArray, u_Ec: float, name: str, simulated: bool
) -> Process:
    """Return the calibrated process, as written to its file."""
    before, count = problem.process, len(problem.used)
    data = before.model_dump()
    data["process"] = settings.model_dump()
    origin = "simulated coupons" if simulated else "measured coupons"
    for key, variance in zip(problem.keys, np.diag(covariance).tolist(), strict=True):
        data["uncertainty"][key] = u_Ec if key == "Ec_mJ_per_cm2" else math.sqrt(variance)
        data["source"][key] = f"calibration: {count} features of {origin}, {name}"
    data["name"] = f"{before.name}, calibrated on {name}"
    data["calibration"] = Calibration(
        keys=problem.parameters,
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        features=count,
        simulated=simulated,
    ).model_dump()
    return Process(**data)


def _disagreeing(settings: Settings, features: Sequence[MeasuredFeature]) -> tuple[MeasuredFeature, ...]:
    printed = (~np.isnan(printed_mm(settings, features))).tolist()
    return tuple(
        feature for feature, is_printed in zip(features, printed, strict=True) if is_printed != feature.resolved
    )


def _scale_warnings(fit: PrinterCalibration) -> list[Caution]:
    files = list(dict.fromkeys(scale.file for scale in fit.scales if not scale.stated))
    if not files:
        return []
    text = f"{', '.join(files)}: the uncertainty of the scale is not specified; {100.0 * U_SCALE:g} % is assumed"
    remedy = "measure it with a stage micrometer and specify it with --u-um-per-px (--u-z-um for heights)"
    return [warning(f"{text}, which limits the accuracy of the shrinkage: {remedy}")]


def _undetermined(fit: PrinterCalibration) -> list[Caution]:
    return [
        warning(
            f"these coupons do not determine {number.key}: its value, {number.value:.3g} ± {number.u:.2g}, "
            "follows mainly from its prior"
        )
        for number in fit.numbers
        if number.variance_reduction < MIN_VARIANCE_REDUCTION
    ]


def _correlated(fit: PrinterCalibration) -> list[Caution]:
    """Warn of parameters that cannot be determined separately."""
    warnings = [
        note(
            "washing, critical dose, exposure and scattering move edges in the same way and cannot be determined "
            f"separately: Ec_mJ_per_cm2 is an effective value for edges at wash_um = {fit.settings.wash_um:g}, not "
            "valid for depths; only the growth of walls is determined, and it is kept"
        )
    ]
    for i, j in combinations(range(len(fit.numbers)), 2):
        correlation = float(fit.correlation[i, j])
        if abs(correlation) > MAX_CORRELATION:
            pair = f"{fit.numbers[i].key} and {fit.numbers[j].key} are strongly correlated ({correlation:+.2f})"
            warnings.append(warning(f"{pair}: measure features with a wider range of sizes"))
    return warnings


def _fit_warnings(fit: PrinterCalibration) -> list[Caution]:
    warnings = []
    if fit.scale > _MAX_SCATTER:
        text = f"features deviate by {fit.scale:.2g} times their reported uncertainty (RMS {fit.rms_um:.2g} µm)"
        cause = "either the model does not describe them, or their uncertainty is underestimated"
        warnings.append(warning(f"{text}: {cause}; all uncertainties were increased by this factor"))
    if fit.disagree:
        features = ", ".join(f"{feature.kind} of {feature.nominal_mm:g} mm" for feature in fit.disagree[:6])
        more = "" if len(fit.disagree) <= 6 else f" and {len(fit.disagree) - 6} more"
        warnings.append(warning(f"resolved either in the model or on the coupons, but not in both: {features}{more}"))
    return warnings
