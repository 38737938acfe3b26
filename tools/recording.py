"""Two sample recordings, both simulated: three prints with a lens and one without, and one of these on another day.

Each print is the shipped 860 nm design with a slightly different index and emitter position, traced angle by angle. The
received power is converted by the readout of the design (components, load, ADC, noise), and the stage performs the test
of the paper. The first lines of the files state that nothing was measured. ``python -m tools.samples`` writes the
files; they are determined by the seed.
"""

import io
from dataclasses import replace

import numpy as np

from solen.arrays import FloatArray
from solen.bench.simulated.sensors import ANGLES, interpolation, traced
from solen.readout import circuit_of, face_areas_mm2, volts
from solen.sensor import Sensor
from solen.spec import loads, template, with_values

SEED = 20
RATE_HZ, SPEED_DEG_PER_S, HOLD_S, AMPLITUDE_DEG, CYCLES, REST_S = 100.0, 15.0, 0.8, 3.0, 6, 0.5
PRINTS = {"S1": (0.0, 0.004), "S2": (0.003, -0.003), "S3": (-0.003, 0.001), "C": (0.0, 0.004)}
"""Errors of the index and of the emitter position (mm) of each print; C has no lens."""
CHIP_MM, ANGLE_NOISE_DEG, DRIFT = 0.2, 0.002, -0.002
"""Width of the chip, encoder noise, and relative change of the emitter power during the run."""
COMMENT = """\
# simulated: yes
# control: C
# design: solen-860, three prints with a lens (S1, S2, S3) and one without (C), traced
"""


def angle_of(time_s: FloatArray) -> FloatArray:
    """Return the angles in the test of the paper: to one side, hold, back, and the same on the other side."""
    ramp = AMPLITUDE_DEG / SPEED_DEG_PER_S
    durations = np.tile([ramp, HOLD_S, ramp, ramp, HOLD_S, ramp], CYCLES)
    corners = np.tile([1.0, 1.0, 0.0, -1.0, -1.0, 0.0], CYCLES) * AMPLITUDE_DEG
    return np.asarray(np.interp(time_s, REST_S + np.cumsum([0.0, *durations]), [0.0, *corners]))


def readings(name: str, angle_deg: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the voltages of the left and right receivers of a print, (n, 2)."""
    index, offset_mm = PRINTS[name]
    design = loads(template("paper-860"))
    end = 1.02 * AMPLITUDE_DEG
    values = {"emitter.width_mm": CHIP_MM, "emitter.offset_mm": offset_mm, "material.index": 1.44 + index}
    sweep = {"motion.from_deg": -end, "motion.to_deg": end, "motion.step_deg": 2.0 * end / (ANGLES - 1)}
    sensor = replace(Sensor.of(with_values(design, {**values, **sweep})), cut=Sensor.of(design).cut)
    sensor = sensor.without_lens if name == "C" else sensor
    traced_deg, fractions = traced(sensor, np.linspace(-end, end, ANGLES))
    areas = face_areas_mm2(sensor.design, sensor.body())
    circuit = circuit_of(sensor.design, {side: areas[side] for side in ("left", "right")})
    light = interpolation(traced_deg, fractions[:, ::-1])
    fading = 1.0 + DRIFT * np.linspace(0.0, 1.0, angle_deg.size)[:, None]
    return volts(light(angle_deg) * fading, circuit, rng=rng)


def recording() -> str:
    """Return the content of the recording."""
    rng = np.random.default_rng(SEED)
    end = 2.0 * REST_S + CYCLES * (4.0 * AMPLITUDE_DEG / SPEED_DEG_PER_S + 2.0 * HOLD_S)
    time_s = np.arange(0.0, end, 1.0 / RATE_HZ)
    angle = angle_of(time_s)
    return COMMENT + table(time_s, angle, list(PRINTS), rng)


def second_day() -> str:
    """Return the content of the second file: S1 alone, moved by hand, with the encoder for comparison."""
    time_s = np.arange(0.0, 12.0, 1.0 / RATE_HZ)
    angle = 1.7 * np.sin(2.0 * np.pi * 0.21 * time_s) + 0.8 * np.sin(2.0 * np.pi * 0.57 * time_s + 1.0)
    comment = "# simulated: yes\n# design: solen-860, the print S1 of rotation-simulated.csv on another day\n"
    return comment + table(time_s, angle, ["S1"], np.random.default_rng(SEED + 1))


def table(time_s: FloatArray, angle: FloatArray, prints: list[str], rng: np.random.Generator) -> str:
    """Return a table of time, angle and voltages of some prints."""
    columns = np.column_stack([readings(name, angle, rng) for name in prints])
    encoder_deg = angle + ANGLE_NOISE_DEG * rng.standard_normal(angle.size)
    text = io.StringIO()
    names = [f"{name}.{side} (V)" for name in prints for side in ("left", "right")]
    formats = ["%.2f", "%.3f", *["%.4f"] * len(names)]
    rows = np.column_stack([time_s, encoder_deg, columns])
    np.savetxt(text, rows, fmt=formats, delimiter=",", header=",".join(["time_s", "angle_deg", *names]), comments="")
    return text.getvalue().replace("-0.000,", "0.000,")
