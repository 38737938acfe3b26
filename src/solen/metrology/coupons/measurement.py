"""Measurement of a coupon in an image or height map: sizes with uncertainties, resolved features, and limits."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from solen.errors import DataError
from solen.geometry.coupons import Coupon, Feature, Gap
from solen.metrology.coupons.disc import MIN_RADIUS_PX, Disc, fit_disc
from solen.metrology.coupons.gap import MIN_DEPTH, GapFit, fit_gap
from solen.metrology.coupons.heights import Height, height_of, steps_of
from solen.metrology.coupons.limits import OUTSIDE, Limit, MeasuredSize, limits_of
from solen.metrology.coupons.locate import Location, centres_of, locate, locate_slab
from solen.metrology.height_map import HeightMap
from solen.metrology.image import Image
from solen.metrology.pose import Pose
from solen.metrology.scale import Scale
from solen.ranks import Caution, warning
from solen.recording import Provenance
from solen.results import HIDDEN, Result, reported

MIN_SNR = 6.0
"""Ratio of a disc's rise to its uncertainty below which the disc is treated as missing."""
MIN_COVERAGE = 0.75
"""Minimum fraction of the edge that is visible."""
MIN_RISE = 0.25
"""Rise relative to the typical one below which a disc is taken for a stain or a stump."""
MAX_U_DIAMETER = 0.3
"""Relative uncertainty of the diameter above which a disc is treated as missing."""
FIRST_BLUR_PX = 2.0
"""Initial blur."""
EDGE_BLURS = 5.0
"""Half width of an edge, in blurs."""
MAX_OFFSET_MM = 0.12
"""Largest distance of a feature from its nominal position."""
CLIP_HEIGHT = 0.9
"""Height up to which the columns in a height map are separated, as a fraction of the lowest column's height."""
MIN_BLUR_RADIUS_PX = 8.0
"""Radius in pixels above which a disc determines the blur."""
MAX_BLUR_PX = 8.0
"""Blur above which a warning is given."""
MAX_SIZE_CHANGE = 0.02
"""Relative deviation of distances from the layout above which a warning is given."""
TOO_SMALL = "too small for this image"
CALIBRATION_KINDS = ("pillar", "hole", "gap", "step")


class CouponMeasurement(Result):
    """Measurement of a coupon.

    Attributes
    ----------
    coupon
        Name of the coupon.
    simulated
        Whether the image was computed.
    image
        ``image`` or ``height map``.
    scale
        Size of a pixel and its origin.
    location
        Pose of the coupon.
    heights
        Heights of columns, from a height map.
    blur_um
        Standard deviation of the image's blur; None if unknown.
    pitch_ratio, u_pitch_ratio
        Ratio of printed to nominal distances between features, and its standard uncertainty; None for fewer than three
        features.
    sources
        The measured file.
    warnings
        Warnings about the values.
    z_um, u_z_um
        Height of a grey level of a height map, and its standard uncertainty; None for an image, or if not specified.
    layout, raster
        The printed coupon, and the image or height map of it.
    measured
        Features, gaps and steps in the order of the layout.
    limits
        The smallest resolved features.
    discs
        Fits of the round features that are present, keyed by name.
    """

    coupon: str
    simulated: bool
    image: Literal["image", "height map"]
    scale: Scale
    location: Location
    heights: tuple[Height, ...]
    blur_um: float | None
    pitch_ratio: float | None
    u_pitch_ratio: float | None
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    z_um: float | None
    u_z_um: float | None
    layout: Coupon = field(metadata=HIDDEN)
    raster: Image | HeightMap = field(metadata=HIDDEN)
    measured: tuple[MeasuredSize, ...] = field(metadata=HIDDEN)
    limits: tuple[Limit, ...] = field(metadata=HIDDEN)
    discs: Mapping[str, Disc] = field(metadata=HIDDEN)

    @reported
    def minimum(self) -> dict[str, Limit]:
        """The smallest resolved features, keyed by kind."""
        return {limit.kind: limit for limit in self.limits}

    @reported
    def features(self) -> list[MeasuredSize]:
        """Pillars, holes, gaps and steps, resolved or not, for the calibration of a printer."""
        return [
            feature for feature in self.measured if feature.kind in CALIBRATION_KINDS and feature.resolved is not None
        ]

    @reported
    def undecided(self) -> list[MeasuredSize]:
        """Features that the image does not show well enough, with the reason."""
        return [feature for feature in self.measured if feature.kind in CALIBRATION_KINDS and feature.resolved is None]

    @reported
    def marks(self) -> list[MeasuredSize]:
        """The marks that orient the image."""
        return [feature for feature in self.measured if feature.kind == "mark"]


