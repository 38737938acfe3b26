"""The resin figure: index against wavelength with its uncertainty."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from solen.errors import DataError
from solen.material.dispersion import AS_PUBLISHED, Tabulated
from solen.material.facts import LISTED_NM, ResinFacts
from solen.material.resin import Resin
from solen.report.canvas import INK, LEFT, RIGHT
from solen.spec.strict import error_context

DEFAULT_RANGE_NM = (400.0, 1000.0)
"""Wavelengths drawn if an index has no limits."""
POINTS = 301


def facts_figure(facts: ResinFacts) -> Figure:
    """Draw the index of a resin against wavelength, with its values at the requested wavelengths.

    Raises
    ------
    DataError
        If the resin has no index.
    """
    at_nm = tuple(at.wavelength_nm for at in facts.at)
    with error_context(f"resin {facts.name}"):
        return index_figure(facts.contents, () if at_nm == LISTED_NM else at_nm)


def index_figure(resin: Resin, at_nm: Sequence[float] = ()) -> Figure:
    """Draw index against wavelength, with its standard uncertainty as a band; dashed if it is as published.

    Raises
    ------
    DataError
        If the resin has no index.
    """
    low, high = resin.index.range_nm
    if high <= low:
        raise DataError("figure", limit="the resin has no index to draw", remedy="omit --figure")
    low = low or DEFAULT_RANGE_NM[0]
    high = high if np.isfinite(high) else DEFAULT_RANGE_NM[1]
    wavelengths = np.unique([*np.linspace(low, high, POINTS), *(nm for nm in at_nm if low <= nm <= high)])
    n = np.array([resin.index.index(float(nm)) for nm in wavelengths])
    u = [resin.index.u_index(float(nm)) for nm in wavelengths]
    is_published = resin.index.mode == AS_PUBLISHED
    figure = Figure(figsize=(6.0, 3.6))
    axes = figure.add_subplot()
    if all(value is not None for value in u):
        band = np.array(u, dtype=float)
        axes.fill_between(wavelengths, n - band, n + band, color=RIGHT, alpha=0.2, lw=0, label="± standard uncertainty")
    label = "as published: see the warning" if is_published else resin.index.mode or resin.index.kind
    colour, dashes = (LEFT, "--") if is_published else (RIGHT, "-")
    axes.plot(wavelengths, n, color=colour, lw=1.8, ls=dashes, label=label)
    if isinstance(resin.index, Tabulated):
        axes.plot(resin.index.wavelength_nm, resin.index.n, ".", color=INK, ms=4)
    for nm in at_nm:
        axes.plot(nm, resin.index.index(nm), "o", color=INK, mfc="none", ms=6)
        axes.annotate(f"{nm:g} nm: {resin.index.index(nm):.4f}", (nm, resin.index.index(nm)), (4, 6),
                      textcoords="offset points")  # fmt: skip
    simulated = any(source.simulated for source in resin.sources if source.of == "index")
    axes.set_title(resin.name + (" (simulated data)" if simulated else ""))
    axes.set(xlabel="wavelength (nm)", ylabel="refractive index")
    axes.legend()
    return figure
