"""What a hyperelastic fit cannot say, in sentences with numbers.

The interface: `cautions` of a fit.
"""

import numpy as np

from solen.material.stiffness.hyperelastic import Fit
from solen.material.stiffness.modes import MODES

_POOR = 0.1


def cautions(found: Fit) -> list[str]:
    """Sentences: range of validity, modes not measured, instability, parameters not determined, misfit."""
    told = [_range(found), _unmeasured(found), *_unstable(found), _undetermined(found), *_misfit(found)]
    return [each for each in told if each]


def _range(found: Fit) -> str:
    ranges = "; ".join(f"{q.mode} {q.stretch_range[0]:.3g} to {q.stretch_range[1]:.3g}" for q in found.quality)
    return f"{found.model.kind} holds over the stretches it was fitted to ({ranges}); beyond, it extrapolates"


def _unmeasured(found: Fit) -> str:
    missing = [name for name in MODES if name not in {q.mode for q in found.quality}]
    if not missing or len(found.values) == 1:
        return ""
    told = " and ".join(missing)
    return f"{told} deformation was not measured: models that agree on these data may differ there"


def _unstable(found: Fit) -> list[str]:
    measured = {q.mode: q.stretch_range for q in found.quality}
    everywhere = (min(low for low, _ in measured.values()), max(high for _, high in measured.values()))
    told = []
    for name, stable in found.stable.items():
        low, high = measured.get(name, everywhere)
        if stable.covers(low, high):
            continue
        where = "in its data" if name in measured else "within the stretches of the other modes"
        ends = [f"below {stable.low:.4g}"] if stable.low is not None and stable.low > low else []
        ends += [f"above {stable.high:.4g}"] if stable.high is not None and stable.high < high else []
        told.append(f"{found.model.kind} is unstable (Drucker) {where}: {name} stretch {' and '.join(ends)}")
    return told


def _undetermined(found: Fit) -> str:
    if found.scatter.covariance is None:
        return f"the parameters of {found.model.kind} are not determined one by one: their covariance does not exist"
    spread = np.sqrt(np.diag(found.scatter.covariance))
    loose = [n for n, p, u in zip(found.model.names, found.values, spread, strict=True) if u > abs(p)]
    if not loose:
        return ""
    names = ", ".join(loose)
    return f"{names} of {found.model.kind}: uncertainty beyond the value itself; fewer parameters would do"


def _misfit(found: Fit) -> list[str]:
    return [
        f"{found.model.kind} misses the {q.mode} stresses by {100 * q.rms_relative:.0f} % in root mean square "
        f"({q.rms_MPa:.2g} MPa)"
        for q in found.quality
        if q.rms_relative > _POOR
    ]
