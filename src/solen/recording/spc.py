"""SPC files, the binary format of Galactic's GRAMS that many spectrometers write, with one or several spectra.

A fixed header is followed by the abscissas, unless they are uniform, and then by the spectra. Each spectrum has a
header with its position in the series and the storage of its values. A value is a floating-point number, or an integer
times a power of two from the header. The counts (points, spectra, offsets) must account for the entire file, and thus
reveal truncation or damage.

Public names: `is_spc` and `read`. Format: "A Brief Guide to SPC File Format and Using GSPCIO", Galactic Industries
(1998), and its header file SPC.H. The older layout (version 4Dh) is rejected.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.recording.model import Recording
from solen.recording.source import Source
from solen.recording.spectrum_header import spectrum_recording

_HEADER, _SUB = 512, 32
_NEW, _BIG_ENDIAN, _OLD = 0x4B, 0x4C, 0x4D
_SHORT, _SEPARATE_EXPONENTS, _SEPARATE_X, _LISTED_X = 0x01, 0x04, 0x40, 0x80
_MAX_GAP = 3  # maximum number of unused bytes before the log; a further value would be longer
_FLOAT = -128  # exponent of floating-point values
_X = {1: "1/CM", 2: "MICROMETERS", 3: "NANOMETERS"}
_Y = {2: "ABSORBANCE", 11: "%", 128: "TRANSMITTANCE", 129: "REFLECTANCE"}
_FRACTIONS = {"TRANSMITTANCE", "REFLECTANCE"}
_MAX_PERCENT = 2.0  # larger fractions of light are in percent: some programs write %T as transmission


@dataclass(frozen=True)
class _Head:
    """File header: byte order, flags, exponent, counts and ends of the axis, units of axis and values, comment, log."""

    order: str
    flags: int
    exponent: int
    points: int
    first: float
    last: float
    spectra: int
    x: int
    y: int
    comment: str
    log: int

    @property
    def short(self) -> bool:
        """Whether values are stored in 16 bits."""
        return bool(self.flags & _SHORT)


def is_spc(source: Source) -> bool:
    """Return whether a file begins like any version of this format."""
    data = source.data
    if len(data) < _HEADER or data[1] not in {_NEW, _BIG_ENDIAN, _OLD} or data.isascii():
        return False
    return data[1] == _OLD or (0 < _head(data).points + _head(data).spectra < len(data) and data[4:8] != b"\0\0\0\0")


def read(source: Source) -> Recording:
    """Read all spectra onto one axis; raise `DataError` if the file is incomplete or not supported."""
    if source.data[1] == _OLD:
        limit = "is an SPC file of the old layout (4Dh), which is not supported"
        raise source.error("", limit, "save it again in its program, or as CSV or JCAMP-DX")
    head = _head(source.data)
    if head.x not in _X:
        limit = f"has the SPC axis type {head.x}; wavelengths and wavenumbers (1 to 3) are supported"
        raise source.error("", limit, "export it as a function of wavelength or wavenumber")
    if head.flags & _SEPARATE_X:
        raise source.error(
            "", "contains spectra with different abscissas, which are not supported", "export each separately"
        )
    x, start = _abscissas(source, head)
    values = list(_values(source, head, start))
    names = ["spectrum"] if len(values) == 1 else [f"spectrum {z:g}" for z, _ in values]
    unit = _Y.get(head.y, "")
    traces = [(name, _percent(unit, column), column) for name, (_, column) in zip(names, values, strict=True)]
    metadata = {"comment": head.comment} if head.comment else {}
    entries = {"XUNITS": _X[head.x], "FIRSTX": repr(head.first), "LASTX": repr(head.last)}
    return spectrum_recording(source, "spc", metadata, entries, x, traces)


def _head(data: bytes) -> _Head:
    order = ">" if data[1] == _BIG_ENDIAN else "<"
    flags, _, _, exponent, points, first, last, spectra, x, y = struct.unpack_from(f"{order}BBBbIddIBB", data)
    (log,) = struct.unpack_from(f"{order}I", data, 248)
    comment = data[88:218].split(b"\0")[0].decode("cp1252", "replace").strip()
    return _Head(order, flags, exponent, points, first, last, max(spectra, 1), x, y, comment, log)


def _abscissas(source: Source, head: _Head) -> tuple[FloatArray, int]:
    """Return the abscissas, uniform or listed, and the offset of the first spectrum."""
    if not head.flags & _LISTED_X:
        return np.linspace(head.first, head.last, head.points), _HEADER
    x = _array(source, head, f"{head.order}f4", _HEADER)
    if not (np.all(np.diff(x) > 0.0) or np.all(np.diff(x) < 0.0)):
        raise source.error("", "has abscissas that are not monotonic", "export it again")
    return x, _HEADER + 4 * head.points


def _values(source: Source, head: _Head, start: int) -> Iterator[tuple[float, FloatArray]]:
    """Yield the position of each spectrum in the series, and its values."""
    size = 2 if head.short else 4
    end = start + head.spectra * (_SUB + size * head.points)
    gap = (head.log or len(source.data)) - end
    if not 0 <= gap <= (_MAX_GAP if head.log else 0) or end > len(source.data):
        limit = f"has {len(source.data)} bytes, but {head.spectra} spectra of {head.points} points end at {end}"
        raise source.error("", f"{limit}: it was cut off or damaged", "export it again")
    for number in range(head.spectra):
        _, exponent, index, z, _, _, points = struct.unpack_from(f"{head.order}BbHfffI", source.data, start)
        if index != number % 65536 or points not in {0, head.points}:
            limit = f"has spectrum {index} of {points} points, where {number} of {head.points} is expected"
            raise source.error("", limit, "export it again")
        exponent = exponent if head.flags & _SEPARATE_EXPONENTS and head.exponent != _FLOAT else head.exponent
        dtype = "f4" if exponent == _FLOAT else f"i{size}"
        if dtype == "f4" and head.short:
            raise source.error("", "specifies both integer and floating-point values", "export it again")
        scale = 1.0 if dtype == "f4" else 2.0 ** (exponent - 8 * size)
        yield z, scale * _array(source, head, head.order + dtype, start + _SUB)
        start += _SUB + size * head.points


def _array(source: Source, head: _Head, kind: str, start: int) -> FloatArray:
    end = start + head.points * np.dtype(kind).itemsize
    if end > len(source.data) or head.points < 2:
        raise source.error("", f"ends before its {head.points} points: it was cut off or damaged", "export it again")
    values = np.frombuffer(source.data, kind, head.points, start).astype(np.float64)
    if not np.isfinite(values).all():
        raise source.error("", "contains values that are not numbers", "export it again")
    return values


def _percent(unit: str, values: FloatArray) -> str:
    """Return the unit of the values: percent for transmittances and reflectances above 2, regardless of the header."""
    return f"%{unit}" if unit in _FRACTIONS and np.median(values) > _MAX_PERCENT else unit
