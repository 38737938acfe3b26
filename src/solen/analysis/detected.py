"""Settings that `study` detects: the stage log next to a recording, and the command that specifies every setting.

A data acquisition program often records no angle, while the program of the stage writes a log to the same folder: a
small table of times and angles without voltages. Whether the log and the recording are from the same test becomes clear
when the log is aligned with the voltages.

Public names: `find_log`, `explicit` and `command`.
"""

import math
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from solen.analysis.sensor_response import AnalysisOptions
from solen.analysis.signals import Switching
from solen.errors import DataError, SolenError
from solen.recording import read
from solen.recording.column_roles import column_of, receiver_columns

MAX_LOG_BYTES, MAX_LOGS = 5_000_000, 40
"""Maximum size in bytes of a file that may be a stage log, and maximum number of files inspected."""
_SUFFIXES = frozenset({".csv", ".tsv", ".txt", ".dat", ".log", ".xls", ".xlsx", ".mat", ".tdms", ".lvm", ".h5", ".nc"})


def find_log(path: Path, others: Iterable[Path] = ()) -> Path | None:
    """Find the stage log in a recording's folder; None if there is no log.

    Raises
    ------
    DataError
        If several files could be the log.
    """
    recordings = {path.resolve(), *(other.resolve() for other in others)}
    tables = [file for file in sorted(path.parent.iterdir()) if file.suffix.lower() in _SUFFIXES and file.is_file()]
    tables = [table for table in tables if table.resolve() not in recordings and table.stat().st_size <= MAX_LOG_BYTES]
    namesakes = {table for table in tables if path.stem.casefold() in table.stem.casefold()}
    tables.sort(key=lambda table: table not in namesakes)
    logs = [table for table in tables[:MAX_LOGS] if _is_log(table)]
    logs = [log for log in logs if log in namesakes] or logs
    if len(logs) > 1:
        names = ", ".join(log.name for log in logs)
        limit = f"has no angle, and several files next to it could be the stage log: {names}"
        raise DataError(path.name, limit=limit, remedy="name one with --angle-file")
    return next(iter(logs), None)


def _is_log(path: Path) -> bool:
    """Return whether a file is a table of times and angles without voltages."""
    try:
        recording = read(path)
        time, angle = column_of(recording, "time"), column_of(recording, "angle")
    except SolenError:
        return False
    if time is None or angle is None:
        return False
    return not receiver_columns(
        [channel for channel in recording.channels if channel.name not in {time.name, angle.name}]
    )


def explicit(
    options: AnalysisOptions, switching: Mapping[str, Switching], logs: Sequence[Path] = ()
) -> AnalysisOptions | None:
    """Return the options equivalent to the detected settings, or None if the settings differ between recordings."""
    if logs:
        distinct = tuple(dict.fromkeys(logs))
        options = options.model_copy(update={"angle_file": distinct if len(distinct) == 1 else tuple(logs)})
    if not switching:
        return options
    settings = {(state.on_off_hz, state.on, state.mains_hz or 0.0) for state in switching.values()}
    if len(settings) > 1:
        return None
    rate_hz, on, mains_hz = settings.pop()
    update: dict[str, object] = {"on_off_hz": rate_hz, "on": on, "mains_hz": mains_hz}
    limits = [limit_V for state in switching.values() for limit_V in state.limits_V.values()]
    low, high = ({limit for limit in side if limit is not None} for side in zip(*limits, strict=True))
    if max(len(low), len(high)) == 1:
        update["rails"] = (min(low, default=-math.inf), min(high, default=math.inf))
    return options.model_copy(update=update)


def command(files: Sequence[Path], options: AnalysisOptions) -> str:
    """Return the command line that specifies all options, including the detected settings."""
    words = ["solen", "bench", "analyse", *map(str, files)]
    for name, field in type(options).model_fields.items():
        value = getattr(options, name)
        if value == field.get_default() or value is None:
            continue
        words.append(f"--{name.replace('_', '-')}")
        if value is not True:
            words += [_text(item) for item in (value if isinstance(value, tuple) else (value,))]
    return " ".join(word if word.startswith("--") else shlex.quote(word) for word in words)


def _text(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
