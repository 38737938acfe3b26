"""Round blobs in an image: candidates for a coupon's features.

A top-hat filter keeps objects that are smaller than a window and brighter (or darker) than their surroundings, even
under non-uniform illumination. The result is thresholded at several levels, and connected regions that are as compact
as a disc or a square are kept. A pillar that appears as a bright ring is filled.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from solen.arrays import BoolArray, FloatArray
from solen.metrology.image import binned

LEVELS = (0.5, 0.35, 0.7, 0.25)
"""Thresholds, as fractions of the height of the highest blobs, in the order in which they are applied."""
HEIGHT_PERCENTILE = 99.5
"""Percentile that defines the height of the highest blobs."""
MIN_SNR = 5.0
"""Minimum height of a blob, in standard deviations of the noise."""
MAX_PIXELS = 600_000
MIN_PX = 12
"""Area in pixels below which the shape of a blob cannot be assessed."""
MAX_AXIS_RATIO, AREA_RATIOS = 1.3, (0.8, 1.15)
"""Maximum axis ratio, and limits of the area relative to the ellipse with the same second moments: 1 for a disc,
0.955 for a square.
"""
MAX_BLOBS = 150


@dataclass(frozen=True, eq=False)
class Blobs:
    """Blobs: their centres (N, 2) as (column, row), and the diameters (N,) of discs of the same areas, in px."""

    centres_px: FloatArray
    diameter_px: FloatArray


def blobs(grey: FloatArray, window_px: float, *, bright: bool, max_rise: float = math.inf) -> Blobs:
    """Return the `MAX_BLOBS` largest blobs that fit in a window and are brighter, or darker, than their surroundings.

    Rises above ``max_rise`` are clipped to it, so that blobs of different heights are segmented alike.
    """
    step = max(1, int(np.ceil(np.sqrt(grey.size / MAX_PIXELS))))
    reduced = binned(grey if bright else -grey, step)
    reduced = np.asarray(ndimage.gaussian_filter(reduced, 1.0))
    window = max(3, round(window_px / step))
    hat = np.minimum(ndimage.white_tophat(reduced, size=(window, window)), max_rise)
    highest = float(np.percentile(hat, HEIGHT_PERCENTILE))
    min_height = MIN_SNR * _noise(reduced)
    regions: list[tuple[float, float, float]] = []
    for level in LEVELS:
        if level * highest > min_height:
            regions += [region for region in _regions(hat > level * highest) if not _is_duplicate(region, regions)]
    regions = sorted(regions, key=lambda blob: -blob[2])[:MAX_BLOBS]
    table = np.array(regions).reshape(-1, 3)
    return Blobs(step * table[:, :2] + 0.5 * (step - 1), step * table[:, 2])


def _noise(grey: FloatArray) -> float:
    """Return the noise of an image, estimated from the median of its second differences."""
    second = grey[:, 2:] - 2.0 * grey[:, 1:-1] + grey[:, :-2]
    return float(np.median(np.abs(second)) / (0.6745 * np.sqrt(6.0)))


def _regions(mask: BoolArray) -> list[tuple[float, float, float]]:
    """Return the compact regions of a mask as (column, row, diameter)."""
    labels, _ = ndimage.label(mask)
    areas = np.bincount(labels.ravel())
    regions = []
    for number, window in enumerate(ndimage.find_objects(labels), 1):
        if areas[number] < MIN_PX or _at_edge(window, mask.shape):
            continue
        region = np.argwhere(ndimage.binary_fill_holes(labels[window] == number)).astype(float)
        if _compact(region):
            row, column = region.mean(axis=0).tolist()
            diameter = float(np.sqrt(4.0 * len(region) / np.pi))
            regions.append((column + window[1].start, row + window[0].start, diameter))
    return regions


def _at_edge(window: tuple[slice, ...], shape: tuple[int, ...]) -> bool:
    return any(part.start == 0 or part.stop == size for part, size in zip(window, shape, strict=True))


def _compact(region: FloatArray) -> bool:
    moments = np.linalg.eigvalsh(np.cov(region.T) + np.eye(2) / 12.0)
    ratio = len(region) / (4.0 * np.pi * np.sqrt(moments.prod()))
    return bool(np.sqrt(moments[1] / moments[0]) < MAX_AXIS_RATIO and AREA_RATIOS[0] < ratio < AREA_RATIOS[1])


def _is_duplicate(blob: tuple[float, float, float], regions: list[tuple[float, float, float]]) -> bool:
    return any(np.hypot(blob[0] - x, blob[1] - y) < 0.3 * diameter for x, y, diameter in regions)
