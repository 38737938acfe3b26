"""A process's numbers from measured coupons: the blur, the dose that sets an edge, the shrinkage.

The idea: least squares of printed sizes against measured ones, each weighed by its uncertainty. What the process was
taken to be before goes in as weak observations, three times as uncertain as it says, so that what coupons cannot tell
stays where it was, and is said. Large features tell how far an edge grows and how sizes scale; only features about as
small as the blur tell the blur from the critical dose; washing moves every edge as the critical dose does, and stays as
it was stated.

The critical dose that comes out is effective: with the blur it places edges where they were measured. A working curve's
is another number, and a better one for depths.

The interface: `calibrated` gives a `Fit`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.coupons import Feature, printed_mm
from solen.fabricate.process.growth import growth_um, with_growth
from solen.fabricate.process.settings import Calibration, Process, Settings

SOUGHT = ("sigma_um", "Ec_mJ_per_cm2", "shrinkage_percent")
WEAK = 3.0
"""How many times as uncertain the process of before is taken to be as it says."""
WIDEST_GROWTH = 10.0
"""Uncertainty of before of a wall's growth, in pixels: as good as none."""
WIDE: dict[str, float] = {
    "sigma_um": 10.0,
    "Ec_mJ_per_cm2": 5.0,
    "shrinkage_percent": 2.0,
    "shrinkage_z_percent": 2.0,
}
"""Uncertainty of before where a process states none."""
TOGETHER = 0.9
"""Correlation from which on two numbers cannot be told apart."""
TOLD = 0.5
"""Share of its variance of before that a number must lose to count as told by the coupons."""
LEAST = 3
_LOST_UM = 200.0  # residual of a feature that the model does not print, in µm
_DOUBT = 2.0


@dataclass(frozen=True, eq=False)
class Fit:
    """Process that was found, and how well it tells the coupons.

    Attributes
    ----------
    process
        The process, with its calibration.
    keys, value, u, u_before
        Numbers that were sought, what they are, and their uncertainty now and before, (p,) each; ``growth_um`` stands
        for the critical dose: how far a straight wall grows beyond its image.
    covariance
        Of the numbers, (p, p).
    Ec
        Effective critical dose in mJ/cm² and its uncertainty.
    features, printed_mm
        Features that were used, and what the model prints them as, (n,).
    chi2, df
        Sum of squared residuals over uncertainties, and features less numbers told.
    scale
        By what uncertainties were multiplied because features scatter more than they say; 1 where they do not.
    disagree
        Features that the model prints and that were not found, or the other way round.
    warnings
        What cannot be concluded.
    """

    process: Process
    keys: tuple[str, ...]
    value: FloatArray
    u: FloatArray
    u_before: FloatArray
    covariance: FloatArray
    Ec: tuple[float, float]
    features: tuple[Feature, ...]
    printed_mm: FloatArray
    chi2: float
    df: int
    scale: float
    disagree: tuple[Feature, ...]
    warnings: tuple[str, ...]

    @property
    def rms_um(self) -> float:
        """Root mean square of printed less measured sizes."""
        off = [
            1e3 * (size - (one.measured_mm or 0.0)) for size, one in zip(self.printed_mm, self.features, strict=True)
        ]
        return float(np.sqrt(np.nanmean(np.square(off))))


