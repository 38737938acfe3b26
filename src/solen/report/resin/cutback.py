"""The cut-back figure: level against length, the line with its band, and outliers."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.loss import GuideLoss, Line, Piece
from solen.report.canvas import INK, LOST, series

_BAND = 0.15


def cutback_figure(loss: GuideLoss) -> Figure:
    """Draw guides as dots coloured by orientation; levels are relative to the launched power if it is known."""
    zero = 0.0 if loss.launched_dB is None else loss.launched_dB
    source = loss.sources[0]
    figure = Figure(figsize=(5.4, 3.8))
    axes = figure.add_subplot()
    ways = list(dict.fromkeys(piece.orientation for piece in loss.points))
    lines = {line.orientation: line for line in loss.by_orientation} or {"": loss}
    for number, way in enumerate(ways):
        look = series(number, dots=True)
        line = lines.get(way, lines.get(""))
        dots = [piece for piece in loss.points if piece.orientation == way]
        _dots(axes, dots, _label(way, line, loss), look, zero)
        if line is not None:
            _line(axes, line, loss, look["color"], zero)
    _crosses(axes, loss, zero)
    axes.set(
        xlabel="length (mm)",
        ylabel="level (dB)" + ("" if loss.launched_dB is None else ", relative to the launched power"),
    )
    axes.set_xlim(left=0.0)
    axes.legend()
    axes.set_title(f"{'simulated: ' if source.simulated else ''}{source.file}")
    return figure


def _label(way: str, line: Line | None, loss: GuideLoss) -> str:
    """Return the orientation and the loss from the drawn line."""
    if line is None:
        return way
    low, high = line.interval95_loss_dB_per_cm
    name = f"{way}: " if loss.by_orientation else ""
    return f"{name}{line.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g}, 95 %)"


def _dots(axes: Axes, pieces: list[Piece], label: str, look: Mapping[str, Any], zero: float) -> None:
    axes.plot(
        [piece.length_mm for piece in pieces],
        [piece.level_dB - zero for piece in pieces],
        **look,
        ms=4,
        label=label,
    )


def _line(axes: Axes, line: Line, loss: GuideLoss, colour: str, zero: float) -> None:
    """Draw the line with its band, dashed from length zero to the shortest guide."""
    shortest = min(piece.length_mm for piece in loss.points)
    longest = max(piece.length_mm for piece in loss.points)
    mm = np.linspace(0.0, longest, 121)
    level, half = line.level_dB(mm) - zero, line.half_width_dB(mm)
    axes.fill_between(mm, level - half, level + half, color=colour, alpha=_BAND, lw=0)
    inside = mm >= shortest
    axes.plot(mm[~inside], level[~inside], "--", color=colour, lw=1.0)
    axes.plot(mm[inside], level[inside], "-", color=colour, lw=1.4)


def _crosses(axes: Axes, loss: GuideLoss, zero: float) -> None:
    for number, outlier in enumerate(loss.outliers):
        at = (outlier.piece.length_mm, outlier.piece.level_dB - zero)
        axes.plot(*at, "x", ms=9, mew=1.6, color=INK, label="outlier, set aside" if number == 0 else None)
        axes.annotate(outlier.piece.guide, at, xytext=(6, 4), textcoords="offset points", fontsize="small", color=LOST)
