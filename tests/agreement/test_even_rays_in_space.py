"""Errors and uncertainties of evenly spread rays from emitters with two to four coordinates.

The view factor of two parallel rectangles has a closed form. The sensor and the prism are compared with Sobol' samples
of many more rays.
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
Errors = list[tuple[float, float]]
"""Error and uncertainty of each reading."""


def parallel_rectangles(width_mm: float, height_mm: float, rays: int) -> Scene:
    """Return a Lambertian rectangle and a receiver of the same size, 1 mm in front of it."""
    source = Emitter((0.0, 0.0), 0.0, rays, CosinePower(), 180.0, width_mm, height_mm)
    curve = Segment((-0.5 * width_mm, 1.0), (0.5 * width_mm, 1.0)).reversed()
    height = (-0.5 * height_mm, 0.5 * height_mm)
    receiver = Interface("eye", curve, "air", "air", "receiver", "eye", height_mm=height)
    return Scene((Region("air", 1.0),), (receiver,), (source,), extrusion=Extrusion(height_mm + 4.0))


def view_factor(x: float, y: float) -> float:
    """Return the fraction of the light of a rectangle x by y that reaches an equal rectangle at distance 1.

    J. R. Howell, A Catalog of Radiation Heat Transfer Configuration Factors, C-11.
    """
    a, b = 1.0 + x * x, 1.0 + y * y
    logarithm = 0.5 * math.log(a * b / (a + y * y))
    arctangents = x * math.sqrt(b) * math.atan(x / math.sqrt(b)) + y * math.sqrt(a) * math.atan(y / math.sqrt(a))
    return 2.0 / (math.pi * x * y) * (logarithm + arctangents - x * math.atan(x) - y * math.atan(y))


def corner_factor(x: float, y: float) -> float:
    """Return the fraction from a Lambertian point to a rectangle with a corner on its axis (Howell, C-3)."""
    a, b = math.hypot(1.0, x), math.hypot(1.0, y)
    return (x / a * math.atan(y / a) + y / b * math.atan(x / b)) / (2.0 * math.pi)


def check_uncertainties(errors: Errors, max_ratio: float, min_rms: float = 0.4) -> str:
    """Check that the ratios of errors to uncertainties have an RMS near 1 and no outlier; return a summary."""
    ratios = np.array([error / u for error, u in errors])
    rms, largest = math.sqrt(np.mean(ratios**2)), float(np.max(np.abs(ratios)))
    line = f"{len(ratios)} readings: error / u is {rms:.2f} RMS, {largest:.1f} at most"
    assert min_rms < rms < 1.4, line
    assert largest < max_ratio, line
    return line


def test_lattices_with_two_coordinates() -> None:
    """A strip in the plane (crossed strings) and a point in space, whose two half lattices often agree by chance."""
    errors, widths = [], (0.2, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0)
    for rays in (500, 1000, 3000, 4096, 10_000, 30_000, 65_536, 100_000, 200_000):
        for width in widths:
            space = parallel_rectangles(width, 1.0, rays)
            plane = replace(space, interfaces=(replace(space.interfaces[0], height_mm=None),), extrusion=None)
            strip = trace(plane).detectors["eye"]
            errors.append((strip.power - (math.hypot(1.0, width) - 1.0) / width, strip.u_power))
            point = trace(replace(space, sources=(Emitter((0.0, 0.0), 0.0, rays, CosinePower()),))).detectors["eye"]
            errors.append((point.power - 4.0 * corner_factor(0.5 * width, 0.5), point.u_power))
    check_uncertainties(errors, 4.0, 0.2)


def test_view_factors_of_rectangles() -> None:
    """There are forty cases; Student's t with 15 degrees of freedom exceeds 4 once in 900."""
    errors = []
    for width, height in ((0.2, 0.2), (0.5, 2.0), (1.0, 1.0), (2.0, 0.3), (3.0, 3.0)):
        for rays in (1000, 3000, 4096, 10_000, 30_000, 65_536, 100_000, 200_000):
            reading = trace(parallel_rectangles(width, height, rays)).detectors["eye"]
            error = reading.power - view_factor(width, height)
            errors.append((error, reading.u_power))
            assert abs(error) < 0.5 / math.sqrt(rays), f"{width} by {height}, {rays} rays"
    check_uncertainties(errors, 4.0)


SCENES: dict[str, Callable[[int], Scene]] = {
    "sensor at -0.5": lambda rays: sensor(-0.5, rays, 0.2, 0.2),
    "sensor at 1": lambda rays: sensor(1.0, rays, 0.2, 0.2),
    "sensor at 0.3, a line": lambda rays: sensor(0.3, rays, 0.2),
    "bar": lambda rays: bar(chip(rays), 1.44),
    "leaky bar": lambda rays: bar(chip(rays), 1.3),
    "prism": lambda rays: wedge(replace(chip(rays, 120.0), axis_deg=-25.0)),
    "prism in ambient light": lambda rays: wedge(Ambient((0.0, 3.0), 14.0, rays, height_mm=3.0)),
}


def errors_of(name: str, ray_counts: tuple[int, ...], exact_rays: int) -> Errors:
    """Return the errors of a scene with several numbers of rays, and the combined uncertainties."""
    exact = trace(SCENES[name](exact_rays), "power", LIMITS, sampling="sobol", seed=5)
    errors = []
    for rays in ray_counts:
        for receiver, reading in trace(SCENES[name](rays), "power", LIMITS).detectors.items():
            expected = exact.detectors[receiver]
            errors.append((reading.power - expected.power, math.hypot(reading.u_power, expected.u_power)))
    return errors


def test_chips_in_space() -> None:
    errors = [pair for name in SCENES for pair in errors_of(name, (1000, 5000, 10_000, 30_000), 2**18)]
    check_uncertainties(errors, 4.5)


@pytest.mark.evidence
def test_chips_in_space_with_up_to_a_million_rays() -> None:
    rays = (1000, 2000, 5000, 10_000, 30_000, 65_536, 100_000, 300_000, 1_000_000)
    errors = [pair for name in SCENES for pair in errors_of(name, rays, 2**23)]
    print(f"\n{check_uncertainties(errors, 4.5)}")
