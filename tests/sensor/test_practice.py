"""What a sensor's neighbours show: a chip, a decentre, another index, space, and where the light goes."""

import json
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.sensor import Practice, Sensor, study
from solen.sensor.budget import budget
from solen.sensor.practice import practice
from solen.spec import Design, loads, template, with_values
from tests.scene.rayfile_support import lambertian, zemax

COARSE: dict[str, Any] = {"motion.step_deg": 3.0}


def design(**values: Any) -> Design:
    """The 860 nm example over few angles; ``__`` stands for the dot of a key."""
    return with_values(loads(template("paper-860")), COARSE | {key.replace("__", "."): value for key, value in values.items()})


def found(**values: Any) -> Practice:
    sensor = Sensor.of(design(**values))
    return practice(sensor, sensor.power())


@cache
def paper() -> Practice:
    return found()


def contrast(found: Practice, angle_deg: float) -> float:
    assert found.chip is not None
    return float(found.chip.contrast[found.chip.at(angle_deg)])


def test_a_chip_softens_the_response() -> None:
    point = paper().point
    assert paper().emitter.kind == "comparison"
    assert point is not None
    assert point.contrast[0] > 0.999
    assert contrast(paper(), -3.0) == pytest.approx(0.896, abs=2e-3)
    assert contrast(paper(), -1.0) == pytest.approx(0.49, abs=5e-3)
    assert paper().skipped == {}


def test_a_chip_agrees_with_many_points_side_by_side() -> None:
    offsets = (np.arange(60) + 0.5) / 60 * 0.2 - 0.1
    powers = []
    for offset in offsets.tolist():
        reading = Sensor.of(design(emitter__offset_mm=offset)).integrate(-1.0)
        powers.append([reading.detectors[name].power for name in ("right", "left")])
    right, left = np.mean(powers, axis=0)
    assert contrast(paper(), -1.0) == pytest.approx((right - left) / (right + left), abs=5e-3)


def test_the_design_s_own_chip_is_compared_with_a_point() -> None:
    own = found(emitter__width_mm=0.2)
    assert (own.emitter.kind, own.emitter.width_mm) == ("own", 0.2)
    assert contrast(own, -3.0) == pytest.approx(contrast(paper(), -3.0), abs=2e-4)
    point = paper().point
    assert own.point is not None
    assert point is not None
    assert own.point.contrast[[0, -1]] == pytest.approx(point.contrast[[0, -1]], abs=1e-5)


def test_an_index_that_is_off_with_a_chip() -> None:
    """A lens cut for 1.44 in 1.484: the contrast at 3 degrees hardly moves, the one at 1 degree does."""
    off = found(material__index=1.484, lens__design_index=1.44)
    assert contrast(off, -3.0) == pytest.approx(0.863, abs=2e-3)
    assert contrast(off, -1.0) == pytest.approx(0.32, abs=7e-3)


def test_the_index_is_off_and_the_lens_is_not() -> None:
    off = paper().index
    assert off is not None
    low, high = off
    assert (low.step, high.step, low.by_uncertainty) == (-0.01, 0.01, False)
    assert (low.index, high.index) == pytest.approx((1.43, 1.45))
    same = Sensor.of(design(material__index=1.43, lens__design_index=1.44, emitter__width_mm=0.2)).power([-1.0])
    assert low.response.contrast[low.response.at(-1.0)] == pytest.approx(same.contrast[0], abs=1e-9)


def resin_of(folder: Path, u_n: float) -> Sensor:
    """The 860 nm example in a resin of 1.44 ± u_n, with a chip of its own."""
    resin = f'schema = 1\nname = "one"\nsource = "a test"\n\n[index]\nkind = "number"\nn = 1.44\nu_n = {u_n}\n'
    (folder / "one.toml").write_text(resin, encoding="utf-8")
    return Sensor.of(design(material__resin="one.toml", emitter__width_mm=0.2).in_folder(folder))


def test_a_known_uncertainty_of_the_index_is_what_it_is_off_by(tmp_path: Path) -> None:
    sensor = resin_of(tmp_path, 0.003)
    off = practice(sensor, sensor.power()).index
    assert off is not None
    assert [(one.step, one.by_uncertainty) for one in off] == [(-0.003, True), (0.003, True)]
    assert [one.index for one in off] == pytest.approx([1.437, 1.443])


@pytest.mark.parametrize("u_n", [0.01, *(pytest.param(u_n, marks=pytest.mark.evidence) for u_n in (0.003, 0.04))])
def test_the_largest_change_is_that_of_the_whole_curve(u_n: float, tmp_path: Path) -> None:
    """Against sweeps every eighth of a degree, which find the largest change to within 5 %."""
    sensor = resin_of(tmp_path, u_n)
    found = practice(sensor, sensor.power([-3.0, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0]))
    moved = found.index_shift
    assert moved is not None
    angles = [step / 8 for step in range(-16, 1)]
    here = sensor.power(angles).contrast
    true = {}
    for step in (-u_n, u_n):
        other = replace(sensor, material=replace(sensor.material, index=1.44 + step))
        true[step] = np.abs(other.power(angles).contrast - here)
    largest = max(float(change.max()) for change in true.values())
    assert 0.88 * largest < moved.contrast < largest + 2 * moved.u_contrast
    at = {step: float(np.interp(moved.angle_deg, angles, change)) for step, change in true.items()}
    assert moved.contrast == pytest.approx(max(at.values()), abs=0.05 * largest)
    assert found.index is not None
    assert all(one.response.angle_deg.tolist() == one.base.angle_deg.tolist() for one in found.index)


