"""Recordings of a bench, from solen or any other, to the response of each sensor, its figures of merit and figures."""

import importlib.resources
from pathlib import Path
from typing import TYPE_CHECKING

from solen import files
from solen.analysis import AnalysisOptions, Study, study
from solen.errors import OutputError
from solen.pipeline.outputs import check_out, figure_bytes, write
from solen.report.options import FigureOptions
from solen.results import Outcome

if TYPE_CHECKING:
    pass

EXAMPLE = "rotation-simulated.csv"


def analyse(
    *recordings: Path,
    options: AnalysisOptions | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
    traces: Path | None = None,
) -> Outcome[Study]:
    """Response and figures of merit of each sensor.

    Parameters
    ----------
    recordings
        The files.
    options
        How to read and analyse them.
    out, figure, traces
        Where to write the result, the figure of the response, and that of the voltages over time.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    check_out(out)
    figure.check(traces)
    if traces is not None and figure.figure == traces:
        raise OutputError(str(traces), limit="is the name of both figures", remedy="give each its own")
    result = study(recordings, options)

    def over_time() -> bytes:
        from solen.report.bench.traces import traces_figure

        return figure_bytes(lambda: traces_figure(result), traces or Path(), "traces", figure)

    return write(result, "analysis", out, {"traces": (traces, over_time)}, figure=figure)


def write_example(path: Path) -> None:
    """Write the simulated recording that solen ships to a new file."""
    if path.suffix.lower() != ".csv":
        raise OutputError(str(path), limit="a recording ends in .csv", remedy="rename it")
    if path.exists():
        raise OutputError(str(path), limit="exists already", remedy="name another file or remove it")
    shipped = importlib.resources.files("solen.analysis") / "examples" / EXAMPLE
    files.write_bytes(path, shipped.read_bytes())
