"""The figure of a cut-back: level against length, the line, its band, and what was set aside."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.loss import CutBack, Line, Piece
from solen.recording import Provenance
from solen.report.canvas import INK, LOST, SERIES, STYLE

_BAND = 0.15


def cutback_figure(found: CutBack, full_dB: float | None, source: Provenance) -> Figure:
    """Pieces as dots, a colour for each orientation; levels count from what was launched where that is known."""
    zero = 0.0 if full_dB is None else full_dB
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(5.4, 3.8), layout="constrained")
        axes = figure.add_subplot()
        ways = list(dict.fromkeys(piece.orientation for piece in found.pieces))
        lines = {line.orientation: line for line in found.by_orientation} or {"": found.line}
        for number, way in enumerate(ways):
            colour = SERIES[number % len(SERIES)]
            line = lines.get(way, lines.get(""))
            dots = [piece for piece in found.pieces if piece.orientation == way]
            _dots(axes, dots, _label(way, line, found), colour, zero)
            if line is not None:
                _line(axes, line, found, colour, zero)
        _crosses(axes, found, zero)
        axes.set(xlabel="length (mm)", ylabel="level (dB)" + ("" if full_dB is None else ", from what was launched"))
        axes.set_xlim(left=0.0)
        axes.legend(fontsize=8)
        axes.set_title(f"{'simulated: ' if source.simulated else ''}{source.file}", fontsize=9)
    return figure


def _label(way: str, line: Line | None, found: CutBack) -> str:
    """Orientation, and the loss of the line that is drawn."""
    if line is None:
        return way
    low, high = line.interval95
    name = f"{way}: " if found.by_orientation else ""
    return f"{name}{line.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g}, 95 %)"


def _dots(axes: Axes, pieces: list[Piece], label: str, colour: str, zero: float) -> None:
    axes.plot(
        [piece.length_mm for piece in pieces],
        [piece.level_dB - zero for piece in pieces],
        "o",
        ms=4,
        color=colour,
        label=label,
    )


def _line(axes: Axes, line: Line, found: CutBack, colour: str, zero: float) -> None:
    """The line with its band, dashed from length zero to the shortest guide."""
    shortest = min(piece.length_mm for piece in found.pieces)
    longest = max(piece.length_mm for piece in found.pieces)
    mm = np.linspace(0.0, longest, 121)
    level, half = line.level_dB(mm) - zero, line.half_width_dB(mm)
    axes.fill_between(mm, level - half, level + half, color=colour, alpha=_BAND, lw=0)
    inside = mm >= shortest
    axes.plot(mm[~inside], level[~inside], "--", color=colour, lw=1.0)
    axes.plot(mm[inside], level[inside], "-", color=colour, lw=1.4)


def _crosses(axes: Axes, found: CutBack, zero: float) -> None:
    for number, bad in enumerate(found.set_aside):
        at = (bad.piece.length_mm, bad.piece.level_dB - zero)
        axes.plot(*at, "x", ms=9, mew=1.6, color=INK, label="set aside" if number == 0 else None)
        axes.annotate(bad.piece.guide, at, xytext=(6, 4), textcoords="offset points", fontsize=7, color=LOST)
