"""Coupons in simulated images and height maps, in any pose: measured within their uncertainty, or refused."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import solen.cli.print.fidelity  # noqa: F401  registers its lines
from solen.arrays import FloatArray
from solen.cli.app import lines
from solen.errors import DataError
from solen.geometry.coupons import Coupon, CouponOptions, Feature, layout
from solen.metrology import Image, as_image
from solen.metrology.coupons import CouponMeasurement, MeasuredSize, fit_disc, measure_coupon
from solen.metrology.height_map import HeightMap
from solen.metrology.scale import Scale
from solen.recording import Provenance
from tests.metrology.coupon_support import Camera, Print, circle
from tests.metrology.render.coverage import coverage
from tests.metrology.render.optics import gaussian
from tests.metrology.render.scenery import dust, fibres

UM = 13.0


def sizes(coupon: Coupon, grown_mm: float, seed: int = 5, scatter_mm: float = 0.003) -> dict[str, float]:
    """Printed diameters: all larger by the same, each by a little of its own."""
    rng = np.random.default_rng(seed)
    return {one.name: one.diameter_mm + grown_mm + scatter_mm * rng.standard_normal() for one in coupon.features}


def printed(coupon: Coupon, grown_mm: float = 0.02, **values: Any) -> tuple[Print, dict[str, float]]:
    chosen = sizes(coupon, grown_mm)
    return Print(coupon, size_mm=lambda one: chosen[one.name], **values), chosen


def as_micrograph(grey: FloatArray, um_per_px: float, u_um_per_px: float | None = None) -> Image:
    return as_image(grey, um_per_px, u_um_per_px=u_um_per_px, name="image.png")


def by_name(found: CouponMeasurement) -> dict[str, MeasuredSize]:
    return {one.name: one for one in found.measured}


def limit(found: CouponMeasurement, kind: str) -> Any:
    (one,) = [one for one in found.limits if one.kind == kind]
    return one


def check_sizes(found: CouponMeasurement, true: dict[str, float], most: float = 4.0) -> None:
    """Every diameter within so many uncertainties, two thirds of them within one and a half."""
    off = [
        abs(one.measured_mm - true[one.name]) / one.u_measured_mm
        for one in found.measured
        if one.kind in {"pillar", "hole"} and one.measured_mm is not None and one.u_measured_mm is not None
    ]
    assert max(off) < most, off
    assert np.mean(np.array(off) < 1.5) > 0.66, off


def disc(
    radius_px: float, rng: np.random.Generator, *, blur_px: float = 2.0, noise: float = 0.03
) -> tuple[FloatArray, FloatArray]:
    side = int(2 * radius_px + 60)
    middle = side / 2 + rng.uniform(-0.5, 0.5, 2)
    ring = np.asarray(circle(float(middle[0]), float(middle[1]), radius_px).exterior.coords)
    image = 0.25 + 0.5 * gaussian(blur_px)(coverage([ring], (side, side)), 1) + 0.0008 * np.arange(side)
    return image + noise * rng.standard_normal(image.shape), middle


def fitted_discs(radius_px: float, count: int) -> FloatArray:
    """Deviation of the diameter and its uncertainty, px, shape (count, 2)."""
    rng = np.random.default_rng(round(10 * radius_px))
    rows = []
    for _ in range(count):
        image, middle = disc(radius_px, rng)
        place = (middle[0] - 0.5 + rng.uniform(-1, 1), middle[1] - 0.5 + rng.uniform(-1, 1))
        blur = 2.0 if radius_px < 8 else None
        found = fit_disc(image, place, radius_px * 1.05, 20.0, bright=True, blur_px=blur)
        assert found is not None
        rows.append((found.diameter_px - 2 * radius_px, found.u_diameter_px))
        assert math.hypot(found.x_px + 0.5 - middle[0], found.y_px + 0.5 - middle[1]) < 0.3
    return np.array(rows)


def check_discs(radius_px: float, count: int) -> None:
    """At 3 % noise and a blur of 2 px: bias of a radius below 0.05 px beyond chance, and honest uncertainties."""
    off, u = fitted_discs(radius_px, count).T
    assert abs(off.mean()) < 2 * 0.05 + 3 * off.std() / math.sqrt(count)
    assert np.mean((off / u) ** 2) < 1.0 + 4 * math.sqrt(2 / count)


@pytest.mark.parametrize("radius_px", [4.0, 15.0, 60.0])
def test_a_disc_has_its_diameter(radius_px: float) -> None:
    check_discs(radius_px, 12)


@pytest.mark.evidence
@pytest.mark.parametrize("radius_px", [3.0, 5.0, 8.0, 15.0, 40.0, 120.0])
def test_many_discs_have_their_diameter(radius_px: float) -> None:
    off, u = fitted_discs(radius_px, 100).T
    print(
        f"radius {radius_px} px: bias {off.mean():+.4f} px, scatter {off.std():.4f}, stated {u.mean():.4f} (diameter)"
    )
    assert abs(off.mean()) < 0.1 + 3 * off.std() / 10
    assert np.mean((off / u) ** 2) < 1.6


def test_an_oval_has_its_mean_diameter() -> None:
    """Its form counts in the uncertainty."""
    angle = np.linspace(0, math.tau, 721)
    ring = np.column_stack([60.2 + 31 * np.cos(angle), 59.7 + 29 * np.sin(angle)])
    found = fit_disc(0.2 + 0.6 * gaussian(2.0)(coverage([ring], (120, 120)), 1), (59.7, 59.2), 30.0, 20.0, bright=True)
    assert found is not None
    assert found.diameter_px == pytest.approx(60.0, abs=0.1)
    assert found.u_diameter_px > 0.2
    assert found.roundness_px == pytest.approx(1 / math.sqrt(2), rel=0.1), "radii by ± 1 px as a cosine"


@pytest.mark.parametrize(
    ("angle_deg", "mirrored"), [(4.0, False), pytest.param(-176.0, True, marks=pytest.mark.evidence)]
)
def test_the_smallest_pillar_is_the_last_that_stands(angle_deg: float, mirrored: bool) -> None:
    coupon = layout("group-a")
    part, true = printed(coupon, missing=frozenset({"d-0.06", "d-0.08", "d-0.1", "d-0.12", "d-0.18"}))
    image = Camera(UM, angle_deg, mirrored, blur_px=1.5).image(part)
    found = measure_coupon(as_micrograph(image, UM, 0.0), coupon)
    check_sizes(found, true)
    told = by_name(found)
    assert [name for name, one in told.items() if one.resolved is False] == [
        "d-0.18",
        "d-0.12",
        "d-0.1",
        "d-0.08",
        "d-0.06",
    ]
    smallest = limit(found, "positive_diameter")
    assert (smallest.nominal_mm, smallest.next_mm, smallest.bound) == (0.2, 0.18, False), (
        "0.16 stands and does not count"
    )
    assert smallest.measured_mm == pytest.approx(true["d-0.2"], abs=4 * smallest.u_measured_mm)
    pose = found.location.pose
    assert math.remainder(pose.rotation_deg - angle_deg, 360) == pytest.approx(0.0, abs=0.02)
    assert found.location.oriented
    assert pose.mirrored is mirrored
    assert any("shows the coupon mirrored" in text for text in found.warnings) is mirrored
    assert ("seen mirrored" in next(iter(lines(found)))) is mirrored
    turned_over = replace(found, location=replace(found.location, pose=replace(pose, mirrored=True), oriented=True))
    assert "seen mirrored" in next(iter(lines(turned_over)))
    assert found.pitch_ratio == pytest.approx(1.0, abs=1e-4)


def test_dust_and_a_shrunk_print() -> None:
    coupon = layout("group-a")
    part, true = printed(coupon, stretch=0.97)
    image = Camera(UM, 10.0, blur_px=1.5).image(part, seed=2)
    rng = np.random.default_rng(7)
    for dirt in (dust(25, 6.0, 0.1), dust(15, 8.0, 0.9), fibres(2, 200.0, 3.0, 0.8)):
        image = dirt(image, rng)
    found = measure_coupon(as_micrograph(image, UM), coupon)
    assert found.pitch_ratio == pytest.approx(0.97, abs=5e-4)
    assert any("by -3.0 %" in line for line in found.warnings)
    near = [one for one in found.measured if one.measured_mm and abs(one.measured_mm - true[one.name]) < 0.004]
    assert len(near) >= 14, "of eighteen; some have dirt on their edge"


@pytest.mark.parametrize("reading", ["pairs", pytest.param("row", marks=pytest.mark.evidence)])
def test_the_smallest_gap_is_the_last_that_is_open(reading: str) -> None:
    coupon = layout("group-b", CouponOptions(gap_reading=reading))
    merged = ("g-0.08", "g-0.06", "g-0.05", "g-0.04", "g-0.03", "g-0.02")
    part, true = printed(coupon, 0.01, merged=frozenset(merged))
    image = Camera(7.0, -8.0).image(part)
    found = measure_coupon(as_micrograph(image, 7.0, 0.0), coupon)
    told = by_name(found)
    for gap in coupon.gaps:
        one = told[gap.name]
        assert one.resolved is (gap.name not in merged), gap.name
        if one.resolved and one.measured_mm is not None and one.u_measured_mm is not None:
            left, right = (coupon.feature(name) for name in gap.between)
            free = math.dist((left.x_mm, left.y_mm), (right.x_mm, right.y_mm))
            free -= 0.5 * (true[left.name] + true[right.name])
            assert one.measured_mm == pytest.approx(free, abs=4 * one.u_measured_mm), gap.name
    assert (limit(found, "gap").nominal_mm, limit(found, "gap").next_mm) == (0.1, 0.08)


def test_a_gap_whose_pillar_is_missing_is_not_reported() -> None:
    coupon = layout("group-b")
    part, _ = printed(coupon, missing=frozenset({"g-0.15-left"}))
    found = measure_coupon(as_micrograph(Camera(UM, blur_px=1.2).image(part), UM), coupon)
    assert by_name(found)["g-0.15"].resolved is None
    assert "g-0.15-left" in by_name(found)["g-0.15"].reason
    assert limit(found, "gap").next_mm == 0.15


@pytest.mark.parametrize("bright", [True, False])
def test_holes_and_their_smallest_variation(bright: bool) -> None:
    coupon = layout("holes")
    part, true = printed(coupon, -0.04)
    levels = {"outside": 0.8, "slab": 0.3, "raised": 0.3} if bright else {"outside": 0.1, "slab": 0.6, "raised": 0.6}
    found = measure_coupon(as_micrograph(Camera(UM, 185.0, levels=levels).image(part), UM, 0.0), coupon)
    check_sizes(found, true)
    assert found.location.bright is bright
    assert (limit(found, "hole").nominal_mm, limit(found, "hole").bound) == (1.4, True)
    variation = limit(found, "hole_variation")
    assert variation.nominal_mm == 0.05
    assert variation.bound, "no smaller difference is on the coupon"


def test_closed_holes() -> None:
    coupon = layout("holes", CouponOptions(hole_reading="tenths"))
    part, _ = printed(coupon, -0.04, missing=frozenset({"hole-1.4", "hole-1.5"}))
    levels = {"outside": 0.8, "slab": 0.3, "raised": 0.3}
    found = measure_coupon(as_micrograph(Camera(UM, levels=levels).image(part), UM), coupon)
    assert (limit(found, "hole").nominal_mm, limit(found, "hole").next_mm) == (1.6, 1.5)


def z_measured(camera: Camera, part: Print) -> CouponMeasurement:
    z = camera.height_map(part)
    z[np.random.default_rng(1).random(z.shape) < 0.02] = np.nan
    return measure_coupon(HeightMap(z, Scale(camera.um_per_px, 0.0), Provenance()), part.coupon)


def test_steps_of_a_layer_are_resolved() -> None:
    coupon = layout("group-c")
    found = z_measured(Camera(16.0, 8.0), Print(coupon, height_mm=lambda one: 0.98 * one.height_mm))
    for one in found.heights:
        true = 0.98 * coupon.feature(one.name).height_mm
        assert one.measured_mm == pytest.approx(true, abs=5 * one.u_measured_mm + 2e-4), "2e-4: the median of the top"
    step = limit(found, "z_step")
    assert (step.nominal_mm, step.bound) == (0.025, True)
    assert step.measured_mm == pytest.approx(0.0245, abs=4 * step.u_measured_mm)


def test_steps_below_the_layer_are_not() -> None:
    """Heights of whole layers of 50 µm: every second step of 25 µm is nothing."""
    coupon = layout("group-c")
    part = Print(coupon, height_mm=lambda one: round(one.height_mm / 0.05 + 1e-6) * 0.05)
    found = z_measured(Camera(16.0), part)
    assert (limit(found, "z_step").nominal_mm, limit(found, "z_step").next_mm) == (0.05, 0.025)
    fine = [one for one in found.measured if one.kind == "step" and one.nominal_mm == 0.025]
    assert 0 < sum(one.resolved is False for one in fine) < len(fine)


@pytest.mark.parametrize(("reading", "angle_deg"), [("literal", 200.0), ("staircase", 0.0)])
def test_the_reference_of_height(reading: str, angle_deg: float) -> None:
    coupon = layout("z-reference", CouponOptions(reference_reading=reading))
    found = z_measured(Camera(16.0, angle_deg), Print(coupon))
    for one in found.heights:
        assert one.measured_mm == pytest.approx(coupon.feature(one.name).height_mm, abs=5 * one.u_measured_mm + 2e-4)
    assert limit(found, "z_step").nominal_mm == pytest.approx(0.025)


def test_what_lies_outside_is_said() -> None:
    coupon = layout("group-a")
    image = Camera(UM, blur_px=1.5).image(printed(coupon)[0])
    found = measure_coupon(as_micrograph(image[:, : image.shape[1] // 2], UM), coupon)
    told = by_name(found)
    assert told["d-1"].resolved is True
    assert told["mark-3"].reason == told["d-0.06"].reason == "not in the image"
    assert any("are not in the image" in line for line in found.warnings)
    smallest = limit(found, "positive_diameter")
    assert smallest.bound, "the smaller ones are not seen, so it may be smaller"


def test_pillars_too_small_for_the_pixels_are_not_reported() -> None:
    coupon = layout("group-a")
    image = Camera(40.0, blur_px=1.0, noise=0.01).image(printed(coupon)[0])
    found = measure_coupon(as_micrograph(image, 40.0), coupon)
    told = by_name(found)
    assert told["d-0.06"].resolved is None
    assert told["d-0.06"].reason == "too small for this image"
    assert any("d-0.06" in line and "too small" in line for line in found.warnings)


def test_a_grid_without_its_marks_is_refused() -> None:
    coupon = layout("group-c")
    camera = Camera(16.0)
    part = Print(coupon, height_mm=lambda _: 1.0, missing=frozenset({"mark-1", "mark-2", "mark-3"}))
    with pytest.raises(DataError, match=r"has an ambiguous pose|shows no group-c"):
        z_measured(camera, replace(part, missing=part.missing | some_row(coupon)))


def some_row(coupon: Coupon) -> frozenset[str]:
    """All but the middle of the third row."""
    kept = {f"row-3-h-{height:g}" for height in (0.3, 0.325, 0.35, 0.375, 0.4)}
    return frozenset(one.name for one in coupon.features if one.name not in kept)


@pytest.mark.parametrize("kind", ["noise", "flat", "another coupon", "wrong scale"])
def test_what_is_no_such_coupon_is_refused(kind: str) -> None:
    rng = np.random.default_rng(3)
    scale, image = UM, 0.5 + 0.05 * rng.standard_normal((500, 900))
    if kind == "flat":
        image = np.full((400, 400), 0.5)
    if kind == "another coupon":
        image = Camera(UM).image(Print(layout("group-b")))
    if kind == "wrong scale":
        image, scale = Camera(UM).image(Print(layout("group-a"))), 5.0
    with pytest.raises(DataError) as told:
        measure_coupon(as_micrograph(image, scale), layout("group-a"))
    assert "image.png; shows no group-a" in str(told.value)


@pytest.mark.parametrize("name", ["cubes", "guides", "cure-discs", "film-layer"])
def test_what_no_image_shows_is_refused(name: str) -> None:
    with pytest.raises(DataError, match="has no features that an image shows"):
        measure_coupon(as_micrograph(np.zeros((99, 99)), UM), layout(name))


@pytest.mark.parametrize("name", ["group-c", "z-reference"])
def test_heights_want_a_height_map(name: str) -> None:
    with pytest.raises(DataError, match="--z-um"):
        measure_coupon(as_micrograph(np.zeros((99, 99)), UM), layout(name))


def test_the_scale_s_uncertainty_goes_along() -> None:
    coupon = layout("group-a")
    image = Camera(UM, blur_px=1.5).image(Print(coupon))
    sure, unsure = (by_name(measure_coupon(as_micrograph(image, UM, u), coupon))["d-1"] for u in (0.0, 0.1))
    assert sure.u_measured_mm is not None
    assert unsure.u_measured_mm == pytest.approx(
        math.hypot(sure.u_measured_mm, 0.1 / UM * float(sure.measured_mm or 0)), rel=1e-6
    )


def feature(name: str) -> Feature:
    return layout("group-a").feature(name)


def test_a_ring_of_light_is_no_pillar() -> None:
    """Where a pillar broke off a bright arc is left: less than three quarters of an edge."""
    coupon = layout("group-a")
    part = Print(coupon, missing=frozenset({"d-0.4"}))
    camera = Camera(UM, blur_px=1.5, noise=0.02)
    image = camera.image(part)
    one = feature("d-0.4")
    angle = np.linspace(0, math.pi, 91)
    outer, inner = (np.column_stack([one.x_mm + r * np.cos(angle), one.y_mm + r * np.sin(angle)]) for r in (0.2, 0.17))
    import shapely

    image = image + 0.3 * camera.cover(shapely.Polygon(np.vstack([outer, inner[::-1]])), coupon)
    found = measure_coupon(as_micrograph(image, UM), coupon)
    assert by_name(found)["d-0.4"].resolved is False
