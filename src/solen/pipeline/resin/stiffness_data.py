"""Stiffness as plain data: what `solen.pipeline.resin.stiffness` puts into its result and its table."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from solen.arrays import FloatArray
from solen.material import stiffness as physics

_SHOWN = 400  # points of a curve in the result


def specimen_data(name: str, file: str, ours: physics.Evaluated) -> dict[str, Any]:
    """One specimen."""
    test = ours.test
    young = ours.young
    return {
        "name": name,
        "file": file,
        "mode": test.mode.name,
        "loading": test.loading,
        "modulus_MPa": young.modulus_MPa,
        "u_modulus_MPa": young.u_modulus_MPa,
        "u_scatter_MPa": young.u_scatter_MPa,
        "u_dimensions_MPa": young.u_dimensions_MPa,
        "interval95_MPa": list(young.interval95_MPa),
        "strain_range": list(young.strain_range),
        "points": young.points,
        "effective_points": young.effective_points,
        "lag_one": young.lag_one,
        "r_squared": young.r_squared,
        "residual_MPa": young.residual_MPa,
        "secants": [{"strain": at, "secant_MPa": value} for at, value in ours.secants_MPa],
        "strength_MPa": ours.extremes.strength_MPa,
        "strain_at_strength": ours.extremes.strain_at_strength,
        "strain_at_break": ours.extremes.strain_at_break,
        "stress_at_break_MPa": ours.extremes.stress_at_break_MPa,
        "toe": {"shift": ours.toe.shift, "u_shift": ours.toe.u_shift, "end": ours.toe.end, "said": ours.toe.said},
        "dimensions": {
            "length_mm": test.specimen.length_mm,
            "area_mm2": test.specimen.area_mm2,
            "shape_factor": test.specimen.shape_factor,
            "source": test.specimen.source,
        },
        "made_from": test.made_from,
        "notes": list(test.notes),
        "cycles": [_cycle(each) for each in ours.cycles],
        "softening": None if ours.softening is None else vars(ours.softening),
        "fitted": {"stretch": _listed(ours.curve.stretch), "stress_MPa": _listed(ours.curve.stress_MPa)},
        "curve": _curve(test),
    }


def _cycle(found: physics.Cycle) -> dict[str, Any]:
    return {key: value for key, value in vars(found).items() if key not in {"start", "peak", "end"}} | {
        "dissipated_mJ_per_mm3": found.dissipated_mJ_per_mm3,
        "loss_fraction": found.loss_fraction,
    }


def _listed(values: FloatArray) -> list[float]:
    return [float(value) for value in values]


def _curve(test: physics.StressStrain) -> dict[str, list[float]]:
    """Every point, or four hundred evenly chosen ones."""
    rows = np.unique(np.linspace(0, len(test.strain) - 1, min(_SHOWN, len(test.strain))).round().astype(int))
    columns = {
        "strain": test.strain,
        "stress_MPa": test.stress_MPa,
        "true_strain": test.true_strain,
        "true_stress_MPa": test.true_stress_MPa,
    }
    return {name: _listed(values[rows]) for name, values in columns.items()}


def fit_data(found: physics.Fit, fits: Sequence[physics.Fit]) -> dict[str, Any]:
    """One model; its AICc beside the lowest of all."""
    judged = [each.aicc for each in fits if each.aicc is not None]
    covariance = found.scatter.covariance
    spread = None if covariance is None else np.sqrt(np.diag(covariance))
    return {
        "kind": found.model.kind,
        "parameters": dict(zip(found.model.names, map(float, found.parameters), strict=True)),
        "u_parameters": None if spread is None else dict(zip(found.model.names, map(float, spread), strict=True)),
        "covariance": None if covariance is None else [[float(value) for value in row] for row in covariance],
        "stable_over": {name: [stable.low, stable.high] for name, stable in found.stable.items()},
        "stable_in_data": found.stable_in_data,
        "aicc": found.aicc,
        "delta_aicc": None if found.aicc is None else found.aicc - min(judged),
        "initial_modulus_MPa": found.initial_modulus_MPa,
        "u_initial_modulus_MPa": found.u_initial_modulus_MPa,
        "weighting": found.weighting,
        "effective_points": found.scatter.effective_points,
        "lag_one": found.scatter.lag_one,
        "modes": [vars(quality) | {"stretch_range": list(quality.stretch_range)} for quality in found.quality],
    }


def table(specimens: Iterable[tuple[str, str, physics.StressStrain]]) -> str:
    """Stress and strain of specimens, each with its name and material, as CSV."""
    lines = ["specimen,material,strain,stress_MPa,true_strain,true_stress_MPa"]
    for name, label, test in specimens:
        names = ",".join('"' + text.replace('"', "'") + '"' for text in (name, label))
        columns = zip(test.strain, test.stress_MPa, test.true_strain, test.true_stress_MPa, strict=True)
        lines += [f"{names},{a:.9g},{b:.9g},{c:.9g},{d:.9g}" for a, b, c, d in columns]
    return "\n".join(lines) + "\n"
