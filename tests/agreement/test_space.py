"""Rays in space against the plane, against closed forms, and against a plain tracer by brute force."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.scene import (
    AngleTable,
    Coating,
    Emitter,
    Extrusion,
    Fan,
    Gaussian,
    HarveyShack,
    Interface,
    Lambertian,
    Layer,
    Monitor,
    Rays,
    Region,
    ScatterTable,
    Scene,
    Source,
    Surface,
    Texture,
)
from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import Limits, Mode, Trace, trace
from solen.trace.reference_space import trace_space_reference
from tests.agreement.random_scene_support import motley_scene, random_scene

LIMITS = Limits(min_weight=1e-6, max_hits=300)
LINE = ((633.0, 1.0),)


def chip(rays: int, cone_deg: float = 180.0) -> Emitter:
    """A square chip 1 mm before the front."""
    return Emitter((0.0, -1.0), 0.0, rays, cone_deg=cone_deg, width_mm=0.2, height_mm=0.2, spectrum=LINE)


def bar(
    source: Source,
    index: float,
    surface: Surface | None = None,
    height_mm: tuple[float, float] | None = None,
    thickness_mm: float = 3.0,
    **medium: float,
) -> Scene:
    """A bar of glass 4 mm wide and 12 mm long with a receiver at its far end."""
    corners = [(-2.0, 0.0), (2.0, 0.0), (2.0, 12.0), (-2.0, 12.0)]
    front, right, end, left = (Segment(corners[i], corners[(i + 1) % 4]) for i in range(4))
    walls = [
        Interface(n, c, "bar", "air", surface=surface) for n, c in (("front", front), ("right", right), ("left", left))
    ]
    receiver = Interface("end", end, "bar", "air", "receiver", "end", height_mm=height_mm)
    regions = (Region("air", 1.0), Region("bar", index, **medium))
    return Scene(regions, (*walls, receiver), (source,), extrusion=Extrusion(thickness_mm))


def wedge(source: Source) -> Scene:
    """A prism with a round face, and a mirror beside it: skew rays, total reflection, both polarisations."""
    a, b, c = (-3.0, 0.0), (3.0, 0.0), (1.0, 6.0)
    sides = [
        Interface("front", Segment(a, b), "glass", "air"),
        Interface("slope", Segment(b, c), "glass", "air"),
        Interface("round", Arc.through(c, (-2.5, 4.0), a), "glass", "air", "receiver", "round", height_mm=(-1.0, 0.5)),
        Interface("mirror", Segment((4.0, 8.0), (4.0, -2.0)), "air", "air", "mirror", surface=Surface(reflectance=0.8)),
        Interface("screen", Segment((-6.0, 9.0), (6.0, 9.0)).reversed(), "air", "air", "receiver", "screen"),
    ]
    regions = (Region("air", 1.0), Region("glass", 1.6, 0.02))
    return Scene(regions, tuple(sides), (source,), extrusion=Extrusion(4.0, index_below=1.45))


def sensor(angle_deg: float, rays: int, width_mm: float = 0.0, height_mm: float = 0.0) -> Scene:
    """The paper's sensor in space under light from a chip."""
    scene = Sensor.of(Design(name="sensor", material=Material(index=1.44))).scene(angle_deg)
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    source = Emitter(fan.point, fan.axis_deg, rays, cone_deg=120.0, width_mm=width_mm, height_mm=height_mm)
    return replace(scene, sources=(source,), extrusion=Extrusion(4.0))


def near(one: Trace, other: Trace) -> None:
    """Everything read is the same to 1e-12."""
    assert one.hits == other.hits
    for name, reading in one.detectors.items():
        assert other.detectors[name].power == pytest.approx(reading.power, abs=1e-12)
        assert other.detectors[name].rays == reading.rays
        assert other.detectors[name].optical_path_mm == pytest.approx(reading.optical_path_mm, abs=1e-9, nan_ok=True)
        np.testing.assert_allclose(other.detectors[name].power_by_angle, reading.power_by_angle, atol=1e-12)
    for name, crossed in one.monitors.items():
        assert other.monitors[name].power == pytest.approx(crossed.power, abs=1e-12)
    assert other.missed == other.leaked == 0.0
    assert other.ledger.total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_light_of_the_plane_stays_there(mode: Mode) -> None:
    flat = Sensor.of(Design(name="sensor", material=Material(index=1.44, absorption_per_mm=0.01))).scene(0.3, 4001)
    near(trace(flat, mode, angle_bins=9), trace(replace(flat, extrusion=Extrusion(4.0)), mode, angle_bins=9))


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("seed", range(10))
def test_light_of_the_plane_stays_there_in_random_scenes(seed: int, mode: Mode) -> None:
    """In chaotic scenes rounding decides in the end where a ray goes: few hits are compared."""
    limits = Limits(min_weight=1e-3, max_hits=20)
    for scene in (motley_scene(seed, 24), random_scene(seed, 24)):
        near(trace(scene, mode, limits), trace(replace(scene, extrusion=Extrusion(1.0)), mode, limits))