def test_a_response_that_is_the_same_on_both_sides_is_compared_on_one() -> None:
    same, moved = paper().index, found(emitter__offset_mm=0.02).index
    assert same is not None
    assert moved is not None
    assert max(same[0].response.angle_deg) == 0.0
    assert (min(moved[0].response.angle_deg), max(moved[0].response.angle_deg)) == (-3.0, 3.0)


def test_the_chip_moves_the_response_of_the_point() -> None:
    moved = paper().chip_shift
    assert moved is not None
    point = Sensor.of(design()).power([moved.angle_deg])
    assert moved.contrast == pytest.approx(abs(contrast(paper(), moved.angle_deg) - float(point.contrast[0])))
    assert moved.contrast > 0.5


@pytest.mark.parametrize(("u_n", "warned"), [(0.003, False), (0.02, True)])
def test_a_response_that_moves_much_is_warned_of(u_n: float, warned: bool, tmp_path: Path) -> None:
    sensor = resin_of(tmp_path, u_n)
    found = practice(sensor, sensor.power())
    assert bool(found.warnings) == warned
    assert paper().warnings == ()  # of an index without uncertainty nothing is known to be off
    if warned:
        assert f"± {u_n}" in found.warnings[0]
        assert found.index_shift is not None
        assert f"{found.index_shift.contrast:.2g} in contrast" in found.warnings[0]


def test_without_light_nothing_moves() -> None:
    dark = found(material__absorption_per_mm=1000.0)
    assert dark.index is not None
    assert [one.shift for one in dark.index] == [None, None]
    assert (dark.index_shift, dark.chip_shift, dark.warnings) == (None, None, ())


def test_dispersion_is_moved_at_all_wavelengths() -> None:
    sensor = Sensor.of(
        design(material__resin="pmma", emitter__spectrum=[[850.0, 1.0], [870.0, 1.0]], motion__step_deg=6.0)
    )
    off = practice(sensor, sensor.power()).index
    assert off is not None
    assert off[1].index - sensor.material.index == pytest.approx(0.01)
    assert abs(off[0].response.right - off[1].response.right).max() > 1e-3


@pytest.mark.parametrize("offset_mm", [0.0, 0.05])
def test_the_balance_point_moves_with_the_emitter(offset_mm: float) -> None:
    here = found(emitter__offset_mm=offset_mm).null_shift
    assert here is not None
    there = Sensor.of(design(emitter__offset_mm=offset_mm + 0.01, emitter__width_mm=0.2))
    near = there.power([here.moved_deg - 0.01, here.moved_deg + 0.01])
    assert near.contrast[0] > 0.0 > near.contrast[1]
    assert here.u_shift_deg < 0.002
    assert here.shift_deg == pytest.approx(-0.19, abs=0.01)


def test_without_a_balance_point_there_is_no_shift() -> None:
    one_sided = found(motion__from_deg=1.0)
    assert one_sided.null_shift is None
    assert "no null" in one_sided.skipped["null_shift"]
    dark = found(material__absorption_per_mm=1000.0)
    assert dark.null_shift is None
    assert dark.chip is not None
    assert np.isnan(dark.chip.contrast).all()


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


def test_in_space_skew_rays_see_another_lens() -> None:
    space = paper().in_space
    assert space is not None
    assert (space.pattern, space.pattern_replaced, space.cone_deg) == ("lambertian", True, 120.0)
    assert (space.emitter.width_mm, space.emitter.height_mm, space.thickness_mm) == (0.2, 0.2, 4.0)
    assert abs(space.plane.contrast[[0, -1]]) == pytest.approx([0.89, 0.89], abs=5e-3)
    assert abs(space.same.contrast[[0, -1]]) == pytest.approx([0.65, 0.65], abs=6e-3)
    assert space.space.u_power.max() < 1e-3


def test_an_extruded_design_is_compared_with_the_plane() -> None:
    own = found(
        trace__dimension="extruded",
        emitter__pattern="lambertian",
        emitter__cone_deg=120.0,
        emitter__width_mm=0.2,
        emitter__height_mm=0.2,
    )
    assert own.in_space is not None
    assert not own.in_space.pattern_replaced
    assert own.in_space.plane.contrast[0] == pytest.approx(0.89, abs=5e-3)
    assert own.in_space.space.contrast[0] == pytest.approx(contrast(own, -3.0), abs=1e-12)
    assert contrast(own, -3.0) == pytest.approx(0.654, abs=4e-3)


def test_a_flat_face_and_a_bend_have_all_of_it() -> None:
    for values in ({"lens__shape": "none"}, {"motion__kind": "bend"}):
        one = found(**values)
        assert one.skipped == {}
        assert one.null_shift is not None
        assert abs(one.null_shift.shift_deg) > 0.03


def test_a_file_of_rays_has_its_own_size(tmp_path: Any) -> None:
    zemax(tmp_path / "led.sdf", lambertian(4096))
    sensor = Sensor.of(
        Design(name="one", material={"index": 1.44}, emitter={"ray_file": "led.sdf"}).in_folder(tmp_path)
    )
    own = practice(sensor, sensor.power([-3.0, 0.0, 3.0]))
    assert own.emitter.kind == "file"
    assert own.point is None
    assert "file of rays" in own.skipped["point"]
    assert own.in_space is not None
    assert own.in_space.pattern == "file"
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
    own = practice(sensor, sensor.power([-3.0, 0.0, 3.0]))
    assert own.skipped == {}
    assert own.null_shift is not None
    assert own.budget is not None


def test_a_study_has_it_where_asked_for_and_progress_rises() -> None:
    told: list[float] = []
    whole = study(design(lens__shape="none"), told.append, practical=True)
    assert whole.practice is not None
    assert whole.practice.point is whole.case.power
    assert told == sorted(told)
    assert told[-1] == 1.0
    assert study(design(lens__shape="none")).practice is None