def calibrated(process: Process, features: Sequence[Feature], name: str, *, simulated: bool = False) -> Fit:
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

    Raises
    ------
    DataError
        For too few features with a size, or none that the model prints.
    """
    used = tuple(one for one in features if one.resolved and one.measured_mm is not None and one.u_mm is not None)
    lateral = sum(one.kind != "step" for one in used)
    if lateral < LEAST:
        limit = f"needs {LEAST} pillars, holes or gaps with a measured size at least"
        raise DataError("coupons", value=f"{lateral} of {len(features)} features", limit=limit)
    problem = _Problem(process, used, SOUGHT + (("shrinkage_z_percent",) if lateral < len(used) else ()))
    found = least_squares(
        problem.residuals,
        problem.start,
        bounds=problem.bounds,
        x_scale=problem.before,
        diff_step=np.full(len(problem.keys), 1e-4),
        xtol=1e-5,
        ftol=1e-7,
        max_nfev=50,
    )
    jacobian, count = np.asarray(found.jac), len(used)
    chi2 = float(np.sum(found.fun[:count] ** 2))
    told = 1.0 - np.diag(np.linalg.inv(jacobian.T @ jacobian)) / problem.before**2
    df = max(count - int(np.count_nonzero(told > TOLD)), 1)
    scale = max(1.0, math.sqrt(chi2 / df))
    # what features say counts for less by how much more they scatter; what was known before does not
    weight = np.concatenate([np.full(count, scale**-2), np.ones(len(problem.keys))])
    covariance = np.linalg.inv((jacobian * weight[:, None]).T @ jacobian)
    settings = problem.settings(found.x)
    u_of_Ec = problem.u_of_Ec(found.x, covariance)
    fit = Fit(
        process=_process(problem, settings, covariance, u_of_Ec, name, simulated),
        keys=problem.sought,
        value=np.asarray(found.x),
        u=np.sqrt(np.diag(covariance)),
        u_before=problem.before,
        covariance=covariance,
        Ec=(settings.Ec_mJ_per_cm2, u_of_Ec),
        features=used,
        printed_mm=printed_mm(settings, used),
        chi2=chi2,
        df=df,
        scale=scale,
        disagree=_disagreeing(settings, features),
        warnings=(),
    )
    return replace(fit, warnings=(*_untold(fit), *_together(fit, settings), *_of_fit(fit)))


class _Problem:
    """Least squares in numbers that coupons tell apart best: the growth of a straight wall for critical dose."""

    def __init__(self, process: Process, used: Sequence[Feature], keys: tuple[str, ...]) -> None:
        self.process, self.used, self.keys = process, used, keys
        self.sought = tuple("growth_um" if key == "Ec_mJ_per_cm2" else key for key in keys)
        self._measured = np.array([1e3 * (one.measured_mm or 0.0) for one in used])
        self._u = np.array([1e3 * (one.u_mm or 0.0) for one in used])
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


def _disagreeing(settings: Settings, features: Sequence[Feature]) -> tuple[Feature, ...]:
    there = ~np.isnan(printed_mm(settings, features))
    return tuple(one for one, is_there in zip(features, there.tolist(), strict=True) if is_there != one.resolved)


def _untold(fit: Fit) -> list[str]:
    told = 1.0 - (fit.u / fit.u_before) ** 2
    return [
        f"{key} is not told by these coupons: it stays {value:.3g} ± {u:.2g}, as was assumed before"
        for key, value, u, share in zip(fit.keys, fit.value, fit.u, told, strict=True)
        if share < TOLD
    ]


def _together(fit: Fit, settings: Settings) -> list[str]:
    """What coupons change alike."""
    found = [
        "washing, critical dose, exposure and scattering move edges alike and cannot be told apart here: "
        f"Ec_mJ_per_cm2 is an effective one, for edges beside wash_um = {settings.wash_um:g} and not for depths; "
        "what is known is the growth of walls, and it is kept"
    ]
    scale = fit.u
    for i, j in combinations(range(len(scale)), 2):
        correlation = float(fit.covariance[i, j] / (scale[i] * scale[j]))
        if abs(correlation) > TOGETHER:
            found.append(
                f"{fit.keys[i]} and {fit.keys[j]} cannot be told apart well (correlation {correlation:+.2f}): "
                "measure features of more different sizes"
            )
    return found


def _of_fit(fit: Fit) -> list[str]:
    found = []
    if fit.scale > _DOUBT:
        found.append(
            f"features are off by {fit.scale:.2g} times their stated uncertainty (rms {fit.rms_um:.2g} µm): the model "
            "does not describe them, or they are less certain than stated; uncertainties were widened by that"
        )
    if fit.disagree:
        listed = ", ".join(f"{one.kind} of {one.nominal_mm:g} mm" for one in fit.disagree[:6])
        more = "" if len(fit.disagree) <= 6 else f" and {len(fit.disagree) - 6} more"
        found.append(f"the model and the coupons disagree on which of these are resolved: {listed}{more}")
    return found
