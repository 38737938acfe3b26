"""Fitting a drawn figure to its page: selects, stacks and letters panels, and keeps text complete and free of overlap.

A figure module does not know the page width, the requested panels, where a legend fits, or which titles are too long
for their panel; this module handles them all.

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
TALLEST = 0.75
"""Height of a graph on a page, as a multiple of its width; images keep their aspect ratio."""
MIN_HEIGHT_IN = 1.3
PAGE_IN = 9.25
"""Page height; stacked panels shrink to fit as far as they stay legible."""
_AIR_PX = 1.0
_APART_PX = 2.5  # half of the least distance between two notes
_MANY = 4
_CODES = range(1, 11)
"""Legend positions inside a panel."""
_ROUNDS = 6
"""Largest number of layout passes made until every text is placed."""


def finish(figure: Figure, look: FigureOptions) -> Figure:
    """Finish a figure according to its options; raise `SpecError` if they name a panel that does not exist."""
    panels = panels_of(figure)
    if look.panels:
        panels = _chosen(panels, look.panels)
    if look.width_mm is not None or look.panels:
        _fit(figure, panels, look)
    _set_limits(panels, look)
    if look.no_titles:
        _hide_titles(figure)
    if look.letters is not None:
        _letter(panels, look.letters)
    if look.height_mm is not None:
        figure.set_figheight(look.height_mm / MM_PER_IN)
    _settle(figure, may_grow=look.height_mm is None)
    figure.set_layout_engine("none")  # the layout is final; saving must not change it
    return figure


def panels_of(figure: Figure) -> list[list[Axes]]:
    """Return the panels in reading order, each as the axes that share a position, with their colour bars."""
    panels: list[list[Axes]] = []
    for axes in figure.axes:
        if axes.get_label() == "<colorbar>":
            panels[-1].append(axes)
        elif axes.get_visible():
            there = [panel for panel in panels if panel[0].get_subplotspec() == axes.get_subplotspec()]
            (there[0].append if there and axes.get_subplotspec() else lambda one: panels.append([one]))(axes)
    return panels


def titles_of(figure: Figure) -> str:
    """Return a figure's titles on one line, including hidden ones."""
    return "; ".join(" ".join(title.get_text().split()) for title in _titles(figure))


def _letter_of(number: int) -> str:
    """Return the letter of a panel: A to Z, then AA, AB..."""
    before, last = divmod(number, len(string.ascii_uppercase))
    return (_letter_of(before - 1) if before else "") + string.ascii_uppercase[last]


def _listed(names: Sequence[str]) -> str:
    return "".join(names) if len(names) <= _MANY else f"{names[0]} to {names[-1]}"


def _chosen(panels: list[list[Axes]], letters: str) -> list[list[Axes]]:
    names = [_letter_of(number) for number in range(len(panels))]
    wanted = letters.upper()
    asked = (
        [wanted] if wanted in names else [name.strip() for name in wanted.split(",")] if "," in wanted else [*wanted]
    )
    for letter in asked:
        if letter not in names:
            raise SpecError("--panels", value=letter, limit=f"the figure has the panels {_listed(names)}")
    chosen = [panels[names.index(letter)] for letter in dict.fromkeys(asked)]
    for panel in panels:
        for axes in reversed(panel if panel not in chosen else []):
            axes.remove()
    return chosen


