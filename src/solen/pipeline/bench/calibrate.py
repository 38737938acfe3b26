"""Recordings to calibrations: one for each sensor, or one of several prints, saved beside what was recorded."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from solen import __version__, files
from solen.analysis import Analysed
from solen.analysis.calibration import (
    Calibration,
    Check,
    Training,
    calibrated,
    leave_one_cycle_out,
    leave_one_sensor_out,
    training_of,
)
from solen.analysis.calibration import file as saved
from solen.analysis.calibration.fit import mean_of
from solen.errors import DataError, OutputError, SpecError
from solen.pipeline.bench.analyse import Request, Study, study
from solen.pipeline.bench.analysis_data import remark
from solen.pipeline.bench.whatmoved import motion_and_circuit
from solen.pipeline.outputs import check_figure

if TYPE_CHECKING:
    from solen.report.bench.decoding import Shown

POOL = "pooled"
_FEW = 0.9  # of the readings of a cycle left out within their bands of 95 %
_MANY = 0.01  # ambiguous


@dataclass(frozen=True)
class Asked:
    """What is asked for.

    Attributes
    ----------
    request
        The recordings and how they are analysed.
    sensor
        The only sensor to calibrate.
    pool
        Make one calibration of all prints with a lens.
    controls
        Calibrate sensors without a lens, too.
    design, motion
        Design file and kind of motion, where the recording says neither.
    """

    request: Request
    sensor: str | None = None
    pool: bool = False
    controls: bool = False
    design: Path | None = None
    motion: str | None = None


@dataclass(frozen=True)
class Made:
    """One calibration with its checks, as it is drawn and told."""

    file: saved.CalibrationFile
    calibration: Calibration
    cycles_out: Check | None
    sensors_out: Check | None


def calibrate(asked: Asked, *, out: Path | None = None, figure: Path | None = None) -> dict[str, Any]:
    """Calibrations of recorded sensors, written to files.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where a recording, an option or an output is not what it should be.
    """
    check_figure(figure)
    if out is not None and out.suffix.lower() != ".json":
        raise OutputError(str(out), limit="a calibration ends in .json", remedy="rename it")
    found = study(asked.request)
    made, told = calibrations(asked, found)
    if out is not None and len(made) > 1:
        names = ", ".join(one.file.sensor for one in made)
        remedy = "choose one with --sensor, make one of all with --pool, or leave --out out"
        raise OutputError(str(out), limit=f"is one file for {len(made)} calibrations: {names}", remedy=remedy)
    places = [out or _beside(asked.request.files, one.file.sensor) for one in made]
    if len(set(places)) < len(places):
        raise OutputError(str(places[0]), limit="would hold several calibrations", remedy="choose one with --sensor")
    contents: dict[Path, files.Content] = {
        place: saved.text_of(one.file).encode("utf-8") for place, one in zip(places, made, strict=True)
    }
    if figure is not None:
        from solen.report import canvas
        from solen.report.bench.decoding import Shown, calibration_figure

        drawn = calibration_figure(
            [_shown(one, Shown) for one in made], simulated=found.simulated, remark=remark(asked.request)
        )
        contents[figure] = canvas.encoded(drawn, figure.suffix.lower(), "calibration")
    files.write_all(contents)
    result = {
        "calibrations": [_short(one, place) for one, place in zip(made, places, strict=True)],
        "simulated": found.simulated,
        "sources": [one.as_dict() for one in found.sources],
        "warnings": [*found.warnings, *told],
    }
    return result | ({} if figure is None else {"figure": str(figure)})


def calibrations(asked: Asked, found: Study) -> tuple[list[Made], list[str]]:
    """A calibration of each sensor that is asked for, or one of all, and what to know."""
    sensors, told = _chosen(asked, found)
    trainings = [training_of(one) for one in sensors]
    ones = [calibrated(one) for one in trainings]
    if asked.pool:
        return [_pooled(asked, found, sensors, trainings, ones)], told
    made = []
    for sensor, training, one in zip(sensors, trainings, ones, strict=True):
        check = leave_one_cycle_out(training)
        warnings = _cautions(sensor, one, check)
        told += [f"{sensor.label}: {line}" for line in warnings]
        file = _file(asked, found, [sensor], one, (check, None), warnings)
        made.append(Made(file, one, check, None))
    return made, told


def _chosen(asked: Asked, found: Study) -> tuple[list[Analysed], list[str]]:
    """Sensors to be calibrated: those with a lens, or the one that is named."""
    every = list(found.sensors)
    if asked.sensor is not None:
        named = [one for one in every if asked.sensor in {one.label, one.label.rpartition(".")[2]}]
        if not named:
            limit = f"no sensor is called so; there are {', '.join(one.label for one in every)}"
            raise SpecError("--sensor", value=asked.sensor, limit=limit)
        every = named
    bare = [one.label for one in every if one.lens is False]
    kept = every if asked.controls else [one for one in every if one.lens is not False]
    if not kept:
        limit = "has no lens and hardly answers to the angle"
        remedy = "--with-controls calibrates it all the same"
        raise DataError(f"sensor {', '.join(bare)}", limit=limit, remedy=remedy)
    if asked.pool and len(kept) < 2:
        raise SpecError("--pool", value=len(kept), limit="needs at least two sensors with a lens")
    left = [] if asked.controls or not bare else [f"without a lens and not calibrated: {', '.join(bare)}"]
    return kept, left


def _pooled(
    asked: Asked,
    found: Study,
    sensors: Sequence[Analysed],
    trainings: Sequence[Training],
    ones: Sequence[Calibration],
) -> Made:
    one = mean_of(ones)
    check = leave_one_sensor_out(trainings, ones)
    warnings = []
    if check is None:
        warnings.append(f"{len(ones)} prints: what it is worth for another one cannot be checked with fewer than three")
    file = _file(asked, found, sensors, one, (None, check), warnings)
    return Made(file, one, None, check)


def _file(
    asked: Asked,
    found: Study,
    sensors: Sequence[Analysed],
    one: Calibration,
    checks: tuple[Check | None, Check | None],
    warnings: Sequence[str],
) -> saved.CalibrationFile:
    runs = [run for sensor in sensors for run in sensor.runs]
    names = {run.signals.source for run in runs}
    sources = [source for source in found.sources if source.file in names or not names & {source.file}]
    mine = [source for source in found.provenances if source.file in names]
    subtracted = found.settings.dark_V == 0.0 and asked.request.settings.dark_V is None
    ambient = "subtracted" if subtracted else "not subtracted"
    motion, circuit = motion_and_circuit(
        sensors[0].label, mine[0] if mine else None, asked.design, asked.motion, ambient
    )
    motion = motion.model_copy(
        update={
            "low_deg": min(run.motion.low_deg for run in runs),
            "high_deg": max(run.motion.high_deg for run in runs),
            "speed_deg_per_s": sorted(run.motion.speed_deg_per_s for run in runs)[len(runs) // 2],
        }
    )
    return saved.CalibrationFile(
        solen=__version__,
        sensor=POOL if asked.pool else sensors[0].label,
        prints=tuple(sensor.label for sensor in sensors),
        simulated=found.simulated,
        cycles=one.cycles,
        freedom_repeat=one.freedom[0],
        rails_v=saved.rails_of(one),
        dark_v=found.settings.dark_V,
        motion=motion,
        circuit=circuit,
        curves=saved.curves_of(one),
        leave_one_cycle_out=_checked(checks[0]),
        leave_one_sensor_out=_checked(checks[1]),
        words=tuple(_words(checks)),
        sources=tuple(source.as_dict() for source in sources),
        warnings=tuple(warnings),
    )


def _checked(check: Check | None) -> saved.Checked | None:
    if check is None:
        return None
    return saved.Checked(
        whole=saved.Part(**asdict(check.whole)), parts=tuple(saved.Part(**asdict(part)) for part in check.parts)
    )


def _words(checks: tuple[Check | None, Check | None]) -> list[str]:
    """What the checks say."""
    told = []
    for check, what in zip(checks, ("a cycle that it has not seen", "a print that it has not seen"), strict=True):
        if check is not None:
            one = check.whole
            told.append(
                f"of {what}, angles are decoded to {one.rms_deg:.2g}° (rms; mean error {one.bias_deg:+.1g}°, worst "
                f"{one.worst_deg:.2g}°); {100 * one.within_68:.0f} % lie within the bands of 68 %, "
                f"{100 * one.within_95:.0f} % within those of 95 %"
            )
    return told


def _cautions(sensor: Analysed, one: Calibration, check: Check | None) -> list[str]:
    """What a sensor's calibration cannot say."""
    told = []
    if check is None:
        told.append("two cycles: how well it decodes a cycle that it has not seen cannot be checked")
    elif check.whole.ambiguous > _MANY:
        told.append(f"{100 * check.whole.ambiguous:.2g} % of the readings have several angles that explain them")
    if check is not None and check.whole.within_95 < _FEW:
        told.append(
            f"only {100 * check.whole.within_95:.0f} % of a cycle that it has not seen lie within the bands of 95 %"
        )
    low, high = sensor.runs[0].motion.low_deg, sensor.runs[0].motion.high_deg
    first, last = float(one.angle_deg[0]), float(one.angle_deg[-1])
    step = float(one.angle_deg[1] - one.angle_deg[0])
    if first > low + 2.0 * step or last < high - 2.0 * step:
        told.append(f"both receivers have readings from {first:g}° to {last:g}° only, of {low:.3g}° to {high:.3g}°")
    return told


