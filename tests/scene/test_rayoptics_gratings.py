"""Gratings of ray-optics: which way its orders go, what they carry, what is left out."""

import json
import math
from typing import Any

import numpy as np
import pytest

from solen.errors import DesignError
from solen.scene import rayoptics
from solen.trace import RoundRobin, trace, trace_round_robin

Json = dict[str, Any]
NM, LINES = 540.0, 600.0


def point(x: float, y: float) -> Json:
    return {"x": x, "y": y}


def loaded(*objects: Json, **settings: Any) -> rayoptics.Imported:
    return rayoptics.loads(json.dumps({"version": 5, "objs": [*objects], **settings}))


def lamp(angle_deg: float, downwards: bool, brightness: float = 1.0) -> Json:
    """A ray that meets the origin at an angle of incidence, towards +x, down or up the picture, whose y points down."""
    angle, way = math.radians(angle_deg), 1.0 if downwards else -1.0
    start = (-10 * math.sin(angle), -way * 10 * math.cos(angle))
    return {"type": "SingleRay", "p1": point(*start), "p2": point(0.0, 0.0), "brightness": brightness}


def flat(**more: Any) -> Json:
    return {"type": "DiffractionGrating", "p1": point(-50, 0), "p2": point(50, 0), "lineDensity": LINES, **more}


def arc(**more: Any) -> Json:
    """An arc that is all but flat at the origin, its centre far up the picture."""
    ends = {"p1": point(-5, -5e-7), "p2": point(5, -5e-7), "p3": point(0, 0)}
    return {"type": "ConcaveDiffractionGrating", **ends, "lineDensity": LINES, **more}


def orders(imported: rayoptics.Imported) -> dict[float, float]:
    """Brightness of what escapes by its direction's x, both rounded."""
    found = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh), legs=True)
    assert found.ledger.total == pytest.approx(1.0, abs=1e-12)
    return {
        round(path.exit_direction[0], 4): round(path.power * imported.scene.emitted, 4)
        for path in found.paths()
        if path.exit_direction is not None
    }


@pytest.mark.parametrize("downwards", [True, False])
@pytest.mark.parametrize(("kind", "mirrored"), [(flat, False), (flat, True), (arc, True)])
def test_orders_go_where_ray_optics_sends_them(kind: Any, mirrored: bool, downwards: bool) -> None:
    """sin θ_m = sin θ − m λ/d of a flat grating, θ seen by the light that goes down: on the left of a concave one."""
    more = {"mirrored": mirrored} if kind is flat else {}
    imported = loaded(lamp(15.0, downwards), kind(customBrightness=True, brightnesses=[0.4, 0.3, 0.2, 0.06], **more))
    assert imported.not_understood == ()
    way = (1.0 if downwards else -1.0) * (1.0 if kind is flat else -1.0)
    step = NM * 1e-6 * LINES
    expected = {
        round(math.sin(math.radians(15.0)) - way * m * step, 4): share
        for m, share in ((0, 0.4), (1, 0.3), (-1, 0.2), (2, 0.06))
    }
    found = orders(imported)
    assert sorted(found) == pytest.approx(sorted(expected), abs=2e-4)
    assert [found[x] for x in sorted(found)] == pytest.approx([expected[x] for x in sorted(expected)], abs=1e-4)


def test_without_stated_shares_a_grating_is_a_wall_with_slits() -> None:
    """Shares (w/d)² sinc²(π m w/d): a half, of which half goes straight on."""
    imported = loaded(lamp(0.0, True), flat(slitRatio=0.5))
    found = orders(imported)
    step, first = NM * 1e-6 * LINES, 1 / math.pi**2
    expected = {0.0: 0.25} | {round(m * step, 4): first / m**2 for m in (-3, -1, 1, 3)}
    assert found == pytest.approx(expected, abs=1e-4)
    assert trace(imported.scene, "power").ledger.absorbed == pytest.approx(0.75 - 20 / 9 * first, abs=1e-6)


