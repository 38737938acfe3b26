"""Fitting a figure to its page: panels are selected, stacked and lettered, and text is kept complete and legible.

A figure module does not know the page width, the requested panels, where a legend fits, or which titles are too long
for their panel; this module handles all of these.

Public names: `finish`, `panels_of`, `covers_data` and `titles_of`.
"""

import math
import string
import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib import rcParams
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.collections import Collection
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.image import AxesImage
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator
from matplotlib.transforms import Bbox, ScaledTranslation

from solen.errors import SpecError
from solen.report.options import MIN_PT, FigureOptions

MM_PER_IN = 25.4
MIN_WIDTH_IN = 2.1
"""Smallest width of a panel next to others, unless the panel was drawn narrower; narrower panels are stacked."""
MAX_ASPECT = 0.75
"""Maximum height of a graph on a page, as a multiple of its width; images keep their aspect ratio."""
MIN_HEIGHT_IN = 1.3
PAGE_IN = 9.25
"""Page height; stacked panels are reduced to fit it, as far as they remain legible."""
_MARGIN_PX = 1.0
_NOTE_MARGIN_PX = 2.5  # half of the smallest distance between two notes
_FEW = 4
_CODES = range(1, 11)
"""Legend positions inside a panel."""
_MAX_PASSES = 6
"""Maximum number of layout passes."""


def finish(figure: Figure, options: FigureOptions) -> Figure:
    """Finish a figure according to its options; raise `SpecError` if they name a panel that does not exist."""
    panels = panels_of(figure)
    if options.panels:
        panels = _selected(panels, options.panels)
    if options.width_mm is not None or options.panels:
        _fit(figure, panels, options)
    _set_limits(panels, options)
    if options.no_titles:
        _hide_titles(figure)
    if options.letters is not None:
        _letter(panels, options.letters)
    if options.height_mm is not None:
        figure.set_figheight(options.height_mm / MM_PER_IN)
    _settle(figure, may_grow=options.height_mm is None)
    figure.set_layout_engine("none")  # the layout is final; saving must not change it
    return figure


def panels_of(figure: Figure) -> list[list[Axes]]:
    """Return the panels in reading order, each as the axes that share a position, with their colour bars."""
    panels: list[list[Axes]] = []
    for axes in figure.axes:
        if axes.get_label() == "<colorbar>":
            panels[-1].append(axes)
        elif axes.get_visible():
            spec = axes.get_subplotspec()
            shared = next((panel for panel in panels if spec and panel[0].get_subplotspec() == spec), None)
            if shared is None:
                panels.append([axes])
            else:
                shared.append(axes)
    return panels


def titles_of(figure: Figure) -> str:
    """Return a figure's titles on one line, including hidden ones."""
    return "; ".join(" ".join(title.get_text().split()) for title in _titles(figure))


def _letter_of(number: int) -> str:
    """Return the letter of a panel: A to Z, then AA, AB..."""
    before, last = divmod(number, len(string.ascii_uppercase))
    return (_letter_of(before - 1) if before else "") + string.ascii_uppercase[last]


def _listed(names: Sequence[str]) -> str:
    return "".join(names) if len(names) <= _FEW else f"{names[0]} to {names[-1]}"


def _selected(panels: list[list[Axes]], letters: str) -> list[list[Axes]]:
    names = [_letter_of(number) for number in range(len(panels))]
    text = letters.upper()
    requested = [text] if text in names else [name.strip() for name in text.split(",")] if "," in text else [*text]
    for letter in requested:
        if letter not in names:
            raise SpecError("--panels", value=letter, limit=f"must be a panel of the figure, {_listed(names)}")
    selected = [panels[names.index(letter)] for letter in dict.fromkeys(requested)]
    for panel in panels:
        for axes in reversed(panel if panel not in selected else []):
            axes.remove()
    return selected


