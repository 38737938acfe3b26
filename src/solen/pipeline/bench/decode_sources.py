"""Where voltages come from that are decoded: a recorded file, lines of CSV as they come, the journal of a run.

Each gives `Batch` after `Batch` of left and right voltages, as large as there is something to hand over.
"""

import contextlib
import json
import math
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solen.analysis import pair, side_of, smoothed
from solen.arrays import FloatArray
from solen.bench.follow import Following
from solen.errors import DataError, SpecError
from solen.pipeline.bench.analyse import Switching
from solen.pipeline.bench.signals import Columns, Sampled, by_sensor, demodulated, sampled
from solen.recording import Provenance, read_parts
from solen.recording.numbers import is_number, parse
from solen.recording.words import heading, plain
from solen.units import factor

_POLL_S = 0.05
_SEPARATORS = (";", "\t", ",")
_TIME_WORDS = ("time", "t", "timestamp", "elapsed", "zeit")


@dataclass(frozen=True)
class Batch:
    """Readings: times (n,), left and right (n, 2) with NaN where one is missing, flags of clipped ones, true angles."""

    time_s: FloatArray
    volts: FloatArray
    clipped: NDArray[np.bool_] | None = None
    angle_deg: FloatArray | None = None


@dataclass(frozen=True)
class Stream:
    """A source: whose voltages they are, how they were recorded, and the readings.

    ``ambient`` is ``subtracted``, ``not subtracted``, or None where nothing says.
    """

    batches: Iterator[Batch]
    sensor: str | None = None
    ambient: str | None = None
    provenance: Provenance | None = None
    warnings: tuple[str, ...] = ()
    simulated: bool = False


@dataclass(frozen=True)
class Wanted:
    """Which columns and which sensor."""

    columns: Columns = field(default_factory=Columns)
    sensor: str | None = None
    names: tuple[str, ...] | None = None
    sheet: str | None = None
    smooth_ms: float | None = None
    switching: Switching | None = None


def recorded(path: Path, wanted: Wanted, known: str) -> Stream:
    """Readings of a file, as `solen bench analyse` reads it; ``known`` is the calibration's sensor, which is looked for."""
    found: dict[str, Stream] = {}
    for group, recording in read_parts(path, sheet=wanted.sheet, columns=wanted.names):
        whole = sampled(recording, wanted.columns)
        one = wanted.switching
        parts = {"": whole} if one is None else demodulated(whole, one.rate_hz, one.emitters, one.settle_us)
        for emitter, part in parts.items():
            if wanted.smooth_ms is not None:
                part = replace(part, volts=smoothed(part.volts, part.base.step_s, wanted.smooth_ms))
            label = ".".join(filter(None, (group, emitter))) or path.stem
            for name, places in by_sensor(part.receivers, label, alone=True).items():
                stream = _of_sensor(part, name, places, recording.provenance)
                if stream is not None:
                    found[name] = stream
    if not found:
        limit = "has no pair of a left and a right receiver"
        raise DataError(path.name, limit=limit, remedy="name them with --channel left=COLUMN right=COLUMN")
    return found[_chosen(list(found), wanted.sensor, known, path.name)]


def _of_sensor(one: Sampled, name: str, places: dict[str, int], provenance: Provenance) -> Stream | None:
    sides = pair(tuple(places))
    if sides is None:
        return None
    columns = [list(places.values())[side] for side in sides]
    clipped = None if one.clipped is None else one.clipped[:, columns]
    batch = Batch(one.base.time_s, one.volts[:, columns], clipped, one.angle_deg)
    ambient = "subtracted" if one.subtracted else None
    return Stream(iter([batch]), name, ambient, provenance, one.warnings, provenance.simulated)


def _chosen(names: Sequence[str], asked: str | None, known: str, where: str) -> str:
    """The sensor that is asked for, else the calibration's own, else the only one."""
    for wanted in filter(None, (asked, known)):
        named = [name for name in names if wanted == name or wanted.rpartition(".")[2] == name.rpartition(".")[2]]
        if named:
            return named[0]
        if wanted == asked:
            raise SpecError("--sensor", value=asked, limit=f"{where} has {', '.join(names)}")
    if len(names) == 1:
        return names[0]
    limit = f"has {len(names)} sensors, none of them called {known}: {', '.join(names)}"
    raise DataError(where, limit=limit, remedy="choose one with --sensor")


def lines(text: Iterable[str], wanted: Wanted) -> Stream:
    """Readings of lines of CSV, each as soon as it is there; the first line is the header unless columns are named."""
    rows = iter(text)
    first = next((row for row in rows if row.strip()), None)
    if first is None:
        raise DataError("-", limit="is an empty stream: no line came", remedy="write a header and readings to it")
    separator = next((one for one in _SEPARATORS if one in first), ",")
    cells = _cells(first, separator)
    if wanted.names is None and all(is_number(cell) for cell in cells):
        limit = "begins with numbers, not with the names of its columns"
        raise DataError("-", limit=limit, remedy="name them, as in --columns time_s left_V right_V")
    layout = _Layout.of(wanted.names or cells, wanted, separator)
    if wanted.names is not None:
        rows = _with(first, rows)
    return Stream(layout.batches(rows))


