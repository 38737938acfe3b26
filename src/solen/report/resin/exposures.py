"""The exposure figure: transmittance against wavelength, and against exposure at some wavelengths."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure.exposures import ExposureTrends, Sample
from solen.report.canvas import MARKERS, draw_repeats, series

_FEW_POINTS = 20


def exposures_figure(trends: ExposureTrends) -> Figure:
    """Draw spectra by exposure (repeat measurements as mean ± SD), and transmittance against exposure."""
    figure = Figure(figsize=(9.0, 3.6))
    left, right = figure.subplots(1, 2)
    _draw_spectra(left, trends.layers)
    _draw_trends(right, trends)
    if trends.simulated:
        figure.suptitle("simulated")
    return figure


def _draw_spectra(axes: Axes, samples: Sequence[Sample]) -> None:
    for number, seconds in enumerate(sorted({sample.exposure_s for sample in samples})):
        group = [sample for sample in samples if sample.exposure_s == seconds]
        marker = MARKERS[number % len(MARKERS)] if group[0].wavelength_nm.size < _FEW_POINTS else ""
        curves = [(sample.wavelength_nm, 100.0 * sample.transmittance) for sample in group]
        draw_repeats(axes, curves, number, f"{seconds:g} s", marker=marker, ms=3, lw=1.3)
    axes.set(xlabel="wavelength (nm)", ylabel="transmittance (%)")
    axes.legend()


def _draw_trends(axes: Axes, trends: ExposureTrends) -> None:
    seconds = trends.exposure_s
    ends = np.array([seconds.min(), seconds.max()])
    for number, row in enumerate(trends.wavelengths):
        axes.plot(seconds, 100.0 * row.T, **series(number, dots=True), ms=5, label=f"{row.wavelength_nm:g} nm")
        if row.trend_T is not None:
            axes.plot(ends, 100.0 * row.trend_T.value(ends), **series(number), lw=1.0)
    axes.set(xlabel="exposure (s)", ylabel="transmittance (%)", xlim=(0.0, None))
    axes.legend()
