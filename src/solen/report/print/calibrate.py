"""The calibration figure: measured minus nominal sizes of features, with the fitted model."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.fabricate.process import FittedFeature, PrinterCalibration
from solen.report.canvas import INK, LOST, SERIES


def calibration_figure(fit: PrinterCalibration) -> Figure:
    """Draw measured and modelled sizes minus nominal sizes, and the residuals, for each kind of feature."""
    figure = Figure(figsize=(9.6, 3.9))
    sizes, residuals = figure.subplots(1, 2)
    kinds = dict.fromkeys(feature.kind for feature in fit.features)
    for kind, colour in zip(kinds, SERIES, strict=False):
        features = [feature for feature in fit.features if feature.kind == kind]
        _draw_kind(sizes, residuals, kind, colour, sorted(features, key=lambda feature: feature.nominal_mm))
    for axes in (sizes, residuals):
        axes.axhline(0.0, color=LOST, lw=1.0)
        axes.set(xscale="log", xlabel="nominal size (mm)")
    sizes.set(ylabel="measured − nominal (µm)")
    residuals.set(ylabel="measured − modelled (µm)")
    sizes.plot([], [], color=INK, lw=1.2, label="model")
    sizes.legend()
    numbers = ", ".join(f"{number.key} {number.value:.3g} ± {number.u:.2g}" for number in fit.numbers)
    figure.suptitle(f"{'simulated: ' if fit.simulated else ''}{numbers}; residual {fit.rms_um:.2g} µm RMS")
    return figure


def _draw_kind(sizes: Axes, residuals: Axes, kind: str, colour: str, features: list[FittedFeature]) -> None:
    nominal, measured, u, printed = np.array(
        [(feature.nominal_mm, feature.measured_mm, feature.u_measured_mm, feature.printed_mm) for feature in features]
    ).T
    style: dict[str, Any] = {"fmt": "o", "ms": 4, "lw": 1.0, "color": colour}
    sizes.errorbar(nominal, 1e3 * (measured - nominal), 2e3 * u, label=f"{kind}s, ± 2 u", **style)
    sizes.plot(nominal, 1e3 * (printed - nominal), color=colour, lw=1.2)
    residuals.errorbar(nominal, 1e3 * (measured - printed), 2e3 * u, **style)