def _fit(figure: Figure, panels: list[list[Axes]], look: FigureOptions) -> None:
    """Set the size for a page; stack panels that would be too narrow next to each other."""
    width, height = figure.get_size_inches()
    wide = width if look.width_mm is None else look.width_mm / MM_PER_IN
    if figure.subfigs or any(panel[0].get_subplotspec() is None for panel in panels):
        figure.set_size_inches(wide, height * max(1.0, wide / width) if wide > width else height)
        return
    sizes = [_size_in(panel[0], (width, height)) for panel in panels]
    across = len({round(panel[0].get_subplotspec().get_position(figure).x0, 3) for panel in panels})  # type: ignore[union-attr]  # made by subplots
    fits = max(1, math.floor(wide / min(MIN_WIDTH_IN, *(w for w, _ in sizes))))
    if not look.panels and across <= fits:
        shrink = wide / width
        figure.set_size_inches(wide, max(height * shrink, min(height, 1.4 * MIN_HEIGHT_IN * _down(panels, figure))))
        return
    across = min(across if not look.panels else len(panels), fits)
    if look.width_mm is None:
        wide = min(width, sum(w for w, _ in sizes[:across]) + 0.5)
    each = wide / across
    tallest = [TALLEST * each if panel[0].get_aspect() == "auto" else math.inf for panel in panels]
    wanted = [min(h * min(1.0, each / w), most) for (w, h), most in zip(sizes, tallest, strict=True)]
    heights = [max(MIN_HEIGHT_IN, *wanted[at : at + across]) + 0.3 for at in range(0, len(panels), across)]
    lower = min(1.0, PAGE_IN / sum(heights))
    heights = [max(MIN_HEIGHT_IN, lower * height) for height in heights]
    grid = GridSpec(len(heights), across, figure=figure, height_ratios=heights)
    for number, panel in enumerate(panels):
        place = grid[divmod(number, across)] if len(panels) > 1 else grid[0, 0]
        for axes in panel:
            if axes.get_subplotspec() is not None:
                axes.set_subplotspec(place)
    figure.set_size_inches(wide, sum(heights))


def _down(panels: list[list[Axes]], figure: Figure) -> int:
    return len({round(panel[0].get_subplotspec().get_position(figure).y0, 3) for panel in panels})  # type: ignore[union-attr]  # made by subplots


