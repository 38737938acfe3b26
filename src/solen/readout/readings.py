"""Readings over a motion: voltages for typical and extreme parts, noise, slopes, resolution and load advice.

Public name: `readings_of`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from solen.arrays import FloatArray
from solen.parts import TrimmerPart
from solen.readout.advice import Advice, advise, slopes_V_per_deg
from solen.readout.circuit import Case, Circuit, cases_of
from solen.readout.emitter import REFERENCE_C
from solen.readout.noise import Noise, noise
from solen.results import Result, reported

MAX_STEP_FRACTION = 0.25
"""Largest change of a reading from angle to angle, as a fraction of its range, that causes no warning."""


@dataclass(frozen=True)
class VoltageRange:
    """Range of the voltages over a motion.

    Attributes
    ----------
    lowest_V, highest_V
        Voltages with typical parts.
    used_of_supply
        Fraction of the supply voltage between them.
    best_resolution_deg, worst_resolution_deg
        Best and worst resolution from one reading of all receivers; None if no voltage changes.
    """

    lowest_V: float
    highest_V: float
    used_of_supply: float
    best_resolution_deg: float | None
    worst_resolution_deg: float | None


class Readings(Result):
    """Readings of R receivers at A angles; arrays (A, R) in the order of the circuit's receivers.

    Attributes
    ----------
    circuit
        Circuit with typical parts.
    angle_deg
        Angles (A,) in ascending order.
    power_fraction, u_power
        Fraction of the emitted power (A, R), and its uncertainty (A,).
    voltage_by_case_V
        Voltages with the emitter on, for the dimmest, typical and brightest parts.
    off_V
        Voltages with the emitter off.
    noise
        Noise with the emitter on.
    sd_V
        Noise of an "on" reading after subtraction of ambient light.
    slope_V_per_deg
        Slope of the voltages with typical parts.
    resolution_deg, resolution_of_all_deg
        Standard deviation of an angle from one reading of each receiver, and of all combined (A,); NaN where the
        voltages do not change.
    drift_V_per_K
        Temperature coefficient of the voltages with typical parts.
    advice
        Advice on the load.
    irradiance_mW_per_cm2
        Mean irradiance of the receiver faces due to the emitter (A, R).
    u_trace_V
        Uncertainty of the voltages due to that of the traced power (A, R).
    """

    circuit: Circuit
    angle_deg: FloatArray
    power_fraction: FloatArray
    u_power: FloatArray
    voltage_by_case_V: Mapping[Case, FloatArray]
    off_V: FloatArray
    noise: Noise
    sd_V: FloatArray
    slope_V_per_deg: FloatArray
    resolution_deg: FloatArray
    resolution_of_all_deg: FloatArray
    drift_V_per_K: FloatArray
    advice: Advice
    irradiance_mW_per_cm2: FloatArray
    u_trace_V: FloatArray

    @reported
    def voltage_V(self) -> FloatArray:
        """Voltages with typical parts (A, R)."""
        return self.voltage_by_case_V["typical"]

    @reported
    def contrast(self) -> FloatArray:
        """Contrast (R − L)/(R + L) of the voltage drops caused by the emitter's light, (A,); NaN without a drop."""
        drop = self.off_V - self.voltage_V
        right, left = (drop[:, self.circuit.names.index(name)] for name in ("right", "left"))
        total = right + left
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(np.where(total > 0.0, (right - left) / total, np.nan))

    @reported
    def range(self) -> VoltageRange:
        """Lowest and highest voltage, and the resolution."""
        low, high = float(self.voltage_V.min()), float(self.voltage_V.max())
        finite = self.resolution_of_all_deg[np.isfinite(self.resolution_of_all_deg)]
        ends = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        return VoltageRange(low, high, (high - low) / self.circuit.supply_V, *ends)

    def coarse_step_warnings(self) -> Iterator[str]:
        """Yield a warning if the angles are too far apart to determine slopes."""
        yield from coarse_step_warnings(self.angle_deg, self.voltage_V, "use a smaller motion.step_deg")