def test_a_coating_does_the_same_in_the_plane_and_in_space() -> None:
    surface = Surface(coating=Coating((Layer(1.0, 200.0), Layer(2.1, 90.0, 0.02))))
    source = Fan((0.0, -1.0), 10.0, 100.0, 500, s_share=0.3, spectrum=LINE)
    spatial = bar(source, 1.5, surface)
    near(trace(replace(spatial, extrusion=None), "power", LIMITS), trace(spatial, "power", LIMITS))


@pytest.mark.parametrize("index", [1.2, 1.3, 1.4, 1.42, 1.5])
def test_top_and_bottom_lose_light_below_root_two_alone(index: float) -> None:
    """A source that emits evenly into the half-space has an even distribution of β: what is above √(n²−1) gets out."""
    point = Emitter((0.0, -1e-4), 0.0, 2**17)
    found = trace(bar(point, index, thickness_mm=2.0), "count", Limits(max_hits=4000), sampling="sobol")
    leaked = 1.0 - math.sqrt(index * index - 1.0) if index < math.sqrt(2.0) else 0.0
    assert found.leaked == pytest.approx(leaked, abs=1e-3)
    if index > math.sqrt(2.0):
        assert found.leaked == 0.0


def test_one_skew_ray_loses_what_fresnel_says() -> None:
    """A ray that bounces off the top once, polarised in the plane of the bounce or across it."""
    index, rise = 1.3, math.radians(70.0)
    sine = math.sin(rise)
    axial = math.sqrt(index * index - sine * sine)  # along z in the bar
    source = Emitter((0.0, -1e-6), 0.0, 1)
    for s_share in (0.0, 1.0):
        at = Rays(((0.0, -1e-9),), ((0.0, 1.0),), s_share=s_share)
        scene = bar(_Rising(at.origins, at.directions, s_share=s_share, rise=rise), index, thickness_mm=2.0)
        found = trace(scene, "power", Limits(min_weight=1e-12, max_hits=3))
        cos_front, cos_up = math.cos(rise), sine / index
        out = math.sqrt(1.0 - axial * axial)
        # the plane of incidence at the front is that of the rise: s_share is across y, thus p there and p at the top
        if s_share == 1.0:
            front = ((index * cos_front - axial / index) / (index * cos_front + axial / index)) ** 2
            top = ((out * index - cos_up) / (out * index + cos_up)) ** 2
        else:
            front = ((cos_front - axial) / (cos_front + axial)) ** 2
            top = ((index * cos_up - out) / (index * cos_up + out)) ** 2
        assert found.leaked == pytest.approx((1.0 - front) * (1.0 - top), rel=1e-9)
    assert source.rays == 1


class _Rising(Rays):
    """Rays that rise over the plane by an angle."""

    def __init__(self, origins: object, directions: object, s_share: float, rise: float) -> None:
        object.__setattr__(self, "origins", origins)
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "s_share", s_share)
        object.__setattr__(self, "_rise", rise)

    def place_in_space(self, u: np.ndarray) -> tuple[np.ndarray, ...]:  # type: ignore[override]
        x, z, dx, dz = self.place(u)
        rise: float = self._rise  # type: ignore[attr-defined]
        return x, np.zeros_like(x), z, math.cos(rise) * dx, np.full_like(x, math.sin(rise)), math.cos(rise) * dz


