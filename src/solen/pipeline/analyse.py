"""Recordings of a bench, ours or any other: from files to the response of each sensor, its numbers and its figures.

Each file is one recording of one sensor, or of several by the names of their columns. Recordings of one sensor are
pooled; sensors are compared.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from solen.analysis import Analysed, Group, Settings, Signals, analysed, beside, smoothed
from solen.errors import DataError, OutputError, SolenError, SpecError
from solen.pipeline import analysis_data as data
from solen.pipeline.outputs import check_figure, check_out, write
from solen.pipeline.signals import Columns, sampled, signals_of
from solen.recording import Recording, read
from solen.recording.labels import has_lens, labels

CONTROL = ("control", "controls", "without lens", "no lens")
"""Parameters of a file that name its sensors without a lens."""


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
    names, sheet
        Columns of tables without a header, and a workbook's sheet.
    """

    files: tuple[Path, ...]
    columns: Columns = field(default_factory=Columns)
    settings: Settings = field(default_factory=Settings)
    pattern: str | None = None
    controls: tuple[str, ...] = ()
    smooth_ms: float | None = None
    names: tuple[str, ...] | None = None
    sheet: str | None = None


@dataclass(frozen=True)
class Study:
    """What was found: sensors in the order of the files, with a lens and without, and where they come from."""

    sensors: tuple[Analysed, ...]
    lens: Group | None
    control: Group | None
    recordings: tuple[Recording, ...]
    warnings: tuple[str, ...]

    @property
    def simulated(self) -> bool:
        """Whether any recording was computed."""
        return any(one.provenance.simulated for one in self.recordings)


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
        from solen.report.analyse import response_figure

        return response_figure(found.sensors, simulated=found.simulated, remark=data.remark(asked))

    def over_time() -> Any:
        from solen.report.traces import traces_figure

        return traces_figure(found.sensors, simulated=found.simulated, remark=data.remark(asked))

    return write(result, "analysis", out, {"figure": (figure, drawn), "traces": (traces, over_time)})


def check(asked: Request) -> None:
    """`SpecError` for options that cannot be."""
    if not asked.files:
        raise SpecError("analyse", limit="needs a file", remedy="name one or more recordings")
    settings, columns = asked.settings, asked.columns
    if settings.drop_cycles < 0:
        raise SpecError("--drop", value=settings.drop_cycles, limit="must be at least 0")
    positive = {"--step-deg": settings.step_deg, "--smooth-ms": asked.smooth_ms, "--rate-hz": columns.rate_hz}
    for name, value in positive.items():
        if value is not None and not 0.0 < value < float("inf"):
            raise SpecError(name, value=value, limit="must be above 0")
    if settings.rails_V is not None and not settings.rails_V[0] < settings.rails_V[1]:
        low, high = settings.rails_V
        raise SpecError("--rails", value=f"{low} {high}", limit="must be the lower and the higher voltage")
    if columns.rate_hz is not None and columns.time is not None:
        raise SpecError("--rate-hz", value=columns.rate_hz, limit="goes with no --time", remedy="leave one of them out")


def study(asked: Request) -> Study:
    """Every sensor of every file, analysed."""
    check(asked)
    parts: dict[str, list[Signals]] = {}
    recordings: list[Recording] = []
    warnings: list[str] = []
    for path in asked.files:
        recording, found, told = _recorded(path, asked)
        recordings.append(recording)
        warnings += [f"{path.name}: {line}" if len(asked.files) > 1 else line for line in told]
        for one in found:
            parts.setdefault(one.label, []).append(one)
    _check_controls(asked, parts)
    sensors = tuple(_sensor(signals, asked.settings) for signals in parts.values())
    several = len(sensors) > 1
    for sensor in sensors:
        warnings += [f"{sensor.label}: {line}" if several else line for line in sensor.warnings]
    lens = [one for one in sensors if one.lens is not False]
    control = [one for one in sensors if one.lens is False]
    groups = (beside(lens) if lens else None, beside(control) if control else None)
    return Study(sensors, *groups, tuple(recordings), tuple(dict.fromkeys(warnings)))


def _sensor(signals: Sequence[Signals], settings: Settings) -> Analysed:
    """One sensor; an error names its file."""
    try:
        return analysed(signals, settings)
    except SolenError as bad:
        named = signals[0].source
        if named in bad.what:
            raise
        raise DataError(f"{named}: {bad.what}", value=bad.value, limit=bad.limit, remedy=bad.remedy) from None


def _recorded(path: Path, asked: Request) -> tuple[Recording, list[Signals], list[str]]:
    """A file, the signals of its sensors, and what to know."""
    recording = read(path, sheet=asked.sheet, columns=asked.names)
    said = {} if asked.pattern is None else labels(path, asked.pattern)
    label = said.get("sensor") or path.stem
    one = sampled(recording, asked.columns, need_angle=True)
    warnings = list(one.warnings)
    if asked.smooth_ms is not None:
        one = replace(one, volts=smoothed(one.volts, one.base.step_s, asked.smooth_ms))
    assert one.angle_deg is not None  # noqa: S101  sampled() has refused
    alone = len(asked.files) == 1 or "sensor" not in said
    found = signals_of(one, one.angle_deg, label, path, {}, alone=len(asked.files) == 1 and alone)
    without = _without(recording, asked)
    lens = has_lens(said["lens"]) if "lens" in said else None
    return recording, [replace(each, lens=_lens(each, lens, without)) for each in found], warnings


def _without(recording: Recording, asked: Request) -> set[str]:
    """Sensors without a lens: as asked for, and as the file says."""
    said = [value for key, value in recording.provenance.metadata.items() if key.strip().casefold() in CONTROL]
    return {*asked.controls, *(name.strip() for text in said for name in text.split(","))}


def _lens(one: Signals, said: bool | None, without: set[str]) -> bool | None:
    if without & {one.label, one.label.rpartition(".")[2]}:
        return False
    return True if said is None and without else said


def _check_controls(asked: Request, parts: dict[str, list[Signals]]) -> None:
    known = {name for label in parts for name in (label, label.rpartition(".")[2])}
    for name in asked.controls:
        if name not in known:
            raise SpecError("--control", value=name, limit=f"no sensor is called so; there are {', '.join(parts)}")
