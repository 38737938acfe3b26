"""Where in a picture a lens of a design lies, roughly: its place and its rotation, in any lighting.

The idea: whether a lens is bright on dark, dark on bright, or transparent with dark rims, along its outline the grey
value changes across the outline. The picture is made coarse, its gradients are divided by their own strength (so that
one bright reflection counts no more than a faint edge), and for each of many rotations the squared cosine between
gradient and normal is summed over the design's outline for all places at once, by Fourier transforms. The highest sum
is the lens. A cropped lens has a lower one, and dust does not make the shape of a lens.

The interface: `find` gives `Found`, poses with their scores, best first. A `Pose` takes lens coordinates in mm to
places in the picture.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage

from solen.arrays import FloatArray
from solen.metrology.ideal import Ideal, outward

ACROSS_PX = 70
"""Coarse pixels across the lens."""
MOST_PX = 512
"""Coarse pixels along the longer side of the picture, at most."""
STEP_DEG = 5.0
FINE_DEG = (-2.0, -1.0, 0.0, 1.0, 2.0)
SMOOTH_PX = 1.2
WALL_WEIGHT = 0.5
"""Weight of the walls beside the front, which a print may lack."""
PEAKS = 3


@dataclass(frozen=True)
class Pose:
    """Where a lens lies in a picture.

    Attributes
    ----------
    rotation_deg
        Counter-clockwise, as one sees it in the picture, from the axis upwards: 0 is a lens whose front looks down.
    vertex_px
        (x, y) of the vertex.
    um_per_px
        Size of a pixel.
    mirrored
        Whether the picture shows the lens from its other side.
    """

    rotation_deg: float
    vertex_px: tuple[float, float]
    um_per_px: float
    mirrored: bool = False

    @property
    def _turn(self) -> FloatArray:
        """Matrix from lens coordinates to directions in the picture, x to the right and y downwards."""
        c, s = math.cos(math.radians(self.rotation_deg)), math.sin(math.radians(self.rotation_deg))
        flip = -1.0 if self.mirrored else 1.0
        return np.array([[flip * c, -s], [-flip * s, -c]])

    def to_px(self, points_mm: FloatArray) -> FloatArray:
        """Places (N, 2) in the picture of points (N, 2) in lens coordinates."""
        return np.asarray(points_mm @ self._turn.T * (1e3 / self.um_per_px) + np.asarray(self.vertex_px))

    def to_mm(self, points_px: FloatArray) -> FloatArray:
        """Lens coordinates (N, 2) of places (N, 2) in the picture."""
        return np.asarray((points_px - np.asarray(self.vertex_px)) @ self._turn * (self.um_per_px / 1e3))

    def direction_px(self, directions: FloatArray) -> FloatArray:
        """Unit directions (N, 2) in the picture of those in lens coordinates."""
        return np.asarray(directions @ self._turn.T)


@dataclass(frozen=True)
class Found:
    """A pose and its score: the mean squared cosine between the normals of the outline and the picture's gradients."""

    pose: Pose
    score: float


def find(grey: FloatArray, um_per_px: float, ideal: Ideal, *, mirrored: bool = False) -> list[Found]:
    """Poses at which a picture is most like a lens, best first; those after the first lie elsewhere.

    Parameters
    ----------
    grey
        Shape (rows, columns).
    um_per_px
        Size of a pixel.
    ideal
        The lens that is looked for; a print of it may differ by about a fiftieth of its width.
    mirrored
        Whether the picture shows it from its other side.
    """
    factor = _factor(grey.shape, um_per_px, ideal)
    coarse = binned(grey, factor)
    maps = _Gradients.of(coarse)
    coarse_um = um_per_px * factor
    shape = _Template.of(ideal, coarse_um)
    poses = [Pose(float(angle), (0.0, 0.0), coarse_um, mirrored) for angle in np.arange(0.0, 360.0, STEP_DEG)]
    found = [Found(replace(pose, vertex_px=(x, y)), score) for pose in poses for x, y, score in maps.peaks(shape, pose)]
    apart = _apart(sorted(found, key=lambda one: -one.score), 0.25 * ideal.width_mm * 1e3 / coarse_um)
    fine = [_finer(maps, one, shape) for one in apart]
    return [
        Found(Pose(one.pose.rotation_deg, _fine_px(one.pose.vertex_px, factor), um_per_px, mirrored), one.score)
        for one in sorted(fine, key=lambda one: -one.score)
    ]


def binned(grey: FloatArray, factor: int) -> FloatArray:
    """Mean of blocks of ``factor`` by ``factor`` pixels; a rest at the far sides is left out."""
    if factor == 1:
        return grey
    rows, columns = grey.shape[0] // factor, grey.shape[1] // factor
    blocks = grey[: rows * factor, : columns * factor].reshape(rows, factor, columns, factor)
    return np.asarray(blocks.mean(axis=(1, 3)))


def _fine_px(place: tuple[float, float], factor: int) -> tuple[float, float]:
    """Place in the picture of a place among its blocks."""
    middle = 0.5 * (factor - 1)
    return (place[0] * factor + middle, place[1] * factor + middle)


