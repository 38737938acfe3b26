"""Choices that `study` makes automatically: the stage log next to a recording, and the full command.

A data acquisition program often records no angle, while the stage program writes its log to the same folder: a small
table of times and angles without voltages. The alignment with the voltages shows whether it belongs to the same test.

Public names: `find_log`, `explicit` and `command`.
"""

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
    taken = {path.resolve(), *(other.resolve() for other in others)}
    near = [one for one in sorted(path.parent.iterdir()) if one.suffix.lower() in _SUFFIXES]
    small = [
        one for one in near if one.resolve() not in taken and one.is_file() and one.stat().st_size <= MAX_LOG_BYTES
    ]
    named = [one for one in small if path.stem.casefold() in one.stem.casefold()]
    logs = [one for one in (*named, *(one for one in small if one not in named))[:MAX_LOGS] if _is_log(one)]
    named = [log for log in logs if log in named]
    if len(named or logs) > 1:
        names = ", ".join(one.name for one in named or logs)
        limit = f"has no angle, and several files next to it could be the stage log: {names}"
        raise DataError(path.name, limit=limit, remedy="name one with --angle-file")
    return next(iter(named or logs), None)


def _is_log(path: Path) -> bool:
    """Whether a file is a table of times and angles without voltages."""
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
    """Options equivalent to the detected settings; None if these differ between recordings."""
    if logs:
        one = tuple(dict.fromkeys(logs))
        options = options.model_copy(update={"angle_file": one if len(one) == 1 else tuple(logs)})
    found = list(switching.values())
    if not found:
        return options
    limits = [limit_V for state in found for limit_V in state.limits_V.values()]
    ends = [{end for end in side if end is not None} for side in zip(*limits, strict=True)]
    same = {(one.on_off_hz, one.on, one.mains_hz or 0.0) for one in found}
    if len(same) > 1:
        return None
    rate_hz, on, mains_hz = same.pop()
    stated: dict[str, object] = {"on_off_hz": rate_hz, "on": on, "mains_hz": mains_hz}
    if any(ends) and max(map(len, ends)) == 1:
        low, high = (
            min(end, default=default) for end, default in zip(ends, (-float("inf"), float("inf")), strict=True)
        )
        stated["rails"] = (low, high)
    return options.model_copy(update=stated)


def command(files: Sequence[Path], options: AnalysisOptions) -> str:
    """Command line with all options, including the detected settings."""
    words = ["solen", "bench", "analyse", *map(str, files)]
    for name, field in type(options).model_fields.items():
        value = getattr(options, name)
        if value == field.get_default() or value is None:
            continue
        words.append(f"--{name.replace('_', '-')}")
        if value is not True:
            words += [_text(one) for one in (value if isinstance(value, tuple) else (value,))]
    return " ".join(word if word.startswith("--") else shlex.quote(word) for word in words)


def _text(value: object) -> str:
    return f"{value:.10g}" if isinstance(value, float) else str(value)
