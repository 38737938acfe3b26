"""The figure of layers against exposure: their transmittance over wavelength, and at some wavelengths over exposure."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure.exposures import ExposureTrends, Sample
from solen.report.canvas import SERIES

_FEW_POINTS = 20


def exposures_figure(trends: ExposureTrends) -> Figure:
    """Spectra, a colour for each exposure; values at some wavelengths against exposure, with their line."""
    figure = Figure(figsize=(9.0, 3.6))
    left, right = figure.subplots(1, 2)
    _spectra(left, trends.layers)
    _values(right, trends)
    if trends.simulated:
        figure.suptitle("simulated")
    return figure


def _spectra(axes: Axes, samples: Sequence[Sample]) -> None:
    seconds = sorted({sample.exposure_s for sample in samples})
    seen = set()
    for sample in samples:
        colour = SERIES[seconds.index(sample.exposure_s) % len(SERIES)]
        label = None if sample.exposure_s in seen else f"{sample.exposure_s:g} s"
        seen.add(sample.exposure_s)
        style = "o-" if sample.wavelength_nm.size < _FEW_POINTS else "-"
        axes.plot(sample.wavelength_nm, 100.0 * sample.transmittance, style, ms=3, lw=1.3, color=colour, label=label)
    axes.set(xlabel="wavelength (nm)", ylabel="transmittance (%)")
    axes.legend()


def _values(axes: Axes, trends: ExposureTrends) -> None:
    seconds = trends.exposure_s
    ends = np.array([seconds.min(), seconds.max()])
    for number, row in enumerate(trends.wavelengths):
        colour = SERIES[number % len(SERIES)]
        axes.plot(seconds, 100.0 * row.T, "o", ms=5, color=colour, label=f"{row.wavelength_nm:g} nm")
        if row.trend_T is not None:
            axes.plot(ends, 100.0 * row.trend_T.value(ends), "-", lw=1.0, color=colour)
    axes.set(xlabel="exposure (s)", ylabel="transmittance (%)", xlim=(0.0, None))
    axes.legend()
