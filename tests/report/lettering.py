"""What a figure really shows, by the Agg renderer alone: where each text is drawn, and what lies under its legends."""

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg, RendererAgg
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

MIN_PT = 6.0
TOUCH = 1.0  # pixels that boxes of texts may share: they hold some air
DPI = 100.0
PAINTS = {name for name in dir(RendererAgg) if name.startswith("draw_")} - {"draw_text"}


@dataclass(frozen=True)
class Written:
    """A text as it was drawn: its box in pixels from the lower left, and its size."""

    text: str
    box: Bbox
    size_pt: float


class Recorder(RendererAgg):
    """Lays texts out as Agg does and notes them; nothing is painted."""

    def __init__(self, width: float, height: float, dpi: float) -> None:
        super().__init__(width, height, dpi)  # type: ignore[no-untyped-call]
        self.written: list[Written] = []
        for name in PAINTS:
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
            self.written.append(Written(s, box, prop.get_size_in_points()))


def faults(figure: Figure) -> list[str]:
    """What is wrong with a figure at the size it has: texts cut off, too small or on each other, legends on data."""
    figure.set_dpi(DPI)
    width, height = figure.bbox.width, figure.bbox.height
    recorder = Recorder(width, height, DPI)
    figure.draw(recorder)
    found = [
        f"leaves the canvas: {one.text!r}"
        for one in recorder.written
        if one.box.x0 < -TOUCH or one.box.y0 < -TOUCH or one.box.x1 > width + TOUCH or one.box.y1 > height + TOUCH
    ]
    found += [f"{one.size_pt:.1f} pt: {one.text!r}" for one in recorder.written if one.size_pt < MIN_PT - 1e-6]
    for one, other in combinations(recorder.written, 2):
        shared = Bbox.intersection(one.box, other.box)
        if shared is not None and shared.width > TOUCH and shared.height > 2.0 * TOUCH:
            found.append(f"on each other: {one.text!r} and {other.text!r}")
    return found + _covered(figure)


def _covered(figure: Figure) -> list[str]:
    """Legends on something: without legends, grids and lines across the whole panel the paper must be bare there."""
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
    found = []
    for (_, legend), box in zip(legends, boxes, strict=True):
        x0, y0, x1, y1 = (max(0, round(end)) for end in box.extents)
        if (pixels[y0:y1, x0:x1] < 250).sum() > 2:
            found.append(f"legend on data: {[text.get_text() for text in legend.get_texts()]}")
    return found
