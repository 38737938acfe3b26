"""Coupons of fidelity as the model prints them: pillars, holes, gaps between pillars, steps.

The idea: seen from above, a feature is as wide as it is where it is widest: on the window side of a layer far inside. A
round image blurred by a Gaussian is a one-dimensional integral, so a coupon is printed without any image, its place
between pixels averaged over (`Settings.edge_um`). A pillar is not there where even its middle is short of the critical
dose; a hole is closed and a gap merged where their middle gets it.

The interface: `Feature` as measured; `printed_mm` of some of them under some settings.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
from scipy.optimize import elementwise
from scipy.special import i0e

from solen.arrays import FloatArray
from solen.fabricate.process.growth import Light, inside
from solen.fabricate.process.settings import Settings

Kind = Literal["pillar", "hole", "gap", "step"]
KINDS: tuple[Kind, ...] = get_args(Kind)
GAP_PILLAR_MM = 0.3
"""Diameter of the pillars that a gap is between where the file does not say: that of the published group B."""
_WIDE = 6.5  # widths of a blur beyond which it adds nothing
_NODES = 28
_EXACT: Any = {"xatol": 1e-7, "xrtol": 0.0, "fatol": 0.0, "frtol": 0.0}  # of an edge, in µm


@dataclass(frozen=True)
class Feature:
    """One feature of a coupon.

    Attributes
    ----------
    kind
        Pillar or hole (their diameter), gap (between the edges of two pillars) or step (a height).
    nominal_mm
        As drawn.
    measured_mm, u_mm
        As found and its standard uncertainty; None where it is not there.
    resolved
        Whether the pillar stands, the hole and the gap are open, the step is seen.
    diameter_mm
        Of the pillars beside a gap.
    where
        How an error names it.
    """

    kind: Kind
    nominal_mm: float
    measured_mm: float | None
    u_mm: float | None
    resolved: bool
    diameter_mm: float = GAP_PILLAR_MM
    where: str = ""


def printed_mm(settings: Settings, features: Sequence[Feature]) -> FloatArray:
    """Sizes (n,) in mm that features are printed in; NaN for what is not there or is closed."""
    found = np.full(len(features), np.nan)
    light = inside(settings)
    smaller, wash = 1.0 - 0.01 * settings.shrinkage_percent, 2.0 * settings.wash_um
    for kind, solve, sign in (("pillar", _pillars, 1.0), ("hole", _holes, -1.0), ("gap", _gaps, -1.0)):
        at = [i for i, feature in enumerate(features) if feature.kind == kind]
        if at:
            nominal = np.array([1e3 * features[i].nominal_mm for i in at])
            beside = np.array([1e3 * features[i].diameter_mm for i in at])
            found[at] = 1e-3 * (smaller * solve(nominal, beside, light, settings.Ec_mJ_per_cm2) + sign * wash)
    for i, feature in enumerate(features):
        if feature.kind == "step":
            layers = round(1e3 * feature.nominal_mm / settings.layer_um)
            height = 1e-3 * layers * settings.layer_um * (1.0 - 0.01 * settings.shrinkage_z_percent)
            found[i] = height if layers else np.nan
    return np.where(found > 0.0, found, np.nan)


def disc(r_um: FloatArray, radius_um: FloatArray, sigma_um: float) -> FloatArray:
    """Evenly lit disc blurred by a Gaussian, at distances (n,) from its middle.

    ∫ exp(-(r - ρ)²/2σ²) e^(-rρ/σ²) I₀(rρ/σ²) ρ dρ/σ² over the disc, by Gauss and Legendre within 6.5 σ of r; in the
    middle 1 - exp(-R²/2σ²).
    """
    nodes, weights = _quadrature()
    low = np.maximum(r_um - _WIDE * sigma_um, 0.0)
    high = np.maximum(np.minimum(r_um + _WIDE * sigma_um, radius_um), low)
    half = 0.5 * (high - low)
    rho = (low + half)[:, None] + half[:, None] * nodes
    r = r_um[:, None]
    density = np.exp(-0.5 * ((r - rho) / sigma_um) ** 2) * i0e(r * rho / sigma_um**2) * rho / sigma_um**2
    return np.asarray(half * (density @ weights))


@lru_cache(maxsize=1)
def _quadrature() -> tuple[FloatArray, FloatArray]:
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    return nodes, weights


def _dose(r_um: FloatArray, radius_um: FloatArray, light: Light) -> FloatArray:
    """Dose at distances from the middle of discs that are lit."""
    found = np.zeros_like(r_um)
    for dose, sigma in zip(*light, strict=True):
        found += dose * disc(r_um, radius_um, float(sigma))
    return found


def _pillars(diameter: FloatArray, _beside: FloatArray, light: Light, critical: float) -> FloatArray:
    radius = 0.5 * diameter

    def excess(r: FloatArray, radius: FloatArray) -> FloatArray:
        return _dose(r, radius, light) - critical

    return 2.0 * _edge(excess, radius + _WIDE * float(light[1].max()), radius)


def _holes(diameter: FloatArray, _beside: FloatArray, light: Light, critical: float) -> FloatArray:
    radius, whole = 0.5 * diameter, float(light[0].sum())

    def short(r: FloatArray, radius: FloatArray) -> FloatArray:
        return critical - (whole - _dose(r, radius, light))

    return 2.0 * _edge(short, radius + _WIDE * float(light[1].max()), radius)


def _gaps(gap: FloatArray, beside: FloatArray, light: Light, critical: float) -> FloatArray:
    radius, centre = 0.5 * beside, 0.5 * (beside + gap)

    def short(x: FloatArray, radius: FloatArray, centre: FloatArray) -> FloatArray:
        return critical - _dose(np.abs(centre - x), radius, light) - _dose(centre + x, radius, light)

    return 2.0 * _edge(short, centre, radius, centre)


def _edge(excess: Callable[..., FloatArray], far: FloatArray, *of: FloatArray) -> FloatArray:
    """Where functions of a distance fall from above 0 in the middle to below it far out; NaN where one does not."""
    near = np.zeros_like(far)
    has = (excess(near, *of) > 0.0) & (excess(far, *of) < 0.0)
    found = np.full(len(far), np.nan)
    if has.any():
        ends = (near[has], far[has])
        root = elementwise.find_root(excess, ends, args=tuple(one[has] for one in of), tolerances=_EXACT)
        found[has] = root.x
    return found
