"""JCAMP-DX files: spectra as text records, either as pairs or compressed on a uniform axis.

A file consists of records ``##LABEL=value``, one of which contains the numbers. ``(XY..XY)`` denotes pairs;
``(X++(Y..Y))`` denotes values on a uniform axis, in lines that begin with the abscissa. The values are plain or
compressed: digits joined by pseudo-digits (squeezed), differences, repeats. Redundant entries (number of points, line
abscissas, first value, last value before each line of differences) are checked against the numbers to detect damage.

Public names: `is_jcamp` and `read`. Format: McDonald and Wilks, "JCAMP-DX: A Standard Form for Exchange of Infrared
Spectra in Computer Readable Form", Appl. Spectrosc. 42 (1988) 151, version 4.24.
"""

import math
import re
from collections.abc import Iterator, Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.recording.model import Recording
from solen.recording.source import Source
from solen.recording.spectrum_header import spectrum_recording

Lines = list[tuple[int, str]]
"""Lines of a record with their line numbers in the file."""

_RECORD = re.compile(r"##([^=]*)=(.*)")
_PLAIN_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_TOKEN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]\d+)?|[@A-Ia-i%J-Rj-rS-Zs]\d*|\?")
_SQUEEZED = {letter: digit for digit, letter in enumerate("@ABCDEFGHI")} | {
    letter: -digit for digit, letter in enumerate("abcdefghi", 1)
}
_DIFFERENCE = {letter: digit for digit, letter in enumerate("%JKLMNOPQR")} | {
    letter: -digit for digit, letter in enumerate("jklmnopqr", 1)
}
_REPEAT = {letter: digit for digit, letter in enumerate("STUVWXYZs", 1)}
_FORMS = {"(XY..XY)": "pairs", "(X++(Y..Y))": "uniform"}


def is_jcamp(source: Source) -> bool:
    """Return whether a file begins like a JCAMP-DX file."""
    return re.match(rb"(?:\xef\xbb\xbf)?\s*##\s*TITLE\s*=", source.data[:200], re.IGNORECASE) is not None


def read(source: Source) -> Recording:
    """Read a JCAMP-DX file with one spectrum; raise `DataError` with the line of damaged or unsupported content."""
    records = dict(_records(source))
    _check_kind(source, records)
    label = next((name for name in ("XYDATA", "XYPOINTS") if name in records), None)
    if label is None:
        raise source.error("", "has no XYDATA and no XYPOINTS", "export the spectrum as JCAMP-DX 4.24")
    form = re.sub(r"\s", "", records[label][0][1]).upper()
    if form not in _FORMS:
        limit = f"has numbers in the form {form or '(unnamed)'}; (XY..XY) and (X++(Y..Y)) are supported"
        raise source.error(f"line {records[label][0][0]}", limit, "export the spectrum in one of these forms")
    body = records[label][1:]
    points = _pairs(source, body) if _FORMS[form] == "pairs" else _uniform(source, body, records)
    factors = [_number(source, records, name, 1.0) for name in ("XFACTOR", "YFACTOR")]
    x, y = (column * factor for column, factor in zip(points, factors, strict=True))
    if _FORMS[form] == "uniform":
        x = points[0]
    metadata = {key: " ".join(text for _, text in lines).strip() for key, lines in records.items() if key != label}
    entries = {"XUNITS": "", "instrument": metadata.get("SPECTROMETERDATASYSTEM", ""), **metadata}
    return spectrum_recording(
        source, "jcamp-dx", metadata, entries, x, [(metadata.get("TITLE") or "spectrum", metadata.get("YUNITS", ""), y)]
    )


def _records(source: Source) -> Iterator[tuple[str, Lines]]:
    """Yield the normalised label and the lines of each record, without comments and lines after END."""
    label, lines = "", Lines()
    for number, line in enumerate(source.lines(), 1):
        text = line.partition("$$")[0].rstrip()
        record = _RECORD.match(text)
        if record is None:
            if text.strip() and not label:
                raise source.error(f"line {number}", "precedes the first record", "export the file again")
            lines.append((number, text))
            continue
        if label:
            yield label, lines
        label, lines = re.sub(r"[\s\-/_]", "", record[1]).upper(), [(number, record[2].strip())]
        if label == "END":
            return
    raise source.error("", "has no END: the file was cut off", "export it again")


def _check_kind(source: Source, records: dict[str, Lines]) -> None:
    """Raise `DataError` for files of several spectra, which are not supported."""
    kind = records.get("DATATYPE", [(0, "")])[0][1].upper()
    if kind == "LINK" or "BLOCKS" in records or "NTUPLES" in records or "PAGE" in records:
        limit = "is a JCAMP-DX file with several blocks or NTUPLES, which is not supported"
        raise source.error("", limit, "export each spectrum to a separate file")


