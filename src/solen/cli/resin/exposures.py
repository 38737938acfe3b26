"""The command of layers against their exposure."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np

from solen.cli.app import FLAT, Out, Sheet, lines
from solen.material.cure.exposures import ExposureOptions, ExposureTrends, Trend
from solen.report.options import FigureOptions
from solen.results import Outcome


def exposures(
    files: list[Path],
    /,
    *,
    options: Annotated[ExposureOptions, FLAT] = ExposureOptions(),
    sheet: Sheet = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[ExposureTrends]:
    """Compare the transmittance of layers by their exposure, and the index where R was measured.

    Parameters
    ----------
    files
        Spectra whose traces, or files, are named by their exposure ("2 s"), or tables of exposure_s, wavelength_nm, T.
    """
    from solen.pipeline.resin import exposures as pipeline

    return pipeline.exposures(files, options, sheet=sheet, out=out, figure=figure)


@lines.register
def _(trends: ExposureTrends) -> Iterator[str]:
    yield "exposure (s)  " + "  ".join(f"{seconds:7g}" for seconds in trends.exposure_s)
    for row in trends.wavelengths:
        for name, values, line in (("T", row.T, row.trend_T), ("n", row.n, row.trend_n)):
            if line is not None:
                texts = ("      -" if np.isnan(value) else f"{value:7.4f}" for value in values)
                yield f"{name} {row.wavelength_nm:7g} nm  " + "  ".join(texts)
                yield f"    {name} changes by {_slope(line)}"


def _slope(line: Trend) -> str:
    ends = line.interval95_slope_per_s
    interval = "no interval from two samples" if ends is None else f"{ends[0]:+.2g} to {ends[1]:+.2g}, 95 %"
    return f"{line.slope_per_s:+.3g} per s ({interval})"
