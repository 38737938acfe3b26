"""Recordings of a bench, ours or any other: from files to the response of each sensor, its numbers and its figures.

Each file is one recording of one sensor, or of several by the names of their columns. Recordings of one sensor are
pooled; sensors are compared.
"""

import importlib.resources
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from solen import files
from solen.analysis import Analysed, Group, Motion, Settings, Signals, analysed, beside, smoothed
from solen.analysis.unseen import Protocol, unseen
from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.pipeline.bench import analysis_data as data
from solen.pipeline.bench.demodulate_data import SETTLE_US
from solen.pipeline.bench.signals import NOWHERE, Columns, Sampled, demodulated, sampled, signals_of, with_log
from solen.pipeline.outputs import check_figure, check_out, leave_all
from solen.recording import Provenance, Recording, read, read_parts
from solen.recording.labels import has_lens, labels

EXAMPLE = "rotation-simulated.csv"
_WIDEST = 0.05  # share of a recording over which a moving mean may go
CONTROL = ("control", "controls", "without lens", "no lens")
"""Parameters of a file that name its sensors without a lens."""


@dataclass(frozen=True)
class Switching:
    """How emitters switch: readings a second of each, how many take turns, and the time left out after a switch."""

    rate_hz: float
    emitters: int = 1
    settle_us: float = SETTLE_US


@dataclass(frozen=True)
class Request:
    """What is asked of a set of files.

    Attributes
    ----------
    files
        The recordings.
    columns, settings
        Which columns are what, and how they are analysed.
    pattern
        Labels in the names of the files.
    controls
        Sensors without a lens, by their labels.
    smooth_ms
        Width of a moving mean; None for none.
    logs
        Logs of the angle on another clock: one for all files, or one for each.
    log_time
        Column of a log's times.
    protocol
        What the stage was asked to do, where nothing recorded its angle.
    switching
        How the emitters switch, of raw waveforms; None for readings.
    names, sheet
        Columns of tables without a header, and a workbook's sheet.
    """

    files: tuple[Path, ...]
    columns: Columns = field(default_factory=Columns)
    settings: Settings = field(default_factory=Settings)
    pattern: str | None = None
    controls: tuple[str, ...] = ()
    smooth_ms: float | None = None
    logs: tuple[Path, ...] = ()
    log_time: str | None = None
    protocol: Protocol | None = None
    switching: Switching | None = None
    names: tuple[str, ...] | None = None
    sheet: str | None = None


@dataclass(frozen=True)
class Study:
    """What was found: sensors in the order of the files, with a lens and without, and where they come from."""

    settings: Settings
    sensors: tuple[Analysed, ...]
    lens: Group | None
    control: Group | None
    provenances: tuple[Provenance, ...]
    alignments: tuple[dict[str, Any], ...]
    warnings: tuple[str, ...]

    @property
    def simulated(self) -> bool:
        """Whether any recording was computed."""
        return any(one.simulated for one in self.provenances)

    @property
    def sources(self) -> list[Provenance]:
        """Where it comes from, each file once."""
        return list({one.sha256: one for one in self.provenances}.values())


def analyse(
    asked: Request, *, out: Path | None = None, figure: Path | None = None, traces: Path | None = None
) -> dict[str, Any]:
    """Response and numbers of each sensor, as plain data.

    Parameters
    ----------
    asked
        The files and how to analyse them.
    out, figure, traces
        Where to leave the result, the figure of the response, and that of the voltages over time.

    Raises
    ------
    DataError, SpecError, OutputError
        In one line, where a file, an option or an output is not what it should be.
    """
    check(asked)
    check_out(out)
    for one in (figure, traces):
        check_figure(one)
    if figure is not None and figure == traces:
        raise OutputError(str(traces), limit="is the name of both figures", remedy="give each its own")
    found = study(asked)
    result = data.result(found, asked)

    def drawn() -> Any:
        from solen.report.bench.analyse import response_figure

        return response_figure(found.sensors, simulated=found.simulated, remark=data.remark(asked))

    def over_time() -> Any:
        from solen.report.bench.traces import traces_figure

        return traces_figure(found.sensors, simulated=found.simulated, remark=data.remark(asked))

    return leave_all(result, "analysis", out, {"figure": (figure, drawn), "traces": (traces, over_time)})


