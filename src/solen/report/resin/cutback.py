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
    """Draw pieces as dots coloured by orientation; levels are relative to the launched power if it is known."""
    zero = 0.0 if loss.launched_dB is None else loss.launched_dB
    source = loss.sources[0]
    figure = Figure(figsize=(5.4, 3.8))
    axes = figure.add_subplot()
    orientations = list(dict.fromkeys(piece.orientation for piece in loss.points))
    lines = {line.orientation: line for line in loss.by_orientation} or {"": loss}
    for number, orientation in enumerate(orientations):
        style = series(number, dots=True)
        line = lines.get(orientation, lines.get(""))
        pieces = [piece for piece in loss.points if piece.orientation == orientation]
        _draw_pieces(axes, pieces, _label(orientation, line, loss), style, zero)
        if line is not None:
            _draw_line(axes, line, loss, style["color"], zero)
    _draw_outliers(axes, loss, zero)
    axes.set(
        xlabel="length (mm)",
        ylabel="level (dB)" + ("" if loss.launched_dB is None else ", relative to the launched power"),
    )
    axes.set_xlim(left=0.0)
    axes.legend()
    axes.set_title(f"{'simulated: ' if source.simulated else ''}{source.file}")
    return figure


def _label(orientation: str, line: Line | None, loss: GuideLoss) -> str:
    """Return the orientation and the loss of the drawn line."""
    if line is None:
        return orientation
    low, high = line.interval95_loss_dB_per_cm
    name = f"{orientation}: " if loss.by_orientation else ""
    return f"{name}{line.loss_dB_per_cm:.3g} dB/cm ({low:.3g} to {high:.3g}, 95 %)"


def _draw_pieces(axes: Axes, pieces: list[Piece], label: str, style: Mapping[str, Any], zero: float) -> None:
    lengths, levels = [piece.length_mm for piece in pieces], [piece.level_dB - zero for piece in pieces]
    axes.plot(lengths, levels, **style, ms=4, label=label)


def _draw_line(axes: Axes, line: Line, loss: GuideLoss, colour: str, zero: float) -> None:
    """Draw the line with its band, dashed from length zero to the shortest guide."""
    shortest, longest = loss.lengths_mm
    mm = np.linspace(0.0, longest, 121)
    level, half = line.level_dB(mm) - zero, line.half_width_dB(mm)
    axes.fill_between(mm, level - half, level + half, color=colour, alpha=_BAND, lw=0)
    measured = mm >= shortest
    axes.plot(mm[~measured], level[~measured], "--", color=colour, lw=1.0)
    axes.plot(mm[measured], level[measured], "-", color=colour, lw=1.4)


def _draw_outliers(axes: Axes, loss: GuideLoss, zero: float) -> None:
    for number, outlier in enumerate(loss.outliers):
        xy = (outlier.piece.length_mm, outlier.piece.level_dB - zero)
        axes.plot(*xy, "x", ms=9, mew=1.6, color=INK, label="excluded outlier" if number == 0 else None)
        axes.annotate(outlier.piece.guide, xy, xytext=(6, 4), textcoords="offset points", fontsize="small", color=LOST)
