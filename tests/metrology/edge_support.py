"""Rendered edges of a lens, and the distances of measured points from the true outline."""

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
    """Return points at equal steps along a polyline."""
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.arange(0.0, length[-1], step_px)
    return np.column_stack([np.interp(at, length, points[:, i]) for i in (0, 1)])


def signed_distances_px(points: FloatArray, line: FloatArray) -> FloatArray:
    """Return signed distances of points from a finely divided polyline, positive on its right as seen in the image."""
    near = np.clip(cKDTree(line).query(points)[1], 1, len(line) - 2)
    best = np.full(len(points), np.inf)
    for first in (near - 1, near):
        direction, offset = line[first + 1] - line[first], points - line[first]
        fraction = np.clip(np.sum(direction * offset, axis=1) / np.sum(direction**2, axis=1), 0.0, 1.0)
        distance = np.hypot(*(offset - fraction[:, None] * direction).T)
        signed = np.copysign(distance, direction[:, 0] * offset[:, 1] - direction[:, 1] * offset[:, 0])
        best = np.where(distance < np.abs(best), signed, best)
    return best


@dataclass(frozen=True)
class MeasuredEdge:
    """Edge points of one image, and the distances of accepted points from the true outline, positive outwards."""

    edge: Edge
    error_px: FloatArray

    @property
    def over_u(self) -> FloatArray:
        """Errors divided by their stated standard uncertainties."""
        return np.asarray(self.error_px / self.edge.u_px[self.edge.kept])


def lens_edge(
    optics: Optics, seed: int, *, um_per_px: float = 5.0, sub: int = 2, camera: Camera | None = None
) -> MeasuredEdge:
    """Return the front of the 860 nm lens in a random pose, measured from a contour that deviates by up to 0.8 px."""
    rng = np.random.default_rng(seed)
    size = 5.0 / um_per_px
    origin = (450 * size + rng.uniform(0, 1), 470 * size + rng.uniform(0, 1))
    placing = Placing(um_per_px, origin, angle_deg=rng.uniform(-10, 10))
    shape = (int(560 * size), int(920 * size))
    levels = reflected(OUTLINE, placing, optics=optics)
    scenery = [gradient(0.3, rng.uniform(0, 360))]
    image = Scene(shape, levels, scenery=scenery, camera=camera or Camera(), sub=sub).taken(seed)
    truth = placing.px(FRONT) - 0.5  # integer coordinates are at pixel centres
    contour = along(truth, 1.0)[60:-60]
    normals = normals_of(contour, closed=False)
    contour = contour + normals * 0.8 * np.sin(np.arange(len(contour)) / 40.0)[:, None]
    edge = fit_edge(image / float(np.iinfo(image.dtype).max), contour, normals)
    return MeasuredEdge(edge, signed_distances_px(edge.points_px[edge.kept], along(truth, 0.05)))
