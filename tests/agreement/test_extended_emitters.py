"""Integration over emitters with a width, an angular pattern and a spectrum."""

import dataclasses
import math

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.material import Cauchy
from solen.results import plain
from solen.scene import (
    Beam,
    Chip,
    CosinePower,
    Emitter,
    Fan,
    Gaussian,
    Interface,
    PatternTable,
    Region,
    Scene,
    Source,
    Surface,
)
from solen.sensor import Sensor
from solen.spec import Design, Material, with_values
from solen.trace import Limits, Trace, derivative, integrate, trace
from solen.trace.adaptive import Lights
from solen.trace.cone import COARSE

TABLE = PatternTable((0.0, 20.0, 40.0, 60.0, 80.0, 100.0, 130.0), (1.0, 0.95, 0.8, 0.5, 0.4, 0.3, 0.0))
PAPER = Sensor.of(Design(name="paper", material=Material(index=1.44)))


def with_emitter(scene: Scene, kind: str, width_mm: float) -> Scene:
    """Return a scene with another emitter in the position of its fan."""
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    sources: dict[str, Source] = {
        "chip": Chip(fan.point, width_mm, fan.axis_deg, fan.cone_deg, 1),
        "lambertian": Emitter(fan.point, fan.axis_deg, 1, CosinePower(), 180.0, width_mm),
        "table": Emitter(fan.point, fan.axis_deg, 1, TABLE, 360.0, width_mm),
    }
    return dataclasses.replace(scene, sources=(sources[kind],))


def contrast(trace: Trace) -> float:
    right, left = trace.detectors["right"].power, trace.detectors["left"].power
    return (right - left) / (right + left)


def test_coarse_rule_is_exact_to_its_degree() -> None:
    """The seven Kronrod nodes are exact up to degree 11, the three Gauss nodes among them up to degree 5."""
    for degree in range(0, 12, 2):
        assert COARSE.kronrod @ COARSE.nodes**degree == pytest.approx(2.0 / (degree + 1), abs=1e-15)
        assert degree > 5 or COARSE.gauss @ COARSE.nodes**degree == pytest.approx(2.0 / (degree + 1), abs=1e-15)
    assert abs(COARSE.kronrod @ COARSE.nodes**12 - 2.0 / 13.0) > 1e-5


@pytest.mark.parametrize("kind", ["chip", "lambertian", "table"])
@pytest.mark.parametrize("angle_deg", [-0.5, -3.0])
def test_extended_emitter_is_the_mean_of_many_points(kind: str, angle_deg: float) -> None:
    """The points are at the centres of 1001 equal intervals of the chip."""
    scene, count = with_emitter(PAPER.scene(angle_deg), kind, 0.2), 1001
    light = Lights.of(scene, "power", Limits(min_weight=1e-7)).in_plane
    points = [light.cone((i + 0.5) / count).integral(1e-5, 10**6).powers for i in range(count)]
    integral = integrate(scene, "power", 1e-4)
    assert integral.reached
    for name, mean in zip(integral.detectors, np.mean(points, axis=0), strict=False):
        assert integral.detectors[name].power == pytest.approx(mean, abs=1e-4)
        assert integral.detectors[name].power == pytest.approx(mean, abs=integral.u_power + 3e-5)
    assert integral.ledger.total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("angle_deg", "chip", "point"), [(-0.5, 0.249, 0.946), (-1.0, 0.486, 0.9999), (-3.0, 0.895, 0.9993)]
)
def test_contrast_of_a_chip_changes_more_gradually(angle_deg: float, chip: float, point: float) -> None:
    """The paper's lens magnifies a chip 0.2 mm wide 13.9 times, so that the contrast rises over several degrees."""
    scene = PAPER.scene(angle_deg)
    assert contrast(integrate(with_emitter(scene, "chip", 0.2), "power", 1e-5)) == pytest.approx(chip, abs=1e-3)
    assert contrast(integrate(scene, "power", 1e-6)) == pytest.approx(point, abs=1e-3)


