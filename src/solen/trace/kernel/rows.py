"""The format of the tables: named rows of the curve table, curve kinds, behaviours and constants.

`solen.trace.tables` writes the tables, and the other modules of this package read them.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload
from numpy.typing import NDArray

from solen.curve import END_TOLERANCE_MM, ROUNDING, SMALL
from solen.scene.model import BEHAVIOURS
from solen.trace.kernel.compiled import compiled

Floats = NDArray[np.floating]
Tags = NDArray[np.signedinteger]
"""Integers of the same width as the floating-point numbers, so that equally many fit into a register."""
N = TypeVar("N", float, np.signedinteger)
TYPES: dict[Any, type[np.number]] = {types.float32: np.float32, types.int32: np.int32, types.int64: np.int64}

SEGMENT, ARC, CONIC, OVAL, CUBIC = range(5)
REFRACTING, MIRROR, ABSORBING, RECEIVER, SPLITTER, LENS, GRATING = range(len(BEHAVIOURS))
TREATED = 8
"""Added to the behaviour of an interface whose surface is not smooth, clean and bare."""
SMOOTH, LAMBERTIAN, GAUSSIAN, HARVEY_SHACK, BY_TABLE = range(5)


class Precision(NamedTuple):
    """Constants in the precision of the computation, because literals would make it double."""

    zero: float
    half: float
    one: float
    three: float
    none: float  # infinity: no hit
    nan: float
    end: float  # extension of curves beyond their ends, mm
    corner: float  # distance by which a ray at a corner is moved, mm
    margin: float  # margin of tests that only save time, mm
    small: float
    rounding: float

    @classmethod
    def of(cls, dtype: type[np.floating]) -> "Precision":
        """Return the constants for double or single precision."""
        double = dtype is np.float64
        lengths = (END_TOLERANCE_MM, 2 * END_TOLERANCE_MM, 1e-9) if double else (1e-5, 2e-5, 1e-3)
        others = (SMALL, ROUNDING if double else 2.0**-22)
        convert: Callable[[float], Any] = dtype  # the values are used as floats
        return cls(*(convert(value) for value in (0.0, 0.5, 1.0, 3.0, np.inf, np.nan, *lengths, *others)))


class Segment(NamedTuple):
    """From (ax, az) along the unit vector (ux, uz)."""

    ax: float
    az: float
    ux: float
    uz: float
    length: float


class Arc(NamedTuple):
    """Centre (cx, cz); (mx, mz) points to the midpoint of the arc, and ``end`` is the distance of its ends from it."""

    cx: float
    cz: float
    radius: float
    mx: float
    mz: float
    end: float
    side: float
    at_most_half: float


class Conic(NamedTuple):
    """c r² − 2 w + b w² = 0 about the vertex; r along the unit vector (lx, lz), from low to high, and w to its left."""

    vx: float
    vz: float
    lx: float
    lz: float
    c: float
    b: float
    low: float
    high: float
    side: float


class Oval(NamedTuple):
    """Front of a Cartesian oval."""

    x1: float  # focus F1
    z1: float
    x2: float  # focus F2
    z2: float
    n1: float
    n2: float
    s1: float  # from F1 to the vertex
    s2: float  # from the vertex to F2
    vx: float  # vertex
    vz: float
    wx: float  # axis
    wz: float
    side: float
    circle: float  # radius about F2 of a circle that contains the oval
    rx: float  # ray from F1 to the end on the right
    rz: float
    lx: float  # ray from F1 to the end on the left
    lz: float
    ax: float  # hull: the left end, two intersections of tangents, the right end
    az: float
    bx: float
    bz: float
    cx: float
    cz: float
    dx: float
    dz: float
    ux: float  # unit vector along the chord, from left to right
    uz: float
    p0: float  # the fitted conic r² = p0 + p1 w + p2 w²
    p1: float
    p2: float


class Cubic(NamedTuple):
    """Cubic Bézier piece with no inflection and a small turn.

    At an end of the complete curve, ``before_per_mm`` or ``after_per_mm`` is the parameter per mm; elsewhere it is 0.
    """

    x0: float
    z0: float
    x1: float
    z1: float
    x2: float
    z2: float
    x3: float
    z3: float
    before_per_mm: float
    after_per_mm: float
    u_from: float  # parameter on the complete curve at the start of the piece
    u_to: float  # and at the end of the piece


class Treatment(NamedTuple):
    """Properties of a surface that is not smooth, clean and bare; see `solen.scene.surface`."""

    reflectance: float
    transmitted: float
    focal: float  # 0: no ideal element
    partial: float  # 1 if refraction has partial reflection
    band_low: float  # wavelengths, nm
    band_high: float
    band_within: float  # 1: acts inside the band, 0: outside it
    scatter: float  # kind of scatter profile
    width: float  # sigma or shoulder of the profile
    wing: float  # slope of the profile
    scatter_fraction: float
    tilt: float  # steepest slope of the texture
    across: float  # 1 if the texture varies along y
    first_layer: float
    layers: float
    first_row: float  # table of fractions for light from the left, or orders of a grating
    rows: float
    rows_right: float  # rows for light from the right, which follow
    lines: float  # grating lines per nm, negative for reflection; 0 for none
    first_offset: float  # first row of the scatter profile
    offset_count: float


@compiled
def treatment_row(treatments: Floats, i: int) -> Treatment:
    """Return the row of a treated surface."""
    t = treatments[i]
    return Treatment(
        t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8], t[9], t[10], t[11], t[12], t[13], t[14], t[15], t[16],
        t[17], t[18], t[19], t[20],
    )  # fmt: skip


def typed(sample: N, number: float) -> N:
    """Return a number in the type of a sample; a wider type would halve the number of rays per register."""
    return type(sample)(number)


@overload(typed)
def _typed(_sample: Any, _number: Any) -> Any:
    kind = TYPES.get(_sample, np.float64)

    def convert(_sample: Any, _number: Any) -> Any:
        return kind(_number)

    return convert


@intrinsic
def _smaller(_: Any, a: Any, b: Any) -> Any:
    """The smaller of two numbers that are not NaN, in a form that can be vectorised."""
    return a(a, b), _extreme("llvm.minnum")


@intrinsic
def _larger(_: Any, a: Any, b: Any) -> Any:
    """The larger of two numbers; see `_smaller`."""
    return a(a, b), _extreme("llvm.maxnum")


smaller = cast("Callable[[float, float], float]", _smaller)
larger = cast("Callable[[float, float], float]", _larger)


def _extreme(name: str) -> Callable[..., Any]:
    def code(_context: Any, builder: Any, _signature: Any, numbers: Any) -> Any:
        kind = numbers[0].type
        function = builder.module.declare_intrinsic(name, (kind,), ir.FunctionType(kind, (kind, kind)))
        return builder.call(function, numbers, fastmath=("nnan", "nsz"))

    return code


@compiled
def segment_row(shape: Floats, c: int) -> Segment:
    """Return the row of a segment."""
    return Segment(shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4])


@compiled
def arc_row(shape: Floats, c: int) -> Arc:
    """Return the row of an arc."""
    return Arc(shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4], shape[c, 5], shape[c, 6], shape[c, 7])


@compiled
def conic_row(shape: Floats, c: int) -> Conic:
    """Return the row of a conic."""
    return Conic(
        shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4], shape[c, 5], shape[c, 6], shape[c, 7],
        shape[c, 8],
    )  # fmt: skip


@compiled
def oval_row(shape: Floats, c: int) -> Oval:
    """Return the row of an oval."""
    return Oval(
        shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4], shape[c, 5], shape[c, 6], shape[c, 7],
        shape[c, 8], shape[c, 9], shape[c, 10], shape[c, 11], shape[c, 12], shape[c, 13], shape[c, 14], shape[c, 15],
        shape[c, 16], shape[c, 17], shape[c, 18], shape[c, 19], shape[c, 20], shape[c, 21], shape[c, 22], shape[c, 23],
        shape[c, 24], shape[c, 25], shape[c, 26], shape[c, 27], shape[c, 28], shape[c, 29], shape[c, 30],
    )  # fmt: skip


@compiled
def cubic_row(shape: Floats, c: int) -> Cubic:
    """Return the row of a cubic piece."""
    return Cubic(
        shape[c, 0], shape[c, 1], shape[c, 2], shape[c, 3], shape[c, 4], shape[c, 5], shape[c, 6], shape[c, 7],
        shape[c, 8], shape[c, 9], shape[c, 10], shape[c, 11],
    )  # fmt: skip