def _factor(shape: tuple[int, ...], um_per_px: float, ideal: Ideal) -> int:
    by_lens = ideal.width_mm * 1e3 / um_per_px / ACROSS_PX
    return max(1, math.floor(by_lens), math.ceil(max(shape) / MOST_PX))


def _finer(maps: "_Gradients", one: Found, shape: "_Template") -> Found:
    """The best pose at rotations between those that were tried."""
    poses = [Pose(one.pose.rotation_deg + by, (0.0, 0.0), one.pose.um_per_px, one.pose.mirrored) for by in FINE_DEG]
    tried = [
        Found(replace(pose, vertex_px=(x, y)), score)
        for pose in poses
        for x, y, score in maps.peaks(shape, pose, near=one.pose.vertex_px)
    ]
    return max(tried, key=lambda one: one.score, default=one)


def _apart(found: list[Found], least_px: float) -> list[Found]:
    """The first poses whose vertices lie apart or which look elsewhere."""
    kept: list[Found] = []
    for one in found:
        if all(_differ(one.pose, other.pose, least_px) for other in kept):
            kept.append(one)
        if len(kept) == PEAKS:
            break
    return kept


def _differ(one: Pose, other: Pose, least_px: float) -> bool:
    turn = abs((one.rotation_deg - other.rotation_deg + 180.0) % 360.0 - 180.0)
    return math.dist(one.vertex_px, other.vertex_px) > least_px or turn > 30.0


@dataclass(frozen=True)
class _Template:
    """The outline that is looked for: points (N, 2) a coarse pixel apart, their normals (N, 2) and weights (N,)."""

    points_mm: FloatArray
    normals: FloatArray
    weights: FloatArray
    apart_px: int

    @classmethod
    def of(cls, ideal: Ideal, um_per_px: float) -> "_Template":
        parts = [(ideal.front_mm, 1.0)]
        parts += [(wall, WALL_WEIGHT) for wall in (ideal.left_mm, ideal.right_mm) if len(wall) > 1]
        points, normals, weights = [], [], []
        for line, weight in parts:
            arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            wanted = np.arange(0.0, arc[-1], um_per_px / 1e3)
            across = outward(line)
            points.append(np.stack([np.interp(wanted, arc, line[:, i]) for i in (0, 1)], axis=1))
            normals.append(np.stack([np.interp(wanted, arc, across[:, i]) for i in (0, 1)], axis=1))
            weights.append(np.full(len(wanted), weight))
        apart = max(4, int(0.1 * ideal.width_mm * 1e3 / um_per_px))
        return cls(np.concatenate(points), np.concatenate(normals), np.concatenate(weights), apart)


@dataclass(frozen=True)
class _Gradients:
    """Products of the components of a picture's gradients, divided by their strength, as Fourier transforms."""

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
        spectra = tuple(fft.rfft2(one / square, padded) for one in (x * x, 2.0 * x * y, y * y))
        return cls(spectra, (rows, columns), padded)

    def peaks(
        self, shape: _Template, pose: Pose, near: tuple[float, float] | None = None
    ) -> Iterator[tuple[float, float, float]]:
        """The best places (x, y) of the vertex at a pose's rotation, with their scores; one alone near a place."""
        scores = self._scores(pose, shape)
        rows, columns = self.padded
        reach = np.arange(-shape.apart_px, shape.apart_px + 1)
        for _ in range(1 if near is not None else PEAKS):
            row, column = divmod(int(np.argmax(scores)), columns) if near is None else _nearby(scores, near)
            score = float(scores[row, column])
            scores[np.ix_((row + reach) % rows, (column + reach) % columns)] = 0.0
            y, x = _unwrapped(row, rows, self.shape[0]), _unwrapped(column, columns, self.shape[1])
            yield float(x), float(y), score

    def _scores(self, pose: Pose, shape: "_Template") -> FloatArray:
        """Sum of squared cosines for every place of the vertex, over the sum of weights."""
        points, normals = pose.to_px(shape.points_mm), pose.direction_px(shape.normals)
        weights = shape.weights
        total = np.zeros(self.spectra[0].shape, dtype=np.complex128)
        products = (normals[:, 0] ** 2, normals[:, 0] * normals[:, 1], normals[:, 1] ** 2)
        at = np.rint(points).astype(int)
        for spectrum, product in zip(self.spectra, products, strict=True):
            kernel = np.zeros(self.padded)
            np.add.at(kernel, (at[:, 1] % self.padded[0], at[:, 0] % self.padded[1]), weights * product)
            total += spectrum * np.conj(fft.rfft2(kernel))
        return np.asarray(fft.irfft2(total, self.padded) / weights.sum())


def _unwrapped(at: int, padded: int, own: int) -> int:
    """Place along an axis where one before the picture's begin stands at the far end of the padding."""
    return at - padded if at >= 1.5 * own else at


def _nearby(scores: FloatArray, near: tuple[float, float], reach: int = 4) -> tuple[int, int]:
    """Row and column of the highest score around a place."""
    rows = np.arange(round(near[1]) - reach, round(near[1]) + reach + 1) % scores.shape[0]
    columns = np.arange(round(near[0]) - reach, round(near[0]) + reach + 1) % scores.shape[1]
    part = scores[np.ix_(rows, columns)]
    row, column = np.unravel_index(int(np.argmax(part)), part.shape)
    return int(rows[row]), int(columns[column])
