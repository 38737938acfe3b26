"""The log that the Cary program writes after the numbers, with a block for each trace in the order of the traces.

A block begins with the trace name, on a separate line and repeated on the next; then come lines such as ``Instrument
Cary 5000``, ``Collection Time: 2/6/2015 1:45:42 PM`` and ``<SBW (nm)> , 2.00``. Settings shared by all blocks apply to
the file, other settings to single traces. A file with valid numbers is accepted even if its log cannot be interpreted.

`read` returns `Logs`; `range_notes` compares a trace with the range given in its log.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.recording import dates

_WIDE = re.compile(r"(\S.*?)\s{2,}(\S.*)")
_BRACKETED = re.compile(r"([<\[].+?[>\]])\s*[,;\t]\s*(.+)")
_COLON = re.compile(r"([^:]{2,40}?)\s*:\s+(.+)")
_MAX_LINE_LENGTH = 500  # maximum number of characters of a setting
_COLLECTED = "Collection Time"


@dataclass(frozen=True)
class Logs:
    """Content of the log: settings of the file and of each trace, the instrument, and the date."""

    shared: dict[str, str]
    of_traces: list[dict[str, str]]
    instrument: str
    date: str


def read(rows: Sequence[Sequence[str]], names: Sequence[str], separator: str) -> Logs:
    """Return the log of the named traces from the rows after the numbers."""
    lines = [separator.join(row).strip().rstrip(separator).strip() for row in rows]
    blocks = _blocks(lines, names)
    settings = [_settings(block) for block in blocks]
    shared = {
        key: value for key, value in settings[0].items() if all(setting.get(key) == value for setting in settings)
    }
    stamps = [setting[_COLLECTED] for setting in settings if _COLLECTED in setting]
    first = next((dates.iso(stamp, others=stamps) or stamp for stamp in stamps), "")
    individual = [{key: value for key, value in setting.items() if key not in shared} for setting in settings]
    for trace in individual:
        if date := dates.iso(trace.get(_COLLECTED, ""), others=stamps):
            trace[_COLLECTED] = date
    instrument = next((setting["Instrument"] for setting in settings if "Instrument" in setting), "")
    return Logs(shared, individual, instrument, first)


def range_notes(log: dict[str, str], waves: FloatArray) -> list[str]:
    """Return notes if a trace does not cover the range from start to stop in its log."""
    try:
        start, stop, step = (float(log[f"{key} (nm)"]) for key in ("Start", "Stop", "UV-Vis Data Interval"))
    except (KeyError, ValueError):
        return []
    tolerance = 1.5 * max(step, float(np.max(np.abs(np.diff(waves)), initial=0.0)))
    low, high = sorted((start, stop))
    notes = []
    if waves.min() - low > tolerance or high - waves.max() > tolerance:
        covered = f"{waves[0]:g} to {waves[-1]:g} nm of the specified {start:g} to {stop:g} nm"
        notes.append(f"the scan covers {covered}: it was interrupted, or lines are missing")
    return notes


def _blocks(lines: list[str], names: Sequence[str]) -> list[list[str]]:
    """Return the lines for each trace; an empty list if a trace has no block."""
    rows: list[list[str]] = [[] for _ in names]
    trace = 0
    current: list[str] | None = None
    after_empty = True
    for line in lines:
        if after_empty and line and trace < len(names) and line == names[trace].strip():
            current = rows[trace]
            trace += 1
        elif current is not None and 0 < len(line) < _MAX_LINE_LENGTH:
            current.append(line)
        after_empty = not line
    return rows


def _settings(block: list[str]) -> dict[str, str]:
    """Return the settings in the lines of a block, keyed by name; of a repeated name, the first setting."""
    settings: dict[str, str] = {}
    for line in block:
        for form in (_BRACKETED, _COLON, _WIDE):
            match = form.fullmatch(line)
            if match and match[2].strip(" :"):
                settings.setdefault(match[1].strip(), match[2].strip())
                break
    return settings
