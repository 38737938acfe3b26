"""The figure of a refractometer's index: what was measured, the curve through it with its band, and the literature."""

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.report.canvas import LEFT, RIGHT, SOFT, STYLE


def refractometer_figure(found: dict[str, Any], low: FloatArray, high: FloatArray, polymers: Sequence[str]) -> Figure:
    """Index against wavelength with its 95 % band, over that of the literature, from ``low`` to ``high``."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.0), layout="constrained")
        axes = figure.subplots()
        nm, n, u95 = (np.array(found[key], dtype=float) for key in ("wavelength_nm", "n", "u95_n"))
        names = " and ".join(f"{polymer}s" for polymer in polymers)
        axes.fill_between(nm, low, high, color=SOFT, lw=0, label=f"literature of {names}")
        axes.fill_between(nm, n - u95, n + u95, color=RIGHT, alpha=0.25, lw=0, label="95 %")
        axes.plot(nm, n, color=RIGHT, lw=1.6, label=f"n, Abbe number {_spread(found['dispersion'])}")
        values = found["values"]
        spread = 1.96 * np.array(values["u_n"])
        axes.errorbar(
            values["wavelength_nm"], values["n"], spread, fmt="o", color=LEFT, ms=4, capsize=3, label="measured"
        )
        axes.set(xlabel="wavelength (nm)", ylabel="refractive index n", xlim=(nm[0], nm[-1]))
        axes.legend(fontsize=8)
        line = found["line"]
        axes.set_title(f"n at 589.3 nm = {line['n']:.4f} ± {line['u_n']:.1g}, the rest by dispersion", fontsize=10)
    return figure


def _spread(shape: dict[str, Any]) -> str:
    return f"{shape['abbe']:.0f} ± {shape['u_abbe']:.0f}"
