"""Films, scatter, textures and other surface treatments agree with closed forms from textbooks."""

import math
from dataclasses import replace

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.refraction import fresnel
from solen.scene import (
    Beam,
    Coating,
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
    Scatter,
    Scene,
    Source,
    Surface,
    Texture,
)
from solen.scene.model import Behaviour
from solen.trace import Limits, integrate, trace, trace_reference
from solen.trace.reference_surfaces import film_powers
from tests.agreement.bits_support import bits

NM = 600.0
SCATTERS: tuple[Scatter, ...] = (Lambertian(), Gaussian(0.2), HarveyShack(0.05, 1.6), HarveyShack(0.1, 2.0, 0.5))


def box(half_mm: float) -> tuple[Interface, ...]:
    """Return a square of receivers: ``up`` above z = 0, ``down`` below."""
    a, b, c, d = (-half_mm, -half_mm), (half_mm, -half_mm), (half_mm, half_mm), (-half_mm, half_mm)
    middle = [(half_mm, 0.0), (-half_mm, 0.0)]
    sides = [(a, b, "down"), (b, middle[0], "down"), (middle[0], c, "up"), (c, d, "up"), (d, middle[1], "up")]
    sides.append((middle[1], a, "down"))
    return tuple(
        Interface(f"far-{i}", Segment(p, q), "below" if name == "down" else "above", "outside", "receiver", name)
        for i, (p, q, name) in enumerate(sides)
    )


def plate(
    surface: Surface | None,
    source: Source,
    n_below: float = 1.0,
    n_above: float = 1.0,
    behaviour: Behaviour = "refracting",
    half_mm: float = 1000.0,
) -> Scene:
    """Return an interface along x inside a square of receivers, its left side above."""
    line = Interface("line", Segment((half_mm, 0.0), (-half_mm, 0.0)).reversed(), "above", "below", behaviour)
    if behaviour == "refracting" or n_below == n_above:
        line = replace(line, surface=surface)
    regions = (Region("below", n_below), Region("above", n_above), Region("outside", 1.0))
    interfaces = (line, *box(half_mm))
    if behaviour == "splitter":  # has the same medium on both sides
        interfaces = tuple(replace(i, left="above", right=i.right.replace("below", "above")) for i in interfaces)
    return Scene(regions, interfaces, (source,))


def ray(angle_deg: float, s_share: float = 0.5, rays: int = 1) -> Rays:
    """Return rays from below to the origin at an angle of incidence."""
    angle = math.radians(angle_deg)
    start, direction = (-math.sin(angle), -math.cos(angle)), (math.sin(angle), math.cos(angle))
    return Rays((start,) * rays, (direction,) * rays, s_share=s_share, spectrum=((NM, 1.0),))


def up_and_down(scene: Scene, **options: object) -> tuple[float, float]:
    result = trace(scene, "power", Limits(min_weight=1e-9), **options)  # type: ignore[arg-type]
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    return result.detectors["up"].power, result.detectors["down"].power


def test_quarter_wave_film() -> None:
    n0, film, glass = 1.0, 1.38, 1.52
    surface = Surface(coating=Coating((Layer(film, NM / (4.0 * film)),)))
    _, back = up_and_down(plate(surface, ray(0.0), n0, glass))
    assert back == pytest.approx(((n0 * glass - film**2) / (n0 * glass + film**2)) ** 2, rel=1e-12)


@pytest.mark.parametrize("pairs", [1, 4, 8])
def test_bragg_mirror(pairs: int) -> None:
    low, high, glass = 1.45, 2.3, 1.52
    layers = (Layer(low, NM / (4.0 * low)), Layer(high, NM / (4.0 * high))) * pairs  # from above, the left
    _, back = up_and_down(plate(Surface(coating=Coating(layers)), ray(0.0), 1.0, glass))
    admittance = glass * (high / low) ** (2 * pairs)
    assert back == pytest.approx(((1.0 - admittance) / (1.0 + admittance)) ** 2, rel=1e-12)


