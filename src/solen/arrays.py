"""Array types, rows of dataclasses of arrays, and runs of set flags."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def rows_of(columns: T, rows: slice | BoolArray | IndexArray) -> T:
    """Return some rows of a dataclass whose fields are None or arrays with one row per reading."""
    present = {name: value for name, value in vars(columns).items() if value is not None}
    return replace(columns, **{name: value[rows] for name, value in present.items()})


def in_pieces(columns: T, count: int, size: int) -> Iterator[T]:
    """Yield consecutive pieces of at most ``size`` rows of a dataclass of arrays with ``count`` rows."""
    for first in range(0, count, size):
        yield rows_of(columns, slice(first, first + size))


def joined_rows(parts: Sequence[T]) -> T:
    """Return a dataclass with the rows of several dataclasses of arrays in turn; no field may be None."""
    names = vars(parts[0])
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def flag_runs(flags: BoolArray) -> list[tuple[int, int]]:
    """Return the slice bounds of each run of consecutive flags (n,) that are set."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
