"""Dates in the spellings used by instruments, converted to ISO 8601 if it is clear which number is the month.

Public names: `iso`, `among` and `seconds`.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import date, datetime

import numpy as np

from solen.arrays import FloatArray

_CLOCK = r"(?:[T ,]+(\d{1,2}):(\d{2})(?::(\d{2})(?:\.\d+)?)?\s*([AaPp]\.?[Mm]\.?)?)?"
_YEAR_FIRST = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})" + _CLOCK)
_GERMAN = re.compile(r"(\d{1,2})\.\s?(\d{1,2})\.\s?(\d{4})" + _CLOCK)
_SLASHED = re.compile(r"(\d{1,2})[/-](\d{1,2})[/-](\d{4})" + _CLOCK)
_STAMP = re.compile(
    r"(?:(\d{1,4}[-/.]\s?\d{1,2}[-/.]\s?\d{1,4})(?:[T,]\s?|\s+))?(\d{1,2}):(\d{2}):(\d{2})(?:[.,](\d{1,9}))?"
    r"\s*([AaPp]\.?[Mm]\.?)?(?:Z|[+-]\d{2}:?\d{2})?"
)
_KEYS = re.compile(r"\b(date|datum|prüfdatum|test date|collection time|date/time stamp|measured|gemessen)\b", re.I)


def iso(text: str, *, others: Iterable[str] = ()) -> str:
    """Return a date, with any time, in ISO 8601; empty if the text is no date or if day and month are ambiguous.

    ``others`` are dates from the same file, which may show the order of day and month.
    """
    text = text.strip()
    if match := _YEAR_FIRST.fullmatch(text):
        year, month, day = (int(match[n]) for n in (1, 2, 3))
    elif match := _GERMAN.fullmatch(text):
        day, month, year = (int(match[n]) for n in (1, 2, 3))
    elif match := _SLASHED.fullmatch(text):
        first = _month_first([text, *others])
        if first is None:
            return ""
        one, two, year = (int(match[n]) for n in (1, 2, 3))
        month, day = (one, two) if first else (two, one)
    else:
        return ""
    return _written(year, month, day, match)


def among(metadata: Mapping[str, str]) -> str:
    """Return the date among a file's parameters, in ISO 8601 if unambiguous, otherwise as written in the file."""
    stated = next((value for key, value in metadata.items() if _KEYS.search(key)), "")
    return iso(stated) or stated


def seconds(cells: Sequence[str]) -> FloatArray | None:
    """Convert clock times, with or without dates, to seconds since midnight of the first day.

    The result is None if a cell is not a time.

    If times without a date decrease by more than half a day, midnight has passed. An empty cell becomes NaN.
    """
    parts = [_STAMP.fullmatch(cell) if cell else None for cell in cells]
    if not any(parts) or any(cell and part is None for cell, part in zip(cells, parts, strict=True)):
        return None
    texts = {part[1] or "" for part in parts if part is not None}
    days = {text: _day(text, texts) for text in texts}
    if any(day is None for day in days.values()) and len(days) > 1:
        return None
    origin = min((day for day in days.values() if day is not None), default=0)
    found = np.array([np.nan if part is None else _clock_s(part) for part in parts])
    found += [0.0 if part is None else 86400.0 * ((days[part[1] or ""] or origin) - origin) for part in parts]
    if texts == {""}:
        steps = np.diff(found)
        found[1:] += 86400.0 * np.cumsum(np.nan_to_num(steps) < -43200.0)
    return found


def _day(text: str, others: Iterable[str]) -> int | None:
    """Return the ordinal of a day; None if the text is no date or the month is ambiguous."""
    stated = iso(text, others=others) if text else ""
    return date.fromisoformat(stated[:10]).toordinal() if stated else None


def _clock_s(part: re.Match[str]) -> float:
    half = (part[6] or "").lower().replace(".", "")
    hour = int(part[2]) % 12 + 12 * (half == "pm") if half else int(part[2])
    return 3600.0 * hour + 60.0 * int(part[3]) + int(part[4]) + float(f"0.{part[5] or 0}")


def _month_first(texts: Iterable[str]) -> bool | None:
    """Whether the month comes first in dates with slashes, as shown by a number above 12 or a 12-hour clock."""
    found = [match for text in texts if (match := _SLASHED.fullmatch(text.strip()))]
    if any(int(match[2]) > 12 for match in found):
        return True
    if any(int(match[1]) > 12 for match in found):
        return False
    american = any(match[7] and len(match[2]) == 1 for match in found)  # others with AM and PM write 06 for a month
    return True if american else None


def _written(year: int, month: int, day: int, match: re.Match[str]) -> str:
    hour, minute, second = (int(match[n] or 0) for n in (4, 5, 6))
    half = (match[7] or "").lower().replace(".", "")
    if half and not 1 <= hour <= 12:
        return ""
    hour = hour % 12 + 12 * (half == "pm") if half else hour
    try:
        when = datetime(year, month, day, hour, minute, second)
    except ValueError:
        return ""
    return when.isoformat() if match[4] else when.date().isoformat()
