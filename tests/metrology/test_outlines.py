"""A lens in an image, in any pose and illumination: registered to its design, or rejected with the reason."""

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


def test_distance_and_foot_of_points_near_front() -> None:
    arc = np.linspace(0.2, float(NOMINAL.arc_mm[-1]) - 0.2, 300)
    points, normals = NOMINAL.at(arc)
    deviation = 0.05 * np.sin(7.0 * arc)
    nearest = NOMINAL.nearest(points + deviation[:, None] * normals)
    # normals are interpolated between points 2 µm apart; 50 µm along a normal that is wrong by 1e-4 rad give 3e-7 mm
    np.testing.assert_allclose(nearest.deviation_mm, deviation, atol=1e-6)
    np.testing.assert_allclose(nearest.arc_mm, arc, atol=1e-4)
    assert not nearest.beyond.any()
    assert np.all(normals[:, 1] < 0.0), "outwards is towards the emitter"


def test_pose_transformation_and_its_inverse() -> None:
    pose = Pose(33.0, (410.0, 520.0), 2.5, mirrored=True)
    points = np.array([[0.0, 0.0], [1.0, 0.5], [-0.3, 1.2]])
    np.testing.assert_allclose(pose.to_mm(pose.to_px(points)), points, atol=1e-12)
    up = Pose(0.0, (0.0, 0.0), 1000.0).to_px(np.array([[1.0, 2.0]]))
    np.testing.assert_allclose(up, [[1.0, -2.0]])


@pytest.mark.parametrize(
    "rotation_deg", [48.0, *(pytest.param(turn, marks=pytest.mark.evidence) for turn in (180.0, 271.0))]
)
def test_finds_lens_at_any_rotation(rotation_deg: float) -> None:
    placing = replace(PLACING, origin_px=(500.0, 420.0), angle_deg=rotation_deg)
    match = match_template(plain(OUTLINE, placing).grey, UM_PER_PX, NOMINAL)[0]
    assert (match.pose.rotation_deg - rotation_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=2.5)
    assert np.hypot(*np.subtract(match.pose.origin_px, (500.0, 420.0))) < 25.0


def test_perfect_print_has_no_deviation() -> None:
    outline = measure_outline(plain(), NOMINAL)
    registration = outline.chosen.registration
    assert outline.chosen.name == "single"
    assert outline.seen == 1.0
    assert registration.rms_um < 0.1 * UM_PER_PX
    assert abs(registration.deviation_um.mean()) < 0.05 * UM_PER_PX
    assert registration.pose.rotation_deg == pytest.approx(
        PLACING.angle_deg, abs=4.0 * registration.u_rotation_deg + 0.01
    )
    # the renderer's coordinates start at a pixel's corner, those of solen at its centre
    np.testing.assert_allclose(np.add(registration.pose.origin_px, 0.5), PLACING.origin_px, atol=0.3)
    size = outline.chosen.size
    assert size.walls == 2
    assert size.size_factor == pytest.approx(1.0, abs=4.0 * size.u_size_factor)
    assert size.overgrowth_um == pytest.approx(0.0, abs=4.0 * size.u_overgrowth_um)
    assert size.u_overgrowth_um < 1.0


def test_position_sign_and_height_of_bumps() -> None:
    up, down = bump(0.8, 30.0, 0.12), bump(-0.9, -25.0, 0.12)
    registration = measure_outline(plain(printed(lambda points: up(down(points)))), NOMINAL).chosen.registration
    # the pose absorbs about 6 µm of the bumps: opposite signs on both sides look like a rotation
    for index, height, x_mm in (
        (np.argmax(registration.deviation_um), 30.0, 0.8),
        (np.argmin(registration.deviation_um), -25.0, -0.9),
    ):
        assert registration.deviation_um[index] == pytest.approx(height, abs=7.0)
        assert registration.points_mm[index, 0] == pytest.approx(x_mm, abs=0.05)


ILLUMINATION = {
    "dark on bright": (reflected(OUTLINE, PLACING, step=-0.4), 0.7),
    "faint": (reflected(OUTLINE, PLACING, step=0.15), 0.4),
}


@pytest.mark.parametrize("illumination", ILLUMINATION)
def test_measures_lens_in_any_illumination(illumination: str) -> None:
    levels, ground = ILLUMINATION[illumination]
    registration = measure_outline(taken(levels, ground=ground), NOMINAL).chosen.registration
    assert registration.rms_um < 0.3 * UM_PER_PX
    assert abs(registration.deviation_um.mean()) < 0.05 * UM_PER_PX


