"""A study: recordings of one or several sensors, from files to the response of each sensor and their comparison.

A file contains recordings of a single sensor, or of several sensors named by its columns or groups. Recordings with the
same label are pooled; sensors with a lens are compared with sensors without.

Public names: `study` and `Study`.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from solen.analysis.alignment import Alignment, align
from solen.analysis.detected import command, explicit, find_log
from solen.analysis.motion import Motion
from solen.analysis.protocol_angle import angle_by_protocol
from solen.analysis.samples import ambient_by_side, sample_times
from solen.analysis.sensor_response import AnalysisOptions, SensorGroup, SensorResponse, group_of, sensor_response
from solen.analysis.signals import TIMES_OF_LOG, Signals, Switching, Waveforms
from solen.analysis.stimulus_column import StimulusColumn, reject_missing_stimulus, stimulus_column
from solen.analysis.waveforms import waveforms
from solen.errors import DataError, SolenError, SpecError
from solen.ranks import Caution, note, prefixed, warning
from solen.recording import Provenance, Recording, read, read_parts
from solen.recording.column_roles import by_sensor
from solen.recording.labels import has_lens, labels
from solen.recording.stimulus import ANGLE, Stimulus
from solen.results import HIDDEN, Result, in_unit, reported
from solen.spec.strict import repeated

CONTROL_KEYS = ("control", "controls", "without lens", "no lens")
"""Parameters in a file that name its sensors without a lens."""


@dataclass(frozen=True)
class SwingWithoutLens:
    """Mean swings of a receiver with and without a lens, and the latter in per cent of the former."""

    swing_V: float
    swing_without_lens_V: float
    without_lens_percent: float


class Study(Result):
    """Responses of all sensors and their comparison; keys end in the units of the recordings instead of V and deg.

    Attributes
    ----------
    sensors
        Every sensor, keyed by label, in the order of the files.
    mean_of_sensors, mean_of_controls
        Mean of the sensors with a lens and of the sensors without; None if there are none.
    lens_beside_none
        Swing without a lens compared with the swing with a lens, keyed by receiver; None unless there are both.
    alignment
        Relation between the clocks of log and recorder, keyed by recording.
    switching
        Switching of the emitters, keyed by recording.
    options
        Analysis options, including detected settings.
    command
        Command line that specifies every setting; None if detected settings differ between recordings.
    dark_V
        Voltage without light: as specified, or 0 if ambient light is subtracted.
    ambient_subtracted
        Whether ambient light is subtracted in all recordings.
    provenances
        Provenance of every recording.
    warnings
        Assumptions and limits.
    """

    sensors: dict[str, SensorResponse]
    mean_of_sensors: SensorGroup | None
    mean_of_controls: SensorGroup | None
    lens_beside_none: dict[str, SwingWithoutLens] | None
    alignment: dict[str, Alignment]
    switching: dict[str, Switching]
    options: AnalysisOptions
    command: str | None
    dark_V: float | None
    ambient_subtracted: bool
    provenances: tuple[Provenance, ...] = field(metadata=HIDDEN)
    logs_found: bool = field(metadata=HIDDEN)
    warnings: tuple[Caution, ...]

    @reported
    def simulated(self) -> bool:
        """Whether any recording is simulated."""
        return any(provenance.simulated for provenance in self.provenances)

    @reported
    def sources(self) -> tuple[Provenance, ...]:
        """The files, each listed once."""
        return tuple({provenance.sha256: provenance for provenance in self.provenances}.values())

    @property
    def unit(self) -> str:
        """Unit of the receivers: V, or another unit specified in the recordings."""
        return next(iter(self.sensors.values())).unit

    @property
    def stimulus(self) -> Stimulus:
        """Quantity against which the response is measured."""
        return next(iter(self.sensors.values())).stimulus

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; keys end in the units of the recordings instead of V and deg."""
        return self.stimulus.keyed(in_unit(super().to_dict(), self.unit))

    @property
    def smoothing(self) -> str:
        """Description of the smoothing, for figures; empty without it."""
        return "" if self.options.smooth_ms is None else f"moving mean over {self.options.smooth_ms:g} ms"

    @property
    def detected(self) -> bool:
        """Whether any setting was detected rather than specified."""
        return any(state.detected for state in self.switching.values()) or self.logs_found


