"""Outlines on a non-uniform background: coins in a photograph, measured with the edge fit for lenses.

The photograph (Greek coins from Pompeii, Brooklyn Museum, no known copyright restrictions) comes with scikit-image and
has no scale: all lengths are in pixels. This example needs `pip install "solen[vision]"`.
"""

import numpy as np
from scipy import ndimage
from skimage import data, filters, measure

from solen.arrays import FloatArray
from solen.metrology import Edge, fit_edge, normals_of


def contours(grey: FloatArray) -> list[FloatArray]:
    """Return rough closed contours (N, 2) in px of the objects on the background."""
    background = ndimage.gaussian_filter(ndimage.minimum_filter(ndimage.gaussian_filter(grey, 2.0), 61), 30.0)
    flat = ndimage.gaussian_filter(grey - background, 1.5)
    solid = ndimage.binary_fill_holes(flat > filters.threshold_otsu(flat)).astype(float)
    lines = [line[:, ::-1] for line in measure.find_contours(ndimage.gaussian_filter(solid, 1.5), 0.5)]
    return [line for line in lines if len(line) > 80 and np.array_equal(line[0], line[-1])]


def circle(edge: Edge) -> tuple[float, float, float, float]:
    """Return the centre (x, y), diameter and RMS deviation of the circle fitted by least squares, in px."""
    points = edge.points_px[edge.kept]
    x, y, constant = np.linalg.lstsq(np.column_stack([2 * points, np.ones(len(points))]), (points**2).sum(axis=1))[0]
    radius = float(np.sqrt(constant + x * x + y * y))
    deviations = np.hypot(points[:, 0] - x, points[:, 1] - y) - radius
    return float(x), float(y), 2.0 * radius, float(deviations.std())


def edges(grey: FloatArray) -> list[Edge]:
    """Return the outlines that can be measured over most of their length."""
    fits = [fit_edge(grey, c, normals_of(c, closed=True), half_px=6, lines=3, closed=True) for c in contours(grey)]
    return [edge for edge in fits if edge.kept.mean() > 0.6]


def main() -> dict[str, FloatArray]:
    """Measure the coins in the original and in the image rotated by 90°.

    Return their diameters in both, and their RMS deviations from a circle, in px.
    """
    grey = data.coins() / 255.0
    original, rotated = (np.array([circle(edge) for edge in edges(image)]) for image in (grey, np.rot90(grey)))
    rotated_back = np.stack([grey.shape[1] - 1 - rotated[:, 1], rotated[:, 0]], axis=1)
    match = np.hypot(*(original[:, None, :2] - rotated_back).transpose(2, 0, 1)).argmin(axis=1)
    differences = np.abs(rotated[match, 2] - original[:, 2])
    print(f"rotated by 90°: diameters of {len(match)} coins differ by {np.median(differences):.3f} px (median)")
    print(f"RMS deviation from a circle: {original[:, 3].min():.2f} to {original[:, 3].max():.2f} px")
    return {"original": original[:, 2], "rotated": rotated[match, 2], "rms": original[:, 3]}


if __name__ == "__main__":
    main()
