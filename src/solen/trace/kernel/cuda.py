"""The engine on a GPU (CUDA): one thread per ray, with the same functions as on the CPU.

`follow` is the loop of `solen.trace.kernel.loop` for one ray at a time; hits and fates are determined by the same
functions, compiled for the GPU from the same source.

The same scene gives bit-identical results, whatever the order of execution. Thread t of T follows the rays t, t + T, t
+ 2 T, …, and T depends on the trace, not on the GPU. Each thread sums its own rays in its own column, and the columns
are added in a fixed order. No two threads ever write to the same location. Legs are not stored.

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
from solen.trace.kernel.step import Load, Rules, carried_on, escape, leave, meet, part, weakened
from solen.trace.kernel.surface import BRANCHES
from solen.trace.kernel.tally import (
    CUT,
    HITS,
    LEG_WIDTH,
    UNDEFINED,
    Sums,
    count_arrival,
    count_monitors,
    note_place,
)
from solen.trace.result import ABSORBED, DETECTED, GOES_ON, KEPT_PLACES, TRUNCATED
from solen.trace.tables import Tables

MAX_THREADS = 2**16
BLOCK = 128
"""Threads per block: few, because each needs many registers."""
MIN_BLOCKS = 128
"""Minimum number of blocks, because numba warns of fewer; blocks without rays end immediately."""
ROOM_BYTES = 2**29
"""Memory for columns and waiting branches; if these are large, fewer threads run."""
ADDED = 256
"""Number of columns that a thread adds in the first of two rounds."""
X, Z, DX, DZ, S, P, AT, OPTICAL = range(8)
REGION, LAST, HIT = range(3)


class Waiting(NamedTuple):
    """Stacks of waiting branches; the last axis is the thread."""

    state: Floats
    """(depth, 8, T)"""
    tags: IntArray
    """(depth, 3, T)"""


@called
def follow(  # noqa: C901  one loop, as that over blocks of rays
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
        columns.place[thread],
        columns.legs,
    )
    state, tags = waiting.state, waiting.tags
    hits, has_monitors = 0, len(tables.monitor) > 0
    for number in range(thread, len(rays.x), threads):
        s, p, colour = rays.s[number], rays.p[number], rays.colour[number]
        least, waits = rules.min_weight * (s + p), 0
        ray = Ray(rays.x[number], rays.z[number], rays.dx[number], rays.dz[number], -1, k.zero)
        load = Load(s, p, least, k.zero, -1, colour, number, 0)
        while True:
            goes_on, power, hit = False, load.s + load.p, nearest(k, tables, ray)
            if hit.curve < 0:
                loss, fate = escape(k, tables, rules, load.region, colour)
                if has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, math.inf, power, loss)
                sums.fate[fate] += power
            else:
                met = meet(k, tables, rules, ray, hit, load)
                if met.corner:
                    ray = carried_on(k, ray, hit)
                    continue
                hits += 1
                if met.undefined:
                    note_place(sums, UNDEFINED, met.x, met.z)
                elif has_monitors:
                    count_monitors(tables, sums, ray.x, ray.z, ray.dx, ray.dz, hit.distance, power, met.loss)
                load = weakened(load, met.kept, tables.refractive_index[colour, met.here] * hit.distance)
                if met.loss > 0.0:
                    sums.fate[ABSORBED] += power - (load.s + load.p)
                    power = load.s + load.p
                if met.fate != GOES_ON:
                    sums.fate[met.fate] += power
                    if met.fate == TRUNCATED and not met.undefined:
                        note_place(sums, CUT, met.x, met.z)
                    if met.fate == DETECTED:
                        count_arrival(k, tables, sums, ray, hit, met, power, load.optical)
                else:  # GPU scenes have only bare surfaces
                    gone = leave(k, tables, rules, None, ray, hit.curve, met, load)
                    if gone.lost > 0.0:
                        sums.fate[ABSORBED] += gone.lost
                    goes_on, both, cut = not gone.ends, gone.both, gone.cut
                    other, its = part(hit, met, gone.parts, load, not gone.goes_back)
                    if both and waits == len(state):  # powers too small to be halved in their type
                        both, cut = False, its.s + its.p
                    if cut > 0.0:
                        sums.fate[TRUNCATED] += cut
                        note_place(sums, CUT, met.x, met.z)
                    if both:
                        row, tag = state[waits, :, thread], tags[waits, :, thread]
                        row[X], row[Z], row[DX], row[DZ], tag[LAST], row[AT] = other
                        row[S], row[P], row[OPTICAL] = its.s, its.p, its.optical
                        tag[REGION], tag[HIT] = its.region, its.hits
                        waits += 1
                    ray, load = part(hit, met, gone.parts, load, gone.goes_back)
            if goes_on:
                continue
            if waits == 0:
                break
            waits -= 1
            row, tag = state[waits, :, thread], tags[waits, :, thread]
            ray = Ray(row[X], row[Z], row[DX], row[DZ], tag[LAST], row[AT])
            load = Load(row[S], row[P], least, row[OPTICAL], tag[REGION], colour, number, tag[HIT])
    sums.counts[HITS] += hits


def _on_card(function: Any, made: dict[Any, Any]) -> Any:
    """Compile a function, and all functions that it calls, for the GPU.

    numba would convert these functions automatically for a kernel that calls them, but with ``fastmath`` either
    entirely on or entirely off: infinities and NaN would lose their meaning, which parallel rays require.
    """
    if function not in made:
        source = function.py_func
        others = {name: source.__globals__.get(name) for name in source.__code__.co_names}
        calls = {name: _on_card(other, made) for name, other in others.items() if isinstance(other, Dispatcher)}
        copy = FunctionType(source.__code__, source.__globals__ | calls, source.__name__)
        made[function] = cuda.jit(copy, device=True)
    return made[function]


def _product(a: float, b: float) -> float:
    """A product that the GPU does not fuse with a sum; the GPU version is below."""
    return a * b


SIMULATED = bool(getattr(config, "ENABLE_CUDASIM", False))
"""Whether numba simulates a GPU; the CPU functions then run on CPU arrays."""
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
    _follow, _kernel = _on_card(follow, {product: _product}), partial(cached, partial(cuda.jit, lto=False))


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
    """Reduce the columns of each row to a few, in order, and clear them."""
    row, lane = divmod(cuda.grid(1), sums.shape[1])
    if row < sums.shape[0]:
        sums[row, lane] = 0
        total = sums[row, lane]
        for column in range(lane, columns.shape[1], sums.shape[1]):
            total += columns[row, column]
            columns[row, column] = 0
        sums[row, lane] = total


def available() -> bool:
    """Return whether there is a GPU, with its driver and a compiler for it."""
    return bool(cuda.is_available())


class Card:
    """A GPU loaded with a scene.

    Parameters
    ----------
    k, tables
        The scene, in double or single precision.
    like
        Sums of the required shapes.
    splitting, min_weight
        Rules for following rays; see `Rules`.
    rays
        Maximum number of rays traced at a time.
    """

    def __init__(self, k: Precision, tables: Tables, like: Sums, splitting: int, min_weight: float, rays: int) -> None:
        dtype = tables.shape.dtype
        depth = 2 - math.floor(math.log2(min_weight)) if splitting == BRANCHES else 1
        floats, ints = (sum(getattr(like, name).size for name in names) for names in (_FLOATS, _INTS))
        bytes_each = 8 * (floats + ints + 4 * KEPT_PLACES) + depth * (8 * dtype.itemsize + 3 * 8)
        most = min(MAX_THREADS, max(ROOM_BYTES // bytes_each, 1), max(rays, 1))
        self._threads = 1 << math.floor(math.log2(most))
        self._k, self._like = k, like
        self._tables = Tables(*(_put(column) for column in tables))
        self._waiting = Waiting(
            _room((depth, 8, self._threads), dtype), _room((depth, 3, self._threads), np.dtype(np.int64))
        )
        self._floats = _room((floats, self._threads), np.dtype(np.float64))
        self._ints = _room((ints, self._threads), np.dtype(np.int64))
        self._columns = Sums(
            **self._parts(self._floats, _FLOATS),
            **self._parts(self._ints, _INTS),
            place=_room((self._threads, *like.place.shape), np.dtype(np.float64)),
            legs=_room((0, LEG_WIDTH), np.dtype(np.float64)),
        )
        self._added(self._floats)  # which clears the columns
        self._added(self._ints)

    def trace(self, rays: Rows, rules: Rules) -> Sums:
        """Trace rays and add their powers."""
        there = Rows(*(_put(column) for column in rays))
        follow_rays[_blocks(self._threads), BLOCK](*self.arguments(), there, rules, self._threads)
        place = self._places()
        sums: dict[str, NDArray[Any]] = {}
        for names, columns in ((_FLOATS, self._floats), (_INTS, self._ints)):
            ends = np.cumsum([getattr(self._like, name).size for name in names])[:-1]
            parts = zip(names, np.split(self._added(columns), ends), strict=True)
            sums |= {name: part.reshape(getattr(self._like, name).shape) for name, part in parts}
        return Sums(**sums, place=place, legs=self._like.legs)

    def arguments(self) -> tuple[Precision, Tables, Sums, Waiting]:
        """Kernel arguments that do not depend on the rays."""
        return self._k, self._tables, self._columns, self._waiting

    def _parts(self, columns: Any, names: tuple[str, ...]) -> dict[str, Any]:
        """Return the rows of each sum, in the shape of that sum."""
        parts, first = {}, 0
        for name in names:
            like = getattr(self._like, name)
            shape = (*like.shape, self._threads)
            parts[name] = columns[first : first + like.size].reshape(shape) if like.size else _room(shape, like.dtype)
            first += like.size
        return parts

    def _added(self, columns: Any) -> NDArray[Any]:
        """Return the sum of all columns, and clear them."""
        while True:
            rows, lanes = columns.shape[0], -(-columns.shape[1] // ADDED)
            sums = _room((rows, lanes), columns.dtype)
            _add[_blocks(rows * lanes), BLOCK](columns, sums)
            if lanes == 1:
                return _got(sums)[:, 0]
            columns = sums

    def _places(self) -> NDArray[np.float64]:
        """Return the first locations of both kinds, by thread."""
        place = np.full(self._like.place.shape, math.nan)
        many = _got(self._columns.counts)
        for kind, count in enumerate((UNDEFINED, CUT)):
            known = 0
            for thread in np.flatnonzero(many[count])[:KEPT_PLACES]:
                mine = _got(self._columns.place[int(thread)])[kind, : many[count, thread]]
                new = mine[: KEPT_PLACES - known]
                place[kind, known : known + len(new)] = new
                known += len(new)
                if known == KEPT_PLACES:
                    break
        return place


_FLOATS = ("fate", "detected", "optical", "position", "angle", "crossed", "maps")
_INTS = ("arrived", "crossings", "counts")


def _blocks(threads: int) -> int:
    return max(-(-threads // BLOCK), 1 if SIMULATED else MIN_BLOCKS)


def _room(shape: tuple[int, ...], dtype: np.dtype[Any]) -> Any:
    return np.zeros(shape, dtype) if SIMULATED else cuda.device_array(shape, dtype)


def _put(column: NDArray[Any]) -> Any:
    return column if SIMULATED else cuda.to_device(np.ascontiguousarray(column))


def _got(column: Any) -> NDArray[Any]:
    return np.array(column) if SIMULATED else np.asarray(column.copy_to_host())