def _fit(figure: Figure, panels: list[list[Axes]], options: FigureOptions) -> None:
    """Set the size for a page; stack panels that would be too narrow side by side."""
    width, height = figure.get_size_inches()
    width_in = width if options.width_mm is None else options.width_mm / MM_PER_IN
    if figure.subfigs or any(panel[0].get_subplotspec() is None for panel in panels):
        figure.set_size_inches(width_in, height * max(1.0, width_in / width) if width_in > width else height)
        return
    sizes = [_size_in(panel[0], (width, height)) for panel in panels]
    columns = len({round(panel[0].get_subplotspec().get_position(figure).x0, 3) for panel in panels})  # type: ignore[union-attr]  # made by subplots
    max_columns = max(1, math.floor(width_in / min(MIN_WIDTH_IN, *(w for w, _ in sizes))))
    if not options.panels and columns <= max_columns:
        shrink = width_in / width
        figure.set_size_inches(
            width_in, max(height * shrink, min(height, 1.4 * MIN_HEIGHT_IN * _row_count(panels, figure)))
        )
        return
    columns = min(columns if not options.panels else len(panels), max_columns)
    if options.width_mm is None:
        width_in = min(width, sum(w for w, _ in sizes[:columns]) + 0.5)
    column_in = width_in / columns
    tallest = [MAX_ASPECT * column_in if panel[0].get_aspect() == "auto" else math.inf for panel in panels]
    wanted_in = [min(h * min(1.0, column_in / w), limit) for (w, h), limit in zip(sizes, tallest, strict=True)]
    heights = [max(MIN_HEIGHT_IN, *wanted_in[at : at + columns]) + 0.3 for at in range(0, len(panels), columns)]
    lower = min(1.0, PAGE_IN / sum(heights))
    heights = [max(MIN_HEIGHT_IN, lower * height) for height in heights]
    grid = GridSpec(len(heights), columns, figure=figure, height_ratios=heights)
    for number, panel in enumerate(panels):
        spec = grid[divmod(number, columns)] if len(panels) > 1 else grid[0, 0]
        for axes in panel:
            if axes.get_subplotspec() is not None:
                axes.set_subplotspec(spec)
    figure.set_size_inches(width_in, sum(heights))


def _row_count(panels: list[list[Axes]], figure: Figure) -> int:
    return len({round(panel[0].get_subplotspec().get_position(figure).y0, 3) for panel in panels})  # type: ignore[union-attr]  # made by subplots


def _size_in(axes: Axes, size_in: Sequence[float]) -> tuple[float, float]:
    spec = axes.get_subplotspec()
    assert spec is not None  # noqa: S101  ensured by the caller
    grid = spec.get_gridspec()
    widths = np.asarray(grid.get_width_ratios(), dtype=float)
    heights = np.asarray(grid.get_height_ratios(), dtype=float)
    return (
        size_in[0] * float(widths[spec.colspan.start : spec.colspan.stop].sum() / widths.sum()),
        size_in[1] * float(heights[spec.rowspan.start : spec.rowspan.stop].sum() / heights.sum()),
    )


def _set_limits(panels: list[list[Axes]], options: FigureOptions) -> None:
    names = [_letter_of(number) for number in range(len(panels))]
    for letter, axis, low, high in options.ends():
        if letter is not None and letter not in names:
            raise SpecError("--limits", value=letter, limit=f"must be a panel of the figure, {_listed(names)}")
        for name, panel in zip(names, panels, strict=True):
            if letter in {None, name}:
                if min(low, high) <= 0.0 and getattr(panel[0], f"get_{axis}scale")() == "log":
                    limit = f"must be above 0 for {axis} of panel {name}, whose axis is logarithmic"
                    raise SpecError("--limits", value=f"{low:g}:{high:g}", limit=limit)
                getattr(panel[0], f"set_{axis}lim")(low, high)


def _titles(figure: Figure) -> list[Text]:
    """Return the titles of the figure and its panels."""
    suptitle = figure.get_suptitle()
    texts = [text for text in figure.texts if suptitle and text.get_text() == suptitle]
    for axes in figure.axes:
        if axes.get_visible():
            titles = [child for child in axes.get_children() if isinstance(child, Text) and child not in axes.texts]
            texts += [text for text in titles if text.get_text()]
    return texts


