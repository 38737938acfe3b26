"""Check whether a network can be built in the states of its motions, with a summary of its parts."""

from collections.abc import Sequence
from dataclasses import dataclass

from solen.geometry.network import DrawnLens, drawn_lenses, network_lenses
from solen.lens import CurvedLens, Lens
from solen.material import Optical
from solen.results import Result
from solen.sensor.network.response import emitter_sensors, receivers_of, warnings_of
from solen.sensor.sensor import Sensor
from solen.spec import Design
from solen.spec.placed import states


@dataclass(frozen=True)
class NetworkLens:
    """A lens of a network, with its best focus at its emitter's wavelength, in mm behind the vertex."""

    name: str
    shape: str
    half_width_mm: float
    depth_mm: float
    best_focus_mm: float | None


@dataclass(frozen=True)
class NetworkEmitter:
    """An emitter of a network: position, direction, counter-clockwise from +z, and wavelength."""

    name: str
    x_mm: float
    z_mm: float
    axis_deg: float
    wavelength_nm: float


class NetworkCheck(Result):
    """A network that can be built in the checked states of its motions.

    Attributes
    ----------
    name
        Name of the design.
    states
        Number of states in which the body was built: each motion over its range, and all motions together at their
        ends.
    material
        Index and absorption at the first emitter's wavelength.
    guides, receivers, motions
        Names of its guides, receivers and motions.
    readings
        Expressions of its readings, keyed by name.
    lenses, emitters
        Its lenses, and its emitters at rest.
    faces
        Names of all faces.
    area_mm2
        Area of the section.
    warnings
        Warnings about the design, including keys without effect.
    """

    name: str
    states: int
    material: Optical
    guides: tuple[str, ...]
    lenses: tuple[NetworkLens, ...]
    emitters: tuple[NetworkEmitter, ...]
    receivers: tuple[str, ...]
    motions: tuple[str, ...]
    readings: dict[str, str]
    faces: tuple[str, ...]
    area_mm2: float
    warnings: tuple[str, ...]

    @property
    def kind(self) -> str:
        """Kind of network, as a phrase."""
        return f"a network of {len(self.guides)} guides" if self.guides else "a drawn network"


def network_check(design: Design) -> NetworkCheck:
    """Check that a network can be built in all states of its motions; raise `DesignError` if it cannot."""
    sensors = emitter_sensors(design)
    for sensor in sensors:
        sensor.check()
    body, network = sensors[0].body(), design.network
    lenses = network_lenses(design) if design.outline_file is None else drawn_lenses(design, body)
    return NetworkCheck(
        name=design.name,
        states=len(list(states(network))),
        material=sensors[0].material,
        guides=tuple(guide.name for guide in network.guides),
        lenses=tuple(_lens(sensors, name, lens) for name, lens in lenses.items()),
        emitters=tuple(_emitter(sensor) for sensor in sensors),
        receivers=receivers_of(sensors),
        motions=tuple(motion.name for motion in network.motion),
        readings={reading.name: reading.value for reading in network.reading},
        faces=tuple(face.name for face in (*body.all_faces, *body.separate)),
        area_mm2=body.area_mm2(),
        warnings=warnings_of(sensors),
    )


def _lens(sensors: Sequence[Sensor], name: str, lens: Lens | DrawnLens) -> NetworkLens:
    """Return a lens with its focus at the wavelength of its emitter, or of the first emitter if it has none."""
    network = sensors[0].design.network
    lit = [sensor for sensor, emitter in zip(sensors, network.emitters, strict=True) if emitter.lens == name]
    index = (lit or sensors)[0].material.index
    focus = lens.best_focus_mm(index) if isinstance(lens, CurvedLens) else None
    return NetworkLens(name, lens.shape, lens.half_width_mm, lens.depth_mm, focus)


def _emitter(sensor: Sensor) -> NetworkEmitter:
    pose = sensor.body().emitter
    return NetworkEmitter(sensor.design.network.lit or "", *pose.point, pose.axis_deg, sensor.light.wavelength_nm)
