"""A process's numbers from measured coupons: the blur, the dose that sets an edge, the shrinkage.

The idea: least squares of printed sizes against measured ones, each weighed by its uncertainty. What the process was
taken to be before is a prior, three times as uncertain as stated, so that what coupons cannot determine stays where it
was, with a warning. Large features show how far an edge grows and how sizes scale; only features about as small as the
blur separate the blur from the critical dose; washing moves every edge as the critical dose does, and stays as stated.

The critical dose that comes out is effective: with the blur it places edges where they were measured. A working curve's
is another number, and a better one for depths.

The interface: `calibrated` gives a `PrinterCalibration`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.features import Kind, MeasuredFeature, printed_mm
from solen.fabricate.process.growth import growth_um, with_growth
from solen.fabricate.process.settings import Calibration, Process, Settings
from solen.recording import Provenance
from solen.results import HIDDEN, Result, reported

SOUGHT = ("sigma_um", "Ec_mJ_per_cm2", "shrinkage_percent")
WEAK = 3.0
"""By how much the stated uncertainty of the process of before is multiplied for the prior."""
WIDEST_GROWTH = 10.0
"""Uncertainty of before of a wall's growth, in pixels: as good as none."""
WIDE: dict[str, float] = {
    "sigma_um": 10.0,
    "Ec_mJ_per_cm2": 5.0,
    "shrinkage_percent": 2.0,
    "shrinkage_z_percent": 2.0,
}
"""Uncertainty of before where a process states none."""
INSEPARABLE = 0.9
"""Correlation above which two numbers cannot be separated."""
LEARNED = 0.5
"""Share of its variance of before that a number must lose to count as determined by the coupons."""
LEAST = 3
_LOST_UM = 200.0  # residual of a feature that the model does not print, in µm
_DOUBT = 2.0


@dataclass(frozen=True)
class CalibratedNumber:
    """A number of the process with its standard uncertainty now and before; ``key`` ends in its unit.

    ``growth_um`` stands for the critical dose: how far a straight wall grows beyond its image.
    """

    key: str
    value: float
    u: float
    u_before: float

    @property
    def learned(self) -> float:
        """Share of the variance of before that the coupons removed."""
        return 1.0 - (self.u / self.u_before) ** 2


@dataclass(frozen=True)
class FittedFeature:
    """A feature that was used: its size as drawn, as measured, and as the model prints it."""

    kind: Kind
    nominal_mm: float
    measured_mm: float
    u_measured_mm: float
    printed_mm: float


@dataclass(frozen=True, eq=False, repr=False)
class PrinterCalibration(Result):
    """A calibrated process, and how well it explains the coupons.

    Attributes
    ----------
    process
        The process, with its calibration.
    simulated
        Whether sizes were computed rather than measured.
    numbers
        Numbers that were sought.
    covariance
        Of the numbers, (p, p).
    Ec_mJ_per_cm2, u_Ec_mJ_per_cm2
        Effective critical dose.
    given, features
        Number of features that were given, and those that were used.
    chi2, df
        Sum of squared residuals over uncertainties, and features less numbers that they determine.
    scale
        By what uncertainties were multiplied because features scatter more than they state; 1 where they do not.
    disagree
        Features that the model prints and that were not found, or the other way round.
    sources, warnings
        Files of the features, and what cannot be concluded.
    """

    process: Process = field(metadata=HIDDEN)
    simulated: bool
    numbers: tuple[CalibratedNumber, ...]
    covariance: FloatArray = field(metadata=HIDDEN)
    Ec_mJ_per_cm2: float
    u_Ec_mJ_per_cm2: float
    given: int
    features: tuple[FittedFeature, ...]
    chi2: float
    df: int
    scale: float
    disagree: tuple[MeasuredFeature, ...]
    sources: tuple[Provenance, ...]
    warnings: tuple[str, ...]

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
        """Correlations of the numbers, (p, p)."""
        u = np.sqrt(np.diag(self.covariance))
        return np.asarray(self.covariance / np.outer(u, u))

    @reported
    def rms_um(self) -> float:
        """Root mean square of printed less measured sizes."""
        off_um = [1e3 * (feature.printed_mm - feature.measured_mm) for feature in self.features]
        return float(np.sqrt(np.nanmean(np.square(off_um))))