def _hide_titles(figure: Figure) -> None:
    """Hide titles; a small note still marks simulated data."""
    titles = _titles(figure)
    for title in titles:
        title.set_visible(False)
        title.set_in_layout(False)
    if any("simulated" in title.get_text() for title in titles):
        figure.supxlabel("simulated", x=1.0, ha="right", fontsize=MIN_PT, color="0.4")


def _letter(panels: list[list[Axes]], first: str) -> None:
    """Draw letters at the upper left corners, outside the axes."""
    start = first.strip("()")
    for number, panel in enumerate(panels, string.ascii_lowercase.index(start.lower())):
        letter = _letter_of(number)
        panel[0].annotate(
            first.replace(start, letter if start.isupper() else letter.lower()), (0.0, 1.0), xytext=(-4.0, 6.0),
            xycoords="axes fraction", textcoords="offset points", ha="right",
            weight="bold", annotation_clip=False,
        )  # fmt: skip


def _settle(figure: Figure, *, may_grow: bool) -> None:
    """Repeat the layout until every text fits and no legend covers data."""
    family = [*rcParams["font.sans-serif"][:1], "sans-serif"]  # measured and drawn with the same font
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), MIN_PT))
        text.set_fontfamily(family)
    for axes in figure.axes:
        axes.tick_params(which="both", labelfontfamily=family, labelsize=max(rcParams["font.size"], MIN_PT))
    below: set[Axes] = set()
    for axes in figure.axes:
        if (legend := axes.get_legend()) is not None:
            legend.set_in_layout(False)  # a legend inside its panel needs no extra space
    if may_grow:
        figure.set_figheight(figure.get_figheight() + _wrap(figure))
    for _ in range(_MAX_PASSES):
        _lay_out(figure)
        wrapped = (_wrap(figure) > 0.0) | _thin_ticks(figure) | _hide_overlapping_notes(figure)
        moved = [axes for panel in panels_of(figure) for axes in panel if _move_legend(axes, panel, below)]
        if moved and may_grow:
            _grow(figure, moved)
        if not wrapped and not moved:
            break
    _lay_out(figure)  # tick labels are still those of the previous layout
    _keep_inside(figure)
    _hide_overlapping_notes(figure)


def _lay_out(figure: Figure) -> None:
    """Run the layout engine, without drawing."""
    engine = figure.get_layout_engine()
    if engine is None:
        figure.draw_without_rendering()
    else:
        engine.execute(figure)


def _keep_inside(figure: Figure) -> None:
    """Move anything that extends beyond the page back onto it."""
    box, (width, height), engine = figure.get_tightbbox(), figure.get_size_inches(), figure.get_layout_engine()
    left, low = max(0.0, -box.x0) / width, max(0.0, -box.y0) / height
    right, top = max(0.0, box.x1 - width) / width, max(0.0, box.y1 - height) / height
    if max(left, low, right, top) > 0.0 and isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(left, low, 1.0 - left - right, 1.0 - low - top))
        _lay_out(figure)


def _wrap(figure: Figure) -> float:
    """Wrap titles and labels that are too long for their panel; return the height of the added lines in inches."""
    texts = [(text, figure.bbox.width) for text in figure.texts]
    rows: dict[float, float] = {}
    for axes in figure.axes:
        titles = [child for child in axes.get_children() if isinstance(child, Text) and child not in axes.texts]
        texts += [(text, axes.bbox.width) for text in (*titles, axes.xaxis.label)] + [
            (axes.yaxis.label, axes.bbox.height)
        ]
    for text, available_px in texts:
        lines = _wrap_text(text, available_px)
        row = -1.0 if text.axes is None else round(text.axes.bbox.y0 / figure.bbox.height, 1)
        rows[row] = max(rows.get(row, 0.0), lines * 1.25 * float(text.get_fontsize()) / 72.0)
    return sum(rows.values())


