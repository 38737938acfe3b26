"""HDF5 files (netCDF-4, MATLAB 7.3 and files from scripts) read with h5py (extra ``netcdf``); netCDF-3 with scipy.

Datasets become arrays named after their paths. netCDF contains the unit of each dataset (``units``) and the column
names of a table (the coordinate of its second dimension); attributes become parameters.

A file with a time in each of several groups contains several recordings; solen bench writes a group for each sensor.
Files are never loaded into memory completely.

Public names: `groups`, `read`, `is_netcdf3` and `read_netcdf3`.
"""

import hashlib
import io
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from solen.errors import DataError
from solen.extras import need
from solen.files import check_seal
from solen.recording.arrays import Array, recorded
from solen.recording.headings import heading
from solen.recording.model import Recording
from solen.recording.source import Source

_MAGIC = b"\x89HDF\r\n\x1a\n"
_STARTS = (0, 512, 1024, 2048)  # MATLAB 7.3 files have their own header before it
_CLASSIC = (b"CDF\x01", b"CDF\x02")


class Stored(Source):
    """A file that is read from disk on demand; ``data`` is its beginning."""

    @cached_property
    def _hashed(self) -> str:
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    @property
    def sha256(self) -> str:
        """Checksum of the file, which is read block by block."""
        return self._hashed


def stored(path: Path) -> Stored | None:
    """Return the file if it is HDF5, with or without MATLAB's header; None if it is not or cannot be read."""
    try:
        with path.open("rb") as file:
            beginning = file.read(_STARTS[-1] + len(_MAGIC))
    except (OSError, ValueError):
        return None
    is_hdf5 = any(beginning[start : start + len(_MAGIC)] == _MAGIC for start in _STARTS)
    return Stored(path, beginning) if is_hdf5 else None


def is_netcdf3(source: Source) -> bool:
    """Return whether a file is in classic netCDF format."""
    return source.data.startswith(_CLASSIC)


def groups(source: Source) -> tuple[str, ...]:
    """Return the names of the groups with a time; none for MATLAB files, whose groups are structures."""
    if source.data.startswith(b"MATLAB"):
        return ()
    with _opened(source) as file:
        try:
            return tuple(name for name, item in file.items() if hasattr(item, "items") and any(map(_is_time, item)))
        except Exception as bad:  # h5py may raise any exception at a damaged file
            raise _damaged(source, bad) from None


def _is_time(name: str) -> bool:
    return heading(name).quantity == "time"


def read(source: Source, group: str = "") -> Recording:
    """Read an HDF5 file or one of its groups.

    Raise `DataError` if h5py is not installed, or if the file is damaged or contains no numeric arrays.
    """
    arrays: list[Array] = []
    metadata: dict[str, str] = {}
    try:
        with _opened(source) as file:
            selected = file[group] if group else file
            metadata |= _attributes(file.attrs) | _attributes(selected.attrs)
            selected.visititems(lambda name, item: _visit(name, item, arrays, metadata))
    except DataError:
        raise
    except Exception as bad:  # h5py may raise any exception at a damaged file
        raise _damaged(source, bad) from None
    return recorded(source, "matlab-7.3" if source.data.startswith(b"MATLAB") else "hdf5", arrays, metadata)


def _opened(source: Source) -> Any:
    need("h5py", what=str(source.path), doing="reading HDF5", otherwise="export a CSV", error=DataError)
    import h5py

    _check_length(source, check_seal(source.path, DataError))
    try:
        return h5py.File(source.path, "r")
    except Exception as bad:
        raise _damaged(source, bad) from None


def _check_length(source: Source, length: int) -> None:
    """Raise `DataError` if the file is longer than its header specifies, because added bytes may change all numbers.

    ``length`` does not include the seal that solen appends to a file; h5py itself rejects a file that is too short.
    The offsets are those of the HDF5 File Format Specification, versions 0 to 3.
    """
    start = next(start for start in _STARTS if source.data[start : start + len(_MAGIC)] == _MAGIC)
    version = source.data[start + len(_MAGIC)]
    width, first = {0: (13, 24), 1: (13, 28)}.get(version, (9, 12))
    size = source.data[start + width]
    base, _, end = (
        int.from_bytes(source.data[start + first + n * size : start + first + (n + 1) * size], "little")
        for n in range(3)
    )
    if length > end and length != base + end:
        limit = (
            f"is {length - end} bytes longer than its header specifies: bytes were added, or the file was never closed"
        )
        raise source.error("", limit, "export it again, or repair it with h5clear --increment=0")


def _damaged(source: Source, bad: Exception) -> DataError:
    return source.error("", f"is a damaged HDF5 file: {' '.join(str(bad).split())[:80]}", "export it again")


def _visit(name: str, dataset: Any, arrays: list[Array], metadata: dict[str, str]) -> None:
    """Add a dataset to ``arrays`` or ``metadata``.

    MATLAB stores strings as numbers, and internal tables in groups whose names begin with ``#``.
    """
    if not hasattr(dataset, "shape") or name.startswith("#"):
        return
    attributes = _attributes(dataset.attrs)
    if attributes.get("MATLAB_class") == "char":
        metadata[name.replace("/", ".")] = "".join(map(chr, np.asarray(dataset[()]).ravel().tolist()))
    elif dataset.shape == () and dataset.dtype.kind in "SO":
        metadata[name.replace("/", ".")] = _text(dataset[()])
    elif dataset.dtype.kind in "biuf" and len(dataset.shape) <= 2:
        unit = attributes.get("units", attributes.get("unit", ""))
        arrays.append(Array(name.replace("/", "."), dataset[()], unit, _names(dataset)))


def _names(dataset: Any) -> tuple[str, ...]:
    """Return the column names of a table: a coordinate of its second dimension that contains strings."""
    if len(dataset.shape) != 2:
        return ()
    for scale in dataset.dims[1].values():
        if scale.dtype.kind in "SO":
            return tuple(_text(value) for value in scale[()])
    return ()


def _attributes(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Return the attributes that are strings or single numbers."""
    kept = {}
    for key, value in attributes.items():
        array = np.asarray(value)
        if array.size == 1 and array.dtype.kind in "SUOiuf" and not key.startswith("_"):
            kept[key] = _text(array.ravel()[0])
    return kept


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def read_netcdf3(source: Source) -> Recording:
    """Read a classic netCDF file; raise `DataError` if it is damaged or contains no numeric arrays."""
    from scipy.io import netcdf_file

    try:
        data: Any = io.BytesIO(source.data)
        opened: Any = netcdf_file(data, "r", mmap=False)
        with opened as file:
            arrays = [
                Array(name, np.array(variable.data), _text(getattr(variable, "units", b"")))
                for name, variable in file.variables.items()
            ]
            metadata = {key: _text(value) for key, value in file._attributes.items() if isinstance(value, bytes)}
            ends = [
                (variable.data[-1:] if variable.isrec else variable.data).tobytes()
                for variable in file.variables.values()
            ]
            size = len(source.data)
            if not any(source.data[: size - pad].endswith(end) for end in ends for pad in {0, -len(end) % 4}):
                raise ValueError("extra bytes at the end: no array ends with the file")
    except Exception:  # scipy may raise any exception at a damaged file
        limit = "is a damaged netCDF file"
        raise source.error("", limit, "export it again") from None
    return recorded(source, "netcdf", arrays, metadata)