def voltages_against_angle(recorded: Study) -> Study:
    """Return a study unchanged; raise `DataError` unless it contains voltages against an angle.

    No model can be fitted to a response to a force or depth: it also depends on the modulus, the supports and the
    position and direction of the load, which a single curve cannot determine.
    """
    file = recorded.provenances[0].file
    if recorded.stimulus is not ANGLE:
        limit = f"is analysed against the {recorded.stimulus.name}, but a diagnosis requires the response to an angle"
        remedy = (
            "record the same sensor driven by an angle, or calibrate it in its present setup with solen bench calibrate"
        )
        raise DataError(file, limit=limit, remedy=remedy)
    if recorded.unit != "V":
        limit = f"contains receivers in {recorded.unit}, but a diagnosis requires voltages"
        raise DataError(file, limit=limit, remedy="record volts")
    return recorded


@dataclass(frozen=True, eq=False)
class _Part:
    """A recording in a file: its samples with their angle, its source, and its log with the alignment of the clocks.

    ``detected_log`` is the path of the log if it was detected rather than specified.
    """

    label: str
    samples: Waveforms
    recording: Recording
    log: Recording | None = None
    alignment: Alignment | None = None
    detected_log: Path | None = None


def study(files: Sequence[Path], options: AnalysisOptions | None = None) -> Study:
    """Analyse and compare all sensors in all files.

    Raises
    ------
    DataError, SpecError
        If a file or an option is invalid.
    """
    options = options or AnalysisOptions()
    _check_files(files, options)
    recordings = _read(files, options)
    sensors, ambient_subtracted = recordings.sensors, recordings.ambient_subtracted
    _check_controls(options, sensors)
    units = {signal.unit for signals in sensors.values() for signal in signals}
    if len(units) > 1:
        limit = f"contain receivers in {' and in '.join(sorted(units))}"
        raise DataError("recordings", limit=limit, remedy="analyse each unit separately")
    stimuli = {signal.stimulus.name for signals in sensors.values() for signal in signals}
    if len(stimuli) > 1:
        limit = f"are driven by {' and by '.join(sorted(stimuli))}"
        remedy = "use --against with a quantity that all of them contain"
        raise DataError("recordings", limit=limit, remedy=remedy)
    dark = options.model_copy(update={"dark_V": 0.0}) if options.dark_V is None and ambient_subtracted else options
    motions: dict[int, Motion] = {}
    responses = {label: _response(signals, dark, motions) for label, signals in sensors.items()}
    lens, control = (
        [response for response in responses.values() if (response.lens is False) == without]
        for without in (False, True)
    )
    groups = [group_of(group) if group else None for group in (lens, control)]
    settings = explicit(options, recordings.switching, recordings.logs)
    warnings = [
        *recordings.warnings,
        *_pooling_warnings(options, sensors),
        *(
            prefixed(response.label if len(responses) > 1 else "", caution)
            for response in responses.values()
            for caution in response.warnings
        ),
        *_group_warnings(groups, len(responses)),
    ]
    return Study(
        sensors=responses,
        mean_of_sensors=groups[0],
        mean_of_controls=groups[1],
        lens_beside_none=_compared(*groups),
        alignment=recordings.alignment,
        switching=recordings.switching,
        options=settings or options,
        command=None if settings is None else command(files, settings),
        dark_V=dark.dark_V,
        ambient_subtracted=ambient_subtracted,
        provenances=tuple(recordings.provenances),
        logs_found=bool(recordings.logs),
        warnings=tuple(dict.fromkeys(warnings)),
    )


@dataclass
class _Recordings:
    """Recordings as read: signals of each sensor; provenances, alignments, switching and warnings of the recordings.

    ``logs`` were detected next to recordings; ``ambient_subtracted`` is whether ambient light was subtracted from all
    recordings.
    """

    sensors: dict[str, list[Signals]] = field(default_factory=dict)
    provenances: list[Provenance] = field(default_factory=list)
    alignment: dict[str, Alignment] = field(default_factory=dict)
    switching: dict[str, Switching] = field(default_factory=dict)
    warnings: list[Caution] = field(default_factory=list)
    logs: list[Path] = field(default_factory=list)
    ambient_subtracted: bool = True


def _read(files: Sequence[Path], options: AnalysisOptions) -> _Recordings:
    recordings = _Recordings()
    for path, part in _parts(files, options):
        for signal in _signals(part, options, path, len(files)):
            recordings.sensors.setdefault(signal.label, []).append(signal)
        recordings.provenances += [source.provenance for source in (part.recording, part.log) if source is not None]
        recordings.ambient_subtracted &= part.samples.ambient_subtracted
        prefix = path.name if len(files) > 1 else ""
        recordings.warnings += [prefixed(prefix, caution) for caution in part.samples.warnings]
        if part.alignment is not None:
            recordings.alignment[part.label] = part.alignment
        if part.samples.switching is not None:
            recordings.switching[part.label] = part.samples.switching
        if part.detected_log is not None:
            recordings.logs.append(part.detected_log)
    return recordings


