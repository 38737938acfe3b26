"""The cases in Mitsuba 3: the outline as the walls of a prism, and a separate loop over ``Scene.ray_intersect``.

Dr.Jit records the loop once, and LLVM compiles it into one kernel that follows all rays at once; Embree computes the
hits. Coordinates are 32-bit floats, as in every LLVM variant of the published builds of Mitsuba, and a ray starts at a
small distance from the face that it left (``spawn_ray``).

Neighbouring rays of a fan have nearly the same path. Embree has an option for this, with which it searches for a whole
packet at once; Mitsuba disables it by default, so both settings are measured.
"""

import math
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
MIN_VERSION = (3, 6)
"""The first version whose Dr.Jit has ``while_loop``."""
MAX_HITS = 10_000
HALF_DEPTH_MM = 1.0

REMEDY = 'pip install "mitsuba>=3.6", and install the LLVM shared library (tested with 15 and 19; Debian: libllvm19)'


class Prism(NamedTuple):
    """A Mitsuba scene whose triangles from number ``first_receiver`` on are receivers."""

    scene: Any
    first_receiver: int
    in_plane: bool


class Sums(NamedTuple):
    """Sums over all rays."""

    hits: int
    detected: int
    lost: int


def missing() -> str | None:
    """Return why Mitsuba cannot run here, or None."""
    if find_spec("mitsuba") is None:
        return f"not installed; {REMEDY}"
    import mitsuba as mi

    if tuple(int(part) for part in mi.__version__.split(".")[:2]) < MIN_VERSION:
        return f"version {mi.__version__} is not supported; {REMEDY}"
    try:
        mi.set_variant(VARIANT)
    except ImportError:
        return f"the LLVM shared library was not found; {REMEDY}, or set DRJIT_LIBLLVM_PATH to its path"
    return None


def versions() -> str:
    """Return the versions of Mitsuba and its components."""
    import drjit as dr
    import mitsuba as mi

    llvm = ".".join(str(part) for part in dr.detail.llvm_version())
    return f"Mitsuba {mi.__version__} ({VARIANT}), Dr.Jit {dr.__version__}, LLVM {llvm}"


def measure(case: Case, rays: int) -> list[Row]:
    """Return the rows for a case, without packets and with them."""
    body, (source,) = prism(case.outline, case.half_mm), case.make(rays).sources
    rows = []
    for name, coherent in (("Mitsuba", False), ("Mitsuba, packets", True)):
        sums = trace(body, source, coherent=coherent, count_lost=True)
        run = partial(trace, body, source, coherent=coherent)
        run()  # compiles the kernel
        detected = sums.detected / rays
        error = None if body.in_plane else math.sqrt(detected * (1.0 - detected) / rays)
        counts = (rays, best_s(run), sums.hits, detected, sums.lost)
        rows.append(Row(case.name, name, "float32 mesh", *counts, error))
    return rows


