"""Warnings about a hyperelastic fit, in sentences with numbers; `cautions` returns them."""

import numpy as np

from solen.material.stiffness.hyperelastic import Fit
from solen.material.stiffness.modes import MODES
from solen.ranks import Caution, do_not_use, note, warning

_POOR = 0.1


def cautions(fit: Fit) -> list[Caution]:
    """Return warnings: range of validity, modes not measured, instability, parameters not determined, misfit."""
    warnings = [_range(fit), _unmeasured(fit), *_unstable(fit), _undetermined(fit), *_misfit(fit)]
    return [each for each in warnings if each]


def _range(fit: Fit) -> Caution:
    ranges = "; ".join(f"{q.mode} {q.stretch_range[0]:.3g} to {q.stretch_range[1]:.3g}" for q in fit.quality)
    return note(f"{fit.model.kind} is valid over the fitted stretch range ({ranges}) and extrapolates beyond it")


def _unmeasured(fit: Fit) -> Caution | None:
    missing = [name for name in MODES if name not in {q.mode for q in fit.quality}]
    if not missing or len(fit.values) == 1:
        return None
    return warning(
        f"{' and '.join(missing)} deformation was not measured: models that agree on these data may differ there"
    )


def _unstable(fit: Fit) -> list[Caution]:
    measured = {q.mode: q.stretch_range for q in fit.quality}
    everywhere = (min(low for low, _ in measured.values()), max(high for _, high in measured.values()))
    warnings = []
    for name, stable in fit.stable.items():
        low, high = measured.get(name, everywhere)
        if stable.covers(low, high):
            continue
        where = "in its data" if name in measured else "within the stretch ranges of the other modes"
        ends = [f"below {stable.low:.4g}"] if stable.low is not None and stable.low > low else []
        ends += [f"above {stable.high:.4g}"] if stable.high is not None and stable.high < high else []
        warnings.append(
            do_not_use(f"{fit.model.kind} is unstable (Drucker) {where}: {name} stretch {' and '.join(ends)}")
        )
    return warnings


def _undetermined(fit: Fit) -> Caution | None:
    if fit.scatter.covariance is None:
        return warning(
            f"the parameters of {fit.model.kind} cannot be determined individually: their covariance does not exist"
        )
    spread = np.sqrt(np.diag(fit.scatter.covariance))
    loose = [n for n, p, u in zip(fit.model.names, fit.values, spread, strict=True) if u > abs(p)]
    if not loose:
        return None
    names = ", ".join(loose)
    return warning(f"{names} of {fit.model.kind}: the uncertainty exceeds the value; use a model with fewer parameters")


def _misfit(fit: Fit) -> list[Caution]:
    return [
        warning(
            f"{fit.model.kind} deviates from the {q.mode} stresses by {100 * q.rms_relative:.0f} % in root mean square "
            f"({q.rms_MPa:.2g} MPa)"
        )
        for q in fit.quality
        if q.rms_relative > _POOR
    ]
