"""Surfaces that are more than smooth and bare, against closed forms of textbooks."""

import math
from dataclasses import replace

import numpy as np
import pytest

from solen.curve import Arc, Segment
from solen.errors import DesignError
from solen.interface import fresnel
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
from solen.trace import Limits, Trace, integrate, trace, trace_reference
from solen.trace.reference_surfaces import film_powers

NM = 600.0
SCATTERS: tuple[Scatter, ...] = (Lambertian(), Gaussian(0.2), HarveyShack(0.05, 1.6), HarveyShack(0.1, 2.0, 0.5))


def box(half_mm: float, name: str = "far") -> tuple[Interface, ...]:
    """Receivers all round: what goes up is counted by ``up``, what goes down by ``down``."""
    a, b, c, d = (-half_mm, -half_mm), (half_mm, -half_mm), (half_mm, half_mm), (-half_mm, half_mm)
    middle = [(half_mm, 0.0), (-half_mm, 0.0)]
    sides = [(a, b, "down"), (b, middle[0], "down"), (middle[0], c, "up"), (c, d, "up"), (d, middle[1], "up")]
    sides.append((middle[1], a, "down"))
    return tuple(
        Interface(f"{name}-{i}", Segment(p, q), "below" if to == "down" else "above", "outside", "receiver", to)
        for i, (p, q, to) in enumerate(sides)
    )


def plate(
    surface: Surface | None,
    source: Source,
    n_below: float = 1.0,
    n_above: float = 1.0,
    behaviour: Behaviour = "refracting",
    half_mm: float = 1000.0,
) -> Scene:
    """One interface along x at z = 0, its left above, with receivers far above and below."""
    line = Interface("line", Segment((half_mm, 0.0), (-half_mm, 0.0)).reversed(), "above", "below", behaviour)
    if behaviour == "refracting" or n_below == n_above:
        line = replace(line, surface=surface)
    regions = (Region("below", n_below), Region("above", n_above), Region("outside", 1.0))
    interfaces = (line, *box(half_mm))
    if behaviour == "splitter":  # it stands in one medium
        interfaces = tuple(replace(i, left="above", right=i.right.replace("below", "above")) for i in interfaces)
    return Scene(regions, interfaces, (source,))


def ray(angle_deg: float, s_share: float = 0.5, rays: int = 1) -> Rays:
    """Rays from below towards the origin at an angle of incidence."""
    angle = math.radians(angle_deg)
    at, towards = (-math.sin(angle), -math.cos(angle)), (math.sin(angle), math.cos(angle))
    return Rays((at,) * rays, (towards,) * rays, s_share=s_share, spectrum=((NM, 1.0),))


def up_and_down(scene: Scene, **options: object) -> tuple[float, float]:
    found = trace(scene, "power", Limits(min_weight=1e-9), **options)  # type: ignore[arg-type]
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
    return found.detectors["up"].power, found.detectors["down"].power


def test_a_quarter_wave_has_its_textbook_reflectance() -> None:
    n0, film, glass = 1.0, 1.38, 1.52
    surface = Surface(coating=Coating((Layer(film, NM / (4.0 * film)),)))
    _, back = up_and_down(plate(surface, ray(0.0), n0, glass))
    assert back == pytest.approx(((n0 * glass - film**2) / (n0 * glass + film**2)) ** 2, rel=1e-12)


@pytest.mark.parametrize("pairs", [1, 4, 8])
def test_a_bragg_mirror_has_its_textbook_reflectance(pairs: int) -> None:
    low, high, glass = 1.45, 2.3, 1.52
    layers = (Layer(low, NM / (4.0 * low)), Layer(high, NM / (4.0 * high))) * pairs  # from above, the left
    _, back = up_and_down(plate(Surface(coating=Coating(layers)), ray(0.0), 1.0, glass))
    admittance = glass * (high / low) ** (2 * pairs)
    assert back == pytest.approx(((1.0 - admittance) / (1.0 + admittance)) ** 2, rel=1e-12)


@pytest.mark.parametrize("s_share", [0.0, 1.0])
@pytest.mark.parametrize("gap_nm", [0.0, 50.0, 300.0, 3000.0, 1e6])
def test_light_tunnels_through_a_gap_as_textbooks_say(gap_nm: float, s_share: float) -> None:
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


def test_a_film_without_thickness_is_none_and_a_metal_absorbs() -> None:
    bare, _ = up_and_down(plate(None, ray(50.0), 1.0, 1.5))
    thin, _ = up_and_down(plate(Surface(coating=Coating((Layer(2.4, 0.0),))), ray(50.0), 1.0, 1.5))
    assert thin == pytest.approx(bare, abs=1e-14)
    gold = Coating((Layer(0.25, 40.0, 3.1),))
    found = trace(plate(Surface(coating=gold), ray(0.0), 1.0, 1.5), "power")
    r, t = film_powers([(0.25 - 3.1j, 40.0)], 1.0, 1.0, 1.5, NM, "s")
    assert found.ledger.absorbed == pytest.approx(1.0 - r - t, abs=1e-12)
    assert 0.05 < found.ledger.absorbed < 0.2


