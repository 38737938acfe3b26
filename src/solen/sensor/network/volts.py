"""Voltages of a network over the range of each of its motions, with noise, resolution and recommended load resistors.

The other motions are at rest and assumed to be known; `solen.sensor.network.motions` evaluates the case that all
motions are unknown. A slope that does not exceed the uncertainty of the simulated light gives no resolution.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.progress import Progress
from solen.readout import advise
from solen.readout.advice import Advice, slopes_V_per_deg
from solen.readout.cautions import cautions
from solen.readout.circuit import Circuit, trimmer_part
from solen.readout.readings import coarse_step_warnings
from solen.recording import Provenance
from solen.results import Result, reported
from solen.sensor.network.motions import SURE
from solen.sensor.network.response import USUAL_TOLERANCE, NetworkResponse, in_turn, network_response, warnings_of
from solen.sensor.network.signals import Signals, circuits_of, network_signals
from solen.sensor.network.study import courses
from solen.sensor.readings import PartUsed, parts_used
from solen.spec import Design
from solen.spec.placed import state_of


class MotionVolts(Result):
    """Voltages over the range of one motion for A angles, E emitters lit in turn and R receivers.

    Attributes
    ----------
    angle_deg
        Angles (A,), ascending.
    signals
        Voltages and their noise (A, E, R).
    slope_V_per_deg, u_slope_V_per_deg
        Slope (A, E, R) of the voltages, and its uncertainty.
    resolution_deg, resolution_of_all_deg
        Standard deviation of the angle from one reading of every receiver, for each emitter (A, E) and for all (A,);
        NaN if the voltages change by no more than the uncertainty of the simulated light.
    """

    angle_deg: FloatArray
    signals: Signals
    slope_V_per_deg: FloatArray
    u_slope_V_per_deg: FloatArray
    resolution_deg: FloatArray
    resolution_of_all_deg: FloatArray


class NetworkVolts(Result):
    """Voltages of a network with its motions at rest, and over the range of each of them.

    Attributes
    ----------
    name
        Name of the design.
    circuits
        Circuit of each emitter, with typical parts; the emitters' names are those of ``at_rest``.
    at_rest
        Voltages and noise with the motions at rest, as one state.
    by_motion
        Voltages and noise over each motion, by its name.
    advice
        Advice on the loads, from all states.
    temperature_C, ambient_mW_per_cm2
        Temperature and irradiance around the sensor.
    parts
        Components of the circuit.
    warnings
        Warnings about the numbers.
    simulated
        Always true: nothing was measured.
    sources
        Files that the numbers come from.
    """

    name: str
    circuits: tuple[Circuit, ...]
    at_rest: Signals
    by_motion: dict[str, MotionVolts]
    advice: Advice
    temperature_C: float
    ambient_mW_per_cm2: float
    parts: tuple[PartUsed, ...]
    warnings: tuple[str, ...]
    simulated: bool = True
    sources: tuple[Provenance, ...] = ()

    @reported
    def range_V(self) -> tuple[float, float]:
        """Lowest and highest voltage over all states, with typical parts."""
        every = [self.at_rest.voltage_V, *(one.signals.voltage_V for one in self.by_motion.values())]
        return min(float(one.min()) for one in every), max(float(one.max()) for one in every)


def network_volts(design: Design, progress: Progress | None = None, tolerance: float = USUAL_TOLERANCE) -> NetworkVolts:
    """Return voltages of a network over its motions; raises the errors of `network_response` and `circuits_of`."""
    sensors, circuits = in_turn(design), circuits_of(design)
    states, places = courses(design.network)
    response = network_response(design, states, tolerance, progress)
    every = network_signals([state_of(design, state) for state in states], response.power, response.u_power)
    by_motion = {name: _over(name, _of(every, where), response, where) for name, where in places.items()}
    advice = advise(
        circuits[0],
        _as_by_first(circuits, every.received),
        trimmer_part(design),
        design.readout.ambient_mw_cm2,
        design.readout.temperature_c,
    )
    in_space, dark_V = design.trace.dimension == "extruded", float(every.off_V.max())
    reasons = [
        text
        for sensor, circuit in zip(sensors, circuits, strict=True)
        for text in cautions(
            circuit, advice, sensor.light.wavelength_nm, dark_V, in_space=in_space, emitters=len(circuits)
        )
    ]
    coarse = [f"{name}: {text}" for name, one in by_motion.items() for text in _coarse(one)]
    return NetworkVolts(
        name=design.name,
        circuits=circuits,
        at_rest=_of(every, [0]),
        by_motion=by_motion,
        advice=advice,
        temperature_C=design.readout.temperature_c,
        ambient_mW_per_cm2=design.readout.ambient_mw_cm2,
        parts=parts_used(*(sensor.design for sensor in sensors)),
        warnings=tuple(dict.fromkeys((*warnings_of(sensors, "power"), *reasons, *coarse))),
    )


def _over(name: str, signals: Signals, response: NetworkResponse, places: list[int]) -> MotionVolts:
    """Return voltages over one motion, with the resolution of that motion."""
    angle = response.angle_deg[places, response.motions.index(name)]
    differences = slopes_V_per_deg(angle, np.eye(len(angle)))  # slopes are linear in the voltages
    slope = np.tensordot(differences, signals.voltage_V, 1)
    u_slope = np.sqrt(np.tensordot(differences**2, signals.u_voltage_V**2, 1))
    shape = (len(angle), -1)
    each = [_resolution_deg(slope[:, i], u_slope[:, i], _inverses(signals, i)) for i in range(slope.shape[1])]
    return MotionVolts(
        angle_deg=angle,
        signals=signals,
        slope_V_per_deg=slope,
        u_slope_V_per_deg=u_slope,
        resolution_deg=np.stack(each, axis=1),
        resolution_of_all_deg=_resolution_deg(slope.reshape(shape), u_slope.reshape(shape), _inverses(signals)),
    )


def _inverses(signals: Signals, emitter: int | None = None) -> FloatArray:
    """Return inverse covariances (A, N, N) of the readings of one emitter, or of all."""
    covariances = np.array([signals.covariance_V2(state) for state in range(len(signals.sd_V))])
    if emitter is not None:
        own = slice(emitter * len(signals.receivers), (emitter + 1) * len(signals.receivers))
        covariances = covariances[:, own, own]
    return np.asarray(np.linalg.inv(covariances))


def _resolution_deg(slope: FloatArray, u_slope: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the standard deviation (A,) of an angle from readings (A, N) with an inverse covariance (A, N, N)."""
    information = np.einsum("an,anm,am->a", slope, inverse, slope)
    u_squared = np.einsum("an,ann->a", u_slope**2, inverse)
    known = information > SURE**2 * u_squared
    return np.where(known, 1.0 / np.sqrt(np.where(known, information, 1.0)), np.nan)


def _of(signals: Signals, places: list[int]) -> Signals:
    """Return signals for a subset of their states."""
    own = ("received", "voltage_V", "u_voltage_V", "sd_V", "slope_V")
    return replace(signals, **{name: getattr(signals, name)[places] for name in own})


def _as_by_first(circuits: tuple[Circuit, ...], received: FloatArray) -> FloatArray:
    """Return fractions (states·emitters, receivers) of the first emitter's power equal to those of each emitter."""
    brightness = np.array([circuit.drive.typical_mW / circuits[0].drive.typical_mW for circuit in circuits])
    return np.asarray((received * brightness[:, None]).reshape(-1, received.shape[-1]))


def _coarse(one: MotionVolts) -> Iterator[str]:
    volts = one.signals.voltage_V.reshape(len(one.angle_deg), -1)
    return coarse_step_warnings(one.angle_deg, volts, "use more steps for the motion")
