"""Surfaces with measured tables, and gratings, agree with closed forms: powers, profiles, angles of orders."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.plane import Point
from solen.refraction import fresnel
from solen.scene import (
    AngleTable,
    Emitter,
    Extrusion,
    Fan,
    Grating,
    Interface,
    Rays,
    Region,
    ScatterTable,
    Scene,
    Surface,
    dumps,
    loads,
)
from solen.scene.model import Behaviour
from solen.scene.sources import Source
from solen.trace import Limits, integrate, trace, trace_reference

NM = 600.0
GLASS = 1.5
CRITICAL_DEG = math.degrees(math.asin(1.0 / GLASS))


def fresnel_table(n1: float, n2: float, steps: int = 2000) -> AngleTable:
    """Return Fresnel's reflectances and transmittances as a table, including total reflection."""
    angle_deg = tuple(np.linspace(0.0, 90.0, steps + 1).tolist())
    s, p = zip(*(_reflectances(math.radians(angle), n1, n2) for angle in angle_deg), strict=True)
    return AngleTable(angle_deg, s, tuple(1.0 - r for r in s), p, tuple(1.0 - r for r in p))


def _reflectances(angle: float, n1: float, n2: float) -> tuple[float, float]:
    if math.sin(angle) * n1 >= n2 or angle == math.radians(90.0):
        return 1.0, 1.0
    reflectance = fresnel(math.cos(angle), n1, n2)
    return reflectance.s, reflectance.p


def flat(reflected: float, transmitted: float = 0.0) -> AngleTable:
    return AngleTable((0.0, 90.0), (reflected,) * 2, (transmitted,) * 2 if transmitted else ())


def ray(angle_deg: float, s_share: float = 0.5) -> Rays:
    angle = math.radians(angle_deg)
    at, towards = (-math.sin(angle), -math.cos(angle)), (math.sin(angle), math.cos(angle))
    return Rays((at,), (towards,), s_share=s_share, spectrum=((NM, 1.0),))


def plate(
    source: Source, surface: Surface, below: float = 1.0, above: float = 1.0, behaviour: Behaviour = "refracting"
) -> Scene:
    """Return an interface along x inside a square of receivers, ``up`` on its left and ``down`` on its right."""
    half = 1000.0
    corners = [(-half, 0.0), (-half, -half), (half, -half), (half, 0.0), (half, half), (-half, half), (-half, 0.0)]
    sides = [
        Interface(
            f"far{i}", Segment(a, b), "below" if i < 3 else "above", "outside", "receiver", "down" if i < 3 else "up"
        )
        for i, (a, b) in enumerate(pairwise(corners))
    ]
    line = Interface("line", Segment((-half, 0.0), (half, 0.0)), "above", "below", behaviour, surface=surface)
    regions = (Region("below", below), Region("above", above), Region("outside", 1.0))
    return Scene(regions, (line, *sides), (source,))


def up_down_absorbed(scene: Scene) -> tuple[float, float, float]:
    result = trace(scene, "power", Limits(min_weight=1e-9))
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    return result.detectors["up"].power, result.detectors["down"].power, result.ledger.absorbed


@pytest.mark.parametrize("s_share", [0.0, 1.0])
@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 56.0, 80.0])
def test_fresnel_table_agrees_with_bare_surface(angle_deg: float, s_share: float) -> None:
    outside, inside = fresnel_table(1.0, GLASS), fresnel_table(GLASS, 1.0)
    for n1, n2, left, right in ((1.0, GLASS, inside, outside), (GLASS, 1.0, outside, inside)):
        table = up_down_absorbed(plate(ray(angle_deg, s_share), Surface(table=left, table_right=right), n1, n2))
        bare = up_down_absorbed(plate(ray(angle_deg, s_share), Surface(), n1, n2))
        assert table == pytest.approx(bare, abs=1e-5)


def test_table_is_interpolated_linearly() -> None:
    table = AngleTable((0.0, 30.0, 90.0), (0.1, 0.4, 0.4), (0.8, 0.5, 0.0))
    surface = Surface(table=table, table_right=table)
    assert up_down_absorbed(plate(ray(12.0), surface)) == pytest.approx((0.68, 0.22, 0.1), abs=1e-12)
    assert up_down_absorbed(plate(ray(60.0), surface)) == pytest.approx((0.25, 0.4, 0.35), abs=1e-12)


def test_table_reflects_its_transmitted_fraction_above_the_critical_angle() -> None:
    surface = Surface(table=flat(0.2, 0.7), table_right=flat(0.2, 0.7))
    assert up_down_absorbed(plate(ray(CRITICAL_DEG + 0.1), surface, GLASS, 1.0)) == pytest.approx((0.0, 0.9, 0.1))
    assert up_down_absorbed(plate(ray(CRITICAL_DEG - 0.1), surface, GLASS, 1.0)) == pytest.approx((0.7, 0.2, 0.1))