def test_a_coating_does_as_much_from_either_side() -> None:
    surface = Surface(coating=Coating((Layer(2.3, 80.0), Layer(1.4, 130.0))))
    through, _ = up_and_down(plate(surface, ray(30.0), 1.0, 1.5))
    angle = math.asin(math.sin(math.radians(30.0)) / 1.5)
    back = Rays(((-math.sin(angle), math.cos(angle)),), ((math.sin(angle), -math.cos(angle)),), spectrum=((NM, 1.0),))
    _, returned = up_and_down(plate(surface, back, 1.0, 1.5))
    assert returned == pytest.approx(through, abs=1e-13)


@pytest.mark.parametrize("scatter", SCATTERS)
def test_scatter_conserves_power(scatter: Scatter) -> None:
    source = Fan((0.0, -1.0), 0.0, 120.0, 4096, spectrum=((NM, 1.0),))
    found = trace(plate(Surface(scatter=scatter), source, 1.0, 1.5, half_mm=1e5), "power", Limits(min_weight=1e-9))
    assert found.ledger.total == pytest.approx(1.0, abs=1e-9)
    assert found.detectors["up"].power + found.detectors["down"].power == pytest.approx(1.0, abs=1e-9)
    smooth, _ = up_and_down(plate(None, source, 1.0, 1.5, half_mm=1e5))
    assert found.detectors["up"].power == pytest.approx(smooth, abs=1e-9), "each part stays on its side"


def angles_above(scene: Scene, rays: int) -> np.ndarray:
    """Sines of the angles at which single rays go on above the plate."""
    found = trace(replace(scene, sources=(scene.sources[0].with_rays(rays),)), "count", legs=True, seed=3)
    legs = found.legs
    assert legs is not None
    return np.array(legs["dx"][legs["hit"] == 1])


@pytest.mark.parametrize("scatter", SCATTERS)
def test_what_is_scattered_has_the_stated_profile(scatter: Scatter) -> None:
    """Sines of single rays against the integral of the profile, by the greatest distance of both distributions."""
    n, angle = 20_000, 20.0
    scene = plate(Surface(scatter=scatter), ray(angle, rays=n))
    found = np.sort(angles_above(scene, n))
    x = np.linspace(-1.0, 1.0, 20_001)
    off = x - math.sin(math.radians(angle))
    density = np.ones_like(x)
    if isinstance(scatter, Gaussian):
        density = np.exp(-0.5 * (off / scatter.sigma) ** 2)
    elif isinstance(scatter, HarveyShack):
        density = (1.0 + (off / scatter.shoulder) ** 2) ** (-0.5 * scatter.slope)
    whole = np.cumsum(density) / density.sum()
    smooth = np.abs(found - math.sin(math.radians(angle))) < 1e-12
    assert np.mean(~smooth) == pytest.approx(scatter.share, abs=4.0 * 0.5 / math.sqrt(n))
    drawn = found[~smooth]
    distance = np.abs(np.interp(drawn, x, whole) - (np.arange(len(drawn)) + 0.5) / len(drawn)).max()
    assert distance < 1.95 / math.sqrt(len(drawn)), "Kolmogorov and Smirnov, 1 in 1000"


def circle(reflectance: float, port_rad: float, rays: int) -> Scene:
    """White circle with a black port that detects, and light from its middle."""
    open_deg = math.degrees(port_rad)
    wall = Arc((0.0, 0.0), 1.0, 0.5 * open_deg, 360.0 - open_deg)
    port = Arc((0.0, 0.0), 1.0, -0.5 * open_deg, open_deg)
    white = Surface(reflectance=reflectance, scatter=Lambertian())
    interfaces = (
        Interface("wall", wall, "air", "air", "mirror", surface=white),
        Interface("port", port, "air", "air", "receiver", "port"),
    )
    return Scene((Region("air", 1.0),), interfaces, (Fan((0.0, 0.0), 0.0, 360.0, rays),))


