"""Figures of recorded networks: signals against each motion, and decoded against true angles of held-out states."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.network.calibrate import HeldOut, NetworkCalibrations
from solen.analysis.network.states import NetworkStates
from solen.arrays import IndexArray
from solen.report.bench.analyse import add_title, label_of
from solen.report.canvas import INK, LOST, SOFT, series

_MAX_POINTS = 600


def states_figure(result: NetworkStates) -> Figure:
    """Draw the signals at every stop in a panel for each motion and emitter; lines are means over the other motions."""
    rows, columns = len(result.motions), len(result.emitters)
    figure = Figure(figsize=(max(4.6, 3.1 * columns), 2.6 * rows + 0.4))
    panels = figure.subplots(rows, columns, squeeze=False, sharex="row", sharey="col")
    for motion, row in enumerate(panels):
        for emitter, axes in enumerate(row):
            _draw_stops(axes, result, motion, emitter)
            if motion == 0:
                axes.set_title(f"{result.emitters[emitter]} on", loc="left")
            axes.set_xlabel(f"{result.motions[motion]} (deg)")
        row[0].set_ylabel(label_of(result.unit))
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4))
    add_title(figure, result.simulated)
    return figure


def _draw_stops(axes: Axes, result: NetworkStates, motion: int, emitter: int) -> None:
    """Draw each receiver's signals at the stops, and their mean over the other motions."""
    stops_deg, (states, signals, _) = result.angle_deg[:, motion], result.states.merged()
    angle = states[:, motion]
    group = np.rint(angle / max(float(np.ptp(angle)), 1e-9) * 200.0)
    for receiver, name in enumerate(result.receivers):
        style = series(receiver)
        signal, u = result.signal_V[:, emitter, receiver], result.u_signal_V[:, emitter, receiver]
        axes.errorbar(stops_deg, signal, u, fmt=".", ms=3.0, lw=0.8, color=style["color"], alpha=0.6)
        column = signals[:, emitter * len(result.receivers) + receiver]
        means = [(angle[group == n].mean(), column[group == n].mean()) for n in np.unique(group)]
        line = np.array(means if len(means) < len(states) else []).reshape(-1, 2)
        axes.plot(line[:, 0], line[:, 1], **style, lw=1.2, label=name)


def calibration_figure(result: NetworkCalibrations) -> Figure:
    """Draw decoded angles and errors with bands against true angles of held-out states, in a row for each motion."""
    motions = result.calibration.motions
    figure = Figure(figsize=(8.4, 2.9 * len(motions) + 0.3))
    panels = figure.subplots(len(motions), 2, squeeze=False)
    for index, (name, row) in enumerate(zip(motions, panels, strict=True)):
        if result.held_out is None:
            for axes in row:
                axes.text(0.5, 0.5, "not checked: too few states", ha="center", transform=axes.transAxes, color=LOST)
            continue
        check = result.calibration.checks[index]
        _draw_angles(row[0], result.held_out, index)
        row[0].set(xlabel=f"{name}, true (deg)", ylabel="decoded (deg)")
        row[0].set_title(f"{name}, held-out states: RMS error {check.rms_deg:.2g}°", loc="left")
        _draw_errors(row[1], result.held_out, index)
        row[1].set(xlabel=f"{name}, true (deg)", ylabel="error (deg)")
        fractions = f"{100 * check.within_68:.0f} and {100 * check.within_95:.0f} %"
        row[1].set_title(f"within the 68 and 95 % bands: {fractions}", loc="left")
    add_title(figure, result.simulated)
    return figure


def _drawn_rows(held_out: HeldOut) -> IndexArray:
    count = len(held_out.angle_deg)
    return np.unique(np.linspace(0, count - 1, min(count, _MAX_POINTS)).astype(np.intp))


def _draw_angles(axes: Axes, held_out: HeldOut, motion: int) -> None:
    rows = _drawn_rows(held_out)
    true = held_out.angle_deg[rows, motion]
    ends = [float(true.min()), float(true.max())]
    axes.plot(ends, ends, color=SOFT, lw=1.0)
    axes.plot(true, held_out.decoded.angle_deg[rows, motion], ".", ms=3.0, color=INK)


def _draw_errors(axes: Axes, held_out: HeldOut, motion: int) -> None:
    rows, decoded = _drawn_rows(held_out), held_out.decoded
    true = held_out.angle_deg[rows, motion]
    low, high = decoded.low_deg[rows, motion, 1] - true, decoded.high_deg[rows, motion, 1] - true
    axes.vlines(true, low, high, color=SOFT, lw=0.8)
    axes.plot(true, decoded.angle_deg[rows, motion] - true, ".", ms=3.0, color=INK)
    axes.axhline(0.0, color=INK, lw=0.6)