def measure_coupon(image: Image | HeightMap, coupon: Coupon) -> CouponMeasurement:
    """Measure a coupon in an image or a height map.

    Raises
    ------
    DataError
        If the coupon has nothing that the image or map can show, or is not found.
    """
    z_mm = image.z_mm if isinstance(image, HeightMap) else None
    file, px_per_mm = image.provenance.file, 1e3 / image.scale.um_per_px
    _check_kind(coupon, image, file)
    of_blocks = not any(feature.round for feature in coupon.features)
    columns = [feature for feature in coupon.features if feature.kind in {"pillar", "mark"}] if z_mm is not None else []
    if not isinstance(image, HeightMap):
        location = locate(image.grey, coupon, px_per_mm, file)
    elif of_blocks:
        location = locate_slab(image.z_mm, coupon, px_per_mm, file)
    else:
        lowest = min((column.height_mm for column in columns), default=math.inf)
        location = locate(image.filled_mm, coupon, px_per_mm, file, max_rise=CLIP_HEIGHT * lowest)
    fits = _DiscFits(image, coupon, location)
    discs, reasons, blur = ({}, {}, None) if of_blocks else fits.present()
    gaps = {gap.name: fit for gap in coupon.gaps if (fit := _fitted_gap(image, gap, discs)) is not None}
    heights = {column.name: height_of(z_mm, coupon, column, location.pose) for column in columns if z_mm is not None}
    measured = [_round(feature, discs, reasons, image.scale) for feature in coupon.features if feature.round]
    measured += [_gap(gap, coupon, gaps, discs, reasons, image.scale) for gap in coupon.gaps]
    measured += steps_of(coupon, heights, image.u_z_relative) if isinstance(image, HeightMap) else []
    ratio, u_ratio = _pitch(coupon, discs, px_per_mm)
    return CouponMeasurement(
        coupon=coupon.name,
        simulated=image.provenance.simulated,
        image="image" if z_mm is None else "height map",
        scale=image.scale,
        location=location,
        heights=tuple(height for height in heights.values() if isinstance(height, Height)),
        blur_um=None if blur is None else blur * image.scale.um_per_px,
        pitch_ratio=ratio,
        u_pitch_ratio=u_ratio,
        sources=(image.provenance,),
        warnings=(*image.warnings, *_warnings(coupon, image, location, measured, blur, ratio)),
        z_um=image.z_um if isinstance(image, HeightMap) else None,
        u_z_um=image.u_z_um if isinstance(image, HeightMap) else None,
        layout=coupon,
        raster=image,
        measured=tuple(measured),
        limits=limits_of(measured),
        discs=discs,
    )


def _check_kind(coupon: Coupon, image: Image | HeightMap, file: str) -> None:
    if not coupon.measured_kinds:
        limit = f"cannot be measured: the coupon {coupon.name} has no features that an image shows"
        raise DataError(file, limit=limit, remedy="measure group-a, group-b, group-c, holes or z-reference")
    sizes = {pillar.diameter_mm for pillar in coupon.of_kind("pillar")}
    if isinstance(image, Image) and coupon.steps and not coupon.gaps and len(sizes) == 1:
        limit = f"cannot be measured: the coupon {coupon.name} varies only in height, which an image does not show"
        raise DataError(file, limit=limit, remedy="use a height map, and set --z-um to the height of one level")


