"""Growth of straight edges, and the critical dose that causes it.

Seen from above, the width of a part is its width on the window side of a layer deep inside the part, where all layers
are equivalent. The *growth* of a wall is the distance of a long straight wall there from the edge of its image, which
coupons determine best. It depends on blur, scattering, critical dose, exposure and washing. A calibrated process
therefore keeps this growth: when another parameter is varied within its uncertainty, the critical dose is adjusted to
give the measured growth.
"""

import math
from functools import lru_cache

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.fabricate.process.response import MeasuredPixel
from solen.fabricate.process.settings import Settings
from solen.fabricate.process.terms import terms_at

_HALO_GROUPS = 4  # groups of scattered light with similar widths
_BLUR_WIDTHS = 8.0  # standard deviations at which a blur is cut off

Light = tuple[FloatArray, FloatArray]
"""Doses in mJ/cm² and blurs in µm (T,)."""


def layers_inside(settings: Settings) -> int:
    """Return the number of layers of a part so high that further layers would not change the light at its middle."""
    return math.ceil(25.0 * settings.deep_Dp_um / settings.layer_um) + 1


def inside_light(settings: Settings) -> Light:
    """Return the light on the window side of a layer deep inside the part, with scattered light in a few groups."""
    return _edge_light(*_terms(settings), settings)


@lru_cache(maxsize=64)
def _terms(settings: Settings) -> Light:
    uniform = settings.model_copy(update={"burn_in_layers": 0})
    terms = terms_at(uniform, layers_inside(settings), settings.layer_um * (1.0 - 1e-9))
    half = len(terms.dose) // 2
    sharp, halo, width = terms.dose[:half].sum(), terms.dose[half:], terms.sigma_um[half:]
    groups = [(sharp, settings.blur_um)]
    for part in np.array_split(np.arange(half), min(_HALO_GROUPS, half)) if halo.sum() > 0.0 else []:
        weight = halo[part].sum()
        groups.append((weight, math.sqrt(float(halo[part] @ width[part] ** 2) / weight)))
    doses, blurs = zip(*groups, strict=True)
    return np.array(doses), np.array(blurs)


def growth_um(settings: Settings) -> float:
    """Return the growth of a wall deep inside the part, with washing but without shrinkage.

    Raises
    ------
    DataError
        If the dose cures no resin.
    """
    return _edge_um(*inside_light(settings), settings, "deep inside the part") + settings.wash_um


def straight_edge_um(settings: Settings, layers: int, height_um: float) -> float:
    """Return the growth of a wall at a height, without washing; negative if the wall recedes.

    The growth is averaged over the position of the wall within a pixel (see `Settings.edge_um`).

    Raises
    ------
    DataError
        If the dose cures no resin at that height.
    """
    terms = terms_at(settings, layers, height_um)
    return _edge_um(*_edge_light(terms.dose, terms.sigma_um, settings), settings, f"at a height of {height_um:g} µm")


def growth_range_um(settings: Settings) -> tuple[float, float]:
    """Return the minimum and maximum growth of walls that face in different directions (along ±X and ±Y)."""
    pixel = settings.pixel_light
    if not isinstance(pixel, MeasuredPixel):
        return (growth_um(settings),) * 2
    dose, sigma = _terms(settings)
    growths = []
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        weights, positions, width = pixel.towards(axis, sign)
        blur = np.sqrt(np.maximum(sigma**2 - pixel.blur_um**2, 0.0) + width**2 + settings.covered_um**2)
        light = np.outer(dose, weights).ravel(), np.repeat(blur, len(positions)), np.tile(positions, len(dose))
        growths.append(_edge_um(light[0], light[1], settings, "deep inside the part", light[2]) + settings.wash_um)
    return min(growths), max(growths)


def _edge_light(dose: FloatArray, sigma: FloatArray, settings: Settings) -> Light:
    """Return doses and blurs of an edge from those of terms (T,), with the light of a pixel and pixel coverage."""
    weights, widths = settings.pixel_light.mixture
    additional = np.maximum(sigma**2 - settings.blur_um**2, 0.0) + settings.covered_um**2
    return np.outer(dose, weights).ravel(), np.sqrt(additional[:, None] + widths**2).ravel()


def _edge_um(
    dose: FloatArray, blur: FloatArray, settings: Settings, where: str, offset: FloatArray | float = 0.0
) -> float:
    """Return the distance x from the edge of an image at which Σ E Φ((b - x)/σ) = Ec; b is the offset of the light."""
    if float(dose.sum()) <= settings.Ec_mJ_per_cm2:
        critical = f"the critical dose of {settings.Ec_mJ_per_cm2:g} mJ/cm²"
        limit = f"gives {dose.sum():.3g} mJ/cm² {where}, not more than {critical}"
        raise DataError("process.exposure_s", value=settings.exposure_s, limit=limit, remedy="expose for longer")
    reach = _BLUR_WIDTHS * float(blur.max()) + float(np.abs(offset).max())
    edge = brentq(lambda x: float(dose @ ndtr((offset - x) / blur)) - settings.Ec_mJ_per_cm2, -reach, reach, xtol=1e-9)
    return float(edge) + settings.grey_shift_um


def with_growth(settings: Settings, growth: float) -> Settings:
    """Return settings with the critical dose that gives a specified growth of walls."""
    dose, blur = inside_light(settings)
    critical = float(dose @ ndtr(-(growth - settings.wash_um - settings.grey_shift_um) / blur))
    return settings.model_copy(update={"Ec_mJ_per_cm2": critical})
