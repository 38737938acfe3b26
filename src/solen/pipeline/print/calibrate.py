"""Calibration of a printer: files of measured features in, a process file and a figure out."""

from collections.abc import Sequence
from pathlib import Path

from solen import __version__, files
from solen.errors import DataError
from solen.fabricate.process import (
    PrinterCalibration,
    calibrated,
    default_process,
    process_text,
    read_features,
    read_process,
)
from solen.pipeline.outputs import check_ending, drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome


def calibrate_printer(
    paths: Sequence[Path], process: Path | None = None, out: Path | None = None, figure: FigureOptions = FigureOptions()
) -> Outcome[PrinterCalibration]:
    """Find a process's blur, edge and shrinkage from measured coupons.

    Parameters
    ----------
    paths
        Files of features; all were printed by one process.
    process
        What the process was taken to be before, with the settings that the coupons were printed with; None for the
        default.
    out
        Write the process here.
    figure
        Draw printed beside measured sizes into this file.

    Raises
    ------
    SolenError
        Where a file cannot be read, or its features determine too little; nothing is written then.
    """
    figure.check()
    check_ending(out, "a process", ".toml")
    if not paths:
        raise DataError("coupons", limit="no file of features", remedy="name one or more")
    before = default_process() if process is None else read_process(process)
    name = ", ".join(dict.fromkeys(path.name for path in paths))
    fit = calibrated(before, [read_features(path) for path in paths], name)
    contents = drawn(fit, figure, "calibration")
    if out is not None:
        comment = f"# Written by solen {__version__} print calibrate.\n"
        contents[out] = (comment + process_text(fit.process)).encode()
    files.write_all(contents)
    return Outcome(fit, named(figure=figure.figure, out=out))
