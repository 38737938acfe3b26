"""A study: recordings of one or several sensors, from files to the response of each sensor and their comparison.

A file contains recordings of a single sensor, or of several sensors that are named by its columns or groups. Recordings
with the same label are pooled; sensors with and without a lens are compared.

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
from solen.analysis.drive import Drive, driven, reject_undriven
from solen.analysis.motion import Motion
from solen.analysis.protocol_angle import angle_by_protocol
from solen.analysis.samples import ambient_by_side, sample_times
from solen.analysis.sensor_response import AnalysisOptions, SensorGroup, SensorResponse, group_of, sensor_response
from solen.analysis.signals import TIMES_OF_LOG, Signals, Switching, Waveforms
from solen.analysis.waveforms import waveforms
from solen.errors import DataError, SolenError, SpecError
from solen.ranks import Caution, note, prefixed, warning
from solen.recording import Provenance, Recording, read, read_parts
from solen.recording.column_roles import by_sensor
from solen.recording.labels import has_lens, labels
from solen.recording.stimulus import ANGLE, Stimulus
from solen.results import HIDDEN, Result, in_unit, reported

CONTROL_KEYS = ("control", "controls", "without lens", "no lens")
"""Parameters in a file that name its sensors without a lens."""


@dataclass(frozen=True)
class SwingWithoutLens:
    """Mean swing of a receiver with and without a lens, and the second as a percentage of the first."""

    swing_V: float
    swing_without_lens_V: float
    without_lens_percent: float


class Study(Result):
    """Analysed and compared sensors; keys end in the units of the recordings instead of V and deg.

    Attributes
    ----------
    sensors
        Every sensor, by label, in the order of the files.
    mean_of_sensors, mean_of_controls
        Mean of the sensors with a lens and of the sensors without; None if there are none.
    lens_beside_none
        Swing without a lens compared with the swing with a lens, by receiver; None unless there are both.
    alignment
        Relation between the clocks of log and recorder, by recording.
    switching
        Switching detected in waveforms, by recording.
    options
        Analysis options, including detected settings.
    command
        Command line with all options; None if detected settings differ between recordings.
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
    def remark(self) -> str:
        """Note on the processing for every figure; empty if there is none."""
        return "" if self.options.smooth_ms is None else f"moving mean over {self.options.smooth_ms:g} ms"

    @property
    def detected(self) -> bool:
        """Whether any setting was detected rather than specified."""
        return any(one.detected for one in self.switching.values()) or self.logs_found


def voltages_against_angle(found: Study) -> Study:
    """Check that a study is of voltages against an angle; `DataError` otherwise, because there is no model to fit.

    A soft body has many other unknowns (modulus, supports, position and direction of the load) that one curve cannot
    separate.
    """
    if found.stimulus is not ANGLE:
        limit = f"is analysed against the {found.stimulus.name}, but a diagnosis requires the response to an angle"
        remedy = (
            "record the same sensor driven by an angle, or calibrate it in its present setup with solen bench calibrate"
        )
        raise DataError(found.provenances[0].file, limit=limit, remedy=remedy)
    if found.unit != "V":
        limit = "is the unit of the receivers, but voltages are required"
        raise DataError(found.provenances[0].file, value=found.unit, limit=limit, remedy="record volts")
    return found


@dataclass(frozen=True, eq=False)
class _Part:
    """A recording in a file: its samples with their angle, its source, and the offset of the log's clock.

    ``beside`` is the log if it was detected rather than specified.
    """

    label: str
    samples: Waveforms
    recording: Recording
    log: Recording | None = None
    alignment: Alignment | None = None
    beside: Path | None = None


def study(files: Sequence[Path], options: AnalysisOptions | None = None) -> Study:
    """Analyse and compare all sensors in all files.

    Raises
    ------
    DataError, SpecError
        If a file or an option is invalid.
    """
    options = options or AnalysisOptions()
    _check_files(files, options)
    found = _read(files, options)
    sensors, bare = found.sensors, found.bare
    _check_controls(options, sensors)
    units = {signal.unit for signals in sensors.values() for signal in signals}
    if len(units) > 1:
        limit = f"contain receivers in {' and in '.join(sorted(units))}"
        raise DataError("recordings", limit=limit, remedy="analyse each unit separately")
    stimuli = {signal.stimulus.name for signals in sensors.values() for signal in signals}
    if len(stimuli) > 1:
        limit = f"are driven by {' and by '.join(sorted(stimuli))}"
        raise DataError("recordings", limit=limit, remedy="specify a quantity that all of them contain with --against")
    used = options.model_copy(update={"dark_V": 0.0}) if options.dark_V is None and bare else options
    motions: dict[int, Motion] = {}
    responses = {label: _response(signals, used, motions) for label, signals in sensors.items()}
    lens, control = (
        [response for response in responses.values() if (response.lens is False) == without]
        for without in (False, True)
    )
    groups = [group_of(ones) if ones else None for ones in (lens, control)]
    stated = explicit(options, found.switching, found.logs)
    warnings = [
        *found.warnings,
        *_pooling_warnings(options, sensors),
        *(
            prefixed(response.label if len(responses) > 1 else "", line)
            for response in responses.values()
            for line in response.warnings
        ),
        *_group_warnings(groups, len(responses)),
    ]
    return Study(
        sensors=responses,
        mean_of_sensors=groups[0],
        mean_of_controls=groups[1],
        lens_beside_none=_compared(*groups),
        alignment=found.alignment,
        switching=found.switching,
        options=stated or options,
        command=None if stated is None else command(files, stated),
        dark_V=used.dark_V,
        ambient_subtracted=bare,
        provenances=tuple(found.provenances),
        logs_found=bool(found.logs),
        warnings=tuple(dict.fromkeys(warnings)),
    )