def calibrated(
    process: Process,
    features: Sequence[MeasuredFeature],
    name: str,
    *,
    simulated: bool = False,
    sources: Sequence[Provenance] = (),
) -> PrinterCalibration:
    """Process that prints coupons as they were measured.

    Parameters
    ----------
    process
        What was known before.
    features
        Features of one or several coupons, printed by that process.
    name
        What the numbers rest on, for the process file.
    simulated
        Whether sizes were computed rather than measured.
    sources
        Files of the features.

    Raises
    ------
    DataError
        For too few features with a size, or none that the model prints.
    """
    used = tuple(
        feature
        for feature in features
        if feature.resolved and feature.measured_mm is not None and feature.u_measured_mm is not None
    )
    lateral = sum(feature.kind != "step" for feature in used)
    if lateral < LEAST:
        limit = f"needs at least {LEAST} pillars, holes or gaps with a measured size"
        raise DataError("coupons", value=f"{lateral} of {len(features)} features", limit=limit)
    problem = _Problem(process, used, SOUGHT + (("shrinkage_z_percent",) if lateral < len(used) else ()))
    solution = least_squares(
        problem.residuals,
        problem.start,
        bounds=problem.bounds,
        x_scale=problem.before,
        diff_step=np.full(len(problem.keys), 1e-4),
        xtol=1e-5,
        ftol=1e-7,
        max_nfev=50,
    )
    jacobian, count = np.asarray(solution.jac), len(used)
    chi2 = float(np.sum(solution.fun[:count] ** 2))
    learned = 1.0 - np.diag(np.linalg.inv(jacobian.T @ jacobian)) / problem.before**2
    df = max(count - int(np.count_nonzero(learned > LEARNED)), 1)
    scale = max(1.0, math.sqrt(chi2 / df))
    # features that scatter more weigh less; what was known before keeps its weight
    weight = np.concatenate([np.full(count, scale**-2), np.ones(len(problem.keys))])
    covariance = np.linalg.inv((jacobian * weight[:, None]).T @ jacobian)
    settings = problem.settings(solution.x)
    u_of_Ec = problem.u_of_Ec(solution.x, covariance)
    rows = zip(problem.sought, solution.x, np.sqrt(np.diag(covariance)), problem.before, strict=True)
    calibration = PrinterCalibration(
        process=_process(problem, settings, covariance, u_of_Ec, name, simulated),
        simulated=simulated,
        numbers=tuple(CalibratedNumber(key, float(x), float(u), float(before)) for key, x, u, before in rows),
        covariance=covariance,
        Ec_mJ_per_cm2=settings.Ec_mJ_per_cm2,
        u_Ec_mJ_per_cm2=u_of_Ec,
        given=len(features),
        features=_fitted(settings, used),
        chi2=chi2,
        df=df,
        scale=scale,
        disagree=_disagreeing(settings, features),
        sources=tuple(sources),
        warnings=("the features are simulated, not measured",) if simulated else (),
    )
    more = (*_unknown(calibration), *_inseparable(calibration), *_of_fit(calibration))
    return replace(calibration, warnings=(*calibration.warnings, *more))


def _fitted(settings: Settings, used: Sequence[MeasuredFeature]) -> tuple[FittedFeature, ...]:
    sizes = printed_mm(settings, used).tolist()
    return tuple(
        FittedFeature(
            feature.kind, feature.nominal_mm, feature.measured_mm or math.nan, feature.u_measured_mm or math.nan, size
        )
        for feature, size in zip(used, sizes, strict=True)
    )