def _wrap_text(text: Text, available_px: float) -> int:
    """Wrap a text; return the number of added lines."""
    content, box = text.get_text(), text.get_window_extent()
    extent_px = max(box.width, box.height) if text.get_rotation() else box.width
    if not content or not text.get_visible() or extent_px <= available_px or "$" in content:
        return 0
    count = max(len(line) for line in content.split("\n"))
    lines = [
        part
        for line in content.split("\n")
        for part in textwrap.wrap(line, max(8, int(count * available_px / extent_px)))
    ]
    text.set_text("\n".join(lines))
    return len(lines) - content.count("\n") - 1


def _thin_ticks(figure: Figure) -> bool:
    """Remove ticks whose labels touch; return whether any were removed."""
    return [_thin_axis(axes, axis) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)].count(True) > 0


def _thin_axis(axes: Axes, axis: Axis) -> bool:
    if not (axes.get_visible() and axes.axison) or isinstance(axis.get_major_locator(), FixedLocator):
        return False
    low, high = sorted(axis.get_view_interval())
    coordinate = 0 if axis is axes.xaxis else 1
    labels = [text for text in axis.get_ticklabels() if text.get_text()]  # labels of a shared axis may be hidden
    boxes = [text.get_window_extent() for text in labels if low <= text.get_position()[coordinate] <= high]
    if not any(box.overlaps(other) for box, other in pairwise(box.padded(_MARGIN_PX) for box in boxes)):
        return False
    if isinstance(axis.get_major_locator(), LogLocator):
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if len(boxes) > _FEW else (1.0,)))
    else:
        axis.set_major_locator(MaxNLocator(max(1, len(boxes) - 2)))
    return True


def _hide_overlapping_notes(figure: Figure) -> bool:
    """Hide notes that overlap earlier ones in a panel; return whether any were hidden."""
    hidden = False
    for axes in figure.axes:
        visible: list[Bbox] = []
        for note in axes.texts:
            x0, y0, x1, y1 = note.get_window_extent().extents
            box = Bbox.from_extents(x0 - _NOTE_MARGIN_PX, y0, x1 + _NOTE_MARGIN_PX, y1)
            if note.get_visible() and note.get_text() and box.count_overlaps(visible):
                note.set_visible(False)
                hidden = True
            elif note.get_visible() and note.get_text():
                visible.append(box)
    return hidden


def _move_legend(axes: Axes, panel: Sequence[Axes], below: set[Axes]) -> bool:
    """Move a legend away from the data, to a free corner or else below its axes; return whether it was moved below."""
    legend = axes.get_legend()
    if legend is None or axes in below or not covers_data(legend, panel, references=True):
        return False
    for references in (True, False):  # preferably clear of reference lines, too
        for code in _CODES:
            legend.set_loc(code)
            if not covers_data(legend, panel, references=references):
                if not references:
                    legend.set_frame_on(True)
                    legend.get_frame().set(facecolor="white", alpha=1.0, linewidth=0.0)
                return False
    below.add(axes)
    _place_below(axes, legend)
    return True