@dataclass
class _Found:
    """Recordings as read: signals of each sensor; provenances, alignments, switching and warnings of the recordings.

    ``logs`` were detected next to recordings; ``bare`` lists whether ambient light was subtracted from each recording.
    """

    sensors: dict[str, list[Signals]] = field(default_factory=dict)
    provenances: list[Provenance] = field(default_factory=list)
    alignment: dict[str, Alignment] = field(default_factory=dict)
    switching: dict[str, Switching] = field(default_factory=dict)
    warnings: list[Caution] = field(default_factory=list)
    logs: list[Path] = field(default_factory=list)
    bare: bool = True


def _read(files: Sequence[Path], options: AnalysisOptions) -> _Found:
    found = _Found()
    for path, part in _parts(files, options):
        for signal in _signals(part, options, path, len(files)):
            found.sensors.setdefault(signal.label, []).append(signal)
        found.provenances += [one.provenance for one in (part.recording, part.log) if one is not None]
        found.bare &= part.samples.ambient_subtracted
        found.warnings += [prefixed(path.name if len(files) > 1 else "", line) for line in part.samples.warnings]
        if part.alignment is not None:
            found.alignment[part.label] = part.alignment
        if part.samples.switching is not None:
            found.switching[part.label] = part.samples.switching
        if part.beside is not None:
            found.logs.append(part.beside)
    return found


def _check_files(files: Sequence[Path], options: AnalysisOptions) -> None:
    if not files:
        raise SpecError("files", limit="at least one recording is required", remedy="name one or more recordings")
    twice = next((path for path in files if list(files).count(path) > 1), None)
    if twice is not None:
        raise SpecError("files", value=str(twice), limit="is named twice", remedy="name each recording once")
    if len(options.angle_file) not in {0, 1, len(files)}:
        limit = f"must be one for all files, or one for each of the {len(files)} files"
        raise SpecError("--angle-file", value=len(options.angle_file), limit=limit)


def _check_controls(options: AnalysisOptions, sensors: Mapping[str, object]) -> None:
    known = {name for label in sensors for name in (label, label.rpartition(".")[2])}
    for name in options.control:
        if name not in known:
            raise SpecError(
                "--control", value=name, limit=f"no sensor has this name; the sensors are {', '.join(sensors)}"
            )


def _response(signals: Sequence[Signals], options: AnalysisOptions, motions: dict[int, Motion]) -> SensorResponse:
    """Response of a sensor; errors name its file."""
    try:
        return sensor_response(signals, options, motions)
    except SolenError as bad:
        file = signals[0].source
        if file in bad.what:
            raise
        raise DataError(f"{file}: {bad.what}", value=bad.value, limit=bad.limit, remedy=bad.remedy) from None


def _parts(files: Sequence[Path], options: AnalysisOptions) -> Iterator[tuple[Path, _Part]]:
    """Yield the recordings in all files, by emitter, one after the other."""
    elsewhere = bool(options.angle_file) or options.amplitude_deg is not None
    for number, path in enumerate(files):
        stated = {} if options.pattern is None else labels(path, options.pattern)
        for group, recording in read_parts(path, sheet=options.sheet, columns=options.columns or None):
            by_emitter = waveforms(recording, options, angle="elsewhere" if elsewhere else "optional")
            for emitter, samples in by_emitter.items():
                own = ".".join(filter(None, (group, emitter)))
                part = _Part(_label(path, stated.get("sensor"), own, len(files)), samples, recording)
                yield path, _with_angle(part, options, number, files)


def _label(path: Path, stated: str | None, own: str, files: int) -> str:
    """Label of a part of a file; if the file is the only one, the part's own name."""
    label = stated or path.stem
    if not own:
        return label
    return own if files == 1 and stated is None else f"{label}.{own}"


def _with_angle(part: _Part, options: AnalysisOptions, number: int, files: Sequence[Path]) -> _Part:
    """The recording with the angle from a log, or from the commanded protocol, if it contains no angle."""
    samples = part.samples
    if options.angle_file:
        return _by_log(part, options.angle_file[number if len(options.angle_file) > 1 else 0], options)
    if options.protocol is not None:
        protocol_angle = angle_by_protocol(samples.time_s, samples.volts, samples.receivers, options.protocol)
        warnings = (*samples.warnings, *protocol_angle.warnings)
        return replace(part, samples=replace(samples, angle_deg=protocol_angle.angle_deg, warnings=warnings))
    if samples.angle_deg is not None:
        return part
    beside = find_log(files[number], files)
    if beside is None:
        reject_undriven(part.recording)
    caution = warning(f"{files[number].name} contains no angle: the angle in {beside.name}, next to it, is used")
    part = replace(part, samples=replace(samples, warnings=(caution, *samples.warnings)))
    return replace(_by_log(part, beside, options), beside=beside)


