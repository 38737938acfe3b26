"""Figures of recorded networks: signals over each motion, and decoded against true angles for held-out states."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.network.calibrate import HeldOut, NetworkCalibrations
from solen.analysis.network.states import NetworkStates
from solen.arrays import FloatArray
from solen.report.bench.analyse import label_of, state_origin
from solen.report.canvas import INK, LOST, SOFT, series

_DRAWN = 600


def states_figure(result: NetworkStates) -> Figure:
    """Draw the signals at every stop in a panel for each motion and emitter; lines are means over the other motions."""
    rows, columns = len(result.motions), len(result.emitters)
    figure = Figure(figsize=(max(4.6, 3.1 * columns), 2.6 * rows + 0.4))
    panels = figure.subplots(rows, columns, squeeze=False, sharex="row", sharey="col")
    for motion, line in enumerate(panels):
        for lit, axes in enumerate(line):
            _draw_stops(axes, result, motion, lit)
            if motion == 0:
                axes.set_title(f"{result.emitters[lit]} lit", loc="left")
            axes.set_xlabel(f"{result.motions[motion]} (deg)")
        line[0].set_ylabel(label_of(result.unit))
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 4))
    state_origin(figure, result.simulated, "")
    return figure


def _draw_stops(axes: Axes, result: NetworkStates, motion: int, lit: int) -> None:
    """Draw each receiver's signals at the stops, and their mean over the other motions."""
    angle, (states, every, _) = result.angle_deg[:, motion], result.states.merged()
    own, span = states[:, motion], max(float(np.ptp(states[:, motion])), 1e-9)
    places = np.rint(own / span * 200.0)
    for read, name in enumerate(result.receivers):
        look = series(read)
        signal, u = result.signal_V[:, lit, read], result.u_signal_V[:, lit, read]
        axes.errorbar(angle, signal, u, fmt=".", ms=3.0, lw=0.8, color=look["color"], alpha=0.6)
        column = every[:, lit * len(result.receivers) + read]
        means = [(own[places == one].mean(), column[places == one].mean()) for one in np.unique(places)]
        if len(means) < len(states):
            axes.plot(*np.array(means).T, **look, lw=1.2, label=name)
        else:
            axes.plot([], [], **look, lw=1.2, label=name)


def calibration_figure(result: NetworkCalibrations) -> Figure:
    """Draw decoded against true angles and the errors with bands for held-out states, in one row for each motion."""
    made = result.calibration
    figure = Figure(figsize=(8.4, 2.9 * len(made.motions) + 0.3))
    panels = figure.subplots(len(made.motions), 2, squeeze=False)
    for place, (name, row) in enumerate(zip(made.motions, panels, strict=True)):
        if result.held_out is None:
            for axes in row:
                axes.text(0.5, 0.5, "not checked: too few states", ha="center", transform=axes.transAxes, color=LOST)
            continue
        check = made.checks[place]
        _draw_angles(row[0], result.held_out, place)
        row[0].set(xlabel=f"{name}, true (deg)", ylabel="decoded (deg)")
        row[0].set_title(f"{name}, states not fitted: rms {check.rms_deg:.2g}°", loc="left")
        _draw_errors(row[1], result.held_out, place)
        row[1].set(xlabel=f"{name}, true (deg)", ylabel="error (deg)")
        shares = f"{100 * check.within_68:.0f} and {100 * check.within_95:.0f} %"
        row[1].set_title(f"in the 68 and 95 % bands: {shares}", loc="left")
    state_origin(figure, result.simulated, "")
    return figure


def _some(left_out: HeldOut) -> FloatArray:
    count = len(left_out.angle_deg)
    return np.unique(np.linspace(0, count - 1, min(count, _DRAWN)).astype(int))


def _draw_angles(axes: Axes, left_out: HeldOut, motion: int) -> None:
    rows = _some(left_out)
    true = left_out.angle_deg[rows, motion]
    ends = [float(true.min()), float(true.max())]
    axes.plot(ends, ends, color=SOFT, lw=1.0)
    axes.plot(true, left_out.decoded.angle_deg[rows, motion], ".", ms=3.0, color=INK)


def _draw_errors(axes: Axes, left_out: HeldOut, motion: int) -> None:
    rows, decoded = _some(left_out), left_out.decoded
    true = left_out.angle_deg[rows, motion]
    low, high = (one[rows, motion, 1] - true for one in (decoded.low_deg, decoded.high_deg))
    axes.vlines(true, low, high, color=SOFT, lw=0.8)
    axes.plot(true, decoded.angle_deg[rows, motion] - true, ".", ms=3.0, color=INK)
    axes.axhline(0.0, color=INK, lw=0.6)
