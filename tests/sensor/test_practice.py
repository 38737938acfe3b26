"""The sensor as in the paper and as built, what matters to it, and where its light goes."""

import json
import sys
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.errors import DesignError
from solen.sensor import Effect, Practice, Response, Sensor, study
from solen.sensor.budget import budget
from solen.sensor.lens_choice import lens_choice
from solen.sensor.numbers import number
from solen.sensor.practice import practice
from solen.spec import Design, loads, template, with_values
from tests.scene.rayfile_support import lambertian, zemax

COARSE: dict[str, Any] = {"motion.step_deg": 3.0}


def design(**values: Any) -> Design:
    """The 860 nm example over few angles; ``__`` stands for the dot of a key."""
    return with_values(
        loads(template("paper-860")), COARSE | {key.replace("__", "."): value for key, value in values.items()}
    )


def found(*keys: str, **values: Any) -> Practice:
    """What is built of the example, and the effects of some numbers; by default of all."""
    sensor = Sensor.of(design(**values))
    return practised(sensor, sensor.count(), *keys)


def practised(sensor: Sensor, response: Response, *keys: str) -> Practice:
    with pytest.MonkeyPatch.context() as patch:
        if keys:
            patch.setattr("solen.sensor.effects.KEYS", keys)
            patch.setattr("solen.sensor.effects.HOLDS", {})
        return practice(sensor, response)


@cache
def paper() -> Practice:
    return found()


def effect(found: Practice, key: str) -> Effect:
    one = found.effect(key)
    assert one is not None
    return one


def test_a_point_in_the_plane_is_built_with_a_chip_in_space() -> None:
    built = paper().built
    assert built is not None
    assert (built.emitter.kind, built.emitter.width_mm, built.emitter.height_mm) == ("comparison", 0.2, 0.2)
    assert (built.pattern, built.pattern_replaced, built.cone_deg, built.thickness_mm) == (
        "lambertian",
        True,
        120.0,
        4.0,
    )
    assert not built.is_design
    there = built.response
    assert there.contrast[[there.at(-3.0), there.at(3.0)]] == pytest.approx([0.6535, -0.6535], abs=1e-3)
    assert built.null_deg == 0.0
    assert built.slope_per_deg == pytest.approx(-0.30, abs=0.01)
    assert paper().paper is None
    assert "point in the plane" in paper().skipped["paper"]


def test_the_shipped_design_is_what_is_built_and_the_paper_stands_beside_it() -> None:
    sensor = Sensor.of(loads(template()).set(step_deg=3.0))
    own = sensor.power()
    one = practised(sensor, own, "emitter.offset_mm")
    assert one.built is not None
    assert one.built.is_design
    assert one.built.response is own
    assert own.contrast[0] == pytest.approx(0.650, abs=1e-3)
    assert one.paper is not None
    same = Sensor.of(design()).power([-0.25])
    assert one.paper.contrast[0] == pytest.approx(0.9993, abs=1e-4)
    assert np.interp(-0.25, one.paper.angle_deg, one.paper.contrast) == pytest.approx(float(same.contrast[0]), abs=0.03)
    assert len(one.paper.angle_deg) > 15  # its curve is steep
    lenses_beside_one_another(one, own)


