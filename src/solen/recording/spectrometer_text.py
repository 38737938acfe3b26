"""Text files of spectrometer programs: a header, a line that marks the start of the numbers, and one point per line.

Each program writes a characteristic line above the numbers (``>>>>>Begin Spectral Data<<<<<``, ``XYDATA``, ``#DATA``,
``[Data]``), and some also write a line below. The header contains the number of points, and often the first, last and
extreme values, which are compared with the rows. It may also specify the quantity of the values; if it does not, a note
reports this.

Public names: `read` and `PROGRAMS`.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from solen.arrays import FloatArray
from solen.recording.grid import truncated_number
from solen.recording.model import Recording
from solen.recording.numbers import is_number, parse
from solen.recording.source import Source
from solen.recording.spectrum_header import number as header_number
from solen.recording.spectrum_header import spectrum_recording

Header = dict[str, str]
_UNIFORMITY = 0.1  # largest deviation of an abscissa from uniform steps, as a fraction of a step
_CELL_BREAK = re.compile(r"[\s;,]+")
_DECIMAL_POINTS = re.compile(r"\d\.\d.*,|,.*\d\.\d|^-?\d+,-?\d+$")


@dataclass(frozen=True)
class Program:
    """Marks and layout of a program's files.

    Attributes
    ----------
    mark
        Pattern of bytes that only files of this program contain.
    header
        Reads the lines above the numbers into a header with the file's own keys.
    begin, end
        Lines above and below the numbers; without a line below, the numbers extend to the end of the file.
    needs_end
        Whether the line below the numbers is required.
    has_names
        Whether the line above the numbers contains the column units, and the line before it the column names.
    labels
        JCAMP-DX labels (`solen.recording.spectrum_header`) and others used here, for keys of the file.
    """

    mark: re.Pattern[bytes]
    header: Callable[[Sequence[str]], Header]
    begin: re.Pattern[str]
    end: re.Pattern[str] | None = None
    needs_end: bool = False
    has_names: bool = False
    labels: Mapping[str, str] = field(default_factory=dict)


def _pairs(separator: str) -> Callable[[Sequence[str]], Header]:
    """Return a reader of lines with name, separator and value; the first line without a separator is the title."""

    def header(lines: Sequence[str]) -> Header:
        parts = [[part.strip(' "#') for part in re.split(separator, line, maxsplit=1)] for line in lines]
        title = next((part[0] for part in parts if len(part) == 1 and part[0].strip("+")), "")
        return ({"title": title} if title else {}) | {part[0]: part[1] for part in parts if len(part) > 1}

    return header


_PERKIN = {2: "file", 3: "date", 7: "analyst", 8: "name", 11: "instrument", 12: "serial number", 13: "software"}
_PERKIN_GRAPH = ("XUNITS", "YUNITS", "y factor", "y offset", "FIRSTX", "DELTAX", "NPOINTS")
_PERKIN_NEUTRAL = {"y factor": "1", "y offset": "0"}


def _perkin(lines: Sequence[str]) -> Header:
    """Return the entries of a PerkinElmer file, defined by line number at the beginning and by order below ``#GR``."""
    stripped = [line.strip() for line in lines]
    after = stripped[stripped.index("#GR") + 1 :] if "#GR" in stripped else []
    entries = {name: stripped[index] for index, name in _PERKIN.items() if index < len(stripped)}
    return entries | dict(zip(_PERKIN_GRAPH, after, strict=False))


