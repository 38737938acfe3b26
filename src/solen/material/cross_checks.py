"""Compare results for a resin that determine the same quantity in two ways.

A layer's k and a cut-back measure the same loss; R and T of a layer and a refractometer measure the same index; an
absorbance and a working curve give the same penetration depth. If two results differ by more than their uncertainties
explain, one of them is wrong, and the resin made from them carries a warning.

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

SURE = 3.0
"""Two results are reported as different if they differ by more than this number of standard uncertainties."""
NEAR_NM = 20.0
"""A measured k is used for a wavelength at most this far away, in nm."""
DEFINITIONS = 0.2
"""Relative difference tolerated between two penetration depths, because their definitions differ."""
NM_PER_MM = 1e6
_DB_PER_CM = 100.0 / math.log(10.0)  # loss in dB/cm at an absorption of 1 per mm

Row = tuple[float, float | None, float | None, float | None]
"""Wavelength in nm, k, its standard uncertainty and its upper 95 % bound; None marks an unknown value."""


def loss_disagreement(rows: Sequence[Row], loss: Loss) -> list[Caution]:
    """Compare the loss that a layer's k implies with the loss measured in guides."""
    if not rows or loss.u_absorption_per_mm is None:
        return []
    nm = loss.wavelength_nm
    if nm is None:
        return [warning("the cut-back specifies no wavelength, so the layer's k is not compared with it")]
    near = [row for row in rows if abs(row[0] - nm) <= NEAR_NM]
    guide, u_guide = (_DB_PER_CM * value for value in (loss.absorption_per_mm, loss.u_absorption_per_mm))
    measured = f"the cut-back gives {guide:.2g} ± {u_guide:.1g} dB/cm at {nm:g} nm"
    known = np.array([_levels(row) for row in near if row[1] is not None])
    if known.size:
        layer, u_layer = (float(value) for value in known.mean(axis=0))
        if abs(layer - guide) <= SURE * math.hypot(u_layer, u_guide):
            return []
        return [
            warning(
                f"{measured}, whereas the layer's k gives {layer:.2g} ± {u_layer:.1g} dB/cm: the "
                "two disagree, and the cut-back is used; scattering in the layer, a baseline error "
                "and fringes all resemble k"
            )
        ]
    bounds = [4.0 * math.pi * row[3] / row[0] * NM_PER_MM * _DB_PER_CM for row in near if row[3] is not None]
    if not bounds or guide - SURE * u_guide <= min(bounds):
        return []
    return [
        warning(
            f"{measured}, which is above the upper bound from the layer's spectra, {min(bounds):.2g} "
            "dB/cm: the two disagree"
        )
    ]


def _levels(row: Row) -> tuple[float, float]:
    """Return the loss in dB/cm and its standard uncertainty for a row with a known k."""
    per_k = 4.0 * math.pi / row[0] * NM_PER_MM * _DB_PER_CM
    return per_k * (row[1] or 0.0), per_k * (row[2] or 0.0)


def index_disagreement(index: Dispersion, other: Dispersion, at_nm: Sequence[float]) -> list[Caution]:
    """Compare two indices at the wavelengths that both cover; a warning names the worst disagreement."""
    low, high = (end(one.range_nm[i] for one in (index, other)) for i, end in ((0, max), (1, min)))
    inside = [nm for nm in at_nm if low <= nm <= high]
    if not inside:
        return []
    (n, u_n), (m, u_m) = index.along(inside), other.along(inside)
    off = np.abs(n - m) / np.hypot(u_n, u_m)
    if not np.isfinite(off).any() or not np.nanmax(off) > SURE:
        return []
    i = int(np.nanargmax(off))
    return [
        warning(
            f"n({inside[i]:g} nm) is {_pm(n[i], u_n[i])} from the spectra and {_pm(m[i], u_m[i])} from the "
            f"refractometer, {off[i]:.1f} standard uncertainties apart: one of them is wrong"
        )
    ]


def _pm(value: FloatArray, u: FloatArray) -> str:
    return f"{float(value):.4f} ± {float(u):.1g}"


def penetration_disagreement(cure: Cure, Dp_um: float, u_Dp_um: float | None) -> list[Caution]:
    """Compare the penetration depths of a working curve and of an absorbance."""
    u_curve = math.sqrt(cure.covariance[0][0]) if cure.covariance else 0.0
    u = math.hypot(u_curve, u_Dp_um or 0.0)
    if abs(cure.Dp_um - Dp_um) <= max(SURE * u, DEFINITIONS * cure.Dp_um):
        return []
    return [
        warning(
            f"Dp is {cure.Dp_um:.3g} µm from the working curve and {Dp_um:.3g} µm from the absorbance: check the path "
            "length of the cell, the lamp's spectrum and the irradiance; bleaching and oxygen cause smaller differences"
        )
    ]