def _place_below(axes: Axes, legend: Legend) -> None:
    """Place the legend below the axes and their labels, in as many columns as fit."""
    figure = axes.get_figure(root=True)
    assert figure is not None  # noqa: S101  it has been drawn
    by_label = {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    available_px, width_px = axes.bbox.width, legend.get_window_extent().width
    labels = [text.get_text() for text in legend.get_texts()]
    columns = max(1, min(len(labels), int(available_px / width_px)))
    if width_px > available_px:
        max_chars = max(8, int(max(map(len, labels)) * (available_px / width_px) ** 1.3))
        by_label = {"\n".join(textwrap.wrap(label, max_chars)): by_label[label] for label in labels}
        labels = list(by_label)
    ticks = axes.xaxis.get_tightbbox() if axes.axison else None
    drop_in = 0.06 + (0.0 if ticks is None else max(0.0, axes.bbox.y0 - ticks.y0) / figure.dpi)
    shift = ScaledTranslation(0.0, -drop_in, figure.dpi_scale_trans)
    axes.legend(
        [by_label[label] for label in labels], labels, ncols=columns, title=legend.get_title().get_text() or None,
        loc="upper left", bbox_to_anchor=(0.0, 0.0), bbox_transform=axes.transAxes + shift, borderaxespad=0.0,
        prop=legend.get_texts()[0].get_fontproperties(), title_fontproperties=legend.get_title().get_fontproperties(),
    )  # fmt: skip


def _grow(figure: Figure, moved: Sequence[Axes]) -> None:
    """Make room for legends below their axes, row by row."""
    rows: dict[float, float] = {}
    for axes in moved:
        legend, row = axes.get_legend(), round(axes.bbox.y0 / figure.bbox.height, 1)
        if legend is not None:
            rows[row] = max(rows.get(row, 0.0), legend.get_window_extent().height / figure.dpi)
    figure.set_figheight(figure.get_figheight() + sum(rows.values()))


def covers_data(legend: Legend, panel: Sequence[Axes], *, references: bool = False) -> bool:
    """Return whether a legend covers data or text, or extends beyond its panel.

    With ``references``, unlabelled lines across the panel, such as a zero line, are treated as data.
    """
    box, within = legend.get_window_extent(), panel[0].bbox.padded(_MARGIN_PX)
    if box.x0 < within.x0 or box.x1 > within.x1 or box.y0 < within.y0 or box.y1 > within.y1:
        return True
    drawn = ((artist, axes) for axes in panel for artist in axes.get_children() if artist.get_visible())
    return any(_artist_meets(artist, axes, box, references=references) for artist, axes in drawn)


def _artist_meets(artist: Any, axes: Axes, box: Bbox, *, references: bool) -> bool:
    if isinstance(artist, Text):
        return bool(artist.get_text()) and artist.get_window_extent().overlaps(box)
    if isinstance(artist, AxesImage):
        return artist.get_window_extent().overlaps(box)
    if isinstance(artist, Line2D):
        is_labelled = not str(artist.get_label()).startswith("_")
        return (references or is_labelled or artist.get_transform() == axes.transData) and _line_meets(artist, box)
    if isinstance(artist, Patch):
        is_data = artist is not axes.patch and artist.get_data_transform().contains_branch(axes.transData)
        path = artist.get_transform().transform_path(artist.get_path())
        return is_data and artist.get_alpha() is None and bool(path.intersects_bbox(box, filled=True))
    return isinstance(artist, Collection) and _collection_meets(artist, box)


def _line_meets(line: Line2D, box: Bbox) -> bool:
    points = line.get_transform().transform(np.asarray(line.get_xydata(), dtype=float))
    if line.get_marker() not in {"None", "", None}:
        figure = line.get_figure(root=True)
        assert figure is not None  # noqa: S101  it has been drawn
        if _inside(points, box.padded(0.5 * line.get_markersize() * figure.dpi / 72.0)):
            return True
    if line.get_linestyle() in {"None", ""}:
        return False
    path = line.get_transform().transform_path(line.get_path()).cleaned(remove_nans=True)
    return np.size(path.vertices) > 2 and bool(path.intersects_bbox(box, filled=False))


def _collection_meets(collection: Collection, box: Bbox) -> bool:
    offsets = np.asarray(collection.get_offsets(), dtype=float)
    if offsets.any():
        return _inside(collection.get_offset_transform().transform(offsets), box)
    filled = bool(np.size(collection.get_facecolor()))
    paths = (collection.get_transform().transform_path(path) for path in collection.get_paths())
    return any(bool(path.intersects_bbox(box, filled=filled)) for path in paths)


def _inside(points: Any, box: Bbox) -> bool:
    x, y = np.asarray(points, dtype=float).T
    return bool(((x > box.x0) & (x < box.x1) & (y > box.y0) & (y < box.y1)).any())
