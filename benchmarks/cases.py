"""What every tracer of a comparison is given, and what it hands back.

A *case* is a scene of solen's; another tracer gets the same outline, index and fan of rays from it. The receivers are
black: a ray that reaches one from inside is detected, whatever its angle. Nothing splits: a ray is refracted, or
totally reflected.
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
"""How far a mesh may leave a curved face."""
CHIP_MM, CONE_DEG = 0.2, 120.0
"""Of the chip in space: width and height, and the cone that its light is cut at."""
ERROR = 1e-4
"""Of the detected share, that times are stated to."""


@dataclass(frozen=True)
class Outline:
    """The body as straight pieces, counter-clockwise in the plane: from ``start`` to ``end`` (N, 2), mm."""

    start: NDArray[np.float64]
    end: NDArray[np.float64]
    receiver: NDArray[np.bool_]


@dataclass(frozen=True)
class Case:
    """A scene for any number of rays; ``box_mm`` is its width and length where it is a box from z = 0 on."""

    name: str
    make: Callable[[int], Scene]
    box_mm: tuple[float, float] | None = None

    @cached_property
    def outline(self) -> Outline:
        """The scene's outline within `FLAT_MM`."""
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
        """Its only source."""
        (source,) = self.make(rays).sources
        if not isinstance(source, Fan):
            raise TypeError("the other tracers are only given fans")
        return source


@dataclass(frozen=True)
class Row:
    """What one tracer did with one case.

    ``hits`` counts every meeting of a ray with a face, the receiver's included; ``lost`` rays met a face from the wrong
    side, left the body without meeting one, or ended in an error.
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
    """of the detected share, as far as it is known"""

    @property
    def to_error_s(self) -> float | None:
        """Time to an error of `ERROR`, which falls with the root of the number of rays."""
        return None if self.error is None else self.seconds * max(self.error / ERROR, 1.0) ** 2


@dataclass(frozen=True)
class Tool:
    """A tracer: why it cannot run here (None: it can), its versions once it has run, and its rows for a case.

    ``measure`` takes the case and the number of rays that a fast tracer should trace.
    """

    name: str
    missing: Callable[[], str | None]
    versions: Callable[[], str]
    measure: Callable[[Case, int], list[Row]]


def paper_case() -> Case:
    """The paper's sensor, turned by −3°."""
    sensor = Sensor.of(Design(name="paper", material=Material(index=INDEX)))
    return Case("sensor at −3°", lambda rays: sensor.scene(-3.0, rays))


def space_case() -> Case:
    """The same in space, as thick as the design says, and the emitter a chip with a Lambertian pattern."""
    sensor = Sensor.of(Design(name="paper", material=Material(index=INDEX)))
    pose = sensor.body(-3.0).emitter

    def make(rays: int) -> Scene:
        chip = Emitter(pose.point, pose.axis_deg, rays, CosinePower(1.0), CONE_DEG, CHIP_MM, CHIP_MM)
        return replace(sensor.scene(-3.0, 1), sources=(chip,), extrusion=Extrusion(sensor.design.body.thickness_mm))

    return Case("chip in space", make)


def slab_case() -> Case:
    """A plain slab; a fan of 120° starts 1 mm before the middle of one end, the other end is the receiver."""
    return Case("slab", slab_scene, SLAB_MM)


def slab_scene(rays: int) -> Scene:
    """See :func:`slab_case`."""
    half, length = SLAB_MM[0] / 2, SLAB_MM[1]
    corners: list[Point] = [(-half, 0.0), (half, 0.0), (half, length), (-half, length)]
    lines = [Segment(a, b) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]
    near, right, far, left = lines
    faces = [Interface(name, line, "body", "air") for name, line in (("near", near), ("right", right), ("left", left))]
    faces.insert(2, Interface("far", far, "body", "air", "receiver", "end"))
    fan = Fan((0.0, -1.0), 0.0, 120.0, rays)
    return Scene((Region("air", 1.0), Region("body", INDEX)), tuple(faces), (fan,), name="slab")
