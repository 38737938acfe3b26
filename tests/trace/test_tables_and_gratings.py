"""Surfaces by measured tables, and gratings, against closed forms: shares, profiles, angles of orders."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from solen.curve import Segment
from solen.errors import DesignError
from solen.interface import fresnel
from solen.plane import Point
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


def of_fresnel(n1: float, n2: float, steps: int = 2000) -> AngleTable:
    """Fresnel's shares as a lab would state them: by the true angle, total reflection included."""
    angle_deg = tuple(np.linspace(0.0, 90.0, steps + 1).tolist())
    whole = [math.sin(math.radians(a)) * n1 >= n2 or a == 90.0 for a in angle_deg]
    shares = [fresnel(math.cos(math.radians(0.0 if w else a)), n1, n2) for a, w in zip(angle_deg, whole, strict=True)]
    s, p = (tuple(1.0 if w else f for w, f in zip(whole, c, strict=True)) for c in zip(*shares, strict=True))
    return AngleTable(angle_deg, s, tuple(1.0 - x for x in s), p, tuple(1.0 - x for x in p))


def flat(reflected: float, transmitted: float = 0.0) -> AngleTable:
    return AngleTable((0.0, 90.0), (reflected,) * 2, (transmitted,) * 2 if transmitted else ())


def ray(angle_deg: float, s_share: float = 0.5) -> Rays:
    angle = math.radians(angle_deg)
    at, towards = (-math.sin(angle), -math.cos(angle)), (math.sin(angle), math.cos(angle))
    return Rays((at,), (towards,), s_share=s_share, spectrum=((NM, 1.0),))


def plate(
    source: Source, surface: Surface, below: float = 1.0, above: float = 1.0, behaviour: Behaviour = "refracting"
) -> Scene:
    """An interface along x with receivers far above and below it; its left is above."""
    far = 1000.0
    corners = [(-far, 0.0), (-far, -far), (far, -far), (far, 0.0), (far, far), (-far, far), (-far, 0.0)]
    sides = [
        Interface(
            f"far{i}", Segment(a, b), "below" if i < 3 else "above", "outside", "receiver", "down" if i < 3 else "up"
        )
        for i, (a, b) in enumerate(pairwise(corners))
    ]
    line = Interface("line", Segment((-far, 0.0), (far, 0.0)), "above", "below", behaviour, surface=surface)
    regions = (Region("below", below), Region("above", above), Region("outside", 1.0))
    return Scene(regions, (line, *sides), (source,))


def up_down_absorbed(scene: Scene) -> tuple[float, float, float]:
    found = trace(scene, "power", Limits(min_weight=1e-9))
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
    return found.detectors["up"].power, found.detectors["down"].power, found.ledger.absorbed


@pytest.mark.parametrize("s_share", [0.0, 1.0])
@pytest.mark.parametrize("angle_deg", [0.0, 20.0, 56.0, 80.0])
def test_a_table_gives_its_shares_at_the_angle_of_incidence(angle_deg: float, s_share: float) -> None:
    outside, inside = of_fresnel(1.0, GLASS), of_fresnel(GLASS, 1.0)
    for n1, n2, right in ((1.0, GLASS, outside), (GLASS, 1.0, inside)):
        table = Surface(table=inside if right is outside else outside, table_right=right)
        found = up_down_absorbed(plate(ray(angle_deg, s_share), table, n1, n2))
        bare = up_down_absorbed(plate(ray(angle_deg, s_share), Surface(), n1, n2))
        assert found == pytest.approx(bare, abs=1e-5)


def test_shares_between_two_angles_are_linear_in_the_angle() -> None:
    table = AngleTable((0.0, 30.0, 90.0), (0.1, 0.4, 0.4), (0.8, 0.5, 0.0))
    surface = Surface(table=table, table_right=table)
    assert up_down_absorbed(plate(ray(12.0), surface)) == pytest.approx((0.68, 0.22, 0.1), abs=1e-12)
    assert up_down_absorbed(plate(ray(60.0), surface)) == pytest.approx((0.25, 0.4, 0.35), abs=1e-12)


def test_where_no_light_can_go_on_what_the_table_transmits_is_reflected() -> None:
    surface = Surface(table=flat(0.2, 0.7), table_right=flat(0.2, 0.7))
    assert up_down_absorbed(plate(ray(CRITICAL_DEG + 0.1), surface, GLASS, 1.0)) == pytest.approx((0.0, 0.9, 0.1))
    assert up_down_absorbed(plate(ray(CRITICAL_DEG - 0.1), surface, GLASS, 1.0)) == pytest.approx((0.7, 0.2, 0.1))


