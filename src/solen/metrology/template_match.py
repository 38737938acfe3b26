"""Template matching: the approximate pose of a lens in an image, for any illumination.

Whether a lens is bright on dark, dark on bright, or transparent with dark rims, the grey value changes across its
outline. The image is downsampled, and its gradients are divided by their own magnitude so that one bright reflection
has no more weight than a faint edge. For each of many rotations, the squared cosine between gradient and normal is
summed over the design's outline for all positions at once, by Fourier transforms. The highest sum indicates the lens. A
cropped lens has a lower sum, and dust does not have the shape of a lens.

`match_template` returns a list of `Match`, each a pose and its score, the best first.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from solen.arrays import FloatArray
from solen.metrology.image import binned
from solen.metrology.nominal import NominalFront, arc_lengths, interpolated, outward
from solen.metrology.pose import Pose

ACROSS_PX = 70
"""Number of downsampled pixels across the lens."""
MAX_PX = 512
"""Maximum number of downsampled pixels along the longer side of the image."""
STEP_DEG = 5.0
FINE_DEG = (-2.0, -1.0, 0.0, 1.0, 2.0)
SMOOTH_PX = 1.2
WALL_WEIGHT = 0.5
"""Weight of the walls behind the front, which a print may lack."""
MAX_PEAKS = 3
REACH_PX = 4
"""Distance, in downsampled pixels, around a position within which its peak is searched for."""


@dataclass(frozen=True)
class Match:
    """A pose and its score: the mean squared cosine between the normals of the outline and the image's gradients."""

    pose: Pose
    score: float


def match_template(grey: FloatArray, um_per_px: float, nominal: NominalFront, *, mirrored: bool = False) -> list[Match]:
    """Return the poses at which an image most resembles a lens, best first, at distinct positions.

    Parameters
    ----------
    grey
        Shape (rows, columns).
    um_per_px
        Size of a pixel.
    nominal
        The lens to find; a print of it may differ by about a fiftieth of its width.
    mirrored
        Whether the image shows the part from its other side.
    """
    across = nominal.width_mm * 1e3 / um_per_px
    factor = max(1, math.floor(across / ACROSS_PX), math.ceil(max(grey.shape) / MAX_PX))
    gradients = _Gradients.of(binned(grey, factor))
    coarse_um = um_per_px * factor
    template = _Template.of(nominal, coarse_um)
    level = Pose(0.0, (0.0, 0.0), coarse_um, mirrored)
    poses = [replace(level, rotation_deg=float(angle)) for angle in np.arange(0.0, 360.0, STEP_DEG)]
    coarse = [match for pose in poses for match in gradients.matches(template, pose)]
    distinct = _distinct(sorted(coarse, key=lambda match: -match.score), 0.25 * across / factor)
    fine = [_refined(gradients, match, template) for match in distinct]
    return [
        Match(replace(match.pose, origin_px=_full_px(match.pose.origin_px, factor), um_per_px=um_per_px), match.score)
        for match in sorted(fine, key=lambda match: -match.score)
    ]


def _full_px(position_px: tuple[float, float], factor: int) -> tuple[float, float]:
    """Return the full-resolution image position of a position in the downsampled image."""
    middle = 0.5 * (factor - 1)
    return (position_px[0] * factor + middle, position_px[1] * factor + middle)


def _refined(gradients: "_Gradients", match: Match, template: "_Template") -> Match:
    """Return the best pose at rotations between those of the coarse search."""
    poses = [replace(match.pose, rotation_deg=match.pose.rotation_deg + by) for by in FINE_DEG]
    candidates = [
        candidate for pose in poses for candidate in gradients.matches(template, pose, near=match.pose.origin_px)
    ]
    return max(candidates, key=lambda candidate: candidate.score, default=match)


def _distinct(matches: list[Match], min_px: float) -> list[Match]:
    """Return the first `MAX_PEAKS` matches that differ in origin or rotation."""
    kept: list[Match] = []
    for match in matches:
        if all(_differ(match.pose, other.pose, min_px) for other in kept):
            kept.append(match)
        if len(kept) == MAX_PEAKS:
            break
    return kept


def _differ(pose: Pose, other: Pose, min_px: float) -> bool:
    turn = abs((pose.rotation_deg - other.rotation_deg + 180.0) % 360.0 - 180.0)
    return math.dist(pose.origin_px, other.origin_px) > min_px or turn > 30.0