def check(asked: Request) -> None:
    """`SpecError` for options that cannot be."""
    if not asked.files:
        raise SpecError("analyse", limit="needs a file", remedy="name one or more recordings")
    twice = next((path for path in asked.files if asked.files.count(path) > 1), None)
    if twice is not None:
        raise SpecError("analyse", value=str(twice), limit="is named twice", remedy="name each recording once")
    settings, columns = asked.settings, asked.columns
    _check_numbers(asked)
    if asked.log_time is not None and not asked.logs:
        raise SpecError("--angle-time", value=asked.log_time, limit="is for a log", remedy="name it with --angle-file")
    if settings.rails_V is not None and not settings.rails_V[0] < settings.rails_V[1]:
        low, high = settings.rails_V
        raise SpecError("--rails", value=f"{low} {high}", limit="must be the lower and the higher voltage")
    if asked.protocol is not None:
        _check_protocol(asked, asked.protocol)
    if asked.switching is not None and not (asked.switching.rate_hz > 0.0 and asked.switching.emitters >= 1):
        limit = "must be above 0, and --emitters at least 1"
        raise SpecError("--on-off-hz", value=asked.switching.rate_hz, limit=limit)
    if len(asked.logs) not in {0, 1, len(asked.files)}:
        limit = f"one for all files, or one for each of the {len(asked.files)}"
        raise SpecError("--angle-file", value=len(asked.logs), limit=limit)
    if columns.rate_hz is not None and columns.time is not None:
        raise SpecError("--rate-hz", value=columns.rate_hz, limit="goes with no --time", remedy="leave one of them out")


def _check_numbers(asked: Request) -> None:
    """`SpecError` for numbers that cannot be."""
    settings, columns = asked.settings, asked.columns
    if settings.drop_cycles < 0:
        raise SpecError("--drop", value=settings.drop_cycles, limit="must be at least 0")
    for name, number in {"--zero-deg": columns.zero_deg, "--dark-v": settings.dark_V}.items():
        if number is not None and not math.isfinite(number):
            raise SpecError(name, value=number, limit="must be a number")
    positive = {"--step-deg": settings.step_deg, "--smooth-ms": asked.smooth_ms, "--rate-hz": columns.rate_hz}
    for name, value in positive.items():
        if value is not None and not 0.0 < value < float("inf"):
            raise SpecError(name, value=value, limit="must be above 0")


def with_example(asked: Request, path: Path) -> Request:
    """Also the simulated recording that solen ships, written to a file that is not there yet."""
    if path.suffix.lower() != ".csv":
        raise OutputError(str(path), limit="a recording ends in .csv", remedy="rename it")
    if path.exists():
        raise OutputError(str(path), limit="exists already", remedy="name another file or remove it")
    shipped = importlib.resources.files("solen.analysis") / "examples" / EXAMPLE
    files.write_bytes(path, shipped.read_bytes())
    return replace(asked, files=(*asked.files, path))


def _check_protocol(asked: Request, protocol: Protocol) -> None:
    values = (protocol.amplitude_deg, protocol.speed_deg_per_s)
    for name, value in zip(("--amplitude-deg", "--speed-deg-per-s"), values, strict=True):
        if not 0.0 < value < float("inf"):
            raise SpecError(name, value=value, limit="must be above 0")
    if not 0.0 <= protocol.hold_s < float("inf"):
        raise SpecError("--hold-s", value=protocol.hold_s, limit="must be at least 0")
    if asked.logs or asked.columns.angle is not None:
        limit = "is for recordings without an angle"
        raise SpecError("--amplitude-deg", value=protocol.amplitude_deg, limit=limit, remedy="leave out the other")


def study(asked: Request) -> Study:
    """Every sensor of every file, analysed."""
    check(asked)
    parts: dict[str, list[Signals]] = {}
    provenances: list[Provenance] = []
    alignments: list[dict[str, Any]] = []
    warnings: list[str] = []
    bare: list[bool] = []
    for number, path in enumerate(asked.files):
        for part in _parts(path, asked, number):
            provenances += part.provenances
            alignments += part.alignments
            bare.append(part.subtracted)
            warnings += [f"{path.name}: {line}" if len(asked.files) > 1 else line for line in part.warnings]
            for one in part.signals:
                parts.setdefault(one.label, []).append(one)
    _check_controls(asked, parts)
    warnings += _pooled(asked, parts)
    settings = asked.settings
    if settings.dark_V is None and all(bare):  # without ambient light, no light is no voltage
        settings = replace(settings, dark_V=0.0)
    motions: dict[int, Motion] = {}
    sensors = tuple(_sensor(signals, settings, motions) for signals in parts.values())
    several = len(sensors) > 1
    for sensor in sensors:
        warnings += [f"{sensor.label}: {line}" if several else line for line in sensor.warnings]
    lens = [one for one in sensors if one.lens is not False]
    control = [one for one in sensors if one.lens is False]
    groups = (beside(lens) if lens else None, beside(control) if control else None)
    return Study(settings, sensors, *groups, tuple(provenances), tuple(alignments), tuple(dict.fromkeys(warnings)))


def _pooled(asked: Request, parts: Mapping[str, Sequence[Signals]]) -> list[str]:
    """What is taken for one sensor though no pattern says so."""
    if asked.pattern is not None:
        return []
    return [
        f"{label}: {len(found)} recordings of one name are taken for one sensor; --pattern tells them apart"
        for label, found in parts.items()
        if len(found) > 1
    ]