def bar(surface: Surface | None, source: Source | None = None) -> Scene:
    """Return a bar in space whose walls have a surface, with a chip in front of it."""
    chip = Emitter((0.0, -1.0), 0.0, 2**13, cone_deg=120.0, width_mm=0.2, height_mm=0.2, spectrum=((NM, 1.0),))
    corners = [(-2.0, 0.0), (2.0, 0.0), (2.0, 12.0), (-2.0, 12.0), (-2.0, 0.0)]
    sides = [Segment(a, b) for a, b in pairwise(corners)]
    names = ("front", "right", "end", "left")
    interfaces = tuple(
        Interface(name, side, "bar", "air", "receiver", "end")
        if name == "end"
        else Interface(name, side, "bar", "air", surface=surface)
        for name, side in zip(names, sides, strict=True)
    )
    return Scene((Region("air", 1.0), Region("bar", 1.3)), interfaces, (source or chip,), extrusion=Extrusion(3.0))


def test_table_in_space_is_sampled_and_integrated() -> None:
    """For skew rays, too, a table of Fresnel's reflectances agrees with the bare surface."""
    surface = Surface(table=fresnel_table(1.3, 1.0, 4000), table_right=fresnel_table(1.0, 1.3, 4000))
    sampled = [trace(bar(s), "power", sampling="sobol", seed=3).detectors["end"].power for s in (surface, None)]
    # the table has no phases, which affect the polarisation at later surfaces
    assert sampled[0] == pytest.approx(sampled[1], abs=3e-4)
    integral = integrate(bar(surface), tolerance=1e-4)
    assert abs(integral.detectors["end"].power - sampled[0]) < 5e-3
    assert integral.detectors["end"].u_power < 1e-3


def test_table_in_the_plane_is_integrated() -> None:
    fan = Fan((0.0, -1.0), 0.0, 120.0, 101, spectrum=((NM, 1.0),))
    tables = Surface(table=fresnel_table(GLASS, 1.0), table_right=fresnel_table(1.0, GLASS))
    powers = [integrate(plate(fan, s, 1.0, GLASS)).detectors["up"].power for s in (tables, Surface())]
    assert powers[0] == pytest.approx(powers[1], abs=1e-5)


def test_constant_table_is_a_grey_mirror() -> None:
    grey, table = Surface(reflectance=0.7), Surface(table=flat(0.7))
    for extrusion in (None, Extrusion(50.0)):
        scenes = (replace(plate(ray(40.0), s, behaviour="mirror"), extrusion=extrusion) for s in (grey, table))
        powers = [trace(scene, "power").detectors["down"].power for scene in scenes]
        assert powers == pytest.approx([0.7, 0.7], abs=1e-12)


@pytest.mark.parametrize("angle_deg", [0.0, 25.0])
def test_scattered_light_has_the_tabulated_profile(angle_deg: float) -> None:
    """The Kolmogorov–Smirnov distance between the sines of the rays and the table is small enough."""
    n, table = 20_000, ScatterTable((0.0, 0.05, 0.3, 1.2), (5.0, 3.0, 0.4, 0.0))
    source = ray(angle_deg)
    many = replace(source, origins=source.origins * n, directions=source.directions * n)
    segments = trace(plate(many, Surface(scatter=table)), "count", segments=True, seed=3).segments
    assert segments is not None
    drawn = np.sort(segments["dx"][segments["hit"] == 1])
    x = np.linspace(-1.0, 1.0, 40_001)
    density = np.interp(np.abs(x - math.sin(math.radians(angle_deg))), table.offset, table.density, right=0.0)
    cumulative = np.cumsum(density) / density.sum()
    assert np.abs(np.interp(drawn, x, cumulative) - (np.arange(n) + 0.5) / n).max() < 1.95 / math.sqrt(n)


ORDERS = ((0, 0.3), (1, 0.25), (-1, 0.2), (2, 0.05))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("upwards", [True, False])
def test_diffraction_orders_obey_the_grating_equation(upwards: bool, mirrored: bool) -> None:
    """The angle of each order is exact, its power within four standard errors; the remaining power is absorbed."""
    n, lines = 20_000, 500.0
    n1, n2 = (1.0, GLASS) if upwards else (GLASS, 1.0)
    angle = math.radians(20.0)
    sign = 1.0 if upwards else -1.0
    start: Point = (-math.sin(angle), -sign * math.cos(angle))
    direction: Point = (math.sin(angle), sign * math.cos(angle))
    source = Rays((start,) * n, (direction,) * n, spectrum=((NM, 1.0),))
    surface = Surface(grating=Grating(lines, ORDERS, mirrored))
    scene = plate(source, surface, 1.0, GLASS, behaviour="grating")
    result = trace(scene, "power", segments=True, seed=5)
    assert result.segments is not None
    assert result.ledger.absorbed == pytest.approx(0.2, abs=1e-12)
    index = n1 if mirrored else n2
    segments = result.segments[result.segments["hit"] == 1]
    for order, efficiency in ORDERS:
        sine = (n1 * math.sin(angle) + sign * order * NM * 1e-6 * lines) / index
        diffracted = segments[np.abs(segments["dx"] - sine) < 1e-9]
        assert np.all((diffracted["dz"] > 0.0) == (upwards != mirrored))
        power = float((diffracted["power_s"] + diffracted["power_p"]).sum())
        assert power == pytest.approx(efficiency, abs=4.0 * math.sqrt(efficiency * 0.8 / n)), order