def _by_log(part: _Part, path: Path, options: AnalysisOptions) -> _Part:
    samples, log = part.samples, read(path)
    alignment, drive, warnings = _aligned(samples, log, options)
    kept = replace(samples, angle_deg=alignment.angle_deg).rows(np.isfinite(alignment.angle_deg))
    every = (*samples.warnings, *warnings, *alignment.warnings)
    kept = replace(kept, stimulus=drive.stimulus, cell=drive.cell, warnings=every)
    return replace(part, samples=kept, log=log, alignment=alignment)


def _aligned(samples: Waveforms, log: Recording, options: AnalysisOptions) -> tuple[Alignment, Drive, list[Caution]]:
    """Relation between the clocks of log and recorder, the logged quantity, and assumptions about it."""
    own = options.model_copy(update={"time": options.angle_time, "rate_hz": options.angle_rate_hz})
    warnings: list[Caution] = []
    base = sample_times(log, own, warnings, TIMES_OF_LOG)
    drive = driven(log, own, base, warnings)
    file = log.provenance.file
    if drive is None:
        limit = "no column is recognised as an angle, force or depth"
        raise DataError(file, limit=limit, remedy="name the column with --angle, --load or --depth")
    held = np.isfinite(drive.values)
    alignment = align(
        samples.time_s, samples.volts, base.time_s[held], drive.values[held], samples.window_s, drive.stimulus
    )
    return alignment, drive, [prefixed(file, line) for line in (*base.warnings, *warnings)]


def _signals(part: _Part, options: AnalysisOptions, path: Path, files: int) -> Iterator[Signals]:
    """Signals of each sensor in a recording."""
    samples, provenance = part.samples, part.recording.provenance
    has, controls = _stated_lens(provenance, options, path)
    ambient_V = ambient_by_side(part.recording)
    for sensor, receivers in by_sensor(samples.receivers, part.label, single_file=files == 1).items():
        places = list(receivers.values())
        own = has if has is not None or not controls else True
        if controls & {sensor, sensor.rpartition(".")[2]}:
            own = False
        assert samples.angle_deg is not None  # noqa: S101  required, or given by _with_angle
        yield Signals(
            label=sensor,
            receivers=tuple(receivers),
            time_s=samples.time_s,
            angle_deg=samples.angle_deg,
            volts=samples.volts[:, places],
            lens=own,
            source=path.name,
            clipped=None if samples.clipped is None else samples.clipped[:, places],
            provenance=provenance,
            unit=samples.unit,
            ambient_subtracted=samples.ambient_subtracted,
            timing_bound_s=_timing_bound_s(part),
            ambient_V=ambient_V,
            stimulus=samples.stimulus,
            cell=samples.cell,
        )


def _timing_bound_s(part: _Part) -> tuple[float, Literal["recording", "log"]] | None:
    """Largest time difference between angles and readings, from a bench, or twice the uncertainty of a log's lag."""
    if part.alignment is not None:
        return 2.0 * part.alignment.u_lag_s, "log"
    try:
        return float(part.recording.provenance.metadata["timing_bound_s"]), "recording"
    except (KeyError, ValueError):
        return None


def _stated_lens(provenance: Provenance, options: AnalysisOptions, path: Path) -> tuple[bool | None, set[str]]:
    """Whether a recording's sensors have a lens (None if unknown), and the labels of the sensors without one."""
    in_name = {} if options.pattern is None else labels(path, options.pattern)
    word = in_name.get("lens") or provenance.metadata.get("lens")
    texts = [value for key, value in provenance.metadata.items() if key.strip().casefold() in CONTROL_KEYS]
    controls = {*options.control, *(name for text in texts for name in re.split(r"[,;\s]+", text) if name)}
    return (None if word is None else has_lens(word)), controls


def _compared(lens: SensorGroup | None, control: SensorGroup | None) -> dict[str, SwingWithoutLens] | None:
    """Fraction of the swing with a lens that remains without one, by receiver."""
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
    """Warning about recordings that are pooled without a pattern."""
    if options.pattern is not None:
        return []
    return [
        prefixed(
            label,
            warning(
                f"{len(signals)} recordings with the same name are pooled as one sensor; use --pattern to separate them"
            ),
        )
        for label, signals in sensors.items()
        if len(signals) > 1
    ]


def _group_warnings(groups: Sequence[SensorGroup | None], sensors: int) -> list[Caution]:
    """Warnings about the number of sensors."""
    warnings = []
    for group, what in zip(groups, ("with a lens", "without a lens"), strict=True):
        if group is not None and group.n == 1 and sensors > 1:
            warnings.append(note(f"only one sensor {what}, so the variation between prints is unknown"))
    if groups[0] is not None and sensors == 1:
        warnings.append(note("only one sensor: its cycles show repeatability, not variation between prints"))
    return warnings
