"""Response and figures of merit of sensors, from recordings of solen's bench or any other."""

from pathlib import Path
from typing import Annotated

from solen.analysis import Study, study
from solen.errors import OutputError
from solen.pipeline.bench.recorded import ANALYSED, Analysed, split_files
from solen.pipeline.options import FLAT, Out
from solen.pipeline.outputs import check_out, figure_bytes, write
from solen.report.options import FigureOptions
from solen.results import Outcome


def analyse(
    *files: Path,
    options: Analysed = ANALYSED,
    traces: Path | None = None,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[Study]:
    """Cycles, response curve and figures of merit of recorded sensors.

    Switched emitters, flicker of lamps, clipped samples and a stage's log in the same folder are detected
    automatically; the command that states them explicitly is printed.

    Parameters
    ----------
    files
        Recordings: tables (CSV, TSV, ;, .xlsx) with a time, an angle and receivers' voltages.
    traces
        Draw voltages over time with the detected cycles into this .svg, .png or .pdf.

    Raises
    ------
    DataError, SpecError, OutputError
        If a file, an option or an output is invalid.
    """
    check_out(out)
    figure.check(traces)
    if traces is not None and figure.figure == traces:
        raise OutputError(str(traces), limit="is the name of both figures", remedy="give each its own name")
    files, options = split_files(files, options)
    result = study(files, options)

    def over_time() -> bytes:
        from solen.report.bench.traces import traces_figure

        return figure_bytes(lambda: traces_figure(result), traces or Path(), "traces", figure)

    return write(result, "analysis", out, {"traces": (traces, over_time)}, figure=figure)
