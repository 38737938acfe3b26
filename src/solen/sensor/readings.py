"""Readings of a sensor's receivers over its motion: traced power with directionality, and voltages.

`received` returns the fraction of the emitted power that receivers convert to current (`solen.sensor.acceptance`);
`readings` converts it to voltages.
"""

from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.parts import AdcPart, Part, ReceiverPart
from solen.progress import Progress
from solen.readout import Readings, circuit_of, face_areas_mm2, readings_of
from solen.readout.cautions import cautions
from solen.readout.circuit import emitter_part, named_part, trimmer_part
from solen.recording import Provenance
from solen.sensor.acceptance import SIDES, Acceptance
from solen.sensor.response import Response
from solen.sensor.sensor import Sensor
from solen.sensor.unused_keys import keys_without_effect
from solen.spec import Design

ANGLE_RAYS, ANGLE_RAYS_IN_SPACE = 2**12, 2**15
"""Numbers of rays that sample the angles of incidence, for an accuracy of about 0.2 % of the detected fraction."""


def received(sensor: Sensor, response: Response) -> FloatArray:
    """Return the fractions (A, 2) of the emitted power that the right and the left receiver convert to current."""
    acceptance = Acceptance.of(sensor)
    power = np.maximum(np.column_stack([response.right, response.left]), 0.0)
    if acceptance.is_flat:
        return power
    rays = angle_rays(sensor)
    return np.asarray(power * [acceptance.factors(sensor.scene(angle, rays)) for angle in response.angle_deg.tolist()])


def angle_rays(sensor: Sensor) -> int:
    """Return the number of rays that sample the angles of incidence at a directional receiver."""
    return ANGLE_RAYS if sensor.design.trace.dimension == "2d" else ANGLE_RAYS_IN_SPACE


@dataclass(frozen=True)
class PartUsed:
    """A circuit part, the document that its numbers come from, and which of them are estimates."""

    name: str
    kind: str
    document: str
    estimates: tuple[str, ...]


class DesignReadings(Readings, kw_only=True):
    """Readings of a design over its motion.

    Attributes
    ----------
    name, wavelength_nm
        Name of the design, and wavelength of its light.
    temperature_C, ambient_mW_per_cm2
        Temperature and irradiance around the sensor.
    parts
        Parts of the circuit.
    warnings
        Warnings about the numbers.
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
    """Return the readings of a sensor, with the parts of its circuit, warnings and sources."""
    design, result = sensor.design, readings(sensor, progress)
    in_space, dark_V = design.trace.dimension == "extruded", float(result.off_V.max())
    circuit_cautions = cautions(result.circuit, result.advice, sensor.light.wavelength_nm, dark_V, in_space=in_space)
    return DesignReadings(
        **vars(result),
        name=design.name,
        wavelength_nm=sensor.light.wavelength_nm,
        temperature_C=design.readout.temperature_c,
        ambient_mW_per_cm2=design.readout.ambient_mw_cm2,
        parts=parts_used(design),
        warnings=(
            *sensor.warnings,
            *keys_without_effect(sensor, "power"),
            *circuit_cautions,
            *result.coarse_step_warnings(),
        ),
    )


def parts_used(*designs: Design) -> tuple[PartUsed, ...]:
    """Return the circuit parts of designs that differ only in their emitter."""
    design = designs[0]
    parts: tuple[Part, ...] = (
        named_part(design, "part", ReceiverPart),
        *{part.name: part for part in map(emitter_part, designs)}.values(),
        trimmer_part(design),
        named_part(design, "adc", AdcPart),
    )
    return tuple(PartUsed(part.name, part.kind, part.document, part.estimates) for part in parts)


def readings(sensor: Sensor, progress: Progress | None = None) -> Readings:
    """Return the readings of a sensor at the angles of its motion, traced in power.

    Raises
    ------
    DesignError
        If its receivers are not named right and left, or the body cannot be built.
    DataError
        If a part of its circuit is not found, or is of another kind.
    """
    return readings_from(sensor, sensor.power(progress=progress))


def readings_from(sensor: Sensor, response: Response) -> Readings:
    """Return the readings of a sensor at the angles of a response; raise the errors of `readings`."""
    sensor.check_pair()
    design = sensor.design
    areas = face_areas_mm2(design, sensor.body())
    circuit = circuit_of(design, {side: areas[side] for side in SIDES})
    return readings_of(
        circuit,
        response.angle_deg,
        received(sensor, response),
        response.u_power,
        trimmer_part(design),
        ambient_mW_cm2=design.readout.ambient_mw_cm2,
        temperature_C=design.readout.temperature_c,
    )
