"""HDF5 files: netCDF-4, MATLAB 7.3 and whatever a script wrote, by h5py (extra ``netcdf``); netCDF-3 by scipy.

The idea: datasets are arrays by their path. netCDF says the unit of each (``units``) and what the columns of a table
are (the coordinate of its second dimension); attributes are parameters.

The interface: `is_hdf5`, `is_netcdf3` and their readers.
"""

import io
from collections.abc import Mapping
from typing import Any

import numpy as np

from solen.errors import DataError
from solen.recording.arrays import Array, recorded
from solen.recording.model import Recording
from solen.recording.source import Source

_MAGIC = b"\x89HDF\r\n\x1a\n"
_STARTS = (0, 512, 1024, 2048)  # a MATLAB 7.3 file has its own header before it
_CLASSIC = (b"CDF\x01", b"CDF\x02")


def is_hdf5(source: Source) -> bool:
    """Whether a file is HDF5, with or without MATLAB's header."""
    return any(source.data[start : start + len(_MAGIC)] == _MAGIC for start in _STARTS)


def is_netcdf3(source: Source) -> bool:
    """Whether a file is netCDF of the classic kind."""
    return source.data.startswith(_CLASSIC)


def read(source: Source) -> Recording:
    """Recording of an HDF5 file; `DataError` without h5py, where it is damaged, or holds no arrays of numbers."""
    try:
        import h5py
    except ModuleNotFoundError:
        limit, remedy = "is an HDF5 file, which needs h5py", 'pip install "solen[netcdf]", or export a CSV'
        raise source.refused("", limit, remedy) from None
    arrays: list[Array] = []
    metadata: dict[str, str] = {}
    try:
        with h5py.File(io.BytesIO(source.data), "r") as file:
            metadata |= _attributes(file.attrs)
            file.visititems(lambda name, one: _visit(name, one, arrays, metadata))
    except DataError:
        raise
    except Exception as bad:  # h5py raises whatever fits what it stumbled over
        limit = f"is a damaged HDF5 file: {' '.join(str(bad).split())[:80]}"
        raise source.refused("", limit, "export it again") from None
    kind = "matlab-7.3" if source.data.startswith(b"MATLAB") else "hdf5"
    return recorded(source, kind, arrays, metadata)


def _visit(name: str, one: Any, arrays: list[Array], metadata: dict[str, str]) -> None:
    """Take a dataset; MATLAB keeps texts as numbers, and its own tables in groups that begin with ``#``."""
    if not hasattr(one, "shape") or name.startswith("#"):
        return
    attributes = _attributes(one.attrs)
    if attributes.get("MATLAB_class") == "char":
        metadata[name.replace("/", ".")] = "".join(map(chr, np.asarray(one[()]).ravel().tolist()))
    elif one.shape == () and one.dtype.kind in "SO":
        metadata[name.replace("/", ".")] = _text(one[()])
    elif one.dtype.kind in "biuf" and len(one.shape) <= 2:
        unit = attributes.get("units", attributes.get("unit", ""))
        arrays.append(Array(name.replace("/", "."), one[()], unit, _names(one)))


def _names(one: Any) -> tuple[str, ...]:
    """What the columns of a table are called, where its second dimension has a coordinate of words."""
    if len(one.shape) != 2:
        return ()
    for scale in one.dims[1].values():
        if scale.dtype.kind in "SO":
            return tuple(_text(value) for value in scale[()])
    return ()


def _attributes(attributes: Mapping[str, Any]) -> dict[str, str]:
    """Attributes that are texts or single numbers."""
    found = {}
    for key, value in attributes.items():
        plain = np.asarray(value)
        if plain.size == 1 and plain.dtype.kind in "SUOiuf" and not key.startswith("_"):
            found[key] = _text(plain.ravel()[0])
    return found


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def read_netcdf3(source: Source) -> Recording:
    """Recording of a classic netCDF file; `DataError` where it is damaged or holds no arrays of numbers."""
    from scipy.io import netcdf_file

    try:
        with netcdf_file(io.BytesIO(source.data), "r", mmap=False) as file:
            arrays = [
                Array(name, np.array(one.data), _text(getattr(one, "units", b"")))
                for name, one in file.variables.items()
            ]
            metadata = {key: _text(value) for key, value in file._attributes.items() if isinstance(value, bytes)}
    except Exception as bad:  # scipy raises whatever fits what it stumbled over
        limit = f"is a damaged netCDF file ({type(bad).__name__})"
        raise source.refused("", limit, "export it again") from None
    return recorded(source, "netcdf", arrays, metadata)
