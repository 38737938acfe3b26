"""The cases in Mitsuba 3: the outline as the walls of a prism, and a loop of our own over ``Scene.ray_intersect``.

Dr.Jit records the loop once and LLVM compiles it into one kernel that follows a whole wavefront of rays; Embree finds
the hits. Coordinates are 32-bit floats, as in every LLVM variant of Mitsuba's published builds, and a ray starts
slightly off the face that it left (``spawn_ray``).

Neighbouring rays of a fan have nearly the same path. Embree has an option for this, with which it searches for a whole
packet at once; Mitsuba disables it by default, so both are measured.
"""

import math
import time
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from manifold3d import triangulate

from benchmarks.cases import INDEX, Case, Outline, Row, Tool
from benchmarks.tracing import best_s
from solen.plane import heading
from solen.scene import Emitter, Fan
from solen.scene.sources import Source

VARIANT = "llvm_ad_rgb"
OLDEST = (3, 6)
"""Oldest supported version, whose Dr.Jit is the first with ``while_loop``."""
MAX_HITS = 10_000
HALF_DEPTH_MM = 1.0

HOW = 'pip install "mitsuba>=3.6", and LLVM\'s shared library (tried with 15 and 19; Debian: libllvm19)'


class Prism(NamedTuple):
    """A Mitsuba scene whose triangles from number ``first_receiver`` on are receivers; ``flat``: in a plane."""

    scene: Any
    first_receiver: int
    flat: bool


class Found(NamedTuple):
    """Sums over all rays."""

    hits: int
    detected: int
    lost: int


def missing() -> str | None:
    """Return why Mitsuba cannot run here, or None."""
    if find_spec("mitsuba") is None:
        return HOW
    import mitsuba as mi

    if tuple(int(part) for part in mi.__version__.split(".")[:2]) < OLDEST:
        return f"this is {mi.__version__}; {HOW}"
    try:
        mi.set_variant(VARIANT)
    except ImportError:
        return f"LLVM's shared library was not found: {HOW}, or name its file in DRJIT_LIBLLVM_PATH"
    return None


def versions() -> str:
    """Return versions of Mitsuba and its components."""
    import drjit as dr
    import mitsuba as mi

    llvm = ".".join(str(part) for part in dr.detail.llvm_version())
    return f"Mitsuba {mi.__version__} ({VARIANT}), Dr.Jit {dr.__version__}, LLVM {llvm}"


def measure(case: Case, rays: int) -> list[Row]:
    """Return rows of a case, without packets and with them."""
    made, (source,) = prism(case.outline, case.half_mm), case.make(rays).sources
    rows = []
    for how, coherent in (("", False), (", packets", True)):
        found = trace(made, source, coherent=coherent, watch=True)
        run = partial(trace, made, source, coherent=coherent)
        run()  # compiles the kernel
        seconds = best_s(run, clock=time.process_time)
        share = found.detected / rays
        error = None if made.flat else math.sqrt(share * (1.0 - share) / rays)
        row = Row(case.name, f"Mitsuba{how}", "float32 mesh", rays, seconds, found.hits, share, found.lost, error)
        rows.append(row)
    return rows


