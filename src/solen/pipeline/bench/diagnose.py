"""Diagnosis of recorded sensors: emitter, chip and receivers of each, from a fit of the response of its design."""

from pathlib import Path
from typing import Annotated

from solen.analysis import study
from solen.analysis.diagnosis import DiagnosisOptions, SensorDiagnoses, diagnosed_sensors
from solen.analysis.study import voltages_against_angle
from solen.pipeline.bench.recorded import ANALYSED, Analysed, Flat, split_files
from solen.pipeline.options import FLAT, Out, ProgressBar
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome


def diagnose(
    *files: Path,
    options: Annotated[DiagnosisOptions, Flat] = DiagnosisOptions(),
    analysis: Analysed = ANALYSED,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
    progress: ProgressBar = None,
) -> Outcome[SensorDiagnoses]:
    """Diagnose a sensor from its recording: emitter decentre, chip width, loss, gains and offsets, with intervals.

    Parameters
    ----------
    files
        Recordings, as for solen bench analyse.

    Raises
    ------
    DataError, SpecError, DesignError, OutputError
        If a file, an option or an output is invalid.
    """
    check_outputs(out, figure)
    files, analysis = split_files(files, analysis)
    diagnoses = diagnosed_sensors(voltages_against_angle(study(files, analysis)), options, progress)
    return write(diagnoses, "diagnosis", out, figure=figure)
