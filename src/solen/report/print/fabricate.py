"""Figures of an exported part: oblique views of the solid from both ends, and its plan with the seats.

Hidden surfaces are removed with a depth buffer: a triangle that faces the viewer fills the pixels in which no nearer
triangle was drawn.
"""

import math

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solen.arrays import FloatArray
from solen.fabricate import Export, ExportedSolid, Mesh, Part
from solen.report.canvas import INK, LEFT, LOST, RIGHT

VIEWS = (("from the front", 35.0), ("from behind", 145.0))
"""Names of the views, and their azimuths in degrees; at 0, Y points away from the viewer."""
ELEVATION_DEG = 38.0
"""Elevation of the viewer in degrees."""
PIXELS = 900
"""Width of the image in pixels."""
LIGHT_DIRECTION = (0.25, 0.75, 0.6)
"""Direction towards the light: right, up, towards the viewer."""
AMBIENT = 0.5
"""Brightness of surfaces that face away from the light."""
BODY_COLOUR = "#8fb4d3"
EDGE_DEG = 20.0
"""Minimum angle between the surfaces of adjacent pixels for which an edge is drawn."""
MIN_COSINE = 1e-6
"""A triangle is invisible if the cosine of the angle from its normal to the direction of the viewer is not larger."""
EDGE_STEP = 0.01
"""Minimum difference of depth for which an edge is drawn, as a fraction of the image size."""


def solid_figure(solid: ExportedSolid) -> Figure:
    """Draw the figure of an exported part; see `export_figure`."""
    return export_figure(solid.export)


def export_figure(export: Export) -> Figure:
    """Draw oblique views of the solid from both ends, and the plan of its outlines with pockets and slots."""
    part, mesh = export.part, export.mesh
    figure = Figure(figsize=(6.6, 5.6))
    grid = figure.add_gridspec(len(VIEWS), 2, width_ratios=(1.8, 1.0))
    for row, (title, azimuth_deg) in enumerate(VIEWS):
        axes = figure.add_subplot(grid[row, 0])
        _draw_solid(axes, mesh, azimuth_deg)
        axes.set_title(title)
    _draw_plan(figure.add_subplot(grid[:, 1]), part)
    size = " × ".join(f"{length:.4g}" for length in mesh.size_mm)
    figure.suptitle(f"{part.name}: {size} mm, {part.volume_mm3:.4g} mm³")
    return figure


def _draw_solid(axes: Axes, mesh: Mesh, azimuth_deg: float) -> None:
    image, extent = rendered(mesh.vertices @ _view(azimuth_deg), mesh.triangles)
    axes.imshow(image, extent=extent, origin="lower", interpolation="antialiased")
    axes.set_axis_off()
    left, right, low, _ = extent
    bar_mm = 10.0 ** math.floor(math.log10((right - left) / 2.0))
    axes.plot([left, left + bar_mm], [low, low], color=INK, lw=2.0, solid_capstyle="butt", clip_on=False)
    axes.annotate(f"{bar_mm:g} mm", (left, low), xytext=(0, -10), textcoords="offset points")


def _view(azimuth_deg: float) -> FloatArray:
    """Return the directions right, up and towards the viewer as columns, in X, Y, Z of the part."""
    azimuth, elevation = math.radians(azimuth_deg), math.radians(ELEVATION_DEG)
    right = np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
    horizontal = np.array([math.sin(azimuth), -math.cos(azimuth), 0.0])
    viewer = math.cos(elevation) * horizontal + np.array([0.0, 0.0, math.sin(elevation)])
    return np.column_stack([right, np.cross(viewer, right), viewer])