def lenses_beside_one_another(one: Practice, own: Response) -> None:
    """The shipped design with the cylinder, in layers, and with a line focus: figures of docs/lens-in-space.md."""
    choice = one.lenses
    assert choice is not None
    assert (choice.own, choice.y_off_mm, choice.skipped) == ("cartesian-oval", 0.1, {})
    found = {lens.shape: lens for lens in choice.lenses}
    known = {
        "cartesian-oval": (0.277, 0.650, 0.070),
        "layered": (0.442, 0.910, 0.115),
        "line-focus": (0.469, 0.931, 0.129),
    }
    for shape, (near, far, off) in known.items():
        lens = found[shape]
        assert lens.angle_deg.tolist() == [-3.0, -1.5, -1.0, -0.5]
        assert lens.contrast[2] == pytest.approx(near, abs=2e-3 + 2.0 * lens.u_contrast[2])
        assert lens.contrast[0] == pytest.approx(far, abs=2e-3 + 2.0 * lens.u_contrast[0])
        assert lens.u_contrast.max() < 6e-3
        assert lens.nonlinearity == pytest.approx(off, abs=2e-3 + 2.0 * lens.u_nonlinearity)
        assert lens.slope_per_deg == pytest.approx(lens.contrast[3] / -0.5)
        assert (lens.off_deg, lens.within_deg) == (-1.0, 0.5)
    assert found["cartesian-oval"].contrast[0] == own.contrast[own.at(-3.0)]  # not traced again
    lost = found["layered"].contrast[2] - found["layered"].off_contrast
    assert lost == pytest.approx(0.02, abs=0.01)
    assert found["cartesian-oval"].off_contrast == pytest.approx(0.277, abs=3e-3)
    assert choice.layers_pay
    assert choice.gain == pytest.approx(1.6, abs=0.1)


@pytest.mark.parametrize(
    ("values", "why"),
    [
        ({"trace__dimension": "2d"}, "plane"),
        ({"emitter__width_mm": 0.0}, "point"),
        ({"lens__shape": "none"}, "no oval"),
        ({"motion__from_deg": 1.0}, "null"),
    ],
)
def test_where_there_is_nothing_to_choose_no_lenses_are_compared(values: dict[str, Any], why: str) -> None:
    space = {"trace__dimension": "extruded", "emitter__pattern": "lambertian", "emitter__width_mm": 0.2}
    sensor = Sensor.of(design(**(space | values)))
    with pytest.raises(DesignError, match=why):
        lens_choice(sensor, sensor.count([1.0, 3.0]), None if "null" in why else 0.0)


@pytest.mark.parametrize(
    ("key", "off", "angle_deg"),
    [
        ("emitter.offset_mm", 0.01, -3.0),
        ("emitter.width_mm", 0.02, -3.0),
        ("emitter.distance_mm", 0.05, -3.0),
        ("body.arm_width_mm", 0.05, -3.0),
    ],
)
def test_an_effect_is_what_the_number_does_with_the_lens_as_it_is_cut(key: str, off: float, angle_deg: float) -> None:
    one = effect(paper(), key)
    led = {"trace.dimension": "extruded", "emitter.pattern": "lambertian", "emitter.cone_deg": 120.0}
    real = Sensor.of(with_values(design(), led | {"emitter.width_mm": 0.2, "emitter.height_mm": 0.2}))
    value = number(real, key)
    ends = [
        replace(Sensor.of(with_values(real.design, {key: value + sign * off})), cut=real.cut).power([angle_deg])
        for sign in (-1, 1)
    ]
    change = float(ends[1].contrast[0] - ends[0].contrast[0]) / 2
    place = one.angle_deg.tolist().index(angle_deg)
    assert one.tolerance == off
    assert one.contrast[place] == pytest.approx(change, abs=one.u_contrast[place])
    assert one.u_contrast[place] < 2e-3


def test_an_index_that_is_off_has_the_sign_that_it_has_in_space() -> None:
    """A lens cut for 1.44: in the plane a higher index steepens the response, in space it flattens it."""
    one = effect(paper(), "material.index")
    assert (one.tolerance, one.by_uncertainty) == (0.01, False)
    assert one.contrast[one.angle_deg.tolist().index(-3.0)] == pytest.approx(-0.0195, abs=2e-3)


def test_a_decentre_moves_the_null() -> None:
    one = effect(paper(), "emitter.offset_mm")
    assert one.null_deg == pytest.approx(-0.246, abs=0.005)
    assert one.u_null_deg is not None
    there = found("emitter.offset_mm", emitter__offset_mm=0.01).built
    assert there is not None
    assert there.null_deg == pytest.approx(one.null_deg, abs=one.u_null_deg + 0.05)  # between angles a degree apart
    assert next(each for each in paper().effects if each.key != "hold") is one  # what matters most


