"""Warnings about a hyperelastic fit; `cautions` returns them."""

import numpy as np

from solen.material.stiffness.hyperelastic import Fit
from solen.material.stiffness.modes import MODES
from solen.ranks import Caution, do_not_use, note, warning

_MAX_RMS = 0.1  # largest relative RMS deviation that causes no warning


def cautions(fit: Fit) -> list[Caution]:
    """Return warnings: range of validity, modes not measured, instability, parameters not determined, misfit."""
    warnings = [
        _range_note(fit),
        _mode_warning(fit),
        *_stability_warnings(fit),
        _parameter_warning(fit),
        *_misfit_warnings(fit),
    ]
    return [caution for caution in warnings if caution]


def _range_note(fit: Fit) -> Caution:
    ranges = "; ".join(f"{q.mode} {q.stretch_range[0]:.3g} to {q.stretch_range[1]:.3g}" for q in fit.quality)
    return note(f"{fit.model.kind} is valid over the fitted range of stretches ({ranges}) and extrapolates outside it")


def _mode_warning(fit: Fit) -> Caution | None:
    missing = [name for name in MODES if name not in {q.mode for q in fit.quality}]
    if not missing or len(fit.values) == 1:
        return None
    return warning(
        f"no {' or '.join(missing)} test was fitted: models that agree for the fitted tests may differ in "
        f"{'this mode' if len(missing) == 1 else 'these modes'}"
    )


def _stability_warnings(fit: Fit) -> list[Caution]:
    measured = {q.mode: q.stretch_range for q in fit.quality}
    whole_range = (min(low for low, _ in measured.values()), max(high for _, high in measured.values()))
    warnings = []
    for name, stable in fit.stable.items():
        low, high = measured.get(name, whole_range)
        if stable.covers(low, high):
            continue
        place = "within the range of its data" if name in measured else "within the stretch range of the other modes"
        limits = [f"below {stable.low:.4g}"] if stable.low is not None and stable.low > low else []
        limits += [f"above {stable.high:.4g}"] if stable.high is not None and stable.high < high else []
        warnings.append(
            do_not_use(f"{fit.model.kind} is unstable (Drucker) {place}: for {name} stretches {' and '.join(limits)}")
        )
    return warnings


def _parameter_warning(fit: Fit) -> Caution | None:
    if fit.scatter.covariance is None:
        return warning(
            f"the parameters of {fit.model.kind} cannot be determined separately from these tests and have no "
            "uncertainty; use a model with fewer parameters"
        )
    u_values = np.sqrt(np.diag(fit.scatter.covariance))
    undetermined = [name for name, p, u in zip(fit.model.names, fit.values, u_values, strict=True) if u > abs(p)]
    if not undetermined:
        return None
    return warning(
        f"{', '.join(undetermined)} of {fit.model.kind}: the uncertainty exceeds the value; use a model with fewer "
        "parameters"
    )


def _misfit_warnings(fit: Fit) -> list[Caution]:
    return [
        warning(
            f"{fit.model.kind} deviates from the {q.mode} stresses by {100 * q.rms_relative:.0f} % RMS "
            f"({q.rms_MPa:.2g} MPa)"
        )
        for q in fit.quality
        if q.rms_relative > _MAX_RMS
    ]
