"""What the receivers read at the angles of a motion: volts of all sets of parts, noise, slopes, resolution, advice.

The interface: `readings_of` a circuit and the power fractions of a motion.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.parts import TrimmerPart
from solen.readout.advice import Advice, advise, slopes_V_per_deg
from solen.readout.cautions import of_a_difference_V, resolution_deg
from solen.readout.circuit import Case, Circuit, spread
from solen.readout.emitter import REFERENCE_C
from solen.readout.noise import Noise, noise


@dataclass(frozen=True)
class Readings:
    """What R receivers read at A angles; arrays (A, R) in the order of the circuit's receivers.

    Attributes
    ----------
    circuit
        With typical parts.
    angle_deg
        Shape (A,), ascending.
    power_fraction, u_power
        Of the emitted power (A, R), and what a trace may be off by (A,).
    cases
        Volts with the emitter on, of the dimmest, typical and brightest parts.
    off_V
        Volts with the emitter off.
    noise
        Of one sample with the emitter on.
    sd_V
        Noise of an on reading less its ambient light.
    slope_V_per_deg
        Change of typical volts.
    resolution_deg, both_deg
        Standard deviation of an angle told from one such reading of each receiver, and of all together (A,); NaN where
        nothing moves.
    drift_V_per_K
        Change of typical volts by temperature.
    advice
        On the loads.
    """

    circuit: Circuit
    angle_deg: FloatArray
    power_fraction: FloatArray
    u_power: FloatArray
    cases: Mapping[Case, FloatArray]
    off_V: FloatArray
    noise: Noise
    sd_V: FloatArray
    slope_V_per_deg: FloatArray
    resolution_deg: FloatArray
    both_deg: FloatArray
    drift_V_per_K: FloatArray
    advice: Advice

    @property
    def volts(self) -> FloatArray:
        """Of typical parts."""
        return self.cases["typical"]

    @property
    def contrast(self) -> FloatArray:
        """(R − L)/(R + L) of what the emitter's light pulls the receivers down by, (A,); NaN where it does nothing."""
        drop = self.off_V - self.volts
        right, left = (drop[:, self.circuit.names.index(name)] for name in ("right", "left"))
        total = right + left
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0.0, (right - left) / total, np.nan))

    @property
    def u_trace_V(self) -> FloatArray:
        """What the trace's own uncertainty makes of the volts."""
        circuit = self.circuit
        one = circuit.transistor.response * circuit.irradiance_mW_cm2(np.ones_like(self.power_fraction))
        asked_A = 1e-6 * np.array(circuit.sensitivity_uA) * one
        drive_ohm = circuit.load_line(circuit.current_mA(self.power_fraction)).drive_ohm
        return np.asarray(self.u_power[:, None] * asked_A * drive_ohm)


def readings_of(
    circuit: Circuit,
    angle_deg: FloatArray,
    power_fraction: FloatArray,
    u_power: FloatArray,
    trimmer: TrimmerPart,
    *,
    ambient_mW_cm2: float = 0.0,
    temperature_C: float = REFERENCE_C,
) -> Readings:
    """Readings at the angles of a motion.

    Parameters
    ----------
    circuit
        With typical parts, of R receivers.
    angle_deg, power_fraction, u_power
        Shapes (A,), (A, R), (A,).
    trimmer
        What the loads are set with.
    ambient_mW_cm2, temperature_C
        As in `Circuit.current_mA`.
    """
    light = (ambient_mW_cm2, temperature_C)
    dark = np.zeros_like(power_fraction)
    on, off = (noise(circuit, shares, *light) for shares in (power_fraction, dark))
    cases = {case: _volts(one, power_fraction, *light) for case, one in spread(circuit).items()}
    sd = of_a_difference_V(on.reading_V, off.reading_V)
    slope = slopes_V_per_deg(angle_deg, cases["typical"])
    each, both = resolution_deg(slope, sd)
    warm, cold = (_volts(circuit, power_fraction, ambient_mW_cm2, temperature_C + step) for step in (0.5, -0.5))
    return Readings(
        circuit=circuit,
        angle_deg=angle_deg,
        power_fraction=power_fraction,
        u_power=u_power,
        cases=cases,
        off_V=_volts(circuit, dark, *light),
        noise=on,
        sd_V=sd,
        slope_V_per_deg=slope,
        resolution_deg=each,
        both_deg=both,
        drift_V_per_K=warm - cold,
        advice=advise(circuit, power_fraction, trimmer, *light),
    )


def _volts(circuit: Circuit, fractions: FloatArray, ambient_mW_cm2: float, temperature_C: float) -> FloatArray:
    return circuit.load_line(circuit.current_mA(fractions, ambient_mW_cm2, temperature_C)).volts
