"""Ray files published by LED manufacturers: Zemax binary source files and IES TM-25.

Both contain a header, followed by 32-bit floats for each ray: a point in the frame of the file, whose z-axis is the
emitter axis; a direction; a flux; and in some files a wavelength. A **Zemax** file (``.dat``, ``.sdf``) has a header of
208 bytes with the format number 1010, the number of rays, the length unit and the kind of flux (OpticStudio help,
"Binary Source File Format"). A **TM-25** file (``.tm25ray``) begins with the letters TM25, has flags that define which
numbers each ray has, and may contain spectral tables; lengths are in mm (IES TM-25-13, section 4.7).

A file is either read completely or rejected with the position of the fault: nothing is guessed, and no ray is omitted.
"""

import struct
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from solen.arrays import FloatArray, IntArray
from solen.errors import DataError
from solen.scene.sources.base import Line

ZEMAX_HEADER = struct.Struct("<iI100s7fI9f4f4i")
ZEMAX_NUMBER = 1010
ZEMAX_MM = {0: 1000.0, 1: 25.4, 2: 10.0, 3: 304.8, 4: 1.0}
"""Length in mm of each numbered unit: metre, inch, centimetre, foot, millimetre."""
TM25_HEADER = struct.Struct("<4siiffQ28siifffiii168s8i")
TM25_TEXTS = 9 * 4000
TM25_COLUMN = 512
TM25_BLOCK = 32
MAX_LINES = 32
"""Maximum number of spectral lines into which the wavelengths in a file are binned."""
MAX_LENGTH_ERROR = 1e-3


@dataclass(frozen=True, eq=False)
class RaySet:
    """Rays from a file, in its own frame: points in mm, unit directions (N, 3), and powers (N,) that add up to 1.

    ``spectrum`` contains wavelengths in nm with weights, and is empty if the file specifies none; ``line`` (N,)
    contains the spectral-line index of each ray, or is None if the file does not specify a wavelength for each ray.
    """

    point_mm: FloatArray
    direction: FloatArray
    power: FloatArray
    spectrum: tuple[Line, ...] = ()
    line: IntArray | None = None

    def __len__(self) -> int:
        return len(self.power)


class _Columns(NamedTuple):
    """Rays as stored in a file: numbers (N, columns), and the flux and wavelength columns (None if absent)."""

    numbers: FloatArray
    flux: int
    wavelength: int | None
    wavelength_nm: float
    """wavelength in nm that corresponds to 1 in that column"""


def read_rays(path: Path | str) -> RaySet:
    """Read the rays from a file.

    Raises
    ------
    DataError
        If the file cannot be read, has another format, is shorter or longer than its header specifies, or contains an
        invalid ray; the message gives the position and the reason.
    """
    path = Path(path)
    try:
        changed = path.stat().st_mtime_ns
    except OSError as bad:
        raise DataError(str(path), limit=f"cannot be read: {bad.strerror or bad}", remedy="check the path") from None
    return _read(path, changed)


@lru_cache(maxsize=4)
def _read(path: Path, _changed: int) -> RaySet:
    """Read the rays from a file, cached by modification time because every scene reads them."""
    try:
        data = path.read_bytes()
    except OSError as bad:
        limit = f"cannot be read: {bad.strerror or bad}"
        raise DataError(str(path), limit=limit, remedy="specify a readable file") from None
    what = str(path)
    if data[:4] == b"TM25":
        return _tm25(data, what)
    if len(data) >= 4 and struct.unpack_from("<i", data)[0] == ZEMAX_NUMBER:
        return _zemax(data, what)
    raise DataError(
        what,
        limit="is neither a binary Zemax file of version 1010 nor a TM-25 file",
        remedy="convert it to one of these formats",
    )


def _zemax(data: bytes, what: str) -> RaySet:
    if len(data) < ZEMAX_HEADER.size:
        raise _short(what, "the header", len(data), ZEMAX_HEADER.size)
    fields = ZEMAX_HEADER.unpack_from(data)
    count, wavelength_um, unit, kind, flux_kind = fields[1], fields[5], fields[10], fields[24], fields[25]
    if unit not in ZEMAX_MM:
        raise DataError(f"{what}: header, dimension units", value=unit, limit="must be 0 to 4")
    if kind not in (0, 2):
        raise DataError(f"{what}: header, ray format", value=kind, limit="must be 0 (flux) or 2 (flux and wavelength)")
    if kind == 0 and flux_kind == 1 and not wavelength_um > 0.0:
        raise _no_power(what)
    numbers = _rays(data, ZEMAX_HEADER.size, count, 7 if kind == 0 else 8, what)
    numbers[:, :3] *= ZEMAX_MM[unit]
    spectrum = ((1000.0 * wavelength_um, 1.0),) if kind == 0 and wavelength_um > 0.0 else ()
    return _ray_set(_Columns(numbers, 6, None if kind == 0 else 7, 1000.0), spectrum, what)