@dataclass(frozen=True, eq=False)
class _Template:
    """The outline to find: points (N, 2) spaced by one downsampled pixel, their normals (N, 2) and weights (N,)."""

    points_mm: FloatArray
    normals: FloatArray
    weights: FloatArray
    separation_px: int

    @classmethod
    def of(cls, nominal: NominalFront, um_per_px: float) -> "_Template":
        parts = [(nominal.front_mm, 1.0)]
        parts += [(wall, WALL_WEIGHT) for wall in (nominal.left_mm, nominal.right_mm) if len(wall) > 1]
        points, normals, weights = [], [], []
        for line, weight in parts:
            arc = arc_lengths(line)
            arc_samples = np.arange(0.0, arc[-1], um_per_px / 1e3)
            points.append(interpolated(arc_samples, arc, line))
            normals.append(interpolated(arc_samples, arc, outward(line)))
            weights.append(np.full(len(arc_samples), weight))
        separation = max(4, int(0.1 * nominal.width_mm * 1e3 / um_per_px))
        return cls(np.concatenate(points), np.concatenate(normals), np.concatenate(weights), separation)


@dataclass(frozen=True, eq=False)
class _Gradients:
    """Fourier transforms of products of an image's gradient components, each divided by the gradient magnitude."""

    spectra: tuple[NDArray[np.complex128], ...]
    shape: tuple[int, int]
    padded: tuple[int, int]

    @classmethod
    def of(cls, coarse: FloatArray) -> "_Gradients":
        x = ndimage.gaussian_filter(coarse, SMOOTH_PX, order=(0, 1))
        y = ndimage.gaussian_filter(coarse, SMOOTH_PX, order=(1, 0))
        strength = np.hypot(x, y)
        floor = max(2.0 * float(np.median(strength)), 0.05 * float(np.quantile(strength, 0.995)), 1e-9)
        square = (strength + floor) ** 2
        rows, columns = coarse.shape
        padded = (int(fft.next_fast_len(2 * rows, real=True)), int(fft.next_fast_len(2 * columns, real=True)))
        spectra = tuple(fft.rfft2(product / square, padded) for product in (x * x, 2.0 * x * y, y * y))
        return cls(spectra, (rows, columns), padded)

    def matches(self, template: _Template, pose: Pose, near: tuple[float, float] | None = None) -> Iterator[Match]:
        """Yield matches at a pose's rotation with the best origins; near a specified position, only the best one."""
        scores = self._scores(replace(pose, origin_px=(0.0, 0.0)), template)
        rows, columns = self.padded
        reach = np.arange(-template.separation_px, template.separation_px + 1)
        for _ in range(1 if near is not None else MAX_PEAKS):
            row, column = divmod(int(np.argmax(scores)), columns) if near is None else _highest_near(scores, near)
            score = float(scores[row, column])
            scores[np.ix_((row + reach) % rows, (column + reach) % columns)] = 0.0
            y, x = _unwrapped(row, rows, self.shape[0]), _unwrapped(column, columns, self.shape[1])
            yield Match(replace(pose, origin_px=(float(x), float(y))), score)

    def _scores(self, pose: Pose, template: _Template) -> FloatArray:
        """Return, for every position of the origin, the sum of squared cosines divided by the sum of weights."""
        at = np.rint(pose.to_px(template.points_mm)).astype(int)
        normals = pose.direction_px(template.normals)
        total = np.zeros(self.spectra[0].shape, dtype=np.complex128)
        products = (normals[:, 0] ** 2, normals[:, 0] * normals[:, 1], normals[:, 1] ** 2)
        for spectrum, product in zip(self.spectra, products, strict=True):
            kernel = np.zeros(self.padded)
            np.add.at(kernel, (at[:, 1] % self.padded[0], at[:, 0] % self.padded[1]), template.weights * product)
            total += spectrum * np.conj(fft.rfft2(kernel))
        return np.asarray(fft.irfft2(total, self.padded) / template.weights.sum())


def _unwrapped(at: int, padded: int, size: int) -> int:
    """Return a position along an axis; positions before the image's first pixel are at the far end of the padding."""
    return at - padded if at >= 1.5 * size else at


def _highest_near(scores: FloatArray, near: tuple[float, float]) -> tuple[int, int]:
    """Return row and column of the highest score within `REACH_PX` of a position."""
    around = np.arange(-REACH_PX, REACH_PX + 1)
    rows = (round(near[1]) + around) % scores.shape[0]
    columns = (round(near[0]) + around) % scores.shape[1]
    part = scores[np.ix_(rows, columns)]
    row, column = np.unravel_index(int(np.argmax(part)), part.shape)
    return int(rows[row]), int(columns[column])
