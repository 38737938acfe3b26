"""Recordings diagnosed: from files to what each sensor's emitter, chip and receivers are, by the design's response."""

from pathlib import Path

from solen.analysis import AnalysisOptions, study
from solen.analysis.diagnosis import DiagnosisOptions, SensorDiagnoses, diagnosed_sensors
from solen.analysis.study import in_volts
from solen.arrays import Progress
from solen.pipeline.outputs import check_outputs, write
from solen.report.options import FigureOptions
from solen.results import Outcome


def diagnose(
    *recordings: Path,
    options: DiagnosisOptions | None = None,
    analysis: AnalysisOptions | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
    progress: Progress | None = None,
) -> Outcome[SensorDiagnoses]:
    """Diagnosis of each sensor.

    Parameters
    ----------
    recordings
        The files.
    options, analysis
        What is known of the sensors, and how to read and analyse the recordings.
    out, figure
        Where to write the result and its figure.
    progress
        Called with the share of the tracing that is done, up to 1.

    Raises
    ------
    DataError, SpecError, DesignError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    check_outputs(out, figure)
    return write(
        diagnosed_sensors(in_volts(study(recordings, analysis)), options, progress), "diagnosis", out, figure=figure
    )
