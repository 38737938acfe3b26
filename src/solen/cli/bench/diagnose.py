"""The command of diagnoses: `solen bench diagnose`."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

from solen.analysis.diagnosis import DiagnosisOptions, SensorDiagnoses
from solen.cli.app import FLAT, Out, lines, progress_bar
from solen.cli.bench.recorded import ANALYSED, LENS, Analysed, Flat, split_files
from solen.report.options import FigureOptions
from solen.results import Outcome


def diagnose(
    *files: Path,
    options: Annotated[DiagnosisOptions, Flat] = DiagnosisOptions(),
    analysis: Analysed = ANALYSED,
    figure: Annotated[FigureOptions, FLAT] = FigureOptions(),
    out: Out = None,
) -> Outcome[SensorDiagnoses]:
    """Diagnose a sensor from its recording: emitter decentre, chip width, loss, gains and offsets, with intervals.

    Parameters
    ----------
    files
        Recordings, as of solen bench analyse.
    """
    from solen.pipeline.bench import diagnose as pipeline

    files, analysis = split_files(files, analysis)
    with progress_bar("tracing the design") as bar:
        return pipeline.diagnose(*files, options=options, analysis=analysis, out=out, figure=figure, progress=bar)


@lines.register
def _(result: SensorDiagnoses) -> Iterator[str]:
    simulated = "; simulated" if result.simulated else ""
    for label, sensor in result.sensors.items():
        yield f"{label}{LENS[sensor.lens]}: {sensor.cycles_used} cycles, ± is half of an interval of 95 %{simulated}"
        yield from (f"  {line}" for line in sensor.words)
        yield from (f"  advice: {line}" for line in sensor.advice)