@pytest.mark.parametrize(("reflectance", "port_rad"), [(0.95, 0.3), (0.5, 1.0), (0.99, 0.1)])
def test_a_lambertian_wall_makes_an_integrating_circle(reflectance: float, port_rad: float) -> None:
    """Irradiance E on the wall obeys E = 1/2π + ρ ∫ sin(|φ−ψ|/2)/4 E dψ, so E'' + (1−ρ)/4 E = 1/8π.

    Hence E = A cos(kφ) + 1/2π(1−ρ) with k = √(1−ρ)/2, and A follows from the equation at φ = 0, opposite the port. What
    the wall does not absorb is detected.
    """
    a, k, loss = math.pi - 0.5 * port_rad, 0.5 * math.sqrt(1.0 - reflectance), 1.0 - reflectance
    base = 1.0 / (2.0 * math.pi * loss)
    flat = 1.0 - math.cos(0.5 * a)  # ∫ sin(φ/2)/2 from 0 to a
    plus, minus = 0.5 + k, 0.5 - k
    waved = 0.25 * ((1.0 - math.cos(plus * a)) / plus + (1.0 - math.cos(minus * a)) / minus)
    amplitude = (1.0 / (2.0 * math.pi) + reflectance * base * flat - base) / (1.0 - reflectance * waved)
    expected = 1.0 - loss * (2.0 * amplitude * math.sin(k * a) / k + 2.0 * a * base)
    found = trace(circle(reflectance, port_rad, 400_000), "power", Limits(min_weight=1e-9, max_hits=5000), seed=1)
    port = found.detectors["port"]
    assert port.u_power < 3e-3
    assert port.power == pytest.approx(expected, abs=4.0 * port.u_power)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-9)


def test_a_grey_mirror_and_a_splitter_divide_the_power() -> None:
    _, back = up_and_down(plate(Surface(reflectance=0.7), ray(20.0), behaviour="mirror"))
    assert back == pytest.approx(0.7, abs=1e-15)
    on, back = up_and_down(plate(Surface(transmitted=0.3), ray(20.0), behaviour="splitter"))
    assert (on, back) == pytest.approx((0.3, 0.7), abs=1e-15)


def test_without_partial_reflection_all_goes_on_up_to_the_critical_angle() -> None:
    on, _ = up_and_down(plate(Surface(partial=False), ray(41.0), 1.5, 1.0))
    assert on == 1.0
    _, back = up_and_down(plate(Surface(partial=False), ray(42.5), 1.5, 1.0))
    assert back == 1.0


@pytest.mark.parametrize(("band", "acts"), [((500.0, 700.0), True), ((700.0, 800.0), False), ((700.0, 500.0), False)])
def test_a_behaviour_holds_in_its_band(band: tuple[float, float], acts: bool) -> None:
    on, back = up_and_down(plate(Surface(band_nm=band), ray(20.0), behaviour="mirror"))
    assert (on, back) == ((0.0, 1.0) if acts else (1.0, 0.0))


@pytest.mark.parametrize("focal_mm", [25.0, -25.0])
def test_an_ideal_lens_bends_by_height_over_focal_length(focal_mm: float) -> None:
    """Parallel light crosses the axis, or seems to come from it, one focal length behind the lens."""
    beam = Beam((-5.0, -10.0), (5.0, -10.0), 0.0, 6, spectrum=((NM, 1.0),))
    lens = Interface("lens", Segment((-8.0, 0.0), (8.0, 0.0)), "air", "air", "lens", surface=Surface(focal_mm=focal_mm))
    found = trace(Scene((Region("air", 1.0),), (lens,), (beam,)), "count", legs=True)
    legs = found.legs
    assert legs is not None
    behind = legs[legs["hit"] == 1]
    height_at_focus = behind["x_mm"] + behind["dx"] / behind["dz"] * focal_mm
    np.testing.assert_allclose(height_at_focus, 0.0, atol=1e-12)


@pytest.mark.parametrize("g", [-0.4, 0.0, 0.8])
def test_a_turbid_medium_scatters_by_its_free_path_and_its_mean_cosine(g: float) -> None:
    n, per_mm = 20_000, 0.25
    regions = (Region("air", 1.0), Region("fog", 1.0, 0.0, per_mm, g))
    ring = Interface("ring", Arc.circle((0.0, 0.0), 1000.0), "fog", "air", "absorbing")
    source = Rays(((0.0, 0.0),) * n, ((0.0, 1.0),) * n)
    found = trace(Scene(regions, (ring,), (source,)), "count", Limits(max_hits=3), legs=True, seed=5)
    legs = found.legs
    assert legs is not None
    first, second = legs[legs["hit"] == 0], legs[legs["hit"] == 1]
    assert first["length_mm"].mean() == pytest.approx(1.0 / per_mm, rel=4.0 / math.sqrt(n))
    assert second["dz"].mean() == pytest.approx(g, abs=4.0 / math.sqrt(n))
    assert second["dx"].mean() == pytest.approx(0.0, abs=4.0 / math.sqrt(n))


def test_a_turbid_slab_lets_through_what_beers_law_says_unscattered() -> None:
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
    found = trace(scene, "power", seed=2)
    straight = math.exp(-3.0 * 0.45)
    assert found.detectors["on"].power == pytest.approx(straight, abs=4.0 * math.sqrt(straight / 40_000))
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
    assert found.monitors["inside"].power > math.exp(-2.0 * 0.45)


