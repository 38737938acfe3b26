"""Voltages at the receivers of a network with each emitter lit in turn, and the noise of every reading.

A reading is the voltage with one emitter on, minus the mean of the voltages with all emitters off before and after it.
Since an off phase follows every emitter's turn, two consecutive emitters share one. Their readings at the same receiver
are therefore correlated.

Public names: `circuits_of` and `network_signals`.
"""

from collections.abc import Sequence

import numpy as np

from solen.arrays import FloatArray
from solen.readout import Circuit, circuit_of, face_areas_mm2, noise, volts
from solen.readout.readings import difference_sd_V
from solen.results import Result
from solen.sensor.acceptance import Acceptance
from solen.sensor.network.response import in_turn
from solen.sensor.readings import angle_rays
from solen.spec import Design

SHARED_OFF = 0.25
"""Covariance of two emitters' readings that share an off reading, in units of the squared off noise: each contains
half of it.
"""


class Signals(Result):
    """Voltages of a network's receivers with the emitters lit in turn, and their noise, by state, emitter and receiver.

    Attributes
    ----------
    emitters, receivers
        Names of the emitters and receivers.
    received
        Fractions (states, emitters, receivers) of the emitted power that receivers convert to current.
    voltage_V, u_voltage_V, off_V
        Voltages (states, emitters, receivers) with an emitter on and their uncertainty due to the traced powers; and
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
        """Return the covariance (emitters·receivers, emitters·receivers) of the readings in one state, in V²."""
        sd = self.sd_V[state]
        count, receivers = sd.shape
        found = np.diag(sd.ravel() ** 2)
        first = np.arange((count - 1) * receivers)
        shared = SHARED_OFF * np.tile(self.sd_off_V**2, count - 1)
        found[first, first + receivers] = found[first + receivers, first] = shared
        return found


def circuits_of(design: Design) -> tuple[Circuit, ...]:
    """Return each emitter's circuit with typical parts; raises the errors of `solen.readout.circuit_of`."""
    sensors = in_turn(design)
    areas = face_areas_mm2(design, sensors[0].body())
    named = {receiver.name: areas[receiver.name] for receiver in design.network.receivers}
    return tuple(circuit_of(sensor.design, named) for sensor in sensors)


def received_by(designs: Sequence[Design], power: FloatArray) -> FloatArray:
    """Return fractions (states, emitters, receivers) converted to current, from powers of designs at rest."""
    power = np.maximum(power, 0.0)
    names = [receiver.name for receiver in designs[0].network.receivers]
    sensors = [in_turn(design) for design in designs]
    if all(Acceptance.of(sensor).is_flat for sensor in sensors[0]):
        return power
    rows = [
        [Acceptance.of(sensor).factors(sensor.scene(rays=angle_rays(sensor)), names) for sensor in row]
        for row in sensors
    ]
    return np.asarray(power * rows)


def network_signals(designs: Sequence[Design], power: FloatArray, u_power: FloatArray) -> Signals:
    """Return voltages and noise of a network in several states.

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
    stated = designs[0].readout
    ambient, warm = stated.ambient_mw_cm2, stated.temperature_c
    each = [(circuit, received[:, i]) for i, circuit in enumerate(circuits)]
    dark = np.zeros(len(circuits[0].names))
    slope = np.stack([one.slope_V(shares, ambient, warm) for one, shares in each], axis=1)
    sd_off = noise(circuits[0], dark, ambient, warm).reading_V
    return Signals(
        emitters=tuple(emitter.name for emitter in designs[0].network.emitters),
        receivers=circuits[0].names,
        received=received,
        voltage_V=np.stack([volts(shares, one, ambient, warm) for one, shares in each], axis=1),
        u_voltage_V=u_power * np.abs(slope),
        off_V=volts(dark, circuits[0], ambient, warm),
        sd_V=difference_sd_V(np.stack([noise(*one, ambient, warm).reading_V for one in each], axis=1), sd_off),
        sd_off_V=sd_off,
        slope_V=slope,
    )
