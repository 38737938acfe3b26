"""The engine on a GPU (CUDA), with the same functions as on the CPU.

`follow` is the loop of `solen.trace.kernel.loop` for one ray at a time; hits and fates are determined by the same
functions, compiled for the GPU from the same source.

The same scene gives bit-identical results, whatever the order of execution. Thread t of T follows the rays t, t + T, t
+ 2 T, …, and T depends on the trace, not on the GPU. Each thread sums its rays in its own column, and the columns are
added in a fixed order. No two threads ever write to the same location. Ray segments are not stored.

Import this module only where it is used, because it requires numba-cuda, which is optional.
"""

import math
from collections.abc import Callable
from functools import partial
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from numba import cuda
from numba.core import config
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

from solen.arrays import IntArray
from solen.trace.kernel.buffers import Rows
from solen.trace.kernel.compiled import cached, called
from solen.trace.kernel.hits import product
from solen.trace.kernel.nearest import Ray, nearest
from solen.trace.kernel.rows import Floats, Precision
from solen.trace.kernel.step import Load, Rules, attenuated, escape, leave, meet, part, past_corner
from solen.trace.kernel.surface import BRANCHES
from solen.trace.kernel.tally import (
    HITS,
    SEGMENT_WIDTH,
    TRUNCATIONS,
    UNDEFINED,
    Sums,
    count_arrival,
    count_monitors,
    store_location,
)
from solen.trace.result import ABSORBED, DETECTED, GOES_ON, MAX_LOCATIONS, TRUNCATED
from solen.trace.tables import Tables

MAX_THREADS = 2**16
BLOCK = 128
"""Number of threads per block: few, because each needs many registers."""
MIN_BLOCKS = 128
"""Minimum number of blocks, because numba warns about fewer; blocks without rays end immediately."""
MAX_BYTES = 2**29
"""Maximum memory for columns and waiting branches; if a thread needs much, fewer threads run."""
COLUMNS_PER_SUM = 256
"""Number of columns that one thread adds in each round of the summation."""
X, Z, DX, DZ, S, P, U, OPTICAL = range(8)
REGION, LAST, HIT = range(3)


class Waiting(NamedTuple):
    """Stacks of waiting branches; the last axis is that of the threads."""

    state: Floats
    """(depth, 8, T)"""
    tags: IntArray
    """(depth, 3, T)"""


@called
def follow(  # noqa: C901  one loop, like that over blocks of rays
    k: Precision,
    tables: Tables,
    columns: Sums,
    waiting: Waiting,
    rays: Rows,
    rules: Rules,
    thread: int,
    threads: int,
) -> None:
    """Follow every ``threads``-th ray from ``thread`` on, and add its powers to the column of the thread."""
    sums = Sums(
        columns.fate[:, thread],
        columns.detected[:, thread],
        columns.arrived[:, thread],
        columns.optical[:, thread],
        columns.position[:, :, thread],
        columns.angle[:, :, thread],
        columns.crossed[:, thread],
        columns.crossings[:, thread],
        columns.maps[:, thread],
        columns.counts[:, thread],
        columns.location[thread],
        columns.segments,
    )
    state, tags = waiting.state, waiting.tags
    hits, has_monitors = 0, len(tables.monitor) > 0
    for number in range(thread, len(rays.x), threads):
        s, p, colour = rays.s[number], rays.p[number], rays.colour[number]
        min_power, waiting_count = rules.min_weight * (s + p), 0
        ray = Ray(rays.x[number], rays.z[number], rays.dx[number], rays.dz[number], -1, k.zero)
        load = Load(s, p, min_power, k.zero, -1, colour, number, 0)
        while True:
            continues, power, hit = False, load.s + load.p, nearest(k, tables, ray)
            if hit.curve < 0:
                loss, fate = escape(k, tables, rules, load.region, colour)
                if has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, math.inf, power, loss)
                sums.fate[fate] += power
            else:
                arrival = meet(k, tables, rules, ray, hit, load)
                if arrival.corner:
                    ray = past_corner(k, ray, hit)
                    continue
                hits += 1
                if arrival.undefined:
                    store_location(sums, UNDEFINED, arrival.x, arrival.z)
                elif has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, hit.distance, power, arrival.loss)
                load = attenuated(load, arrival.kept, tables.refractive_index[colour, arrival.medium] * hit.distance)
                if arrival.loss > 0.0:
                    sums.fate[ABSORBED] += power - (load.s + load.p)
                    power = load.s + load.p
                if arrival.fate != GOES_ON:
                    sums.fate[arrival.fate] += power
                    if arrival.fate == TRUNCATED and not arrival.undefined:
                        store_location(sums, TRUNCATIONS, arrival.x, arrival.z)
                    if arrival.fate == DETECTED:
                        count_arrival(k, tables, sums, ray, hit, arrival, power, load.optical)
                else:  # GPU scenes have only bare surfaces
                    departure = leave(k, tables, rules, None, ray, hit.curve, arrival, load)
                    if departure.absorbed > 0.0:
                        sums.fate[ABSORBED] += departure.absorbed
                    continues, both, cut = not departure.ends, departure.both, departure.truncated
                    other_ray, other_load = part(hit, arrival, departure.parts, load, not departure.reflected_first)
                    if both and waiting_count == len(state):  # the powers are too small to be halved in their type
                        both, cut = False, other_load.s + other_load.p
                    if cut > 0.0:
                        sums.fate[TRUNCATED] += cut
                        store_location(sums, TRUNCATIONS, arrival.x, arrival.z)
                    if both:
                        row, tag = state[waiting_count, :, thread], tags[waiting_count, :, thread]
                        row[X], row[Z], row[DX], row[DZ], tag[LAST], row[U] = other_ray
                        row[S], row[P], row[OPTICAL] = other_load.s, other_load.p, other_load.optical
                        tag[REGION], tag[HIT] = other_load.region, other_load.hits
                        waiting_count += 1
                    ray, load = part(hit, arrival, departure.parts, load, departure.reflected_first)
            if continues:
                continue
            if waiting_count == 0:
                break
            waiting_count -= 1
            row, tag = state[waiting_count, :, thread], tags[waiting_count, :, thread]
            ray = Ray(row[X], row[Z], row[DX], row[DZ], tag[LAST], row[U])
            load = Load(row[S], row[P], min_power, row[OPTICAL], tag[REGION], colour, number, tag[HIT])
    sums.counts[HITS] += hits


