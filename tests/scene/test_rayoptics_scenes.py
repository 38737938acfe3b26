"""Scenes in the format of ray-optics, written for these tests: overlaps, sources, unsupported content, errors."""

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
from solen.scene.rayoptics.seedrandom import random_numbers
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
    """Points slightly to the left and right of an interface, near its middle."""
    x, z = interface.curve.points(np.array([0.457]))[0].tolist()
    normal = interface.curve.normal_at((x, z))
    left, right = ((x + sign * 1e-4 * normal[0], z + sign * 1e-4 * normal[1]) for sign in (1.0, -1.0))
    return left, right


@pytest.mark.parametrize("seed", range(12))
def test_indices_of_overlapping_glasses_multiply(seed: int) -> None:
    """Random circles and triangles: the index on each side of an interface is the product over the glasses there."""
    random_source = random.Random(seed)  # noqa: S311  shapes, not secrets
    shapes: list[Any] = []
    objects: list[Json] = [LAMP]
    for index in (1.1, 1.3, 1.7, 1.9):
        if random_source.random() < 0.5:
            x, y, r = random_source.uniform(-20, 20), random_source.uniform(-20, 20), random_source.uniform(5, 25)
            shapes.append((index, lambda p, x=x, y=y, r=r: math.hypot(p[0] - x, p[1] + y) < r))
            objects.append(circle(x, y, r, refIndex=index))
        else:
            corners = [(random_source.uniform(-40, 40), random_source.uniform(-40, 40)) for _ in range(3)]
            shapes.append((index, lambda p, c=corners: in_triangle(p, [(x, -y) for x, y in c])))
            objects.append(polygon(*corners, refIndex=index))
    imported = scene(*objects)
    imported_scene = {region.name: region.index for region in imported.scene.regions}
    assert len(imported.scene.interfaces) >= 4
    for interface in imported.scene.interfaces:
        for side, at in zip((interface.left, interface.right), sides(interface), strict=True):
            expected = math.prod(index for index, contains in shapes if contains(at))
            assert imported_scene[side] == pytest.approx(expected, rel=1e-12)
    closed = Scene(imported.scene.regions, imported.scene.interfaces, imported.scene.sources)
    assert closed.open_media is False  # the scene's own check of closed media passed


