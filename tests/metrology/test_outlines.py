"""A lens in an image: found wherever it lies and however it is lit, laid on its design, or refused with the reason."""

import dataclasses
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.curve import CartesianOval
from solen.errors import DataError, SpecError
from solen.metrology import as_image, measure_lens
from solen.metrology.comparison import compare, comparison_warnings
from solen.metrology.nominal import NominalFront, SeenFrom, nominal_front
from solen.metrology.outline import measure_outline
from solen.metrology.pose import Pose
from solen.metrology.registration import effective_number, register
from solen.metrology.template_match import match_template
from solen.plane import Rigid
from solen.sensor import Sensor
from solen.spec import loads
from solen.spec.objects import CURVES
from tests.metrology.lens_support import NOMINAL, OUTLINE, PLACING, SHAPE, UM_PER_PX, plain, printed, taken
from tests.metrology.render.micrograph import Level, dark_field, reflected, transmitted
from tests.metrology.render.optics import gaussian
from tests.metrology.render.scenery import dust, fibres, glare, gradient
from tests.metrology.render.shape import Placing, bump, grown, shipped

INDICES = (1.44, 1.49, 1.54)


def nominal_fronts() -> list[NominalFront]:
    return [nominal_front(shipped(lens__design_index=index), f"n = {index}") for index in INDICES]


def test_feet_of_points_beside_the_front_have_their_distances() -> None:
    arc = np.linspace(0.2, float(NOMINAL.arc_mm[-1]) - 0.2, 300)
    points, normals = NOMINAL.at(arc)
    off = 0.05 * np.sin(7.0 * arc)
    nearest = NOMINAL.nearest(points + off[:, None] * normals)
    # normals are interpolated between points 2 µm apart: 50 µm along one that is off by 1e-4 rad is 3e-7 mm
    np.testing.assert_allclose(nearest.deviation_mm, off, atol=1e-6)
    np.testing.assert_allclose(nearest.arc_mm, arc, atol=1e-4)
    assert not nearest.beyond.any()
    assert np.all(normals[:, 1] < 0.0), "outwards is towards the emitter"


