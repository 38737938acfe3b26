"""Calibrations from recordings: one per sensor, or one pooled over several prints, saved next to the recordings."""

from pathlib import Path

from solen import files
from solen.analysis import AnalysisOptions, study
from solen.analysis.calibration import CalibrationOptions, SensorCalibrations, calibrated_sensors
from solen.analysis.calibration.calibrate import default_path
from solen.analysis.calibration.file import text_of
from solen.analysis.network import NetworkCalibrations, calibrated_network, is_network, network_readings
from solen.analysis.network.file import text_of as network_text
from solen.analysis.network.stream_decoder import check_options
from solen.errors import OutputError
from solen.pipeline.outputs import check_outputs, drawn, named
from solen.report.options import FigureOptions
from solen.results import Outcome


def calibrate(
    *recordings: Path,
    options: CalibrationOptions | None = None,
    analysis: AnalysisOptions | None = None,
    out: Path | None = None,
    figure: FigureOptions = FigureOptions(),
) -> Outcome[SensorCalibrations | NetworkCalibrations]:
    """Write calibrations of recorded sensors next to the recordings, or a single one to ``out``.

    Recordings of several motions are those of a network, which is calibrated for all motions at once.

    Raises
    ------
    DataError, SpecError, OutputError
        If a recording, an option or an output is invalid.
    """
    check_outputs(out, figure)
    if recordings and is_network(recordings[0]):
        return _network(recordings, options or CalibrationOptions(), analysis or AnalysisOptions(), out, figure)
    result = calibrated_sensors(study(recordings, analysis), options)
    calibrations = {calibration.sensor: calibration for calibration in result.calibrations}
    if out is not None and len(calibrations) > 1:
        limit = f"is one file, but there are {len(calibrations)} calibrations: {', '.join(calibrations)}"
        remedy = "choose one sensor with --sensor, combine all with --pool, or omit --out"
        raise OutputError(str(out), limit=limit, remedy=remedy)
    paths = {sensor: out or default_path(recordings, sensor) for sensor in calibrations}
    if len(set(paths.values())) < len(paths):
        first = next(iter(paths.values()))
        limit = "would contain several calibrations"
        raise OutputError(str(first), limit=limit, remedy="choose one sensor with --sensor")
    contents: dict[Path, files.Content] = {
        path: text_of(calibrations[sensor]).encode("utf-8") for sensor, path in paths.items()
    }
    files.write_all(contents | drawn(result, figure, "calibration"))
    names = {f"calibration.{sensor}": path for sensor, path in paths.items()}
    return Outcome(result, names | named(figure=figure.figure))


def _network(
    recordings: tuple[Path, ...],
    options: CalibrationOptions,
    analysis: AnalysisOptions,
    out: Path | None,
    figure: FigureOptions,
) -> Outcome[NetworkCalibrations]:
    """Calibrate a network from all its recordings together."""
    check_options(options, ("sensor",))
    check_options(analysis)
    result = calibrated_network([network_readings(path, options.sensor) for path in recordings])
    sensor = result.calibration.sensor or recordings[0].stem
    path = out or default_path(recordings, sensor)
    content: dict[Path, files.Content] = {path: network_text(result.calibration).encode("utf-8")}
    files.write_all(content | drawn(result, figure, "calibration"))
    return Outcome(result, {f"calibration.{sensor}": path} | named(figure=figure.figure))
