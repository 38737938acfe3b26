"""The sensor as in the paper and as built, effects of tolerances, comparison of lenses and light budget."""

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
    """The 860 nm example at three angles; ``__`` stands for the dot of a key."""
    return with_values(
        loads(template("paper-860")), COARSE | {key.replace("__", "."): value for key, value in values.items()}
    )


def practice_of(*keys: str, **values: Any) -> Practice:
    """The example as built, and the effects of some numbers, by default of all."""
    sensor = Sensor.of(design(**values))
    return practice_with_keys(sensor, sensor.count(), *keys)


def practice_with_keys(sensor: Sensor, response: Response, *keys: str) -> Practice:
    with pytest.MonkeyPatch.context() as patch:
        if keys:
            patch.setattr("solen.sensor.effects.KEYS", keys)
            patch.setattr("solen.sensor.effects.HOLDS", {})
        return practice(sensor, response)


@cache
def paper() -> Practice:
    return practice_of()


def effect(sensor_practice: Practice, key: str) -> Effect:
    number_effect = sensor_practice.effect(key)
    assert number_effect is not None
    return number_effect


def test_point_in_the_plane_is_built_with_a_chip_in_space() -> None:
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
    response = built.response
    assert response.contrast[[response.index_at(-3.0), response.index_at(3.0)]] == pytest.approx(
        [0.6535, -0.6535], abs=1e-3
    )
    assert built.null_deg == 0.0
    assert built.slope_per_deg == pytest.approx(-0.30, abs=0.01)
    assert paper().paper is None
    assert "point in the plane" in paper().skipped["paper"]


def test_template_is_its_own_built_sensor_compared_with_the_paper() -> None:
    sensor = Sensor.of(loads(template()).set(step_deg=3.0))
    own = sensor.power()
    result = practice_with_keys(sensor, own, "emitter.offset_mm")
    assert result.built is not None
    assert result.built.is_design
    assert result.built.response is own
    assert own.contrast[0] == pytest.approx(0.650, abs=1e-3)
    assert result.paper is not None
    same = Sensor.of(design()).power([-0.25])
    assert result.paper.contrast[0] == pytest.approx(0.9993, abs=1e-4)
    assert np.interp(-0.25, result.paper.angle_deg, result.paper.contrast) == pytest.approx(
        float(same.contrast[0]), abs=0.03
    )
    assert len(result.paper.angle_deg) > 15  # its curve is steep
    check_lenses(result, own)


def check_lenses(sensor_practice: Practice, own: Response) -> None:
    """The template with a cylinder, a layered and a line-focus lens has the figures of docs/lens-in-space.md."""
    choice = sensor_practice.lenses
    assert choice is not None
    assert (choice.own, choice.y_off_mm, choice.skipped) == ("cartesian-oval", 0.1, {})
    figures = {lens.shape: lens for lens in choice.lenses}
    known = {
        "cartesian-oval": (0.277, 0.650, 0.070),
        "layered": (0.442, 0.910, 0.115),
        "line-focus": (0.469, 0.931, 0.129),
    }
    for shape, (near, far, nonlinearity) in known.items():
        lens = figures[shape]
        assert lens.angle_deg.tolist() == [-3.0, -1.5, -1.0, -0.5]
        assert lens.contrast[2] == pytest.approx(near, abs=2e-3 + 2.0 * lens.u_contrast[2])
        assert lens.contrast[0] == pytest.approx(far, abs=2e-3 + 2.0 * lens.u_contrast[0])
        assert lens.u_contrast.max() < 6e-3
        assert lens.nonlinearity == pytest.approx(nonlinearity, abs=2e-3 + 2.0 * lens.u_nonlinearity)
        assert lens.slope_per_deg == pytest.approx(lens.contrast[3] / -0.5)
        assert (lens.off_deg, lens.within_deg) == (-1.0, 0.5)
    assert figures["cartesian-oval"].contrast[0] == own.contrast[own.index_at(-3.0)]  # not traced again
    lost = figures["layered"].contrast[2] - figures["layered"].off_contrast
    assert lost == pytest.approx(0.02, abs=0.01)
    assert figures["cartesian-oval"].off_contrast == pytest.approx(0.277, abs=3e-3)
    assert choice.layers_pay
    assert choice.gain == pytest.approx(1.6, abs=0.1)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"trace__dimension": "2d"}, "plane"),
        ({"emitter__width_mm": 0.0}, "point"),
        ({"lens__shape": "none"}, "neither a cylinder nor"),
        ({"motion__from_deg": 1.0}, "null"),
    ],
)
def test_refuses_comparisons_of_lenses_without_a_choice(values: dict[str, Any], message: str) -> None:
    space = {"trace__dimension": "extruded", "emitter__pattern": "lambertian", "emitter__width_mm": 0.2}
    sensor = Sensor.of(design(**(space | values)))
    with pytest.raises(DesignError, match=message):
        lens_choice(sensor, sensor.count([1.0, 3.0]), None if "null" in message else 0.0)