@pytest.mark.parametrize("s_share", [0.0, 1.0])
@pytest.mark.parametrize("gap_nm", [0.0, 50.0, 300.0, 3000.0, 1e6])
def test_light_tunnels_through_a_gap(gap_nm: float, s_share: float) -> None:
    """Frustrated total reflection between two halves of glass (Zhu et al., Am. J. Phys. 54, 601, 1986)."""
    n, angle = 1.5, math.radians(60.0)
    surface = Surface(coating=Coating((Layer(1.0, gap_nm),)))
    through, back = up_and_down(plate(surface, ray(60.0, s_share), n, n))
    cos, decay = n * math.cos(angle), math.sqrt((n * math.sin(angle)) ** 2 - 1.0)
    ratio = cos / decay if s_share == 1.0 else cos / (n * n * decay)
    sinh = math.sinh(min(2.0 * math.pi / NM * gap_nm * decay, 300.0))
    expected = 1.0 / (1.0 + (0.5 * (ratio + 1.0 / ratio)) ** 2 * sinh**2)
    assert through == pytest.approx(expected, rel=1e-10, abs=1e-14)
    assert through + back == pytest.approx(1.0, abs=1e-12)


def test_film_of_zero_thickness_has_no_effect() -> None:
    bare, _ = up_and_down(plate(None, ray(50.0), 1.0, 1.5))
    thin, _ = up_and_down(plate(Surface(coating=Coating((Layer(2.4, 0.0),))), ray(50.0), 1.0, 1.5))
    assert thin == pytest.approx(bare, abs=1e-14)


def test_metal_film_absorbs() -> None:
    gold = Coating((Layer(0.25, 40.0, 3.1),))
    result = trace(plate(Surface(coating=gold), ray(0.0), 1.0, 1.5), "power")
    r, t = film_powers([(0.25 - 3.1j, 40.0)], 1.0, 1.0, 1.5, NM, "s")
    assert result.ledger.absorbed == pytest.approx(1.0 - r - t, abs=1e-12)
    assert 0.05 < result.ledger.absorbed < 0.2


def test_transmittance_of_a_coating_is_the_same_from_both_sides() -> None:
    surface = Surface(coating=Coating((Layer(2.3, 80.0), Layer(1.4, 130.0))))
    through, _ = up_and_down(plate(surface, ray(30.0), 1.0, 1.5))
    angle = math.asin(math.sin(math.radians(30.0)) / 1.5)
    back = Rays(((-math.sin(angle), math.cos(angle)),), ((math.sin(angle), -math.cos(angle)),), spectrum=((NM, 1.0),))
    _, reverse = up_and_down(plate(surface, back, 1.0, 1.5))
    assert reverse == pytest.approx(through, abs=1e-13)


@pytest.mark.parametrize("scatter", SCATTERS)
def test_scatter_conserves_power(scatter: Scatter) -> None:
    source = Fan((0.0, -1.0), 0.0, 120.0, 4096, spectrum=((NM, 1.0),))
    result = trace(plate(Surface(scatter=scatter), source, 1.0, 1.5, half_mm=1e5), "power", Limits(min_weight=1e-9))
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9)
    assert result.detectors["up"].power + result.detectors["down"].power == pytest.approx(1.0, abs=1e-9)
    smooth, _ = up_and_down(plate(None, source, 1.0, 1.5, half_mm=1e5))
    assert result.detectors["up"].power == pytest.approx(smooth, abs=1e-9)  # each part stays on its side


@pytest.mark.parametrize("scatter", SCATTERS)
def test_scattered_light_has_the_specified_profile(scatter: Scatter) -> None:
    """The Kolmogorov–Smirnov distance between the sines of the rays and the profile is small enough (1 in 1000)."""
    n, angle = 20_000, 20.0
    segments = trace(plate(Surface(scatter=scatter), ray(angle, rays=n)), "count", segments=True, seed=3).segments
    assert segments is not None
    sines = np.sort(segments["dx"][segments["hit"] == 1])
    x = np.linspace(-1.0, 1.0, 20_001)
    offset = x - math.sin(math.radians(angle))
    density = np.ones_like(x)
    if isinstance(scatter, Gaussian):
        density = np.exp(-0.5 * (offset / scatter.sigma) ** 2)
    elif isinstance(scatter, HarveyShack):
        density = (1.0 + (offset / scatter.shoulder) ** 2) ** (-0.5 * scatter.slope)
    cumulative = np.cumsum(density) / density.sum()
    is_smooth = np.abs(sines - math.sin(math.radians(angle))) < 1e-12
    assert np.mean(~is_smooth) == pytest.approx(scatter.share, abs=4.0 * 0.5 / math.sqrt(n))
    drawn = sines[~is_smooth]
    distance = np.abs(np.interp(drawn, x, cumulative) - (np.arange(len(drawn)) + 0.5) / len(drawn)).max()
    assert distance < 1.95 / math.sqrt(len(drawn))


