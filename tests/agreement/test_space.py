"""Rays in space agree with rays in the plane, with closed forms, and with the reference tracer in space."""

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from solen.arrays import FloatArray
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
from solen.scene.sources.base import PlacedInSpace
from solen.sensor import Sensor
from solen.spec import Design, Material
from solen.trace import Limits, Mode, Trace, trace
from solen.trace.reference_space import trace_space_reference
from tests.agreement.random_scene_support import motley_scene, random_scene

LIMITS = Limits(min_weight=1e-6, max_hits=300)
LINE = ((633.0, 1.0),)


def chip(rays: int, cone_deg: float = 180.0) -> Emitter:
    """Return a square chip 1 mm in front of the body."""
    return Emitter((0.0, -1.0), 0.0, rays, cone_deg=cone_deg, width_mm=0.2, height_mm=0.2, spectrum=LINE)


def bar(
    source: Source,
    index: float,
    surface: Surface | None = None,
    height_mm: tuple[float, float] | None = None,
    thickness_mm: float = 3.0,
    **medium: float,
) -> Scene:
    """Return a bar 4 mm wide and 12 mm long with a receiver at its far end."""
    corners = [(-2.0, 0.0), (2.0, 0.0), (2.0, 12.0), (-2.0, 12.0)]
    front, right, end, left = (Segment(corners[i], corners[(i + 1) % 4]) for i in range(4))
    walls = [
        Interface(n, c, "bar", "air", surface=surface) for n, c in (("front", front), ("right", right), ("left", left))
    ]
    receiver = Interface("end", end, "bar", "air", "receiver", "end", height_mm=height_mm)
    regions = (Region("air", 1.0), Region("bar", index, **medium))
    return Scene(regions, (*walls, receiver), (source,), extrusion=Extrusion(thickness_mm))


def wedge(source: Source) -> Scene:
    """Return a prism with a round face and a mirror beside it, for skew rays, total reflection and polarised light."""
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
    """Return the scene of the paper's sensor in space with a chip."""
    scene = Sensor.of(Design(name="sensor", material=Material(index=1.44))).scene(angle_deg)
    (fan,) = scene.sources
    assert isinstance(fan, Fan)
    source = Emitter(fan.point, fan.axis_deg, rays, cone_deg=120.0, width_mm=width_mm, height_mm=height_mm)
    return replace(scene, sources=(source,), extrusion=Extrusion(4.0))


def check_same(plane: Trace, space: Trace) -> None:
    """Check that all readings agree to 1e-12."""
    assert plane.hits == space.hits
    for name, reading in plane.detectors.items():
        assert space.detectors[name].power == pytest.approx(reading.power, abs=1e-12)
        assert space.detectors[name].rays == reading.rays
        assert space.detectors[name].optical_path_mm == pytest.approx(reading.optical_path_mm, abs=1e-9, nan_ok=True)
        np.testing.assert_allclose(space.detectors[name].power_by_angle, reading.power_by_angle, atol=1e-12)
    for name, crossed in plane.monitors.items():
        assert space.monitors[name].power == pytest.approx(crossed.power, abs=1e-12)
    assert space.missed == space.leaked == 0.0
    assert space.ledger.total == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
def test_light_in_the_plane_of_a_sensor(mode: Mode) -> None:
    plane = Sensor.of(Design(name="sensor", material=Material(index=1.44, absorption_per_mm=0.01))).scene(0.3, 4001)
    check_same(trace(plane, mode, angle_bins=9), trace(replace(plane, extrusion=Extrusion(4.0)), mode, angle_bins=9))


@pytest.mark.parametrize("mode", ["count", "power", "roulette"])
@pytest.mark.parametrize("seed", range(6))
def test_light_in_the_plane_of_random_scenes(seed: int, mode: Mode) -> None:
    """Few hits are compared, because rounding errors grow in chaotic scenes."""
    limits = Limits(min_weight=1e-3, max_hits=20)
    for scene in (motley_scene(seed, 24), random_scene(seed, 24)):
        check_same(trace(scene, mode, limits), trace(replace(scene, extrusion=Extrusion(1.0)), mode, limits))