def prism(outline: Outline, half_mm: float | None = None) -> Prism:
    """Return two triangles for each piece of the outline, receivers last; their normals point out of the body.

    With half a thickness, as in space, top and bottom come first.
    """
    import mitsuba as mi

    order = np.argsort(outline.receiver, kind="stable")
    start, end = outline.start[order], outline.end[order]
    half = half_mm or HALF_DEPTH_MM
    walls = np.empty((len(start), 4, 3), dtype=np.float32)
    walls[:, (0, 3), :2], walls[:, (1, 2), :2] = start[:, None], end[:, None]
    walls[:, :2, 2], walls[:, 2:, 2] = -half, half
    vertices = walls.reshape(-1, 3)
    faces = 4 * np.arange(len(start), dtype=np.uint32)[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
    faces = faces.reshape(-1, 3)
    if half_mm is not None:
        flat = triangulate([outline.start]).astype(np.uint32)
        corners = len(vertices) + np.arange(2, dtype=np.uint32) * len(outline.start)
        faces = np.vstack([corners[0] + flat[:, ::-1], corners[1] + flat, faces])
        caps = [np.column_stack([outline.start, np.full(len(outline.start), y)]) for y in (-half, half)]
        vertices = np.vstack([vertices, *caps]).astype(np.float32)
    mesh = mi.Mesh("walls", len(vertices), len(faces))
    values = mi.traverse(mesh)
    values["vertex_positions"] = mi.Float(vertices.ravel())
    values["faces"] = mi.UInt32(faces.ravel())
    values.update()
    scene = mi.load_dict({"type": "scene", "walls": mesh})
    return Prism(scene, len(faces) - 2 * int(np.count_nonzero(outline.receiver)), half_mm is None)


def trace(made: Prism, source: Source, *, coherent: bool, watch: bool = False) -> Found:
    """Follow every ray of a source to its end; ``watch`` counts lost rays, which takes half as much time again."""
    import drjit as dr
    import mitsuba as mi

    def going_on(ray: Any, going: Any, *_: Any) -> Any:  # noqa: ARG001  the loop hands over its whole state
        return going

    def step(ray: Any, going: Any, inside: Any, hits: Any, detected: Any, lost: Any) -> tuple[Any, ...]:
        """Follow all rays to their next face."""
        hit = made.scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent, going)
        met = going & hit.is_valid()
        cos = dr.dot(ray.d, hit.n)
        defined = met & ((cos > 0) == inside)
        receiver = defined & (hit.prim_index >= made.first_receiver)
        direction, total = _bent(ray.d, hit.n, cos, flat=made.flat)
        hits = dr.select(met, hits + 1, hits)
        if watch:
            lost |= (met & ~defined) | (going & ~met & inside)
        goes_on = defined & ~receiver & (hits < MAX_HITS)
        inside_next = inside ^ (goes_on & ~total)
        return hit.spawn_ray(direction), goes_on, inside_next, hits, detected | (receiver & inside), lost

    no = mi.Bool(False)
    state = (
        _launched(source) if isinstance(source, Fan) else _emitted(source),
        mi.Bool(True),
        no,
        mi.UInt32(0),
        no,
        no,
    )
    _, _, _, hits, detected, lost = dr.while_loop(state, going_on, step, mode="symbolic")
    sums = dr.sum(hits), dr.count(detected), dr.count(lost)
    dr.eval(*sums)
    return Found(*(int(total[0]) for total in sums))


def _launched(fan: Fan) -> Any:
    """Return rays of a fan in the plane y = 0 of Mitsuba's (x, z, y)."""
    import drjit as dr
    import mitsuba as mi

    share = (mi.Float64(dr.arange(mi.UInt32, fan.rays)) + 0.5) / fan.rays - 0.5
    sine, cosine = dr.sincos(mi.Float(np.radians(fan.axis_deg) + np.radians(fan.cone_deg) * share))
    return mi.Ray3f(mi.Point3f(*fan.point, 0.0), mi.Vector3f(-sine, cosine, 0.0))


def _emitted(source: Source) -> Any:
    """Return independent rays of a chip with a Lambertian pattern, in Mitsuba's (x, z, y)."""
    import drjit as dr
    import mitsuba as mi

    if not isinstance(source, Emitter):
        raise TypeError("the other tracers are given fans and chips")
    random = mi.PCG32(size=source.rays)
    share, turn, wide, high = (random.next_float32() for _ in range(4))
    sine = dr.sqrt(share) * math.sin(source.half_rad)
    across, up = dr.sincos(2.0 * math.pi * turn)
    along, left, up = dr.sqrt(1.0 - sine * sine), sine * up, sine * across
    axis, aside = heading(source.axis_deg), heading(source.axis_deg + 90.0)
    step, y = source.width_mm * (wide - 0.5), source.height_mm * (high - 0.5)
    point = mi.Point3f(source.point[0] + aside[0] * step, source.point[1] + aside[1] * step, y)
    direction = mi.Vector3f(axis[0] * along + aside[0] * left, axis[1] * along + aside[1] * left, up)
    return mi.Ray3f(point, direction)


def _bent(direction: Any, normal: Any, cos: Any, *, flat: bool) -> tuple[Any, Any]:
    """Return the direction behind the face, or before it after total reflection, and whether it is total.

    ``cos`` is the direction's cosine with the outward normal: positive for a ray in the body.
    """
    import drjit as dr
    import mitsuba as mi

    ratio = dr.select(cos > 0, mi.Float(INDEX), mi.Float(1.0 / INDEX))
    cos2 = 1.0 - ratio * ratio * (1.0 - cos * cos)
    total = cos2 <= 0
    root = dr.sqrt(dr.select(total, 0.0, cos2))  # LLVM 15 cannot compile dr.safe_sqrt
    through = dr.copysign(root, cos) - ratio * cos
    bent = dr.select(total, 1.0, ratio) * direction + dr.select(total, -2.0 * cos, through) * normal
    if flat:
        bent.z = 0.0
    return dr.normalize(bent), total


TOOL = Tool("Mitsuba 3", missing, versions, measure)