def integrating_circle(reflectance: float, port_rad: float, rays: int) -> Scene:
    """Return a white circle with a port that detects light, and a source at its centre."""
    port_deg = math.degrees(port_rad)
    wall = Arc((0.0, 0.0), 1.0, 0.5 * port_deg, 360.0 - port_deg)
    port = Arc((0.0, 0.0), 1.0, -0.5 * port_deg, port_deg)
    white = Surface(reflectance=reflectance, scatter=Lambertian())
    interfaces = (
        Interface("wall", wall, "air", "air", "mirror", surface=white),
        Interface("port", port, "air", "air", "receiver", "port"),
    )
    return Scene((Region("air", 1.0),), interfaces, (Fan((0.0, 0.0), 0.0, 360.0, rays),))


@pytest.mark.parametrize(("reflectance", "port_rad"), [(0.95, 0.3), (0.5, 1.0), (0.99, 0.1)])
def test_integrating_circle(reflectance: float, port_rad: float) -> None:
    """The irradiance E on the wall obeys E = 1/2π + ρ ∫ sin(|φ−ψ|/2)/4 E dψ, so that E'' + (1−ρ)/4 E = 1/8π.

    Hence E = A cos(kφ) + 1/2π(1−ρ) with k = √(1−ρ)/2, and A follows from the equation at φ = 0, opposite the port. The
    light that the wall does not absorb is detected.
    """
    a, k, loss = math.pi - 0.5 * port_rad, 0.5 * math.sqrt(1.0 - reflectance), 1.0 - reflectance
    base = 1.0 / (2.0 * math.pi * loss)
    constant_term = 1.0 - math.cos(0.5 * a)  # ∫ sin(φ/2)/2 from 0 to a
    plus, minus = 0.5 + k, 0.5 - k
    cosine_term = 0.25 * ((1.0 - math.cos(plus * a)) / plus + (1.0 - math.cos(minus * a)) / minus)
    amplitude = (1.0 / (2.0 * math.pi) + reflectance * base * constant_term - base) / (1.0 - reflectance * cosine_term)
    expected = 1.0 - loss * (2.0 * amplitude * math.sin(k * a) / k + 2.0 * a * base)
    limits = Limits(min_weight=1e-6, max_hits=5000)
    result = trace(integrating_circle(reflectance, port_rad, 100_000), "power", limits, seed=1)
    port = result.detectors["port"]
    assert port.u_power < 3e-3
    assert port.power == pytest.approx(expected, abs=4.0 * port.u_power + result.ledger.truncated)
    assert result.ledger.total == pytest.approx(1.0, abs=1e-9)


def test_grey_mirror_and_splitter() -> None:
    _, back = up_and_down(plate(Surface(reflectance=0.7), ray(20.0), behaviour="mirror"))
    assert back == pytest.approx(0.7, abs=1e-15)
    on, back = up_and_down(plate(Surface(transmitted=0.3), ray(20.0), behaviour="splitter"))
    assert (on, back) == pytest.approx((0.3, 0.7), abs=1e-15)


def test_no_partial_reflection_below_the_critical_angle() -> None:
    on, _ = up_and_down(plate(Surface(partial=False), ray(41.0), 1.5, 1.0))
    assert on == 1.0
    _, back = up_and_down(plate(Surface(partial=False), ray(42.5), 1.5, 1.0))
    assert back == 1.0


