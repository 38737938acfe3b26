"""MATLAB .mat files up to version 7: variables, with fields of structures as ``structure.field``.

Public names: `is_matlab` and `read`. Version 7.3 is HDF5 and is read by `solen.recording.hdf5`.
"""

import io
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from solen.recording.arrays import Array, recorded
from solen.recording.model import Recording
from solen.recording.source import Source

_MAGIC = b"MATLAB 5.0 MAT-file"
_OLD = 4  # bytes of the number type at the beginning of a file of version 4, which has no magic word
_MAX_DEPTH = 8


def is_matlab(source: Source) -> bool:
    """Return whether a file begins like a .mat file of version 5 to 7, or is named .mat and begins like version 4."""
    kind = int.from_bytes(source.data[:_OLD], "little")
    named = source.path.suffix.lower() == ".mat" and kind < 5000 and len(source.data) > 20
    return source.data.startswith(_MAGIC) or named


def read(source: Source, columns: Sequence[str] | None = None) -> Recording:
    """Read a .mat file; raise `DataError` if it is damaged or contains no numeric arrays.

    ``columns`` are names for the columns of a matrix.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        data: Any = io.BytesIO(source.data)  # the type stubs accept only paths
        variables: dict[str, Any] = loadmat(data, simplify_cells=True)
    except (MatReadError, ValueError, TypeError, KeyError, IndexError, OSError, EOFError, NotImplementedError) as bad:
        limit = f"cannot be read as a .mat file: {' '.join(str(bad).split())[:80]}"
        raise source.error("", limit, "save it again in MATLAB, or export a CSV with writetable") from None
    except Exception:  # errors of zlib, struct and others at a damaged file
        limit = "is a damaged .mat file"
        raise source.error("", limit, "save it again in MATLAB, or export a CSV with writetable") from None
    arrays, metadata = [], _header(source)
    for name, value in _leaves(
        "", {key: variable for key, variable in variables.items() if not key.startswith("__")}, 0
    ):
        if isinstance(value, str):
            metadata[name] = value
        else:
            arrays.append(Array(name, value))
    return recorded(source, "matlab", arrays, metadata, columns)


def _header(source: Source) -> dict[str, str]:
    """Return the header that identifies the program; version 4 files have none."""
    if not source.data.startswith(_MAGIC):
        return {}
    return {"header": " ".join(source.data[:116].decode("latin-1").split())}


def _leaves(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Yield the strings and arrays in a variable; those in a structure are named after their fields."""
    if isinstance(value, dict) and depth < _MAX_DEPTH:
        for key, item in value.items():
            yield from _leaves(f"{name}.{key}" if name else str(key), item, depth + 1)
    elif isinstance(value, str) or np.asarray(value).dtype.kind in "biuf":
        yield name, value