def test_power_of_evanescent_orders_is_absorbed() -> None:
    surface = Surface(grating=Grating(1500.0, ((0, 0.4), (1, 0.3), (-1, 0.3))))
    scene = plate(ray(40.0), surface, behaviour="grating")
    assert up_down_absorbed(scene) == pytest.approx((0.7, 0.0, 0.3), abs=1e-12)  # sin 40° + 0.9 is above 1
    assert trace_reference(scene, "power").detectors["up"].power == pytest.approx(0.7, abs=1e-12)


def test_json_round_trip_of_tables_profiles_and_gratings() -> None:
    surface = Surface(
        table=AngleTable((0.0, 45.0, 90.0), (0.1, 0.2, 1.0), (0.5, 0.5, 0.0)),
        table_right=flat(0.5, 0.25),
        scatter=ScatterTable((0.0, 1.0), (1.0, 0.5), 0.3),
    )
    grating = Surface(grating=Grating(600.0, ORDERS, mirrored=True))
    for scene in (plate(ray(3.0), surface), plate(ray(3.0), grating, behaviour="grating")):
        assert loads(dumps(scene)) == scene


UNSUPPORTED: list[tuple[dict[str, object], str]] = [
    ({"behaviour": "grating"}, r"surface\.grating; is required"),
    ({"surface": Surface(grating=Grating(100.0, ORDERS))}, r"surface\.grating; does not apply"),
    ({"behaviour": "absorbing", "surface": Surface(table=flat(0.5))}, r"surface\.table; does not apply.*absorbing"),
    ({"behaviour": "mirror", "surface": Surface(table=flat(0.5, 0.2))}, "mirror cannot transmit"),
    ({"surface": Surface(table=flat(0.5, 0.2)), "right": "glass"}, "two sides"),
]


@pytest.mark.parametrize(("fields", "message"), UNSUPPORTED)
def test_refuses_surface_that_the_interface_does_not_support(fields: dict[str, object], message: str) -> None:
    side = Interface("side", Segment((0.0, 0.0), (1.0, 0.0)), "air", "air")
    with pytest.raises(DesignError, match=message):
        Scene((Region("air", 1.0), Region("glass", GLASS)), (replace(side, **fields),), (ray(0.0),), open_media=True)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("angles", "reflected", "message"),
    [
        ((0.0, 80.0), (0.1, 0.1), "0 to 90"),
        ((5.0, 90.0), (0.1, 0.1), "0 to 90"),
        ((0.0, 50.0, 50.0, 90.0), (0.1,) * 4, "ascend"),
        ((0.0, 90.0), (0.1,), "1 value, but must have 2, one for each angle"),
        ((0.0, 90.0), (0.1, 1.1), "reflected"),
    ],
)
def test_refuses_invalid_table(angles: tuple[float, ...], reflected: tuple[float, ...], message: str) -> None:
    with pytest.raises(DesignError, match=message):
        AngleTable(angles, reflected)


def test_refuses_other_invalid_tables() -> None:
    with pytest.raises(DesignError, match=r"90 deg.*at most 1"):
        AngleTable((0.0, 90.0), (0.5, 0.6), (0.5, 0.5))
    with pytest.raises(DesignError, match="table_right; requires"):
        Surface(table_right=flat(0.5))
    with pytest.raises(DesignError, match="above 0 for at least one"):
        ScatterTable((0.0, 1.0), (0.0, 0.0))


def test_refuses_efficiencies_above_1() -> None:
    scene = plate(ray(0.0), Surface(grating=Grating(100.0, ((0, 1.0), (1, 0.5)))), behaviour="grating")
    with pytest.raises(DesignError, match=r"efficiencies .* 1\.5"):
        trace(scene, "power")


def test_refuses_gratings_in_space_in_integrals_and_without_wavelengths() -> None:
    scene = plate(ray(0.0), Surface(grating=Grating(100.0, ORDERS)), behaviour="grating")
    with pytest.raises(DesignError, match="only in the plane"):
        trace(replace(scene, extrusion=Extrusion(2.0)), "power")
    with pytest.raises(DesignError, match="scatters"):
        integrate(scene)
    with pytest.raises(DesignError, match="wavelength"):
        replace(scene, sources=(replace(scene.sources[0], spectrum=()),))