def _number(source: Source, records: dict[str, Lines], label: str, default: float = math.nan) -> float:
    """Return the number in a record, or a default if there is no such record."""
    if label not in records:
        return default
    number, text = records[label][0]
    if not _PLAIN_NUMBER.fullmatch(text):
        raise source.error(f"line {number}", f"contains no number for {label}", "export the file again", text)
    return float(text)


def _pairs(source: Source, body: Lines) -> tuple[FloatArray, FloatArray]:
    """Return points from pairs: a comma or spaces within a pair; a semicolon, spaces or a line break between pairs."""
    x: list[float] = []
    y: list[float] = []
    for number, text in body:
        cells = [cell for cell in re.split(r"[\s,;]+", text) if cell]
        wrong = next((cell for cell in cells if not _PLAIN_NUMBER.fullmatch(cell)), None)
        if wrong is not None or len(cells) % 2:
            limit = "is not a number" if wrong is not None else "contains an incomplete pair"
            raise source.error(f"line {number}", limit, "export the file again", wrong)
        for abscissa, value in zip(cells[::2], cells[1::2], strict=True):
            if len(x) > 1 and not (float(abscissa) - x[-1]) * (x[1] - x[0]) > 0.0:
                limit = (
                    f"reverses at {abscissa}: the abscissas of a spectrum must increase, or decrease, from line to line"
                )
                raise source.error(f"line {number}", limit, "export the file again: lines are damaged")
            x.append(float(abscissa))
            y.append(float(value))
    return np.array(x), np.array(y)


def _uniform(source: Source, body: Lines, records: dict[str, Lines]) -> tuple[FloatArray, FloatArray]:
    """Return points on the uniform axis of NPOINTS points from FIRSTX to LASTX.

    Each line must begin with the abscissa of its first value.
    """
    first, last, count = (_number(source, records, name) for name in ("FIRSTX", "LASTX", "NPOINTS"))
    if not (math.isfinite(first + last + count) and count >= 2):
        raise source.error("", "lacks FIRSTX, LASTX or NPOINTS", "export it again")
    step, factor = (last - first) / (count - 1), _number(source, records, "XFACTOR", 1.0)
    values: list[float] = []
    differences = False
    for number, text in body:
        if not text.strip():
            continue
        tokens = _tokens(source, number, text)
        if not _PLAIN_NUMBER.fullmatch(tokens[0]) or len(tokens) < 2:
            raise source.error(f"line {number}", "does not begin with its abscissa", "export the file again", text[:20])
        line_values, ends_in_difference = _unpacked(source, number, tokens[1:])
        index = len(values) - 1 if differences else len(values)
        if abs(float(tokens[0]) * factor - first - step * index) > abs(factor) * _last_digit(tokens[0]):
            limit = f"begins at {float(tokens[0]) * factor:g}, where {first + step * index:g} is expected"
            raise source.error(f"line {number}", limit, "export the file again: lines are missing or damaged")
        if differences:
            if line_values[0] != values[-1]:
                limit = f"begins with {line_values[0]:g}, but the previous line ended with {values[-1]:g}"
                raise source.error(f"line {number}", limit, "export the file again")
            line_values = line_values[1:]
        values += line_values
        differences = ends_in_difference
    indices = np.arange(len(values), dtype=np.float64)
    return np.asarray(first + step * indices, dtype=np.float64), np.array(values, dtype=np.float64)


def _last_digit(text: str) -> float:
    """Return the rounding tolerance of a written number: slightly more than a unit of its last digit."""
    mantissa, _, power = text.casefold().partition("e")
    return 1.01 * float(10.0 ** (int(power or 0) - len(mantissa.partition(".")[2])))


def _tokens(source: Source, number: int, text: str) -> list[str]:
    """Return the plain and compressed numbers on a line; raise `DataError` if it contains anything else."""
    if _TOKEN.sub("", text).strip(" \t,;"):
        limit = "contains something other than plain or compressed numbers"
        raise source.error(f"line {number}", limit, "export the file again", text[:40])
    return _TOKEN.findall(text)


def _unpacked(source: Source, number: int, tokens: Sequence[str]) -> tuple[list[float], bool]:
    """Return the values of the tokens on a line, and whether the last token was a difference."""
    values: list[float] = []
    step, difference = 0.0, False
    for token in tokens:
        letter, digits = token[0], token[1:]
        if letter in _REPEAT and (values or difference):
            for _ in range(int(f"{_REPEAT[letter]}{digits}") - 1):
                values.append(values[-1] + (step if difference else 0.0))
        elif letter in _DIFFERENCE and values:
            step, difference = float(f"{_DIFFERENCE[letter]}{digits}"), True
            values.append(values[-1] + step)
        elif letter == "?":
            values.append(math.nan)
            difference = False
        elif letter not in _REPEAT and letter not in _DIFFERENCE:
            values.append(float(f"{_SQUEEZED[letter]}{digits}") if letter in _SQUEEZED else float(token))
            difference = False
        else:
            raise source.error(f"line {number}", "repeats a value that does not exist", "export the file again", token)
    return values, difference
