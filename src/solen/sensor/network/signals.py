"""Voltages at the receivers of a network with each emitter lit in turn, and the noise of every reading.

A reading is the voltage with one emitter on, minus the mean of the voltages with all emitters off before and after it.
An off phase follows every emitter's on phase, so that two consecutive emitters share an off phase, and their readings
at the same receiver are correlated.

Public names: `circuits_of` and `network_signals`.
"""

from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.readout import Circuit, circuit_of, face_areas_mm2, noise, volts
from solen.readout.readings import difference_sd_V
from solen.results import Result
from solen.sensor.acceptance import Acceptance
from solen.sensor.network.response import emitter_sensors
from solen.sensor.readings import angle_rays
from solen.spec import Design

SHARED_OFF_COVARIANCE = 0.25
"""Covariance of the readings of two emitters that share an off reading, over the variance of the latter: ½ · ½."""


class Signals(Result):
    """Voltages of a network's receivers with the emitters lit in turn, and their noise, by state, emitter and receiver.

    Attributes
    ----------
    emitters, receivers
        Names of the emitters and receivers.
    received
        Fractions (states, emitters, receivers) of the emitted power that receivers convert to current.
    voltage_V, u_voltage_V, off_V
        Voltages (states, emitters, receivers) with an emitter on, their uncertainty due to the traced powers, and
        voltages (receivers,) with all emitters off.
    sd_V
        Noise (states, emitters, receivers) of a reading: on, minus the mean of the off readings before and after.
    sd_off_V
        Noise (receivers,) of an off reading.
    slope_V
        Change (states, emitters, receivers) of the voltage per fraction of the emitted power, which is negative.
    """

    emitters: tuple[str, ...]
    receivers: tuple[str, ...]
    received: FloatArray
    voltage_V: FloatArray
    u_voltage_V: FloatArray
    off_V: FloatArray
    sd_V: FloatArray
    sd_off_V: FloatArray
    slope_V: FloatArray

    def covariance_V2(self, state: int = 0) -> FloatArray:
        """Return the covariance (emitters·receivers, emitters·receivers) of the readings in a state, in V²."""
        sd = self.sd_V[state]
        count, receivers = sd.shape
        covariance = np.diag(sd.ravel() ** 2)
        first = np.arange((count - 1) * receivers)
        shared = SHARED_OFF_COVARIANCE * np.tile(self.sd_off_V**2, count - 1)
        covariance[first, first + receivers] = covariance[first + receivers, first] = shared
        return covariance


def circuits_of(design: Design) -> tuple[Circuit, ...]:
    """Return each emitter's circuit with typical parts; raise the errors of `solen.readout.circuit_of`."""
    sensors = emitter_sensors(design)
    face_areas = face_areas_mm2(design, sensors[0].body())
    areas = {receiver.name: face_areas[receiver.name] for receiver in design.network.receivers}
    return tuple(circuit_of(sensor.design, areas) for sensor in sensors)


def received_by(designs: Sequence[Design], power: FloatArray) -> FloatArray:
    """Return the fractions (states, emitters, receivers) of the power that are converted to current.

    ``designs`` are the network in each state, with the motions at their ``at_deg``, and ``power`` is the power through
    the receivers' faces.
    """
    power = np.maximum(power, 0.0)
    names = [receiver.name for receiver in designs[0].network.receivers]
    sensors = [emitter_sensors(design) for design in designs]
    if all(Acceptance.of(sensor).is_flat for sensor in sensors[0]):
        return power
    rows = [
        [Acceptance.of(sensor).factors(sensor.scene(rays=angle_rays(sensor)), names) for sensor in row]
        for row in sensors
    ]
    return np.asarray(power * rows)


def network_signals(designs: Sequence[Design], power: FloatArray, u_power: FloatArray) -> Signals:
    """Return the voltages and the noise of a network in several states.

    Parameters
    ----------
    designs
        The network in each state, from `solen.spec.placed.state_of`; the circuit is that of the first.
    power, u_power
        Fractions (states, emitters, receivers) of the emitted power through the receivers' faces, with uncertainties.

    Raises
    ------
    DataError
        If a part of the circuit is not found, or is of another kind.
    """
    circuits, received = circuits_of(designs[0]), received_by(designs, power)
    readout = designs[0].readout
    light = (readout.ambient_mw_cm2, readout.temperature_c)
    pairs = [(circuit, received[:, i]) for i, circuit in enumerate(circuits)]
    dark = np.zeros(len(circuits[0].names))
    slope = np.stack([circuit.slope_V(fractions, *light) for circuit, fractions in pairs], axis=1)
    sd_on = np.stack([noise(circuit, fractions, *light).reading_V for circuit, fractions in pairs], axis=1)
    sd_off = noise(circuits[0], dark, *light).reading_V
    return Signals(
        emitters=tuple(emitter.name for emitter in designs[0].network.emitters),
        receivers=circuits[0].names,
        received=received,
        voltage_V=np.stack([volts(fractions, circuit, *light) for circuit, fractions in pairs], axis=1),
        u_voltage_V=u_power * np.abs(slope),
        off_V=volts(dark, circuits[0], *light),
        sd_V=difference_sd_V(sd_on, sd_off),
        sd_off_V=sd_off,
        slope_V=slope,
    )