def bar(surface: Surface | None, source: Source | None = None) -> Scene:
    """A bar of glass in space with walls of this surface and a chip before it."""
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


def test_in_space_a_table_counts_by_the_true_angle_sampled_and_integrated() -> None:
    """A table of Fresnel's shares is the bare surface over again: with skew rays, by both ways of computing."""
    surface = Surface(table=of_fresnel(1.3, 1.0, 4000), table_right=of_fresnel(1.0, 1.3, 4000))
    sampled = [trace(bar(s), "power", sampling="sobol", seed=3).detectors["end"].power for s in (surface, None)]
    # the table has no phases, which change what a few later surfaces make of the polarisation
    assert sampled[0] == pytest.approx(sampled[1], abs=3e-4)
    found = integrate(bar(surface), tolerance=1e-4)
    assert abs(found.detectors["end"].power - sampled[0]) < 5e-3
    assert found.detectors["end"].u_power < 1e-3


def test_in_the_plane_a_table_can_be_integrated() -> None:
    lamp = Fan((0.0, -1.0), 0.0, 120.0, 101, spectrum=((NM, 1.0),))
    tables = Surface(table=of_fresnel(GLASS, 1.0), table_right=of_fresnel(1.0, GLASS))
    found = [integrate(plate(lamp, s, 1.0, GLASS)).detectors["up"].power for s in (tables, Surface())]
    assert found[0] == pytest.approx(found[1], abs=1e-5)


def test_a_flat_table_is_a_grey_mirror() -> None:
    grey, table = Surface(reflectance=0.7), Surface(table=flat(0.7))
    for extrusion in (None, Extrusion(50.0)):
        scenes = (replace(plate(ray(40.0), s, behaviour="mirror"), extrusion=extrusion) for s in (grey, table))
        powers = [trace(scene, "power").detectors["down"].power for scene in scenes]
        assert powers == pytest.approx([0.7, 0.7], abs=1e-12)


@pytest.mark.parametrize("angle_deg", [0.0, 25.0])
def test_what_is_scattered_has_the_tabulated_profile(angle_deg: float) -> None:
    """Sines of single rays against the integral of the table, by the greatest distance of both distributions."""
    n, table = 20_000, ScatterTable((0.0, 0.05, 0.3, 1.2), (5.0, 3.0, 0.4, 0.0))
    source = ray(angle_deg)
    many = replace(source, origins=source.origins * n, directions=source.directions * n)
    found = trace(plate(many, Surface(scatter=table)), "count", legs=True, seed=3)
    assert found.legs is not None
    drawn = np.sort(found.legs["dx"][found.legs["hit"] == 1])
    x = np.linspace(-1.0, 1.0, 40_001)
    density = np.interp(np.abs(x - math.sin(math.radians(angle_deg))), table.offset, table.density, right=0.0)
    whole = np.cumsum(density) / density.sum()
    assert np.abs(np.interp(drawn, x, whole) - (np.arange(n) + 0.5) / n).max() < 1.95 / math.sqrt(n)


ORDERS = ((0, 0.3), (1, 0.25), (-1, 0.2), (2, 0.05))


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("upwards", [True, False])
def test_orders_leave_by_the_grating_equation(upwards: bool, mirrored: bool) -> None:
    """From glass into air or back: each order's angle in closed form, its power within chance; what is left is lost."""
    n, lines = 40_000, 500.0
    n1, n2 = (1.0, GLASS) if upwards else (GLASS, 1.0)
    angle = math.radians(20.0)
    way = 1.0 if upwards else -1.0
    at: Point = (-math.sin(angle), -way * math.cos(angle))
    towards: Point = (math.sin(angle), way * math.cos(angle))
    source = Rays((at,) * n, (towards,) * n, spectrum=((NM, 1.0),))
    surface = Surface(grating=Grating(lines, ORDERS, mirrored))
    scene = plate(source, surface, 1.0, GLASS, behaviour="grating")
    found = trace(scene, "power", legs=True, seed=5)
    assert found.legs is not None
    assert found.ledger.absorbed == pytest.approx(0.2, abs=1e-12)
    after = n1 if mirrored else n2
    legs = found.legs[found.legs["hit"] == 1]
    right = way  # of the light's way: +x as it goes up
    for order, share in ORDERS:
        sine = (n1 * math.sin(angle) + right * order * NM * 1e-6 * lines) / after
        leaving = legs[np.abs(legs["dx"] - sine) < 1e-9]
        assert np.all((leaving["dz"] > 0.0) == (upwards != mirrored))
        power = float((leaving["power_s"] + leaving["power_p"]).sum())
        assert power == pytest.approx(share, abs=4.0 * math.sqrt(share * 0.8 / n)), order


