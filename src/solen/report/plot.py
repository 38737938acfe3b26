"""The figure of a result, chosen by its type.

The interface: `plot`; `FIGURES` says which function draws which type. Neither the types nor matplotlib are loaded
before a result is drawn.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from solen.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = {
    "Convergence": "solen.report.design.figures:convergence_figure",
    "ExposureTrends": "solen.report.resin.exposures:exposures_figure",
    "GuideLoss": "solen.report.resin.cutback:cutback_figure",
    "LayerIndex": "solen.report.resin.index:index_figure",
    "Listing": "solen.report.resin.spectra:spectra_figure",
    "MeasuredCurve": "solen.report.resin.cure:cure_figure",
    "MeasuredStiffness": "solen.report.resin.stiffness:stiffness_figure",
    "OvalLens": "solen.report.design.figures:profile_figure",
    "Penetration": "solen.report.resin.penetration:penetration_figure",
    "RefractometerIndex": "solen.report.resin.refractometer:refractometer_figure",
    "Resin": "solen.report.resin.library:index_figure",
    "ResinFacts": "solen.report.resin.library:facts_figure",
    "Sensor": "solen.report.design.figures:focus_figure",
}
"""Functions that take one result, by the name of its type."""


def plot(result: Any) -> "Figure":
    """Figure of a result, in the style of all figures of solen; a notebook shows it, ``savefig`` writes it.

    Raises
    ------
    OutputError
        Where no figure is drawn of such a result.
    """
    kinds = [kind.__name__ for kind in type(result).__mro__ if kind.__name__ in FIGURES]
    if not kinds:
        limit = f"there is no figure of a {type(result).__name__}"
        raise OutputError("plot", limit=limit, remedy=f"figures are drawn of {', '.join(FIGURES)}")
    import matplotlib as mpl

    from solen.report.canvas import STYLE

    module, _, function = FIGURES[kinds[0]].partition(":")
    with mpl.rc_context(STYLE):
        figure: Figure = getattr(import_module(module), function)(result)
    return figure
