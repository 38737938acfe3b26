"""Calibrations of a study's sensors: one per sensor, or one pooled over several prints, with cross-validation.

Public names: `calibrated_sensors`, `SensorCalibrations` and `default_path`.
"""

import statistics
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from solen import __version__
from solen.analysis.calibration.conditions import ConditionOptions, conditions
from solen.analysis.calibration.cross_validation import Check, leave_one_cycle_out, leave_one_sensor_out
from solen.analysis.calibration.estimate import Calibration, calibrated, pooled
from solen.analysis.calibration.file import SUFFIX, CalibrationFile, Cell, Checked, curves_of, rails_of
from solen.analysis.calibration.training import training_of
from solen.analysis.load_cell import least_certain
from solen.analysis.run import Run
from solen.analysis.sensor_response import SensorResponse
from solen.analysis.study import Study
from solen.errors import DataError, SpecError
from solen.files import check_name
from solen.ranks import Caution, do_not_use, note, prefixed, warning
from solen.recording import Provenance
from solen.recording.stimulus import ANGLE, FORCE, Stimulus
from solen.results import HIDDEN, Result, plain

POOL = "pooled"
_MIN_WITHIN_95 = 0.9  # smallest fraction within the 95 % bands for which the calibration may be used
_MAX_AMBIGUOUS = 0.01  # largest fraction of ambiguous readings without a warning


class CalibrationOptions(ConditionOptions):
    """Selection of the sensors to calibrate, and calibration options."""

    sensor: str | None = None
    """Calibrate only this sensor."""
    pool: bool = False
    """Compute one calibration from all prints with a lens, for use with a print that was never recorded."""
    with_controls: bool = False
    """Also calibrate sensors without a lens."""


class SensorCalibrations(Result):
    """Calibrations of a study's sensors.

    Attributes
    ----------
    calibrations
        Contents of the calibration files.
    checks
        Cross-validation of each calibration; None if there are too few cycles or prints.
    simulated
        Whether any recording is simulated.
    sources
        The recordings.
    warnings
        Warnings.
    smoothing
        Description of the smoothing, for a figure; empty without it.
    """

    calibrations: tuple[CalibrationFile, ...]
    checks: tuple[Check | None, ...] = field(metadata=HIDDEN)
    simulated: bool
    sources: tuple[Provenance, ...]
    warnings: tuple[Caution, ...]
    smoothing: str = field(default="", metadata=HIDDEN)

    def to_dict(self) -> dict[str, Any]:
        """Return the result as plain data; the calibrations' keys end in their actual units instead of V and deg."""
        data = super().to_dict()
        pairs = zip(self.calibrations, data["calibrations"], strict=True)
        return data | {"calibrations": [calibration.keyed(entry) for calibration, entry in pairs]}


def calibrated_sensors(study: Study, options: CalibrationOptions | None = None) -> SensorCalibrations:
    """Calibrate each requested sensor, or compute one calibration pooled over all sensors.

    Raises
    ------
    DataError, SpecError
        If there is no sensor with the specified name, or if a sensor has too few cycles or no pair of receivers.
    """
    options = options or CalibrationOptions()
    sensors, warnings = _selected(study, options)
    full_range = study.stimulus is not ANGLE and not options.pool
    trainings = [training_of(sensor, full_range=full_range) for sensor in sensors]
    calibrations = [calibrated(training) for training in trainings]
    if options.pool:
        checks = [leave_one_sensor_out(trainings, calibrations)]
        text = f"{len(calibrations)} prints: at least three are needed to check the calibration on a held-out print"
        cautions = [] if checks[0] else [warning(text)]
        files = [_file(study, options, sensors, pooled(calibrations), checks[0], cautions)]
    else:
        checks = [leave_one_cycle_out(training) for training in trainings]
        files = [
            _file(study, options, [sensor], calibration, check, _cautions(sensor, calibration, check))
            for sensor, calibration, check in zip(sensors, calibrations, checks, strict=True)
        ]
    warnings += [prefixed(file.sensor, caution) for file in files for caution in file.warnings]
    return SensorCalibrations(
        tuple(files), tuple(checks), study.simulated, study.sources, (*study.warnings, *warnings), study.smoothing
    )


def _selected(study: Study, options: CalibrationOptions) -> tuple[list[SensorResponse], list[Caution]]:
    """Return the sensors to calibrate, and a note on those that are omitted because they have no lens."""
    sensors = list(study.sensors.values())
    if options.sensor is not None:
        sensors = [sensor for sensor in sensors if options.sensor in {sensor.label, sensor.label.rpartition(".")[2]}]
        if not sensors:
            remedy = f"choose from {', '.join(study.sensors)}"
            raise SpecError("--sensor", value=options.sensor, limit="no sensor has this name", remedy=remedy)
    controls = ", ".join(sensor.label for sensor in sensors if sensor.lens is False)
    selected = [sensor for sensor in sensors if options.with_controls or sensor.lens is not False]
    if not selected:
        limit = f"has no lens and hardly responds to the {study.stimulus.name}"
        raise DataError(f"sensor {controls}", limit=limit, remedy="use --with-controls to calibrate it anyway")
    if options.pool and len(selected) < 2:
        limit = f"requires at least two sensors with a lens, but there is {len(selected)}"
        raise SpecError("--pool", limit=limit, remedy="add recordings of other prints, or omit --pool")
    omitted = controls and not options.with_controls
    return selected, [note(f"sensors without a lens are not calibrated: {controls}")] if omitted else []