@pytest.mark.parametrize(
    ("key", "step", "angle_deg"),
    [
        ("emitter.offset_mm", 0.01, -3.0),
        ("emitter.width_mm", 0.02, -3.0),
        ("emitter.distance_mm", 0.05, -3.0),
        ("body.arm_width_mm", 0.05, -3.0),
    ],
)
def test_effect_is_the_change_with_the_lens_as_designed(key: str, step: float, angle_deg: float) -> None:
    number_effect = effect(paper(), key)
    led = {"trace.dimension": "extruded", "emitter.pattern": "lambertian", "emitter.cone_deg": 120.0}
    built = Sensor.of(with_values(design(), led | {"emitter.width_mm": 0.2, "emitter.height_mm": 0.2}))
    value = number(built, key)
    ends = [
        replace(Sensor.of(with_values(built.design, {key: value + sign * step})), cut=built.cut).power([angle_deg])
        for sign in (-1, 1)
    ]
    change = float(ends[1].contrast[0] - ends[0].contrast[0]) / 2
    index = number_effect.angle_deg.tolist().index(angle_deg)
    assert number_effect.tolerance == step
    assert number_effect.contrast[index] == pytest.approx(change, abs=number_effect.u_contrast[index])
    assert number_effect.u_contrast[index] < 2e-3


def test_effect_of_the_index_has_its_sign_in_space() -> None:
    """For a lens designed for 1.44, a higher index steepens the response in the plane and flattens it in space."""
    index_effect = effect(paper(), "material.index")
    assert (index_effect.tolerance, index_effect.by_uncertainty) == (0.01, False)
    assert index_effect.contrast[index_effect.angle_deg.tolist().index(-3.0)] == pytest.approx(-0.0195, abs=2e-3)


def test_decentre_shifts_the_null() -> None:
    offset_effect = effect(paper(), "emitter.offset_mm")
    assert offset_effect.null_deg == pytest.approx(-0.246, abs=0.005)
    assert offset_effect.u_null_deg is not None
    decentred = practice_of("emitter.offset_mm", emitter__offset_mm=0.01).built
    assert decentred is not None
    assert decentred.null_deg == pytest.approx(
        offset_effect.null_deg, abs=offset_effect.u_null_deg + 0.05
    )  # interpolated between angles
    assert next(each for each in paper().effects if each.key != "hold") is offset_effect  # the largest of a number


def test_effects_are_ranked_and_small_ones_not_resolved() -> None:
    largest = [number_effect.largest for number_effect in paper().effects]
    assert largest == sorted(largest, reverse=True)
    joins = {
        number_effect.value: number_effect for number_effect in paper().effects if number_effect.key == "motion.join"
    }
    assert set(joins) == {"seam", "smooth"}
    assert not joins["smooth"].resolved  # a rotation about the stem's base does not displace the lens


def test_supports_of_a_soft_body_have_the_largest_effect() -> None:
    """In space, where the rigid sensor with its bridge has a contrast of 0.650."""
    holds = {number_effect.value: number_effect for number_effect in paper().effects if number_effect.key == "hold"}
    assert set(holds) == {"outer-*", "receiver-*"}
    assert paper().effects[0] is holds["receiver-*"]
    assert holds["receiver-*"].contrast[0] == pytest.approx(-0.148, abs=0.005)
    assert abs(holds["outer-*"].contrast[0]) < 0.005
    (warning,) = paper().warnings
    assert "supported at the ends of the arms, the contrast differs by -0.15 at -3°" in warning


