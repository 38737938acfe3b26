"""Comparison of two independent measurements of the same quantity of a resin.

The k of a layer and a cut-back give the same loss; R and T of a layer and a refractometer give the same index; an
absorbance and a working curve give the same penetration depth. If two results differ by more than their uncertainties
explain, one of them is wrong, and the resin that is built from them gets a warning.

`loss_disagreement`, `index_disagreement` and `penetration_disagreement` return warnings, or an empty list if the two
results agree or cannot be compared.
"""

import math
from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.material.dispersion import Dispersion
from solen.material.resin import Cure, Loss
from solen.ranks import Caution, warning

MAX_DIFFERENCE_U = 3.0
"""Largest difference between two results, in standard uncertainties, that causes no warning."""
MAX_DISTANCE_NM = 20.0
"""Largest difference in wavelength between a k and a loss that are compared."""
MAX_DP_DIFFERENCE = 0.2
"""Largest relative difference of two penetration depths that causes no warning: their definitions differ."""
NM_PER_MM = 1e6
_DB_PER_CM = 100.0 / math.log(10.0)  # loss in dB/cm at an absorption of 1 per mm

Row = tuple[float, float | None, float | None, float | None]
"""Wavelength in nm, k, and the standard uncertainty and upper 95 % bound of k; None if unknown."""


def loss_disagreement(rows: Sequence[Row], loss: Loss) -> list[Caution]:
    """Return a warning if a layer's k implies another loss than that of guides, or if their wavelength is unknown."""
    if not rows or loss.u_absorption_per_mm is None:
        return []
    nm = loss.wavelength_nm
    if nm is None:
        return [warning("the wavelength of the cut-back is not specified, so the layer's k is not compared with it")]
    near = [row for row in rows if abs(row[0] - nm) <= MAX_DISTANCE_NM]
    guide, u_guide = (_DB_PER_CM * value for value in (loss.absorption_per_mm, loss.u_absorption_per_mm))
    measured = f"the cut-back gives {guide:.2g} ± {u_guide:.1g} dB/cm at {nm:g} nm"
    known = np.array([_levels(row) for row in near if row[1] is not None])
    if known.size:
        layer, u_layer = (float(value) for value in known.mean(axis=0))
        if abs(layer - guide) <= MAX_DIFFERENCE_U * math.hypot(u_layer, u_guide):
            return []
        return [
            warning(
                f"{measured}, whereas the layer's k gives {layer:.2g} ± {u_layer:.1g} dB/cm: the two disagree, and the "
                "cut-back is used; scattering in the layer, a baseline error and fringes can all appear as k"
            )
        ]
    bounds = [4.0 * math.pi * row[3] / row[0] * NM_PER_MM * _DB_PER_CM for row in near if row[3] is not None]
    if not bounds or guide - MAX_DIFFERENCE_U * u_guide <= min(bounds):
        return []
    return [
        warning(
            f"{measured}, which is above the upper bound from the layer's spectra, {min(bounds):.2g} "
            "dB/cm: the two disagree"
        )
    ]


def _levels(row: Row) -> tuple[float, float]:
    """Return the loss in dB/cm and its standard uncertainty for a known k."""
    per_k = 4.0 * math.pi / row[0] * NM_PER_MM * _DB_PER_CM
    return per_k * (row[1] or 0.0), per_k * (row[2] or 0.0)


def index_disagreement(index: Dispersion, other: Dispersion, at_nm: Sequence[float]) -> list[Caution]:
    """Return a warning with the largest difference if two indices disagree at a wavelength that both cover."""
    (low, high), (other_low, other_high) = index.range_nm, other.range_nm
    common = [nm for nm in at_nm if max(low, other_low) <= nm <= min(high, other_high)]
    if not common:
        return []
    (n, u_n), (m, u_m) = index.indices(common), other.indices(common)
    difference_u = np.abs(n - m) / np.hypot(u_n, u_m)
    if not np.isfinite(difference_u).any() or not np.nanmax(difference_u) > MAX_DIFFERENCE_U:
        return []
    i = int(np.nanargmax(difference_u))
    return [
        warning(
            f"n({common[i]:g} nm) is {_plus_minus(n[i], u_n[i])} from the spectra and {_plus_minus(m[i], u_m[i])} from "
            f"the refractometer, {difference_u[i]:.1f} standard uncertainties apart: one of them is wrong"
        )
    ]


def _plus_minus(value: FloatArray, u: FloatArray) -> str:
    return f"{float(value):.4f} ± {float(u):.1g}"


def penetration_disagreement(cure: Cure, Dp_um: float, u_Dp_um: float | None) -> list[Caution]:
    """Return a warning if the penetration depths from a working curve and from an absorbance disagree."""
    u_curve = math.sqrt(cure.covariance[0][0]) if cure.covariance else 0.0
    u = math.hypot(u_curve, u_Dp_um or 0.0)
    if abs(cure.Dp_um - Dp_um) <= max(MAX_DIFFERENCE_U * u, MAX_DP_DIFFERENCE * cure.Dp_um):
        return []
    return [
        warning(
            f"Dp is {cure.Dp_um:.3g} µm from the working curve and {Dp_um:.3g} µm from the absorbance: check the path "
            "length of the cell, the lamp's spectrum and the irradiance; bleaching and oxygen cause smaller differences"
        )
    ]
