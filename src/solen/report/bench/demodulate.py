"""The demodulation figure: samples, readings, and rejection of ambient light."""

from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.demodulation import OFF, Demodulation, gain, rejection_dB
from solen.analysis.demodulation.rejection import KERNELS, mean_gain
from solen.report.canvas import INK, LOST, SERIES, receiver, series

EXCERPT_PERIODS = 12
MAX_POINTS = 4000


def demodulation_figure(result: Demodulation) -> Figure:
    """Draw an excerpt of the samples with the emitter states, the rejection against frequency, and all readings."""
    figure = Figure(figsize=(8.2, 5.2))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    _excerpt(figure.add_subplot(grid[0, 0]), result)
    _rejection(figure.add_subplot(grid[0, 1]), result)
    _readings(figure.add_subplot(grid[1, :]), result)
    figure.suptitle(f"{'simulated: ' if result.simulated else ''}{result.sources[0].file}")
    return figure


def _excerpt(axes: Axes, result: Demodulation) -> None:
    """Draw a few periods: dots for the samples used (filled: on, open: off), crosses for the omitted samples."""
    samples, readings = result.samples, result.readings
    period = readings.period_s if np.isfinite(readings.period_s) else 1.0
    middle = float(readings.time_s[len(readings.time_s) // 2])
    rows = np.abs(samples.time_s - middle) <= 0.5 * EXCERPT_PERIODS * period / max(1, len(readings.emitters))
    start_s, state = samples.time_s[rows][0], samples.state[rows]
    time, column = 1e3 * (samples.time_s[rows] - start_s), samples.values[rows, 0]
    axes.plot(time, column, color=LOST, lw=0.6)
    for label, mask, marker, face in (
        ("on", state > OFF, "o", SERIES[0]),
        ("off", state == OFF, "o", "white"),
        ("settling, omitted", state < OFF, "x", LOST),
    ):
        edge = LOST if marker == "x" else SERIES[0]
        axes.plot(time[mask], column[mask], marker, ms=3, mfc=face, mec=edge, mew=0.8, label=label)
    axes.set(xlabel=f"time (ms) from {start_s:.3f} s", ylabel=_labelled(samples.names[0], samples.units[0]))
    axes.legend()


def _readings(axes: Axes, result: Demodulation) -> None:
    kept, samples, emitters = result.switched.kept, result.samples, result.readings.emitters
    for index, ((column, channel), emitter) in enumerate(product(enumerate(samples.names), emitters)):
        rows = np.flatnonzero(kept.emitter == emitter)
        rows = rows[:: max(1, len(rows) // MAX_POINTS)]
        style, label = receiver(channel, column), channel
        if len(emitters) > 1:
            style, label = series(index), f"{channel}, emitter {emitter}"
        axes.plot(kept.time_s[rows], kept.signal[rows, column], **style, lw=0.8, label=label)
        clipped = rows[kept.clipped[rows, column]]
        axes.plot(kept.time_s[clipped], kept.signal[clipped, column], "x", color=INK, ms=4)
    means = "" if result.means is None else f", means of {result.means.readings}"
    axes.set(xlabel="time (s)", ylabel=_labelled(f"on − off{means}", samples.units[0]))
    axes.legend()


def _rejection(axes: Axes, result: Demodulation) -> None:
    period, means = result.readings.period_s, result.means
    if not np.isfinite(period):
        axes.set_axis_off()
        return
    hz, slot_s = np.linspace(0.5, min(150.0, 0.99 / period), 600), result.switched.slot_s
    for kernel, style in zip(KERNELS, ("-", "--"), strict=True):
        axes.plot(hz, rejection_dB(gain(hz, period, slot_s, kernel)), style, color=SERIES[0], lw=1.3, label=kernel)
    if means is not None:
        both = gain(hz, period, slot_s, result.options.kernel) * mean_gain(hz, period, means.readings)
        label = f"averaged over {means.readings} readings"
        axes.plot(hz, rejection_dB(np.maximum(both, 1e-4)), color=SERIES[1], lw=1.0, label=label)
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set(xlabel="frequency of ambient light (Hz)", ylabel="rejection (dB)", ylim=(-8.0, 62.0))
    axes.legend()


def _labelled(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name
