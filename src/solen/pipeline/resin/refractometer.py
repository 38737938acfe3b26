"""Index from a refractometer: measured values as input, the index against wavelength and its figure as output."""

from typing import Annotated

from solen.material.index.refractometer import RefractometerIndex, RefractometerOptions, refractometer_index
from solen.pipeline.options import FLAT, Out
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome


def refractometer(
    n: list[float],
    /,
    *,
    options: Annotated[RefractometerOptions, FLAT],
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[RefractometerIndex]:
    """Extend an index from a refractometer or ellipsometer to other wavelengths, with the dispersion of polymers.

    Parameters
    ----------
    n
        Measured index, or several at different wavelengths.
    """
    check_outputs(out, figure)
    result = refractometer_index(n, options)
    return write(result, "refractometer", out, figure=figure)