def _beside(recordings: Sequence[Path], label: str) -> Path:
    """Place of a calibration beside its recording."""
    first = recordings[0]
    for path in recordings:
        if label in {path.stem} or label.startswith(f"{path.stem}."):
            return path.with_name(f"{label}{saved.SUFFIX}")
    return first.with_name(f"{first.stem}.{label}{saved.SUFFIX}" if len(recordings) == 1 else f"{label}{saved.SUFFIX}")


def _shown(one: Made, kind: "type[Shown]") -> "Shown":
    """As it is drawn."""
    title = f"{one.file.sensor}: {one.file.cycles} cycles, ± 2 SD of a new reading"
    what = "a cycle" if one.sensors_out is None else "a print"
    return kind(title, one.calibration, one.cycles_out or one.sensors_out, what)


def _short(one: Made, place: Path) -> dict[str, Any]:
    """What is told of a calibration; its curves are in its file."""
    kept = ("sensor", "prints", "cycles", "motion", "circuit", "leave_one_cycle_out", "leave_one_sensor_out")
    data = one.file.model_dump(mode="json")
    low, high = float(one.calibration.angle_deg[0]), float(one.calibration.angle_deg[-1])
    told = {name: data[name] for name in (*kept, "words", "warnings")}
    return {"file": str(place), "range_deg": [low, high], **told}
