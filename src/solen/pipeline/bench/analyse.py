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

    Switched emitters, flicker of lamps, clipped samples and a motion log of the stage in the same folder are detected
    automatically; the command that states them explicitly is printed. A recording of several motions belongs to a
    network: its readings are then given by emitter and receiver in every state.

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
        raise OutputError(str(traces), limit="is the name of both figures", remedy="give each its own name")
    files, options = split_files(files, options)
    if files and is_network(files[0]):
        check_options(options)
        if traces is not None or len(files) > 1:
            what = ("--traces", traces) if traces is not None else ("files", len(files))
            limit = "does not apply to a network" if traces is not None else "must be a single recording of a network"
            raise SpecError(what[0], value=str(what[1]), limit=limit)
        return write(analysed_network(network_readings(files[0])), "analysis", out, figure=figure)
    result = study(files, options)

    def over_time() -> bytes:
        from solen.report.bench.traces import traces_figure

        return figure_bytes(lambda: traces_figure(result), traces or Path(), "traces", figure)

    return write(result, "analysis", out, {"traces": (traces, over_time)}, figure=figure)
