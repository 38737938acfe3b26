"""The figure of the spectra that a file holds, a panel for each quantity and unit."""

from collections.abc import Sequence
from itertools import cycle

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.recording import Spectrum
from solen.recording.spectrum import Listing
from solen.report.canvas import SERIES

_NAMED = 14
"""Traces whose names a legend has room for; of more, the first and the last are named."""


def spectra_figure(listing: Listing) -> Figure:
    """Spectra over wavelength, side by side where they are of several kinds, as transmittance and absorbance are."""
    kinds: dict[tuple[str, str], list[Spectrum]] = {}
    for spectrum in listing.spectra:
        kinds.setdefault((spectrum.channel.quantity, spectrum.channel.unit), []).append(spectrum)
    figure = Figure(figsize=(4.6 * len(kinds), 3.6))
    panels = figure.subplots(1, len(kinds), squeeze=False)[0]
    for axes, ((quantity, unit), traces) in zip(panels, kinds.items(), strict=True):
        _draw(axes, traces)
        axes.set(xlabel="wavelength (nm)", ylabel=_label(quantity, unit))
    source = listing.sources[0]
    what = "simulated" if source.simulated else " ".join(filter(None, (source.instrument, source.date)))
    figure.suptitle(source.file + (f": {what}" if what else ""))
    return figure


def _draw(axes: Axes, traces: Sequence[Spectrum]) -> None:
    """Draw traces of one kind. Many traces are one colour's shades, in their order, so that a drift shows."""
    many = len(traces) > _NAMED
    colours = cycle(SERIES)
    shades = mpl.colormaps["viridis"]
    for number, trace in enumerate(traces):
        named = not many or number in {0, len(traces) - 1}
        colour = shades(0.9 * number / (len(traces) - 1)) if many else next(colours)
        marker = "o" if trace.channel.values.size < 3 else ""
        axes.plot(
            trace.wavelength_nm,
            trace.channel.values,
            marker=marker,
            lw=0.9 if many else 1.4,
            ms=3,
            color=colour,
            label=trace.channel.name if named else None,
        )
    title = f"first and last\nof {len(traces)} traces" if many else None
    axes.legend(title=title)


def _label(quantity: str, unit: str) -> str:
    name = quantity or "values"
    return f"{name} ({unit})" if unit and unit != "1" else name