def _with(first: str, rows: Iterator[str]) -> Iterator[str]:
    yield first
    yield from rows


def _cells(line: str, separator: str) -> list[str]:
    return [cell.strip().strip('"') for cell in line.strip("\r\n").split(separator)]


def _number(cell: str, mark: str) -> float | None:
    """Number of a cell; NaN where it is empty, None where it is a word."""
    try:
        return parse(cell, mark)
    except ValueError:
        return None


@dataclass(frozen=True)
class _Layout:
    """Which cells of a line are the time, left and right, and what they are multiplied by."""

    places: tuple[int | None, int, int]
    scales: tuple[float, float, float]
    count: int
    separator: str
    mark: str
    rate_hz: float | None

    @classmethod
    def of(cls, names: Sequence[str], wanted: Wanted, separator: str) -> "_Layout":
        heads = [heading(name) for name in names]
        asked = dict(wanted.columns.channels)
        left, right = (_side(names, asked, side) for side in ("left", "right"))
        timed = None if wanted.columns.rate_hz is not None else _time_place(names, wanted.columns.time)
        scales = (_scale(heads[left].unit, "V", names[left]), _scale(heads[right].unit, "V", names[right]))
        unit = "" if timed is None else (wanted.columns.time_unit or heads[timed].unit)
        first = 1.0 if timed is None else _scale(unit, "s", names[timed])
        mark = "," if separator != "," else "."
        return cls((timed, left, right), (first, *scales), len(names), separator, mark, wanted.columns.rate_hz)

    def batches(self, rows: Iterable[str]) -> Iterator[Batch]:
        """One reading at a time; a line that cannot be read is a reading that is missing."""
        for number, row in enumerate(row for row in rows if row.strip()):
            cells = _cells(row, self.separator)
            values = [_number(cell, self.mark) for cell in cells] if len(cells) == self.count else []
            volts = [self._value(values, slot) for slot in (1, 2)]
            when = number / self.rate_hz if self.rate_hz else float(number)
            stamp = when if self.places[0] is None else self._value(values, 0)
            if not math.isfinite(stamp):
                volts = [math.nan, math.nan]
            yield Batch(np.array([stamp]), np.array([volts]))

    def _value(self, values: Sequence[float | None], slot: int) -> float:
        place = self.places[slot]
        value = values[place] if values and place is not None else None
        return math.nan if value is None else value * self.scales[slot]


def _scale(unit: str, wanted: str, name: str) -> float:
    if not unit or unit == "1":
        return 1.0
    found = factor(unit, wanted)
    if found is None:
        raise DataError(f"-: {name}", value=unit, limit=f"cannot be taken to {wanted}", remedy="name another column")
    return found


def _side(names: Sequence[str], asked: dict[str, str], side: str) -> int:
    """Place of the left or the right receiver's column."""
    there = f"its columns are {', '.join(names)}"
    wanted = next((column for name, column in asked.items() if side_of(name) == side), None)
    if wanted is not None:
        found = [n for n, name in enumerate(names) if plain(wanted) in {plain(name), plain(heading(name).name)}]
    else:
        found = [n for n, name in enumerate(names) if side_of(heading(name).name) == side]
        found = [n for n in found if not any(word in names[n].lower() for word in ("ambient", "clipped"))]
    if len(found) != 1:
        limit = (
            f"has no column {wanted or f'that is told to be the {side} receiver'}"
            if not found
            else (f"has {len(found)} columns that may be the {side} receiver")
        )
        raise DataError("-", limit=limit, remedy=f"name it with --channel {side}=COLUMN; {there}")
    return found[0]


def _time_place(names: Sequence[str], asked: str | None) -> int | None:
    """Place of the time's column; None where there is none, and readings are numbered."""
    for number, name in enumerate(names):
        told = heading(name)
        if asked is not None and plain(asked) in {plain(name), plain(told.name)}:
            return number
        if asked is None and (told.quantity == "time" or plain(told.name) in _TIME_WORDS):
            return number
    if asked is not None:
        raise DataError("-", limit=f"has no column {asked}", remedy=f"its columns are {', '.join(names)}")
    return None


def journal(path: Path, wanted: Wanted, known: str, *, follow: bool) -> Stream:
    """Readings of a run's journal, ambient light taken out; with ``follow`` as it grows, until the run ends."""
    following = Following(path)
    names = [str(one["name"]) for one in following.header["sensors"]]
    name = _chosen(names, wanted.sensor, known, path.name)
    text = {"header": _plain_header(following.header)}
    simulated = bool(following.header.get("simulated"))
    provenance = Provenance(path.name, format="journal", metadata=text, simulated=simulated)
    return Stream(_grown(following, name, follow=follow), name, "subtracted", provenance, (), simulated)


def _plain_header(header: dict[str, Any]) -> str:
    return json.dumps({key: value for key, value in header.items() if key != "streams"})


def _grown(following: Following, name: str, *, follow: bool) -> Iterator[Batch]:
    while True:
        for found in following.readings(name):
            yield Batch(found.time_s, found.volts, found.clipped)
        if following.ended or not follow:
            return
        with contextlib.suppress(InterruptedError):
            time.sleep(_POLL_S)