def _for_gpu(function: Any, compiled_functions: dict[Any, Any]) -> Any:
    """Compile a function, and all functions that it calls, for the GPU.

    numba would compile these functions itself for a kernel that calls them, but with ``fastmath`` either entirely on or
    entirely off; if it is on, infinities and NaN lose their meaning, which parallel rays require.
    """
    if function not in compiled_functions:
        source = function.py_func
        others = {name: source.__globals__.get(name) for name in source.__code__.co_names}
        calls = {
            name: _for_gpu(other, compiled_functions) for name, other in others.items() if isinstance(other, Dispatcher)
        }
        copy = FunctionType(source.__code__, source.__globals__ | calls, source.__name__)
        compiled_functions[function] = cuda.jit(copy, device=True)
    return compiled_functions[function]


def _product(a: float, b: float) -> float:
    """A product that a GPU does not fuse with a sum; its GPU version is registered below."""
    return a * b


SIMULATED = bool(getattr(config, "ENABLE_CUDASIM", False))
"""Whether numba simulates a GPU; then the CPU functions run on CPU arrays."""
_follow: Callable[..., None] = follow
_kernel: Callable[[Callable[..., None]], Any] = cuda.jit
if not SIMULATED:
    from numba.cuda.extending import overload

    overload(_product)(
        lambda a, b: (
            (lambda a, b: cuda.libdevice.dmul_rn(a, b))
            if cuda.types.float64 in (a, b)
            else (lambda a, b: cuda.libdevice.fmul_rn(a, b))
        )
    )
    _follow, _kernel = _for_gpu(follow, {product: _product}), partial(cached, partial(cuda.jit, lto=False))


@_kernel
def follow_rays(
    k: Precision, tables: Tables, columns: Sums, waiting: Waiting, rays: Rows, rules: Rules, threads: int
) -> None:
    """Follow the rays of one thread on the GPU."""
    thread = cuda.grid(1)
    if thread < threads:
        _follow(k, tables, columns, waiting, rays, rules, thread, threads)


@_kernel
def _add(columns: Any, sums: Any) -> None:
    """Add the columns of each row, in order, to a few sums, and clear them."""
    row, lane = divmod(cuda.grid(1), sums.shape[1])
    if row < sums.shape[0]:
        sums[row, lane] = 0
        total = sums[row, lane]
        for column in range(lane, columns.shape[1], sums.shape[1]):
            total += columns[row, column]
            columns[row, column] = 0
        sums[row, lane] = total


def available() -> bool:
    """Return whether a GPU, its driver and its compiler are available."""
    return bool(cuda.is_available())