def test_the_largest_comes_first_and_what_is_small_is_not_resolved() -> None:
    largest = [one.largest for one in paper().effects]
    assert largest == sorted(largest, reverse=True)
    joins = {one.value: one for one in paper().effects if one.key == "motion.join"}
    assert set(joins) == {"seam", "smooth"}
    assert not joins["smooth"].resolved  # about the stem's base the lens stays in place


def test_how_a_soft_body_is_held_is_what_matters_most() -> None:
    """In space; the rigid sensor with its bridge gives 0.650."""
    holds = {one.value: one for one in paper().effects if one.key == "hold"}
    assert set(holds) == {"outer-*", "receiver-*"}
    assert paper().effects[0] is holds["receiver-*"]
    assert holds["receiver-*"].contrast[0] == pytest.approx(-0.148, abs=0.005)
    assert abs(holds["outer-*"].contrast[0]) < 0.005
    (warning,) = paper().warnings
    assert "held by the ends of the arms, the contrast differs by -0.15 at -3°" in warning


def test_what_a_missing_package_leaves_out_is_warned_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    monkeypatch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
    without = found()
    assert not [effect for effect in without.effects if effect.key == "hold"]
    (warning,) = without.warnings
    assert "supports of a soft body" in warning
    assert "scikit-fem" in warning


def test_about_the_emitter_the_join_matters() -> None:
    joins = {
        one.value: one
        for one in found("emitter.offset_mm", motion__pivot="emitter").effects
        if one.key == "motion.join"
    }
    assert joins["seam"].resolved
    assert joins["seam"].contrast[0] == pytest.approx(-0.046, abs=5e-3)
    alone = found("emitter.offset_mm", motion__moves=["emitter"])
    assert alone.effect("motion.join") is None


def resin_of(folder: Path, u_n: float) -> Sensor:
    """The 860 nm example in a resin of 1.44 ± u_n, with a chip of its own."""
    resin = f'schema = 1\nname = "one"\nsource = "a test"\n\n[index]\nkind = "number"\nn = 1.44\nu_n = {u_n}\n'
    (folder / "one.toml").write_text(resin, encoding="utf-8")
    return Sensor.of(design(material__resin="one.toml", emitter__width_mm=0.2).in_folder(folder))


@pytest.mark.parametrize(("u_n", "warned"), [(0.003, False), (0.03, True)])
def test_a_response_that_moves_much_within_the_index_s_uncertainty_is_warned_of(
    u_n: float, warned: bool, tmp_path: Path
) -> None:
    sensor = resin_of(tmp_path, u_n)
    one = practised(sensor, sensor.power(), "material.index")
    index = effect(one, "material.index")
    assert (index.tolerance, index.by_uncertainty) == (u_n, True)
    assert bool(one.warnings) == warned
    assert "index" not in "".join(paper().warnings)  # without uncertainty nothing is known to be off
    if warned:
        assert f"± {u_n}" in one.warnings[0]
        assert f"contrast changes by up to {index.largest:.2g}" in one.warnings[0]


def test_a_stated_tolerance_is_what_a_number_is_off_by() -> None:
    wide = effect(found("emitter.offset_mm", tolerance__emitter_offset_mm=0.03), "emitter.offset_mm")
    assert wide.tolerance == 0.03
    assert wide.largest > 2.0 * effect(paper(), "emitter.offset_mm").largest


def test_without_light_nothing_moves() -> None:
    dark = found(material__absorption_per_mm=1000.0)
    assert dark.built is not None
    assert dark.built.null_deg is None
    assert [one.largest for one in dark.effects] == [0.0] * len(dark.effects)
    assert dark.warnings == ()


def test_ambient_light_of_the_plane_does_not_keep_a_sensor_from_being_built() -> None:
    lit = found("emitter.offset_mm", ambient__power=0.5)
    assert lit.built is not None
    assert paper().built is not None
    assert lit.built.response.contrast[0] == pytest.approx(float(paper().built.response.contrast[0]), abs=1e-9)  # type: ignore[union-attr]


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
@pytest.mark.parametrize("absorption_per_mm", [0.0, 0.01])
def test_the_budget_is_whole(dimension: str, absorption_per_mm: float) -> None:
    values = {"emitter__pattern": "lambertian", "emitter__cone_deg": 120.0, "trace__dimension": dimension}
    sensor = Sensor.of(design(**values, material__absorption_per_mm=absorption_per_mm))
    one = budget(sensor)
    parts = (one.right, one.left, one.beside, one.above_below, one.reflected)
    rest = (one.leaked, one.escaped, one.absorbed, one.truncated)
    assert min(*parts, *rest) >= 0.0
    assert sum(parts) + sum(rest) == pytest.approx(1.0, abs=one.u)
    assert (one.above_below > 0.01) == (dimension == "extruded")
    assert (one.absorbed > 0.1) == (absorption_per_mm > 0.0)
    assert one.right == pytest.approx(one.left, abs=one.u)