def in_triangle(p: Point, corners: list[Point]) -> bool:
    signs = [
        (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
        for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    return all(s > 0 for s in signs) or all(s < 0 for s in signs)


def test_coinciding_edges_are_one_surface() -> None:
    """Two adjacent squares have one surface between them, from glass to glass."""
    left = polygon((0, 0), (10, 0), (10, 10), (0, 10), refIndex=1.5)
    right = polygon((10, -5), (20, -5), (20, 15), (10, 15), refIndex=1.25)
    imported_scene = scene(LAMP, left, right).scene
    between = [i for i in imported_scene.interfaces if {i.left, i.right} == {"glass1", "glass2"}]
    assert len(between) == 1
    assert isinstance(between[0].curve, Segment)
    assert between[0].curve.length_mm == pytest.approx(10.0)
    assert len(imported_scene.interfaces) == 3 + 1 + 3 + 2


def test_slit_to_hole_is_not_surface() -> None:
    ring = polygon((0, 0), (0, 10), (10, 10), (10, 0), (5, 0), (5, 3), (7, 3), (7, 7), (3, 7), (3, 3), (5, 3), (5, 0))
    imported_scene = scene(LAMP, ring).scene
    assert not [i for i in imported_scene.interfaces if i.curve.middle_point == pytest.approx((5.0, -1.5))]
    assert {(i.left, i.right) for i in imported_scene.interfaces} <= {("air", "glass1"), ("glass1", "air")}


def test_self_intersecting_outline_follows_even_odd_rule() -> None:
    star = [(10 * math.cos(0.8 * math.pi * k), 10 * math.sin(0.8 * math.pi * k)) for k in range(5)]
    imported_scene = scene(LAMP, polygon(*star)).scene
    assert len(imported_scene.interfaces) == 15  # five points with three segments each; the middle is air
    Scene(
        imported_scene.regions, imported_scene.interfaces, imported_scene.sources
    )  # refuses media that are not closed


def test_wall_on_edge_of_glass_absorbs() -> None:
    square = polygon((5, -10), (25, -10), (25, 10), (5, 10))
    wall = {"type": "Blocker", "p1": point(5, -4), "p2": point(5, 4)}
    imported_scene = scene(LAMP, square, wall).scene
    (black,) = [i for i in imported_scene.interfaces if i.behaviour == "absorbing"]
    assert {black.left, black.right} == {"air", "glass1"}
    assert trace(imported_scene, "power").ledger.absorbed == 1.0


def test_dispersion_of_overlapping_glasses_is_product() -> None:
    a, b = circle(0, 0, 10, refIndex=1.5, cauchyB=0.004), circle(5, 0, 10, refIndex=1.2, cauchyB=0.01)
    imported_scene = {region.name: region for region in scene(LAMP, a, b, simulateColors=True).scene.regions}
    for wavelength_nm in (400.0, 700.0):
        index = [imported_scene[name].index_at(wavelength_nm) for name in ("circleglass1", "circleglass2")]
        assert index[0] == pytest.approx(1.5 + 0.004 / (wavelength_nm * 1e-3) ** 2)
        assert imported_scene["circleglass1*circleglass2"].index_at(wavelength_nm) == pytest.approx(
            math.prod(index), rel=1e-12
        )


def test_outline_drawn_in_wrong_direction_has_glass_outside() -> None:
    """As in ray-optics, where the direction of a parametric outline matters."""
    piece = {"eqnX": r"10\cos(t)", "eqnY": r"-10\sin(t)", "tMin": 0, "tMax": math.tau, "tStep": 0.01}
    with pytest.raises(DesignError, match=r"paramglass1\^-1.*at least 1"):
        scene(LAMP, {"type": "ParamGlass", "pieces": [piece]})


def test_rays_of_beam_follow_density() -> None:
    beam = {"type": "Beam", "p1": point(0, 0), "p2": point(0, 10), "brightness": 0.3}
    (source,) = scene(beam, rayModeDensity=0.5).scene.sources
    launch = source.launch()
    np.testing.assert_allclose(launch.z_mm, [-1.0, -3.0, -5.0, -7.0, -9.0])
    np.testing.assert_allclose(launch.dx, 1.0)
    np.testing.assert_allclose(launch.power_s + launch.power_p, 0.6)
    (bright,) = scene({**beam, "brightness": 3}, rayModeDensity=0.5).scene.sources
    np.testing.assert_allclose(bright.launch().power_s, 0.5)  # no ray is brighter than 1
    (correct_brightness,) = scene({**beam, "brightness": 3}, rayModeDensity=0.5, colorMode="linear").scene.sources
    assert correct_brightness.power == pytest.approx(3.0 * 10.0, rel=0.05)
    assert correct_brightness.power / correct_brightness.rays <= 1.0


def test_filter_acts_within_band() -> None:
    mirror = {"type": "Mirror", "p1": point(5, -5), "p2": point(5, 5), "filter": True, "wavelength": 500}
    detector = {"type": "Detector", "p1": point(9, -5), "p2": point(9, 5), "name": "behind"}
    for wavelength, invert, passes in ((505, False, 0), (515, False, 1), (505, True, 1), (515, True, 0)):
        lamp = {**LAMP, "wavelength": wavelength}
        imported_scene = scene(lamp, {**mirror, "invert": invert}, detector, simulateColors=True)
        result = trace_round_robin(
            imported_scene.scene, RoundRobin(imported_scene.weak, imported_scene.weakest, imported_scene.fresh)
        )
        assert abs(imported_scene.readings(result.monitors)["behind"].power) == passes
    assert trace(scene(LAMP, mirror, detector).scene, "power").monitors["behind"].power == 0.0  # no colours, no filter


def test_ideal_lens_and_mirror_focus_at_focal_length() -> None:
    """Parallel rays meet at the focus, independently of their height."""
    beam = {"type": "Beam", "p1": point(0, -8), "p2": point(0, 8)}
    for kind, focus in (("IdealLens", 40.0), ("IdealMirror", 0.0)):
        ideal = {"type": kind, "p1": point(20, -10), "p2": point(20, 10), "focalLength": 20}
        imported_scene = scene(beam, ideal, rayModeDensity=1).scene
        for path in trace(imported_scene, "power", segments=True).paths():
            (x, z), (dx, dz) = path.points_mm[-1], path.exit_direction or (0.0, 0.0)
            assert z + dz * (focus - x) / dx == pytest.approx(0.0, abs=1e-12)


def test_detectors_have_names_and_bins() -> None:
    plain = {"type": "Detector", "p1": point(5, -3.5), "p2": point(5, 3.5)}
    named = {**plain, "p1": point(6, -3.5), "p2": point(6, 3.5), "irradMap": True, "binSize": 2, "name": "screen"}
    imported_scene = scene(LAMP, plain, named, {**plain, "p1": point(7, 9), "p2": point(7, 5)})
    assert [item.name for item in imported_scene.detectors] == ["detector1", "screen", "detector3"]
    readings = imported_scene.readings(trace(imported_scene.scene, "power").monitors)
    assert readings["detector1"].power == 1.0
    assert readings["screen"].position is not None
    assert readings["screen"].irradiance is not None
    np.testing.assert_allclose(readings["screen"].position, [0.0, 2.0, 4.0, 6.0])
    np.testing.assert_allclose(readings["screen"].irradiance, [0.0, 0.5, 0.0, 0.0])
    assert readings["detector1"].irradiance is None


def test_recognises_circle_and_parabola_in_formulas() -> None:
    ball = {
        "type": "CustomGlass",
        "p1": point(0, 0),
        "p2": point(20, 0),
        "eqn1": r"-\sqrt{1-x^2}",
        "eqn2": r"\sqrt{1-x^2}",
    }
    bowl = {"type": "CustomMirror", "p1": point(40, 0), "p2": point(60, 0), "eqn": "0.5x^2"}
    wavy = {"type": "CustomMirror", "p1": point(80, 0), "p2": point(99, 0), "eqn": r"0.1\sin(20x)"}
    imported_scene = scene(LAMP, ball, bowl, wavy).scene
    kinds = {i.name.split(".")[0]: type(i.curve) for i in imported_scene.interfaces}
    assert kinds == {"customglass1": Arc, "custommirror1": Bezier, "custommirror2": Spline}
    assert all(i.curve.radius_mm == pytest.approx(10.0) for i in imported_scene.interfaces if isinstance(i.curve, Arc))


def test_fitted_curve_is_within_tolerance() -> None:
    (curve,) = fitted(lambda t: (10.0 * t, math.exp(math.sin(5.0 * t))), -1.0, 1.0, "it")
    points = curve.points(np.linspace(0.0, 1.0, 5001))
    assert np.abs(points[:, 1] - np.exp(np.sin(0.5 * points[:, 0]))).max() < 20.0 * 1e-6


def test_bridges_jump_of_formula() -> None:
    curves = fitted(lambda t: (t, math.floor(t)), -1.0, 0.5, "it")
    assert all(isinstance(curve, Segment) for curve in curves)
    assert all(a.end == b.start for a, b in itertools.pairwise(curves))
    assert curves[-1].end == (0.5, 0.0)


def test_facets_follow_curve() -> None:
    """Hits and normals of the polyline agree with those of the curve, to within its sagitta."""
    piece = {"eqnX": r"10\cos(t)", "eqnY": r"10\sin(t)", "tMin": 0, "tMax": math.tau, "tStep": 0.01}
    glass = {"type": "ParamGlass", "pieces": [piece]}
    smooth, facets = (scene(LAMP, glass, facets=sign).scene.interfaces[0].curve for sign in (False, True))
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


def test_random_numbers_equal_those_of_seedrandom() -> None:
    """The first numbers of seedrandom('hello.'), as in its documentation."""
    numbers = random_numbers("hello.")
    assert next(numbers) == pytest.approx(0.9282578795792454, abs=1e-15)
    assert next(numbers) == pytest.approx(0.3752569768646784, abs=1e-15)


def test_reports_unsupported_objects_and_reads_others() -> None:
    imported_scene = scene(
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
    message = [str(item) for item in imported_scene.not_understood]
    assert message == [
        "object 2, GrinGlass: solen does not support this type of object",
        "object 3, Mirror, shiny: unknown key",
        "object 4, Mirror, p2: is missing; the object is omitted",
        "object 5, CircleGlass, refIndex: must be a number, not 'high'; the object is omitted",
        "object 6, CustomMirror: formula 'x.real' at character 2 = '.'; is not part of a formula; "
        "the object is omitted",
        "object 7, ModuleObj, module: 'none' is not a module, or contains itself",
        "object 8, Beam, random: the scene has no randomSeed, so its rays differ on each run; the object is omitted",
        "object 10, object: is not an object",
        "scene, weather: unknown key",
    ]
    assert [i.name for i in imported_scene.scene.interfaces] == ["mirror1.1"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not valid JSON"),
        ("[]", "not a ray-optics scene"),
        ('{"objs": []}', "not a ray-optics scene"),
        ('{"version": 4, "objs": []}', "this version of solen reads version 5; open the scene in ray-optics"),
        ('{"version": 5, "objs": [], "lengthScale": 0}', "lengthScale; must be above 0"),
        ('{"version": 5, "objs": [], "rayModeDensity": "many"}', "rayModeDensity; must be a number"),
        ('{"version": 5, "objs": [], "mode": "fun"}', "mode; must be one of"),
    ],
)
def test_refuses_invalid_file_in_one_line(content: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "scene.json"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(DataError) as bad:
        rayoptics.load(file)
    assert message in str(bad.value)
    assert str(bad.value).startswith(str(file))
    assert "\n" not in str(bad.value)


def test_refuses_scene_without_source_or_with_index_below_1() -> None:
    with pytest.raises(DataError, match="contains no supported source; add a source"):
        scene(circle(0, 0, 1))
    with pytest.raises(DataError, match=r"contains no supported source \(object 1, Lantern: .*\)"):
        scene({"type": "Lantern"})
    with pytest.raises(DesignError, match="at least 1"):
        scene(LAMP, circle(0, 0, 1, refIndex=0.8))
    inside = scene(LAMP, circle(0, 0, 1, refIndex=0.8), circle(0, 0, 2, refIndex=1.25))
    assert {region.index for region in inside.scene.regions} == {1.0, 1.25}


def test_reports_ideal_lens_on_glass() -> None:
    lens = {"type": "IdealLens", "p1": point(5, -1), "p2": point(5, 1)}
    imported_scene = scene(LAMP, polygon((5, -1), (9, -1), (9, 1), (5, 1)), lens)
    assert [str(item) for item in imported_scene.not_understood] == [
        "object 3, IdealLens: is a lens on a glass surface, which is not supported"
    ]


def test_arranges_wall_across_ring_of_glass() -> None:
    ring = Glass("ring", (Arc.circle((0.0, 0.0), 2.0), Arc.circle((0.0, 0.0), 1.0)), 1.5)
    wall = Element("wall", (Segment((-3.0, 0.0), (3.0, 0.0)),), "absorbing")
    imported_scene = arranged([ring, wall], 1e-6, colours=False)
    walls = [i for i in imported_scene.interfaces if i.behaviour == "absorbing"]
    assert sorted(i.left for i in walls) == ["air", "air", "air", "ring", "ring"]
    Scene(
        imported_scene.regions, imported_scene.interfaces, (Fan((9.0, 9.0), 0.0, 10.0, 3),)
    )  # refuses media that are not closed


JUNK: tuple[Any, ...] = (None, True, -1, 0, 1e308, "x", "`1`", "``t``", [], {}, [[1]], {"x": 1}, 10**400)


@pytest.mark.parametrize("seed", range(4))
def test_random_changes_of_file_are_read_reported_or_refused(seed: int) -> None:
    random_source = random.Random(seed)  # noqa: S311  changes, not secrets
    module = {
        "params": ["n=1:1:9:3"],
        "vars": ["f(t) = n t"],
        "objs": [{"for": "i=1:1:n", **LAMP, "brightness": "`i`"}],
    }
    piece = {"eqnX": "5\\cos(t)", "eqnY": "5\\sin(t)", "tMin": 0, "tMax": 6.28, "tStep": 0.1}
    scene_data: Json = {
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
    messages: list[str] = []
    for _ in range(60):
        data = json.loads(json.dumps(scene_data))
        target, key = random_source.choice(list(entries_in(data)))
        target[key] = random_source.choice(JUNK)
        try:
            imported_scene = rayoptics.loads(json.dumps(data), facets=random_source.random() < 0.5)
        except (DataError, DesignError) as bad:
            messages.append(str(bad))
        else:
            assert imported_scene.scene.rays >= 1
    assert 0 < len(messages) < 60
    assert not [line for line in messages if "\n" in line]


def entries_in(item: Any) -> list[tuple[Any, Any]]:
    """Every value in nested lists and objects, as its container and key."""
    keys = list(item) if isinstance(item, dict) else range(len(item)) if isinstance(item, list) else []
    return [entry for key in keys for entry in ((item, key), *entries_in(item[key]))]
