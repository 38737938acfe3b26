"""Scenes in the format of ray-optics, of our own making: overlaps, places of rays, what is unknown, what is refused."""

import itertools
import json
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.curve import Arc, Bezier, Segment, Spline
from solen.errors import DataError, DesignError
from solen.plane import Point
from solen.scene import Fan, Interface, Scene, rayoptics
from solen.scene.rayoptics.arrangement import Element, Glass, arranged
from solen.scene.rayoptics.formula_curves import fitted
from solen.scene.rayoptics.seedrandom import drawn
from solen.trace import RoundRobin, trace, trace_round_robin

Json = dict[str, Any]
LAMP: Json = {"type": "SingleRay", "p1": {"x": 0, "y": 0}, "p2": {"x": 1, "y": 0}}


def text(*objects: Json, **settings: Any) -> str:
    return json.dumps({"version": 5, "objs": [*objects], **settings})


def scene(*objects: Json, facets: bool = False, **settings: Any) -> rayoptics.Imported:
    return rayoptics.loads(text(*objects, **settings), facets=facets)


def point(x: float, y: float) -> Json:
    return {"x": x, "y": y}


def polygon(*corners: Point, **more: Any) -> Json:
    return {"type": "Glass", "path": [{**point(x, y), "arc": False} for x, y in corners], **more}


def circle(x: float, y: float, radius: float, **more: Any) -> Json:
    return {"type": "CircleGlass", "p1": point(x, y), "p2": point(x + radius, y), **more}


def sides(interface: Interface) -> tuple[Point, Point]:
    """Points just left and right of an interface, some way along it."""
    x, z = interface.curve.points(np.array([0.457]))[0].tolist()
    normal = interface.curve.normal_at((x, z))
    left, right = ((x + way * 1e-4 * normal[0], z + way * 1e-4 * normal[1]) for way in (1.0, -1.0))
    return left, right


@pytest.mark.parametrize("seed", range(12))
def test_overlapping_glasses_multiply_and_all_media_are_closed(seed: int) -> None:
    """Random circles and triangles: on both sides of each interface the product of what holds the point there."""
    chance = random.Random(seed)  # noqa: S311  shapes, not secrets
    shapes: list[Any] = []
    objects: list[Json] = [LAMP]
    for index in (1.1, 1.3, 1.7, 1.9):
        if chance.random() < 0.5:
            x, y, r = chance.uniform(-20, 20), chance.uniform(-20, 20), chance.uniform(5, 25)
            shapes.append((index, lambda p, x=x, y=y, r=r: math.hypot(p[0] - x, p[1] + y) < r))
            objects.append(circle(x, y, r, refIndex=index))
        else:
            corners = [(chance.uniform(-40, 40), chance.uniform(-40, 40)) for _ in range(3)]
            shapes.append((index, lambda p, c=corners: in_triangle(p, [(x, -y) for x, y in c])))
            objects.append(polygon(*corners, refIndex=index))
    imported = scene(*objects)
    found = {region.name: region.index for region in imported.scene.regions}
    assert len(imported.scene.interfaces) >= 4
    for interface in imported.scene.interfaces:
        for side, at in zip((interface.left, interface.right), sides(interface), strict=True):
            expected = math.prod(index for index, holds in shapes if holds(at))
            assert found[side] == pytest.approx(expected, rel=1e-12)
    closed = Scene(imported.scene.regions, imported.scene.interfaces, imported.scene.sources)
    assert closed.open_media is False  # the scene's own check of closed media passed


