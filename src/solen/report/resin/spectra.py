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
_MAX_NAMES = 14
"""Maximum number of traces that a legend names; if there are more, it names only the first and the last."""


def spectra_figure(listing: Listing) -> Figure:
    """Draw spectra against wavelength, different quantities (transmittance, absorbance) side by side."""
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
    origin = "simulated" if listing.simulated else " ".join(filter(None, (source.instrument, source.date)))
    figure.suptitle(listing.file + (f": {origin}" if origin and (listing.simulated or not others) else ""))
    return figure


def _labels(listing: Listing) -> list[str]:
    """Return the name of each trace, without repeat numbers if repeats are averaged, and with its file if necessary."""
    names = [_NUMBER.sub("", trace.name) if listing.repeats else trace.name for trace in listing.traces]
    if len(listing.sources) == 1:
        return names
    stems = [Path(trace.file).stem for trace in listing.traces]
    has_common_name = len(set(names)) == 1  # the name is then not informative
    return stems if has_common_name else [f"{stem}, {name}" for stem, name in zip(stems, names, strict=True)]


def _draw(axes: Axes, traces: Mapping[str, Sequence[Spectrum]]) -> None:
    """Draw the traces of one quantity, keyed by label; many traces are drawn in a colour gradient, to show drift."""
    is_crowded = len(traces) > _MAX_NAMES
    colours = mpl.colormaps["viridis"]
    for number, (name, repeats) in enumerate(traces.items()):
        curves = [(trace.wavelength_nm, trace.channel.values) for trace in repeats]
        label = name if not is_crowded or number in {0, len(traces) - 1} else None
        style: dict[str, Any] = {"marker": "o" if curves[0][0].size < 3 else "", "ms": 3, "lw": 1.4}
        if is_crowded:
            style |= {"color": colours(0.9 * number / (len(traces) - 1)), "ls": "-", "lw": 0.9}
        draw_repeats(axes, curves, number, label, **style)
    title = f"first and last\nof {len(traces)} traces" if is_crowded else None
    axes.legend(title=title)


def _label(quantity: str, unit: str) -> str:
    name = quantity or "values"
    return f"{name} ({unit})" if unit and unit != "1" else name