class _Problem:
    """Least squares in numbers that coupons separate best: the growth of a straight wall in place of critical dose."""

    def __init__(self, process: Process, used: Sequence[MeasuredFeature], keys: tuple[str, ...]) -> None:
        self.process, self.used, self.keys = process, used, keys
        self.sought = tuple("growth_um" if key == "Ec_mJ_per_cm2" else key for key in keys)
        self._measured = np.array([1e3 * (feature.measured_mm or 0.0) for feature in used])
        self._u = np.array([1e3 * (feature.u_measured_mm or 0.0) for feature in used])
        settings = process.process
        start = {key: float(getattr(settings, key)) for key in keys} | {"growth_um": growth_um(settings)}
        before = {key: WEAK * (process.uncertainty.get(key) or WIDE[key]) for key in keys}
        before["growth_um"] = WIDEST_GROWTH * settings.pixel_um
        low, high = _ends(settings)
        least, most = (np.array([ends[key] for key in self.sought]) for ends in (low, high))
        self.bounds = (least, most)
        self.start = np.clip([start[key] for key in self.sought], *self.bounds)
        self.before = np.array([before[key] for key in self.sought])

    def settings(self, values: FloatArray) -> Settings:
        """Process of some values."""
        changed = dict(zip(self.sought, values.tolist(), strict=True))
        growth = changed.pop("growth_um")
        changed["halo_um"] = max(self.process.process.halo_um, changed["sigma_um"])
        blurred = self.process.process.model_copy(update=changed)
        return with_growth(blurred, growth)

    def residuals(self, values: FloatArray) -> FloatArray:
        """Of features in their uncertainties, and of what was known before in its own."""
        sizes = 1e3 * printed_mm(self.settings(values), self.used)
        off = np.where(np.isnan(sizes), _LOST_UM, sizes - self._measured)
        return np.concatenate([off / self._u, (values - self.start) / self.before])

    def u_of_Ec(self, values: FloatArray, covariance: FloatArray) -> float:
        """Uncertainty of the critical dose, to first order."""
        slope = np.empty(len(values))
        for i, step in enumerate(1e-3 * self.before):
            ends = [self.settings(values + sign * step * np.eye(len(values))[i]).Ec_mJ_per_cm2 for sign in (1.0, -1.0)]
            slope[i] = (ends[0] - ends[1]) / (2.0 * step)
        return math.sqrt(float(slope @ covariance @ slope))


def _ends(settings: Settings) -> tuple[dict[str, float], dict[str, float]]:
    """Least and largest values that are looked at."""
    pixel = settings.pixel_um
    low = {"sigma_um": 0.1 * pixel, "growth_um": -2.0 * pixel, "shrinkage_percent": -19.0, "shrinkage_z_percent": -19.0}
    high = {"sigma_um": 20.0 * pixel, "growth_um": 15.0 * pixel, "shrinkage_percent": 19.0, "shrinkage_z_percent": 19.0}
    return low, high


def _process(
    problem: _Problem, settings: Settings, covariance: FloatArray, u_of_Ec: float, name: str, simulated: bool
) -> Process:
    """Process file of what was found."""
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


def _unknown(fit: PrinterCalibration) -> list[str]:
    return [
        f"these coupons do not determine {number.key}: it stays {number.value:.3g} ± {number.u:.2g}, as assumed before"
        for number in fit.numbers
        if number.learned < LEARNED
    ]


def _inseparable(fit: PrinterCalibration) -> list[str]:
    """What changes coupons alike."""
    warnings = [
        "washing, critical dose, exposure and scattering move edges alike and cannot be separated here: Ec_mJ_per_cm2 "
        f"is an effective one, for edges at wash_um = {fit.settings.wash_um:g} and not for depths; what is known is "
        "the growth of walls, and it is kept"
    ]
    for i, j in combinations(range(len(fit.numbers)), 2):
        correlation = float(fit.correlation[i, j])
        if abs(correlation) > INSEPARABLE:
            warnings.append(
                f"{fit.numbers[i].key} and {fit.numbers[j].key} can hardly be separated (correlation "
                f"{correlation:+.2f}): measure features of more different sizes"
            )
    return warnings


def _of_fit(fit: PrinterCalibration) -> list[str]:
    warnings = []
    if fit.scale > _DOUBT:
        warnings.append(
            f"features are off by {fit.scale:.2g} times their stated uncertainty (rms {fit.rms_um:.2g} µm): the model "
            "does not describe them, or they are less certain than stated; uncertainties were widened by that"
        )
    if fit.disagree:
        listed = ", ".join(f"{feature.kind} of {feature.nominal_mm:g} mm" for feature in fit.disagree[:6])
        more = "" if len(fit.disagree) <= 6 else f" and {len(fit.disagree) - 6} more"
        warnings.append(f"the model and the coupons disagree on which of these are resolved: {listed}{more}")
    return warnings