@pytest.mark.parametrize(("band", "acts"), [((500.0, 700.0), True), ((700.0, 800.0), False), ((700.0, 500.0), False)])
def test_behaviour_applies_in_its_band(band: tuple[float, float], acts: bool) -> None:
    on, back = up_and_down(plate(Surface(band_nm=band), ray(20.0), behaviour="mirror"))
    assert (on, back) == ((0.0, 1.0) if acts else (1.0, 0.0))


@pytest.mark.parametrize("focal_mm", [25.0, -25.0])
def test_ideal_lens(focal_mm: float) -> None:
    """Parallel rays meet, or appear to start, on the axis at a distance of one focal length."""
    beam = Beam((-5.0, -10.0), (5.0, -10.0), 0.0, 6, spectrum=((NM, 1.0),))
    lens = Interface("lens", Segment((-8.0, 0.0), (8.0, 0.0)), "air", "air", "lens", surface=Surface(focal_mm=focal_mm))
    segments = trace(Scene((Region("air", 1.0),), (lens,), (beam,)), "count", segments=True).segments
    assert segments is not None
    behind = segments[segments["hit"] == 1]
    height_at_focus = behind["x_mm"] + behind["dx"] / behind["dz"] * focal_mm
    np.testing.assert_allclose(height_at_focus, 0.0, atol=1e-12)


@pytest.mark.parametrize("g", [-0.4, 0.0, 0.8])
def test_free_path_and_mean_cosine_of_a_turbid_medium(g: float) -> None:
    n, per_mm = 20_000, 0.25
    regions = (Region("air", 1.0), Region("fog", 1.0, 0.0, per_mm, g))
    ring = Interface("ring", Arc.circle((0.0, 0.0), 1000.0), "fog", "air", "absorbing")
    source = Rays(((0.0, 0.0),) * n, ((0.0, 1.0),) * n)
    scene = Scene(regions, (ring,), (source,))
    segments = trace(scene, "count", Limits(max_hits=3), segments=True, seed=5).segments
    assert segments is not None
    first, second = segments[segments["hit"] == 0], segments[segments["hit"] == 1]
    assert first["length_mm"].mean() == pytest.approx(1.0 / per_mm, rel=4.0 / math.sqrt(n))
    assert second["dz"].mean() == pytest.approx(g, abs=4.0 / math.sqrt(n))
    assert second["dx"].mean() == pytest.approx(0.0, abs=4.0 / math.sqrt(n))


def test_unscattered_light_through_a_turbid_slab_obeys_beer_law() -> None:
    fog = Region("fog", 1.0, 0.05, 0.4, 0.5)
    a, b, c, d = (-5.0, 0.0), (5.0, 0.0), (5.0, 3.0), (-5.0, 3.0)
    sides = [(a, b), (b, c), (c, d), (d, a)]
    slab = [Interface(f"side-{i}", Segment(p, q), "fog", "air") for i, (p, q) in enumerate(sides)]
    pinhole = Interface("pinhole", Segment((1e-6, 2000.0), (-1e-6, 2000.0)).reversed(), "air", "air", "receiver", "on")
    source = Rays(((0.0, -1.0),) * 40_000, ((0.0, 1.0),) * 40_000)
    monitor = Monitor("inside", (-4.0, 2.0), (4.0, 2.0))
    scene = Scene(
        (Region("air", 1.0), fog), (*slab, replace(pinhole, curve=pinhole.curve.reversed())), (source,), (monitor,)
    )
    result = trace(scene, "power", seed=2)
    unscattered = math.exp(-3.0 * 0.45)
    assert result.detectors["on"].power == pytest.approx(unscattered, abs=4.0 * math.sqrt(unscattered / 40_000))
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert result.monitors["inside"].power > math.exp(-2.0 * 0.45)


