"""Diffraction gratings of ray-optics: directions and efficiencies of the orders, and omitted gratings."""

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
    """A ray that reaches the origin at an angle of incidence, towards +x and downwards or upwards; y points down."""
    angle, sign = math.radians(angle_deg), 1.0 if downwards else -1.0
    start = (-10 * math.sin(angle), -sign * 10 * math.cos(angle))
    return {"type": "SingleRay", "p1": point(*start), "p2": point(0.0, 0.0), "brightness": brightness}


def flat(**options: Any) -> Json:
    return {"type": "DiffractionGrating", "p1": point(-50, 0), "p2": point(50, 0), "lineDensity": LINES, **options}


def arc(**options: Any) -> Json:
    """An arc that is almost flat at the origin, with its centre far above."""
    ends = {"p1": point(-5, -5e-7), "p2": point(5, -5e-7), "p3": point(0, 0)}
    return {"type": "ConcaveDiffractionGrating", **ends, "lineDensity": LINES, **options}


def orders(imported: rayoptics.Imported) -> dict[float, float]:
    """Brightness of the escaping rays, keyed by the x component of their direction; both are rounded."""
    observed = trace_round_robin(
        imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh), segments=True
    )
    assert observed.ledger.total == pytest.approx(1.0, abs=1e-12)
    return {
        round(path.exit_direction[0], 4): round(path.power * imported.scene.emitted, 4)
        for path in observed.paths()
        if path.exit_direction is not None
    }


@pytest.mark.parametrize("downwards", [True, False])
@pytest.mark.parametrize(("kind", "mirrored"), [(flat, False), (flat, True), (arc, True)])
def test_directions_of_orders_agree_with_ray_optics(kind: Any, mirrored: bool, downwards: bool) -> None:
    """sin θ_m = sin θ − m λ/d for a flat grating and light that goes down; the sign is opposite for a concave one."""
    options = {"mirrored": mirrored} if kind is flat else {}
    imported = loaded(lamp(15.0, downwards), kind(customBrightness=True, brightnesses=[0.4, 0.3, 0.2, 0.06], **options))
    assert imported.not_understood == ()
    sign = (1.0 if downwards else -1.0) * (1.0 if kind is flat else -1.0)
    step = NM * 1e-6 * LINES
    expected = {
        round(math.sin(math.radians(15.0)) - sign * m * step, 4): efficiency
        for m, efficiency in ((0, 0.4), (1, 0.3), (-1, 0.2), (2, 0.06))
    }
    observed = orders(imported)
    assert sorted(observed) == pytest.approx(sorted(expected), abs=2e-4)
    assert [observed[x] for x in sorted(observed)] == pytest.approx([expected[x] for x in sorted(expected)], abs=1e-4)


def test_grating_without_brightnesses_is_wall_with_slits() -> None:
    """The efficiencies are (w/d)² sinc²(π m w/d); of the half that passes the slits, half is in order 0."""
    imported = loaded(lamp(0.0, True), flat(slitRatio=0.5))
    observed = orders(imported)
    step, first = NM * 1e-6 * LINES, 1 / math.pi**2
    expected = {0.0: 0.25} | {round(m * step, 4): first / m**2 for m in (-3, -1, 1, 3)}
    assert observed == pytest.approx(expected, abs=1e-4)
    assert trace(imported.scene, "power").ledger.absorbed == pytest.approx(0.75 - 20 / 9 * first, abs=1e-6)


def test_sampled_orders_agree_with_round_robin() -> None:
    screen = {"type": "Detector", "p1": point(-40, 20), "p2": point(40, 20), "irradMap": True, "binSize": 4}
    beam = {"type": "Beam", "p1": point(1, -5), "p2": point(-1, -5), "brightness": 0.5}
    grating = flat(customBrightness=True, brightnesses=[0.4, 0.3, 0.2])
    imported = loaded(beam, grating, screen, rayModeDensity=4000, colorMode="linear")
    drawn_powers = trace(imported.scene, "power", seed=4).monitors["detector1"].power_by_bin
    round_robin = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
    exact = round_robin.monitors["detector1"].power_by_bin
    np.testing.assert_allclose(drawn_powers, exact, atol=4 * 0.5 / math.sqrt(imported.scene.rays))
    assert np.abs(exact).sum() == pytest.approx(0.9, abs=1e-9)


