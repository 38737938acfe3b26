"""The figure of a file's spectra, with a panel for each quantity and unit."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from solen.recording import Spectrum
from solen.recording.spectrum import Listing
from solen.report.canvas import draw_repeats

_NUMBER = re.compile(r"[\s_#-]*\d+$")
_NAMED = 14
"""A legend names up to this many traces; if there are more, it names only the first and the last."""


def spectra_figure(listing: Listing) -> Figure:
    """Draw spectra over wavelength, different kinds (transmittance, absorbance) side by side."""
    kinds: dict[tuple[str, str], dict[str, list[Spectrum]]] = {}
    for label, spectrum in zip(_labels(listing), listing.spectra, strict=True):
        kind = kinds.setdefault((spectrum.channel.quantity, spectrum.channel.unit), {})
        kind.setdefault(label, []).append(spectrum)
    figure = Figure(figsize=(4.6 * len(kinds), 3.6))
    panels = figure.subplots(1, len(kinds), squeeze=False)[0]
    for axes, ((quantity, unit), traces) in zip(panels, kinds.items(), strict=True):
        _draw(axes, traces)
        axes.set(xlabel="wavelength (nm)", ylabel=_label(quantity, unit))
    source, *others = listing.sources
    what = "simulated" if listing.simulated else " ".join(filter(None, (source.instrument, source.date)))
    figure.suptitle(listing.file + (f": {what}" if what and (listing.simulated or not others) else ""))
    return figure


def _labels(listing: Listing) -> list[str]:
    """Return the trace names without repeat numbers, with their files if there are several."""
    several = len(listing.sources) > 1
    names = [_NUMBER.sub("", trace.name) if listing.repeats else trace.name for trace in listing.traces]
    alone = len(set(names)) == 1  # a name common to all files is not informative
    stems = [Path(trace.file).stem for trace in listing.traces]
    if not several:
        return names
    return stems if alone else [f"{stem}, {name}" for stem, name in zip(stems, names, strict=True)]


def _draw(axes: Axes, traces: Mapping[str, Sequence[Spectrum]]) -> None:
    """Draw traces of one kind by name; if there are many, use ordered shades of one colour to show drift."""
    many = len(traces) > _NAMED
    shades = mpl.colormaps["viridis"]
    for number, (name, alike) in enumerate(traces.items()):
        curves = [(trace.wavelength_nm, trace.channel.values) for trace in alike]
        label = name if not many or number in {0, len(traces) - 1} else None
        look: dict[str, Any] = {"marker": "o" if curves[0][0].size < 3 else "", "ms": 3, "lw": 1.4}
        if many:
            look |= {"color": shades(0.9 * number / (len(traces) - 1)), "ls": "-", "lw": 0.9}
        draw_repeats(axes, curves, number, label, **look)
    title = f"first and last\nof {len(traces)} traces" if many else None
    axes.legend(title=title)


def _label(quantity: str, unit: str) -> str:
    name = quantity or "values"
    return f"{name} ({unit})" if unit and unit != "1" else name