@pytest.mark.parametrize("dark", [False, True])
def test_names_both_edges_of_thick_part(dark: bool) -> None:
    inner = grown(OUTLINE, -80.0)
    if dark:
        image = taken(dark_field((OUTLINE, PLACING, 2.0), (inner, PLACING, 4.0)), ground=0.1)
    else:
        image = taken(transmitted((OUTLINE, PLACING, 2.0), (inner, PLACING, 4.0)), ground=0.8)
    outline = measure_outline(image, NOMINAL)
    by_name = {edge.name: edge for edge in outline.edges}
    assert set(by_name) == {"outer", "inner"}
    assert outline.chosen is by_name["outer"]
    assert outline.chosen.sharpest
    assert outline.chosen.registration.rms_um < 0.2 * UM_PER_PX
    assert any("80 µm apart" in warning for warning in outline.warnings)
    if not dark:
        assert measure_outline(image, NOMINAL, "inner").chosen.name == "inner"


def test_selects_face_in_focus() -> None:
    levels = [
        Level([OUTLINE], PLACING, -0.3, gaussian(2.0)),
        Level([OUTLINE], PLACING.moved(25.0, 5.0), -0.2, gaussian(4.0)),
    ]
    outline = measure_outline(taken(levels, ground=0.8), NOMINAL)
    assert len(outline.edges) == 2
    assert outline.chosen.sharpest
    assert outline.chosen.registration.rms_um < 0.3 * UM_PER_PX


def test_outline_with_dust_glare_and_uneven_light() -> None:
    dirt = [gradient(0.5, 30.0), dust(25, 12.0, 0.9), fibres(4, 150.0, 6.0, 0.9), glare(4, 25.0, 1.0)]
    outline = measure_outline(plain(scenery=dirt), NOMINAL)
    assert outline.chosen.registration.rms_um < 0.25 * UM_PER_PX
    assert sum(outline.chosen.edge.rejected.values()) > 0


def test_measures_visible_part_of_cropped_lens() -> None:
    outline = measure_outline(plain(OUTLINE, PLACING.moved(-250.0, -300.0), shape=(500, 600)), NOMINAL)
    assert 0.5 < outline.seen < 0.9
    assert outline.chosen.registration.rms_um < 0.1 * UM_PER_PX
    assert any("% of the front" in warning for warning in outline.warnings)


def test_rejects_too_small_part_of_lens() -> None:
    with pytest.raises(DataError, match=r"% of the front|shows no lens"):
        measure_outline(plain(OUTLINE, PLACING.moved(-850.0, -300.0), shape=(500, 600)), NOMINAL)


def test_rejects_image_without_lens() -> None:
    with pytest.raises(DataError, match="no lens"):
        measure_outline(taken([], scenery=[dust(30, 14.0, 0.9), gradient(0.4, 10.0)]), NOMINAL)


def test_rejects_impossible_scale() -> None:
    image = np.random.default_rng(1).random(SHAPE)
    for um_per_px in (0.5, 90.0):
        with pytest.raises(DataError, match="pixels wide"):
            measure_outline(as_image(image, um_per_px), NOMINAL)


@pytest.mark.parametrize(
    ("specified", "unit"), [(0.005, "mm per pixel"), (200.0, "pixels per mm"), (5000.0, "nm per pixel")]
)
def test_error_suggests_unit_of_scale(specified: float, unit: str) -> None:
    with pytest.raises(DataError, match=rf"{unit}: set --um-per-px 5"):
        measure_outline(as_image(np.zeros(SHAPE), specified), NOMINAL)


@pytest.mark.parametrize("across_px", [62.0, 80.0, 98.0])
def test_measures_lens_of_few_pixels(across_px: float) -> None:
    um_per_px = 4000.0 / across_px
    placing = Placing(um_per_px, (56.0 * 50.0 / um_per_px, 74.0 * 50.0 / um_per_px), angle_deg=6.0)
    shape = (round(88.0 * 50.0 / um_per_px), round(112.0 * 50.0 / um_per_px))
    outline = measure_outline(
        taken(reflected(OUTLINE, placing, optics=gaussian(0.9)), 2, um_per_px, shape=shape), NOMINAL
    ).chosen
    assert outline.registration.rms_um < 0.1 * um_per_px
    ratio = np.abs(outline.registration.deviation_um) / np.hypot(outline.registration.u_um, 0.05 * um_per_px)
    assert np.mean(ratio < 1.96) > 0.9
    assert outline.size.overgrowth_um == pytest.approx(0.0, abs=3.0 * outline.size.u_overgrowth_um)


def test_rejects_unknown_edge() -> None:
    with pytest.raises(SpecError, match="outer"):
        measure_outline(as_image(np.zeros(SHAPE), UM_PER_PX), NOMINAL, "left")  # type: ignore[arg-type]


