"""Style and encoding of figures; the bytes of a file depend only on the drawn values.

Each figure module draws with the colours and `series` below, at any size; `drawn` applies the style and fits the figure
to its page. `encoded` returns the bytes of the file.
"""

import io
import re
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.font_manager import fontManager

from solen.arrays import FloatArray
from solen.errors import SpecError
from solen.recording.column_roles import side_of
from solen.report.finish import finish, titles_of
from solen.report.options import FigureOptions

RIGHT, LEFT, LOST, INK, SOFT = "#0072B2", "#D55E00", "#9aa0a6", "#22272e", "#d9dde1"
SPACE, LOWER, HIGHER = "#009E73", "#56B4E9", "#CC79A7"
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#22272e")
"""Series colours that remain distinguishable with colour vision deficiency (Okabe and Ito)."""
LINES = ("-", (0, (5, 1.5)), (0, (1, 1)), (0, (6, 1.5, 1, 1.5)), (0, (3, 1)), (0, (6, 1, 1, 1, 1, 1)), (0, (9, 2)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
"""Dashes and markers for these series, so that they differ in more than colour."""
SIDES = {"right": (RIGHT, ">"), "left": (LEFT, "<")}
"""Colour and marker for the right and the left receiver."""
FONTS = ("Helvetica Neue", "Arial", "Liberation Sans", "DejaVu Sans")
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "pdf.fonttype": 42,  # text stays text, as journals require
    "ps.fonttype": 42,
    "font.family": "sans-serif",
    "font.sans-serif": list(FONTS),
    "font.size": 9,
    "axes.titlesize": "medium",
    "figure.titlesize": "medium",
    "legend.fontsize": "small",
    "legend.title_fontsize": "small",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": SOFT,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}


def series(number: int, *, dots: bool = False) -> dict[str, Any]:
    """Return the style for a series number: colour and dashes, or colour and marker."""
    index = number % len(SERIES)
    return {"color": SERIES[index]} | ({"marker": MARKERS[index], "ls": ""} if dots else {"ls": LINES[index]})


def receiver(name: str, index: int = 0) -> dict[str, Any]:
    """Return the style of a receiver curve: colour and marker of its side, or of a series index if it has no side."""
    side = SIDES.get(side_of(name) or "")
    colour, marker = side or (SERIES[2:][index % len(SERIES[2:])], MARKERS[1:][index % len(MARKERS[1:])])
    return {"color": colour, "marker": marker, "markevery": 0.13, "ms": 6.5, "mew": 0.0}


def draw_repeats(
    axes: Axes, curves: Sequence[tuple[FloatArray, FloatArray]], number: int, label: str | None, **style_options: Any
) -> None:
    """Draw repeated curves, each with x and y (n,), as thin lines, and their mean with a band of one SD."""
    options = series(number) | style_options
    if len(curves) == 1:
        axes.plot(*curves[0], **options, label=label)
        return
    low, high = max(float(np.min(x)) for x, _ in curves), min(float(np.max(x)) for x, _ in curves)
    x = np.unique(np.concatenate([xs[(xs >= low) & (xs <= high)] for xs, _ in curves]))
    rows = np.array([np.interp(x, xs[order], y[order]) for xs, y in curves for order in [np.argsort(xs)]])
    mean, sd = rows.mean(axis=0), rows.std(axis=0, ddof=1)
    for xs, y in curves:
        axes.plot(xs, y, color=options["color"], lw=0.4, alpha=0.4)
    axes.fill_between(x, mean - sd, mean + sd, color=options["color"], alpha=0.2, lw=0)
    axes.plot(x, mean, **options, label=None if label is None else f"{label}: mean ± SD of {len(curves)}")


def style(options: FigureOptions = FigureOptions()) -> dict[Any, Any]:
    """Return the matplotlib settings for the figure options; raise `SpecError` if the font is not installed."""
    installed = {font.name.casefold(): font.name for font in fontManager.ttflist}
    names = [name for name in FONTS if name.casefold() in installed]
    if options.font is not None:
        if options.font.casefold() not in installed:
            raise SpecError("--font", value=options.font, limit="is not installed", remedy="name an installed font")
        names.insert(0, installed[options.font.casefold()])
    return STYLE | {"font.size": options.size_pt, "font.sans-serif": names}


def drawn(draw: Callable[[], Figure], options: FigureOptions = FigureOptions()) -> Figure:
    """Return a figure in the common style, fitted to its page."""
    with mpl.rc_context(style(options)):
        return finish(draw(), options)


def svg(figure: Figure, salt: str) -> str:
    """Return a figure as SVG text; ``salt`` makes its internal identifiers unique on a page."""
    return encoded(figure, ".svg", salt).decode("utf-8")


def encoded(figure: Figure, suffix: str, salt: str, dpi: int = 200) -> bytes:
    """Return the bytes of a file of one of the `KINDS`, with the titles of the figure in the metadata and no date."""
    data, title = io.BytesIO(), titles_of(figure)
    with mpl.rc_context({**STYLE, "svg.hashsalt": f"solen-{salt}"}):
        if suffix == ".svg":  # savefig would draw it twice, once for the layout, with the same result
            metadata = {"Date": None, "Creator": None} | ({"Title": title} if title else {})
            FigureCanvasSVG(figure).print_svg(data, metadata=metadata)  # type: ignore[no-untyped-call]  # matplotlib's own
        elif suffix == ".pdf":
            figure.savefig(data, format="pdf", metadata={"CreationDate": None, "Title": title or None})
        elif suffix == ".eps":
            _without_transparency(figure)
            figure.savefig(data, format="eps")
            return re.sub(rb"%%(CreationDate|Title): .*\n", b"", data.getvalue())
        elif suffix == ".png":
            figure.savefig(data, format="png", dpi=dpi, metadata={"Title": title} if title else None)
        else:
            text = {"description": title.encode("ascii", "replace").decode()} if title else {}
            figure.savefig(data, format="tiff", dpi=dpi, pil_kwargs={"compression": "tiff_lzw", **text})
    return data.getvalue()


def _without_transparency(figure: Figure) -> None:
    """Blend translucent colours with white, because PostScript has no transparency and would draw them opaque."""
    for artist in _all(figure):
        for part in ("facecolor", "edgecolor", "color"):
            get_colour, set_colour = getattr(artist, f"get_{part}", None), getattr(artist, f"set_{part}", None)
            if get_colour is None or set_colour is None:
                continue
            colours = to_rgba_array(get_colour())
            if len(colours) and (colours[:, 3] < 1.0).any() and (colours[:, 3] > 0.0).any():
                colours[:, :3] = 1.0 - colours[:, 3:] * (1.0 - colours[:, :3])
                colours[:, 3] = colours[:, 3] > 0.0
                artist.set_alpha(None)
                set_colour(colours if len(colours) > 1 else tuple(colours[0]))


def _all(artist: Artist) -> Iterator[Artist]:
    yield artist
    for child in artist.get_children():
        yield from _all(child)
