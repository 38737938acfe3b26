"""Integration over emitters with a size, a pattern and a spectrum, against averages over many point sources."""

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


def emitting(scene: Scene, kind: str, width_mm: float) -> Scene:
    """The scene with another emitter where its fan is."""
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    sources: dict[str, Source] = {
        "chip": Chip(fan.point, width_mm, fan.axis_deg, fan.cone_deg, 1),
        "lambertian": Emitter(fan.point, fan.axis_deg, 1, CosinePower(), 180.0, width_mm),
        "table": Emitter(fan.point, fan.axis_deg, 1, TABLE, 360.0, width_mm),
    }
    return dataclasses.replace(scene, sources=(sources[kind],))


def contrast(found: Trace) -> float:
    right, left = found.detectors["right"].power, found.detectors["left"].power
    return (right - left) / (right + left)


def test_the_small_rule_is_kronrods() -> None:
    """Seven nodes are exact up to degree 11, the three of Gauss among them up to degree 5."""
    for degree in range(0, 12, 2):
        assert COARSE.kronrod @ COARSE.nodes**degree == pytest.approx(2.0 / (degree + 1), abs=1e-15)
        assert degree > 5 or COARSE.gauss @ COARSE.nodes**degree == pytest.approx(2.0 / (degree + 1), abs=1e-15)
    assert abs(COARSE.kronrod @ COARSE.nodes**12 - 2.0 / 13.0) > 1e-5


@pytest.mark.parametrize("kind", ["chip", "lambertian", "table"])
@pytest.mark.parametrize("angle_deg", [-0.5, -3.0])
def test_an_extended_emitter_is_the_average_of_many_points(kind: str, angle_deg: float) -> None:
    """Of 2001 point sources in the middle of equal parts of the chip, each integrated on its own."""
    scene, many = emitting(PAPER.scene(angle_deg), kind, 0.2), 2001
    light = Lights.of(scene, "power", Limits(min_weight=1e-7)).in_plane
    points = [light.cone((i + 0.5) / many).integral(1e-5, 10**6).share for i in range(many)]
    found = integrate(scene, "power", 1e-4)
    assert found.reached
    for name, average in zip(found.detectors, np.mean(points, axis=0), strict=False):
        assert found.detectors[name].power == pytest.approx(average, abs=1e-4)
        assert found.detectors[name].power == pytest.approx(average, abs=found.u_power + 3e-5)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    ("angle_deg", "chip", "point"), [(-0.5, 0.249, 0.946), (-1.0, 0.486, 0.9999), (-3.0, 0.895, 0.9993)]
)
def test_a_chip_turns_a_switch_into_a_sensor(angle_deg: float, chip: float, point: float) -> None:
    """The paper's lens enlarges a chip 0.2 mm wide 13.9 times: the contrast rises over degrees, not over tenths."""
    scene = PAPER.scene(angle_deg)
    assert contrast(integrate(emitting(scene, "chip", 0.2), "power", 1e-5)) == pytest.approx(chip, abs=1e-3)
    assert contrast(integrate(scene, "power", 1e-6)) == pytest.approx(point, abs=1e-3)


@pytest.mark.parametrize("kind", ["chip", "lambertian", "table"])
def test_without_a_width_it_is_the_point(kind: str) -> None:
    scene = PAPER.scene(0.3)
    point = integrate(emitting(scene, kind, 0.0), "power", 1e-8)
    narrow = integrate(emitting(scene, kind, 1e-6), "power", 1e-7)
    for name, reading in point.detectors.items():
        assert narrow.detectors[name].power == pytest.approx(reading.power, abs=1e-5)
    if kind == "chip":
        fan = integrate(scene, "power", 1e-8)
        assert {name: plain(reading) for name, reading in point.detectors.items()} == {
            name: plain(reading) for name, reading in fan.detectors.items()
        }


@pytest.mark.parametrize("mode", ["count", "power"])
@pytest.mark.parametrize("kind", ["chip", "lambertian", "table"])
def test_it_agrees_with_a_dense_trace(mode: str, kind: str) -> None:
    scene = emitting(PAPER.scene(0.2), kind, 0.1)
    found = integrate(scene, mode, 1e-4)  # type: ignore[arg-type]
    rays = 2**18
    dense = trace(dataclasses.replace(scene, sources=(scene.sources[0].with_rays(rays),)), mode)  # type: ignore[arg-type]
    for name, reading in dense.detectors.items():
        assert found.detectors[name].power == pytest.approx(reading.power, abs=found.u_power + 100.0 / rays)


def seen(source: Source, size_mm: float = 0.5) -> float:
    """Share of a source's light that reaches a disc 3 mm away along its axis."""
    outside = Arc((0.0, 3.0), size_mm, 0.0, -360.0)
    disc = Interface("disc", outside, "air", "air", "receiver", "disc")
    return integrate(Scene((Region("air", 1.0),), (disc,), (source,)), "count", 1e-9).detectors["disc"].power


