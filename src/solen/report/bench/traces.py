"""Voltages over time with the detected cycles, as in the paper's figure S6.

Cropped holds are grey and unused cycles are hatched. Long recordings are drawn as the minimum and maximum of each
interval, so that every peak remains visible.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis import Run, SensorResponse, Study
from solen.arrays import FloatArray
from solen.report.bench.analyse import label_of, state_origin, title_of
from solen.report.canvas import INK, LOST, SOFT, receiver

_POINTS = 2400
_MAX_ROWS = 12
_MAX_HOLDS = 400


def traces_figure(study: Study) -> Figure:
    """Draw a row for each recording: voltages, with the angle above them, and the cycles and holds."""
    rows = [(sensor, run) for sensor in study.sensors.values() for run in sensor.runs]
    shown = rows[:_MAX_ROWS]
    figure = Figure(figsize=(10.0, 2.5 * len(shown) + 0.4))
    axes = figure.subplots(len(shown), 1, squeeze=False, sharey=True).ravel()
    for panel, (one, run) in zip(axes, shown, strict=True):
        _draw(panel, one, run)
    axes[-1].set_xlabel("time (s)")
    more = f"first {_MAX_ROWS} of {len(rows)} recordings" if len(rows) > _MAX_ROWS else ""
    state_origin(figure, study.simulated, study.remark, more)
    return figure


def _draw(axes: Axes, response: SensorResponse, run: Run) -> None:
    signals = run.signals
    for place, name in enumerate(signals.receivers):
        axes.plot(*_thinned(signals.time_s, signals.volts[:, place]), **receiver(name, place), lw=0.8, label=name)
        flags = run.clipped[:, place]
        if flags.any():
            places = np.flatnonzero(flags)[:: max(1, int(flags.sum()) // _POINTS)]
            axes.plot(signals.time_s[places], signals.volts[places, place], "x", color=INK, ms=3, label="clipped")
    _draw_motion(axes, run)
    above = axes.twinx()
    above.plot(*_thinned(signals.time_s, signals.angle_deg), color=INK, lw=0.7, alpha=0.5)
    above.set_ylabel(f"{signals.stimulus.label}, thin")
    above.grid(visible=False)
    above.spines["right"].set_visible(True)
    axes.set_ylabel(label_of(signals.unit))
    axes.set_xlim(signals.time_s[0], signals.time_s[-1])
    several = f", {signals.source}" if len(response.runs) > 1 else ""
    axes.set_title(f"{title_of(response)}{several}; grey: holds, cropped; hatched: not averaged", loc="left")
    handles, names = axes.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    axes.legend(unique.values(), unique.keys())


def _draw_motion(axes: Axes, run: Run) -> None:
    time_s = run.signals.time_s
    for start, stop in run.motion.holds[:_MAX_HOLDS]:
        axes.axvspan(time_s[start], time_s[stop - 1], color=SOFT, alpha=0.7, lw=0, zorder=0)
    _, top = axes.get_ylim()
    cycles = run.motion.cycles
    for place, cycle in enumerate(cycles[: _MAX_HOLDS // 2]):
        axes.axvline(cycle.start_s, color=INK, lw=0.7, ls=":")
        if len(cycles) <= 30:
            axes.text(cycle.start_s, top, f" {place + 1}", va="top", color=INK)
        if place not in run.used:
            axes.axvspan(cycle.start_s, cycle.end_s, fc="none", ec=LOST, hatch="///", lw=0, alpha=0.5, zorder=0)


def _thinned(time_s: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the minimum and maximum of each interval in chronological order."""
    size = values.size // _POINTS
    if size < 4:
        return time_s, values
    count = values.size // size * size
    blocks = values[:count].reshape(-1, size)
    rows = np.arange(len(blocks)) * size
    places = np.sort(np.concatenate([rows + blocks.argmin(axis=1), rows + blocks.argmax(axis=1)]))
    return time_s[places], values[places]
