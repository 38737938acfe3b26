"""Dates in the spellings used by instruments, converted to ISO 8601 if it is clear which number is the month.

Public names: `iso`, `date_of` and `seconds`.
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
    """Return a date, with its time if given, in ISO 8601; empty for another text or if day and month are ambiguous.

    ``others`` are dates from the same file, which may show the order of day and month.
    """
    text = text.strip()
    if match := _YEAR_FIRST.fullmatch(text):
        year, month, day = (int(match[n]) for n in (1, 2, 3))
    elif match := _GERMAN.fullmatch(text):
        day, month, year = (int(match[n]) for n in (1, 2, 3))
    elif match := _SLASHED.fullmatch(text):
        month_first = _month_first([text, *others])
        if month_first is None:
            return ""
        first_number, second_number, year = (int(match[n]) for n in (1, 2, 3))
        month, day = (first_number, second_number) if month_first else (second_number, first_number)
    else:
        return ""
    return _iso(year, month, day, match)


def date_of(metadata: Mapping[str, str]) -> str:
    """Return the date in a file's metadata, in ISO 8601 if unambiguous, otherwise as written in the file."""
    written = next((value for key, value in metadata.items() if _KEYS.search(key)), "")
    return iso(written) or written


def seconds(cells: Sequence[str]) -> FloatArray | None:
    """Return clock times, with or without dates, in seconds since midnight of the first day; None for other cells.

    A decrease of times without a date by more than half a day means that midnight has passed. An empty cell becomes
    NaN.
    """
    parts = [_STAMP.fullmatch(cell) if cell else None for cell in cells]
    if not any(parts) or any(cell and part is None for cell, part in zip(cells, parts, strict=True)):
        return None
    texts = {part[1] or "" for part in parts if part is not None}
    days = {text: _day(text, texts) for text in texts}
    if any(day is None for day in days.values()) and len(days) > 1:
        return None
    origin = min((day for day in days.values() if day is not None), default=0)
    times_s = np.array([np.nan if part is None else _clock_s(part) for part in parts])
    times_s += [0.0 if part is None else 86400.0 * ((days[part[1] or ""] or origin) - origin) for part in parts]
    if texts == {""}:
        steps = np.diff(times_s)
        times_s[1:] += 86400.0 * np.cumsum(np.nan_to_num(steps) < -43200.0)
    return times_s


def _day(text: str, others: Iterable[str]) -> int | None:
    """Return the ordinal of a day; None if the string is not a date or the month is ambiguous."""
    date_iso = iso(text, others=others) if text else ""
    return date.fromisoformat(date_iso[:10]).toordinal() if date_iso else None


def _clock_s(part: re.Match[str]) -> float:
    meridiem = (part[6] or "").lower().replace(".", "")
    hour = int(part[2]) % 12 + 12 * (meridiem == "pm") if meridiem else int(part[2])
    return 3600.0 * hour + 60.0 * int(part[3]) + int(part[4]) + float(f"0.{part[5] or 0}")


def _month_first(texts: Iterable[str]) -> bool | None:
    """Return whether dates with slashes begin with the month; None without a number above 12 or a 12-hour clock."""
    matches = [match for text in texts if (match := _SLASHED.fullmatch(text.strip()))]
    if any(int(match[2]) > 12 for match in matches):
        return True
    if any(int(match[1]) > 12 for match in matches):
        return False
    twelve_hour = any(
        match[7] and len(match[2]) == 1 for match in matches
    )  # other countries with AM and PM write months with two digits
    return True if twelve_hour else None


def _iso(year: int, month: int, day: int, match: re.Match[str]) -> str:
    hour, minute, second = (int(match[n] or 0) for n in (4, 5, 6))
    meridiem = (match[7] or "").lower().replace(".", "")
    if meridiem and not 1 <= hour <= 12:
        return ""
    hour = hour % 12 + 12 * (meridiem == "pm") if meridiem else hour
    try:
        moment = datetime(year, month, day, hour, minute, second)
    except ValueError:
        return ""
    return moment.isoformat() if match[4] else moment.date().isoformat()