def test_coating_in_the_plane_and_in_space() -> None:
    surface = Surface(coating=Coating((Layer(1.0, 200.0), Layer(2.1, 90.0, 0.02))))
    source = Fan((0.0, -1.0), 10.0, 100.0, 500, s_share=0.3, spectrum=LINE)
    space = bar(source, 1.5, surface)
    check_same(trace(replace(space, extrusion=None), "power", LIMITS), trace(space, "power", LIMITS))


@pytest.mark.parametrize("index", [1.2, 1.3, 1.4, 1.42, 1.5])
def test_leak_through_top_and_bottom(index: float) -> None:
    """Light that is uniform in the half-space is uniform in its cosine along y; above √(n²−1) it leaks if n < √2."""
    point = Emitter((0.0, -1e-4), 0.0, 2**17)
    result = trace(bar(point, index, thickness_mm=2.0), "count", Limits(max_hits=4000), sampling="sobol")
    leaked = 1.0 - math.sqrt(index * index - 1.0) if index < math.sqrt(2.0) else 0.0
    assert result.leaked == pytest.approx(leaked, abs=1e-3)
    if index > math.sqrt(2.0):
        assert result.leaked == 0.0


@pytest.mark.parametrize("s_share", [0.0, 1.0])
def test_skew_ray_loses_power_by_fresnel(s_share: float) -> None:
    """The ray is reflected at the top once, polarised in the plane of incidence or perpendicular to it."""
    index, elevation = 1.3, math.radians(70.0)
    sine = math.sin(elevation)
    axial = math.sqrt(index * index - sine * sine)  # along z in the bar
    scene = bar(SkewRay(((0.0, -1e-9),), ((0.0, 1.0),), s_share=s_share), index, thickness_mm=2.0)
    result = trace(scene, "power", Limits(min_weight=1e-12, max_hits=3))
    cos_front, cos_top = math.cos(elevation), sine / index
    cos_out = math.sqrt(1.0 - axial * axial)
    # the plane of incidence contains y; light that is s-polarised at launch is thus p-polarised at front and top
    if s_share == 1.0:
        front = ((index * cos_front - axial / index) / (index * cos_front + axial / index)) ** 2
        top = ((cos_out * index - cos_top) / (cos_out * index + cos_top)) ** 2
    else:
        front = ((cos_front - axial) / (cos_front + axial)) ** 2
        top = ((index * cos_top - cos_out) / (index * cos_top + cos_out)) ** 2
    assert result.leaked == pytest.approx((1.0 - front) * (1.0 - top), rel=1e-9)


class SkewRay(Rays):
    """Rays with an elevation of 70° above the plane."""

    def place_in_space(self, u: FloatArray) -> PlacedInSpace:
        x, z, dx, dz = self.place(u)
        cos, sin = math.cos(math.radians(70.0)), math.sin(math.radians(70.0))
        return x, np.zeros_like(x), z, cos * dx, np.full_like(x, sin), cos * dz


TABULATED = Surface(
    table=AngleTable((0.0, 30.0, 60.0, 90.0), (0.1, 0.2, 0.7, 0.9), (0.8, 0.6, 0.1, 0.0), (0.2, 0.1, 0.9, 0.9)),
    table_right=AngleTable((0.0, 90.0), (0.05, 0.6), (0.9, 0.2), (0.05, 0.3), (0.9, 0.4)),
    scatter=ScatterTable((0.0, 0.1, 0.5), (1.0, 0.3, 0.0), 0.4),
)
BODIES = {
    "bar": lambda rays: bar(chip(rays), 1.44),
    "leaky bar": lambda rays: bar(chip(rays), 1.3),
    "short receiver": lambda rays: bar(chip(rays), 1.44, height_mm=(-0.5, 1.0)),
    "absorbing bar": lambda rays: bar(chip(rays), 1.5, absorption_per_mm=0.05),
    "turbid bar": lambda rays: bar(chip(rays), 1.5, scattering_per_mm=0.2, anisotropy=0.6),
    "Lambertian bar": lambda rays: bar(chip(rays), 1.5, Surface(scatter=Lambertian(0.5))),
    "rough bar": lambda rays: bar(chip(rays), 1.5, Surface(scatter=Gaussian(0.2, 0.7))),
    "Harvey-Shack bar": lambda rays: bar(chip(rays), 1.5, Surface(scatter=HarveyShack(0.05, 1.5, 0.7))),
    "texture along": lambda rays: bar(chip(rays), 1.44, Surface(texture=Texture(50.0, 2.0))),
    "texture across": lambda rays: bar(chip(rays), 1.44, Surface(texture=Texture(50.0, 2.0, "across"))),
    "coated bar": lambda rays: bar(
        chip(rays), 1.6, Surface(coating=Coating((Layer(1.0, 300.0), Layer(1.8, 100.0, 0.05))))
    ),
    "tabulated bar": lambda rays: bar(chip(rays), 1.5, TABULATED),
    "wedge": lambda rays: wedge(replace(chip(rays, 120.0), axis_deg=-25.0, s_share=1.0)),
    "sensor": lambda rays: sensor(-0.5, rays, width_mm=0.2, height_mm=0.2),
}