def test_patterns_in_closed_form() -> None:
    """A disc seen under ±asin(r/d): of cos θ it gets sin, of a table the area under it up to there."""
    edge = math.asin(0.5 / 3.0)
    assert seen(Emitter((0.0, 0.0), 0.0, 1, CosinePower())) == pytest.approx(math.sin(edge), abs=1e-9)
    assert seen(Emitter((0.0, 0.0), 0.0, 1, cone_deg=360.0)) == pytest.approx(edge / math.pi, abs=1e-9)
    cube = 1.5 * (math.sin(edge) - math.sin(edge) ** 3 / 3.0)
    assert seen(Emitter((0.0, 0.0), 0.0, 1, CosinePower(3.0))) == pytest.approx(cube, abs=1e-9)
    table = PatternTable((0.0, 5.0, 90.0), (0.2, 1.0, 0.0))
    five, ninety = math.radians(5.0), math.radians(90.0)
    whole = 0.6 * five + 0.5 * (ninety - five)
    rest = edge - five
    part = 0.6 * five + rest * (1.0 - 0.5 * rest / (ninety - five))
    assert seen(Emitter((0.0, 0.0), 0.0, 1, table)) == pytest.approx(part / whole, abs=1e-9)


def test_colours_are_summed_by_their_weights() -> None:
    base = PAPER.scene(0.4)
    body = Region("body", Cauchy(A=1.42, B_um2=0.02), 0.001)
    lines = ((450.0, 1.0), (620.0, 2.5), (860.0, 0.5))

    def of(spectrum: tuple[tuple[float, float], ...]) -> Trace:
        source = base.sources[0].with_spectrum(spectrum)
        return integrate(dataclasses.replace(base, regions=(base.regions[0], body), sources=(source,)), "power", 1e-6)

    together, alone = of(lines), [of((line,)) for line in lines]
    for name, reading in together.detectors.items():
        expected = sum(w * one.detectors[name].power for (_, w), one in zip(lines, alone, strict=True)) / 4.0
        assert reading.power == pytest.approx(expected, abs=1e-8)
    powers = [one.detectors["right"].power for one in alone]
    assert np.ptp(powers) > 1e-3  # colours must matter here


def test_several_sources_share_the_power() -> None:
    scene = PAPER.scene(0.4)
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    other = Chip((0.1, -1.0), 0.1, 0.0, 90.0, 1, power=3.0)
    both = integrate(dataclasses.replace(scene, sources=(fan, other)), "power", 1e-5)
    each = [integrate(dataclasses.replace(scene, sources=(one,)), "power", 1e-6) for one in (fan, other)]
    for name, reading in both.detectors.items():
        parts = [0.25 * each[0].detectors[name].power, 0.75 * each[1].detectors[name].power]
        assert reading.power_by_source == pytest.approx(parts, abs=1e-5)
        assert reading.power == pytest.approx(sum(parts), abs=1e-5)


def test_the_derivative_of_a_chip_is_that_of_its_integral() -> None:
    def at(index: float) -> Scene:
        return emitting(Sensor.of(Design(name="one", material=Material(index=index))).scene(-1.0), "chip", 0.2)

    found = derivative(at, 1.44)
    wide = [integrate(at(1.44 + sign * 0.003), "power", 1e-7) for sign in (1.0, -1.0)]
    for name, slope in found.detectors.items():
        rough = (wide[0].detectors[name].power - wide[1].detectors[name].power) / 0.006
        assert slope.value == pytest.approx(rough, abs=0.02 * abs(rough) + 1e-3)
        assert 0.0 < slope.u_value < 0.05


def test_what_is_not_made_of_points_or_scatters_is_refused() -> None:
    scene = PAPER.scene(0.0)
    face = scene.interfaces[0]
    rough = dataclasses.replace(face, surface=Surface(scatter=Gaussian(0.1)))
    cases = {
        "Beam": dataclasses.replace(scene, sources=(Beam((0.0, -1.0), (1.0, -1.0), 0.0, 2),)),
        "cone_deg": emitting(dataclasses.replace(scene, sources=(Fan((0.0, -1.0), 0.0, 0.0, 2),)), "chip", 0.1),
        "scatters": dataclasses.replace(scene, interfaces=(rough, *scene.interfaces[1:])),
    }
    for words, wrong in cases.items():
        with pytest.raises(DesignError, match=words):
            integrate(wrong)


def test_light_to_the_side_and_back_arrives_on_a_ring() -> None:
    ring = Interface("ring", Arc.circle((0.0, 0.0), 5.0), "air", "air", "receiver", "ring")
    wall = Interface("wall", Segment((-1.0, -2.0), (1.0, -2.0)), "air", "air", "absorbing")
    found = integrate(
        Scene((Region("air", 1.0),), (ring, wall), (Emitter((0.0, 0.0), 0.0, 1, TABLE, 360.0, 0.3),)), "count", 1e-6
    )
    assert found.ledger.detected + found.ledger.absorbed == pytest.approx(1.0, abs=1e-6)
    assert found.ledger.absorbed == 0.0  # the table ends at 130 degrees, the wall begins at 153


@pytest.mark.parametrize(
    ("width_mm", "angle_deg", "index", "tolerance"),
    [(0.3, -2.318, 1.54, 1e-2), (0.3, 2.308, 1.54, 1e-2), (0.2, 2.622, 1.49, 1e-3)],
)
def test_a_loose_tolerance_has_an_uncertainty_that_holds(
    width_mm: float, angle_deg: float, index: float, tolerance: float
) -> None:
    """Chips and angles at which rules of few places agree by chance beside a sharp bend."""
    design = with_values(Design(name="chip", material=Material(index=index)), {"emitter.width_mm": width_mm})
    sensor = Sensor.of(design)
    truth, found = (sensor.integrate(angle_deg, tolerance=one) for one in (1e-5, tolerance))
    for name, reading in found.detectors.items():
        assert abs(reading.power - truth.detectors[name].power) < found.u_power <= tolerance