@pytest.mark.parametrize("kind", ["chip", "lambertian", "table"])
def test_narrow_emitter_is_a_point(kind: str) -> None:
    scene = PAPER.scene(0.3)
    point = integrate(with_emitter(scene, kind, 0.0), "power", 1e-8)
    narrow = integrate(with_emitter(scene, kind, 1e-6), "power", 1e-7)
    for name, reading in point.detectors.items():
        assert narrow.detectors[name].power == pytest.approx(reading.power, abs=1e-5)
    if kind == "chip":
        fan = integrate(scene, "power", 1e-8)
        assert {name: plain(reading) for name, reading in point.detectors.items()} == {
            name: plain(reading) for name, reading in fan.detectors.items()
        }


@pytest.mark.parametrize("mode", ["count", "power"])
@pytest.mark.parametrize("kind", ["chip", "lambertian", "table"])
def test_agrees_with_dense_trace(mode: str, kind: str) -> None:
    scene = with_emitter(PAPER.scene(0.2), kind, 0.1)
    integral = integrate(scene, mode, 1e-4)  # type: ignore[arg-type]
    rays = 2**18
    dense = trace(dataclasses.replace(scene, sources=(scene.sources[0].with_rays(rays),)), mode)  # type: ignore[arg-type]
    for name, reading in dense.detectors.items():
        assert integral.detectors[name].power == pytest.approx(reading.power, abs=integral.u_power + 100.0 / rays)


def power_on_disc(source: Source) -> float:
    """Return the fraction of light that reaches a disc of radius 0.5 mm, 3 mm away on the axis."""
    outline = Arc((0.0, 3.0), 0.5, 0.0, -360.0)
    disc = Interface("disc", outline, "air", "air", "receiver", "disc")
    return integrate(Scene((Region("air", 1.0),), (disc,), (source,)), "count", 1e-9).detectors["disc"].power


def test_patterns_in_closed_form() -> None:
    """The disc receives the integral of the pattern over angles up to asin(r/d)."""
    edge = math.asin(0.5 / 3.0)
    assert power_on_disc(Emitter((0.0, 0.0), 0.0, 1, CosinePower())) == pytest.approx(math.sin(edge), abs=1e-9)
    assert power_on_disc(Emitter((0.0, 0.0), 0.0, 1, cone_deg=360.0)) == pytest.approx(edge / math.pi, abs=1e-9)
    cube = 1.5 * (math.sin(edge) - math.sin(edge) ** 3 / 3.0)
    assert power_on_disc(Emitter((0.0, 0.0), 0.0, 1, CosinePower(3.0))) == pytest.approx(cube, abs=1e-9)
    table = PatternTable((0.0, 5.0, 90.0), (0.2, 1.0, 0.0))
    five, ninety = math.radians(5.0), math.radians(90.0)
    total = 0.6 * five + 0.5 * (ninety - five)
    outer = edge - five
    received = 0.6 * five + outer * (1.0 - 0.5 * outer / (ninety - five))
    assert power_on_disc(Emitter((0.0, 0.0), 0.0, 1, table)) == pytest.approx(received / total, abs=1e-9)


def test_spectral_lines_are_summed_with_their_weights() -> None:
    base = PAPER.scene(0.4)
    body = Region("body", Cauchy(A=1.42, B_um2=0.02), 0.001)
    lines = ((450.0, 1.0), (620.0, 2.5), (860.0, 0.5))

    def integral(spectrum: tuple[tuple[float, float], ...]) -> Trace:
        source = base.sources[0].with_spectrum(spectrum)
        return integrate(dataclasses.replace(base, regions=(base.regions[0], body), sources=(source,)), "power", 1e-6)

    single = [integral((line,)) for line in lines]
    for name, reading in integral(lines).detectors.items():
        expected = sum(w * result.detectors[name].power for (_, w), result in zip(lines, single, strict=True)) / 4.0
        assert reading.power == pytest.approx(expected, abs=1e-8)
    powers = [result.detectors["right"].power for result in single]
    assert np.ptp(powers) > 1e-3  # the index depends on wavelength