def test_warns_of_effects_omitted_for_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    monkeypatch.setattr("solen.sensor.effects.KEYS", ("emitter.offset_mm",))
    without = practice_of()
    assert not [effect for effect in without.effects if effect.key == "hold"]
    (warning,) = without.warnings
    assert "supports of a soft body" in warning
    assert "scikit-fem" in warning


def test_join_has_an_effect_for_a_pivot_at_the_emitter() -> None:
    joins = {
        number_effect.value: number_effect
        for number_effect in practice_of("emitter.offset_mm", motion__pivot="emitter").effects
        if number_effect.key == "motion.join"
    }
    assert joins["seam"].resolved
    assert joins["seam"].contrast[0] == pytest.approx(-0.046, abs=5e-3)
    alone = practice_of("emitter.offset_mm", motion__moves=["emitter"])
    assert alone.effect("motion.join") is None


def sensor_of_resin(folder: Path, u_n: float) -> Sensor:
    """The 860 nm example in a resin of index 1.44 ± u_n, with a chip."""
    resin = f'schema = 1\nname = "one"\nsource = "a test"\n\n[index]\nkind = "number"\nn = 1.44\nu_n = {u_n}\n'
    (folder / "one.toml").write_text(resin, encoding="utf-8")
    return Sensor.of(design(material__resin="one.toml", emitter__width_mm=0.2).in_folder(folder))


@pytest.mark.parametrize(("u_n", "warns"), [(0.003, False), (0.03, True)])
def test_warns_of_a_large_effect_of_the_uncertainty_of_the_index(u_n: float, warns: bool, tmp_path: Path) -> None:
    sensor = sensor_of_resin(tmp_path, u_n)
    result = practice_with_keys(sensor, sensor.power(), "material.index")
    index_effect = effect(result, "material.index")
    assert (index_effect.tolerance, index_effect.by_uncertainty) == (u_n, True)
    assert bool(result.warnings) == warns
    assert "index" not in "".join(paper().warnings)  # its index has no uncertainty
    if warns:
        assert f"± {u_n}" in result.warnings[0]
        assert f"contrast changes by up to {index_effect.largest:.2g}" in result.warnings[0]


def test_effect_uses_the_tolerance_of_the_design() -> None:
    wide = effect(practice_of("emitter.offset_mm", tolerance__emitter_offset_mm=0.03), "emitter.offset_mm")
    assert wide.tolerance == 0.03
    assert wide.largest > 2.0 * effect(paper(), "emitter.offset_mm").largest


def test_effects_are_zero_without_light() -> None:
    dark = practice_of(material__absorption_per_mm=1000.0)
    assert dark.built is not None
    assert dark.built.null_deg is None
    assert [number_effect.largest for number_effect in dark.effects] == [0.0] * len(dark.effects)
    assert dark.warnings == ()


def test_sensor_is_built_without_ambient_light() -> None:
    with_ambient = practice_of("emitter.offset_mm", ambient__power=0.5)
    assert with_ambient.built is not None
    assert paper().built is not None
    assert with_ambient.built.response.contrast[0] == pytest.approx(float(paper().built.response.contrast[0]), abs=1e-9)  # type: ignore[union-attr]


@pytest.mark.parametrize("dimension", ["2d", "extruded"])
@pytest.mark.parametrize("absorption_per_mm", [0.0, 0.01])
def test_budget_is_complete(dimension: str, absorption_per_mm: float) -> None:
    values = {"emitter__pattern": "lambertian", "emitter__cone_deg": 120.0, "trace__dimension": dimension}
    sensor = Sensor.of(design(**values, material__absorption_per_mm=absorption_per_mm))
    result = budget(sensor)
    parts = (result.right, result.left, result.beside, result.above_below, result.reflected)
    rest = (result.leaked, result.escaped, result.absorbed, result.truncated)
    assert min(*parts, *rest) >= 0.0
    assert sum(parts) + sum(rest) == pytest.approx(1.0, abs=result.u)
    assert (result.above_below > 0.01) == (dimension == "extruded")
    assert (result.absorbed > 0.1) == (absorption_per_mm > 0.0)
    assert result.right == pytest.approx(result.left, abs=result.u)


