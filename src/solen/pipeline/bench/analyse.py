"""Responses and figures of merit of sensors, from recordings made by solen's bench or any other."""

from pathlib import Path
from typing import Annotated

from solen.analysis import Study, study
from solen.analysis.network import NetworkStates, analysed_network, is_network, network_readings
from solen.analysis.network.stream_decoder import check_options
from solen.errors import OutputError, SpecError
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
) -> Outcome[Study | NetworkStates]:
    """Compute cycles, response curve and figures of merit of recorded sensors.

    Switched emitters, flicker of lamps, clipped samples and a stage log in the same folder are detected automatically;
    the command that specifies them explicitly is printed. A recording of several motions is analysed as that of a
    network: the result is the reading of every emitter and receiver in every state.

    Parameters
    ----------
    files
        Recordings: tables (CSV, TSV, ;, .xlsx) with a time, an angle and receiver voltages.
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
        raise OutputError(str(traces), limit="is the name of both figures", remedy="use different names")
    files, options = split_files(files, options)
    if files and is_network(files[0]):
        check_options(options)
        if traces is not None:
            raise SpecError("--traces", value=str(traces), limit="does not apply to a network", remedy="omit it")
        if len(files) > 1:
            limit = f"must be analysed one at a time, but there are {len(files)}"
            raise SpecError("recordings of a network", limit=limit, remedy="name one recording")
        return write(analysed_network(network_readings(files[0])), "analysis", out, figure=figure)
    result = study(files, options)

    def traces_bytes() -> bytes:
        from solen.report.bench.traces import traces_figure

        return figure_bytes(lambda: traces_figure(result), traces or Path(), "traces", figure)

    return write(result, "analysis", out, {"traces": (traces, traces_bytes)}, figure=figure)