def test_a_texture_spreads_light_by_its_slopes() -> None:
    """Reflected off a mirror, rays turn by twice the slope, whose mean square is half of the steepest one's."""
    n, texture = 20_000, Texture(100.0, 1.0)
    scene = plate(Surface(texture=texture), ray(0.0, rays=n), behaviour="mirror")
    found = trace(scene, "count", legs=True, seed=4)
    legs = found.legs
    assert legs is not None
    angle = np.arcsin(legs["dx"][legs["hit"] == 1])
    assert angle.mean() == pytest.approx(0.0, abs=4.0 * texture.slope / math.sqrt(n))
    assert np.abs(angle).max() <= 2.0 * math.atan(texture.slope) + 1e-12
    assert np.mean(np.tan(0.5 * angle) ** 2) == pytest.approx(0.5 * texture.slope**2, rel=0.03)


def test_results_of_chance_have_an_uncertainty_and_depend_on_the_seed_alone() -> None:
    scene = circle(0.9, 0.5, 40_000)
    one, again, other = (trace(scene, "power", seed=seed, threads=t) for seed, t in ((1, 1), (1, 2), (2, 2)))
    assert repr(one) == repr(again)
    assert one.detectors["port"].power != other.detectors["port"].power
    spread = math.hypot(one.detectors["port"].u_power, other.detectors["port"].u_power)
    assert abs(one.detectors["port"].power - other.detectors["port"].power) < 5.0 * spread


def test_the_power_of_a_bare_surface_is_fresnels() -> None:
    on, back = up_and_down(plate(Surface(), ray(56.0, 1.0), 1.0, 1.5))
    share = fresnel(math.cos(math.radians(56.0)), 1.0, 1.5).s
    assert (on, back) == pytest.approx((1.0 - share, share), abs=1e-14)


REFUSED: list[tuple[dict[str, object], str]] = [
    ({"behaviour": "lens"}, r"surface\.focal_mm; is required by a lens"),
    ({"behaviour": "splitter"}, "is required by a splitter"),
    ({"behaviour": "absorbing", "surface": Surface(scatter=Lambertian())}, "cannot scatter or have a coating"),
    ({"surface": Surface(focal_mm=3.0)}, "does not apply to behaviour refracting"),
    (
        {"behaviour": "mirror", "surface": Surface(coating=Coating((Layer(1.4, 1.0),)))},
        "requires a refracting interface",
    ),
]


@pytest.mark.parametrize(("fields", "told"), REFUSED)
def test_what_means_nothing_is_refused(fields: dict[str, object], told: str) -> None:
    side = Interface("side", Segment((0.0, 0.0), (1.0, 0.0)), "air", "air")
    with pytest.raises(DesignError, match=told):
        Scene((Region("air", 1.0),), (replace(side, **fields),), (ray(0.0),))  # type: ignore[arg-type]


def test_what_scatters_cannot_be_integrated_and_the_plane_alone_has_ideal_elements() -> None:
    scene = plate(Surface(scatter=Lambertian()), Fan((0.0, -1.0), 0.0, 30.0, 10))
    with pytest.raises(DesignError, match="a scene that scatters"):
        integrate(scene)
    lens = Interface("lens", Segment((-8.0, 0.0), (8.0, 0.0)), "air", "air", "lens", surface=Surface(focal_mm=5.0))
    extruded = Scene((Region("air", 1.0),), (lens,), (ray(0.0),), extrusion=Extrusion(2.0))
    with pytest.raises(DesignError, match="ideal elements and gratings are supported only in the plane"):
        trace(extruded)


def test_a_trace_is_the_same_whatever_surface_says_nothing() -> None:
    scene = plate(None, ray(33.0), 1.0, 1.5)
    plain: Trace = trace(scene, "power")
    treated = trace(plate(Surface(), ray(33.0), 1.0, 1.5), "power")
    assert plain.detectors["up"].power == pytest.approx(treated.detectors["up"].power, abs=1e-15)


@pytest.mark.parametrize("extrusion", [None, Extrusion(2.0)])
@pytest.mark.parametrize(("gap_nm", "through"), [(20_000.0, 0.0), (50.0, 1.0)])
def test_counting_sees_the_total_reflection_of_a_thick_film_alone(
    gap_nm: float, through: float, extrusion: Extrusion | None
) -> None:
    scene = plate(Surface(coating=Coating((Layer(1.0, gap_nm),))), ray(60.0), 1.5, 1.5)
    found = trace(replace(scene, extrusion=extrusion), "count")
    assert (found.detectors["up"].power, found.detectors["down"].power) == (through, 1.0 - through)
    if extrusion is None:
        assert trace_reference(scene, "count").detectors["up"].power == through
