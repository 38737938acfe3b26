"""JCAMP-DX: spectra as text records, either point by point or compressed along a uniform axis.

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
from solen.recording.spectrum_statements import spectrum

Lines = list[tuple[int, str]]
"""Lines of a record with their line numbers in the file."""

_RECORD = re.compile(r"##([^=]*)=(.*)")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
_TOKEN = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]\d+)?|[@A-Ia-i%J-Rj-rS-Zs]\d*|\?")
_SQUEEZED = {letter: digit for digit, letter in enumerate("@ABCDEFGHI")} | {
    letter: -digit for digit, letter in enumerate("abcdefghi", 1)
}
_DIFFERENCE = {letter: digit for digit, letter in enumerate("%JKLMNOPQR")} | {
    letter: -digit for digit, letter in enumerate("jklmnopqr", 1)
}
_REPEAT = {letter: digit for digit, letter in enumerate("STUVWXYZs", 1)}
_FORMS = {"(XY..XY)": "pairs", "(X++(Y..Y))": "even"}


def is_jcamp(source: Source) -> bool:
    """Whether a file begins like a JCAMP-DX file."""
    return re.match(rb"(?:\xef\xbb\xbf)?\s*##\s*TITLE\s*=", source.data[:200], re.IGNORECASE) is not None


def read(source: Source) -> Recording:
    """Read a JCAMP-DX file with one spectrum; raise `DataError` with the line of damaged or unsupported content."""
    records = dict(_records(source))
    _check_kind(source, records)
    label = next((one for one in ("XYDATA", "XYPOINTS") if one in records), None)
    if label is None:
        raise source.refused("", "has no XYDATA and no XYPOINTS", "export the spectrum as JCAMP-DX 4.24")
    form = re.sub(r"\s", "", records[label][0][1]).upper()
    if form not in _FORMS:
        limit = f"has numbers in the form {form or '(unnamed)'}; (XY..XY) and (X++(Y..Y)) are supported"
        raise source.refused(f"line {records[label][0][0]}", limit, "export the spectrum in one of these forms")
    body = records[label][1:]
    points = _pairs(source, body) if _FORMS[form] == "pairs" else _even(source, body, records)
    factors = [_stated(source, records, name, 1.0) for name in ("XFACTOR", "YFACTOR")]
    x, y = (column * factor for column, factor in zip(points, factors, strict=True))
    if _FORMS[form] == "even":
        x = points[0]
    metadata = {key: " ".join(text for _, text in lines).strip() for key, lines in records.items() if key != label}
    stated = {"XUNITS": "", "instrument": metadata.get("SPECTROMETERDATASYSTEM", ""), **metadata}
    return spectrum(
        source, "jcamp-dx", metadata, stated, x, [(metadata.get("TITLE") or "spectrum", metadata.get("YUNITS", ""), y)]
    )


def _records(source: Source) -> Iterator[tuple[str, Lines]]:
    """Return the lines of each record by normalised label.

    Comments and lines after END are omitted.
    """
    label, held = "", Lines()
    for number, line in enumerate(source.lines(), 1):
        text = line.partition("$$")[0].rstrip()
        record = _RECORD.match(text)
        if record is None:
            if text.strip() and not label:
                raise source.refused(f"line {number}", "precedes any record", "export the file again")
            held.append((number, text))
            continue
        if label:
            yield label, held
        label, held = re.sub(r"[\s\-/_]", "", record[1]).upper(), [(number, record[2].strip())]
        if label == "END":
            return
    raise source.refused("", "has no END: the file was cut off", "export it again")


def _check_kind(source: Source, records: dict[str, Lines]) -> None:
    """Raise `DataError` for files with several spectra, which are not supported."""
    kind = records.get("DATATYPE", [(0, "")])[0][1].upper()
    if kind == "LINK" or "BLOCKS" in records or "NTUPLES" in records or "PAGE" in records:
        limit = "is a JCAMP-DX file with several blocks or NTUPLES, which is not supported"
        raise source.refused("", limit, "export each spectrum to a separate file")


def _stated(source: Source, records: dict[str, Lines], label: str, default: float = math.nan) -> float:
    """Return the number in a record."""
    if label not in records:
        return default
    number, text = records[label][0]
    if not _NUMBER.fullmatch(text):
        raise source.refused(f"line {number}", f"contains no number for {label}", "export the file again", text)
    return float(text)


def _pairs(source: Source, body: Lines) -> tuple[FloatArray, FloatArray]:
    """Return points from pairs: a comma or spaces within a pair; a semicolon, spaces or a line break between pairs."""
    x: list[float] = []
    y: list[float] = []
    for number, text in body:
        cells = [cell for cell in re.split(r"[\s,;]+", text) if cell]
        wrong = next((cell for cell in cells if not _NUMBER.fullmatch(cell)), None)
        if wrong is not None or len(cells) % 2:
            limit = "is not a number" if wrong is not None else "contains an incomplete pair"
            raise source.refused(f"line {number}", limit, "export the file again", wrong)
        for place, value in zip(cells[::2], cells[1::2], strict=True):
            if len(x) > 1 and not (float(place) - x[-1]) * (x[1] - x[0]) > 0.0:
                limit = (
                    f"reverses at {place}: the abscissas of a spectrum must increase, or decrease, from line to line"
                )
                raise source.refused(f"line {number}", limit, "export the file again: lines are damaged")
            x.append(float(place))
            y.append(float(value))
    return np.array(x), np.array(y)


def _even(source: Source, body: Lines, records: dict[str, Lines]) -> tuple[FloatArray, FloatArray]:
    """Return points on a uniform axis, from FIRSTX to LASTX in NPOINTS points.

    Each line must begin with the abscissa of its first value.
    """
    first, last, count = (_stated(source, records, name) for name in ("FIRSTX", "LASTX", "NPOINTS"))
    if not (math.isfinite(first + last + count) and count >= 2):
        raise source.refused("", "lacks FIRSTX, LASTX or NPOINTS", "export it again")
    step, factor = (last - first) / (count - 1), _stated(source, records, "XFACTOR", 1.0)
    values: list[float] = []
    differences = False
    for number, text in body:
        if not text.strip():
            continue
        tokens = _tokens(source, number, text)
        if not _NUMBER.fullmatch(tokens[0]) or len(tokens) < 2:
            raise source.refused(
                f"line {number}", "does not begin with its abscissa", "export the file again", text[:20]
            )
        own, ends_in_difference = _unpacked(source, number, tokens[1:])
        place = len(values) - 1 if differences else len(values)
        if abs(float(tokens[0]) * factor - first - step * place) > abs(factor) * _last_digit(tokens[0]):
            limit = f"begins at {float(tokens[0]) * factor:g}, where {first + step * place:g} is expected"
            raise source.refused(f"line {number}", limit, "export the file again: lines are missing or damaged")
        if differences:
            if own[0] != values[-1]:
                limit = f"begins with {own[0]:g}, but the previous line ended with {values[-1]:g}"
                raise source.refused(f"line {number}", limit, "export the file again")
            own = own[1:]
        values += own
        differences = ends_in_difference
    places = np.arange(len(values), dtype=np.float64)
    return np.asarray(first + step * places, dtype=np.float64), np.array(values, dtype=np.float64)


def _last_digit(text: str) -> float:
    """Return the rounding tolerance of a written number: slightly more than one unit in the last digit."""
    mantissa, _, power = text.casefold().partition("e")
    return 1.01 * float(10.0 ** (int(power or 0) - len(mantissa.partition(".")[2])))


def _tokens(source: Source, number: int, text: str) -> list[str]:
    """Return the plain and compressed numbers on a line, which must contain nothing else."""
    if _TOKEN.sub("", text).strip(" \t,;"):
        limit = "contains something other than plain or compressed numbers"
        raise source.refused(f"line {number}", limit, "export the file again", text[:40])
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
            raise source.refused(
                f"line {number}", "repeats a value that does not exist", "export the file again", token
            )
    return values, difference