@dataclass(frozen=True, eq=False)
class _DiscFits:
    """The round features of a located coupon, fitted in turn from the largest to the smallest."""

    image: Image | HeightMap
    coupon: Coupon
    location: Location

    @property
    def pose(self) -> Pose:
        return self.location.pose

    def present(self) -> tuple[dict[str, Disc], dict[str, str], float]:
        """Return the discs that are present, the reasons why others are missing, and the blur in px."""
        fits, reasons, blur = self._fitted()
        features = {name: self.coupon.feature(name) for name in fits}
        heights = {
            name: feature.height_mm if isinstance(self.image, HeightMap) else 1.0 for name, feature in features.items()
        }
        clear = [(name, fit) for name, fit in list(fits.items())[: max(3, len(fits) // 2)] if fit and fit.snr > MIN_SNR]
        typical = float(np.median([abs(fit.rise) / heights[name] for name, fit in clear])) if clear else 0.0
        discs = {}
        for name, fit in fits.items():
            reason = self._reason_missing(features[name], fit, typical * heights[name])
            if fit is not None and not reason:
                discs[name] = fit
            else:
                reasons[name] = reason
        return discs, reasons, blur

    def _fitted(self) -> tuple[dict[str, Disc | None], dict[str, str], float]:
        """Return the fits of visible features, the reasons why others have no fit, and the blur of large features."""
        fits: dict[str, Disc | None] = {}
        reasons: dict[str, str] = {}
        blur, known = FIRST_BLUR_PX, False
        ceiling = self.image.ceiling if isinstance(self.image, Image) else math.inf
        for feature in sorted(
            (feature for feature in self.coupon.features if feature.round), key=lambda feature: -feature.diameter_mm
        ):
            radius = 0.5 * feature.diameter_mm * self.pose.px_per_mm
            if not known and radius < MIN_BLUR_RADIUS_PX and fits:
                blur, known = _blur(fits, blur), True
            x, y = self.pose.to_px(centres_of([feature]))[0].tolist()
            rows, columns = self.image.grey.shape
            reach = radius + EDGE_BLURS * blur
            if not (reach < x < columns - 1 - reach and reach < y < rows - 1 - reach):
                reasons[feature.name] = OUTSIDE
                continue
            free, blocked = self._surroundings(feature, blur)
            fits[feature.name] = fit_disc(
                self.image.grey,
                (x, y),
                radius,
                free,
                bright=self.location.bright,
                blur_px=blur if known else None,
                blocked_rad=blocked,
                ceiling=ceiling,
            )
        return fits, reasons, _blur(fits, blur)

    def _surroundings(self, feature: Feature, blur: float) -> tuple[float, list[float]]:
        """Return the free distance around a feature's edge in px, and the directions of features that are too near."""
        scale, coupon = self.pose.px_per_mm, self.coupon
        need = EDGE_BLURS * blur + 3.0
        reach = max(0.4 * feature.diameter_mm * scale, need)
        blocked = []
        for other in coupon.features:
            if other.name == feature.name:
                continue
            free = feature.distance_mm(other) * scale
            if free < 2.0 * need + 0.2 * feature.diameter_mm * scale:
                direction = self.pose.direction_px(np.array([other.x_mm - feature.x_mm, other.y_mm - feature.y_mm]))
                blocked.append(math.atan2(direction[1], direction[0]))
            else:
                reach = min(reach, 0.5 * free)
        if coupon.slab is not None:
            sides = (0.5 * coupon.slab.width_mm - abs(feature.x_mm), 0.5 * coupon.slab.depth_mm - abs(feature.y_mm))
            to_edge = min(sides) - 0.5 * feature.diameter_mm
            reach = min(reach, max(to_edge * scale - EDGE_BLURS * blur, need))
        return reach, blocked

    def _reason_missing(self, feature: Feature, fit: Disc | None, typical: float) -> str:
        """Return the reason why a round feature is missing; empty if it is present."""
        if 0.5 * feature.diameter_mm * self.pose.px_per_mm < MIN_RADIUS_PX:
            return TOO_SMALL
        if fit is None or fit.snr < MIN_SNR or abs(fit.rise) < MIN_RISE * typical:
            return "no edge"
        if fit.coverage < MIN_COVERAGE:
            return f"only {100 * fit.coverage:.0f} % of its edge is visible"
        offset = math.dist((fit.x_px, fit.y_px), self.pose.to_px(centres_of([feature]))[0]) / self.pose.px_per_mm
        if offset > max(MAX_OFFSET_MM, 0.25 * feature.diameter_mm):
            return f"its position deviates by {offset:.2g} mm"
        if fit.u_diameter_px > MAX_U_DIAMETER * fit.diameter_px:
            return "its edge is not clear"
        return ""


def _blur(fits: Mapping[str, Disc | None], otherwise: float) -> float:
    blurs = [fit.blur_px for fit in fits.values() if fit is not None and fit.diameter_px > 2.0 * MIN_BLUR_RADIUS_PX]
    return float(np.median(blurs)) if blurs else otherwise


def _round(feature: Feature, discs: Mapping[str, Disc], reasons: Mapping[str, str], scale: Scale) -> MeasuredSize:
    disc = discs.get(feature.name)
    if disc is not None:
        size, u, u_own = _size_mm(disc.diameter_px, disc.u_diameter_px, scale)
        return MeasuredSize(feature.name, feature.kind, feature.diameter_mm, size, u, resolved=True, u_own_mm=u_own)
    reason = reasons.get(feature.name, "no edge")
    resolved = None if reason in {OUTSIDE, TOO_SMALL} else False
    return MeasuredSize(feature.name, feature.kind, feature.diameter_mm, resolved=resolved, reason=reason)


def _fitted_gap(image: Image | HeightMap, gap: Gap, discs: Mapping[str, Disc]) -> GapFit | None:
    left, right = (discs.get(name) for name in gap.between)
    return None if left is None or right is None else fit_gap(image.grey, left, right)


def _gap(
    gap: Gap,
    coupon: Coupon,
    fits: Mapping[str, GapFit],
    discs: Mapping[str, Disc],
    reasons: Mapping[str, str],
    scale: Scale,
) -> MeasuredSize:
    fit, measured, u_measured, u_own, resolved, reason = fits.get(gap.name), None, None, None, None, ""
    if fit is None:
        absent = next((name for name in gap.between if name not in discs), "")
        why = reasons.get(absent, OUTSIDE) or "no edge"
        reason = why if why == OUTSIDE else f"{absent}: {why}"
    elif fit.open:
        (measured, u_measured, u_own), resolved = _size_mm(fit.width_px, fit.u_width_px, scale), True
    elif fit.width_px <= 0 or fit.depth < MIN_DEPTH or gap.gap_mm > 2e-3 * fit.u_width_px * scale.um_per_px:
        resolved, reason = False, "merged"
    else:
        reason = TOO_SMALL
    pillar = coupon.feature(gap.between[0]).diameter_mm
    return MeasuredSize(gap.name, "gap", gap.gap_mm, measured, u_measured, resolved, reason, pillar, u_own)


def _size_mm(size_px: float, u_px: float, scale: Scale) -> tuple[float, float, float]:
    """Return a length in mm, and its standard uncertainty with and without that of the scale."""
    size, u_own = size_px * 1e-3 * scale.um_per_px, u_px * 1e-3 * scale.um_per_px
    return size, math.hypot(u_own, size * scale.u_relative), u_own


def _pitch(coupon: Coupon, discs: Mapping[str, Disc], px_per_mm: float) -> tuple[float | None, float | None]:
    """Return the ratio of printed to nominal distances, and its standard uncertainty from the position fit."""
    names = [name for name in discs if not any(name in gap.between for gap in coupon.gaps)] or list(discs)
    if len(names) < 3:
        return None, None
    centres = centres_of([coupon.feature(name) for name in names])
    positions = np.array([(discs[name].x_px, discs[name].y_px) for name in names])
    poses = [Pose.fitted(centres, positions, mirrored=mirrored) for mirrored in (False, True)]
    squares = [float(np.sum((pose.to_px(centres) - positions) ** 2)) for pose in poses]
    variance = min(squares) / max(2 * len(names) - 4, 1)
    spread = float(np.sum((centres - centres.mean(axis=0)) ** 2))
    best = poses[squares.index(min(squares))]
    return best.px_per_mm / px_per_mm, math.sqrt(variance / spread) / px_per_mm


def _warnings(
    coupon: Coupon,
    image: Image | HeightMap,
    location: Location,
    measured: Sequence[MeasuredSize],
    blur: float | None,
    ratio: float | None,
) -> list[Caution]:
    scale = image.scale
    outside = sum(feature.reason == OUTSIDE for feature in measured)
    small = ", ".join(feature.name for feature in measured if feature.reason == TOO_SMALL)
    changed = 100.0 * ((ratio or 1.0) - 1.0)
    conditions = (
        (
            scale.u_um_per_px is None,
            "the uncertainty of the scale is not specified (--u-um-per-px) and is not included in the uncertainties of "
            "the sizes",
        ),
        (
            abs(changed) > 100.0 * MAX_SIZE_CHANGE,
            f"distances between features deviate from the layout by {changed:+.1f} %: the print has shrunk or grown, "
            "or the scale is wrong",
        ),
        (
            not location.oriented and bool(coupon.gaps),
            "the marks do not show whether the image is mirrored",
        ),
        (
            location.oriented and location.pose.mirrored,
            "the image shows the coupon mirrored: it was taken from below, through the base, or was flipped",
        ),
        (outside > 0, f"{outside} of {len(measured)} features are not in the image"),
        (bool(small), f"too small for pixels of {scale.um_per_px:g} µm and this blur: {small}"),
        (
            isinstance(image, HeightMap) and image.u_z_um is None and bool(coupon.steps),
            "the uncertainty of the height scale is not specified (--u-z-um) and is not included in the uncertainties "
            "of the steps",
        ),
        (
            isinstance(image, Image) and bool(coupon.steps),
            "heights and steps are not measured: they require a height map",
        ),
        (
            (blur or 0.0) > MAX_BLUR_PX,
            f"the image is blurred by {blur or 0.0:.1f} px, so small features and gaps cannot be detected",
        ),
    )
    return [warning(text) for applies, text in conditions if applies]