PROGRAMS = {
    "ocean": Program(  # OceanView and SpectraSuite, as the programs save text with a header
        mark=re.compile(rb">Begin [^\n]*Spectral Data<"),
        header=_pairs(":"),
        begin=re.compile(r">+Begin (?:Processed )?Spectral Data<+"),
        end=re.compile(r">+End (?:Processed )?Spectral Data<+"),
        labels=dict.fromkeys(
            [f"Number of Pixels in {what}" for what in ("Spectrum", "Processed Spectrum", "File")], "NPOINTS"
        )
        | dict.fromkeys(["Spectrometer", "Spectrometers"], "instrument"),
    ),
    "jasco": Program(  # Spectra Manager, as WrightTools' from_JASCO and JASCOFiles.jl describe its text and CSV
        mark=re.compile(rb"\A\W*TITLE[\t,;](?=.{0,400}?\bORIGIN[\t,;]\s*JASCO)", re.DOTALL),
        header=_pairs(r"[\t,;]"),
        begin=re.compile(r"XYDATA[,\t;]*"),
        end=re.compile(r"[,\t;]*|#{3,}.*"),
        labels={"SPECTROMETER/DATA SYSTEM": "instrument", "TITLE": "name"},
    ),
    "perkin-elmer": Program(  # UV WinLab's .asc, as hyperSpec and Bev.IO.PerkinElmerAsciiReader describe it
        mark=re.compile(rb"\A\W*PE [A-Z]{2}\s+(?:SUBTECH\s+)?SPECTRUM\s+ASCII"),
        header=_perkin,
        begin=re.compile("#DATA"),
    ),
    "avantes": Program(  # AvaSoft's converted text, as lightr describes it
        mark=re.compile(rb"\A.{0,400}?Integration time \[ms\].{0,400}?\n\[nm\]\s*;", re.DOTALL),
        header=_pairs(r":\s"),
        begin=re.compile(r"\[nm\]\s*(?:;\s*\[[^\]]*\]\s*)+"),
        has_names=True,
    ),
    "thorlabs": Program(  # ThorSpectra's text with a header, in the form that pyIVLS imitates
        mark=re.compile(rb"\A.{0,300}?\[SpectrumHeader\]", re.DOTALL),
        header=_pairs("[;,\t]"),
        begin=re.compile(r"#?\[Data\]"),
        end=re.compile(r"#?\[EndOfFile\]"),
        needs_end=True,
        labels={"Length": "NPOINTS", "XAxisUnit": "XUNITS", "YAxisUnit": "YUNITS", "InstrModel": "instrument"},
    ),
}
"""Programs, keyed by the name of their format."""


def read(source: Source) -> Recording | None:
    """Read a spectrum; return None for files from other programs; raise `DataError` with the line of any damage."""
    for name, program in PROGRAMS.items():
        if program.mark.search(source.data):
            return _read(source, name, program)
    return None


def _read(source: Source, name: str, program: Program) -> Recording:
    lines = source.lines()
    begin = next((n for n, line in enumerate(lines) if program.begin.fullmatch(line.strip())), None)
    if begin is None:
        raise source.error("", "has no complete line that marks the start of the numbers", "export it again")
    metadata = program.header(lines[: begin - program.has_names])
    entries = metadata | {program.labels[key]: value for key, value in metadata.items() if key in program.labels}
    for key, neutral in _PERKIN_NEUTRAL.items() if name == "perkin-elmer" else ():
        text = entries.get(key, neutral)
        if not is_number(text) or parse(text, "," if "," in text else ".") != float(neutral):
            limit = f"is not {neutral}: scaled values are not supported"
            raise source.error(key, limit, "export the spectrum unscaled", text)
    if entries.get("XAxis mode", "Wavelengths") != "Wavelengths":
        limit = f"has the axis {entries['XAxis mode']}, which is not supported"
        raise source.error("", limit, "save it as a function of wavelength")
    body = _body(source, program, lines, begin + 1)
    rows = _rows(source, body)
    points = entries.get("NPOINTS", "2 or more")
    if len(rows) < 2 or (points != str(len(rows)) and "NPOINTS" in entries):
        limit = f"has {len(rows)} rows, but the header specifies {points}: the file was cut off or damaged"
        raise source.error("", limit, "export it again")
    x, *columns = np.array(rows, dtype=np.float64).T
    _check_abscissas(source, list(body), x, entries)
    if program.has_names:
        heads = [[cell.strip(" []") for cell in line.split(";")[1:]] for line in lines[begin - 1 : begin + 1]]
        if len(heads[0]) != len(heads[1]) or len(heads[0]) != len(columns):
            raise source.error(
                f"line {begin}",
                f"does not have a name and a unit for each of {len(columns)} columns",
                "export it again",
            )
        pairs = [(name, unit + name if unit == "%" else unit) for name, unit in zip(*heads, strict=True)]
    else:
        units = [entries.get("YUNITS", ""), *(entries.get(f"Y{n}UNITS", "") for n in range(2, len(columns) + 1))]
        pairs = [(entries.get("name") or "spectrum", unit) for unit in units]
    traces = [(*pair, column) for pair, column in zip(pairs, columns, strict=True)]
    recording = spectrum_recording(source, name, metadata, entries, x, traces)
    *others, last = recording.channels
    return replace(recording, channels=(*others, last.noted(_last_number_note(lines, body))))


