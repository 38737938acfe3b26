"""The figure of layers against exposure: their transmittance over wavelength, and at some wavelengths over exposure."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure.exposure import Sample, trend
from solen.report.canvas import SERIES, STYLE

_FEW_POINTS = 20


def exposures_figure(samples: Sequence[Sample], wavelengths_nm: Sequence[float], simulated: bool) -> Figure:
    """Spectra, a colour for each exposure; values at some wavelengths against exposure, with their line."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        _spectra(left, samples)
        _values(right, samples, wavelengths_nm)
        if simulated:
            figure.suptitle("simulated", fontsize=9)
    return figure


def _spectra(axes: Axes, samples: Sequence[Sample]) -> None:
    seconds = sorted({one.exposure_s for one in samples})
    seen = set()
    for one in samples:
        colour = SERIES[seconds.index(one.exposure_s) % len(SERIES)]
        label = None if one.exposure_s in seen else f"{one.exposure_s:g} s"
        seen.add(one.exposure_s)
        style = "o-" if one.wavelength_nm.size < _FEW_POINTS else "-"
        axes.plot(one.wavelength_nm, 100.0 * one.transmittance, style, ms=3, lw=1.3, color=colour, label=label)
    axes.set(xlabel="wavelength (nm)", ylabel="transmittance (%)")
    axes.legend(fontsize=8)


def _values(axes: Axes, samples: Sequence[Sample], wavelengths_nm: Sequence[float]) -> None:
    seconds = np.array([one.exposure_s for one in samples])
    ends = np.array([seconds.min(), seconds.max()])
    for number, nm in enumerate(wavelengths_nm):
        colour = SERIES[number % len(SERIES)]
        t = np.array([float(np.interp(nm, one.wavelength_nm, one.transmittance)) for one in samples])
        axes.plot(seconds, 100.0 * t, "o", ms=5, color=colour, label=f"{nm:g} nm")
        line = trend(seconds, t)
        if line is not None:
            axes.plot(ends, 100.0 * line.value(ends), "-", lw=1.0, color=colour)
    axes.set(xlabel="exposure (s)", ylabel="transmittance (%)", xlim=(0.0, None))
    axes.legend(fontsize=8)
