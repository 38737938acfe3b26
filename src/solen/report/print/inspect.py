"""The figure of an inspection: the picture with the edge and the design on it, and how far they are apart."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from solen.metrology import Image
from solen.metrology.nominal import NominalFront
from solen.metrology.comparison import ComparedDesign
from solen.metrology.outline import Outline
from solen.report.canvas import INK, LOST, SERIES, STYLE

MOST_PX = 1400
"""Longer side of the picture as it is drawn."""
MARGIN = 0.18
MAP = "coolwarm"
PICTURE, BELOW = 5.2, 2.4
"""Width of the picture and height of what is below it, in inches."""


def inspect_figure(image: Image, outline: Outline, nominal: NominalFront, rivals: Sequence[ComparedDesign]) -> Figure:
    """Picture with the measured edge (coloured by its deviation) and the design's front; deviations along x below."""
    laid = outline.chosen.registration
    most = max(float(np.abs(laid.deviation_um).max()), 1e-3)
    norm = TwoSlopeNorm(0.0, -most, most)
    with mpl.rc_context(STYLE):
        x0, x1, y0, y1 = _window(laid.pose.to_px(nominal.front_mm), image.shape)
        tall = float(np.clip(PICTURE * (y1 - y0) / (x1 - x0), 1.5, 7.0))
        figure = Figure(figsize=(6.4, tall + BELOW), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=[tall, BELOW])
        _picture(above, image, outline, nominal)
        edge = _coloured(above, outline, norm)
        figure.colorbar(edge, ax=above, label="out of the design (µm)", shrink=0.95)
        _deviations(below, outline, rivals, norm)
        said = "simulated: " if image.provenance.simulated else ""
        title = f"{said}{image.provenance.file}, {image.um_per_px:.4g} µm per pixel"
        above.set_title(f"{title}: {laid.rms_um:.3g} µm (rms) from {nominal.name}", fontsize=9)
    return figure


def _picture(axes: Axes, image: Image, outline: Outline, nominal: NominalFront) -> None:
    """The part of the picture around the lens, in grey, with the design's front and the edges not taken."""
    pose = outline.chosen.registration.pose
    front = pose.to_px(nominal.front_mm)
    x0, x1, y0, y1 = _window(front, image.shape)
    step = max(1, int(np.ceil(max(x1 - x0, y1 - y0) / MOST_PX)))
    part = image.grey[y0:y1:step, x0:x1:step]
    low, high = np.quantile(part, [0.002, 0.998])
    axes.imshow(
        part, cmap="gray", vmin=low, vmax=max(high, low + 1e-9), extent=(x0 - 0.5, x1 - 0.5, y1 - 0.5, y0 - 0.5)
    )
    for one in outline.edges[1:]:
        kept = one.edge.points_px[one.edge.kept]
        axes.plot(*kept.T, ".", ms=1.2, color=SERIES[5], label=f"{one.name} edge")
    axes.plot(*front.T, "--", lw=1.1, color=SERIES[2], label=f"design: {nominal.name}")
    bad = outline.chosen.edge.points_px[~outline.chosen.edge.kept]
    if len(bad):
        axes.plot(*bad.T, "x", ms=2.5, mew=0.6, color=SERIES[3], label="set aside")
    _bar(axes, image.um_per_px, (x0, x1, y0, y1))
    axes.set(xlim=(x0 - 0.5, x1 - 0.5), ylim=(y1 - 0.5, y0 - 0.5), xticks=[], yticks=[])
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.legend(fontsize=7, loc="upper right", frameon=True, framealpha=0.85)


def _window(front: NDArray[np.float64], shape: tuple[int, int]) -> tuple[int, int, int, int]:
    """Columns and rows around the front."""
    margin = MARGIN * float(np.ptp(front, axis=0).max())
    (x0, y0), (x1, y1) = np.floor(front.min(axis=0) - margin), np.ceil(front.max(axis=0) + margin)
    return max(int(x0), 0), min(int(x1), shape[1]), max(int(y0), 0), min(int(y1), shape[0])


def _bar(axes: Axes, um_per_px: float, window: tuple[int, int, int, int]) -> None:
    """A scale bar of a round length."""
    x0, x1, _, y1 = window
    quarter = 0.25 * (x1 - x0) * um_per_px
    length = max(
        one for one in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000) if one <= max(quarter, 1)
    )
    left, height = x0 + 0.04 * (x1 - x0), y1 - 0.05 * (x1 - x0)
    box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1.5}
    axes.plot([left, left + length / um_per_px], [height, height], "-", lw=3, color="white")
    axes.plot([left, left + length / um_per_px], [height, height], "-", lw=1.6, color=INK)
    axes.annotate(f"{length} µm", (left, height), xytext=(0, 4), textcoords="offset points", fontsize=7, bbox=box)


def _coloured(axes: Axes, outline: Outline, norm: TwoSlopeNorm) -> LineCollection:
    """The measured edge, coloured by how far it stands out."""
    laid = outline.chosen.registration
    points = laid.pose.to_px(laid.points_mm)
    pieces = np.stack([points[:-1], points[1:]], axis=1)
    near = np.hypot(*(points[1:] - points[:-1]).T) < 10.0 * np.median(np.hypot(*(points[1:] - points[:-1]).T))
    lines = LineCollection(list(pieces[near]), cmap=MAP, norm=norm, linewidths=2.2)
    lines.set_array(laid.deviation_um[:-1][near])
    axes.add_collection(lines)
    return lines


def _deviations(axes: Axes, outline: Outline, rivals: Sequence[ComparedDesign], norm: TwoSlopeNorm) -> None:
    """Deviation along x, its 95 % band, and that from the designs it was compared with."""
    laid = outline.chosen.registration
    x, off = laid.points_mm[:, 0], laid.deviation_um
    for number, rival in enumerate(rivals):
        other = rival.registration
        if abs(other.rms_um - laid.rms_um) < 1e-6 * laid.rms_um:  # the design itself
            continue
        axes.plot(
            other.points_mm[:, 0],
            other.deviation_um,
            "-",
            lw=0.9,
            color=(*SERIES[4:6], LOST)[number % 3],
            label=f"from {rival.name} ({rival.registration.rms_um:.3g} µm rms)",
        )
    axes.fill_between(x, off - 1.96 * laid.u_um, off + 1.96 * laid.u_um, color=SERIES[0], alpha=0.2, lw=0)
    axes.scatter(x, off, c=off, cmap=MAP, norm=norm, s=4, lw=0, zorder=3)
    axes.axhline(0.0, color=INK, lw=0.7)
    most = float(np.abs(off).max())
    axes.set(xlabel="x (mm)", ylabel="out of the design (µm)", ylim=(-1.4 * most, 2.1 * most))
    axes.legend(fontsize=7, loc="upper center", ncols=2, frameon=True, framealpha=0.85, edgecolor="none")