def test_rejects_design_without_lens() -> None:
    with pytest.raises(DataError, match="no lens"):
        nominal_front(shipped(lens__shape="none"))


@pytest.mark.parametrize("index", INDICES)
def test_nearest_design_is_printed_one(index: float) -> None:
    outline = printed(bump(-0.7, 12.0, 0.3), {1.44: "solen-860", 1.49: "solen-500", 1.54: "solen-450"}[index])
    edge = measure_outline(plain(outline), NOMINAL).chosen
    designs = compare(edge, nominal_fronts())
    assert designs[0].name == f"n = {index}"
    assert designs[0].probability > 0.99
    assert sum(design.probability for design in designs) == pytest.approx(1.0)
    assert designs[0].registration.independent_values < 100, "correlated neighbours are not independent"


def test_does_not_distinguish_similar_designs() -> None:
    alike = [nominal_front(shipped(lens__design_index=index), f"n = {index}") for index in (1.44, 1.442)]
    edge = measure_outline(plain(printed(bump(0.5, 20.0, 0.3))), NOMINAL).chosen
    designs = compare(edge, alike)
    assert designs[0].probability < 0.95
    assert "cannot be distinguished" in comparison_warnings(designs, 2.0)[0]


def test_rejects_too_few_points_near_lens() -> None:
    distant_points = np.full((500, 2), 9e4)
    with pytest.raises(DataError, match=r"= 0; at least 4 .*--um-per-px"):
        register(distant_points, np.full(500, 0.5), Pose(19.0, (306.0, 395.0), 4.0), NOMINAL)


def test_pose_of_registration_and_its_uncertainty() -> None:
    rng = np.random.default_rng(4)
    truth = Pose(21.0, (300.0, 400.0), 4.0)
    points, normals = NOMINAL.at(np.linspace(0.1, float(NOMINAL.arc_mm[-1]) - 0.1, 500))
    errors = []
    for _ in range(40):
        noisy = truth.to_px(points + rng.normal(0.0, 0.002, (500, 1)) * normals)
        registration = register(noisy, np.full(500, 0.5), Pose(19.0, (306.0, 395.0), 4.0), NOMINAL)
        shift = 4.0 * np.subtract(registration.pose.origin_px, truth.origin_px)
        errors.append([(registration.pose.rotation_deg - 21.0) / registration.u_rotation_deg, np.hypot(*shift)])
        assert registration.rms_um == pytest.approx(2.0, rel=0.15)
    spread = np.std([error[0] for error in errors])
    assert spread == pytest.approx(1.0, abs=0.35)  # three standard errors for 40 draws
    assert np.max([error[1] for error in errors]) < 2.0


def test_detects_mirrored_image_of_asymmetric_front() -> None:
    front = NOMINAL.front_mm.copy()
    front[:, 1] += 0.05 * np.exp(-(((front[:, 0] - 1.0) / 0.3) ** 2))
    lopsided = NominalFront("lopsided", front, NOMINAL.left_mm, NOMINAL.right_mm)
    assert NOMINAL.is_symmetric
    assert not lopsided.is_symmetric
    outline = np.vstack([front, [[2.2, 3.0], [-2.2, 3.0]]])
    image = plain(outline, Placing(UM_PER_PX, (600.0, 650.0), angle_deg=5.0))
    mirrored = as_image(np.ascontiguousarray(image.grey[:, ::-1]), UM_PER_PX)
    for micrograph, expected in ((image, False), (mirrored, True)):
        registration = measure_outline(micrograph, lopsided).chosen.registration
        assert registration.pose.mirrored is expected
        assert registration.rms_um < 0.2 * UM_PER_PX


@pytest.mark.parametrize("seen_from", ["top", "bottom"])
def test_face_of_symmetric_lens_is_as_specified(seen_from: SeenFrom) -> None:
    """A bump on the right is on the left if the image was taken from below."""
    image = plain(printed(bump(0.8, 25.0, 0.15)))
    outline = measure_outline(image, NOMINAL, seen_from=seen_from)
    registration = outline.chosen.registration
    side = 1.0 if seen_from == "top" else -1.0
    assert registration.pose.mirrored == (seen_from == "bottom")
    assert registration.points_mm[np.argmax(registration.deviation_um), 0] == pytest.approx(0.8 * side, abs=0.05)
    assert not any("--seen-from" in text for text in outline.warnings)
    assert any("--seen-from" in text for text in measure_outline(image, NOMINAL).warnings)


