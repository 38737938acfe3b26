"""The inspection figure: the image with the measured edge and the design, and the deviation of the edge."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.metrology.comparison import ComparedDesign
from solen.metrology.inspection import FacesInspection, LensInspection
from solen.report.canvas import INK, LINES, SERIES

MAX_PX = 1400
"""Longer side of the drawn image, in pixels."""
MARGIN = 0.18
"""Margin around the lens, as a fraction of its size."""
COLOUR_MAP = "coolwarm"
RIVAL_COLOURS = (*SERIES[4:6], SERIES[3])
"""Colours of the compared designs."""
LENGTHS_UM = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)
"""Lengths of the scale bar."""
IMAGE_IN, PLOT_IN = 5.2, 2.4
"""Width of the image and height of the plot of the deviation, in inches."""


def inspect_figure(inspection: LensInspection) -> Figure:
    """Draw the image with the edge, coloured by its deviation, and the design; below, the deviation along x."""
    image, fit = inspection.image, inspection.outline.chosen.registration
    limit = max(float(np.abs(fit.deviation_um).max()), 1e-3)
    norm = TwoSlopeNorm(0.0, -limit, limit)
    x0, x1, y0, y1 = _window(fit.pose.to_px(inspection.nominal.front_mm), image.shape)
    height = float(np.clip(IMAGE_IN * (y1 - y0) / (x1 - x0), 1.5, 7.0))
    figure = Figure(figsize=(6.4, height + PLOT_IN))
    above, below = figure.subplots(2, 1, height_ratios=[height, PLOT_IN])
    _draw_image(above, inspection)
    edge = _coloured(above, inspection, norm)
    bar = above.inset_axes((1.02, 0.0, 0.03, 1.0))  # of the height of the image
    figure.colorbar(edge, cax=bar, label="deviation (µm), positive outwards")
    bar.grid(visible=False)
    _deviations(below, inspection, norm)
    title = f"{'simulated: ' if inspection.simulated else ''}{inspection.sources[0].file}"
    title += f", {image.um_per_px:.4g} µm per pixel: {fit.rms_um:.3g} µm RMS from {inspection.nominal.name}"
    above.set_title(title)
    return figure


def faces_figure(faces: FacesInspection) -> Figure:
    """Draw the deviations of the last and the first layer along x."""
    figure = Figure(figsize=(6.4, 2.0 * PLOT_IN))
    layers = (("last layer", faces.last_layer), ("first layer", faces.first_layer))
    for axes, (name, layer) in zip(figure.subplots(2, 1, sharex=True), layers, strict=True):
        limit = max(float(np.abs(layer.outline.chosen.registration.deviation_um).max()), 1e-3)
        _deviations(axes, layer, TwoSlopeNorm(0.0, -limit, limit))
        simulated = "simulated: " if layer.simulated else ""
        deviation = f"{layer.deviation.rms_um:.3g} ± {layer.deviation.u_rms_um:.2g} µm RMS"
        axes.set_title(f"{simulated}{name}, {layer.sources[0].file}: {deviation}")
    return figure


def _draw_image(axes: Axes, inspection: LensInspection) -> None:
    """Draw the image around the lens in grey, with the fronts of designs and the rejected edge points."""
    image, outline = inspection.image, inspection.outline
    front = outline.chosen.registration.pose.to_px(inspection.nominal.front_mm)
    x0, x1, y0, y1 = _window(front, image.shape)
    step = max(1, int(np.ceil(max(x1 - x0, y1 - y0) / MAX_PX)))
    part = image.grey[y0:y1:step, x0:x1:step]
    low, high = np.quantile(part, [0.002, 0.998])
    axes.imshow(
        part, cmap="gray", vmin=low, vmax=max(high, low + 1e-9), extent=(x0 - 0.5, x1 - 0.5, y1 - 0.5, y0 - 0.5)
    )
    for other in outline.edges[1:]:
        axes.plot(*other.edge.measured[0].T, ".", ms=1.2, color=SERIES[5], label=f"{other.name} edge")
    axes.plot(*front.T, "--", lw=1.1, zorder=3, color=SERIES[2], label=f"design: {_design_label(inspection)}")
    for number, rival in enumerate(_rivals(inspection)):
        placed = rival.registration.pose.to_px(rival.front_mm)
        axes.plot(
            *placed.T, lw=0.9, color=RIVAL_COLOURS[number % 3], ls=LINES[2 + number % 3], label=f"rival: {rival.name}"
        )
    rejected = outline.chosen.edge.points_px[~outline.chosen.edge.kept]
    if len(rejected):
        axes.plot(*rejected.T, "x", ms=2.5, mew=0.6, color=SERIES[3], label="rejected")
    _scale_bar(axes, image.um_per_px, (x0, x1, y0, y1))
    axes.set(xlim=(x0 - 0.5, x1 - 0.5), ylim=(y1 - 0.5, y0 - 0.5), xticks=[], yticks=[])
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.legend()


def _rivals(inspection: LensInspection) -> list[ComparedDesign]:
    """Return the compared designs without that of the lens."""
    rms_um = inspection.outline.chosen.registration.rms_um
    designs = inspection.designs.values()
    return [design for design in designs if abs(design.registration.rms_um - rms_um) >= 1e-6 * rms_um]


def _design_label(inspection: LensInspection) -> str:
    """Return the name of the design and its label in the comparison, such as its index."""
    rivals = {rival.name for rival in _rivals(inspection)}
    labels = [name for name in inspection.designs if name not in rivals]
    return ", ".join(dict.fromkeys((inspection.nominal.name, *labels)))


def _window(front: FloatArray, shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Return the ranges of columns and rows around the front of a lens."""
    margin = MARGIN * float(np.ptp(front, axis=0).max())
    (x0, y0), (x1, y1) = np.floor(front.min(axis=0) - margin), np.ceil(front.max(axis=0) + margin)
    return max(int(x0), 0), min(int(x1), shape[1]), max(int(y0), 0), min(int(y1), shape[0])


