"""The cases in pvtrace 2: a box for the slab, a closed prism for the sensor, and ``follow`` for the rays.

pvtrace is written in plain Python and traces one ray at a time, so it traces only a hundred. Its surfaces choose at
random between Fresnel reflection and refraction. The surface defined here implements counting mode instead: it refracts
or totally reflects, and transmits rays undeviated through a receiver, to the wall of the pvtrace world.
"""

import logging
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import INDEX, Case, Outline, Row, Tool

RAYS = 100
DEPTH_MM, WORLD_MM = 10.0, 1000.0
TOLERANCE_MM = 1e-9
REMEDY = 'pip install "pvtrace>=2.1,<3" pandas'


class CountingSurface:
    """A surface like `solen.refraction`; ``receivers`` (N, 2, 2) are start and end points in the frame of the body."""

    def __init__(self, receivers: NDArray[np.float64]) -> None:
        self.receivers = receivers
        self.detected = 0

    def is_reflected(self, ray: Any, geometry: Any, container: Any, adjacent: Any) -> bool:  # noqa: ARG002
        """Return whether the reflection is total."""
        cos, _, ratio = self._incidence(ray, geometry)
        return not self._at_receiver(ray, cos) and ratio * ratio * (1.0 - cos * cos) >= 1.0

    def reflect(self, ray: Any, geometry: Any, container: Any, adjacent: Any) -> Any:  # noqa: ARG002
        """Return the ray after a total reflection."""
        cos, normal, _ = self._incidence(ray, geometry)
        return _with_direction(ray, np.asarray(ray.direction) - 2.0 * cos * normal)

    def transmit(self, ray: Any, geometry: Any, container: Any, adjacent: Any) -> Any:  # noqa: ARG002
        """Return the ray behind the face."""
        cos, normal, ratio = self._incidence(ray, geometry)
        if self._at_receiver(ray, cos):
            self.detected += 1
            return replace(ray)
        cos2 = math.copysign(math.sqrt(1.0 - ratio * ratio * (1.0 - cos * cos)), cos)
        return _with_direction(ray, ratio * np.asarray(ray.direction) + (cos2 - ratio * cos) * normal)

    def _incidence(self, ray: Any, geometry: Any) -> tuple[float, NDArray[np.float64], float]:
        """Return the cosine of the angle to the outward normal, that normal, and the ratio of the indices."""
        normal = np.asarray(geometry.normal(ray.position))
        cos = float(normal @ np.asarray(ray.direction))
        return cos, normal, INDEX if cos > 0.0 else 1.0 / INDEX

    def _at_receiver(self, ray: Any, cos: float) -> bool:
        start, end = self.receivers[:, 0], self.receivers[:, 1]
        at = np.array([ray.position[0], ray.position[2]])
        distances = np.linalg.norm(at - start, axis=1) + np.linalg.norm(at - end, axis=1)
        return cos > 0.0 and bool(np.any(distances - np.linalg.norm(end - start, axis=1) < TOLERANCE_MM))


def missing() -> str | None:
    """Return why pvtrace cannot run here, or None."""
    if find_spec("pvtrace") is None or find_spec("pandas") is None:
        return f"not installed; {REMEDY}"
    installed = version("pvtrace")
    return None if installed.startswith("2.") else f"version {installed} is not supported; {REMEDY}"


def versions() -> str:
    """Return the versions of pvtrace and of the library that computes its hits."""
    return f"pvtrace {version('pvtrace')}, trimesh {version('trimesh')}"


def measure(case: Case, rays: int) -> list[Row]:
    """Return one row, for at most `RAYS` rays."""
    if case.half_mm is not None:
        return []  # only fans are supported
    rays = min(rays, RAYS)
    with _old_numpy():
        scene, surface = _scene(case)
        fan = list(_fan_rays(case, rays))
        _follow(scene, fan[:2])  # builds the search trees
        surface.detected = 0
        start = time.perf_counter()
        hits, lost = _follow(scene, fan)
        seconds = time.perf_counter() - start
    geometry = "float64 mesh" if case.box_mm is None else "float64 box"
    return [Row(case.name, "pvtrace", geometry, rays, seconds, hits, surface.detected / rays, lost)]


@contextmanager
def _old_numpy() -> Iterator[None]:
    """Restore names that numpy removed in 1.24 but pvtrace needs, and suppress the logging of pvtrace."""
    logging.getLogger().addHandler(logging.NullHandler())  # prevents pvtrace from adding its own handler
    removed = {name: kind for name, kind in (("float", float), ("int", int)) if name not in vars(np)}
    for name, kind in removed.items():
        setattr(np, name, kind)
    try:
        yield
    finally:
        for name in removed:
            delattr(np, name)


def _scene(case: Case) -> tuple[Any, CountingSurface]:
    """Return a body in air inside a spherical world, and its surface; x and z are those of solen."""
    import pvtrace

    air = pvtrace.Material(refractive_index=1.0)
    world = pvtrace.Node(name="world", geometry=pvtrace.Sphere(radius=WORLD_MM, material=air))
    outline = case.outline
    mesh = None if case.box_mm else _closed(outline)
    center = np.asarray(mesh.center_mass if mesh is not None else (0.0, 0.0, (case.box_mm or (0.0, 0.0))[1] / 2))
    pieces = np.stack([outline.start, outline.end], axis=1)[outline.receiver]
    surface = CountingSurface(pieces - center[[0, 2]])
    material = pvtrace.Material(refractive_index=INDEX, surface=surface)
    if case.box_mm:
        geometry = pvtrace.Box((case.box_mm[0], DEPTH_MM, case.box_mm[1]), material=material)
    else:
        geometry = pvtrace.Mesh(mesh, material=material)  # moves its centre of mass to the origin
    pvtrace.Node(name="body", geometry=geometry, parent=world, location=tuple(center))
    return pvtrace.Scene(world), surface


def _closed(outline: Outline) -> Any:
    """Return a closed prism with the outline as cross-section, symmetric about y = 0."""
    import shapely
    import trimesh

    mesh = trimesh.creation.extrude_polygon(shapely.Polygon(outline.start), DEPTH_MM)
    mesh.apply_translation((0.0, 0.0, -DEPTH_MM / 2))
    mesh.apply_transform(np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=float))
    return mesh


def _fan_rays(case: Case, rays: int) -> Iterator[Any]:
    import pvtrace

    launch = case.fan(rays).launch()
    for x, z, dx, dz in zip(launch.x_mm, launch.z_mm, launch.dx, launch.dz, strict=True):
        yield pvtrace.Ray(position=(x, 0.0, z), direction=(dx, 0.0, dz), wavelength=550.0)


def _follow(scene: Any, rays: list[Any]) -> tuple[int, int]:
    """Return the number of hits of all rays, and the number of rays that did not reach the wall of the world."""
    from pvtrace import Event
    from pvtrace.algorithm import photon_tracer

    hits = lost = 0
    for ray in rays:
        try:
            _, events = zip(*photon_tracer.follow(scene, ray), strict=True)
        except Exception:  # the ray is lost, for whatever reason
            lost += 1
            continue
        lost += events[-1] is not Event.EXIT
        hits += sum(event in {Event.REFLECT, Event.TRANSMIT} for event in events)
    return hits, lost


def _with_direction(ray: Any, direction: NDArray[np.float64]) -> Any:
    return replace(ray, direction=tuple(direction.tolist()))


TOOL = Tool("pvtrace", missing, versions, measure)