def prism(outline: Outline, half_mm: float | None = None) -> Prism:
    """Return a scene with two triangles per segment of the outline, receivers last, with normals out of the body.

    If half the thickness is given, as in space, the triangles of top and bottom come first.
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
        triangles = triangulate([outline.start]).astype(np.uint32)
        first = len(vertices) + np.arange(2, dtype=np.uint32) * len(outline.start)
        faces = np.vstack([first[0] + triangles[:, ::-1], first[1] + triangles, faces])
        caps = [np.column_stack([outline.start, np.full(len(outline.start), y)]) for y in (-half, half)]
        vertices = np.vstack([vertices, *caps]).astype(np.float32)
    mesh = mi.Mesh("walls", len(vertices), len(faces))
    values = mi.traverse(mesh)
    values["vertex_positions"] = mi.Float(vertices.ravel())
    values["faces"] = mi.UInt32(faces.ravel())
    values.update()
    scene = mi.load_dict({"type": "scene", "walls": mesh})
    return Prism(scene, len(faces) - 2 * int(np.count_nonzero(outline.receiver)), half_mm is None)


def trace(body: Prism, source: Source, *, coherent: bool, count_lost: bool = False) -> Sums:
    """Follow every ray of a source to its end; counting lost rays takes half as much time again."""
    import drjit as dr
    import mitsuba as mi

    def continues(ray: Any, active: Any, *_: Any) -> Any:  # noqa: ARG001  the loop passes its complete state
        return active

    def step(ray: Any, active: Any, inside: Any, hits: Any, detected: Any, lost: Any) -> tuple[Any, ...]:
        """Follow all rays to their next face."""
        hit = body.scene.ray_intersect(ray, mi.RayFlags.Minimal, coherent, active)
        is_hit = active & hit.is_valid()
        cos = dr.dot(ray.d, hit.n)
        defined = is_hit & ((cos > 0) == inside)
        receiver = defined & (hit.prim_index >= body.first_receiver)
        direction, total = _refracted(ray.d, hit.n, cos, in_plane=body.in_plane)
        hits = dr.select(is_hit, hits + 1, hits)
        if count_lost:
            lost |= (is_hit & ~defined) | (active & ~is_hit & inside)
        goes_on = defined & ~receiver & (hits < MAX_HITS)
        inside_next = inside ^ (goes_on & ~total)
        return hit.spawn_ray(direction), goes_on, inside_next, hits, detected | (receiver & inside), lost

    no = mi.Bool(False)
    rays = _fan_rays(source) if isinstance(source, Fan) else _chip_rays(source)
    state = (rays, mi.Bool(True), no, mi.UInt32(0), no, no)
    _, _, _, hits, detected, lost = dr.while_loop(state, continues, step, mode="symbolic")
    sums = dr.sum(hits), dr.count(detected), dr.count(lost)
    dr.eval(*sums)
    return Sums(*(int(total[0]) for total in sums))


def _fan_rays(fan: Fan) -> Any:
    """Return the rays of a fan in the plane y = 0, in the coordinates (x, z, y) of Mitsuba."""
    import drjit as dr
    import mitsuba as mi

    position = (mi.Float64(dr.arange(mi.UInt32, fan.rays)) + 0.5) / fan.rays - 0.5
    sine, cosine = dr.sincos(mi.Float(np.radians(fan.axis_deg) + np.radians(fan.cone_deg) * position))
    return mi.Ray3f(mi.Point3f(*fan.point, 0.0), mi.Vector3f(-sine, cosine, 0.0))


def _chip_rays(source: Source) -> Any:
    """Return independent rays of a Lambertian chip, in the coordinates (x, z, y) of Mitsuba."""
    import drjit as dr
    import mitsuba as mi

    if not isinstance(source, Emitter):
        raise TypeError("the other tracers support only fans and chips")
    random = mi.PCG32(size=source.rays)
    u, v, width, height = (random.next_float32() for _ in range(4))
    sine = dr.sqrt(u) * math.sin(source.half_rad)
    sin_azimuth, cos_azimuth = dr.sincos(2.0 * math.pi * v)
    along, left, up = dr.sqrt(1.0 - sine * sine), sine * cos_azimuth, sine * sin_azimuth
    axis, across = heading(source.axis_deg), heading(source.axis_deg + 90.0)
    offset, y = source.width_mm * (width - 0.5), source.height_mm * (height - 0.5)
    point = mi.Point3f(source.point[0] + across[0] * offset, source.point[1] + across[1] * offset, y)
    direction = mi.Vector3f(axis[0] * along + across[0] * left, axis[1] * along + across[1] * left, up)
    return mi.Ray3f(point, direction)


def _refracted(direction: Any, normal: Any, cos: Any, *, in_plane: bool) -> tuple[Any, Any]:
    """Return the direction after refraction or total reflection, and whether the reflection is total.

    ``cos`` is the cosine of the angle between direction and outward normal, positive for a ray in the body.
    """
    import drjit as dr
    import mitsuba as mi

    ratio = dr.select(cos > 0, mi.Float(INDEX), mi.Float(1.0 / INDEX))
    cos2 = 1.0 - ratio * ratio * (1.0 - cos * cos)
    total = cos2 <= 0
    root = dr.sqrt(dr.select(total, 0.0, cos2))  # LLVM 15 cannot compile dr.safe_sqrt
    factor = dr.copysign(root, cos) - ratio * cos
    result = dr.select(total, 1.0, ratio) * direction + dr.select(total, -2.0 * cos, factor) * normal
    if in_plane:
        result.z = 0.0
    return dr.normalize(result), total


TOOL = Tool("Mitsuba 3", missing, versions, measure)
