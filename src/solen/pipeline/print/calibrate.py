"""Calibration of a printer: measured features as input, a process file and a figure as output."""

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen import files
from solen.errors import DataError
from solen.fabricate.process import (
    PrinterCalibration,
    calibrated,
    default_process,
    process_text,
    read_features,
    read_process,
)
from solen.pipeline.options import FLAT, Force
from solen.pipeline.outputs import check_ending, check_new, drawn, named, toml_bytes
from solen.report.options import FigureOptions
from solen.results import Outcome


def calibrate(
    features: list[Path],
    /,
    *,
    process: Path | None = None,
    out: Annotated[Path | None, Parameter(name="--out", help="Write the process to this .toml.")] = None,
    force: Force = False,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
) -> Outcome[PrinterCalibration]:
    """Fit the blur, edge growth and shrinkage of a printer to measured coupons, for solen print predict.

    Parameters
    ----------
    features
        Files of measured features (JSON), written by solen print fidelity --out.
    process
        The process with which the coupons were printed, as far as known; default: the published settings.

    Raises
    ------
    SolenError
        If a file cannot be read, or its features do not determine the fit; then nothing is written.
    """
    figure.check()
    check_ending(out, "a process", ".toml")
    check_new(out, force=force)
    if not features:
        raise DataError("features", limit="missing", remedy="specify a file of solen print fidelity --out")
    prior = default_process() if process is None else read_process(process)
    name = ", ".join(dict.fromkeys(path.name for path in features))
    fit = calibrated(prior, [read_features(path) for path in features], name)
    contents = drawn(fit, figure, "calibration")
    if out is not None:
        contents[out] = toml_bytes(process_text(fit.process), "print calibrate")
    files.write_all(contents)
    return Outcome(fit, named(figure=figure.figure, out=out))
