"""Speed of the tracers on the paper's sensor at −3°, all in one run, so that the ratios hold on any machine.

Run with ``python benchmarks/tracing.py``. Each figure is the least CPU time of several runs, without compilation.
"""

import os
import platform
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numba
import numpy as np

import solen
from solen.scene import CosinePower, Emitter, Extrusion, Scene
from solen.sensor import Sensor
from solen.spec import Design, Material, loads, template
from solen.trace import Mode, integrate, integrate_many, trace, trace_many, trace_reference

RAYS, REFERENCE_RAYS, REPEATS, ANGLES = 2_000_000, 2_000, 5, 25
MODES: tuple[Mode, ...] = ("count", "power")


def best_s(call: Callable[[], object], repeats: int = REPEATS, clock: Callable[[], float] = time.process_time) -> float:
    """Return the shortest of several runs by a clock, s."""
    times = []
    for _ in range(repeats):
        begun = clock()
        call()
        times.append(clock() - begun)
    return min(times)


def main() -> None:
    """Print the table."""
    sensor = Sensor.of(Design(name="paper", material=Material(index=1.44)))
    many, few = sensor.scene(-3.0, RAYS), sensor.scene(-3.0, REFERENCE_RAYS)
    print(
        f"solen {solen.__version__}, numba {numba.__version__}, "
        f"Python {platform.python_version()}, {os.cpu_count()} cores"
    )
    print(f"{'mode':6} {'what':28} {'rays/s':>10} {'hits/s':>10} {'of the reference':>18}")
    for mode in MODES:
        hits = trace(few, mode).hits / REFERENCE_RAYS
        plain = REFERENCE_RAYS / best_s(partial(trace_reference, few, mode), 2)
        engine = RAYS / best_s(partial(trace, many, mode, threads=1))
        for what, speed in (("reference", plain), ("engine", engine)):
            print(f"{mode:6} {what:28} {speed:10.3g} {speed * hits:10.3g} {speed / plain:18.1f}")
        found = integrate(many, mode, 1e-6)
        seconds = best_s(partial(integrate, many, mode, 1e-6))
        fan_s = best_s(partial(trace, many, mode), 2)
        print(f"{mode:6} adaptive: u {found.u_power:.1e} with {found.rays} rays in {seconds * 1e3:.2f} ms; ", end="")
        print(f"a fan of {RAYS} rays takes {fan_s / seconds:.0f} times as long")
    sweep(sensor)
    space(sensor)
    shipped(Sensor.of(loads(template())))


def shipped(sensor: Sensor) -> None:
    """Print integrals of the shipped design, whose LED has a chip, in space."""
    angles = [float(angle) for angle in np.linspace(-3.0, 3.0, ANGLES)]
    for name, case in (("with lens", sensor), ("without", sensor.without_lens)):
        scene = case.scene(1.0)
        found = integrate(scene, "power", 1e-4)
        seconds = best_s(partial(integrate, scene, "power", 1e-4))
        sweep_s = best_s(partial(case.power, angles), 3)
        print(f"chip in space, {name}: an angle to {found.u_power:.1e} in {seconds * 1e3:.0f} ms", end=", ")
        print(f"{seconds / found.rays * 1e9:.0f} ns a ray; {ANGLES} angles in {sweep_s:.2f} s")
    slope_s = best_s(partial(sensor.derivative, "body.arm_width_mm", 0.2), 2)
    print(f"derivative with respect to one number of the design: {slope_s:.1f} s")


def space(sensor: Sensor) -> None:
    """Compare rays in space with rays in the plane, for a fan and a chip."""
    flat = sensor.scene(-3.0, RAYS // 5)
    (fan,) = flat.sources
    pose = sensor.body(-3.0).emitter
    chip = Emitter(pose.point, pose.axis_deg, fan.rays, CosinePower(1.0), 120.0, 0.2, 0.2)
    for name, scene in (("fan", flat), ("chip", replace(flat, sources=(chip,)))):
        for mode in MODES:
            solid = replace(scene, extrusion=Extrusion(sensor.design.body.thickness_mm))
            times = [best_s(partial(trace, one, mode, threads=1)) for one in (scene, solid)]
            print(f"{mode:6} a {name} in space takes {times[1] / times[0]:.1f} times as long as in the plane")


def sweep(sensor: Sensor) -> None:
    """Print the time for the angles of a response, with the lens and without: making the scenes, and using them."""
    angles = [float(angle) for angle in np.linspace(-3.0, 3.0, ANGLES)]
    cases = (sensor, sensor.without_lens)

    def scenes() -> list[Scene]:
        return [case.scene(angle) for case in cases for angle in angles]

    made = scenes()
    integrated = integrate_many(made, "power", 1e-4)
    print(f"{len(made)} scenes made in {best_s(scenes) * 1e3:.0f} ms; ", end="")
    print(f"integrated to {max(found.u_power for found in integrated):.1e}", end=" ")
    print(f"in {best_s(partial(integrate_many, made, 'power', 1e-4)) * 1e3:.0f} ms")
    together, apart = best_s(partial(trace_many, made)), best_s(lambda: [trace(scene) for scene in made])
    print(
        f"fans of {made[0].rays} rays: {together * 1e3:.0f} ms in one call, {apart / together:.1f} times as long apart"
    )
    slope_s = best_s(partial(sensor.derivative, "body.arm_width_mm", 0.2))
    print(f"derivative with respect to one number of the design: {slope_s * 1e3:.0f} ms")


if __name__ == "__main__":
    main()
