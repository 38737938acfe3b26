"""All that a picture or a z map of a coupon shows: sizes with their uncertainties, what is resolved, and the limits."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.errors import DataError
from solen.geometry.coupons import Coupon, Feature
from solen.metrology.coupons.disc import LEAST_RADIUS_PX, Disc, fit_disc
from solen.metrology.coupons.gap import GapFit, fit_gap
from solen.metrology.coupons.heights import Height, height_of, steps_of
from solen.metrology.coupons.limits import OUTSIDE, Limit, Measured, hole_variation, smallest, z_step
from solen.metrology.pose import Placement, fitted, places
from solen.metrology.coupons.locate import Registration, register
from solen.metrology.coupons.slab import register_slab
from solen.metrology.scale import Scale

SNR = 6.0
"""Rise of a disc over its uncertainty, below which there is none."""
COVERAGE = 0.75
"""Share of its edge that must be there."""
RISE = 0.25
"""Rise relative to the usual one, below which a disc is a stain or a stump."""
UNSURE = 0.3
"""Uncertainty relative to the diameter, from which on a disc is not measured."""
FIRST_BLUR_PX = 2.0
EDGE = 5.0
"""How far an edge reaches, in blurs."""
AWAY_MM = 0.12
"""How far from its place a feature may stand."""
SURE_PX = 8.0
"""Radius from which on a disc tells the blur."""
CHANGED = 0.02
"""Relative: the print or the scale differs from the layout by more."""


@dataclass(frozen=True)
class Fidelity:
    """What was measured of a coupon.

    Attributes
    ----------
    measured
        Features, gaps and steps in the order of the layout.
    limits
        The smallest that are resolved.
    registration
        Where the coupon lies.
    discs
        Round features as they were found, by name.
    gaps
        Gaps as they were found, by name.
    heights
        Heights of columns by name, where there is a z map.
    blur_um
        Standard deviation of the picture's blur; None where it is not known.
    pitch_ratio, u_pitch_ratio
        Distances between features as printed, over those of the layout; None for fewer than three features.
    warnings
        What must be said.
    """

    measured: tuple[Measured, ...]
    limits: tuple[Limit, ...]
    registration: Registration
    discs: dict[str, Disc]
    gaps: dict[str, GapFit]
    heights: dict[str, Height]
    blur_um: float | None
    pitch_ratio: float | None
    u_pitch_ratio: float | None
    warnings: tuple[str, ...]


def measure(
    grey: FloatArray,
    scale: Scale,
    coupon: Coupon,
    *,
    z_mm: FloatArray | None = None,
    ceiling: float = math.inf,
    what: str = "picture",
) -> Fidelity:
    """Measure a coupon.

    Parameters
    ----------
    grey
        Shape (rows, columns): grey values, or for a z map its heights without gaps.
    scale
        Size of a pixel.
    coupon
        What was printed.
    z_mm
        Shape (rows, columns): heights in mm, NaN where there are none; None for a picture.
    ceiling
        Grey value at which the camera was saturated.
    what
        The picture, as errors name it.

    Raises
    ------
    DataError
        Where the coupon shows nothing that can be measured so, or is not found.
    """
    _check_kind(coupon, z_mm, what)
    px_per_mm = 1e3 / scale.um_per_px
    blocks = not any(one.round for one in coupon.features)
    if blocks and z_mm is not None:
        found = register_slab(z_mm, coupon, px_per_mm, what)
    else:
        found = register(grey, coupon, px_per_mm, what)
    discs, reasons, blur = ({}, {}, None) if blocks else _discs(grey, coupon, found, ceiling, heights=z_mm is not None)
    gaps = _gaps(grey, coupon, discs)
    heights = _heights(z_mm, coupon, found.placement)
    mm = 1e-3 * scale.um_per_px
    u_scale = (scale.u_um_per_px or 0.0) / scale.um_per_px
    measured = [_round(one, discs, reasons, mm, u_scale) for one in coupon.features if one.round]
    measured += [_gap(name, size, pair, gaps, discs, reasons, mm, u_scale) for name, size, pair in _listed(coupon)]
    measured += steps_of(coupon, heights) if z_mm is not None else []
    ratio, u_ratio = _pitch(coupon, discs, px_per_mm)
    return Fidelity(
        tuple(measured),
        limits_of(measured),
        found,
        discs,
        gaps,
        {name: one for name, one in heights.items() if isinstance(one, Height)},
        None if blur is None else blur * scale.um_per_px,
        ratio,
        u_ratio,
        tuple(_warnings(coupon, found, measured, scale, blur, ratio, z_mm)),
    )


def limits_of(measured: Sequence[Measured]) -> tuple[Limit, ...]:
    """Limits of all kinds that were measured."""
    by = {kind: [one for one in measured if one.kind == kind] for kind in ("pillar", "gap", "hole", "step")}
    sizes = {one.nominal_mm for one in by["pillar"]}
    found = [
        smallest("positive_diameter", by["pillar"]) if len(sizes) > 1 else None,
        smallest("gap", by["gap"]),
        smallest("hole", by["hole"]),
        hole_variation(by["hole"]),
        z_step(by["step"]),
    ]
    return tuple(one for one in found if one is not None)


def _check_kind(coupon: Coupon, z_mm: FloatArray | None, what: str) -> None:
    kinds = coupon.measured_kinds
    if not kinds:
        limit = f"coupon {coupon.name} has no features that a picture shows"
        raise DataError(what, limit=limit, remedy="measure group-a, group-b, group-c, holes or z-reference")
    if (
        z_mm is None
        and coupon.steps
        and not coupon.gaps
        and len({one.diameter_mm for one in coupon.of_kind("pillar")}) == 1
    ):
        limit = f"a {coupon.name} shows heights, which a picture does not"
        raise DataError(what, limit=limit, remedy="give a z map, with the height of one of its levels: --z-um")


def _discs(
    grey: FloatArray, coupon: Coupon, found: Registration, ceiling: float, *, heights: bool
) -> tuple[dict[str, Disc], dict[str, str], float]:
    """Round features that are there, and for the others the reason; the blur."""
    features = sorted((one for one in coupon.features if one.round), key=lambda one: -one.diameter_mm)
    fits: dict[str, Disc | None] = {}
    reasons: dict[str, str] = {}
    blur, known = FIRST_BLUR_PX, False
    for one in features:
        if not known and 0.5 * one.diameter_mm * found.placement.px_per_mm < SURE_PX and fits:
            blur, known = _blur(fits, blur), True
        place = found.placement.px(np.array([(one.x_mm, one.y_mm)]))[0]
        radius = 0.5 * one.diameter_mm * found.placement.px_per_mm
        if not _inside(place, radius + EDGE * blur, grey.shape):
            reasons[one.name] = OUTSIDE
            continue
        reach, blocked = _surroundings(coupon, one, found.placement, blur)
        fits[one.name] = fit_disc(
            grey, (float(place[0]), float(place[1])), radius, reach, bright=found.bright,
            blur_px=blur if known else None, blocked_rad=blocked, ceiling=ceiling,
        )  # fmt: skip
    blur = _blur(fits, blur)
    usual = _usual_rise(fits, coupon, heights=heights)
    discs = {}
    for one in features:
        if one.name in fits:
            fit = fits[one.name]
            why = _missing(one, fit, found.placement, usual * (one.height_mm if heights else 1.0))
            if fit is not None and not why:
                discs[one.name] = fit
            else:
                reasons[one.name] = why
    return discs, reasons, blur


def _inside(place: FloatArray, reach: float, shape: tuple[int, ...]) -> bool:
    return bool((place - reach > 0.0).all() and place[0] + reach < shape[1] - 1 and place[1] + reach < shape[0] - 1)


def _surroundings(coupon: Coupon, feature: Feature, placement: Placement, blur: float) -> tuple[float, list[float]]:
    """How far beyond a feature's edge nothing else lies, px, and the directions in which something is too near."""
    scale = placement.px_per_mm
    need = EDGE * blur + 3.0
    reach = max(0.4 * feature.diameter_mm * scale, need)
    blocked = []
    here = (feature.x_mm, feature.y_mm)
    for other in coupon.features:
        if other.name == feature.name:
            continue
        free = feature.distance_mm(other) * scale
        if free < 2.0 * need + 0.2 * feature.diameter_mm * scale:
            blocked.append(placement.direction_rad(here, (other.x_mm, other.y_mm)))
        else:
            reach = min(reach, 0.5 * free)
    if coupon.slab is not None:
        to_edge = (
            min(0.5 * coupon.slab.width_mm - abs(feature.x_mm), 0.5 * coupon.slab.depth_mm - abs(feature.y_mm))
            - 0.5 * feature.diameter_mm
        )
        reach = min(reach, max(to_edge * scale - EDGE * blur, need))
    return reach, blocked