def test_what_passes_beside_the_lens_is_what_it_does_not_accept() -> None:
    sensor = Sensor.of(design())
    one = budget(sensor)
    assert one.beside == pytest.approx(1.0 - sensor.lens.acceptance_deg / 60.0, abs=one.u)
    accepted = 1.0 - one.beside
    assert accepted - one.reflected == pytest.approx(0.5207, abs=5e-4)
    flat = budget(sensor.without_lens)
    assert flat.beside == 0.0
    assert flat.reflected == pytest.approx(1.0 - 0.9604, abs=1e-3)


def test_light_from_around_is_not_in_the_budget() -> None:
    lit = budget(Sensor.of(design(ambient__power=0.5)))
    dark = budget(Sensor.of(design()))
    assert (lit.right, lit.beside) == pytest.approx((dark.right, dark.beside), abs=1e-12)


def test_a_flat_face_and_a_bend_have_all_of_it() -> None:
    for values, moved in (({"lens__shape": "none"}, False), ({"motion__kind": "bend"}, True)):
        one = found("emitter.offset_mm", "receivers.gap_mm", **values)
        assert set(one.skipped) == {"paper", "receivers.gap_mm", "lenses"}
        assert effect(one, "emitter.offset_mm").resolved == moved


def test_a_file_of_rays_has_its_own_size(tmp_path: Any) -> None:
    zemax(tmp_path / "led.sdf", lambertian(4096))
    sensor = Sensor.of(
        Design(name="one", material={"index": 1.44}, emitter={"ray_file": "led.sdf"}).in_folder(tmp_path)
    )
    own = practised(sensor, sensor.power([-3.0, 0.0, 3.0]), "emitter.offset_mm")
    assert own.built is not None
    assert (own.built.emitter.kind, own.built.pattern) == ("file", "file")
    assert own.budget is not None
    assert own.budget.beside > 0.3


def test_a_drawn_body_has_what_has_a_meaning(tmp_path: Any) -> None:
    corners = [[2.0, 0.0], [3.0, 20.0], [0.2, 20.0], [0.0, 19.0], [-0.2, 20.0], [-3.0, 20.0], [-2.0, 0.0], [2.0, 0.0]]
    names = ["wall", "receiver-right", "wall", "wall", "receiver-left", "wall", "lens"]
    pieces = [{"kind": "segment", "a": a, "b": b} for a, b in pairwise(corners)]
    faces = [{"name": name, "curve": piece} for name, piece in zip(names, pieces, strict=True)]
    data = {"solen_outline": 1, "faces": faces, "emitters": [{"point": [0.0, -1.0]}]}
    (tmp_path / "one.json").write_text(json.dumps(data), encoding="utf-8")
    body = {"kind": "outline", "file": "one.json"}
    sensor = Sensor.of(Design(name="one", material={"index": 1.49}, body=body).in_folder(tmp_path))
    own = practised(
        sensor, sensor.power([-3.0, 0.0, 3.0]), "body.arm_width_mm", "emitter.distance_mm", "emitter.offset_mm"
    )
    assert {"body.arm_width_mm", "emitter.distance_mm"} <= set(own.skipped)
    assert own.effect("emitter.offset_mm") is not None
    assert own.budget is not None


def test_a_study_has_it_where_asked_for_and_progress_rises() -> None:
    told: list[float] = []
    whole = study(design(lens__shape="none"), told.append, practical=True)
    assert whole.practice is not None
    assert told == sorted(told)