def test_texture_deflects_light_by_its_slopes() -> None:
    """A mirror deflects by twice the slope angle; the mean square of the slope is half the square of its maximum."""
    n, texture = 20_000, Texture(100.0, 1.0)
    scene = plate(Surface(texture=texture), ray(0.0, rays=n), behaviour="mirror")
    segments = trace(scene, "count", segments=True, seed=4).segments
    assert segments is not None
    angle = np.arcsin(segments["dx"][segments["hit"] == 1])
    assert angle.mean() == pytest.approx(0.0, abs=4.0 * texture.slope / math.sqrt(n))
    assert np.abs(angle).max() <= 2.0 * math.atan(texture.slope) + 1e-12
    assert np.mean(np.tan(0.5 * angle) ** 2) == pytest.approx(0.5 * texture.slope**2, rel=0.03)


def test_random_result_depends_on_the_seed_but_not_on_threads() -> None:
    scene = integrating_circle(0.9, 0.5, 40_000)
    first, repeated, other = (trace(scene, "power", seed=seed, threads=t) for seed, t in ((1, 1), (1, 2), (2, 2)))
    assert bits(first) == bits(repeated)
    a, b = first.detectors["port"], other.detectors["port"]
    assert a.power != b.power
    assert abs(a.power - b.power) < 5.0 * math.hypot(a.u_power, b.u_power)


def test_bare_surface_obeys_fresnel() -> None:
    on, back = up_and_down(plate(Surface(), ray(56.0, 1.0), 1.0, 1.5))
    reflectance = fresnel(math.cos(math.radians(56.0)), 1.0, 1.5).s
    assert (on, back) == pytest.approx((1.0 - reflectance, reflectance), abs=1e-14)


UNSUPPORTED: list[tuple[dict[str, object], str]] = [
    ({"behaviour": "lens"}, r"surface\.focal_mm; is required by a lens"),
    ({"behaviour": "splitter"}, "is required by a splitter"),
    ({"behaviour": "absorbing", "surface": Surface(scatter=Lambertian())}, "cannot scatter or have a coating"),
    ({"surface": Surface(focal_mm=3.0)}, "does not apply to behaviour refracting"),
    (
        {"behaviour": "mirror", "surface": Surface(coating=Coating((Layer(1.4, 1.0),)))},
        "requires a refracting interface",
    ),
]


@pytest.mark.parametrize(("fields", "message"), UNSUPPORTED)
def test_refuses_unsupported_surfaces(fields: dict[str, object], message: str) -> None:
    side = Interface("side", Segment((0.0, 0.0), (1.0, 0.0)), "air", "air")
    with pytest.raises(DesignError, match=message):
        Scene((Region("air", 1.0),), (replace(side, **fields),), (ray(0.0),))  # type: ignore[arg-type]


def test_refuses_integration_of_scatter() -> None:
    with pytest.raises(DesignError, match="scatters"):
        integrate(plate(Surface(scatter=Lambertian()), Fan((0.0, -1.0), 0.0, 30.0, 10)))


def test_refuses_ideal_elements_in_space() -> None:
    lens = Interface("lens", Segment((-8.0, 0.0), (8.0, 0.0)), "air", "air", "lens", surface=Surface(focal_mm=5.0))
    extruded = Scene((Region("air", 1.0),), (lens,), (ray(0.0),), extrusion=Extrusion(2.0))
    with pytest.raises(DesignError, match="only in the plane"):
        trace(extruded)


def test_default_surface_is_bare() -> None:
    powers = [trace(plate(s, ray(33.0), 1.0, 1.5), "power").detectors["up"].power for s in (None, Surface())]
    assert powers[0] == pytest.approx(powers[1], abs=1e-15)


@pytest.mark.parametrize("extrusion", [None, Extrusion(2.0)])
@pytest.mark.parametrize(("gap_nm", "through"), [(20_000.0, 0.0), (50.0, 1.0)])
def test_only_thick_films_reflect_in_counting_mode(gap_nm: float, through: float, extrusion: Extrusion | None) -> None:
    scene = plate(Surface(coating=Coating((Layer(1.0, gap_nm),))), ray(60.0), 1.5, 1.5)
    result = trace(replace(scene, extrusion=extrusion), "count")
    assert (result.detectors["up"].power, result.detectors["down"].power) == (through, 1.0 - through)
    if extrusion is None:
        assert trace_reference(scene, "count").detectors["up"].power == through
