"""The figure of a penetration depth: absorbance of the resin, spectrum of the lamp, and light against depth."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.material.cure.penetration import Attenuation, Penetration
from solen.report.canvas import INK, LEFT, LOST, RIGHT

_MARGIN_NM = 60.0  # on both sides of the lamp's spectrum
_MAX_DEPTHS, _MAX_DEPTH_UM = 3.0, 2000.0  # largest depth in penetration depths and in µm


def penetration_figure(penetration: Penetration) -> Figure:
    """Draw absorbance against wavelength; if the lamp is known, draw its light against depth in a second panel."""
    decay, absorbance = penetration.attenuation, penetration.absorbance
    figure = Figure(figsize=(4.8 if decay is None else 9.0, 3.6))
    panels = figure.subplots(1, 1 if decay is None else 2, squeeze=False)[0]
    label = f"absorbance, {penetration.path_um:g} µm"
    panels[0].plot(penetration.wavelength_nm, absorbance, color=INK, lw=1.4, label=label)
    panels[0].set(xlabel="wavelength (nm)", ylabel="absorbance (base 10)")
    if decay is not None:
        _draw_lamp(panels[0], decay, float(np.nanmax(absorbance)))
        _draw_light(panels[1], decay)
    panels[0].legend()
    simulated = "simulated: " if penetration.simulated else ""
    figure.suptitle(f"{simulated}{penetration.sources[0].file}")
    return figure


def _draw_lamp(axes: Axes, decay: Attenuation, height: float) -> None:
    """Draw the spectrum of the lamp, scaled to a height."""
    nm = decay.wavelength_nm
    if len(nm) == 1:
        axes.axvline(float(nm[0]), color=RIGHT, lw=1.4, label="lamp")
    else:
        density = decay.weight / np.gradient(nm)
        axes.fill_between(nm, 0.0, density / density.max() * height, color=RIGHT, alpha=0.25, lw=0, label="lamp")
    axes.set_xlim(float(nm[0]) - _MARGIN_NM, float(nm[-1]) + _MARGIN_NM)


def _draw_light(axes: Axes, decay: Attenuation) -> None:
    """Draw the transmitted fraction of the light against depth, and the exponential with the same initial slope."""
    surface = decay.local_um()
    um = np.linspace(0.0, min(_MAX_DEPTHS * surface, _MAX_DEPTH_UM), 201)
    axes.plot(um, decay.transmitted(um), color=RIGHT, lw=1.6, label="light of the lamp")
    axes.plot(um, np.exp(-um / surface), "--", color=LEFT, lw=1.2, label=f"Dp = {surface:.3g} µm, as at the surface")
    twin = axes.twinx()
    twin.plot(um, [decay.local_um(float(depth)) for depth in um], ":", color=LOST, lw=1.4)
    twin.set_ylabel("local Dp (µm), dotted")
    twin.grid(visible=False)
    twin.set_ylim(0.0, None)
    axes.set(yscale="log", xlabel="depth (µm)", ylabel="fraction of the light")
    axes.yaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(mpl.ticker.NullFormatter())
    axes.legend()
