"""A scene as arrays: the seam between what a scene means and how fast it is traced.

One row per interface: the kind of its curve, up to `WIDTH` numbers that describe it, its behaviour, the regions on its
sides and its receiver. A new curve is a class in `solen.curve`, a row here and a function in `solen.trace.kernel`.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from solen.curve import Arc, CartesianOval, Curve, Parabola, Segment
from solen.errors import DesignError
from solen.plane import minus, unit
from solen.scene import Scene
from solen.scene.model import BEHAVIOURS

SEGMENT, ARC, PARABOLA, OVAL = range(4)
REFRACTING, MIRROR, ABSORBING, RECEIVER = range(len(BEHAVIOURS))
WIDTH = 21


class Tables(NamedTuple):
    """Arrays of a scene: C interfaces, R regions, M monitors. The kernel takes nothing else."""

    kind: NDArray[np.int64]
    """(C,) which curve"""
    shape: NDArray[np.float64]
    """(C, WIDTH) its numbers, in the order of the functions below"""
    middle: NDArray[np.float64]
    """(C, 2) its point halfway"""
    behaviour: NDArray[np.int64]
    """(C,) index into BEHAVIOURS"""
    left: NDArray[np.int64]
    """(C,) region on the left"""
    right: NDArray[np.int64]
    """(C,) region on the right"""
    receiver: NDArray[np.int64]
    """(C,) receiver, −1 where it is none"""
    refractive_index: NDArray[np.float64]
    """(R,) refractive index"""
    absorption: NDArray[np.float64]
    """(R,) absorption per mm"""
    monitor: NDArray[np.float64]
    """(M, 5) start x, z, unit direction x, z, length"""
    bins: NDArray[np.int64]
    """(M,) bins of the map"""
    first_bin: NDArray[np.int64]
    """(M,) where the map begins in the array of all maps"""


def compile_scene(scene: Scene) -> Tables:
    """Arrays of a scene; `DesignError` where a curve has no compiled form."""
    names = [region.name for region in scene.regions]
    receivers = scene.receivers
    rows = [_row(interface.curve) for interface in scene.interfaces]
    bins = np.array([monitor.bins for monitor in scene.monitors], dtype=np.int64)
    return Tables(
        kind=np.array([kind for kind, _ in rows], dtype=np.int64),
        shape=np.array([shape + (0.0,) * (WIDTH - len(shape)) for _, shape in rows]).reshape(-1, WIDTH),
        middle=np.array([interface.curve.middle_point for interface in scene.interfaces], dtype=float).reshape(-1, 2),
        behaviour=np.array([BEHAVIOURS.index(i.behaviour) for i in scene.interfaces], dtype=np.int64),
        left=np.array([names.index(i.left) for i in scene.interfaces], dtype=np.int64),
        right=np.array([names.index(i.right) for i in scene.interfaces], dtype=np.int64),
        receiver=np.array(
            [-1 if i.receiver is None else receivers.index(i.receiver) for i in scene.interfaces], dtype=np.int64
        ),
        refractive_index=np.array([region.index for region in scene.regions], dtype=float),
        absorption=np.array([region.absorption_per_mm for region in scene.regions], dtype=float),
        monitor=np.array([_segment(monitor.segment) for monitor in scene.monitors], dtype=float).reshape(-1, 5),
        bins=bins,
        first_bin=np.cumsum(bins) - bins,
    )


def _row(curve: Curve) -> tuple[int, tuple[float, ...]]:
    if type(curve) not in ROWS:
        known = ", ".join(cls.__name__ for cls in ROWS)
        raise DesignError(f"curve {type(curve).__name__}", limit=f"the compiled engine knows {known}")
    kind, row = ROWS[type(curve)]
    return kind, row(curve)


def _segment(curve: Segment) -> tuple[float, ...]:
    return (*curve.a, *unit(minus(curve.b, curve.a)), curve.length_mm)


def _arc(curve: Arc) -> tuple[float, ...]:
    towards_center = 1.0 if curve.sweep_deg > 0 else -1.0
    end_mm = curve.radius_mm * math.sin(math.radians(curve.half_deg))
    return (*curve.center, curve.radius_mm, *curve.middle, end_mm, towards_center, float(curve.half_deg <= 90.0))


def _parabola(curve: Parabola) -> tuple[float, ...]:
    low, high = sorted((curve.from_mm, curve.to_mm))
    forwards = 1.0 if curve.to_mm > curve.from_mm else -1.0
    return (*curve.vertex, *curve.axis, curve.curve_per_mm, low, high, forwards)


def _oval(curve: CartesianOval) -> tuple[float, ...]:
    """Foci, indices, distances, vertex, axis, depth, side of the normal, a circle round the piece, rays to its ends."""
    outline = curve.flattened()
    center = 0.5 * (outline.min(axis=0) + outline.max(axis=0))
    radius = 1.01 * float(np.max(np.hypot(*(outline - center).T))) + 1e-3  # generous: it only spares Newton's method
    outwards = 1.0 if curve.to_deg > curve.from_deg else -1.0
    foci = (*curve.object_focus, *curve.image_focus)
    frame = (*curve.vertex, *curve.axis, curve.depth_mm, outwards)
    circle = (float(center[0]), float(center[1]), radius)
    right, left = curve.end_rays
    return (*foci, curve.n1, curve.n2, curve.object_mm, *frame, *circle, *right, *left, curve.image_mm)


ROWS: dict[type[Curve], tuple[int, Callable[[Any], tuple[float, ...]]]] = {
    Segment: (SEGMENT, _segment),
    Arc: (ARC, _arc),
    Parabola: (PARABOLA, _parabola),
    CartesianOval: (OVAL, _oval),
}
