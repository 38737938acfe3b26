"""The figure of layers: some images, a close-up of pixels, the plate, and the extent of layers against height."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from solen.fabricate.grey import FULL
from solen.fabricate.layers import Job, LayeredPrint
from solen.report.canvas import INK, LOST, RIGHT, series

COLOUR_MAP = LinearSegmentedColormap.from_list("lit", ["#ffffff", RIGHT])
DRAWN = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
"""Positions of the drawn layers, as fractions of the stack."""
COLUMNS = 3
MAX_PIXELS = 900
"""Maximum number of pixels along the longer side of a drawn image; larger images are subsampled."""
EDGE_PIXELS = 28
"""Number of pixels along each side of the close-up."""
MAX_STEPS = 400
"""Maximum number of layers whose extent is drawn."""


def layers_figure(layered: LayeredPrint) -> Figure:
    """Draw some layers of a copy, a close-up of pixels at an edge, the plate, and the extent against height."""
    job, (rows, columns) = layered.job, layered.job.tile
    indices = sorted({round(fraction * (job.count - 1)) for fraction in DRAWN})
    wide = columns > rows
    figure = Figure(figsize=(8.4, 5.6 if wide else 7.0))
    across = COLUMNS if wide else len(indices)
    down = -(-len(indices) // across)
    grid = figure.add_gridspec(down + 1, 3 * across, height_ratios=(*(1.55 / down for _ in range(down)), 1.0))
    for number, layer in enumerate(indices):
        row, column = divmod(number, across)
        _draw_layer(figure.add_subplot(grid[row, 3 * column : 3 * column + 3]), job, layer)
    edge, plate, side = (figure.add_subplot(grid[down, i * across : (i + 1) * across]) for i in range(3))
    _draw_edge(edge, job, indices[len(indices) // 2])
    _draw_plate(plate, job)
    _draw_side(side, job)
    size = " × ".join(f"{length:.4g}" for length in job.solid.size_mm)
    copies = "" if job.slicing.copies == 1 else f"{job.slicing.copies} copies, "
    layers = f"{copies}{job.count} layers of {job.slicing.layer_um:g} µm on {job.printer.name}"
    figure.suptitle(f"{layered.name}: {size} mm, {layers}")
    return figure


def _draw_layer(axes: Axes, job: Job, layer: int) -> None:
    image, (x, y) = job.copy_of_layer(layer), job.printer.pitches_mm
    rows, columns = image.shape
    step = max(1, max(rows, columns) // MAX_PIXELS)
    left, low = _from_origin(job)
    extent = (left, left + columns * x, low, low + rows * y)
    axes.imshow(image[::step, ::step], cmap=COLOUR_MAP, vmin=0, vmax=FULL, origin="lower", extent=extent)
    axes.set_title(f"layer {layer + 1}\n{job.seconds_of(layer):g} s\nat {(layer + 0.5) * job.layer_mm:.3f} mm")
    axes.grid(visible=False)


def _draw_edge(axes: Axes, job: Job, layer: int) -> None:
    """Draw a close-up around the grey pixel of a layer with the smallest Y."""
    image, pitch = job.copy_of_layer(layer), np.array(job.printer.pitches_mm)
    rows, columns = image.shape
    grey = np.argwhere((image > 0) & (image < FULL))
    pixels = grey if len(grey) else np.argwhere(image)
    row, column = pixels[np.lexsort((np.abs(pixels[:, 1] - 0.5 * columns), pixels[:, 0]))[0]] if len(pixels) else (0, 0)
    low, left = _window(int(row), rows), _window(int(column), columns)
    window = image[low : low + EDGE_PIXELS, left : left + EDGE_PIXELS]
    start = np.array([left, low]) * pitch + _from_origin(job)
    size = np.array(window.shape[::-1]) * pitch
    extent = (start[0], start[0] + size[0], start[1], start[1] + size[1])
    axes.imshow(window, cmap=COLOUR_MAP, vmin=0, vmax=FULL, origin="lower", extent=extent, interpolation="nearest")
    axes.set_title(f"pixels of layer {layer + 1}")
    axes.set(xlabel="X and Y from the part's origin (mm)")
    axes.grid(visible=False)


def _from_origin(job: Job) -> tuple[float, float]:
    """Return X and Y of the lower left corner of the image of a copy, relative to the origin of the part."""
    (left, low), (x, y) = job.tile_from_mm, job.solid.origin_mm
    return left - x, low - y


def _window(centre: int, count: int) -> int:
    """Return the first of `EDGE_PIXELS` pixels around a pixel, inside an image of ``count`` pixels."""
    return max(0, min(centre - EDGE_PIXELS // 2, count - EDGE_PIXELS))


def _draw_plate(axes: Axes, job: Job) -> None:
    width, depth, _ = job.printer.size_mm
    x, y, _ = job.solid.size_mm
    axes.add_patch(Rectangle((-0.5 * width, -0.5 * depth), width, depth, facecolor="none", edgecolor=INK, lw=1.0))
    for left, low in job.positions_mm:
        axes.add_patch(Rectangle((left - 0.5 * x, low - 0.5 * y), x, y, facecolor=RIGHT, alpha=0.5, lw=0))
    axes.set(xlim=(-0.53 * width, 0.53 * width), ylim=(-0.53 * depth, 0.53 * depth), xlabel="X (mm)", ylabel="Y (mm)")
    axes.set_title(f"plate of {width:.4g} × {depth:.4g} mm")
    axes.set_aspect("equal")
    axes.grid(visible=False)


def _draw_side(axes: Axes, job: Job) -> None:
    """Draw the extent of a part along X and Y against height."""
    indices = np.unique(np.linspace(0, job.count - 1, min(job.count, MAX_STEPS)).round().astype(int))
    heights = (indices + 0.5) * job.layer_mm
    sections = [job.solid.section(z)[1] for z in heights.tolist()]
    sizes = [np.ptp(np.vstack(rings), axis=0) if len(rings) else np.zeros(2) for rings in sections]
    burn_in = job.burn_in_layers * job.layer_mm
    axes.axhspan(0.0, burn_in, color=LOST, alpha=0.35, lw=0, label="burn-in")
    for axis, label in enumerate(("along X", "along Y")):
        axes.plot([size[axis] for size in sizes], heights, **series(axis), lw=1.2, label=label)
    axes.set(xlabel="extent of a layer (mm)", ylabel="height above the plate (mm)")
    axes.set(ylim=(0.0, job.height_mm), xlim=(0.0, 1.05 * max(1e-9, *(size.max() for size in sizes))))
    axes.legend()
