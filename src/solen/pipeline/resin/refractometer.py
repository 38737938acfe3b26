"""Index of a refractometer over wavelength: the result and its figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen.material.index.refractometer import RefractometerIndex, RefractometerOptions, refractometer_index
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome


def refractometer(
    n: Sequence[float],
    options: RefractometerOptions,
    *,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[RefractometerIndex]:
    """Index against wavelength from measured values and the dispersion that polymers have."""
    check_outputs(out, figure)
    result = refractometer_index(n, options)
    return write(result, "refractometer", out, figure=figure)
