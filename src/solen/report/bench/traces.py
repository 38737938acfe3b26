"""Voltages over time with the detected cycles, as in the paper's figure S6.

Holds, which are not used, are grey; cycles that are not used are hatched. Long recordings are drawn as the minimum and
maximum of each interval, so that every peak remains visible.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis import Run, SensorResponse, Study
from solen.arrays import FloatArray
from solen.report.bench.analyse import add_title, label_of, title_of
from solen.report.canvas import INK, LOST, SOFT, receiver

_POINTS = 2400
_MAX_ROWS = 12
_MAX_HOLDS = 400


def traces_figure(study: Study) -> Figure:
    """Draw a row for each recording: voltages, the angle on a second axis, and the cycles and holds."""
    rows = [(sensor, run) for sensor in study.sensors.values() for run in sensor.runs]
    drawn = rows[:_MAX_ROWS]
    figure = Figure(figsize=(10.0, 2.5 * len(drawn) + 0.4))
    axes = figure.subplots(len(drawn), 1, squeeze=False, sharey=True).ravel()
    for panel, (sensor, run) in zip(axes, drawn, strict=True):
        _draw(panel, sensor, run)
    axes[-1].set_xlabel("time (s)")
    omission = f"first {_MAX_ROWS} of {len(rows)} recordings" if len(rows) > _MAX_ROWS else ""
    add_title(figure, study.simulated, study.smoothing, omission)
    return figure


def _draw(axes: Axes, response: SensorResponse, run: Run) -> None:
    signals = run.signals
    for index, name in enumerate(signals.receivers):
        axes.plot(*_thinned(signals.time_s, signals.volts[:, index]), **receiver(name, index), lw=0.8, label=name)
        clipped = np.flatnonzero(run.clipped[:, index])
        if clipped.size:
            rows = clipped[:: max(1, clipped.size // _POINTS)]
            axes.plot(signals.time_s[rows], signals.volts[rows, index], "x", color=INK, ms=3, label="clipped")
    _draw_motion(axes, run)
    angle_axes = axes.twinx()
    angle_axes.plot(*_thinned(signals.time_s, signals.angle_deg), color=INK, lw=0.7, alpha=0.5)
    angle_axes.set_ylabel(f"{signals.stimulus.label}, thin line")
    angle_axes.grid(visible=False)
    angle_axes.spines["right"].set_visible(True)
    axes.set_ylabel(label_of(signals.unit))
    axes.set_xlim(signals.time_s[0], signals.time_s[-1])
    file = f", {signals.source}" if len(response.runs) > 1 else ""
    axes.set_title(f"{title_of(response)}{file}; grey: holds, not used; hatched: cycles not used", loc="left")
    handles, names = axes.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    axes.legend(unique.values(), unique.keys())


def _draw_motion(axes: Axes, run: Run) -> None:
    time_s = run.signals.time_s
    for start, stop in run.motion.holds[:_MAX_HOLDS]:
        axes.axvspan(time_s[start], time_s[stop - 1], color=SOFT, alpha=0.7, lw=0, zorder=0)
    _, top = axes.get_ylim()
    cycles = run.motion.cycles
    for index, cycle in enumerate(cycles[: _MAX_HOLDS // 2]):
        axes.axvline(cycle.start_s, color=INK, lw=0.7, ls=":")
        if len(cycles) <= 30:
            axes.text(cycle.start_s, top, f" {index + 1}", va="top", color=INK)
        if index not in run.used:
            axes.axvspan(cycle.start_s, cycle.end_s, fc="none", ec=LOST, hatch="///", lw=0, alpha=0.5, zorder=0)


def _thinned(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the minimum and maximum of each interval in chronological order."""
    size = values.size // _POINTS
    if size < 4:
        return time_s, values
    count = values.size // size * size
    blocks = values[:count].reshape(-1, size)
    rows = np.arange(len(blocks)) * size
    extremes = np.sort(np.concatenate([rows + blocks.argmin(axis=1), rows + blocks.argmax(axis=1)]))
    return time_s[extremes], values[extremes]
