"""Voltages of a network over the range of each of its motions, with noise, resolution and load advice.

The other motions are at rest and assumed to be known; `solen.sensor.network.motions` covers the case that all motions
are unknown. If the slope does not exceed the uncertainty of the simulated light, there is no resolution.

Public names: `network_volts`, `NetworkVolts` and `MotionVolts`.
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
from solen.sensor.network.motions import MIN_SIGNIFICANCE
from solen.sensor.network.response import (
    DEFAULT_TOLERANCE,
    NetworkResponse,
    emitter_sensors,
    network_response,
    warnings_of,
)
from solen.sensor.network.signals import Signals, circuits_of, network_signals
from solen.sensor.network.study import motion_states
from solen.sensor.readings import PartUsed, parts_used
from solen.spec import Design
from solen.spec.placed import state_of


class MotionVolts(Result):
    """Voltages over the range of one motion for A angles, E emitters lit in turn and R receivers.

    Attributes
    ----------
    angle_deg
        Angles (A,) in ascending order.
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
        Circuit of each emitter, with typical parts, in the order of the emitters of ``at_rest``.
    at_rest
        Voltages and noise with the motions at rest, as one state.
    by_motion
        Voltages and noise over each motion, keyed by its name.
    advice
        Advice on the load, from all states.
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
        states = [self.at_rest, *(motion.signals for motion in self.by_motion.values())]
        lows, highs = zip(*((signals.voltage_V.min(), signals.voltage_V.max()) for signals in states), strict=True)
        return float(min(lows)), float(max(highs))


def network_volts(
    design: Design, progress: Progress | None = None, tolerance: float = DEFAULT_TOLERANCE
) -> NetworkVolts:
    """Return the voltages of a network over its motions; raise the errors of `network_response` and `circuits_of`."""
    sensors, circuits = emitter_sensors(design), circuits_of(design)
    states, indices_of = motion_states(design.network)
    response = network_response(design, states, tolerance, progress)
    signals = network_signals([state_of(design, state) for state in states], response.power, response.u_power)
    by_motion = {
        name: _motion_volts(name, _subset(signals, indices), response, indices) for name, indices in indices_of.items()
    }
    advice = advise(
        circuits[0],
        _as_first_emitter(circuits, signals.received),
        trimmer_part(design),
        design.readout.ambient_mw_cm2,
        design.readout.temperature_c,
    )
    in_space, dark_V = design.trace.dimension == "extruded", float(signals.off_V.max())
    circuit_cautions = [
        text
        for sensor, circuit in zip(sensors, circuits, strict=True)
        for text in cautions(
            circuit, advice, sensor.light.wavelength_nm, dark_V, in_space=in_space, emitters=len(circuits)
        )
    ]
    coarse = [f"{name}: {text}" for name, motion in by_motion.items() for text in _coarse_step_warnings(motion)]
    return NetworkVolts(
        name=design.name,
        circuits=circuits,
        at_rest=_subset(signals, [0]),
        by_motion=by_motion,
        advice=advice,
        temperature_C=design.readout.temperature_c,
        ambient_mW_per_cm2=design.readout.ambient_mw_cm2,
        parts=parts_used(*(sensor.design for sensor in sensors)),
        warnings=tuple(dict.fromkeys((*warnings_of(sensors, "power"), *circuit_cautions, *coarse))),
    )


def _motion_volts(name: str, signals: Signals, response: NetworkResponse, indices: list[int]) -> MotionVolts:
    """Return the voltages over one motion, with the resolution of that motion."""
    angle = response.angle_deg[indices, response.motions.index(name)]
    differences = slopes_V_per_deg(angle, np.eye(len(angle)))  # the slopes are linear in the voltages
    slope = np.tensordot(differences, signals.voltage_V, 1)
    u_slope = np.sqrt(np.tensordot(differences**2, signals.u_voltage_V**2, 1))
    shape = (len(angle), -1)
    resolutions = [_resolution_deg(slope[:, i], u_slope[:, i], _inverses(signals, i)) for i in range(slope.shape[1])]
    return MotionVolts(
        angle_deg=angle,
        signals=signals,
        slope_V_per_deg=slope,
        u_slope_V_per_deg=u_slope,
        resolution_deg=np.stack(resolutions, axis=1),
        resolution_of_all_deg=_resolution_deg(slope.reshape(shape), u_slope.reshape(shape), _inverses(signals)),
    )


def _inverses(signals: Signals, emitter: int | None = None) -> FloatArray:
    """Return the inverse covariances (A, N, N) of the readings of one emitter, by default of all emitters."""
    covariances = np.array([signals.covariance_V2(state) for state in range(len(signals.sd_V))])
    if emitter is not None:
        rows = slice(emitter * len(signals.receivers), (emitter + 1) * len(signals.receivers))
        covariances = covariances[:, rows, rows]
    return np.asarray(np.linalg.inv(covariances))


def _resolution_deg(slope: FloatArray, u_slope: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the standard deviation (A,) of an angle from readings (A, N) with an inverse covariance (A, N, N)."""
    information = np.einsum("an,anm,am->a", slope, inverse, slope)
    u_squared = np.einsum("an,ann->a", u_slope**2, inverse)
    is_known = information > MIN_SIGNIFICANCE**2 * u_squared
    return np.where(is_known, 1.0 / np.sqrt(np.where(is_known, information, 1.0)), np.nan)


def _subset(signals: Signals, indices: list[int]) -> Signals:
    """Return signals in a subset of their states."""
    arrays = ("received", "voltage_V", "u_voltage_V", "sd_V", "slope_V")
    return replace(signals, **{name: getattr(signals, name)[indices] for name in arrays})


def _as_first_emitter(circuits: tuple[Circuit, ...], received: FloatArray) -> FloatArray:
    """Return all received powers (states·emitters, receivers) as fractions of the first emitter's power."""
    relative_power = np.array([circuit.drive.typical_mW / circuits[0].drive.typical_mW for circuit in circuits])
    return np.asarray((received * relative_power[:, None]).reshape(-1, received.shape[-1]))


def _coarse_step_warnings(motion: MotionVolts) -> Iterator[str]:
    volts = motion.signals.voltage_V.reshape(len(motion.angle_deg), -1)
    return coarse_step_warnings(motion.angle_deg, volts, "use more steps for the motion")