def test_a_pose_goes_to_the_image_and_back() -> None:
    pose = Pose(33.0, (410.0, 520.0), 2.5, mirrored=True)
    points = np.array([[0.0, 0.0], [1.0, 0.5], [-0.3, 1.2]])
    np.testing.assert_allclose(pose.to_mm(pose.to_px(points)), points, atol=1e-12)
    up = Pose(0.0, (0.0, 0.0), 1000.0).to_px(np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(up, [[1.0, -2.0]])


@pytest.mark.parametrize(
    "rotation_deg", [48.0, *(pytest.param(turn, marks=pytest.mark.evidence) for turn in (180.0, 271.0))]
)
def test_the_lens_is_found_at_any_rotation(rotation_deg: float) -> None:
    placing = replace(PLACING, origin_px=(500.0, 420.0), angle_deg=rotation_deg)
    found = match_template(plain(OUTLINE, placing).grey, UM_PER_PX, NOMINAL)[0]
    assert (found.pose.rotation_deg - rotation_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=2.5)
    assert np.hypot(*np.subtract(found.pose.origin_px, (500.0, 420.0))) < 25.0


def test_a_perfect_print_lies_on_its_design() -> None:
    found = measure_outline(plain(), NOMINAL)
    laid = found.chosen.registration
    assert found.chosen.name == "single"
    assert found.seen == 1.0
    assert laid.rms_um < 0.1 * UM_PER_PX
    assert abs(laid.deviation_um.mean()) < 0.05 * UM_PER_PX
    assert laid.pose.rotation_deg == pytest.approx(PLACING.angle_deg, abs=4.0 * laid.u_rotation_deg + 0.01)
    # the renderer counts from a pixel's corner, places are counted from its middle
    np.testing.assert_allclose(np.add(laid.pose.origin_px, 0.5), PLACING.origin_px, atol=0.3)
    size = found.chosen.size
    assert size.walls == 2
    assert size.size_factor == pytest.approx(1.0, abs=4.0 * size.u_size_factor)
    assert size.overgrowth_um == pytest.approx(0.0, abs=4.0 * size.u_overgrowth_um)
    assert size.u_overgrowth_um < 1.0


def test_a_bump_is_seen_where_it_is_with_its_sign_and_height() -> None:
    up, down = bump(0.8, 30.0, 0.12), bump(-0.9, -25.0, 0.12)
    laid = measure_outline(plain(printed(lambda points: up(down(points)))), NOMINAL).chosen.registration
    # the best pose takes up some 6 µm of them: bumps of opposite sign on both sides look like a rotation
    for worst, height, x_mm in ((np.argmax(laid.deviation_um), 30.0, 0.8), (np.argmin(laid.deviation_um), -25.0, -0.9)):
        assert laid.deviation_um[worst] == pytest.approx(height, abs=7.0)
        assert laid.points_mm[worst, 0] == pytest.approx(x_mm, abs=0.05)


LIT = {
    "dark on bright": (reflected(OUTLINE, PLACING, step=-0.4), 0.7),
    "faint": (reflected(OUTLINE, PLACING, step=0.15), 0.4),
}


@pytest.mark.parametrize("lit", LIT)
def test_the_lens_is_measured_in_any_light(lit: str) -> None:
    levels, ground = LIT[lit]
    laid = measure_outline(taken(levels, ground=ground), NOMINAL).chosen.registration
    assert laid.rms_um < 0.3 * UM_PER_PX
    assert abs(laid.deviation_um.mean()) < 0.05 * UM_PER_PX


@pytest.mark.parametrize("dark", [False, True])
def test_both_edges_of_a_thick_part_are_found_and_named(dark: bool) -> None:
    inner = grown(OUTLINE, -80.0)
    if dark:
        image = taken(dark_field((OUTLINE, PLACING, 2.0), (inner, PLACING, 4.0)), ground=0.1)
    else:
        image = taken(transmitted((OUTLINE, PLACING, 2.0), (inner, PLACING, 4.0)), ground=0.8)
    found = measure_outline(image, NOMINAL)
    by_name = {one.name: one for one in found.edges}
    assert set(by_name) == {"outer", "inner"}
    assert found.chosen is by_name["outer"]
    assert found.chosen.sharpest
    assert found.chosen.registration.rms_um < 0.2 * UM_PER_PX
    assert any("80 µm apart" in warning for warning in found.warnings)
    if not dark:
        assert measure_outline(image, NOMINAL, "inner").chosen.name == "inner"


def test_of_two_faces_that_are_shifted_the_one_in_focus_is_taken() -> None:
    levels = [
        Level([OUTLINE], PLACING, -0.3, gaussian(2.0)),
        Level([OUTLINE], PLACING.moved(25.0, 5.0), -0.2, gaussian(4.0)),
    ]
    found = measure_outline(taken(levels, ground=0.8), NOMINAL)
    assert len(found.edges) == 2
    assert found.chosen.sharpest
    assert found.chosen.registration.rms_um < 0.3 * UM_PER_PX


def test_dust_glare_and_uneven_light_do_not_change_the_outline() -> None:
    dirt = [gradient(0.5, 30.0), dust(25, 12.0, 0.9), fibres(4, 150.0, 6.0, 0.9), glare(4, 25.0, 1.0)]
    found = measure_outline(plain(scenery=dirt), NOMINAL)
    assert found.chosen.registration.rms_um < 0.25 * UM_PER_PX
    assert sum(found.chosen.edge.rejected.values()) > 0


def test_a_cropped_lens_is_measured_as_far_as_it_goes() -> None:
    found = measure_outline(plain(OUTLINE, PLACING.moved(-250.0, -300.0), shape=(500, 600)), NOMINAL)
    assert 0.5 < found.seen < 0.9
    assert found.chosen.registration.rms_um < 0.1 * UM_PER_PX
    assert any("% of the front" in warning for warning in found.warnings)


def test_too_little_of_a_lens_is_refused() -> None:
    with pytest.raises(DataError, match=r"% of the front|shows no lens"):
        measure_outline(plain(OUTLINE, PLACING.moved(-850.0, -300.0), shape=(500, 600)), NOMINAL)


def test_an_image_of_nothing_is_refused() -> None:
    with pytest.raises(DataError, match="no lens"):
        measure_outline(taken([], scenery=[dust(30, 14.0, 0.9), gradient(0.4, 10.0)]), NOMINAL)


def test_a_scale_that_cannot_be_is_refused() -> None:
    image = np.random.default_rng(1).random(SHAPE)
    for um_per_px in (0.5, 90.0):
        with pytest.raises(DataError, match="pixels wide"):
            measure_outline(as_image(image, um_per_px), NOMINAL)


@pytest.mark.parametrize(
    ("stated", "meant"), [(0.005, "mm per pixel"), (200.0, "pixels per mm"), (5000.0, "nm per pixel")]
)
def test_a_scale_in_another_unit_is_named_first(stated: float, meant: str) -> None:
    with pytest.raises(DataError, match=rf"{meant}: set --um-per-px 5"):
        measure_outline(as_image(np.zeros(SHAPE), stated), NOMINAL)


@pytest.mark.parametrize("across_px", [62.0, 80.0, 98.0])
def test_a_lens_of_few_pixels_is_measured(across_px: float) -> None:
    um = 4000.0 / across_px
    placing = Placing(um, (56.0 * 50.0 / um, 74.0 * 50.0 / um), angle_deg=6.0)
    shape = (round(88.0 * 50.0 / um), round(112.0 * 50.0 / um))
    found = measure_outline(
        taken(reflected(OUTLINE, placing, optics=gaussian(0.9)), 2, um, shape=shape), NOMINAL
    ).chosen
    assert found.registration.rms_um < 0.1 * um
    off = np.abs(found.registration.deviation_um) / np.hypot(found.registration.u_um, 0.05 * um)
    assert np.mean(off < 1.96) > 0.9
    assert found.size.overgrowth_um == pytest.approx(0.0, abs=3.0 * found.size.u_overgrowth_um)


def test_unknown_edge_is_refused() -> None:
    with pytest.raises(SpecError, match="outer"):
        measure_outline(as_image(np.zeros(SHAPE), UM_PER_PX), NOMINAL, "left")  # type: ignore[arg-type]


def test_a_design_without_a_lens_is_refused() -> None:
    with pytest.raises(DataError, match="no lens"):
        nominal_front(shipped(lens__shape="none"))


@pytest.mark.parametrize("index", INDICES)
def test_the_nearest_design_is_the_printed_one(index: float) -> None:
    outline = printed(bump(-0.7, 12.0, 0.3), {1.44: "solen-860", 1.49: "solen-500", 1.54: "solen-450"}[index])
    found = measure_outline(plain(outline), NOMINAL).chosen
    designs = compare(found, nominal_fronts())
    assert designs[0].name == f"n = {index}"
    assert designs[0].probability > 0.99
    assert sum(design.probability for design in designs) == pytest.approx(1.0)
    assert designs[0].registration.independent < 100, "what neighbours have in common is no new witness"


def test_designs_that_are_alike_are_not_distinguished() -> None:
    alike = [nominal_front(shipped(lens__design_index=index), f"n = {index}") for index in (1.44, 1.442)]
    found = measure_outline(plain(printed(bump(0.5, 20.0, 0.3))), NOMINAL).chosen
    designs = compare(found, alike)
    assert designs[0].probability < 0.95
    assert "cannot be distinguished" in comparison_warnings(designs, 2.0)[0]


def test_too_few_points_beside_the_lens_are_refused() -> None:
    away = np.full((500, 2), 9e4)
    with pytest.raises(DataError, match=r"= 0; at least 4 .*--um-per-px"):
        register(away, np.full(500, 0.5), Pose(19.0, (306.0, 395.0), 4.0), NOMINAL)


def test_registration_gives_back_a_pose_and_its_uncertainty() -> None:
    rng = np.random.default_rng(4)
    truth = Pose(21.0, (300.0, 400.0), 4.0)
    points, normals = NOMINAL.at(np.linspace(0.1, float(NOMINAL.arc_mm[-1]) - 0.1, 500))
    errors = []
    for _ in range(40):
        noisy = truth.to_px(points + rng.normal(0.0, 0.002, (500, 1)) * normals)
        laid = register(noisy, np.full(500, 0.5), Pose(19.0, (306.0, 395.0), 4.0), NOMINAL)
        shift = 4.0 * np.subtract(laid.pose.origin_px, truth.origin_px)
        errors.append([(laid.pose.rotation_deg - 21.0) / laid.u_rotation_deg, np.hypot(*shift)])
        assert laid.rms_um == pytest.approx(2.0, rel=0.15)
    spread = np.std([error[0] for error in errors])
    assert spread == pytest.approx(1.0, abs=0.35)  # of 40 draws, three standard errors
    assert np.max([error[1] for error in errors]) < 2.0


def test_a_mirrored_image_of_an_asymmetric_front_is_reported() -> None:
    front = NOMINAL.front_mm.copy()
    front[:, 1] += 0.05 * np.exp(-(((front[:, 0] - 1.0) / 0.3) ** 2))
    lopsided = NominalFront("lopsided", front, NOMINAL.left_mm, NOMINAL.right_mm)
    assert NOMINAL.is_symmetric
    assert not lopsided.is_symmetric
    outline = np.vstack([front, [[2.2, 3.0], [-2.2, 3.0]]])
    image = plain(outline, Placing(UM_PER_PX, (600.0, 650.0), angle_deg=5.0))
    mirrored = as_image(np.ascontiguousarray(image.grey[:, ::-1]), UM_PER_PX)
    for micrograph, expected in ((image, False), (mirrored, True)):
        found = measure_outline(micrograph, lopsided).chosen.registration
        assert found.pose.mirrored is expected
        assert found.rms_um < 0.2 * UM_PER_PX


@pytest.mark.parametrize("seen_from", ["top", "bottom"])
def test_of_a_symmetric_lens_the_face_is_what_is_stated(seen_from: SeenFrom) -> None:
    """A bump on the right comes out on the left where the image was taken from below."""
    image = plain(printed(bump(0.8, 25.0, 0.15)))
    found = measure_outline(image, NOMINAL, seen_from=seen_from)
    laid = found.chosen.registration
    side = 1.0 if seen_from == "top" else -1.0
    assert laid.pose.mirrored == (seen_from == "bottom")
    assert laid.points_mm[np.argmax(laid.deviation_um), 0] == pytest.approx(0.8 * side, abs=0.05)
    assert not any("--seen-from" in text for text in found.warnings)
    assert any("--seen-from" in text for text in measure_outline(image, NOMINAL).warnings)


def test_the_face_of_a_symmetric_lens_is_unknown_unless_it_is_stated() -> None:
    image = plain()
    assert measure_lens(image, shipped()).mirrored is None
    assert measure_lens(image, shipped(), seen_from="bottom").mirrored is True


def test_a_stated_face_that_the_outline_contradicts_is_warned_of() -> None:
    front = NOMINAL.front_mm.copy()
    front[:, 1] += 0.05 * np.exp(-(((front[:, 0] - 1.0) / 0.3) ** 2))
    lopsided = NominalFront("lopsided", front, NOMINAL.left_mm, NOMINAL.right_mm)
    image = plain(np.vstack([front, [[2.2, 3.0], [-2.2, 3.0]]]), Placing(UM_PER_PX, (600.0, 650.0), angle_deg=5.0))
    found = measure_outline(image, lopsided, seen_from="bottom")
    assert found.chosen.registration.pose.mirrored
    assert any("seen from the top" in text for text in found.warnings)
    assert not any("--seen-from" in text for text in measure_outline(image, lopsided, seen_from="top").warnings)


def test_effective_number_of_noise_and_of_a_wave() -> None:
    noise = np.random.default_rng(3).normal(size=2000)
    assert effective_number(noise) == pytest.approx(2000, rel=0.1)
    assert effective_number(np.sin(np.linspace(0.0, 6.0 * np.pi, 2000))) < 30


def test_a_part_of_another_width_is_reported_or_refused() -> None:
    image = plain()
    near = measure_outline(as_image(image.grey, 1.08 * UM_PER_PX), NOMINAL)
    assert near.width_mm == pytest.approx(1.08 * 4.0, rel=0.01)
    assert any("mm wide just behind the front" in warning for warning in near.warnings)
    with pytest.raises(DataError, match="shows no lens"):
        measure_outline(as_image(image.grey, 1.4 * UM_PER_PX), NOMINAL)


def test_edges_that_overlap_are_both_measured() -> None:
    inner = grown(OUTLINE, -30.0)
    found = measure_outline(taken(transmitted((OUTLINE, PLACING, 2.0), (inner, PLACING, 2.0)), ground=0.8), NOMINAL)
    by_name = {one.name: one.registration for one in found.edges}
    assert set(by_name) == {"outer", "inner"}
    assert by_name["outer"].rms_um < 0.25 * UM_PER_PX
    assert any("none is sharper" in warning for warning in found.warnings)


@pytest.mark.parametrize(("apart_px", "told"), [(0.0, False), (5.0, True)])
def test_two_edges_in_one_are_recognised_by_their_blur(apart_px: float, told: bool) -> None:
    """A lower face that is shifted along the axis: the walls of both coincide, the fronts nearly."""
    along = np.radians(PLACING.angle_deg)
    shift = apart_px * np.array([np.sin(along), np.cos(along)])
    levels = [
        Level([OUTLINE], PLACING, -0.3, gaussian(1.5)),
        Level([OUTLINE], PLACING.moved(*(float(one) for one in shift)), -0.3, gaussian(1.5)),
    ]
    found = measure_outline(taken(levels, ground=0.8), NOMINAL)
    assert len(found.edges) == 1
    assert any("measured as one" in text for text in found.warnings) == told


def test_a_drawn_front_is_looked_at_as_that_of_a_y(tmp_path: Path) -> None:
    """A body like the Y, drawn lying on its side and away from the origin: the same front, and as symmetric."""
    lie = Rigid.about((3.0, 1.0), 90.0)
    front = Sensor.of(shipped()).lens.front.moved(lie)
    assert isinstance(front, CartesianOval)
    kind = next(name for name, cls in CURVES.items() if cls is CartesianOval)
    corners = [front.end, lie.point((2.0, 20.0)), lie.point((-2.0, 20.0)), front.start]
    faces: list[dict[str, Any]] = [{"name": "lens", "curve": {"kind": kind, **dataclasses.asdict(front)}}]
    faces += [
        {"name": name, "curve": {"kind": "segment", "a": a, "b": b}}
        for name, a, b in zip(("wall", "receiver", "wall"), corners, corners[1:], strict=False)
    ]
    emitters = [{"point": lie.point((0.0, -1.0)), "axis_deg": 90.0}]
    drawn = {"solen_outline": 1, "faces": faces, "emitters": emitters}
    (tmp_path / "own.json").write_text(json.dumps(drawn), encoding="utf-8")
    text = 'schema = 1\nname = "own"\n[material]\nindex = 1.44\n[body]\nkind = "outline"\nfile = "own.json"\n'
    drawn_front = nominal_front(loads(text, folder=tmp_path))
    assert drawn_front.is_symmetric
    assert np.abs(drawn_front.nearest(NOMINAL.front_mm[5:-5]).deviation_mm).max() < 1e-3
