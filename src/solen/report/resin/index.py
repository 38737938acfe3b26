"""The index figure: transmittance, absorbance and index against wavelength."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.material.index.fit import Fit
from solen.material.index.layer import LayerIndex
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SOFT, SPACE

TITLES = {
    "measured": "from R and T, both measured",
    "absorptance": "from T and absorptance, R = 1 − T − A",
    "as-published": "as published: R = 1 − T − A with A = −log10 T",
    "lossless": "from T alone, k = 0 assumed",
    "joint": "fitted jointly with its bare substrate",
    "fringes": "from levels and fringes of its spectra",
}
"""Titles, keyed by mode."""

_MAX_DISTANCE = 0.2  # largest distance from n at which the range of the literature is drawn


def index_figure(index: LayerIndex) -> Figure:
    """Draw T and R, absorbance and absorptance, and n with its uncertainty and masks in three panels."""
    figure = Figure(figsize=(9.6, 3.4))
    light, loss, n = figure.subplots(1, 3)
    nm = index.wavelength_nm
    _draw_light(light, nm, index)
    _draw_loss(loss, nm, index)
    _draw_index(n, nm, index)
    for axes in (light, loss, n):
        axes.set_xlabel("wavelength (nm)")
    simulated = "simulated, " if index.simulated else ""
    layer = " of a layer on its substrate" if index.options.substrate else ""
    figure.suptitle(f"{simulated}index{layer} {TITLES.get(index.mode, index.mode)}")
    return figure


def _style(nm: FloatArray, number: int = 0) -> str:
    """Return the style of the first or second curve: a line, or dots if there are few points."""
    return ("o", "s")[number] if nm.size < 12 else ("-", "--")[number]


def _widened(low: float, high: float) -> tuple[float, float]:
    """Return axis limits with room for the legend at the top."""
    return low - 0.05 * (high - low), high + 0.55 * (high - low)


def _draw_light(axes: Axes, nm: FloatArray, index: LayerIndex) -> None:
    reference = ", relative to the bare substrate" if index.baseline == "substrate" else ""
    if np.isfinite(index.T).any():
        axes.plot(nm, index.T, _style(nm), color=RIGHT, ms=3, lw=1.4, label=f"T{reference}")
    if index.mode in {"measured", "fringes", "joint"} and np.isfinite(index.R).any():
        axes.plot(nm, index.R, _style(nm, 1), color=LEFT, ms=3, lw=1.4, label="R")
    elif index.mode not in {"lossless", "fringes", "joint"}:
        axes.plot(nm, index.R, ":", color=LEFT, lw=1.4, label="R, by difference")
    low, high = axes.get_ylim()
    axes.set(ylabel="fraction", ylim=(min(low, 0.0), max(high, 1.0)))
    axes.legend()


def _draw_loss(axes: Axes, nm: FloatArray, index: LayerIndex) -> None:
    t, r = index.T, index.R
    absorbance = -np.log10(np.where(t > 0.0, t, np.nan))
    axes.plot(nm, absorbance, _style(nm), color=RIGHT, ms=3, lw=1.4, label="absorbance −log10 T")
    has_absorptance = index.mode in {"measured", "absorptance", "fringes"} and np.isfinite(r).any()
    if has_absorptance and not index.options.substrate:  # T and R have the same reference
        axes.plot(nm, 1.0 - r - t, _style(nm, 1), color=SPACE, ms=3, lw=1.4, label="absorptance 1 − R − T")
        axes.legend()
    axes.axhline(0.0, color=INK, lw=0.6)
    axes.set_ylabel("absorbance or absorptance" if axes.get_legend() else "absorbance −log10 T")


def _draw_index(axes: Axes, nm: FloatArray, index: LayerIndex) -> None:
    n, u = index.n, index.u_n
    colour = INK if index.measurement else LEFT
    if np.isfinite(u).any():
        axes.fill_between(nm, n - u, n + u, color=colour, alpha=0.18, lw=0, label="± u(n)")
    axes.plot(nm, n, _style(nm), color=colour, ms=3, lw=1.4, label="n")
    _draw_literature(axes, nm, index)
    limits = axes.get_ylim()
    if index.mode not in {"lossless", "fringes", "joint"}:
        axes.plot(nm, index.lossless_n, ":", color=LOST, lw=1.4, label="lossless, from T alone")
    _draw_fit(axes, index.fit)
    axes.set_ylim(*_widened(*limits))
    _draw_masks(axes, nm, n)
    if not index.measurement:
        axes.set_title("R computed from T, not measured", loc="right", color=LEFT, fontweight="bold")
    axes.set_ylabel("refractive index n")
    axes.legend()


def _draw_literature(axes: Axes, nm: FloatArray, index: LayerIndex) -> None:
    """Draw the range of published indices if it is close to the measured ones."""
    literature, (bottom, top) = index.literature, axes.get_ylim()
    if literature is None:
        return
    low, high = literature.low, literature.high
    if np.isfinite(low).any() and np.nanmin(low) < top + _MAX_DISTANCE and np.nanmax(high) > bottom - _MAX_DISTANCE:
        label = f"literature: {', '.join(literature.polymers)}"
        axes.fill_between(nm, low, high, color=SOFT, alpha=0.6, lw=0, zorder=0, label=label)


def _draw_fit(axes: Axes, fit: Fit | None) -> None:
    if fit is None:
        return
    nm, n, u = fit.wavelength_nm, fit.n, fit.u_n
    axes.plot(nm, n, "-.", color=SPACE, lw=1.4, label=f"{fit.kind} fit{' ± u' if np.isfinite(u).any() else ''}")
    for edge in (n - u, n + u):
        axes.plot(nm, edge, "--", color=SPACE, lw=0.8)


def _draw_masks(axes: Axes, nm: FloatArray, n: FloatArray) -> None:
    """Draw marks at the lower edge of the panel where n is masked."""
    masked = ~np.isfinite(n)
    if masked.any():
        edge = axes.get_xaxis_transform()
        label = f"n masked ({int(masked.sum())} of {n.size})"
        axes.plot(nm[masked], np.full(int(masked.sum()), 0.015), "|", color=LEFT, ms=7, transform=edge, label=label)