def _check_files(files: Sequence[Path], options: AnalysisOptions) -> None:
    if not files:
        raise SpecError("files", limit="at least one recording is required", remedy="name one or more recordings")
    duplicate = repeated(files)
    if duplicate is not None:
        raise SpecError("files", value=str(duplicate), limit="is named twice", remedy="name each recording once")
    if len(options.angle_file) not in {0, 1, len(files)}:
        limit = f"names {len(options.angle_file)} logs for {len(files)} recordings"
        raise SpecError("--angle-file", limit=limit, remedy="name one log for all recordings, or one for each")


def _check_controls(options: AnalysisOptions, sensors: Mapping[str, object]) -> None:
    names = {name for label in sensors for name in (label, label.rpartition(".")[2])}
    for name in options.control:
        if name not in names:
            limit = "no sensor has this name"
            raise SpecError("--control", value=name, limit=limit, remedy=f"choose from {', '.join(sensors)}")


def _response(signals: Sequence[Signals], options: AnalysisOptions, motions: dict[int, Motion]) -> SensorResponse:
    """Return the response of a sensor; errors name its file."""
    try:
        return sensor_response(signals, options, motions)
    except SolenError as error:
        file = signals[0].source
        if file in error.what:
            raise
        raise DataError(f"{file}: {error.what}", value=error.value, limit=error.limit, remedy=error.remedy) from None


def _parts(files: Sequence[Path], options: AnalysisOptions) -> Iterator[tuple[Path, _Part]]:
    """Yield the recordings in all files, in order; a recording with several emitters is divided into one for each."""
    elsewhere = bool(options.angle_file) or options.amplitude_deg is not None
    for index, path in enumerate(files):
        fields = {} if options.pattern is None else labels(path, options.pattern)
        for group, recording in read_parts(path, sheet=options.sheet, columns=options.columns or None):
            by_emitter = waveforms(recording, options, angle="elsewhere" if elsewhere else "optional")
            for emitter, samples in by_emitter.items():
                name = ".".join(filter(None, (group, emitter)))
                part = _Part(_label(path, fields.get("sensor"), name, len(files)), samples, recording)
                yield path, _with_angle(part, options, index, files)


def _label(path: Path, sensor: str | None, name: str, files: int) -> str:
    """Return the label of a part of a file; it omits the file name if there is only one file."""
    label = sensor or path.stem
    if not name:
        return label
    return name if files == 1 and sensor is None else f"{label}.{name}"


def _with_angle(part: _Part, options: AnalysisOptions, index: int, files: Sequence[Path]) -> _Part:
    """Return a recording with its angle: that of a log, of the commanded protocol, or its recorded angle."""
    samples = part.samples
    if options.angle_file:
        return _with_log(part, options.angle_file[index if len(options.angle_file) > 1 else 0], options)
    if options.protocol is not None:
        protocol_angle = angle_by_protocol(samples.time_s, samples.volts, samples.receivers, options.protocol)
        warnings = (*samples.warnings, *protocol_angle.warnings)
        return replace(part, samples=replace(samples, angle_deg=protocol_angle.angle_deg, warnings=warnings))
    if samples.angle_deg is not None:
        return part
    log = find_log(files[index], files)
    if log is None:
        reject_missing_stimulus(part.recording)
    caution = warning(f"{files[index].name} contains no angle: the angle in {log.name}, in the same folder, is used")
    part = replace(part, samples=replace(samples, warnings=(caution, *samples.warnings)))
    return replace(_with_log(part, log, options), detected_log=log)


def _with_log(part: _Part, path: Path, options: AnalysisOptions) -> _Part:
    """Return a recording with the angle, force or depth of a stage log."""
    samples, log = part.samples, read(path)
    alignment, driving, warnings = _aligned(samples, log, options)
    kept = replace(samples, angle_deg=alignment.angle_deg).rows(np.isfinite(alignment.angle_deg))
    warnings = [*samples.warnings, *warnings, *alignment.warnings]
    kept = replace(kept, stimulus=driving.stimulus, cell=driving.cell, warnings=tuple(warnings))
    return replace(part, samples=kept, log=log, alignment=alignment)


