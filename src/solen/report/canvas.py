"""How every figure looks, and a figure as the bytes of a file that are the same for the same numbers."""

import io
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

RIGHT, LEFT, LOST, INK, SOFT = "#0072B2", "#D55E00", "#9aa0a6", "#22272e", "#d9dde1"
SPACE, LOWER, HIGHER = "#009E73", "#56B4E9", "#CC79A7"
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#22272e")
"""Colours of things of one kind, distinguishable with colour vision deficiency too (Okabe and Ito)."""
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica Neue", "Arial", "DejaVu Sans"],
    "font.size": 9,
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
}


def svg(figure: Figure, salt: str) -> str:
    """SVG text of a figure; ``salt`` keeps its inner names apart from those of other figures on one page."""
    return encoded(figure, ".svg", salt).decode("utf-8")


def encoded(figure: Figure, suffix: str, salt: str) -> bytes:
    """A figure as the bytes of a file that ends in ``.svg``, ``.png`` or ``.pdf``; no date is in it."""
    data = io.BytesIO()
    with mpl.rc_context({**STYLE, "svg.hashsalt": f"solen-{salt}"}):
        if suffix == ".svg":  # savefig would draw it twice, once for the layout: the bytes are the same
            FigureCanvasSVG(figure).print_svg(data, metadata={"Date": None, "Creator": None})  # type: ignore[no-untyped-call]
        else:
            no_date = {"CreationDate": None} if suffix == ".pdf" else None
            figure.savefig(data, format=suffix[1:], dpi=200, metadata=no_date)
    return data.getvalue()
