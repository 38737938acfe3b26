"""The figure of a calibration: how much larger features were measured than drawn, and what the model makes of them."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.fabricate.process import Feature, Fit
from solen.report.canvas import INK, LOST, SERIES, STYLE


def calibration_figure(fit: Fit, *, simulated: bool) -> Figure:
    """Measured and printed less nominal sizes, and what is left, by kind."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.9), layout="constrained")
        sizes, rest = figure.subplots(1, 2)
        kinds = list(dict.fromkeys(one.kind for one in fit.features))
        for kind, colour in zip(kinds, SERIES, strict=False):
            chosen = [(one, size) for one, size in zip(fit.features, fit.printed_mm, strict=True) if one.kind == kind]
            _kind(sizes, rest, kind, colour, sorted(chosen, key=lambda pair: pair[0].nominal_mm))
        for axes in (sizes, rest):
            axes.axhline(0.0, color=LOST, lw=1.0)
            axes.set(xscale="log", xlabel="nominal size (mm)")
        sizes.set(ylabel="larger than drawn (µm)")
        rest.set(ylabel="measured less modelled (µm)")
        sizes.plot([], [], color=INK, lw=1.2, label="model")
        sizes.legend(fontsize=8)
        values = zip(fit.keys, fit.value, fit.u, strict=True)
        told = ", ".join(f"{key} {value:.3g} ± {u:.2g}" for key, value, u in values)
        figure.suptitle(f"{'simulated: ' if simulated else ''}{told}; rms {fit.rms_um:.2g} µm", fontsize=9)
    return figure


def _kind(sizes: Axes, rest: Axes, kind: str, colour: str, chosen: list[tuple[Feature, float]]) -> None:
    nominal = np.array([one.nominal_mm for one, _ in chosen])
    measured = np.array([one.measured_mm or np.nan for one, _ in chosen])
    u = np.array([one.u_mm or np.nan for one, _ in chosen])
    printed = np.array([size for _, size in chosen])
    marks: dict[str, Any] = {"fmt": "o", "ms": 4, "lw": 1.0, "color": colour}
    sizes.errorbar(nominal, 1e3 * (measured - nominal), 2e3 * u, label=f"{kind}s, ± 2 u", **marks)
    sizes.plot(nominal, 1e3 * (printed - nominal), color=colour, lw=1.2)
    rest.errorbar(nominal, 1e3 * (measured - printed), 2e3 * u, **marks)