def _aligned(
    samples: Waveforms, log: Recording, options: AnalysisOptions
) -> tuple[Alignment, StimulusColumn, list[Caution]]:
    """Return the alignment of a log's clock with the recorder's, the logged quantity, and assumptions about it."""
    log_options = options.model_copy(update={"time": options.angle_time, "rate_hz": options.angle_rate_hz})
    warnings: list[Caution] = []
    base = sample_times(log, log_options, warnings, TIMES_OF_LOG)
    driving = stimulus_column(log, log_options, base, warnings)
    file = log.provenance.file
    if driving is None:
        limit = "no column is recognised as an angle, force or depth"
        raise DataError(file, limit=limit, remedy="name the column with --angle, --load or --depth")
    finite = np.isfinite(driving.values)
    alignment = align(
        samples.time_s, samples.volts, base.time_s[finite], driving.values[finite], samples.window_s, driving.stimulus
    )
    return alignment, driving, [prefixed(file, caution) for caution in (*base.warnings, *warnings)]


def _signals(part: _Part, options: AnalysisOptions, path: Path, files: int) -> Iterator[Signals]:
    """Yield the signals of each sensor in a recording."""
    samples, provenance = part.samples, part.recording.provenance
    file_lens, controls = _specified_lens(provenance, options, path)
    ambient_V = ambient_by_side(part.recording)
    for sensor, receivers in by_sensor(samples.receivers, part.label, single_file=files == 1).items():
        columns = list(receivers.values())
        lens = file_lens if file_lens is not None or not controls else True
        if controls & {sensor, sensor.rpartition(".")[2]}:
            lens = False
        assert samples.angle_deg is not None  # noqa: S101  required, or given by _with_angle
        yield Signals(
            label=sensor,
            receivers=tuple(receivers),
            time_s=samples.time_s,
            angle_deg=samples.angle_deg,
            volts=samples.volts[:, columns],
            lens=lens,
            source=path.name,
            clipped=None if samples.clipped is None else samples.clipped[:, columns],
            provenance=provenance,
            unit=samples.unit,
            ambient_subtracted=samples.ambient_subtracted,
            timing_bound_s=_timing_bound_s(part),
            ambient_V=ambient_V,
            stimulus=samples.stimulus,
            cell=samples.cell,
        )


def _timing_bound_s(part: _Part) -> tuple[float, Literal["recording", "log"]] | None:
    """Return the largest time difference between angles and readings, and its source; None if it is not known.

    For an aligned log, it is twice the uncertainty of the lag; a bench writes it in its recordings.
    """
    if part.alignment is not None:
        return 2.0 * part.alignment.u_lag_s, "log"
    try:
        return float(part.recording.provenance.metadata["timing_bound_s"]), "recording"
    except (KeyError, ValueError):
        return None


def _specified_lens(provenance: Provenance, options: AnalysisOptions, path: Path) -> tuple[bool | None, set[str]]:
    """Return whether a recording's sensors have a lens (None if unknown), and the labels of the sensors without one."""
    fields = {} if options.pattern is None else labels(path, options.pattern)
    word = fields.get("lens") or provenance.metadata.get("lens")
    texts = [value for key, value in provenance.metadata.items() if key.strip().casefold() in CONTROL_KEYS]
    controls = {*options.control, *(name for text in texts for name in re.split(r"[,;\s]+", text) if name)}
    return (None if word is None else has_lens(word)), controls


def _compared(lens: SensorGroup | None, control: SensorGroup | None) -> dict[str, SwingWithoutLens] | None:
    """Return the comparison of the swings with and without a lens, keyed by receiver; None unless there are both."""
    if lens is None or control is None:
        return None
    compared = {}
    for name, receiver in lens.receivers.items():
        if name in control.receivers:
            with_lens, without = receiver.swing_V, control.receivers[name].swing_V
            percent = 100.0 * abs(without / with_lens) if with_lens else np.nan
            compared[name] = SwingWithoutLens(with_lens, without, percent)
    return compared


def _pooling_warnings(options: AnalysisOptions, sensors: Mapping[str, Sequence[Signals]]) -> list[Caution]:
    """Return warnings about recordings that are pooled without a pattern."""
    if options.pattern is not None:
        return []
    counts = {label: len(signals) for label, signals in sensors.items() if len(signals) > 1}
    text = "recordings with the same name are pooled as one sensor; use --pattern to separate them"
    return [prefixed(label, warning(f"{count} {text}")) for label, count in counts.items()]


def _group_warnings(groups: Sequence[SensorGroup | None], sensors: int) -> list[Caution]:
    """Return warnings about the number of sensors."""
    warnings = []
    for group, kind in zip(groups, ("with a lens", "without a lens"), strict=True):
        if group is not None and group.n == 1 and sensors > 1:
            warnings.append(note(f"there is only one sensor {kind}, so the variation between prints is unknown"))
    if groups[0] is not None and sensors == 1:
        warnings.append(note("there is only one sensor: its cycles show repeatability, not variation between prints"))
    return warnings
