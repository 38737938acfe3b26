"""Evenly spread rays of emitters with two to four coordinates: how far off they are, and what they state.

Two parallel rectangles that face each other see a share of each other that has a closed form; the sensor and the prism
have none and are held to Sobol' samples of many more rays.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from solen.curve import Segment
from solen.scene import Ambient, CosinePower, Emitter, Extrusion, Interface, Region, Scene
from solen.trace import Limits, trace
from tests.agreement.test_space import bar, chip, sensor, wedge

LIMITS = Limits(max_hits=300)
Found = list[tuple[float, float]]
"""Error and stated u of each reading."""


def facing(wide_mm: float, high_mm: float, rays: int) -> Scene:
    """A Lambertian rectangle and, 1 mm before it, a receiver of the same size."""
    source = Emitter((0.0, 0.0), 0.0, rays, CosinePower(), 180.0, wide_mm, high_mm)
    curve = Segment((-0.5 * wide_mm, 1.0), (0.5 * wide_mm, 1.0)).reversed()
    receiver = Interface("eye", curve, "air", "air", "receiver", "eye", height_mm=(-0.5 * high_mm, 0.5 * high_mm))
    return Scene((Region("air", 1.0),), (receiver,), (source,), extrusion=Extrusion(high_mm + 4.0))


def view_factor(x: float, y: float) -> float:
    """Share of the light of a rectangle x by y that reaches its likeness at distance 1.

    J. R. Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11.
    """
    a, b = 1.0 + x * x, 1.0 + y * y
    logarithm = 0.5 * math.log(a * b / (a + y * y))
    bends = x * math.sqrt(b) * math.atan(x / math.sqrt(b)) + y * math.sqrt(a) * math.atan(y / math.sqrt(a))
    return 2.0 / (math.pi * x * y) * (logarithm + bends - x * math.atan(x) - y * math.atan(y))


def corner_factor(x: float, y: float) -> float:
    """The same of a Lambertian point to a rectangle x by y in front of it, one corner on its axis; C-3 there."""
    a, b = math.hypot(1.0, x), math.hypot(1.0, y)
    return (x / a * math.atan(y / a) + y / b * math.atan(x / b)) / (2.0 * math.pi)


def honest(found: Found, most: float, least_rms: float = 0.4) -> str:
    """A line about errors in units of their u, whose root mean square is near 1 and whose largest is no surprise."""
    off = np.array([error / u for error, u in found])
    rms, worst = math.sqrt(np.mean(off**2)), float(np.max(np.abs(off)))
    line = f"{len(off)} readings: error / u has a root mean square of {rms:.2f}, and {worst:.1f} at most"
    assert least_rms < rms < 1.4, line
    assert worst < most, line
    return line


def test_lattices_of_two_coordinates_state_what_they_are_off_by() -> None:
    """Of a strip in the plane, by crossed strings, and of a point in space: their two halves often agree by chance."""
    found, sizes = [], (0.2, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
    for rays in (500, 1000, 3000, 4096, 10_000, 30_000, 65_536, 100_000, 200_000):
        for size in sizes:
            both = facing(size, 1.0, rays)
            flat = replace(both, interfaces=(replace(both.interfaces[0], height_mm=None),), extrusion=None)
            strip = trace(flat).detectors["eye"]
            found.append((strip.power - (math.hypot(1.0, size) - 1.0) / size, strip.u_power))
            point = replace(both, sources=(Emitter((0.0, 0.0), 0.0, rays, CosinePower()),))
            seen = trace(point).detectors["eye"]
            found.append((seen.power - 4.0 * corner_factor(0.5 * size, 0.5), seen.u_power))
    honest(found, 4.0, 0.2)


def test_rectangles_see_of_each_other_what_they_must() -> None:
    """Forty combinations; of Student's distribution with 15 degrees of freedom 4 is passed once in 900."""
    found = []
    for wide, high in ((0.2, 0.2), (0.5, 2.0), (1.0, 1.0), (2.0, 0.3), (3.0, 3.0)):
        for rays in (1000, 3000, 4096, 10_000, 30_000, 65_536, 100_000, 200_000):
            eye = trace(facing(wide, high, rays)).detectors["eye"]
            found.append((eye.power - view_factor(wide, high), eye.u_power))
            assert abs(eye.power - view_factor(wide, high)) < 0.5 / math.sqrt(rays), f"{wide} by {high}, {rays} rays"
    honest(found, 4.0)


SCENES: dict[str, Callable[[int], Scene]] = {
    "sensor at -0.5": lambda rays: sensor(-0.5, rays, 0.2, 0.2),
    "sensor at 1": lambda rays: sensor(1.0, rays, 0.2, 0.2),
    "sensor at 0.3, a line": lambda rays: sensor(0.3, rays, 0.2),
    "bar": lambda rays: bar(chip(rays), 1.44),
    "bar that leaks": lambda rays: bar(chip(rays), 1.3),
    "prism": lambda rays: wedge(replace(chip(rays, 120.0), axis_deg=-25.0)),
    "prism in ambient light": lambda rays: wedge(Ambient((0.0, 3.0), 14.0, rays, height_mm=3.0)),
}


def compared(name: str, rays: tuple[int, ...], truth_rays: int) -> Found:
    """Errors of one scene with so many rays each, and their u with that of the truth."""
    truth = trace(SCENES[name](truth_rays), "power", LIMITS, sampling="sobol", seed=5)
    found = []
    for many in rays:
        one = trace(SCENES[name](many), "power", LIMITS)
        for receiver, reading in one.detectors.items():
            right = truth.detectors[receiver]
            found.append((reading.power - right.power, math.hypot(reading.u_power, right.u_power)))
    return found


def test_even_rays_of_a_chip_in_space_are_off_by_what_they_state() -> None:
    found = [pair for name in SCENES for pair in compared(name, (1000, 5000, 10_000, 30_000), 2**19)]
    honest(found, 4.5)


@pytest.mark.evidence
def test_a_million_even_rays_of_a_chip_in_space_are_off_by_what_they_state() -> None:
    rays = (1000, 2000, 5000, 10_000, 30_000, 65_536, 100_000, 300_000, 1_000_000)
    found = [pair for name in SCENES for pair in compared(name, rays, 2**23)]
    print(f"\n{honest(found, 4.5)}")
