"""Checks of drawn figures with the Agg renderer: positions of texts, and what is under the legends."""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

MIN_PT = 6.0
MAX_OVERLAP = 1.0  # overlap in pixels that is tolerated, because text boxes include a margin
DPI = 100.0
PAINTING_METHODS = {name for name in dir(RendererAgg) if name.startswith("draw_")} - {"draw_text"}


@dataclass(frozen=True)
class DrawnText:
    """A drawn text: its box in pixels from the lower left corner, and its font size."""

    text: str
    box: Bbox
    size_pt: float


class Recorder(RendererAgg):
    """Renderer that records the layout of texts; nothing is painted."""

    def __init__(self, width: float, height: float, dpi: float) -> None:
        super().__init__(width, height, dpi)  # type: ignore[no-untyped-call]
        self.texts: list[DrawnText] = []
        for name in PAINTING_METHODS:
            setattr(self, name, lambda *_, **__: None)

    def draw_text(
        self, gc: Any, x: float, y: float, s: str, prop: Any, angle: float, ismath: Any = False, mtext: Any = None
    ) -> None:
        del gc, mtext  # nothing is painted
        size: Any = self.get_text_width_height_descent  # which matplotlib does not type
        width, height, descent = size(s, prop, ismath)
        turn = np.radians(angle)
        corners = np.array([(0, -descent), (width, -descent), (width, height - descent), (0, height - descent)])
        turned = corners @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        points = turned + np.array([x, self.height - y])
        if s.strip():
            box = Bbox([points.min(axis=0), points.max(axis=0)])
            self.texts.append(DrawnText(s, box, prop.get_size_in_points()))


def faults(figure: Figure) -> list[str]:
    """Faults of a figure at its size: text that is cut off, too small or overlapping, and legends on data."""
    figure.set_dpi(DPI)
    width, height = figure.bbox.width, figure.bbox.height
    recorder = Recorder(width, height, DPI)
    figure.draw(recorder)
    low_x, low_y, high_x, high_y = -MAX_OVERLAP, -MAX_OVERLAP, width + MAX_OVERLAP, height + MAX_OVERLAP
    messages = [
        f"leaves the canvas: {text.text!r}"
        for text in recorder.texts
        if text.box.x0 < low_x or text.box.y0 < low_y or text.box.x1 > high_x or text.box.y1 > high_y
    ]
    messages += [f"{text.size_pt:.1f} pt: {text.text!r}" for text in recorder.texts if text.size_pt < MIN_PT - 1e-6]
    for first, second in combinations(recorder.texts, 2):
        shared = Bbox.intersection(first.box, second.box)
        if shared is not None and shared.width > MAX_OVERLAP and shared.height > 2.0 * MAX_OVERLAP:
            messages.append(f"overlap: {first.text!r} and {second.text!r}")
    return messages + _covered(figure)


def _covered(figure: Figure) -> list[str]:
    """Legends that cover data: with legends, grids and reference lines hidden, the area of a legend must be blank."""
    legends = [(axes, legend) for axes in figure.axes if (legend := axes.get_legend()) is not None]
    if not legends:
        return []
    boxes = [legend.get_window_extent().padded(-1.0) for _, legend in legends]
    for _, legend in legends:
        legend.set_visible(False)
    for axes in figure.axes:
        axes.grid(visible=False)
        for artist in (*axes.lines, *axes.patches):
            if axes.transData not in (artist.get_transform(), getattr(artist, "get_data_transform", lambda: None)()):
                artist.set_visible(False)
        for spine in axes.spines.values():
            spine.set_visible(False)
    figure.set_layout_engine("none")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())[..., :3].min(axis=2)[::-1]  # type: ignore[no-untyped-call]
    messages = []
    for (_, legend), box in zip(legends, boxes, strict=True):
        x0, y0, x1, y1 = (max(0, round(end)) for end in box.extents)
        if (pixels[y0:y1, x0:x1] < 250).sum() > 2:
            messages.append(f"legend on data: {[text.get_text() for text in legend.get_texts()]}")
    return messages
