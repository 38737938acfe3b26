"""Growth of straight edges, and the critical dose that causes it.

Seen from above, the width of a part is its width on the window side of a layer deep inside the part, where all layers
are equivalent. Coupons best determine the growth of a long straight wall beyond its image there; it depends on blur,
scattering, critical dose, exposure and washing. A calibrated process therefore keeps this growth: when another
parameter is varied within its uncertainty, the critical dose is adjusted to give the measured growth.
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

_HALOS = 4  # groups of scattered light
_WIDE = 8.0  # widths of a blur beyond which it adds nothing

Light = tuple[FloatArray, FloatArray]
"""Doses in mJ/cm² and blurs in µm of the light that arrives on the window side of a layer deep inside the part."""


def layers_inside(settings: Settings) -> int:
    """Return the number of layers beyond which further layers have no effect."""
    return math.ceil(25.0 * settings.deep_Dp_um / settings.layer_um) + 1


def inside(settings: Settings) -> Light:
    """Return the light on the window side of a layer deep inside the part; scattered light is grouped by width."""
    return _of_edges(*_terms(settings), settings)


@lru_cache(maxsize=64)
def _terms(settings: Settings) -> Light:
    even = settings.model_copy(update={"burn_in_layers": 0})
    terms = terms_at(even, layers_inside(settings), settings.layer_um * (1.0 - 1e-9))
    half = len(terms.dose) // 2
    narrow, halo, width = terms.dose[:half].sum(), terms.dose[half:], terms.sigma_um[half:]
    groups = [(narrow, settings.blur_um)]
    for part in np.array_split(np.arange(half), min(_HALOS, half)) if halo.sum() > 0.0 else []:
        weight = halo[part].sum()
        groups.append((weight, math.sqrt(float(halo[part] @ width[part] ** 2) / weight)))
    doses, blurs = zip(*groups, strict=True)
    return np.array(doses), np.array(blurs)


def growth_um(settings: Settings) -> float:
    """Growth of a long straight wall beyond its image, deep inside the part, with washing but without shrinkage.

    Raises
    ------
    DataError
        If the dose sets no resin.
    """
    return _edge_um(*inside(settings), settings, "deep inside the part") + settings.wash_um


def straight_edge_um(settings: Settings, layers: int, height_um: float) -> float:
    """Return the growth of a long straight wall beyond its image at a height, in µm; negative if the wall recedes.

    The growth is averaged over wall positions between pixels (see `Settings.edge_um`).

    Raises
    ------
    DataError
        If the dose sets no resin at that height.
    """
    terms = terms_at(settings, layers, height_um)
    return _edge_um(*_of_edges(terms.dose, terms.sigma_um, settings), settings, f"at a height of {height_um:g} µm")


def uneven_um(settings: Settings) -> tuple[float, float]:
    """Minimum and maximum growth of straight walls deep inside a part over the four directions that they face."""
    pixel = settings.pixel_light
    if not isinstance(pixel, MeasuredPixel):
        return (growth_um(settings),) * 2
    dose, sigma = _terms(settings)
    grown = []
    for axis, sign in ((0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)):
        weights, places, width = pixel.towards(axis, sign)
        blur = np.sqrt(np.maximum(sigma**2 - pixel.blur_um**2, 0.0) + width**2 + settings.covered_um**2)
        light = np.outer(dose, weights).ravel(), np.repeat(blur, len(places)), np.tile(places, len(dose))
        grown.append(_edge_um(light[0], light[1], settings, "deep inside the part", light[2]) + settings.wash_um)
    return min(grown), max(grown)


def _of_edges(dose: FloatArray, sigma: FloatArray, settings: Settings) -> Light:
    """Return doses and blurs of an edge from terms (T,): pixel light, any wider blur, and covered fractions."""
    weights, widths = settings.pixel_light.mixture
    beyond = np.maximum(sigma**2 - settings.blur_um**2, 0.0) + settings.covered_um**2
    return np.outer(dose, weights).ravel(), np.sqrt(beyond[:, None] + widths**2).ravel()


def _edge_um(
    dose: FloatArray, blur: FloatArray, settings: Settings, where: str, beside: FloatArray | float = 0.0
) -> float:
    """Distance x from a straight edge's image with Σ E Φ((b - x)/σ) = Ec, for light offset by b (``beside``)."""
    if float(dose.sum()) <= settings.Ec_mJ_per_cm2:
        limit = (
            f"the dose {where} is {dose.sum():.3g} mJ/cm2, while the resin sets at {settings.Ec_mJ_per_cm2:g} mJ/cm2"
        )
        raise DataError("process.exposure_s", value=settings.exposure_s, limit=limit, remedy="expose for longer")
    reach = _WIDE * float(blur.max()) + float(np.abs(beside).max())
    excess = brentq(
        lambda x: float(dose @ ndtr((beside - x) / blur)) - settings.Ec_mJ_per_cm2, -reach, reach, xtol=1e-9
    )
    return float(excess) + settings.grey_shift_um


def with_growth(settings: Settings, growth: float) -> Settings:
    """Return settings with the critical dose that gives a specified growth of walls."""
    dose, blur = inside(settings)
    critical = float(dose @ ndtr(-(growth - settings.wash_um - settings.grey_shift_um) / blur))
    return settings.model_copy(update={"Ec_mJ_per_cm2": critical})
