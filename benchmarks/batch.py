"""Time of a design in the batch and with the public call, both in one run, in CPU time of this process.

Run with ``python -m benchmarks.batch``. The designs are the paper's with random numbers, 25 angles each, and every
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
MANY = 100_000


def cpu_s(call: Callable[[], object]) -> float:
    """Return the CPU time of a call, over all threads of the process."""
    begun = time.process_time()
    call()
    return time.process_time() - begun


def designs(base: Sensor) -> list[Sensor]:
    """Return randomly drawn designs."""
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
    """Respond with powers that are not traced, to measure the time of the Python code."""

    def nothing(one_design: batch.DesignBatch, *_: object) -> batch.Found:
        angles = len(one_design.angle_deg)
        power, dark = np.ones((angles, one_design.bins, 2)), np.zeros((angles, one_design.bins))
        return batch.Found(power, dark, np.full(angles, batch.SOUND))

    with patch.object(batch.DesignBatch, "traced", nothing):
        respond(sensors, ANGLES, WIDTHS, OFFSETS, rays=rays, threads=1)


def throughput(name: str, base: Sensor, rays: int) -> None:
    """Print time and stated error of a design with all its chips."""
    made: list[Sensor] = []
    making = cpu_s(lambda: made.extend(designs(base)))
    found: list[Responses] = []
    respond(made[:1], ANGLES, WIDTHS, OFFSETS, rays=rays, threads=1)
    whole = cpu_s(lambda: found.append(respond(made, ANGLES, WIDTHS, OFFSETS, rays=rays, threads=1)))
    python = making + cpu_s(lambda: without_compiled_code(made, rays))
    u, ms = found[0].u_contrast, 1e3 / DESIGNS
    print(
        f"{name:6} {rays:6d} {ms * (making + whole):8.2f} {ms * python:8.2f} "
        f"{np.sqrt(np.mean(u**2)):8.1e} {np.median(u.max(axis=(1, 2))):8.1e} {u.max():8.1e} "
        f"{MANY * (making + whole) / DESIGNS / 120.0:8.1f}"
    )


def beside_the_public_call(name: str, base: Sensor, rays: int) -> None:
    """Compare `Sensor.power` to 1e-3 with the batch at that uncertainty, for one chip of one design."""
    sensor = base.set({"lens.focus_mm": 19.0})
    sensor.power(ANGLES[:2], tolerance=1e-3)
    public = cpu_s(lambda: base.set({"lens.focus_mm": 19.01}).power(ANGLES, tolerance=1e-3))
    respond([sensor], ANGLES, rays=rays, threads=1)
    found: list[Responses] = []
    own = cpu_s(lambda: found.append(respond([base.set({"lens.focus_mm": 19.01})], ANGLES, rays=rays, threads=1)))
    u = found[0].u_power.max()
    print(f"{name:6} public {1e3 * public:8.1f} ms, batch {1e3 * own:6.2f} ms at u {u:.1e}: {public / own:.0f} times")


def main() -> None:
    """Print the tables."""
    print(f"{os.cpu_count()} cores; ms of one core a design; u of the contrast: rms, median and most of the largest")
    print("case     rays       ms   Python      rms   median     most  min for 1e5 on two cores")
    for rays in (RAYS, 2 * RAYS):
        throughput("plane", PLANE, rays)
        throughput("space", PLANE.set(SPACE), rays)
    beside_the_public_call("plane", PLANE, 2**13)
    beside_the_public_call("space", PLANE.set(SPACE), 2**14)


if __name__ == "__main__":
    main()