def test_face_of_symmetric_lens_is_unknown_by_default() -> None:
    image = plain()
    assert measure_lens(image, shipped()).mirrored is None
    assert measure_lens(image, shipped(), seen_from="bottom").mirrored is True


def test_warns_if_outline_contradicts_specified_face() -> None:
    front = NOMINAL.front_mm.copy()
    front[:, 1] += 0.05 * np.exp(-(((front[:, 0] - 1.0) / 0.3) ** 2))
    lopsided = NominalFront("lopsided", front, NOMINAL.left_mm, NOMINAL.right_mm)
    image = plain(np.vstack([front, [[2.2, 3.0], [-2.2, 3.0]]]), Placing(UM_PER_PX, (600.0, 650.0), angle_deg=5.0))
    outline = measure_outline(image, lopsided, seen_from="bottom")
    assert outline.chosen.registration.pose.mirrored
    assert any("seen from the top" in text for text in outline.warnings)
    assert not any("--seen-from" in text for text in measure_outline(image, lopsided, seen_from="top").warnings)


def test_effective_number_of_noise_and_of_wave() -> None:
    noise = np.random.default_rng(3).normal(size=2000)
    assert effective_number(noise) == pytest.approx(2000, rel=0.1)
    assert effective_number(np.sin(np.linspace(0.0, 6.0 * np.pi, 2000))) < 30


def test_reports_or_rejects_part_of_another_width() -> None:
    image = plain()
    near = measure_outline(as_image(image.grey, 1.08 * UM_PER_PX), NOMINAL)
    assert near.width_mm == pytest.approx(1.08 * 4.0, rel=0.01)
    assert any("just behind the front" in warning for warning in near.warnings)
    with pytest.raises(DataError, match="shows no lens"):
        measure_outline(as_image(image.grey, 1.4 * UM_PER_PX), NOMINAL)


def test_measures_two_overlapping_edges() -> None:
    inner = grown(OUTLINE, -30.0)
    outline = measure_outline(taken(transmitted((OUTLINE, PLACING, 2.0), (inner, PLACING, 2.0)), ground=0.8), NOMINAL)
    by_name = {edge.name: edge.registration for edge in outline.edges}
    assert set(by_name) == {"outer", "inner"}
    assert by_name["outer"].rms_um < 0.25 * UM_PER_PX
    assert any("none is sharper" in warning for warning in outline.warnings)


@pytest.mark.parametrize(("separation_px", "warned"), [(0.0, False), (5.0, True)])
def test_blur_reveals_two_merged_edges(separation_px: float, warned: bool) -> None:
    """A lower face is shifted along the axis: its walls coincide with those of the upper face, its front nearly."""
    angle = np.radians(PLACING.angle_deg)
    shift = separation_px * np.array([np.sin(angle), np.cos(angle)])
    levels = [
        Level([OUTLINE], PLACING, -0.3, gaussian(1.5)),
        Level([OUTLINE], PLACING.moved(*(float(component) for component in shift)), -0.3, gaussian(1.5)),
    ]
    outline = measure_outline(taken(levels, ground=0.8), NOMINAL)
    assert len(outline.edges) == 1
    assert any("measured as one" in text for text in outline.warnings) == warned


def test_front_of_drawn_body_equals_that_of_y(tmp_path: Path) -> None:
    """A body like the Y, drawn rotated and away from the origin, has the same symmetric front."""
    placement = Rigid.about((3.0, 1.0), 90.0)
    front = Sensor.of(shipped()).lens.front.moved(placement)
    assert isinstance(front, CartesianOval)
    kind = next(name for name, cls in CURVES.items() if cls is CartesianOval)
    corners = [front.end, placement.point((2.0, 20.0)), placement.point((-2.0, 20.0)), front.start]
    faces: list[dict[str, Any]] = [{"name": "lens", "curve": {"kind": kind, **dataclasses.asdict(front)}}]
    faces += [
        {"name": name, "curve": {"kind": "segment", "a": a, "b": b}}
        for name, a, b in zip(("wall", "receiver", "wall"), corners, corners[1:], strict=False)
    ]
    emitters = [{"point": placement.point((0.0, -1.0)), "axis_deg": 90.0}]
    drawn = {"solen_outline": 1, "faces": faces, "emitters": emitters}
    (tmp_path / "own.json").write_text(json.dumps(drawn), encoding="utf-8")
    text = 'schema = 1\nname = "own"\n[material]\nindex = 1.44\n[body]\nkind = "outline"\nfile = "own.json"\n'
    drawn_front = nominal_front(loads(text, folder=tmp_path))
    assert drawn_front.is_symmetric
    assert np.abs(drawn_front.nearest(NOMINAL.front_mm[5:-5]).deviation_mm).max() < 1e-3
