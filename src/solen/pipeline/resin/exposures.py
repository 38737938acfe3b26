"""Optics of layers against their exposure: files of spectra in, the result and its figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen.material.cure.exposures import ExposureOptions, ExposureTrends, exposure_trends
from solen.pipeline.outputs import check_outputs, write
from solen.recording import read
from solen.report.options import FigureOptions
from solen.results import Outcome


def exposures(
    files: Sequence[Path],
    options: ExposureOptions = ExposureOptions(),
    *,
    sheet: str | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[ExposureTrends]:
    """Transmittance of layers at some wavelengths against their exposure, and their index where R was measured."""
    check_outputs(out, figure)
    result = exposure_trends([read(file, sheet=sheet) for file in files], options)
    return write(result, "exposures", out, figure=figure)