def in_triangle(p: Point, corners: list[Point]) -> bool:
    signs = [
        (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    return all(s > 0 for s in signs) or all(s < 0 for s in signs)


def test_edges_that_coincide_are_one_surface() -> None:
    """Two squares side by side: one surface between them, from glass to glass; none where the same glass is."""
    left = polygon((0, 0), (10, 0), (10, 10), (0, 10), refIndex=1.5)
    right = polygon((10, -5), (20, -5), (20, 15), (10, 15), refIndex=1.25)
    found = scene(LAMP, left, right).scene
    between = [i for i in found.interfaces if {i.left, i.right} == {"glass1", "glass2"}]
    assert len(between) == 1
    assert isinstance(between[0].curve, Segment)
    assert between[0].curve.length_mm == pytest.approx(10.0)
    assert len(found.interfaces) == 3 + 1 + 3 + 2


def test_a_slit_to_a_hole_is_no_surface() -> None:
    ring = polygon((0, 0), (0, 10), (10, 10), (10, 0), (5, 0), (5, 3), (7, 3), (7, 7), (3, 7), (3, 3), (5, 3), (5, 0))
    found = scene(LAMP, ring).scene
    assert not [i for i in found.interfaces if i.curve.middle_point == pytest.approx((5.0, -1.5))]
    assert {(i.left, i.right) for i in found.interfaces} <= {("air", "glass1"), ("glass1", "air")}


def test_an_outline_that_crosses_itself_holds_what_is_surrounded_once() -> None:
    star = [(10 * math.cos(0.8 * math.pi * k), 10 * math.sin(0.8 * math.pi * k)) for k in range(5)]
    found = scene(LAMP, polygon(*star)).scene
    assert len(found.interfaces) == 15  # five points of three stretches each; the middle is air
    Scene(found.regions, found.interfaces, found.sources)  # refuses media that are not closed


def test_a_wall_on_an_edge_of_glass_takes_the_light_there() -> None:
    square = polygon((5, -10), (25, -10), (25, 10), (5, 10))
    wall = {"type": "Blocker", "p1": point(5, -4), "p2": point(5, 4)}
    found = scene(LAMP, square, wall).scene
    (black,) = [i for i in found.interfaces if i.behaviour == "absorbing"]
    assert {black.left, black.right} == {"air", "glass1"}
    assert trace(found, "power").ledger.absorbed == 1.0


def test_dispersion_of_overlapping_glasses_is_the_product() -> None:
    a, b = circle(0, 0, 10, refIndex=1.5, cauchyB=0.004), circle(5, 0, 10, refIndex=1.2, cauchyB=0.01)
    found = {region.name: region for region in scene(LAMP, a, b, simulateColors=True).scene.regions}
    for wavelength_nm in (400.0, 700.0):
        index = [found[name].index_at(wavelength_nm) for name in ("circleglass1", "circleglass2")]
        assert index[0] == pytest.approx(1.5 + 0.004 / (wavelength_nm * 1e-3) ** 2)
        assert found["circleglass1*circleglass2"].index_at(wavelength_nm) == pytest.approx(math.prod(index), rel=1e-12)


def test_a_glass_drawn_the_wrong_way_is_glass_outside() -> None:
    """As ray-optics has it: a parametric outline counts how it is walked."""
    piece = {"eqnX": r"10\cos(t)", "eqnY": r"-10\sin(t)", "tMin": 0, "tMax": math.tau, "tStep": 0.01}
    with pytest.raises(DesignError, match=r"paramglass1\^-1.*at least 1"):
        scene(LAMP, {"type": "ParamGlass", "pieces": [piece]})


def test_a_beam_is_placed_by_the_density() -> None:
    beam = {"type": "Beam", "p1": point(0, 0), "p2": point(0, 10), "brightness": 0.3}
    (source,) = scene(beam, rayModeDensity=0.5).scene.sources
    launch = source.launch()
    np.testing.assert_allclose(launch.z_mm, [-1.0, -3.0, -5.0, -7.0, -9.0])
    np.testing.assert_allclose(launch.dx, 1.0)
    np.testing.assert_allclose(launch.power_s + launch.power_p, 0.6)
    (bright,) = scene({**beam, "brightness": 3}, rayModeDensity=0.5).scene.sources
    np.testing.assert_allclose(bright.launch().power_s, 0.5)  # no ray is brighter than 1
    (correct,) = scene({**beam, "brightness": 3}, rayModeDensity=0.5, colorMode="linear").scene.sources
    assert correct.power == pytest.approx(3.0 * 10.0, rel=0.05)
    assert correct.power / correct.rays <= 1.0


def test_colours_are_lines_and_filters_bands() -> None:
    mirror = {"type": "Mirror", "p1": point(5, -5), "p2": point(5, 5), "filter": True, "wavelength": 500}
    detector = {"type": "Detector", "p1": point(9, -5), "p2": point(9, 5), "name": "behind"}
    for wavelength, invert, passes in ((505, False, 0), (515, False, 1), (505, True, 1), (515, True, 0)):
        lamp = {**LAMP, "wavelength": wavelength}
        found = scene(lamp, {**mirror, "invert": invert}, detector, simulateColors=True)
        result = trace_round_robin(found.scene, RoundRobin(found.weak, found.weakest, found.fresh))
        assert abs(found.readings(result.monitors)["behind"].power) == passes
    assert trace(scene(LAMP, mirror, detector).scene, "power").monitors["behind"].power == 0.0  # no colours, no filter


def test_lens_and_mirror_focus_where_they_say() -> None:
    """Parallel rays meet at the focus, whatever their height."""
    beam = {"type": "Beam", "p1": point(0, -8), "p2": point(0, 8)}
    for kind, focus in (("IdealLens", 40.0), ("IdealMirror", 0.0)):
        ideal = {"type": kind, "p1": point(20, -10), "p2": point(20, 10), "focalLength": 20}
        found = scene(beam, ideal, rayModeDensity=1).scene
        for path in trace(found, "power", legs=True).paths():
            (x, z), (dx, dz) = path.points_mm[-1], path.exit_direction or (0.0, 0.0)
            assert z + dz * (focus - x) / dx == pytest.approx(0.0, abs=1e-12)


def test_detectors_are_named_and_cut_into_bins() -> None:
    plain = {"type": "Detector", "p1": point(5, -3.5), "p2": point(5, 3.5)}
    named = {**plain, "p1": point(6, -3.5), "p2": point(6, 3.5), "irradMap": True, "binSize": 2, "name": "screen"}
    found = scene(LAMP, plain, named, {**plain, "p1": point(7, 9), "p2": point(7, 5)})
    assert [one.name for one in found.detectors] == ["detector1", "screen", "detector3"]
    readings = found.readings(trace(found.scene, "power").monitors)
    assert readings["detector1"].power == 1.0
    assert readings["screen"].position is not None
    assert readings["screen"].irradiance is not None
    np.testing.assert_allclose(readings["screen"].position, [0.0, 2.0, 4.0, 6.0])
    np.testing.assert_allclose(readings["screen"].irradiance, [0.0, 0.5, 0.0, 0.0])
    assert readings["detector1"].irradiance is None


def test_a_circle_by_a_formula_is_a_circle_and_a_parabola_one_cubic() -> None:
    ball = {
        "type": "CustomGlass",
        "p1": point(0, 0),
        "p2": point(20, 0),
        "eqn1": r"-\sqrt{1-x^2}",
        "eqn2": r"\sqrt{1-x^2}",
    }
    bowl = {"type": "CustomMirror", "p1": point(40, 0), "p2": point(60, 0), "eqn": "0.5x^2"}
    wavy = {"type": "CustomMirror", "p1": point(80, 0), "p2": point(99, 0), "eqn": r"0.1\sin(20x)"}
    found = scene(LAMP, ball, bowl, wavy).scene
    kinds = {i.name.split(".")[0]: type(i.curve) for i in found.interfaces}
    assert kinds == {"customglass1": Arc, "custommirror1": Bezier, "custommirror2": Spline}
    assert all(i.curve.radius_mm == pytest.approx(10.0) for i in found.interfaces if isinstance(i.curve, Arc))


def test_a_fitted_curve_keeps_its_tolerance() -> None:
    (curve,) = fitted(lambda t: (10.0 * t, math.exp(math.sin(5.0 * t))), -1.0, 1.0, "it")
    points = curve.points(np.linspace(0.0, 1.0, 5001))
    assert np.abs(points[:, 1] - np.exp(np.sin(0.5 * points[:, 0]))).max() < 20.0 * 1e-6


def test_a_jump_is_bridged() -> None:
    curves = fitted(lambda t: (t, math.floor(t)), -1.0, 0.5, "it")
    assert all(isinstance(curve, Segment) for curve in curves)
    assert all(a.end == b.start for a, b in itertools.pairwise(curves))
    assert curves[-1].end == (0.5, 0.0)


def test_facets_follow_their_curve() -> None:
    """Hits of a polyline lie on its curve but for the sagitta; so do its normals."""
    piece = {"eqnX": r"10\cos(t)", "eqnY": r"10\sin(t)", "tMin": 0, "tMax": math.tau, "tStep": 0.01}
    glass = {"type": "ParamGlass", "pieces": [piece]}
    smooth, facets = (scene(LAMP, glass, facets=way).scene.interfaces[0].curve for way in (False, True))
    lines = scene(LAMP, glass, facets=True).scene.interfaces
    assert {i.left for i in lines} == {"paramglass1"}
    for angle in np.linspace(0.1, 6.0, 23):
        direction = (math.cos(angle), math.sin(angle))
        (hit,) = [t for i in lines for t in i.curve.hits((1.0, 2.0), direction)]
        (exact,) = smooth.hits((1.0, 2.0), direction)
        assert hit == pytest.approx(exact, abs=10.0 * 0.01**2)
        at = (1.0 + hit * direction[0], 2.0 + hit * direction[1])
        holding = next(i.curve for i in lines if i.curve.hits((1.0, 2.0), direction))
        np.testing.assert_allclose(holding.normal_at(at), smooth.normal_at(at), atol=1e-4)
    back = facets.reversed()
    np.testing.assert_allclose([back.start, back.end], [facets.end, facets.start])


def test_seeded_numbers_are_those_of_the_peer() -> None:
    """First numbers of seedrandom('hello.') as its documentation gives them."""
    numbers = drawn("hello.")
    assert next(numbers) == pytest.approx(0.9282578795792454, abs=1e-15)
    assert next(numbers) == pytest.approx(0.3752569768646784, abs=1e-15)


def test_what_is_unknown_is_reported_and_the_rest_is_read() -> None:
    found = scene(
        LAMP,
        {"type": "GrinGlass", "path": []},
        {"type": "Mirror", "p1": point(5, -1), "p2": point(5, 1), "shiny": True},
        {"type": "Mirror", "p1": point(5, -1)},
        {"type": "CircleGlass", "p1": point(0, 0), "p2": point(1, 0), "refIndex": "high"},
        {"type": "CustomMirror", "p1": point(0, 3), "p2": point(1, 3), "eqn": "x.real"},
        {"type": "ModuleObj", "module": "none"},
        {"type": "Beam", "p1": point(0, 50), "p2": point(1, 50), "random": True},
        {"type": "TextLabel", "text": "hello"},
        7,  # type: ignore[arg-type]
        weather="fine",
    )
    told = [str(one) for one in found.not_understood]
    assert told == [
        "object 2, GrinGlass: solen does not support this type of object",
        "object 3, Mirror, shiny: unknown key",
        "object 4, Mirror, p2: is missing; the object is omitted",
        "object 5, CircleGlass, refIndex: must be a number, not 'high'; the object is omitted",
        "object 6, CustomMirror: formula 'x.real' at character 2 = '.'; is not part of a formula; "
        "the object is omitted",
        "object 7, ModuleObj, module: there is no module 'none', or it contains itself",
        "object 8, Beam, random: the scene has no randomSeed, so its rays differ on each run; the object is omitted",
        "object 10, object: is not an object",
        "scene, weather: unknown key",
    ]
    assert [i.name for i in found.scene.interfaces] == ["mirror1.1"]


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{", "not JSON"),
        ("[]", "not a ray-optics scene"),
        ('{"objs": []}', "not a ray-optics scene"),
        ('{"version": 4, "objs": []}', "this version of solen reads version 5; open the scene in ray-optics"),
        ('{"version": 5, "objs": [], "lengthScale": 0}', "lengthScale; must be above 0"),
        ('{"version": 5, "objs": [], "rayModeDensity": "many"}', "rayModeDensity; must be a number"),
        ('{"version": 5, "objs": [], "mode": "fun"}', "mode; must be one of"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(content: str, told: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(DataError) as bad:
        rayoptics.load(file)
    assert told in str(bad.value)
    assert str(bad.value).startswith(str(file))
    assert "\n" not in str(bad.value)


def test_a_scene_without_light_and_an_index_below_1_are_refused() -> None:
    with pytest.raises(DataError, match="there is no supported source; add a source"):
        scene(circle(0, 0, 1))
    with pytest.raises(DataError, match=r"there is no supported source \(object 1, Lantern: .*\)"):
        scene({"type": "Lantern"})
    with pytest.raises(DesignError, match="at least 1"):
        scene(LAMP, circle(0, 0, 1, refIndex=0.8))
    inside = scene(LAMP, circle(0, 0, 1, refIndex=0.8), circle(0, 0, 2, refIndex=1.25))
    assert {region.index for region in inside.scene.regions} == {1.0, 1.25}


def test_an_ideal_lens_on_glass_is_reported() -> None:
    lens = {"type": "IdealLens", "p1": point(5, -1), "p2": point(5, 1)}
    found = scene(LAMP, polygon((5, -1), (9, -1), (9, 1), (5, 1)), lens)
    assert [str(one) for one in found.not_understood] == [
        "object 3, IdealLens: is a lens on a glass surface, which is not supported"
    ]


def test_parts_that_lie_on_one_another_need_no_file() -> None:
    ring = Glass("ring", (Arc.circle((0.0, 0.0), 2.0), Arc.circle((0.0, 0.0), 1.0)), 1.5)
    wall = Element("wall", (Segment((-3.0, 0.0), (3.0, 0.0)),), "absorbing")
    found = arranged([ring, wall], 1e-6, colours=False)
    walls = [i for i in found.interfaces if i.behaviour == "absorbing"]
    assert sorted(i.left for i in walls) == ["air", "air", "air", "ring", "ring"]
    Scene(found.regions, found.interfaces, (Fan((9.0, 9.0), 0.0, 10.0, 3),))  # refuses media that are not closed


JUNK: tuple[Any, ...] = (None, True, -1, 0, 1e308, "x", "`1`", "``t``", [], {}, [[1]], {"x": 1}, 10**400)


@pytest.mark.parametrize("seed", range(4))
def test_whatever_stands_in_a_file_is_read_reported_or_refused(seed: int) -> None:
    chance = random.Random(seed)  # noqa: S311  changes, not secrets
    module = {
        "params": ["n=1:1:9:3"],
        "vars": ["f(t) = n t"],
        "objs": [{"for": "i=1:1:n", **LAMP, "brightness": "`i`"}],
    }
    piece = {"eqnX": "5\\cos(t)", "eqnY": "5\\sin(t)", "tMin": 0, "tMax": 6.28, "tStep": 0.1}
    whole: Json = {
        "version": 5,
        "modules": {"m": module},
        "objs": [
            {"type": "ModuleObj", "module": "m", "points": [point(0, 0)], "params": {"n": 2}},
            {"type": "Beam", "p1": point(0, 0), "p2": point(0, 9), "emisAngle": 10},
            {"type": "ParamGlass", "origin": point(20, 0), "pieces": [piece]},
            {"type": "CustomGlass", "p1": point(30, 0), "p2": point(40, 0), "eqn1": "-x^2", "eqn2": "1"},
            polygon((50, 0), (60, 0), (60, 9)),
            {"type": "Detector", "p1": point(70, 0), "p2": point(70, 9), "irradMap": True},
        ],
        "rayModeDensity": 0.2,
    }
    refused: list[str] = []
    for _ in range(60):
        data = json.loads(json.dumps(whole))
        target, key = chance.choice(list(places_in(data)))
        target[key] = chance.choice(JUNK)
        try:
            found = rayoptics.loads(json.dumps(data), facets=chance.random() < 0.5)
        except (DataError, DesignError) as bad:
            refused.append(str(bad))
        else:
            assert found.scene.rays >= 1
    assert 0 < len(refused) < 60
    assert not [line for line in refused if "\n" in line]


def places_in(item: Any) -> list[tuple[Any, Any]]:
    """Every place of a value in lists and objects, as the holder and the key."""
    keys = list(item) if isinstance(item, dict) else range(len(item)) if isinstance(item, list) else []
    return [place for key in keys for place in ((item, key), *places_in(item[key]))]
