"""Rejection of ambient light by subtraction of the dark readings, in dB, for several kinds of ambient light.

A receiver in the circuit of the paper is read 200 times a second with its emitter on and off. Ambient light of
0.5 mW/cm² rises, flickers, or changes in a step. The residual of the ambient light after subtraction is compared with
its effect on the voltage: by the standard deviation over 20 s, or for a step by the largest value. The mains frequency
is 0.1 % too high, so that all phases occur.
"""

import numpy as np
from numpy.typing import NDArray

from solen.analysis.demodulation import averaged, slots_of, subtract
from solen.readout import circuit_of, volts
from solen.spec import loads, template

READINGS, RATE_HZ, POWER, AMBIENT_MW_PER_CM2 = 4000, 200.0, 0.2, 0.5
TIME_S = np.arange(2 * READINGS) / (2.0 * RATE_HZ)
STATE = np.tile([1, 0], READINGS)
CIRCUIT = circuit_of(loads(template("paper-860")), {"right": 12.0})
FLICKER_HZ = {"1 Hz": 1.0, "50 Hz": 50.05, "100 Hz": 100.1, "120 Hz": 120.12}


def light(name: str) -> NDArray[np.float64]:
    """Return the ambient light of a kind over time, from 0 to 1."""
    if name in FLICKER_HZ:
        return np.asarray(0.5 + 0.5 * np.cos(2 * np.pi * FLICKER_HZ[name] * TIME_S))
    step = (TIME_S > 5.00125) & (TIME_S < 7.00375)
    return np.asarray(TIME_S / 20.0 if name == "ramp" else np.where(step, 1.0, 0.0))


def rejections(name: str) -> list[float]:
    """Return the rejection of one-sided, two-sided, and averaged two-sided subtraction, in dB, at most 160 dB.

    The averages are over four readings: a period of 50 Hz.
    """
    power = POWER * STATE[:, None].astype(float)
    read, dark = volts(power, CIRCUIT, AMBIENT_MW_PER_CM2 * light(name)), volts(power, CIRCUIT)
    slots, truth = slots_of(TIME_S, read, STATE), float(dark[0, 0] - dark[1, 0])
    two_sided = subtract(slots)
    signals = (subtract(slots, "one-sided"), two_sided, averaged(two_sided, slots, 4))
    size = np.ptp if name == "step" else lambda values: np.sqrt(np.mean(values**2))
    effect = float(size((read - dark)[:, 0] - (name != "step") * np.mean((read - dark)[:, 0])))
    residuals = [float(size(signal.signal[1:-1, 0] - truth)) for signal in signals]
    return [20.0 * np.log10(effect / max(residual, 1e-8 * effect)) for residual in residuals]


def main() -> dict[str, list[float]]:
    """Return the rejections, keyed by kind of light."""
    results = {name: rejections(name) for name in ("ramp", *FLICKER_HZ, "step")}
    print("rejection in dB   one-sided  two-sided  mean of 4")
    for name, row in results.items():
        print(f"{name:16}" + "".join(f" {value:10.1f}" for value in row))
    return results


if __name__ == "__main__":
    main()