def test_several_sources_are_weighted_by_their_power() -> None:
    scene = PAPER.scene(0.4)
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    chip = Chip((0.1, -1.0), 0.1, 0.0, 90.0, 1, power=3.0)
    both = integrate(dataclasses.replace(scene, sources=(fan, chip)), "power", 1e-5)
    of_fan, of_chip = (integrate(dataclasses.replace(scene, sources=(s,)), "power", 1e-6) for s in (fan, chip))
    for name, reading in both.detectors.items():
        parts = [0.25 * of_fan.detectors[name].power, 0.75 * of_chip.detectors[name].power]
        assert reading.power_by_source == pytest.approx(parts, abs=1e-5)
        assert reading.power == pytest.approx(sum(parts), abs=1e-5)


def test_derivative_of_a_chip() -> None:
    def scene_at(index: float) -> Scene:
        return with_emitter(Sensor.of(Design(name="one", material=Material(index=index))).scene(-1.0), "chip", 0.2)

    slopes = derivative(scene_at, 1.44, tolerance=1e-5)
    high, low = (integrate(scene_at(1.44 + sign * 0.003), "power", 1e-6) for sign in (1.0, -1.0))
    for name, slope in slopes.detectors.items():
        difference = (high.detectors[name].power - low.detectors[name].power) / 0.006
        assert slope.value == pytest.approx(difference, abs=0.02 * abs(difference) + 1e-3)
        assert 0.0 < slope.u_value < 0.05


def test_refuses_beams_empty_cones_and_scatter() -> None:
    scene = PAPER.scene(0.0)
    face = scene.interfaces[0]
    rough = dataclasses.replace(face, surface=Surface(scatter=Gaussian(0.1)))
    cases = {
        "Beam": dataclasses.replace(scene, sources=(Beam((0.0, -1.0), (1.0, -1.0), 0.0, 2),)),
        "cone_deg": with_emitter(dataclasses.replace(scene, sources=(Fan((0.0, -1.0), 0.0, 0.0, 2),)), "chip", 0.1),
        "scatters": dataclasses.replace(scene, interfaces=(rough, *scene.interfaces[1:])),
    }
    for message, invalid in cases.items():
        with pytest.raises(DesignError, match=message):
            integrate(invalid)


def test_light_emitted_backwards_reaches_a_circular_receiver() -> None:
    ring = Interface("ring", Arc.circle((0.0, 0.0), 5.0), "air", "air", "receiver", "ring")
    wall = Interface("wall", Segment((-1.0, -2.0), (1.0, -2.0)), "air", "air", "absorbing")
    emitter = Emitter((0.0, 0.0), 0.0, 1, TABLE, 360.0, 0.3)
    integral = integrate(Scene((Region("air", 1.0),), (ring, wall), (emitter,)), "count", 1e-6)
    assert integral.ledger.detected + integral.ledger.absorbed == pytest.approx(1.0, abs=1e-6)
    assert integral.ledger.absorbed == 0.0  # the pattern ends at 130 degrees, and the wall begins at 153


@pytest.mark.parametrize(
    ("width_mm", "angle_deg", "index", "tolerance"),
    [(0.3, -2.318, 1.54, 1e-2), (0.3, 2.308, 1.54, 1e-2), (0.2, 2.622, 1.49, 1e-3)],
)
def test_uncertainty_is_valid_for_high_tolerances(
    width_mm: float, angle_deg: float, index: float, tolerance: float
) -> None:
    """At these angles and widths, two rules with few nodes agree by chance next to a kink."""
    design = with_values(Design(name="chip", material=Material(index=index)), {"emitter.width_mm": width_mm})
    sensor = Sensor.of(design)
    exact, coarse = (sensor.integrate(angle_deg, tolerance=value) for value in (1e-5, tolerance))
    for name, reading in coarse.detectors.items():
        assert abs(reading.power - exact.detectors[name].power) < coarse.u_power <= tolerance
