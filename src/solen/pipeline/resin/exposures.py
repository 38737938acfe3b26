"""Comparison of layers with different exposures: files of spectra as input, the result and its figure as output."""

from pathlib import Path
from typing import Annotated

from solen.material.cure.exposures import ExposureOptions, ExposureTrends, exposure_trends
from solen.pipeline.options import FLAT, Out, Sheet
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
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
    """Compare the transmittance of layers with different exposures, and their index if R was measured.

    Parameters
    ----------
    files
        Spectra with exposures in the names of traces or files ("2 s"), or tables with columns exposure_s, wavelength_nm
        and T.
    """
    check_outputs(out, figure)
    result = exposure_trends([read(file, sheet=sheet) for file in files], options)
    return write(result, "exposures", out, figure=figure)