def test_what_belongs_to_an_order_that_does_not_propagate_is_absorbed() -> None:
    surface = Surface(grating=Grating(1500.0, ((0, 0.4), (1, 0.3), (-1, 0.3))))
    scene = plate(ray(40.0), surface, behaviour="grating")
    found = up_down_absorbed(scene)
    assert found == pytest.approx((0.7, 0.0, 0.3), abs=1e-12)  # to the right sin 40° + 0.9 is above 1
    (direct,) = trace_reference(scene, "power").detectors["up"].power_by_source
    assert direct == pytest.approx(0.7, abs=1e-12)


def test_tables_profiles_and_gratings_are_kept_in_a_scene_file() -> None:
    surface = Surface(
        table=AngleTable((0.0, 45.0, 90.0), (0.1, 0.2, 1.0), (0.5, 0.5, 0.0)),
        table_right=flat(0.5, 0.25),
        scatter=ScatterTable((0.0, 1.0), (1.0, 0.5), 0.3),
    )
    ruled = Surface(grating=Grating(600.0, ORDERS, mirrored=True))
    for scene in (plate(ray(3.0), surface), plate(ray(3.0), ruled, behaviour="grating")):
        assert loads(dumps(scene)) == scene


REFUSED: list[tuple[dict[str, object], str]] = [
    ({"behaviour": "grating"}, "surface.grating applies only to gratings"),
    ({"surface": Surface(grating=Grating(100.0, ORDERS))}, "surface.grating applies only to gratings"),
    ({"behaviour": "absorbing", "surface": Surface(table=flat(0.5))}, "absorbing.*cannot have a table"),
    ({"behaviour": "mirror", "surface": Surface(table=flat(0.5, 0.2))}, "mirror cannot transmit"),
    ({"surface": Surface(table=flat(0.5, 0.2)), "right": "glass"}, "two sides"),
]


@pytest.mark.parametrize(("fields", "limit"), REFUSED)
def test_a_surface_that_its_interface_cannot_have_is_refused(fields: dict[str, object], limit: str) -> None:
    side = Interface("side", Segment((0.0, 0.0), (1.0, 0.0)), "air", "air")
    with pytest.raises(DesignError, match=limit):
        Scene((Region("air", 1.0), Region("glass", GLASS)), (replace(side, **fields),), (ray(0.0),), open_media=True)  # type: ignore[arg-type]


def test_tables_that_are_none_are_refused() -> None:
    for angles, shares, limit in (
        ((0.0, 80.0), (0.1, 0.1), "0 to 90"),
        ((5.0, 90.0), (0.1, 0.1), "0 to 90"),
        ((0.0, 50.0, 50.0, 90.0), (0.1,) * 4, "ascend"),
        ((0.0, 90.0), (0.1,), "one number for each of 2"),
        ((0.0, 90.0), (0.1, 1.1), "reflected"),
    ):
        with pytest.raises(DesignError, match=limit):
            AngleTable(angles, shares)
    with pytest.raises(DesignError, match=r"at most 1, also at 90 deg"):
        AngleTable((0.0, 90.0), (0.5, 0.6), (0.5, 0.5))
    with pytest.raises(DesignError, match="table for the left"):
        Surface(table_right=flat(0.5))
    with pytest.raises(DesignError, match="above 0 for at least one"):
        ScatterTable((0.0, 1.0), (0.0, 0.0))


def test_orders_of_more_power_than_arrives_and_gratings_in_space_are_refused() -> None:
    bright = plate(ray(0.0), Surface(grating=Grating(100.0, ((0, 1.0), (1, 0.5)))), behaviour="grating")
    with pytest.raises(DesignError, match=r"sum of 1\.5"):
        trace(bright, "power")
    ruled = plate(ray(0.0), Surface(grating=Grating(100.0, ORDERS)), behaviour="grating")
    with pytest.raises(DesignError, match="gratings are supported only in the plane"):
        trace(replace(ruled, extrusion=Extrusion(2.0)), "power")
    with pytest.raises(DesignError, match="a scene that scatters"):
        integrate(ruled)
    with pytest.raises(DesignError, match="a grating needs wavelengths"):
        replace(ruled, sources=(replace(ruled.sources[0], spectrum=()),))