def _blur(fits: dict[str, Disc | None], otherwise: float) -> float:
    some = [one.blur_px for one in fits.values() if one is not None and one.diameter_px > 2.0 * SURE_PX]
    return float(np.median(some)) if some else otherwise


def _usual_rise(fits: dict[str, Disc | None], coupon: Coupon, *, heights: bool) -> float:
    """Median rise of the larger half of the discs; of a z map the rise for each mm of nominal height."""
    some = []
    for name, one in list(fits.items())[: max(3, len(fits) // 2)]:
        if one is not None and one.snr > SNR:
            some.append(abs(one.rise) / (coupon.feature(name).height_mm if heights else 1.0))
    return float(np.median(some)) if some else 0.0


def _missing(feature: Feature, fit: Disc | None, placement: Placement, usual: float) -> str:
    """Why a round feature does not count as there; empty where it does."""
    if 0.5 * feature.diameter_mm * placement.px_per_mm < LEAST_RADIUS_PX:
        return TOO_SMALL
    if fit is None or fit.snr < SNR or abs(fit.rise) < RISE * usual:
        return "no edge"
    if fit.coverage < COVERAGE:
        return f"only {100 * fit.coverage:.0f} % of its edge"
    expected = placement.px(np.array([(feature.x_mm, feature.y_mm)]))[0]
    away = math.hypot(fit.x_px - expected[0], fit.y_px - expected[1]) / placement.px_per_mm
    if away > max(AWAY_MM, 0.25 * feature.diameter_mm):
        return f"{away:.2g} mm from its place"
    if fit.u_diameter_px > UNSURE * fit.diameter_px:
        return "its edge is not clear"
    return ""


TOO_SMALL = "too small for this picture"


def _gaps(grey: FloatArray, coupon: Coupon, discs: dict[str, Disc]) -> dict[str, GapFit]:
    found = {}
    for gap in coupon.gaps:
        left, right = (discs.get(name) for name in gap.between)
        if left is not None and right is not None and (fit := fit_gap(grey, left, right)) is not None:
            found[gap.name] = fit
    return found


def _heights(z_mm: FloatArray | None, coupon: Coupon, placement: Placement) -> dict[str, Height | str]:
    if z_mm is None:
        return {}
    columns = [one for one in coupon.features if one.kind in {"pillar", "mark"}]
    return {one.name: height_of(z_mm, coupon, one, placement) for one in columns}


def _round(one: Feature, discs: dict[str, Disc], reasons: dict[str, str], mm: float, u_scale: float) -> Measured:
    disc = discs.get(one.name)
    if disc is None:
        reason = reasons.get(one.name, "no edge")
        resolved = None if reason in {OUTSIDE, TOO_SMALL} else False
        return Measured(one.name, one.kind, one.diameter_mm, None, None, resolved, reason)
    size = disc.diameter_px * mm
    return Measured(one.name, one.kind, one.diameter_mm, size, _u(size, disc.u_diameter_px * mm, u_scale), True)


def _listed(coupon: Coupon) -> list[tuple[str, float, tuple[str, str]]]:
    return [(gap.name, gap.gap_mm, gap.between) for gap in coupon.gaps]


def _gap(
    name: str,
    nominal: float,
    between: tuple[str, str],
    gaps: dict[str, GapFit],
    discs: dict[str, Disc],
    reasons: dict[str, str],
    mm: float,
    u_scale: float,
) -> Measured:
    if name not in gaps:
        absent = [one for one in between if one not in discs]
        reason = next((reasons.get(one, "") for one in absent), OUTSIDE) or "no edge"
        return Measured(
            name, "gap", nominal, None, None, None, reason if reason == OUTSIDE else f"{absent[0]}: {reason}"
        )
    fit = gaps[name]
    if not fit.open:
        reason = "merged" if fit.width_px <= 0 or fit.depth < 0.5 else "not told from merged"
        if reason == "merged" or nominal > 2.0 * fit.u_width_px * mm:
            return Measured(name, "gap", nominal, None, None, False, "merged")
        return Measured(name, "gap", nominal, None, None, None, TOO_SMALL)
    size = fit.width_px * mm
    return Measured(name, "gap", nominal, size, _u(size, fit.u_width_px * mm, u_scale), True)


def _u(size: float, own: float, u_scale: float) -> float:
    return math.hypot(own, size * u_scale)


def _pitch(coupon: Coupon, discs: dict[str, Disc], px_per_mm: float) -> tuple[float | None, float | None]:
    """Distances as printed over those of the layout, and its standard uncertainty from how well the places fit."""
    names = [name for name in discs if not any(name in gap.between for gap in coupon.gaps)] or list(discs)
    if len(names) < 3:
        return None, None
    at = places([coupon.feature(name) for name in names])
    seen = np.array([(discs[name].x_px, discs[name].y_px) for name in names])
    best = min(
        (fitted(at, seen, mirrored=m) for m in (False, True)), key=lambda one: float(np.sum((one.px(at) - seen) ** 2))
    )
    rest = float(np.sum((best.px(at) - seen) ** 2)) / max(2 * len(names) - 4, 1)
    spread = float(np.sum((at - at.mean(axis=0)) ** 2))
    return best.px_per_mm / px_per_mm, math.sqrt(rest / spread) / px_per_mm


def _warnings(
    coupon: Coupon,
    found: Registration,
    measured: Sequence[Measured],
    scale: Scale,
    blur: float | None,
    ratio: float | None,
    z_mm: FloatArray | None,
) -> list[str]:
    said = []
    if scale.u_um_per_px is None:
        said.append("no uncertainty of the scale is stated: u_mm holds none")
    if ratio is not None and abs(ratio - 1.0) > CHANGED:
        said.append(f"distances between features are {100 * (ratio - 1):+.1f} % off: the print has shrunk or grown, or "
                    "the scale is wrong")  # fmt: skip
    if not found.oriented and coupon.gaps:
        said.append("the marks do not tell whether the picture is mirrored")
    outside = sum(one.reason == OUTSIDE for one in measured)
    if outside:
        said.append(f"{outside} of {len(measured)} features are not in the picture")
    small = [one.name for one in measured if one.reason == TOO_SMALL]
    if small:
        said.append(f"{', '.join(small)}: too small for pixels of {scale.um_per_px:g} µm and this blur to be told")
    if z_mm is None and coupon.steps:
        said.append("heights and steps are not measured: they are in a z map, not in a picture")
    if blur is not None and blur > 8.0:
        said.append(f"the picture is blurred by {blur:.1f} px: small features and gaps are lost in it")
    return said