def _last_number_note(lines: Sequence[str], body: Mapping[int, str]) -> str:
    """Return a note on the last number if the file ends with this number; otherwise an empty string."""
    return (
        truncated_number(_CELL_BREAK.split(lines[-1].strip())[-1]) if lines[-1].strip() and len(lines) in body else ""
    )


def _body(source: Source, program: Program, lines: Sequence[str], first: int) -> dict[int, str]:
    """Return the lines of numbers, keyed by line number; raise `DataError` if numbers follow the end mark."""
    numbered = list(enumerate(lines[first:], first + 1))
    end = next((n for n, (_, line) in enumerate(numbered) if program.end and program.end.fullmatch(line.strip())), None)
    if end is None and program.needs_end:
        raise source.error("", "has no line that marks the end of the numbers: the file was cut off", "export it again")
    for line_number, line in numbered[end:] if end is not None else ():
        cells = _CELL_BREAK.split(line.strip())
        if len(cells) > 1 and all(map(is_number, cells)):
            raise source.error(
                f"line {line_number}", "contains numbers below the end mark", "export it again", line.strip()[:40]
            )
    return {line_number: line.strip() for line_number, line in numbered[:end] if line.strip()}


def _rows(source: Source, body: Mapping[int, str]) -> list[list[float]]:
    """Return the abscissa and values on each line; raise `DataError` if their number differs from the first line."""
    first = next(iter(body.values()), "")
    separator = "\t" if "\t" in first else ";" if ";" in first else "," if _DECIMAL_POINTS.search(first) else None
    mark = "," if separator != "," and any("," in line for line in body.values()) else "."
    rows: list[list[float]] = []
    for line_number, line in body.items():
        try:
            row = [parse(cell.strip(), mark) for cell in line.split(separator)]
        except ValueError as bad:
            raise source.error(f"line {line_number}", str(bad), "export it again", line[:40]) from None
        if len(row) < 2 or (rows and len(row) != len(rows[0])) or not np.isfinite(row).all():
            raise source.error(
                f"line {line_number}", "is not an abscissa followed by its values", "export it again", line[:40]
            )
        rows.append(row)
    return rows


def _check_abscissas(source: Source, lines: Sequence[int], x: FloatArray, entries: Mapping[str, str]) -> None:
    """Raise `DataError` at the first abscissa that is out of order, or deviates from the steps in the header."""
    steps = np.diff(x) * (1.0 if np.sum(np.diff(x) > 0.0) * 2 > x.size - 1 else -1.0)
    disordered = np.flatnonzero(~(steps > 0.0))
    if disordered.size:
        limit = f"follows {x[disordered[0]]:g}: the abscissas of a spectrum must be in ascending or descending order"
        raise source.error(
            f"line {lines[disordered[0] + 1]}", limit, "export it again: lines are damaged", f"{x[disordered[0] + 1]:g}"
        )
    first, step = header_number(source, entries, "FIRSTX"), abs(header_number(source, entries, "DELTAX"))
    uniform = first + np.sign(x[-1] - x[0]) * step * np.arange(x.size)
    deviating = np.flatnonzero(np.abs(x - uniform) > _UNIFORMITY * step)
    if deviating.size:
        limit = f"is where {uniform[deviating[0]]:g} is expected from the first abscissa and the step in the header"
        raise source.error(
            f"line {lines[deviating[0]]}", limit, "export it again: lines are damaged", f"{x[deviating[0]]:g}"
        )