def _sensor(signals: Sequence[Signals], settings: Settings, motions: dict[int, Motion]) -> Analysed:
    """One sensor; an error names its file."""
    try:
        return analysed(signals, settings, motions)
    except SolenError as bad:
        named = signals[0].source
        if named in bad.what:
            raise
        raise DataError(f"{named}: {bad.what}", value=bad.value, limit=bad.limit, remedy=bad.remedy) from None


@dataclass(frozen=True)
class _Part:
    """What one recording of a file gave."""

    signals: list[Signals]
    provenances: list[Provenance]
    alignments: list[dict[str, Any]]
    warnings: list[str]
    subtracted: bool


def _parts(path: Path, asked: Request, number: int) -> Iterator[_Part]:
    """Each recording of a file, one after the other."""
    said = {} if asked.pattern is None else labels(path, asked.pattern)
    elsewhere = bool(asked.logs) or asked.protocol is not None
    columns = replace(asked.columns, angle=NOWHERE) if elsewhere else asked.columns
    for group, recording in read_parts(path, sheet=asked.sheet, columns=asked.names):
        whole = sampled(recording, columns, need_angle=not elsewhere)
        one = asked.switching
        parts = {"": whole} if one is None else demodulated(whole, one.rate_hz, one.emitters, one.settle_us)
        for emitter, part in parts.items():
            name = _name(path, said, [group, emitter], len(asked.files))
            yield _part(path, asked, number, recording, part, name, said.get("lens"))


def _name(path: Path, said: Mapping[str, str], parts: Sequence[str], files: int) -> str:
    """Label of a part of a file: its own name where the file is the only one."""
    own = ".".join(filter(None, parts))
    label = said.get("sensor") or path.stem
    if not own:
        return label
    return own if files == 1 and "sensor" not in said else f"{label}.{own}"


def _part(
    path: Path, asked: Request, number: int, recording: Recording, one: Sampled, label: str, lens: str | None
) -> _Part:
    """Signals of one recording, with the angle that it has or is given."""
    if asked.smooth_ms is not None:
        _check_smooth(asked.smooth_ms, one, path)
        one = replace(one, volts=smoothed(one.volts, one.base.step_s, asked.smooth_ms))
    provenances, told = [recording.provenance], list[str]()
    aligned: list[dict[str, Any]] = []
    if asked.logs:
        log = read(asked.logs[number if len(asked.logs) > 1 else 0])
        one, told, aligned = with_log(one, log, replace(asked.columns, time=asked.log_time, rate_hz=None), path)
        provenances.append(log.provenance)
    elif asked.protocol is not None:
        guessed = unseen(one.base.time_s, one.volts, one.receivers, asked.protocol)
        one, told = replace(one, angle_deg=guessed.angle_deg), list(guessed.warnings)
    if one.angle_deg is None:
        raise DataError(path.name, limit="has no angle", remedy="name its column with --angle")
    without = _without(recording, asked)
    stated = lens or recording.provenance.metadata.get("lens")
    has = None if stated is None else has_lens(stated)
    found = [
        replace(each, lens=_lens(each, has, without))
        for each in signals_of(one, one.angle_deg, label, path, len(asked.files) == 1)
    ]
    return _Part(found, provenances, aligned, [*one.warnings, *told], one.subtracted)


def _check_smooth(width_ms: float, one: Sampled, path: Path) -> None:
    """`SpecError` for a mean over more than cycles could be seen in."""
    most_s = _WIDEST * float(one.base.time_s[-1] - one.base.time_s[0])
    if 1e-3 * width_ms > most_s:
        limit = f"must be at most {1e3 * most_s:.4g}, a twentieth of {path.name}"
        raise SpecError("--smooth-ms", value=width_ms, limit=limit, remedy="choose a smaller one, or none")


def _without(recording: Recording, asked: Request) -> set[str]:
    """Sensors without a lens: as asked for, and as the file says."""
    said = [value for key, value in recording.provenance.metadata.items() if key.strip().casefold() in CONTROL]
    return {*asked.controls, *(name for text in said for name in re.split(r"[,;\s]+", text) if name)}


def _lens(one: Signals, said: bool | None, without: set[str]) -> bool | None:
    if without & {one.label, one.label.rpartition(".")[2]}:
        return False
    return True if said is None and without else said


def _check_controls(asked: Request, parts: dict[str, list[Signals]]) -> None:
    known = {name for label in parts for name in (label, label.rpartition(".")[2])}
    for name in asked.controls:
        if name not in known:
            raise SpecError("--control", value=name, limit=f"no sensor is called so; there are {', '.join(parts)}")
