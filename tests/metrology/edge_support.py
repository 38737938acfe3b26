"""Rendered edges of a lens, and how far measured points lie from the true outline."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from solen.arrays import FloatArray
from solen.metrology import Edge, fit_edge, normals_of
from tests.metrology.render.camera import Camera
from tests.metrology.render.micrograph import Scene, reflected
from tests.metrology.render.optics import Optics
from tests.metrology.render.scenery import gradient
from tests.metrology.render.shape import Placing, front_mm, outline_mm, shipped

OUTLINE, FRONT = outline_mm(shipped()), front_mm(shipped())


def along(points: FloatArray, step_px: float) -> FloatArray:
    """Points at even steps along a polyline."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, length[-1], step_px)
    return np.column_stack([np.interp(at, length, points[:, i]) for i in (0, 1)])


def off_px(points: FloatArray, line: FloatArray) -> FloatArray:
    """Signed distances of points from a polyline of short pieces, positive to the right of its way as one sees it."""
    near = np.clip(cKDTree(line).query(points)[1], 1, len(line) - 2)
    best = np.full(len(points), np.inf)
    for first in (near - 1, near):
        way, beside = line[first + 1] - line[first], points - line[first]
        share = np.clip(np.sum(way * beside, axis=1) / np.sum(way**2, axis=1), 0.0, 1.0)
        distance = np.hypot(*(beside - share[:, None] * way).T)
        signed = np.copysign(distance, way[:, 0] * beside[:, 1] - way[:, 1] * beside[:, 0])
        best = np.where(distance < np.abs(best), signed, best)
    return best


@dataclass(frozen=True)
class Found:
    """Edge points of one image, and how far (px) each that is kept lies from the true outline, outwards positive."""

    edge: Edge
    error_px: FloatArray

    @property
    def over_u(self) -> FloatArray:
        """Errors over their stated standard uncertainties."""
        return np.asarray(self.error_px / self.edge.u_px[self.edge.kept])


def lens_edge(
    optics: Optics, seed: int, *, um_per_px: float = 5.0, sub: int = 2, camera: Camera | None = None
) -> Found:
    """The front of the 860 nm lens in uneven light, turned and placed by the seed, found from a contour a pixel off."""
    rng = np.random.default_rng(seed)
    size = 5.0 / um_per_px
    origin = (450 * size + rng.uniform(0, 1), 470 * size + rng.uniform(0, 1))
    placing = Placing(um_per_px, origin, angle_deg=rng.uniform(-10, 10))
    shape = (int(560 * size), int(920 * size))
    levels = reflected(OUTLINE, placing, optics=optics)
    scenery = [gradient(0.3, rng.uniform(0, 360))]
    image = Scene(shape, levels, scenery=scenery, camera=camera or Camera(), sub=sub).taken(seed)
    true = placing.px(FRONT) - 0.5  # to places that are whole in the middle of a pixel
    contour = along(true, 1.0)[60:-60]
    normals = normals_of(contour, closed=False)
    contour = contour + normals * 0.8 * np.sin(np.arange(len(contour)) / 40.0)[:, None]
    edge = fit_edge(image / float(np.iinfo(image.dtype).max), contour, normals)
    return Found(edge, off_px(edge.points_px[edge.kept], along(true, 0.05)))