def test_efficiencies_above_1_are_traced_only_by_round_robin() -> None:
    imported = loaded(lamp(0.0, True), flat(customBrightness=True))
    observed = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
    assert (observed.ledger.escaped, observed.ledger.truncated) == pytest.approx((2.0, -1.0))
    with pytest.raises(DesignError, match="add up to 2"):
        trace(imported.scene, "power")


def test_reports_reason_for_omitted_grating() -> None:
    ball = {"type": "CircleGlass", "p1": point(0, 0), "p2": point(80, 0)}
    (omitted,) = loaded(lamp(0.0, True), flat(), ball).not_understood
    assert (omitted.type, omitted.object) == ("DiffractionGrating", 2)
    assert "in or on glass" in omitted.reason
    for options, key in (
        ({"brightnesses": [0.0], "customBrightness": True}, "brightnesses"),
        ({"slitRatio": 2}, "slitRatio"),
    ):
        (omitted,) = loaded(lamp(0.0, True), flat(**options)).not_understood
        assert omitted.key == key


def test_reads_numbers_written_as_strings() -> None:
    coloured = {**lamp(0.0, True), "wavelength": "580", "brightness": " 0.25 "}
    module = {"numPoints": 1, "params": ["n=1:1:9:2"], "objs": [{**lamp(0.0, True), "wavelength": "`500+n`"}]}
    instance = {"type": "ModuleObj", "module": "M", "points": [point(0, 0)], "params": {"n": "7"}}
    imported = loaded(coloured, instance, simulateColors=True, modules={"M": module}, rayModeDensity="0.2")
    assert imported.not_understood == ()
    assert imported.scene.wavelengths_nm == (507.0, 580.0)
    assert imported.scene.sources[0].power == 0.25
    for invalid in ("58o", "", "1_000", "nan", "Infinity", True):
        (omitted,) = loaded(lamp(0.0, True), {**coloured, "wavelength": invalid}).not_understood
        assert omitted.key == "wavelength"


HYPERBOLA = r"1.5-\sqrt{\frac{0.8+x^2}{1.25}}"


@pytest.mark.parametrize(("first", "second"), [("0.1", HYPERBOLA), (HYPERBOLA.replace("1.5-", "-1.5+"), "-0.1")])
def test_glass_between_formulas_agrees_as_polyline_and_curve(first: str, second: str) -> None:
    """The outline in ray-optics begins on the line and passes along one segment twice, which is not a surface."""
    glass = {"type": "CustomGlass", "p1": point(-50, 0), "p2": point(50, 0), "eqn1": first, "eqn2": second}
    beam = {"type": "Beam", "p1": point(-49.9, 90), "p2": point(49.9, 90)}
    from_side = {"type": "Beam", "p1": point(-90, -40), "p2": point(-90, 40)}
    screen = {"type": "Detector", "p1": point(-60, -95), "p2": point(60, -95)}
    settings: Json = {"version": 5, "objs": [beam, from_side, glass, screen], "rayModeDensity": 2}
    observed = []
    for facets in (True, False):
        imported = rayoptics.loads(json.dumps(settings), facets=facets)
        assert imported.not_understood == ()
        assert {(r.name, r.index) for r in imported.scene.regions} == {("air", 1.0), ("customglass1", 1.5)}
        round_robin = trace_round_robin(imported.scene, RoundRobin(imported.weak, imported.weakest, imported.fresh))
        assert round_robin.undefined == 0
        observed.append(round_robin.monitors["detector1"].power)
    assert observed[0] == pytest.approx(observed[1], abs=2e-3)
    assert abs(observed[0]) > 0.3


def test_omits_glass_with_second_curve_below_first() -> None:
    glass = {"type": "CustomGlass", "p1": point(-50, 0), "p2": point(50, 0), "eqn1": "0.4", "eqn2": r"\sqrt{1-x^2}"}
    (omitted,) = loaded(lamp(0.0, True), glass).not_understood
    assert omitted.key == "eqn2"
    assert "below eqn1 at x = -1" in omitted.reason
