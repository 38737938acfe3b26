"""Decoded readings per second, compared with the rate of a bench, and the time of a single reading.

Run with ``python benchmarks/decoding.py``. Everything is timed in one run, so the ratios hold on any machine; each
figure is the best of several runs. The sensor is synthetic, with five cycles and 10 mV of noise.
"""

import os
import platform
import time
from collections.abc import Callable
from functools import partial

import numpy as np

import solen
from solen.analysis import AnalysisOptions, Signals, sensor_response
from solen.analysis.calibration import Decoder, calibrated, leave_one_cycle_out, training_of
from solen.analysis.calibration.posterior import posterior
from solen.arrays import FloatArray

RATE_HZ, READINGS, REPEATS = 200.0, 20_000, 5


def best_s(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest CPU time of several runs, s."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def decode_singly(decoder: Decoder, volts: FloatArray) -> None:
    """Decode readings one by one, as in a live stream."""
    for row in volts:
        decoder.decode(row[None, :])


def recording(noise_V: float) -> Signals:
    """Return six cycles of ±3° at 15°/s with holds, as saturating voltages."""
    rng = np.random.default_rng(1)
    corners = np.cumsum([0.0, 0.2, 0.8, 0.4, 0.8, 0.2])
    time_s = np.arange(0.0, 6 * corners[-1] + 2.0, 1.0 / RATE_HZ)
    in_cycle = np.where((time_s > 1.0) & (time_s < 1.0 + 6 * corners[-1]), (time_s - 1.0) % corners[-1], 0.0)
    angle = np.interp(in_cycle, corners, [0.0, -3.0, -3.0, 3.0, 3.0, 0.0])
    volts = 2.0 + np.tanh(angle / 2.0)[:, None] * np.array([-1.0, 1.0])
    volts = volts + noise_V * rng.standard_normal((time_s.size, 2))
    return Signals("one", ("left", "right"), time_s, angle, volts)


def main() -> None:
    """Print the table."""
    print(
        f"solen {solen.__version__}, numpy {np.__version__}, Python {platform.python_version()}, {os.cpu_count()} cores"
    )
    print(f"{'method':44} {'readings/s':>12} {'of 200 Hz':>10}")
    for noise_V in (0.01, 0.0005):
        training = training_of(sensor_response([recording(noise_V)], AnalysisOptions()))
        calibration = calibrated(training)
        decoder = Decoder(calibration)
        volts = np.resize(training.samples.volts, (READINGS, 2))
        decoder.decode(volts[:10])
        grid = np.linspace(calibration.angle_deg[0], calibration.angle_deg[-1], 2001)
        direct = 1.0 / best_s(partial(posterior, calibration, volts[0], grid), 2)
        array = READINGS / best_s(partial(decoder.decode, volts))
        single_s = best_s(partial(decode_singly, decoder, volts[:100])) / 100
        validation_s = best_s(partial(leave_one_cycle_out, training), 1)
        for method, rate in (
            ("directly on a grid", direct),
            ("many at once", array),
            ("one at a time", 1.0 / single_s),
        ):
            title = f"{method}, noise {1e3 * noise_V:g} mV, {decoder.pieces} pieces"
            print(f"{title:44} {rate:12.3g} {rate / RATE_HZ:10.3g}")
        print(f"  a single reading takes {1e3 * single_s:.2f} ms, cross-validation by cycles {validation_s:.2f} s")


if __name__ == "__main__":
    main()
