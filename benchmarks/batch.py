"""CPU time of a design in the batch and with `Sensor.power`, both in one run.

Run with ``python -m benchmarks.batch``. The designs are random variants of the paper's, with 25 angles each, and every
response is that of 100 chips: 20 decentres within 60 µm by 5 widths of 0.2 mm ± 20 %.
"""

import os
import time
from collections.abc import Callable
from unittest.mock import patch

import numpy as np

from solen.sensor import Responses, Sensor, respond
from solen.sensor.batched import RAYS
from solen.spec import Design
from solen.trace import batch

DESIGNS, ANGLES = 64, np.linspace(-3.0, 3.0, 25).tolist()
OFFSETS, WIDTHS = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.06, 0.06, 20), np.linspace(0.16, 0.24, 5)))
PLANE = Sensor.of(Design.model_validate({"name": "chip", "material": {"index": 1.44}, "emitter": {"width_mm": 0.2}}))
SPACE = {"trace.dimension": "extruded", "emitter.pattern": "lambertian", "emitter.height_mm": 0.2}
MANY_DESIGNS = 100_000


def cpu_s(call: Callable[[], object]) -> float:
    """Return the CPU time of a call, over all threads of the process."""
    start = time.process_time()
    call()
    return time.process_time() - start


def random_designs(base: Sensor) -> list[Sensor]:
    """Return random variants of a design."""
    draw = np.random.default_rng(1)
    return [
        base.set(
            {
                "lens.focus_mm": draw.uniform(15.0, 25.0),
                "material.index": draw.uniform(1.435, 1.445),
                "body.arm_width_mm": draw.uniform(2.8, 3.2),
                "lens.half_width_mm": draw.uniform(1.8, 2.1),
            }
        )
        for _ in range(DESIGNS)
    ]


def without_compiled_code(sensors: list[Sensor], rays: int) -> None:
    """Compute responses from constant powers instead of traces, to measure the time of the Python code."""

    def constant_powers(design_batch: batch.DesignBatch, *_: object) -> batch.BatchPowers:
        angles = len(design_batch.angle_deg)
        power, truncated = np.ones((angles, design_batch.bins, 2)), np.zeros((angles, design_batch.bins))
        return batch.BatchPowers(power, truncated, np.full(angles, batch.SOUND))

    with patch.object(batch.DesignBatch, "trace", constant_powers):
        respond(sensors, ANGLES, WIDTHS, OFFSETS, rays=rays, threads=1)


def measure_throughput(name: str, base: Sensor, rays: int) -> None:
    """Print the time per design with all its chips, and the uncertainty of the contrast."""
    sensors: list[Sensor] = []
    create_s = cpu_s(lambda: sensors.extend(random_designs(base)))
    responses: list[Responses] = []
    respond(sensors[:1], ANGLES, WIDTHS, OFFSETS, rays=rays, threads=1)
    respond_s = cpu_s(lambda: responses.append(respond(sensors, ANGLES, WIDTHS, OFFSETS, rays=rays, threads=1)))
    python_s = create_s + cpu_s(lambda: without_compiled_code(sensors, rays))
    u, ms = responses[0].u_contrast, 1e3 / DESIGNS
    print(
        f"{name:6} {rays:6d} {ms * (create_s + respond_s):8.2f} {ms * python_s:8.2f} "
        f"{np.sqrt(np.mean(u**2)):8.1e} {np.median(u.max(axis=(1, 2))):8.1e} {u.max():8.1e} "
        f"{MANY_DESIGNS * (create_s + respond_s) / DESIGNS / 120.0:8.1f}"
    )


def compare_with_power(name: str, base: Sensor, rays: int) -> None:
    """Compare `Sensor.power` to 1e-3 with the batch at that uncertainty, for one chip of one design."""
    sensor = base.set({"lens.focus_mm": 19.0})
    sensor.power(ANGLES[:2], tolerance=1e-3)
    power_s = cpu_s(lambda: base.set({"lens.focus_mm": 19.01}).power(ANGLES, tolerance=1e-3))
    respond([sensor], ANGLES, rays=rays, threads=1)
    responses: list[Responses] = []
    other = [base.set({"lens.focus_mm": 19.01})]
    batch_s = cpu_s(lambda: responses.append(respond(other, ANGLES, rays=rays, threads=1)))
    times = f"Sensor.power {1e3 * power_s:8.1f} ms, batch {1e3 * batch_s:6.2f} ms"
    print(f"{name:6} {times} with u {responses[0].u_power.max():.1e}: ratio {power_s / batch_s:.0f}")


def main() -> None:
    """Print the tables."""
    print(f"{os.cpu_count()} cores; ms per design on one core; u of the contrast: RMS, median of maxima, maximum")
    print("case     rays       ms   Python      RMS   median      max  min for 1e5 on two cores")
    for rays in (RAYS, 2 * RAYS):
        measure_throughput("plane", PLANE, rays)
        measure_throughput("space", PLANE.set(SPACE), rays)
    compare_with_power("plane", PLANE, 2**13)
    compare_with_power("space", PLANE.set(SPACE), 2**14)


if __name__ == "__main__":
    main()