TABLED = Surface(
    table=AngleTable((0.0, 30.0, 60.0, 90.0), (0.1, 0.2, 0.7, 0.9), (0.8, 0.6, 0.1, 0.0), (0.2, 0.1, 0.9, 0.9)),
    table_right=AngleTable((0.0, 90.0), (0.05, 0.6), (0.9, 0.2), (0.05, 0.3), (0.9, 0.4)),
    scatter=ScatterTable((0.0, 0.1, 0.5), (1.0, 0.3, 0.0), 0.4),
)
BODIES = {
    "bar": lambda rays: bar(chip(rays), 1.44),
    "bar that leaks": lambda rays: bar(chip(rays), 1.3),
    "short receiver": lambda rays: bar(chip(rays), 1.44, height_mm=(-0.5, 1.0)),
    "absorbing bar": lambda rays: bar(chip(rays), 1.5, absorption_per_mm=0.05),
    "turbid bar": lambda rays: bar(chip(rays), 1.5, scattering_per_mm=0.2, anisotropy=0.6),
    "white bar": lambda rays: bar(chip(rays), 1.5, Surface(scatter=Lambertian(0.5))),
    "rough bar": lambda rays: bar(chip(rays), 1.5, Surface(scatter=Gaussian(0.2, 0.7))),
    "polished bar": lambda rays: bar(chip(rays), 1.5, Surface(scatter=HarveyShack(0.05, 1.5, 0.7))),
    "rippled along": lambda rays: bar(chip(rays), 1.44, Surface(texture=Texture(50.0, 2.0))),
    "rippled across": lambda rays: bar(chip(rays), 1.44, Surface(texture=Texture(50.0, 2.0, "across"))),
    "coated bar": lambda rays: bar(
        chip(rays), 1.6, Surface(coating=Coating((Layer(1.0, 300.0), Layer(1.8, 100.0, 0.05))))
    ),
    "tabled bar": lambda rays: bar(chip(rays), 1.5, TABLED),
    "wedge": lambda rays: wedge(replace(chip(rays, 120.0), axis_deg=-25.0, s_share=1.0)),
    "sensor": lambda rays: sensor(-0.5, rays, width_mm=0.2, height_mm=0.2),
}


def check_against_brute_force(
    scene: Scene, few: Scene, sigmas: float, sampling: Literal["fan", "sobol"] = "sobol"
) -> str:
    """Every reading within so many standard errors of both; a line about it."""
    found = trace(scene, "power", LIMITS, sampling=sampling, seed=11 if sampling == "sobol" else 0)
    truth = trace_space_reference(few, LIMITS, seed=11)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
    readings = {name: (one.power, one.u_power) for name, one in found.detectors.items()}
    for what, power in (("absorbed", found.ledger.absorbed), ("missed", found.missed), ("leaked", found.leaked)):
        # for these the engine states no uncertainty: it has at most that of as many random rays
        readings[what] = (power, truth.error(what) * math.sqrt(few.rays / found.rays))
    line = []
    for what, (power, u) in readings.items():
        error = max(math.hypot(truth.error(what), u), 1.0 / few.rays)
        line.append(f"{what} {power:.5f} {(power - truth.mean(what)) / error:+.1f}")
        assert abs(power - truth.mean(what)) < sigmas * error, f"{what}: {power} against {truth.mean(what)} ± {error}"
    return ", ".join(line)


@pytest.mark.parametrize("name", BODIES)
def test_space_agrees_with_brute_force(name: str) -> None:
    check_against_brute_force(BODIES[name](2**15), BODIES[name](1500), sigmas=4.5)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["wedge", "sensor", "bar that leaks"])
def test_space_agrees_with_brute_force_of_a_million_rays(name: str) -> None:
    """Both take the same million rays; what differs is how they are followed, and what chance does on the way."""
    line = check_against_brute_force(BODIES[name](1_000_000), BODIES[name](1_000_000), 3.0, "fan")
    print(f"\n{name}, 10^6 rays by brute force; reading and deviation in standard errors: {line}")


def test_a_bar_of_light_is_the_plane_over_again() -> None:
    """Thin and close, a slab's light is that of the plane where its pattern is: the extremes of β are cut off."""
    narrow = replace(chip(2**15, 4.0), width_mm=0.0, height_mm=0.0)
    spatial = bar(narrow, 1.44, thickness_mm=2.0)
    flat = replace(spatial, extrusion=None)
    one, other = (trace(scene, "power", LIMITS, sampling="sobol").detectors["end"].power for scene in (flat, spatial))
    assert one == pytest.approx(other, rel=1e-3)


def test_what_space_cannot_do_is_refused() -> None:
    scene = bar(chip(100), 1.4)
    for options, told in (
        ({"precision": "single"}, "precision"),
        ({"device": "cuda"}, "device"),
        ({"legs": True}, "legs"),
    ):
        with pytest.raises(DesignError, match=told):
            trace(scene, "power", **options)
    with pytest.raises(DesignError, match="thickness_mm"):
        Extrusion(0.0)
    with pytest.raises(DesignError, match="must be extruded"):
        trace_space_reference(replace(scene, extrusion=None))


def test_a_monitor_in_space_reads_what_flies_through_it() -> None:
    gate = Monitor("gate", (-1.9999999, 11.999), (1.9999999, 11.999), bins=4)
    scene = replace(bar(chip(2**13), 1.5, absorption_per_mm=0.1), monitors=(gate,))
    found = trace(scene, "power", LIMITS)
    assert found.monitors["gate"].power == pytest.approx(found.detectors["end"].power, rel=2e-3)
    assert found.monitors["gate"].power > found.detectors["end"].power, "it stands before the last micrometre"
    assert found.monitors["gate"].power_by_bin.sum() == pytest.approx(found.monitors["gate"].power, rel=1e-12)