def _size_in(axes: Axes, size_in: Sequence[float]) -> tuple[float, float]:
    place = axes.get_subplotspec()
    assert place is not None  # noqa: S101  ensured by the caller
    columns = place.get_gridspec().ncols
    wide = np.asarray(place.get_gridspec().get_width_ratios(), dtype=float)
    high = np.asarray(place.get_gridspec().get_height_ratios(), dtype=float)
    first, last = place.num1, place.num2
    across, down = slice(first % columns, last % columns + 1), slice(first // columns, last // columns + 1)
    return (
        size_in[0] * float(wide[across].sum() / wide.sum()),
        size_in[1] * float(high[down].sum() / high.sum()),
    )


def _set_limits(panels: list[list[Axes]], look: FigureOptions) -> None:
    names = [_letter_of(number) for number in range(len(panels))]
    for letter, axis, low, high in look.ends():
        if letter is not None and letter not in names:
            raise SpecError("--limits", value=letter, limit=f"the figure has the panels {_listed(names)}")
        for name, panel in zip(names, panels, strict=True):
            if letter in {None, name}:
                if min(low, high) <= 0.0 and getattr(panel[0], f"get_{axis}scale")() == "log":
                    limit = f"ends of {axis} of panel {name} must be above 0: its axis is logarithmic"
                    raise SpecError("--limits", value=f"{low:g}:{high:g}", limit=limit)
                getattr(panel[0], f"set_{axis}lim")(low, high)


def _titles(figure: Figure) -> list[Text]:
    """Return the titles of the figure and its panels."""
    whole = figure.get_suptitle()
    texts = [text for text in figure.texts if whole and text.get_text() == whole]
    for axes in figure.axes:
        if axes.get_visible():
            own = [child for child in axes.get_children() if isinstance(child, Text) and child not in axes.texts]
            texts += [text for text in own if text.get_text()]
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
    """Lay the figure out until every text fits and no legend covers data."""
    family = [*rcParams["font.sans-serif"][:1], "sans-serif"]  # the same font as for measuring
    for text in figure.findobj(Text):
        text.set_fontsize(max(text.get_fontsize(), MIN_PT))
        text.set_fontfamily(family)
    for axes in figure.axes:
        axes.tick_params(which="both", labelfontfamily=family, labelsize=max(rcParams["font.size"], MIN_PT))
    outside: set[Axes] = set()
    for axes in figure.axes:
        if (legend := axes.get_legend()) is not None:
            legend.set_in_layout(False)  # inside its panel it needs no extra space
    if may_grow:
        figure.set_figheight(figure.get_figheight() + _wrap(figure))
    for _ in range(_ROUNDS):
        _lay_out(figure)
        wrapped = (_wrap(figure) > 0.0) | _thin(figure) | _uncrowded(figure)
        moved = [axes for panel in panels_of(figure) for axes in panel if _clear(axes, panel, outside)]
        if moved and may_grow:
            _grow(figure, moved)
        if not wrapped and not moved:
            break
    _lay_out(figure)  # labels are still at the ticks of the previous layout
    _keep_inside(figure)
    _uncrowded(figure)


def _lay_out(figure: Figure) -> None:
    """Run the layout engine, without drawing."""
    engine = figure.get_layout_engine()
    if engine is None:
        figure.draw_without_rendering()
    else:
        engine.execute(figure)


def _keep_inside(figure: Figure) -> None:
    """Move anything that extends beyond the page back onto it."""
    box, (wide, high), engine = figure.get_tightbbox(), figure.get_size_inches(), figure.get_layout_engine()
    left, low = max(0.0, -box.x0) / wide, max(0.0, -box.y0) / high
    right, top = max(0.0, box.x1 - wide) / wide, max(0.0, box.y1 - high) / high
    if max(left, low, right, top) > 0.0 and isinstance(engine, ConstrainedLayoutEngine):
        engine.set(rect=(left, low, 1.0 - left - right, 1.0 - low - top))
        _lay_out(figure)


def _wrap(figure: Figure) -> float:
    """Break titles and labels that are too long for their panel; return the height of the added lines in inches."""
    places = [(text, figure.bbox.width) for text in figure.texts]
    rows: dict[float, float] = {}
    for axes in figure.axes:
        own = [child for child in axes.get_children() if isinstance(child, Text) and child not in axes.texts]
        places += [(text, axes.bbox.width) for text in (*own, axes.xaxis.label)] + [
            (axes.yaxis.label, axes.bbox.height)
        ]
    for text, room in places:
        lines = _broken(text, room)
        row = -1.0 if text.axes is None else round(text.axes.bbox.y0 / figure.bbox.height, 1)
        rows[row] = max(rows.get(row, 0.0), lines * 1.25 * float(text.get_fontsize()) / 72.0)
    return sum(rows.values())


def _broken(text: Text, room: float) -> int:
    """Break a text; return the number of added lines."""
    words, box = text.get_text(), text.get_window_extent()
    long = max(box.width, box.height) if text.get_rotation() else box.width
    if not words or not text.get_visible() or long <= room or "$" in words:
        return 0
    count = max(len(line) for line in words.split("\n"))
    lines = [part for line in words.split("\n") for part in textwrap.wrap(line, max(8, int(count * room / long)))]
    text.set_text("\n".join(lines))
    return len(lines) - words.count("\n") - 1


def _thin(figure: Figure) -> bool:
    """Remove ticks whose labels touch; return whether any were removed."""
    return [_thinned(axes, axis) for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)].count(True) > 0


def _thinned(axes: Axes, axis: Axis) -> bool:
    if not (axes.get_visible() and axes.axison) or isinstance(axis.get_major_locator(), FixedLocator):
        return False
    low, high = sorted(axis.get_view_interval())
    along = 0 if axis is axes.xaxis else 1
    shown = [text for text in axis.get_ticklabels() if text.get_text()]  # some or all are hidden on a shared axis
    boxes = [text.get_window_extent() for text in shown if low <= text.get_position()[along] <= high]
    if not any(box.overlaps(other) for box, other in pairwise(box.padded(_AIR_PX) for box in boxes)):
        return False
    if isinstance(axis.get_major_locator(), LogLocator):
        axis.set_major_locator(LogLocator(subs=(1.0, 3.0) if len(boxes) > _MANY else (1.0,)))
    else:
        axis.set_major_locator(MaxNLocator(max(1, len(boxes) - 2)))
    return True