def _file(
    study: Study,
    options: CalibrationOptions,
    sensors: Sequence[SensorResponse],
    calibration: Calibration,
    check: Check | None,
    warnings: Sequence[Caution],
) -> CalibrationFile:
    runs = [run for sensor in sensors for run in sensor.runs]
    subtracted = study.ambient_subtracted and study.options.dark_V is None
    motion, circuit = conditions(
        sensors[0].label, runs[0].signals.provenance, options, "subtracted" if subtracted else "not subtracted"
    )
    motions = [run.motion for run in runs]
    extent = {
        "low_deg": min(motion.low_deg for motion in motions),
        "high_deg": max(motion.high_deg for motion in motions),
        "speed_deg_per_s": statistics.median_high(motion.speed_deg_per_s for motion in motions),
    }
    cell = _cell(runs) if study.stimulus is FORCE else None
    checked = None if check is None else Checked(whole=check.total, parts=check.parts)
    return CalibrationFile(
        solen=__version__,
        sensor=POOL if options.pool else sensors[0].label,
        prints=tuple(sensor.label for sensor in sensors),
        simulated=study.simulated,
        cycles=calibration.cycles,
        unit=study.unit,
        stimulus=study.stimulus.name,
        load_cell=cell,
        range_deg=(float(calibration.angle_deg[0]), float(calibration.angle_deg[-1])),
        freedom_repeat=calibration.freedom[0],
        rails_V=rails_of(calibration),
        dark_V=study.dark_V,
        motion=motion.model_copy(update=extent),
        circuit=circuit,
        curves=curves_of(calibration),
        leave_one_cycle_out=None if options.pool else checked,
        leave_one_sensor_out=checked if options.pool else None,
        words=_check_lines(check, "print" if options.pool else "cycle", study.stimulus, cell),
        sources=tuple(plain(source) for source in study.sources),
        warnings=tuple(warnings),
    )


def _check_lines(check: Check | None, fold: str, stimulus: Stimulus, cell: Cell | None) -> tuple[str, ...]:
    """Return the results of a cross-validation in words; ``fold`` names what is held out: a cycle or a print."""
    if check is None:
        return ()
    total, sign = check.total, stimulus.sign
    reference = " relative to the load cell" if stimulus is FORCE else ""
    sentence = (
        f"{stimulus.plural} of a held-out {fold} are decoded with an RMS error of {total.rms_deg:.2g}{sign}{reference} "
        f"(mean {total.bias_deg:+.1g}{sign}, largest {total.worst_deg:.2g}{sign}); {100 * total.within_68:.0f} % are "
        f"within their 68 % bands, {100 * total.within_95:.0f} % within their 95 % bands"
    )
    return (sentence,) if cell is None or cell.u_scale is None else (sentence, cell.shared)


def _cautions(sensor: SensorResponse, calibration: Calibration, check: Check | None) -> list[Caution]:
    """Return warnings about the limits of a sensor's calibration."""
    warnings = []
    if check is None:
        text = "only two cycles were used: at least three are needed to check the calibration on a held-out cycle"
        warnings.append(warning(text))
    elif check.total.ambiguous > _MAX_AMBIGUOUS:
        percent = 100 * check.total.ambiguous
        warnings.append(warning(f"{percent:.2g} % of the readings match several {sensor.stimulus.plural}"))
    if check is not None and check.total.within_95 < _MIN_WITHIN_95:
        percent = 100 * check.total.within_95
        text = f"only {percent:.0f} % of the readings of held-out cycles are within their 95 % bands"
        warnings.append(do_not_use(text))
    low, high = sensor.runs[0].motion.low_deg, sensor.runs[0].motion.high_deg
    first, second, last = (float(calibration.angle_deg[index]) for index in (0, 1, -1))
    margin = 2.0 * (second - first)
    if first > low + margin or last < high - margin:
        sign = sensor.stimulus.sign
        text = (
            f"both receivers have readings only from {first:g}{sign} to {last:g}{sign}, but the motion ranges from "
            f"{low:.3g}{sign} to {high:.3g}{sign}"
        )
        warnings.append(warning(text))
    return warnings


def _cell(runs: Sequence[Run]) -> Cell | None:
    """Return the load cell of the recordings; if there are several, the one with the largest uncertainty."""
    cell = least_certain(run.signals.cell for run in runs)
    if cell is None:
        return None
    sensitivity, percent = cell.sensitivity_N_per_V, cell.u_sensitivity_percent
    return Cell(
        name=cell.name,
        sensitivity_deg_per_V=sensitivity,
        u_sensitivity_deg_per_V=None if percent is None else 0.01 * percent * abs(sensitivity),
        off_line_deg=max(run.signals.cell.u_line_N for run in runs if run.signals.cell is not None),
    )


def default_path(recordings: Sequence[Path], sensor: str) -> Path:
    """Return the default path of a sensor's calibration file, next to its recording.

    Raises
    ------
    DataError
        If the sensor's name cannot be part of a file name.
    """
    check_name("sensor", sensor, DataError, "name the file with the option --out")
    for path in recordings:
        if sensor == path.stem or sensor.startswith(f"{path.stem}."):
            return path.with_name(f"{sensor}{SUFFIX}")
    first = recordings[0]
    return first.with_name(f"{first.stem}.{sensor}{SUFFIX}" if len(recordings) == 1 else f"{sensor}{SUFFIX}")
