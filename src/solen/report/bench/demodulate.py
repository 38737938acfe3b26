"""The demodulation figure: samples, readings, and ambient-light rejection."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.analysis.demodulation import OFF, Demodulation, gain, rejection_dB
from solen.analysis.demodulation.rejection import KERNELS, mean_gain
from solen.report.canvas import INK, LOST, SERIES, receiver, series

SHOWN_PERIODS = 12
MAX_POINTS = 4000


def demodulation_figure(result: Demodulation) -> Figure:
    """Draw an excerpt of the samples with the emitter states, all readings, and the rejection against frequency."""
    figure = Figure(figsize=(8.2, 5.2))
    grid = figure.add_gridspec(2, 2, width_ratios=(1.5, 1.0))
    _stretch(figure.add_subplot(grid[0, 0]), result)
    _rejection(figure.add_subplot(grid[0, 1]), result)
    _readings(figure.add_subplot(grid[1, :]), result)
    figure.suptitle(f"{'simulated: ' if result.simulated else ''}{result.sources[0].file}")
    return figure


def _stretch(axes: Axes, result: Demodulation) -> None:
    """Draw a few periods: dots for the samples used (filled: on, open: off), crosses for those taken while settling."""
    samples, readings = result.samples, result.readings
    period = readings.period_s if np.isfinite(readings.period_s) else 1.0
    middle = float(readings.time_s[len(readings.time_s) // 2])
    here = np.abs(samples.time_s - middle) <= 0.5 * SHOWN_PERIODS * period / max(1, len(readings.emitters))
    time, state = 1e3 * (samples.time_s[here] - samples.time_s[here][0]), samples.state[here]
    column = samples.values[here, 0]
    axes.plot(time, column, color=LOST, lw=0.6)
    for label, chosen, marker, face in (
        ("on", state > OFF, "o", SERIES[0]),
        ("off", state == OFF, "o", "white"),
        ("settling, left out", state < OFF, "x", LOST),
    ):
        edge = LOST if marker == "x" else SERIES[0]
        axes.plot(time[chosen], column[chosen], marker, ms=3, mfc=face, mec=edge, mew=0.8, label=label)
    name, unit = samples.names[0], samples.units[0]
    axes.set(xlabel=f"time (ms) from {samples.time_s[here][0]:.3f} s", ylabel=_labelled(name, unit))
    axes.legend()


def _readings(axes: Axes, result: Demodulation) -> None:
    kept, samples, many = result.switched.kept, result.samples, len(result.readings.emitters) > 1
    number = 0
    for place, channel in enumerate(samples.names):
        for emitter in result.readings.emitters:
            here = np.flatnonzero(kept.emitter == emitter)
            here = here[:: max(1, len(here) // MAX_POINTS)]
            look = series(number) if many else receiver(channel, place)
            name = f"{channel}, emitter {emitter}" if many else channel
            axes.plot(kept.time_s[here], kept.signal[here, place], **look, lw=0.8, label=name)
            clipped = here[kept.clipped[here, place]]
            axes.plot(kept.time_s[clipped], kept.signal[clipped, place], "x", color=INK, ms=4)
            number += 1
    of_means = "" if result.means is None else f", means of {result.means.readings}"
    axes.set(xlabel="time (s)", ylabel=_labelled(f"on less off{of_means}", samples.units[0]))
    axes.legend()


def _rejection(axes: Axes, result: Demodulation) -> None:
    period, means = result.readings.period_s, result.means
    if not np.isfinite(period):
        axes.set_axis_off()
        return
    hz, slot_s = np.linspace(0.5, min(150.0, 0.99 / period), 600), result.switched.slot_s
    for one, style in zip(KERNELS, ("-", "--"), strict=True):
        axes.plot(hz, rejection_dB(gain(hz, period, slot_s, one)), style, color=SERIES[0], lw=1.3, label=one)
    if means is not None:
        both = gain(hz, period, slot_s, result.options.kernel) * mean_gain(hz, period, means.readings)
        axes.plot(
            hz, rejection_dB(np.maximum(both, 1e-4)), color=SERIES[1], lw=1.0, label=f"and mean of {means.readings}"
        )
    axes.axhline(0.0, color=INK, lw=0.8)
    axes.set(xlabel="ambient light (Hz)", ylabel="rejection (dB)", ylim=(-8.0, 62.0))
    axes.legend()


def _labelled(name: str, unit: str) -> str:
    return f"{name} ({unit})" if unit else name