def _uncrowded(figure: Figure) -> bool:
    """Hide notes that overlap earlier ones in a panel; return whether any were hidden."""
    hidden = False
    for axes in figure.axes:
        shown: list[Bbox] = []
        for note in axes.texts:
            x0, y0, x1, y1 = note.get_window_extent().extents
            box = Bbox.from_extents(x0 - _APART_PX, y0, x1 + _APART_PX, y1)
            if note.get_visible() and note.get_text() and box.count_overlaps(shown):
                note.set_visible(False)
                hidden = True
            elif note.get_visible() and note.get_text():
                shown.append(box)
    return hidden


def _clear(axes: Axes, panel: Sequence[Axes], outside: set[Axes]) -> bool:
    """Move a legend away from the data, to a free corner or else below its axes; return whether it was moved below."""
    legend = axes.get_legend()
    if legend is None or axes in outside or not covers_data(legend, panel, references=True):
        return False
    for references in (True, False):  # preferably away from reference lines
        for place in _CODES:
            legend.set_loc(place)
            if not covers_data(legend, panel, references=references):
                if not references:
                    legend.set_frame_on(True)
                    legend.get_frame().set(facecolor="white", alpha=1.0, linewidth=0.0)
                return False
    outside.add(axes)
    _below(axes, legend)
    return True


def _below(axes: Axes, legend: Legend) -> None:
    """Place the legend below the axes and their labels, in as many columns as fit."""
    figure = axes.get_figure(root=True)
    assert figure is not None  # noqa: S101  it has been drawn
    by_label = {label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    room, wide = axes.bbox.width, legend.get_window_extent().width
    labels = [text.get_text() for text in legend.get_texts()]
    across = max(1, min(len(labels), int(room / wide)))
    if wide > room:
        most = max(8, int(max(map(len, labels)) * (room / wide) ** 1.3))
        by_label = {"\n".join(textwrap.wrap(label, most)): by_label[label] for label in labels}
        labels = list(by_label)
    ticks = axes.xaxis.get_tightbbox() if axes.axison else None
    drop_in = 0.06 + (0.0 if ticks is None else max(0.0, axes.bbox.y0 - ticks.y0) / figure.dpi)
    shift = ScaledTranslation(0.0, -drop_in, figure.dpi_scale_trans)
    axes.legend(
        [by_label[label] for label in labels], labels, ncols=across, title=legend.get_title().get_text() or None,
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

    With ``references``, unlabelled lines across the panel, such as a zero line, count too.
    """
    box, within = legend.get_window_extent(), panel[0].bbox.padded(_AIR_PX)
    if box.x0 < within.x0 or box.x1 > within.x1 or box.y0 < within.y0 or box.y1 > within.y1:
        return True
    drawn = ((artist, axes) for axes in panel for artist in axes.get_children() if artist.get_visible())
    return any(_meets(artist, axes, box, references=references) for artist, axes in drawn)


def _meets(artist: Any, axes: Axes, box: Bbox, *, references: bool) -> bool:
    if isinstance(artist, Text):
        return bool(artist.get_text()) and artist.get_window_extent().overlaps(box)
    if isinstance(artist, AxesImage):
        return artist.get_window_extent().overlaps(box)
    if isinstance(artist, Line2D):
        named = not str(artist.get_label()).startswith("_")
        return (references or named or artist.get_transform() == axes.transData) and _line_meets(artist, box)
    if isinstance(artist, Patch):
        of_data = artist is not axes.patch and artist.get_data_transform().contains_branch(axes.transData)
        whole = artist.get_transform().transform_path(artist.get_path())
        return of_data and artist.get_alpha() is None and bool(whole.intersects_bbox(box, filled=True))
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