def _tm25(data: bytes, what: str) -> RaySet:
    if len(data) < TM25_HEADER.size + TM25_TEXTS:
        raise _short(what, "the header", len(data), TM25_HEADER.size + TM25_TEXTS)
    fields = TM25_HEADER.unpack_from(data)
    count, colours, wavelength_nm, tables, columns, text = fields[5], fields[8], fields[9], *fields[12:15]
    position, direction, radiant, by_ray, luminous, stokes, tristimulus, index = fields[16:]
    if position != 1 or direction != 1 or not (radiant == 1 or luminous == 1):
        raise DataError(f"{what}: flags", limit="each ray must have a position, a direction and a flux")
    if colours not in range(4) or index == 1:
        limit = "must be 0 to 3: a separate spectrum for each ray is not supported"
        raise DataError(f"{what}: header, spectral data", value=colours, limit=limit)
    if radiant != 1 and colours != 1:
        raise _no_power(what)
    position, spectrum = _tm25_tables(data, tables, what)
    position += TM25_COLUMN * columns + text
    width = 6 + radiant + by_ray + luminous + 3 * stokes + 2 * tristimulus + columns
    numbers = _rays(data, position, count, width, what)
    spectrum = ((wavelength_nm, 1.0),) if colours == 1 else spectrum if colours == 3 else ()
    if colours == 3 and tables != 1:
        raise DataError(f"{what}: header, spectral tables", value=tables, limit="must be 1: one table for all rays")
    flux = 6 if radiant == 1 else 6 + by_ray
    return _ray_set(_Columns(numbers, flux, 6 + radiant if by_ray == 1 else None, 1.0), spectrum, what)


def _tm25_tables(data: bytes, tables: int, what: str) -> tuple[int, tuple[Line, ...]]:
    """Return the position after the spectral tables, and the lines of the first one."""
    start = position = TM25_HEADER.size + TM25_TEXTS
    lines: tuple[Line, ...] = ()
    for number in range(tables):
        if len(data) < position + 4:
            raise _short(what, "the spectral tables", len(data), position + 4)
        (pairs,) = struct.unpack_from("<i", data, position)
        position += 4
        if pairs < 1 or len(data) < position + 8 * pairs:
            raise _short(what, f"spectral table {number + 1}", len(data), position + 8 * max(pairs, 1))
        rows = np.frombuffer(data, "<f4", 2 * pairs, position).reshape(-1, 2).astype(np.float64)
        position += 8 * pairs
        lines = lines or tuple((float(nm), float(weight)) for nm, weight in rows if weight > 0.0)
    return start + -(-(position - start) // TM25_BLOCK) * TM25_BLOCK, _few_lines(lines)


def _rays(data: bytes, start: int, count: int, width: int, what: str) -> FloatArray:
    """Return the numbers (N, width) of all rays; the file must contain all of them and nothing more."""
    size = 4 * width
    expected = start + count * size
    if count < 1:
        raise DataError(f"{what}: header, number of rays", value=count, limit="must be at least 1")
    if len(data) < expected:
        raise _short(what, f"ray {max(len(data) - start, 0) // size + 1} of {count}", len(data), expected)
    if len(data) > expected:
        limit = f"has {len(data)} bytes, {len(data) - expected} more than its {count} rays of {size} bytes require"
        raise DataError(what, limit=limit, remedy="obtain the file again")
    return np.frombuffer(data, "<f4", count * width, start).reshape(count, width).astype(np.float64)


def _ray_set(columns: _Columns, spectrum: tuple[Line, ...], what: str) -> RaySet:
    """Check the numbers of each ray and return the rays."""
    numbers, flux = columns.numbers, columns.numbers[:, columns.flux]
    length = np.linalg.norm(numbers[:, 3:6], axis=1)
    checks = {
        "its numbers must be finite": np.all(np.isfinite(numbers[:, :6]), axis=1) & np.isfinite(flux),
        "its direction must be a unit vector": np.abs(length - 1.0) <= MAX_LENGTH_ERROR,
        "its flux must be at least 0": flux >= 0.0,
    }
    if columns.wavelength is not None:
        nm = columns.numbers[:, columns.wavelength] * columns.wavelength_nm
        checks["its wavelength must be from 100 to 20000 nm"] = (nm >= 100.0) & (nm <= 20_000.0)
    for limit, valid in checks.items():
        if not np.all(valid):
            raise DataError(f"{what}: ray {int(np.argmin(valid)) + 1} of {len(numbers)}", limit=limit)
    if not np.sum(flux) > 0.0:
        raise DataError(what, limit="all its rays have zero flux")
    power = flux / np.sum(flux)
    spectrum, line = (spectrum, None) if columns.wavelength is None else _lines(nm, power)
    return RaySet(numbers[:, :3], numbers[:, 3:6] / length[:, None], power, spectrum, line)


def _lines(nm: FloatArray, power: FloatArray) -> tuple[tuple[Line, ...], IntArray]:
    """Return spectral lines for the rays, binned in equal widths if there are many, and the line index of each ray."""
    values, line = np.unique(nm, return_inverse=True)
    if len(values) > MAX_LINES:
        edges = np.linspace(nm.min(), nm.max(), MAX_LINES + 1)
        _, line = np.unique(
            np.clip(np.searchsorted(edges, nm, side="right") - 1, 0, MAX_LINES - 1), return_inverse=True
        )
        weight = np.bincount(line, np.maximum(power, np.finfo(float).tiny))
        values = np.bincount(line, np.maximum(power, np.finfo(float).tiny) * nm) / weight
    weights = np.maximum(np.bincount(line, power), np.finfo(float).tiny)
    return tuple(zip(values.tolist(), weights.tolist(), strict=True)), line.astype(np.int64)


def _few_lines(lines: tuple[Line, ...]) -> tuple[Line, ...]:
    """Return a spectrum with few lines, by binning if necessary."""
    if len(lines) <= MAX_LINES:
        return lines
    nm, weight = (np.array(column) for column in zip(*lines, strict=True))
    return _lines(nm, weight / weight.sum())[0]


def _short(what: str, where: str, size: int, expected: int) -> DataError:
    limit = f"is truncated in {where}: it has {size} bytes and requires at least {expected}"
    return DataError(what, limit=limit, remedy="obtain the file again")


def _no_power(what: str) -> DataError:
    limit = "specifies luminous flux without a single wavelength, so the power is unknown"
    return DataError(what, limit=limit, remedy="obtain a file with radiant flux")