def rendered(
    vertices: FloatArray, triangles: NDArray[np.int64]
) -> tuple[FloatArray, tuple[float, float, float, float]]:
    """Return an image (rows, columns, 4) of triangles viewed along their third coordinate, and its extent."""
    margin = 0.03 * float(np.ptp(vertices[:, :2], axis=0).max())
    low, high = vertices[:, :2].min(axis=0) - margin, vertices[:, :2].max(axis=0) + margin
    pixel = float((high - low).max()) / PIXELS
    columns, rows = (int(count) for count in np.ceil((high - low) / pixel))
    depth, drawn = np.full((rows, columns), -np.inf), np.full((rows, columns), -1)
    corners = vertices[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    placed = np.concatenate([(corners[..., :2] - low) / pixel - 0.5, corners[..., 2:]], axis=-1)
    for index in np.flatnonzero(normals[:, 2] > MIN_COSINE).tolist():
        _fill(depth, drawn, placed[index], index)
    extent = (float(low[0]), float(low[0] + columns * pixel), float(low[1]), float(low[1] + rows * pixel))
    return _coloured(depth, np.where(drawn[..., None] >= 0, normals[drawn], 0.0), PIXELS * pixel), extent


def _fill(depth: FloatArray, drawn: NDArray[np.int64], corners: FloatArray, index: int) -> None:
    """Draw a triangle with corners (column, row, depth) into the pixels in which no nearer triangle was drawn."""
    columns, rows = (
        np.arange(max(0, math.ceil(corners[:, axis].min())), math.floor(corners[:, axis].max()) + 1) for axis in (0, 1)
    )
    if not len(columns) or not len(rows):
        return
    (x0, y0, d0), (x1, y1, d1), (x2, y2, d2) = corners.tolist()
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    dx, dy = columns - x0, (rows - y0)[:, None]
    second, third = (dx * (y2 - y0) - (x2 - x0) * dy) / area, ((x1 - x0) * dy - dx * (y1 - y0)) / area
    depths = d0 + second * (d1 - d0) + third * (d2 - d0)
    window = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    nearer = (second >= 0.0) & (third >= 0.0) & (second + third <= 1.0) & (depths > depth[window])
    depth[window][nearer] = depths[nearer]
    drawn[window][nearer] = index


def _coloured(depth: FloatArray, normals: FloatArray, width: float) -> FloatArray:
    """Return shaded colours with edges; pixels without a surface are transparent."""
    surface = np.isfinite(depth)
    diffuse = np.clip(normals @ (np.array(LIGHT_DIRECTION) / np.linalg.norm(LIGHT_DIRECTION)), 0.0, 1.0)
    colour = np.array(mpl.colors.to_rgb(BODY_COLOUR)) * (AMBIENT + (1.0 - AMBIENT) * diffuse)[..., None]
    edge = _edges(np.where(surface, depth, -1e9), normals, EDGE_STEP * width)
    colour[edge] = mpl.colors.to_rgb(INK)
    return np.dstack([colour, (surface | edge).astype(float)])


def _edges(depth: FloatArray, normals: FloatArray, step: float) -> NDArray[np.bool_]:
    """Return the pixels whose right or upper neighbour has another surface or depth."""
    edge = np.zeros(depth.shape, dtype=bool)
    for pixel, neighbour in ((np.s_[:-1], np.s_[1:]), (np.s_[:, :-1], np.s_[:, 1:])):
        surface = np.minimum(depth[pixel], depth[neighbour]) > -1e9
        fold = np.sum(normals[pixel] * normals[neighbour], axis=-1) < math.cos(math.radians(EDGE_DEG))
        edge[pixel] |= (surface & fold) | (np.abs(depth[pixel] - depth[neighbour]) > step)
    return edge


def _draw_plan(axes: Axes, part: Part) -> None:
    for prism in part.prisms:
        for ring in prism.rings(1e-2):
            axes.plot(*ring.T, color=INK, lw=1.0)
    for cut in part.cuts:
        slot = cut.name.startswith("slot")
        for ring in cut.removed.rings(1e-2):
            axes.fill(*ring.T, facecolor=LEFT if slot else RIGHT, alpha=0.35, lw=0)
            axes.plot(*ring.T, color=LEFT if slot else RIGHT, lw=1.0)
    for colour, kind, heights in _seats(part):
        axes.fill([], [], color=colour, alpha=0.6, label=f"{kind}\n{heights}")
    if part.cuts:
        axes.legend()
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.axvline(0.0, color=LOST, lw=0.6, ls=(0, (6, 3)))
    axes.set(xlabel="X = x (mm)", ylabel="Y = z (mm)")


def _seats(part: Part) -> list[tuple[str, str, str]]:
    """Return colour, name and heights for each kind of seat in a part."""
    seats: dict[str, tuple[str, str, str]] = {}
    for cut in part.cuts:
        kind = cut.name.partition("-")[0]
        heights = f"Z {cut.removed.from_mm:.4g} to {cut.removed.to_mm:.4g} mm"
        seats[kind] = (LEFT if kind == "slot" else RIGHT, f"{kind}s", heights)
    return list(seats.values())
