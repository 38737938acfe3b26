"""Names of array types, rows of dataclasses of arrays, and stretches of flags."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
IndexArray = NDArray[np.intp]
BoolArray = NDArray[np.bool_]

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T", bound="DataclassInstance")


def rows_of(columns: T, rows: slice | BoolArray | IndexArray) -> T:
    """Some rows of a dataclass whose fields are arrays with a row for each reading, or None."""
    held = {name: value for name, value in vars(columns).items() if value is not None}
    return replace(columns, **{name: value[rows] for name, value in held.items()})


def in_pieces(columns: T, count: int, size: int) -> Iterator[T]:
    """Such a dataclass of ``count`` rows in pieces of at most ``size``."""
    for first in range(0, count, size):
        yield rows_of(columns, slice(first, first + size))


def joined_rows(parts: Sequence[T]) -> T:
    """Rows of several such dataclasses, one after the other; none of their fields is None."""
    names = vars(parts[0])
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def stretches(flags: BoolArray) -> list[tuple[int, int]]:
    """Slice bounds of each stretch of flags (n,) that are set."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