def test_solens_engine_draws_the_same_orders() -> None:
    screen = {"type": "Detector", "p1": point(-40, 20), "p2": point(40, 20), "irradMap": True, "binSize": 4}
    beam = {"type": "Beam", "p1": point(1, -5), "p2": point(-1, -5), "brightness": 0.5}
    grating = flat(customBrightness=True, brightnesses=[0.4, 0.3, 0.2])
    imported = loaded(beam, grating, screen, rayModeDensity=4000, colorMode="linear")
    drawn = trace(imported.scene, "power", seed=4).monitors["detector1"].power_by_bin
    turns = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
    exact = turns.monitors["detector1"].power_by_bin
    np.testing.assert_allclose(drawn, exact, atol=4 * 0.5 / math.sqrt(imported.scene.rays))
    assert np.abs(exact).sum() == pytest.approx(0.9, abs=1e-9)


def test_orders_brighter_than_the_light_are_followed_in_turns_alone() -> None:
    imported = loaded(lamp(0.0, True), flat(customBrightness=True))
    found = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
    assert (found.ledger.escaped, found.ledger.truncated) == pytest.approx((2.0, -1.0))
    with pytest.raises(DesignError, match="sum of 2"):
        trace(imported.scene, "power")


def test_a_grating_in_glass_or_without_light_is_left_out_with_the_reason() -> None:
    ball = {"type": "CircleGlass", "p1": point(0, 0), "p2": point(80, 0)}
    (missed,) = loaded(lamp(0.0, True), flat(), ball).not_understood
    assert (missed.type, missed.object) == ("DiffractionGrating", 2)
    assert "in or on glass" in missed.reason
    for more, key in (
        ({"brightnesses": [0.0], "customBrightness": True}, "brightnesses"),
        ({"slitRatio": 2}, "slitRatio"),
    ):
        (missed,) = loaded(lamp(0.0, True), flat(**more)).not_understood
        assert missed.key == key


def test_numbers_written_as_text_are_numbers() -> None:
    coloured = {**lamp(0.0, True), "wavelength": "580", "brightness": " 0.25 "}
    module = {"numPoints": 1, "params": ["n=1:1:9:2"], "objs": [{**lamp(0.0, True), "wavelength": "`500+n`"}]}
    use = {"type": "ModuleObj", "module": "M", "points": [point(0, 0)], "params": {"n": "7"}}
    imported = loaded(coloured, use, simulateColors=True, modules={"M": module}, rayModeDensity="0.2")
    assert imported.not_understood == ()
    assert imported.scene.wavelengths_nm == (507.0, 580.0)
    assert imported.scene.sources[0].power == 0.25
    for bad in ("58o", "", "1_000", "nan", "Infinity", True):
        (missed,) = loaded(lamp(0.0, True), {**coloured, "wavelength": bad}).not_understood
        assert missed.key == "wavelength"


HYPERBOLA = r"1.5-\sqrt{\frac{0.8+x^2}{1.25}}"


@pytest.mark.parametrize(("first", "second"), [("0.1", HYPERBOLA), (HYPERBOLA.replace("1.5-", "-1.5+"), "-0.1")])
def test_a_glass_over_a_first_curve_off_the_line_is_the_same_as_polyline_and_curve(first: str, second: str) -> None:
    """The outline of ray-optics begins on the line and walks one stretch there and back, which is no surface."""
    glass = {"type": "CustomGlass", "p1": point(-50, 0), "p2": point(50, 0), "eqn1": first, "eqn2": second}
    beam = {"type": "Beam", "p1": point(-49.9, 90), "p2": point(49.9, 90)}
    side = {"type": "Beam", "p1": point(-90, -40), "p2": point(-90, 40)}
    screen = {"type": "Detector", "p1": point(-60, -95), "p2": point(60, -95)}
    settings: Json = {"version": 5, "objs": [beam, side, glass, screen], "rayModeDensity": 2}
    found = []
    for facets in (True, False):
        imported = rayoptics.loads(json.dumps(settings), facets=facets)
        assert imported.not_understood == ()
        assert {(r.name, r.index) for r in imported.scene.regions} == {("air", 1.0), ("customglass1", 1.5)}
        turns = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
        assert turns.undefined == 0
        found.append(turns.monitors["detector1"].power)
    assert found[0] == pytest.approx(found[1], abs=2e-3)
    assert abs(found[0]) > 0.3


def test_a_second_curve_below_the_first_is_left_out_as_in_ray_optics() -> None:
    glass = {"type": "CustomGlass", "p1": point(-50, 0), "p2": point(50, 0), "eqn1": "0.4", "eqn2": r"\sqrt{1-x^2}"}
    (missed,) = loaded(lamp(0.0, True), glass).not_understood
    assert missed.key == "eqn2"
    assert "below eqn1 at x = -1" in missed.reason
