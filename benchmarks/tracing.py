"""Speed of the tracers on the paper's sensor at −3°, all in one run, so that the ratios hold on any machine.

Run with ``python benchmarks/tracing.py``. Each figure is the shortest CPU time of several runs, without compilation.
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


def best_s(call: Callable[[], object], repeats: int = REPEATS) -> float:
    """Return the shortest CPU time of several runs, s."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """Print the table."""
    sensor = Sensor.of(Design(name="paper", material=Material(index=1.44)))
    many, few = sensor.scene(-3.0, RAYS), sensor.scene(-3.0, REFERENCE_RAYS)
    print(
        f"solen {solen.__version__}, numba {numba.__version__}, "
        f"Python {platform.python_version()}, {os.cpu_count()} cores"
    )
    print(f"{'mode':6} {'tracer':28} {'rays/s':>10} {'hits/s':>10} {'of the reference':>18}")
    for mode in MODES:
        hits = trace(few, mode).hits / REFERENCE_RAYS
        reference = REFERENCE_RAYS / best_s(partial(trace_reference, few, mode), 2)
        engine = RAYS / best_s(partial(trace, many, mode, threads=1))
        for tracer, speed in (("reference", reference), ("engine", engine)):
            print(f"{mode:6} {tracer:28} {speed:10.3g} {speed * hits:10.3g} {speed / reference:18.1f}")
        integral = integrate(many, mode, 1e-6)
        integrate_s = best_s(partial(integrate, many, mode, 1e-6))
        fan_s = best_s(partial(trace, many, mode), 2)
        u, rays = integral.u_power, integral.rays
        print(f"{mode:6} adaptive: u {u:.1e} with {rays} rays in {integrate_s * 1e3:.2f} ms; ", end="")
        print(f"a fan of {RAYS} rays takes {fan_s / integrate_s:.0f} times as long")
    measure_response(sensor)
    measure_space(sensor)
    measure_shipped_design(Sensor.of(loads(template())))


def measure_shipped_design(sensor: Sensor) -> None:
    """Print integrals of the shipped design, which has an LED chip, in space."""
    angles = [float(angle) for angle in np.linspace(-3.0, 3.0, ANGLES)]
    for name, variant in (("with lens", sensor), ("without lens", sensor.without_lens)):
        scene = variant.scene(1.0)
        integral = integrate(scene, "power", 1e-4)
        integrate_s = best_s(partial(integrate, scene, "power", 1e-4))
        response_s = best_s(partial(variant.power, angles), 3)
        print(f"chip in space, {name}: one angle to {integral.u_power:.1e} in {integrate_s * 1e3:.0f} ms", end=", ")
        print(f"{integrate_s / integral.rays * 1e9:.0f} ns per ray; {ANGLES} angles in {response_s:.2f} s")
    slope_s = best_s(partial(sensor.derivative, "body.arm_width_mm", 0.2), 2)
    print(f"derivative with respect to one design parameter: {slope_s:.1f} s")


def measure_space(sensor: Sensor) -> None:
    """Compare rays in space with rays in the plane, for a fan and a chip."""
    plane = sensor.scene(-3.0, RAYS // 5)
    (fan,) = plane.sources
    pose = sensor.body(-3.0).emitter
    chip = Emitter(pose.point, pose.axis_deg, fan.rays, CosinePower(1.0), 120.0, 0.2, 0.2)
    for name, scene in (("fan", plane), ("chip", replace(plane, sources=(chip,)))):
        for mode in MODES:
            extruded = replace(scene, extrusion=Extrusion(sensor.design.body.thickness_mm))
            plane_s, space_s = (best_s(partial(trace, s, mode, threads=1)) for s in (scene, extruded))
            print(f"{mode:6} a {name} in space takes {space_s / plane_s:.1f} times as long as in the plane")


def measure_response(sensor: Sensor) -> None:
    """Print the times for the scenes of a response with and without lens, for their integrals and for fans."""
    angles = [float(angle) for angle in np.linspace(-3.0, 3.0, ANGLES)]
    variants = (sensor, sensor.without_lens)

    def create_scenes() -> list[Scene]:
        return [variant.scene(angle) for variant in variants for angle in angles]

    scenes = create_scenes()
    u = max(integral.u_power for integral in integrate_many(scenes, "power", 1e-4))
    integrate_s = best_s(partial(integrate_many, scenes, "power", 1e-4))
    print(f"{len(scenes)} scenes created in {best_s(create_scenes) * 1e3:.0f} ms; ", end="")
    print(f"integrated to {u:.1e} in {integrate_s * 1e3:.0f} ms")
    many_s, single_s = best_s(partial(trace_many, scenes)), best_s(lambda: [trace(scene) for scene in scenes])
    times = f"{many_s * 1e3:.0f} ms in one call, {single_s / many_s:.1f} times as long in separate calls"
    print(f"fans of {scenes[0].rays} rays: {times}")
    slope_s = best_s(partial(sensor.derivative, "body.arm_width_mm", 0.2))
    print(f"derivative with respect to one design parameter: {slope_s * 1e3:.0f} ms")


if __name__ == "__main__":
    main()
