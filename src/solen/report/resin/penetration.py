"""The figure of a penetration depth: what the resin absorbs beside what the lamp sends, and the light that is left."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.arrays import FloatArray
from solen.material.cure.colour import Attenuation
from solen.recording import Provenance
from solen.report.canvas import INK, LEFT, LOST, RIGHT, STYLE

_BESIDE_NM = 60.0  # shown on both sides of the lamp
_DEPTHS = 3.0  # penetration depths that are shown
_HIGHEST_UM = 2000.0


def penetration_figure(
    nm: FloatArray, absorbance: FloatArray, path_um: float, found: Attenuation | None, source: Provenance
) -> Figure:
    """Absorbance against wavelength; where a lamp is known, its light against depth in a second panel."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.8 if found is None else 9.0, 3.6), layout="constrained")
        panels = figure.subplots(1, 1 if found is None else 2, squeeze=False)[0]
        panels[0].plot(nm, absorbance, color=INK, lw=1.4, label=f"absorbance, {path_um:g} µm")
        panels[0].set(xlabel="wavelength (nm)", ylabel="absorbance (base 10)")
        if found is not None:
            _lamp(panels[0], found, float(np.nanmax(absorbance)))
            _depth(panels[1], found)
        panels[0].legend(fontsize=8)
        figure.suptitle(f"{'simulated: ' if source.simulated else ''}{source.file}", fontsize=9)
    return figure


def _lamp(axes: Axes, found: Attenuation, highest: float) -> None:
    nm = found.wavelength_nm
    if len(nm) == 1:
        axes.axvline(float(nm[0]), color=RIGHT, lw=1.4, label="lamp")
    else:
        density = found.weight / np.gradient(nm)
        axes.fill_between(nm, 0.0, density / density.max() * highest, color=RIGHT, alpha=0.25, lw=0, label="lamp")
    axes.set_xlim(float(nm[0]) - _BESIDE_NM, float(nm[-1]) + _BESIDE_NM)


def _depth(axes: Axes, found: Attenuation) -> None:
    """Share of the light against depth, with the exponential that starts as it does."""
    surface = found.local_um()
    um = np.linspace(0.0, min(_DEPTHS * surface, _HIGHEST_UM), 201)
    axes.plot(um, found.share(um), color=RIGHT, lw=1.6, label="lamp's light")
    axes.plot(um, np.exp(-um / surface), "--", color=LEFT, lw=1.2, label=f"Dp = {surface:.3g} µm, as at the surface")
    local = [found.local_um(float(z)) for z in um]
    beside = axes.twinx()
    beside.plot(um, local, ":", color=LOST, lw=1.4)
    beside.set_ylabel("local Dp (µm), dotted")
    beside.grid(visible=False)
    beside.set_ylim(0.0, None)
    axes.set(yscale="log", xlabel="depth (µm)", ylabel="share of the light")
    axes.yaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(mpl.ticker.NullFormatter())
    axes.legend(fontsize=8, loc="lower left")
