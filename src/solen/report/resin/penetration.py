"""The figure of a penetration depth: absorption of the resin, spectrum of the lamp, and the remaining light."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure.penetration import Attenuation, Penetration
from solen.report.canvas import INK, LEFT, LOST, RIGHT

_BESIDE_NM = 60.0  # shown on both sides of the lamp's band
_DEPTHS = 3.0  # penetration depths that are shown
_MAX_DEPTH_UM = 2000.0


def penetration_figure(penetration: Penetration) -> Figure:
    """Draw absorbance against wavelength; if the lamp is known, draw its light against depth in a second panel."""
    decay, absorbance = penetration.attenuation, penetration.absorbance
    figure = Figure(figsize=(4.8 if decay is None else 9.0, 3.6))
    panels = figure.subplots(1, 1 if decay is None else 2, squeeze=False)[0]
    label = f"absorbance, {penetration.path_um:g} µm"
    panels[0].plot(penetration.wavelength_nm, absorbance, color=INK, lw=1.4, label=label)
    panels[0].set(xlabel="wavelength (nm)", ylabel="absorbance (base 10)")
    if decay is not None:
        _lamp(panels[0], decay, float(np.nanmax(absorbance)))
        _depth(panels[1], decay)
    panels[0].legend()
    simulated = "simulated: " if penetration.simulated else ""
    figure.suptitle(f"{simulated}{penetration.sources[0].file}")
    return figure


def _lamp(axes: Axes, decay: Attenuation, highest: float) -> None:
    nm = decay.wavelength_nm
    if len(nm) == 1:
        axes.axvline(float(nm[0]), color=RIGHT, lw=1.4, label="lamp")
    else:
        density = decay.weight / np.gradient(nm)
        axes.fill_between(nm, 0.0, density / density.max() * highest, color=RIGHT, alpha=0.25, lw=0, label="lamp")
    axes.set_xlim(float(nm[0]) - _BESIDE_NM, float(nm[-1]) + _BESIDE_NM)


def _depth(axes: Axes, decay: Attenuation) -> None:
    """Draw the remaining fraction of the light against depth, with the exponential that has the same initial slope."""
    surface = decay.local_um()
    um = np.linspace(0.0, min(_DEPTHS * surface, _MAX_DEPTH_UM), 201)
    axes.plot(um, decay.share(um), color=RIGHT, lw=1.6, label="lamp's light")
    axes.plot(um, np.exp(-um / surface), "--", color=LEFT, lw=1.2, label=f"Dp = {surface:.3g} µm, as at the surface")
    local = [decay.local_um(float(z)) for z in um]
    beside = axes.twinx()
    beside.plot(um, local, ":", color=LOST, lw=1.4)
    beside.set_ylabel("local Dp (µm), dotted")
    beside.grid(visible=False)
    beside.set_ylim(0.0, None)
    axes.set(yscale="log", xlabel="depth (µm)", ylabel="fraction of the light")
    axes.yaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(mpl.ticker.NullFormatter())
    axes.legend()