def _scale_bar(axes: Axes, um_per_px: float, window: tuple[int, int, int, int]) -> None:
    """Draw a scale bar with a length of up to a quarter of the image width."""
    x0, x1, _, y1 = window
    quarter = max(0.25 * (x1 - x0) * um_per_px, 1.0)
    length = max(size for size in LENGTHS_UM if size <= quarter)
    left, height = x0 + 0.04 * (x1 - x0), y1 - 0.05 * (x1 - x0)
    box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
    for width, colour in ((3.0, "white"), (1.6, INK)):
        axes.plot([left, left + length / um_per_px], [height, height], "-", lw=width, color=colour)
    axes.annotate(f"{length} µm", (left, height), xytext=(0, 4), textcoords="offset points", fontsize="small", bbox=box)


def _coloured(axes: Axes, inspection: LensInspection, norm: TwoSlopeNorm) -> LineCollection:
    """Draw the measured edge, coloured by its deviation."""
    fit = inspection.outline.chosen.registration
    points = fit.pose.to_px(fit.points_mm)
    segments, lengths = np.stack([points[:-1], points[1:]], axis=1), np.hypot(*np.diff(points, axis=0).T)
    connected = lengths < 10.0 * np.median(lengths)
    lines = LineCollection(list(segments[connected]), cmap=COLOUR_MAP, norm=norm, linewidths=2.2)
    lines.set_array(fit.deviation_um[:-1][connected])
    axes.add_collection(lines)
    return lines


def _deviations(axes: Axes, inspection: LensInspection, norm: TwoSlopeNorm) -> None:
    """Draw the deviation along x with its 95 % band, and the deviations from the other designs."""
    fit = inspection.outline.chosen.registration
    x, deviation = fit.points_mm[:, 0], fit.deviation_um
    for number, design in enumerate(_rivals(inspection)):
        other = design.registration
        style: dict[str, Any] = {"color": RIVAL_COLOURS[number % 3], "ls": LINES[2 + number % 3]}
        label = f"from {design.name} ({other.rms_um:.3g} µm RMS)"
        axes.plot(other.points_mm[:, 0], other.deviation_um, lw=0.9, label=label, **style)
    band = 1.96 * fit.u_um
    axes.fill_between(x, deviation - band, deviation + band, color=SERIES[0], alpha=0.2, lw=0)
    axes.scatter(x, deviation, c=deviation, cmap=COLOUR_MAP, norm=norm, s=4, lw=0, zorder=3)
    axes.axhline(0.0, color=INK, lw=0.7)
    limit = float(np.abs(deviation).max())
    axes.set(xlabel="x (mm)", ylabel="deviation (µm), positive outwards", ylim=(-1.4 * limit, 2.1 * limit))
    if _rivals(inspection):
        axes.legend()
