"""Round outlines on uneven ground: the coins of scikit-image's photograph, measured by the edge fit for lenses.

The photograph (Greek coins from Pompeii, Brooklyn Museum, no known copyright restrictions) comes with scikit-image and
states no scale: all lengths are in pixels. This example needs `pip install "solen[vision]"`.
"""

import numpy as np
from scipy import ndimage
from skimage import data, filters, measure

from solen.arrays import FloatArray
from solen.metrology import Edge, fit_edge, normals_of


def contours(grey: FloatArray) -> list[FloatArray]:
    """Return rough closed contours (N, 2) in px of the objects on the background."""
    ground = ndimage.gaussian_filter(ndimage.minimum_filter(ndimage.gaussian_filter(grey, 2.0), 61), 30.0)
    flat = ndimage.gaussian_filter(grey - ground, 1.5)
    solid = ndimage.binary_fill_holes(flat > filters.threshold_otsu(flat)).astype(float)
    lines = [line[:, ::-1] for line in measure.find_contours(ndimage.gaussian_filter(solid, 1.5), 0.5)]
    return [line for line in lines if len(line) > 80 and np.array_equal(line[0], line[-1])]


def circle(edge: Edge) -> tuple[float, float, float, float]:
    """Return centre (x, y), diameter and rms deviation from a circle, px, by least squares over the points on edges."""
    points = edge.points_px[edge.kept]
    x, y, rest = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), (points**2).sum(axis=1))[0]
    radius = float(np.sqrt(rest + x * x + y * y))
    off = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
    return float(x), float(y), 2.0 * radius, float(off.std())


def edges(grey: FloatArray) -> list[Edge]:
    """Return the outlines that can be measured over most of their length."""
    found = [fit_edge(grey, c, normals_of(c, closed=True), half_px=6, lines=3, closed=True) for c in contours(grey)]
    return [edge for edge in found if edge.kept.mean() > 0.6]


def main() -> dict[str, FloatArray]:
    """Measure the coins in the original and in the image rotated by 90°.

    Return their diameters in px in both, and their rms deviations from a circle.
    """
    grey = data.coins() / 255.0
    taken, turned = (np.array([circle(edge) for edge in edges(image)]) for image in (grey, np.rot90(grey)))
    back = np.stack([grey.shape[1] - 1 - turned[:, 1], turned[:, 0]], axis=1)
    same = np.hypot(*(taken[:, None, :2] - back).transpose(2, 0, 1)).argmin(axis=1)
    apart = np.abs(turned[same, 2] - taken[:, 2])
    print(f"turned: diameters of {len(apart)} coins differ by {np.median(apart):.3f} px (median)")
    print(f"deviation from round: {taken[:, 3].min():.2f} to {taken[:, 3].max():.2f} px (rms)")
    return {"taken": taken[:, 2], "turned": turned[same, 2], "round": taken[:, 3]}


if __name__ == "__main__":
    main()