def check_reference(scene: Scene, few: Scene, factor: float, sampling: Literal["fan", "sobol"] = "sobol") -> str:
    """Check all readings within ``factor`` combined standard errors; return a summary."""
    result = trace(scene, "power", LIMITS, sampling=sampling, seed=11 if sampling == "sobol" else 0)
    reference = trace_space_reference(few, LIMITS, seed=11)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    readings = {name: (detected.power, detected.u_power) for name, detected in result.detectors.items()}
    for fate, power in (("absorbed", result.ledger.absorbed), ("missed", result.missed), ("leaked", result.leaked)):
        # the uncertainty of these is at most that of the same number of random rays
        readings[fate] = (power, reference.error(fate) * math.sqrt(few.rays / result.rays))
    summary = []
    for fate, (power, u) in readings.items():
        expected, error = reference.mean(fate), max(math.hypot(reference.error(fate), u), 1.0 / few.rays)
        summary.append(f"{fate} {power:.5f} {(power - expected) / error:+.1f}")
        assert abs(power - expected) < factor * error, f"{fate}: {power} instead of {expected} ± {error}"
    return ", ".join(summary)


@pytest.mark.parametrize("name", BODIES)
def test_reference_in_space(name: str) -> None:
    check_reference(BODIES[name](2**14), BODIES[name](1000), factor=4.5)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["wedge", "sensor", "leaky bar"])
def test_reference_in_space_with_a_million_rays(name: str) -> None:
    """Both trace the same rays, but draw different random numbers."""
    summary = check_reference(BODIES[name](1_000_000), BODIES[name](1_000_000), 3.0, "fan")
    print(f"\n{name}, 10^6 rays in the reference; reading and deviation in standard errors: {summary}")


def test_narrow_emission_is_the_same_in_the_plane_and_in_space() -> None:
    narrow = replace(chip(2**15, 4.0), width_mm=0.0, height_mm=0.0)
    space = bar(narrow, 1.44, thickness_mm=2.0)
    plane = replace(space, extrusion=None)
    power = [trace(scene, "power", LIMITS, sampling="sobol").detectors["end"].power for scene in (plane, space)]
    assert power[0] == pytest.approx(power[1], rel=1e-3)


def test_refuses_unsupported_options_in_space() -> None:
    scene = bar(chip(100), 1.4)
    for options, option in (
        ({"precision": "single"}, "precision"),
        ({"device": "cuda"}, "device"),
        ({"segments": True}, "segments"),
    ):
        with pytest.raises(DesignError, match=option):
            trace(scene, "power", **options)
    with pytest.raises(DesignError, match="thickness_mm"):
        Extrusion(0.0)
    with pytest.raises(DesignError, match="must be extruded"):
        trace_space_reference(replace(scene, extrusion=None))


def test_monitor_in_space() -> None:
    """The monitor is 1 µm in front of the receiver."""
    gate = Monitor("gate", (-1.9999999, 11.999), (1.9999999, 11.999), bins=4)
    scene = replace(bar(chip(2**13), 1.5, absorption_per_mm=0.1), monitors=(gate,))
    result = trace(scene, "power", LIMITS)
    assert result.monitors["gate"].power == pytest.approx(result.detectors["end"].power, rel=2e-3)
    assert result.monitors["gate"].power > result.detectors["end"].power
    assert result.monitors["gate"].power_by_bin.sum() == pytest.approx(result.monitors["gate"].power, rel=1e-12)
