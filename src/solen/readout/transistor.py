"""A phototransistor with its load resistor: irradiance to current, current to voltage.

Light generates a photocurrent I. The collector current equals I while the voltage V across the transistor is
sufficient, and is lower below a knee: I_C = I (1 − exp(−(V − V_s)/V_k)), with the saturation voltage V_s and the knee
width V_k. Together with V = V_supply − R I_C, this has a closed form with the Wright omega function, ω(z) + ln ω(z) =
z:

    y = (V − V_s)/V_k = a − b + ω(ln b + b − a),    a = (V_supply − V_s)/V_k,    b = R I/V_k.

Far above the knee, V = V_supply − R I; in bright light, V approaches V_s. V always falls with increasing light.

Public names: `Phototransistor`, `LoadLine`, `load_line`, `spectral_response`, `exponent_of` and `angular_factor`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import wrightomega

from solen.arrays import FloatArray
from solen.parts import Light, ReceiverPart
from solen.readout.emitter import REFERENCE_C
from solen.results import Result

SATURATION_V, KNEE_V, GAIN, DARK_NA, DOUBLING_K = 0.15, 0.1, 300.0, 1.0, 8.0
RISE_US, RISE_US_PER_KOHM = 3.0, 15.0
"""Default values, typical of small silicon phototransistors."""
RISE_PER_TIME_CONSTANT = math.log(9.0)
"""Rise time from 10 to 90 %, in first-order time constants."""


@dataclass(frozen=True)
class Phototransistor:
    """A receiver, and its response to the light of an emitter.

    Attributes
    ----------
    name
        Part name.
    typical_uA, min_uA, max_uA
        Current at 1 mW/cm² of the datasheet's wavelength, 25 °C.
    response
        Sensitivity to the emitter's light relative to the sensitivity at the datasheet's wavelength.
    exponent
        Exponent m of the response cos^m to a beam; 1 for a flat window, where the current depends only on the power
        through the window.
    saturation_V, knee_V
        Saturation voltage, and the width of the knee above it.
    gain
        Collector current per base photocurrent, which also amplifies the shot noise.
    dark_nA, dark_doubling_K
        Dark current at 25 °C, and the temperature rise that doubles it.
    rise_per_K
        Relative increase in sensitivity per K.
    rise_us, rise_us_per_kohm
        Rise time from 10 to 90 % with a small load, and its increase per kΩ.
    max_current_mA, max_supply_V
        Maximum current and voltage.
    """

    name: str
    typical_uA: float
    min_uA: float
    max_uA: float
    response: float = 1.0
    exponent: float = 1.0
    saturation_V: float = SATURATION_V
    knee_V: float = KNEE_V
    gain: float = GAIN
    dark_nA: float = DARK_NA
    dark_doubling_K: float = DOUBLING_K
    rise_per_K: float = 0.0
    rise_us: float = RISE_US
    rise_us_per_kohm: float = RISE_US_PER_KOHM
    max_current_mA: float = math.inf
    max_supply_V: float = math.inf

    @classmethod
    def of(cls, part: ReceiverPart, light: Light) -> "Phototransistor":
        """Return the phototransistor of a part file, with its response to the light of a design."""
        current = part.current_ua_per_mw_cm2
        values = {
            "saturation_V": part.saturation_v,
            "knee_V": part.knee_v,
            "gain": part.gain,
            "dark_nA": part.dark_na,
            "dark_doubling_K": part.dark_doubling_k,
            "rise_us": part.rise_us,
            "rise_us_per_kohm": part.rise_us_per_kohm,
            "max_current_mA": part.max_current_ma,
            "max_supply_V": part.max_supply_v,
        }
        return cls(
            name=part.name,
            typical_uA=current.nominal,
            min_uA=current.min or current.nominal,
            max_uA=current.max or current.nominal,
            response=spectral_response(part, light.spectrum or ((light.wavelength_nm, 1.0),)),
            exponent=exponent_of(part),
            rise_per_K=0.0 if part.rise_percent_per_k is None else 0.01 * part.rise_percent_per_k.nominal,
            **{name: value.nominal for name, value in values.items() if value is not None},
        )

    def dark_mA(self, temperature_C: float | FloatArray) -> FloatArray:
        """Return the dark current, which doubles for each rise in temperature by ``dark_doubling_K``."""
        rise_K = np.asarray(temperature_C, dtype=float) - REFERENCE_C
        return np.asarray(1e-6 * self.dark_nA * np.exp2(rise_K / self.dark_doubling_K))

    def current_mA(
        self, irradiance_mW_cm2: FloatArray, sensitivity_uA: float | FloatArray, temperature_C: float | FloatArray
    ) -> FloatArray:
        """Return the photocurrent, including dark current, of parts with a given sensitivity; arrays broadcast."""
        rise_K = np.asarray(temperature_C, dtype=float) - REFERENCE_C
        per_mW_cm2 = 1e-3 * np.asarray(sensitivity_uA) * np.maximum(1.0 + self.rise_per_K * rise_K, 0.0)
        return np.asarray(irradiance_mW_cm2 * per_mW_cm2 + self.dark_mA(temperature_C))

    def time_constant_us(self, load_ohm: float | FloatArray) -> FloatArray:
        """Return the first-order time constant: the rise time of receiver and load, divided by ln 9."""
        load_us = 1e-3 * np.asarray(load_ohm, dtype=float) * self.rise_us_per_kohm
        return np.asarray(np.hypot(self.rise_us, load_us) / RISE_PER_TIME_CONSTANT)


class LoadLine(Result):
    """Operating points of a phototransistor with a load, in the shape to which currents and loads broadcast.

    Attributes
    ----------
    volts
        Collector voltage.
    collector_mA
        Collector current.
    output_ohm
        Voltage drop per ampere of a small additional current into the collector node: the load, or less in saturation.
    drive_ohm
        Voltage drop per ampere of a small change in photocurrent.
    """

    volts: FloatArray
    collector_mA: FloatArray
    output_ohm: FloatArray
    drive_ohm: FloatArray


def load_line(
    current_mA: FloatArray,
    load_ohm: float | FloatArray,
    supply_V: float,
    saturation_V: float = SATURATION_V,
    knee_V: float = KNEE_V,
) -> LoadLine:
    """Return the operating points for photocurrents.

    Parameters
    ----------
    current_mA, load_ohm
        Arrays that broadcast; currents must be at least 0.
    supply_V, saturation_V, knee_V
        Supply voltage, saturation voltage and knee width.

    Returns
    -------
    LoadLine
        Voltages from ``saturation_V`` to ``supply_V``.
    """
    load = np.asarray(load_ohm, dtype=float)
    a = (supply_V - saturation_V) / knee_V
    b = 1e-3 * np.asarray(current_mA, dtype=float) * load / knee_V
    with np.errstate(divide="ignore"):
        log_b = np.log(b)
    omega = wrightomega(log_b + b - a)
    y = np.asarray(a - b + omega)
    if (saturated := b >= a).any():  # equivalent formula: the one above loses digits in deep saturation
        y[saturated] = log_b[saturated] - np.log(omega[saturated])
    fraction = -np.expm1(-y)
    stiffness = 1.0 + b * (1.0 - fraction)
    output = np.broadcast_to(load, y.shape) / stiffness
    return LoadLine(
        volts=np.minimum(saturation_V + knee_V * y, supply_V),
        collector_mA=np.asarray(current_mA * fraction),
        output_ohm=np.asarray(output),
        drive_ohm=np.asarray(output * fraction),
    )


def spectral_response(part: ReceiverPart, lines: Sequence[tuple[float, float]]) -> float:
    """Return the sensitivity to lines (nm, weight) relative to that at the datasheet's wavelength, or 1 if unknown."""
    if part.spectrum is None:
        return 1.0
    nm, relative = np.array(part.spectrum.wavelength_nm), np.array(part.spectrum.relative)
    line_nm, weights = np.array([line[0] for line in lines]), np.array([line[1] for line in lines])
    response = float(np.interp(line_nm, nm, relative) @ weights / weights.sum())
    reference_nm = nm[int(np.argmax(relative))] if part.sensitivity_nm is None else part.sensitivity_nm.nominal
    return response / float(np.interp(reference_nm, nm, relative))


def exponent_of(part: ReceiverPart) -> float:
    """Return the exponent m of the response cos^m θ to a beam, from the half angle; 1, a flat window, by default."""
    half = part.half_angle_deg
    if half is None or not 0.0 < half.nominal < 90.0:
        return 1.0
    return math.log(0.5) / math.log(math.cos(math.radians(half.nominal)))


def angular_factor(exponent: float, angle_deg: FloatArray, power: FloatArray) -> FloatArray:
    """Return the fraction of the power through a face that a receiver with the response cos^m detects.

    Power through a face already includes cos θ, so a beam is weighted by cos^(m−1) θ; for a flat window, m is 1 and all
    beams have the same weight.

    Parameters
    ----------
    exponent
        Exponent m.
    angle_deg
        Angles of incidence (bins,) at the receiver's window.
    power
        Power by angle (..., bins).

    Returns
    -------
    array (...)
        Detected fraction; 1 if no light arrives.
    """
    cosine = np.clip(np.cos(np.radians(angle_deg)), 1e-6, 1.0)
    total = power.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(total > 0.0, (power @ cosine ** (exponent - 1.0)) / total, 1.0))