def test_light_beside_the_lens_is_outside_its_acceptance() -> None:
    sensor = Sensor.of(design())
    result = budget(sensor)
    assert result.beside == pytest.approx(1.0 - sensor.lens.acceptance_deg / 60.0, abs=result.u)
    accepted = 1.0 - result.beside
    assert accepted - result.reflected == pytest.approx(0.5207, abs=5e-4)
    flat = budget(sensor.without_lens)
    assert flat.beside == 0.0
    assert flat.reflected == pytest.approx(1.0 - 0.9604, abs=1e-3)


def test_budget_excludes_ambient_light() -> None:
    with_ambient = budget(Sensor.of(design(ambient__power=0.5)))
    dark = budget(Sensor.of(design()))
    assert (with_ambient.right, with_ambient.beside) == pytest.approx((dark.right, dark.beside), abs=1e-12)


def test_flat_face_and_bend_have_effects_and_a_budget() -> None:
    for values, resolves in (({"lens__shape": "none"}, False), ({"motion__kind": "bend"}, True)):
        result = practice_of("emitter.offset_mm", "receivers.gap_mm", **values)
        assert set(result.skipped) == {"paper", "receivers.gap_mm", "lenses"}
        assert effect(result, "emitter.offset_mm").resolved == resolves


def test_ray_file_has_its_own_size(tmp_path: Any) -> None:
    zemax(tmp_path / "led.sdf", lambertian(4096))
    sensor = Sensor.of(
        Design(name="one", material={"index": 1.44}, emitter={"ray_file": "led.sdf"}).in_folder(tmp_path)
    )
    result = practice_with_keys(sensor, sensor.power([-3.0, 0.0, 3.0]), "emitter.offset_mm")
    assert result.built is not None
    assert (result.built.emitter.kind, result.built.pattern) == ("file", "file")
    assert result.budget is not None
    assert result.budget.beside > 0.3


def test_drawn_body_has_the_effects_that_apply(tmp_path: Any) -> None:
    corners = [[2.0, 0.0], [3.0, 20.0], [0.2, 20.0], [0.0, 19.0], [-0.2, 20.0], [-3.0, 20.0], [-2.0, 0.0], [2.0, 0.0]]
    names = ["wall", "receiver-right", "wall", "wall", "receiver-left", "wall", "lens"]
    pieces = [{"kind": "segment", "a": a, "b": b} for a, b in pairwise(corners)]
    faces = [{"name": name, "curve": piece} for name, piece in zip(names, pieces, strict=True)]
    data = {"solen_outline": 1, "faces": faces, "emitters": [{"point": [0.0, -1.0]}]}
    (tmp_path / "one.json").write_text(json.dumps(data), encoding="utf-8")
    body = {"kind": "outline", "file": "one.json"}
    sensor = Sensor.of(Design(name="one", material={"index": 1.49}, body=body).in_folder(tmp_path))
    result = practice_with_keys(
        sensor, sensor.power([-3.0, 0.0, 3.0]), "body.arm_width_mm", "emitter.distance_mm", "emitter.offset_mm"
    )
    assert {"body.arm_width_mm", "emitter.distance_mm"} <= set(result.skipped)
    assert result.effect("emitter.offset_mm") is not None
    assert result.budget is not None


def test_study_includes_the_practice_on_request() -> None:
    fractions: list[float] = []
    full_study = study(design(lens__shape="none"), fractions.append, practical=True)
    assert full_study.practice is not None
    assert fractions == sorted(fractions)


def test_change_of_light_agrees_with_the_sensor_with_more_absorption() -> None:
    """A symmetric sensor at rest has the contrast 0 by symmetry, but its light changes as at other angles."""
    key = "material.absorption_per_mm"
    result = effect(practice_of(key), key)
    built = Sensor.of(
        design(
            emitter__width_mm=0.2, emitter__height_mm=0.2, emitter__pattern="lambertian", trace__dimension="extruded"
        )
    )
    before, after = (
        chip.power((-3.0, -1.0), tolerance=1e-3).received_share for chip in (built, built.set({key: result.tolerance}))
    )
    assert result.received == pytest.approx(after / before - 1.0, abs=0.003)
    assert result.received < -0.15