def coarse_step_warnings(angle_deg: FloatArray, volts: FloatArray, remedy: str) -> Iterator[str]:
    """Yield a warning if angles (A,) are too far apart to determine the slopes of voltages (A, R)."""
    if len(angle_deg) < 2:
        yield "a single angle gives no slope, and therefore no resolution"
        return
    steps, full_range = np.abs(np.diff(volts, axis=0)), float(np.ptp(volts))
    if full_range > 0.0 and steps.max() > MAX_STEP_FRACTION * full_range:
        row = int(np.argmax(steps.max(axis=1)))
        yield (
            f"a reading changes by {steps.max():.2f} V from {angle_deg[row]:g} to {angle_deg[row + 1]:g} deg, "
            f"{100 * steps.max() / full_range:.0f} % of its range: slopes and resolution in between are means over "
            f"the step; {remedy}"
        )


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
    """Return the readings at the angles of a motion.

    Parameters
    ----------
    circuit
        Circuit with typical parts, for R receivers.
    angle_deg, power_fraction, u_power
        Angles (A,), fractions (A, R) and their uncertainties (A,).
    trimmer
        The trimmer that sets the loads.
    ambient_mW_cm2, temperature_C
        Equivalent irradiance of the ambient light, and temperature: a single number, or one for each angle or reading.
    """
    light = (ambient_mW_cm2, temperature_C)
    dark = np.zeros_like(power_fraction)
    on, off = (noise(circuit, fractions, *light) for fractions in (power_fraction, dark))
    cases = {case: _volts(parts, power_fraction, *light) for case, parts in cases_of(circuit).items()}
    sd = difference_sd_V(on.reading_V, off.reading_V)
    slope = slopes_V_per_deg(angle_deg, cases["typical"])
    each, combined = resolution_deg(slope, sd)
    warm, cold = (_volts(circuit, power_fraction, ambient_mW_cm2, temperature_C + step) for step in (0.5, -0.5))
    return Readings(
        circuit=circuit,
        angle_deg=angle_deg,
        power_fraction=power_fraction,
        u_power=u_power,
        voltage_by_case_V=cases,
        off_V=_volts(circuit, dark, *light),
        noise=on,
        sd_V=sd,
        slope_V_per_deg=slope,
        resolution_deg=each,
        resolution_of_all_deg=combined,
        drift_V_per_K=warm - cold,
        advice=advise(circuit, power_fraction, trimmer, *light),
        irradiance_mW_per_cm2=circuit.irradiance_mW_cm2(power_fraction, temperature_C),
        u_trace_V=np.asarray(u_power[:, None] * np.abs(circuit.slope_V(power_fraction, *light))),
    )


def _volts(circuit: Circuit, fractions: FloatArray, ambient_mW_cm2: float, temperature_C: float) -> FloatArray:
    return circuit.load_line(circuit.current_mA(fractions, ambient_mW_cm2, temperature_C)).volts


def resolution_deg(slope_V_per_deg: FloatArray, sd_V: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the standard deviation of an angle from one reading of each receiver, (A, R), and of all combined, (A,).

    A single receiver determines the angle to σ/|slope|, and all combined to (Σ (slope/σ)²)^−1/2, the Cramér-Rao bound.
    NaN where the voltages do not change.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        each = np.where(slope_V_per_deg != 0.0, sd_V / np.abs(slope_V_per_deg), np.nan)
        information = ((slope_V_per_deg / sd_V) ** 2).sum(axis=-1)
        combined = np.where(information > 0.0, 1.0 / np.sqrt(information), np.nan)
    return np.asarray(each), np.asarray(combined)


def difference_sd_V(on_V: FloatArray, off_V: FloatArray) -> FloatArray:
    """Return the noise of an "on" reading minus the mean of the "off" readings before and after it."""
    return np.asarray(np.sqrt(on_V**2 + 0.5 * off_V**2))