class GpuScene:
    """A scene in the memory of a GPU.

    Parameters
    ----------
    k, tables
        The scene, in double or single precision.
    like
        Sums with the required shapes.
    splitting, min_weight
        Rules for following rays; see `Rules`.
    rays
        Maximum number of rays traced at a time.
    """

    def __init__(self, k: Precision, tables: Tables, like: Sums, splitting: int, min_weight: float, rays: int) -> None:
        dtype = tables.shape.dtype
        depth = 2 - math.floor(math.log2(min_weight)) if splitting == BRANCHES else 1
        floats, ints = (sum(getattr(like, name).size for name in names) for names in (_FLOATS, _INTS))
        bytes_per_thread = 8 * (floats + ints + 4 * MAX_LOCATIONS) + depth * (8 * dtype.itemsize + 3 * 8)
        max_threads = min(MAX_THREADS, max(MAX_BYTES // bytes_per_thread, 1), max(rays, 1))
        self._threads = 1 << math.floor(math.log2(max_threads))
        self._k, self._like = k, like
        self._tables = Tables(*(_to_device(column) for column in tables))
        self._waiting = Waiting(
            _allocated((depth, 8, self._threads), dtype), _allocated((depth, 3, self._threads), np.dtype(np.int64))
        )
        self._floats = _allocated((floats, self._threads), np.dtype(np.float64))
        self._ints = _allocated((ints, self._threads), np.dtype(np.int64))
        self._columns = Sums(
            **self._views(self._floats, _FLOATS),
            **self._views(self._ints, _INTS),
            location=_allocated((self._threads, *like.location.shape), np.dtype(np.float64)),
            segments=_allocated((0, SEGMENT_WIDTH), np.dtype(np.float64)),
        )
        self._column_sums(self._floats)  # which clears the columns
        self._column_sums(self._ints)

    def trace(self, rays: Rows, rules: Rules) -> Sums:
        """Trace rays and add their powers."""
        device_rays = Rows(*(_to_device(column) for column in rays))
        follow_rays[_blocks(self._threads), BLOCK](*self.arguments(), device_rays, rules, self._threads)
        location = self._locations()
        sums: dict[str, NDArray[Any]] = {}
        for names, columns in ((_FLOATS, self._floats), (_INTS, self._ints)):
            ends = np.cumsum([getattr(self._like, name).size for name in names])[:-1]
            parts = zip(names, np.split(self._column_sums(columns), ends), strict=True)
            sums |= {name: part.reshape(getattr(self._like, name).shape) for name, part in parts}
        return Sums(**sums, location=location, segments=self._like.segments)

    def arguments(self) -> tuple[Precision, Tables, Sums, Waiting]:
        """Return the kernel arguments that do not depend on the rays."""
        return self._k, self._tables, self._columns, self._waiting

    def _views(self, columns: Any, names: tuple[str, ...]) -> dict[str, Any]:
        """Return the rows of each sum, in the shape of that sum."""
        parts, first = {}, 0
        for name in names:
            like = getattr(self._like, name)
            shape = (*like.shape, self._threads)
            parts[name] = (
                columns[first : first + like.size].reshape(shape) if like.size else _allocated(shape, like.dtype)
            )
            first += like.size
        return parts

    def _column_sums(self, columns: Any) -> NDArray[Any]:
        """Return the sum of all columns, and clear them."""
        while True:
            rows, lanes = columns.shape[0], -(-columns.shape[1] // COLUMNS_PER_SUM)
            sums = _allocated((rows, lanes), columns.dtype)
            _add[_blocks(rows * lanes), BLOCK](columns, sums)
            if lanes == 1:
                return _to_host(sums)[:, 0]
            columns = sums

    def _locations(self) -> NDArray[np.float64]:
        """Return the first locations of undefined and of truncated rays, in the order of the threads."""
        locations = np.full(self._like.location.shape, math.nan)
        counts = _to_host(self._columns.counts)
        for kind, count in enumerate((UNDEFINED, TRUNCATIONS)):
            stored = 0
            for thread in np.flatnonzero(counts[count])[:MAX_LOCATIONS]:
                thread_locations = _to_host(self._columns.location[int(thread)])[kind, : counts[count, thread]]
                new = thread_locations[: MAX_LOCATIONS - stored]
                locations[kind, stored : stored + len(new)] = new
                stored += len(new)
                if stored == MAX_LOCATIONS:
                    break
        return locations


_FLOATS = ("fate", "detected", "optical", "position", "angle", "crossed", "maps")
_INTS = ("arrived", "crossings", "counts")


def _blocks(threads: int) -> int:
    return max(-(-threads // BLOCK), 1 if SIMULATED else MIN_BLOCKS)


def _allocated(shape: tuple[int, ...], dtype: np.dtype[Any]) -> Any:
    return np.zeros(shape, dtype) if SIMULATED else cuda.device_array(shape, dtype)


def _to_device(column: NDArray[Any]) -> Any:
    return column if SIMULATED else cuda.to_device(np.ascontiguousarray(column))


def _to_host(column: Any) -> NDArray[Any]:
    return np.array(column) if SIMULATED else np.asarray(column.copy_to_host())
