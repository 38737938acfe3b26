"""Input and output of every tracer in a comparison.

A *case* is a scene of solen; the other tracers use the same outline, index and fan of rays. The receivers are black: a
ray that reaches one from inside is detected at any angle. Rays do not split; they are either refracted or totally
reflected.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from solen.curve import Segment
from solen.plane import Point
from solen.scene import CosinePower, Emitter, Extrusion, Fan, Interface, Region, Scene
from solen.sensor import Sensor
from solen.spec import Design, Material

INDEX = 1.44
SLAB_MM = (5.0, 100.0)
"""Width and length of the slab; it starts at z = 0."""
FLAT_MM = 1e-5
"""Largest deviation of a mesh from a curved face."""
CHIP_MM, CONE_DEG = 0.2, 120.0
"""Width and height of the chip in space, and the cone to which its light is limited."""
ERROR = 1e-4
"""Error of the detected fraction for which times are given."""


@dataclass(frozen=True)
class Outline:
    """The outline of a body as segments from ``start`` to ``end`` (N, 2) in mm, counter-clockwise in the plane."""

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    receiver: NDArray[np.bool_]


@dataclass(frozen=True)
class Case:
    """A scene for any number of rays; ``box_mm`` is its width and length if it is a box that begins at z = 0."""

    name: str
    make: Callable[[int], Scene]
    box_mm: tuple[float, float] | None = None

    @cached_property
    def outline(self) -> Outline:
        """The outline of the scene, within `FLAT_MM`."""
        faces = self.make(1).interfaces
        lines = [face.curve.flattened(FLAT_MM) for face in faces]
        pieces = [len(line) - 1 for line in lines]
        return Outline(
            start=np.vstack([line[:-1] for line in lines]),
            end=np.vstack([line[1:] for line in lines]),
            receiver=np.repeat([face.receiver is not None for face in faces], pieces),
        )

    @property
    def half_mm(self) -> float | None:
        """Half the thickness of a body in space; None in the plane."""
        extrusion = self.make(1).extrusion
        return None if extrusion is None else 0.5 * extrusion.thickness_mm

    def fan(self, rays: int) -> Fan:
        """Return the only source of the scene."""
        (source,) = self.make(rays).sources
        if not isinstance(source, Fan):
            raise TypeError("the other tracers support only fans")
        return source


@dataclass(frozen=True)
class Row:
    """Results of one tracer for one case.

    ``hits`` counts all hits of rays on faces, including receivers; ``lost`` counts rays that hit a face from the wrong
    side, left the body without a hit, or ended in an error.
    """

    case: str
    tool: str
    geometry: str
    rays: int
    seconds: float
    hits: int
    detected: float
    lost: int
    error: float | None = None
    """error of the detected fraction, if known"""

    @property
    def to_error_s(self) -> float | None:
        """Time to reach an error of `ERROR`, which is inversely proportional to the square root of the ray count."""
        return None if self.error is None else self.seconds * max(self.error / ERROR, 1.0) ** 2


@dataclass(frozen=True)
class Tool:
    """A tracer: the reason why it cannot run (or None), its versions, and its rows for a case.

    ``measure`` takes a case and the number of rays for fast tracers.
    """

    name: str
    missing: Callable[[], str | None]
    versions: Callable[[], str]
    measure: Callable[[Case, int], list[Row]]


def paper_case() -> Case:
    """Return the paper's sensor, rotated by −3°."""
    sensor = Sensor.of(Design(name="paper", material=Material(index=INDEX)))
    return Case("sensor at −3°", lambda rays: sensor.scene(-3.0, rays))


def space_case() -> Case:
    """Return the same sensor in space, with the thickness of the design and a Lambertian chip."""
    sensor = Sensor.of(Design(name="paper", material=Material(index=INDEX)))
    pose = sensor.body(-3.0).emitter

    def make(rays: int) -> Scene:
        chip = Emitter(pose.point, pose.axis_deg, rays, CosinePower(1.0), CONE_DEG, CHIP_MM, CHIP_MM)
        return replace(sensor.scene(-3.0, 1), sources=(chip,), extrusion=Extrusion(sensor.design.body.thickness_mm))

    return Case("chip in space", make)


def slab_case() -> Case:
    """Return a slab with a fan of 120° 1 mm in front of the middle of one end; the other end is the receiver."""
    return Case("slab", slab_scene, SLAB_MM)


def slab_scene(rays: int) -> Scene:
    """Return the scene of `slab_case`."""
    half, length = SLAB_MM[0] / 2, SLAB_MM[1]
    corners: list[Point] = [(-half, 0.0), (half, 0.0), (half, length), (-half, length)]
    lines = [Segment(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    near, right, far, left = lines
    faces = [Interface(name, line, "body", "air") for name, line in (("near", near), ("right", right), ("left", left))]
    faces.insert(2, Interface("far", far, "body", "air", "receiver", "end"))
    fan = Fan((0.0, -1.0), 0.0, 120.0, rays)
    return Scene((Region("air", 1.0), Region("body", INDEX)), tuple(faces), (fan,), name="slab")
