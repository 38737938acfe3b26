"""What the receivers of a sensor read over its motion: traced power, as directional parts see it, and the volts of it.

A trace gives the power through a receiver's face. A part with a lens sees less of what arrives from the side, so its
current is not in proportion to that power. `Acceptance` is what its directionality makes of the light of a scene;
everything that turns traced power into currents takes its shares from here: `readings`, the simulated bench and the
diagnosis.
"""

from dataclasses import dataclass, replace

import numpy as np

from solen.arrays import FloatArray, Progress
from solen.parts import AdcPart, ReceiverPart
from solen.readout import Readings, circuit_of, face_areas_mm2, readings_of
from solen.readout.cautions import cautions
from solen.readout.circuit import emitter_part, named_part, trimmer_part
from solen.readout.transistor import angular_factor, exponent_of
from solen.recording import Provenance
from solen.scene import Scene
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.trace import trace

SIDES = ("right", "left")
ANGLE_BINS, ANGLE_RAYS = 90, 4096
FLAT = 1e-6
"""How near to 1 the exponent of a flat window is."""


@dataclass(frozen=True)
class Acceptance:
    """How receivers see light by its angle of incidence: as cos^m to a beam.

    Attributes
    ----------
    exponent
        m; 1 for a flat window, whose current depends on the power through it alone.
    index
        Of the material at the window: behind a matched face it sees an angle as air would show it, by Snell's law.
    """

    exponent: float = 1.0
    index: float = 1.0

    @classmethod
    def of(cls, sensor: Sensor) -> "Acceptance":
        """Acceptance of the part that a design names; `DataError` where there is no such receiver."""
        matched = sensor.design.receivers.coupling == "matched"
        exponent = exponent_of(named_part(sensor.design, "part", ReceiverPart))
        return cls(exponent, sensor.material.index if matched else 1.0)

    @property
    def is_flat(self) -> bool:
        """Whether all light through the face counts alike."""
        return abs(self.exponent - 1.0) < FLAT

    def factors(self, scene: Scene) -> FloatArray:
        """Shares (2,) of the power at the right and the left receiver that their parts see, of a scene's first source.

        1 where no light arrives.
        """
        if self.is_flat:
            return np.ones(len(SIDES))
        edges = np.linspace(-90.0, 90.0, ANGLE_BINS + 1)
        sine = np.sin(np.radians(0.5 * (edges[1:] + edges[:-1])))
        window_deg = np.degrees(np.arcsin(np.clip(sine * self.index, -1.0, 1.0)))
        emitter_alone = replace(scene, sources=scene.sources[:1])
        detectors = trace(emitter_alone, "power", angle_bins=ANGLE_BINS).detectors
        return np.array(
            [float(angular_factor(self.exponent, window_deg, detectors[side].power_by_angle)) for side in SIDES]
        )


def received(sensor: Sensor, response: Response) -> FloatArray:
    """Shares (A, 2) of the emitted power that the right and the left receiver of a response make their current of."""
    acceptance = Acceptance.of(sensor)
    power = np.maximum(np.column_stack([response.right, response.left]), 0.0)
    if acceptance.is_flat:
        return power
    angles_deg = response.angle_deg.tolist()
    return np.asarray(power * [acceptance.factors(sensor.scene(angle, ANGLE_RAYS)) for angle in angles_deg])


@dataclass(frozen=True)
class PartUsed:
    """A part that a circuit is made of, its document, and which of its numbers are estimates."""

    name: str
    kind: str
    document: str
    estimates: tuple[str, ...]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class DesignReadings(Readings):
    """Readings of a design over its motion.

    Attributes
    ----------
    name, wavelength_nm
        Name of the design, and wavelength of its light.
    temperature_C, ambient_mW_per_cm2
        Temperature and irradiance around the sensor.
    parts
        Components of the circuit.
    warnings
        What must be known before the numbers are used.
    simulated
        Always true: nothing was measured.
    sources
        Files that the numbers come from.
    """

    name: str
    wavelength_nm: float
    temperature_C: float
    ambient_mW_per_cm2: float
    parts: tuple[PartUsed, ...]
    warnings: tuple[str, ...]
    simulated: bool = True
    sources: tuple[Provenance, ...] = ()


def design_readings(sensor: Sensor, progress: Progress | None = None) -> DesignReadings:
    """Readings of a sensor as `readings` gives them, with the parts of its circuit and what must be known of it."""
    design, found = sensor.design, readings(sensor, progress)
    in_space, dark_V = design.trace.dimension == "extruded", float(found.off_V.max())
    reasons = cautions(found.circuit, found.advice, sensor.light.wavelength_nm, dark_V, in_space=in_space)
    parts = (
        named_part(design, "part", ReceiverPart),
        emitter_part(design),
        trimmer_part(design),
        named_part(design, "adc", AdcPart),
    )
    return DesignReadings(
        **vars(found),
        name=design.name,
        wavelength_nm=sensor.light.wavelength_nm,
        temperature_C=design.readout.temperature_c,
        ambient_mW_per_cm2=design.readout.ambient_mw_cm2,
        parts=tuple(PartUsed(part.name, part.kind, part.document, part.estimates) for part in parts),
        warnings=(*sensor.warnings, *keys_without_effect(sensor, "power"), *reasons, *found.coarse()),
    )


def readings(sensor: Sensor, progress: Progress | None = None) -> Readings:
    """Readings of a sensor at the angles of its motion, traced in power.

    Raises
    ------
    DesignError
        Where its receivers are not right and left, or the body cannot be built.
    DataError
        Where a part of its circuit is not found, or is of another kind.
    """
    sensor.check_pair()
    design = sensor.design
    areas = face_areas_mm2(design, sensor.body())
    circuit = circuit_of(design, {side: areas[side] for side in SIDES})
    response = sensor.power(progress=progress)
    return readings_of(
        circuit,
        response.angle_deg,
        received(sensor, response),
        response.u_power,
        trimmer_part(design),
        ambient_mW_cm2=design.readout.ambient_mw_cm2,
        temperature_C=design.readout.temperature_c,
    )
