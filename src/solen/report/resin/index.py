"""The figure of an index: transmittance, absorbance and index against wavelength, and what the index is."""

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.report.canvas import INK, LEFT, LOST, RIGHT, SOFT, SPACE, STYLE

TITLES = {
    "measured": "from R and T, both measured",
    "absorptance": "from T and absorptance, R = 1 − T − A",
    "as-published": "as published: R = 1 − T − A with A = −log10 T",
    "lossless": "from T alone, k = 0 assumed",
}
"""What each mode is, as a title says it."""

_NEAR = 0.2  # how far from n a band is still drawn


def index_figure(found: dict[str, Any]) -> Figure:
    """Three panels of an index result: T and R, absorbance and absorptance, n with its uncertainty and its masks."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.6, 3.4), layout="constrained")
        light, loss, index = figure.subplots(1, 3)
        nm = _array(found["wavelength_nm"])
        _draw_light(light, nm, found)
        _draw_loss(loss, nm, found)
        _draw_index(index, nm, found)
        for letter, axes in zip("ABC", (light, loss, index), strict=True):
            axes.set_xlabel("wavelength (nm)")
            axes.set_title(letter, loc="left", fontweight="bold")
        simulated = "simulated, " if any(one["simulated"] for one in found["sources"]) else ""
        layer = " of a layer on its substrate" if found.get("substrate") else ""
        figure.suptitle(f"{simulated}index{layer} {TITLES.get(found['mode'], found['mode'])}", fontsize=10)
    return figure


def _array(values: list[float | None]) -> FloatArray:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _style(nm: FloatArray) -> str:
    """A line, or dots where there are few points."""
    return "o" if nm.size < 12 else "-"


def _relative(found: dict[str, Any]) -> bool:
    """Whether T is the ratio to that of a bare substrate."""
    return bool(found["baseline"] == "substrate")


def _widened(low: float, high: float) -> tuple[float, float]:
    """Room for the legend above, and for what was not measured beside what was."""
    return low - 0.05 * (high - low), high + 0.55 * (high - low)


def _draw_light(axes: Axes, nm: FloatArray, found: dict[str, Any]) -> None:
    against = ", against the bare substrate" if _relative(found) else ""
    axes.plot(nm, _array(found["T"]), _style(nm), color=RIGHT, ms=3, lw=1.4, label=f"T{against}")
    if found["mode"] == "measured":
        axes.plot(nm, _array(found["R"]), _style(nm), color=LEFT, ms=3, lw=1.4, label="R")
    elif found["mode"] != "lossless":
        axes.plot(nm, _array(found["R"]), "--", color=LEFT, lw=1.2, label="R, by difference")
    low, high = axes.get_ylim()
    axes.set(ylabel="fraction", ylim=(min(low, 0.0), max(high, 1.0)))
    axes.legend(fontsize=8)


def _draw_loss(axes: Axes, nm: FloatArray, found: dict[str, Any]) -> None:
    t, r = _array(found["T"]), _array(found["R"])
    absorbance = -np.log10(np.where(t > 0.0, t, np.nan))
    axes.plot(nm, absorbance, _style(nm), color=RIGHT, ms=3, lw=1.4, label="absorbance −log10 T")
    if found["mode"] in {"measured", "absorptance"} and not found.get("substrate"):  # T and R of one baseline
        axes.plot(nm, 1.0 - r - t, _style(nm), color=SPACE, ms=3, lw=1.4, label="absorptance 1 − R − T")
        axes.legend(fontsize=8)
    axes.axhline(0.0, color=INK, lw=0.6)
    axes.set_ylabel("A, of two kinds" if axes.get_legend() else "absorbance −log10 T")


def _draw_index(axes: Axes, nm: FloatArray, found: dict[str, Any]) -> None:
    n, u = _array(found["n"]), _array(found["u_n"])
    colour = INK if found["measurement"] else LEFT
    if np.isfinite(u).any():
        axes.fill_between(nm, n - u, n + u, color=colour, alpha=0.18, lw=0, label="± u(n)")
    axes.plot(nm, n, _style(nm), color=colour, ms=3, lw=1.4, label="n")
    _draw_literature(axes, nm, found)
    limits = axes.get_ylim()
    if found["mode"] != "lossless":
        axes.plot(nm, _array(found["lossless"]["n"]), ":", color=LOST, lw=1.4, label="lossless, from T alone")
    _draw_fit(axes, found)
    axes.set_ylim(*_widened(*limits))
    _draw_masks(axes, nm, n)
    if not found["measurement"]:
        axes.set_title("no measurement: R made of T alone", loc="right", color=LEFT, fontsize=8, fontweight="bold")
    axes.set_ylabel("refractive index n")
    axes.legend(fontsize=7, loc="upper right")


def _draw_literature(axes: Axes, nm: FloatArray, found: dict[str, Any]) -> None:
    """Band of others' indices, where it is near enough to be on the same picture."""
    known, (least, most) = found.get("literature"), axes.get_ylim()
    if not known:
        return
    low, high = _array(known["low"]), _array(known["high"])
    if np.isfinite(low).any() and np.nanmin(low) < most + _NEAR and np.nanmax(high) > least - _NEAR:
        label = f"literature: {', '.join(known['polymers'])}"
        axes.fill_between(nm, low, high, color=SOFT, alpha=0.6, lw=0, zorder=0, label=label)


def _draw_fit(axes: Axes, found: dict[str, Any]) -> None:
    fit = found.get("fit")
    if fit:
        nm, n, u = (_array(fit[key]) for key in ("wavelength_nm", "n", "u_n"))
        axes.plot(nm, n, color=SPACE, lw=1.4, label=f"{fit['kind']} fit{' ± u' if np.isfinite(u).any() else ''}")
        for edge in (n - u, n + u):
            axes.plot(nm, edge, "--", color=SPACE, lw=0.8)


def _draw_masks(axes: Axes, nm: FloatArray, n: FloatArray) -> None:
    """Marks at the lower edge where n is masked."""
    masked = ~np.isfinite(n)
    if masked.any():
        edge = axes.get_xaxis_transform()
        label = f"n masked ({int(masked.sum())} of {n.size})"
        axes.plot(nm[masked], np.full(int(masked.sum()), 0.015), "|", color=LEFT, ms=7, transform=edge, label=label)
