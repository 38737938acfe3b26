"""Printed lenses in all orientations: convergence, shrinkage, print-through, uncertainty and compensation."""

import numpy as np
import pytest

from solen.errors import DataError, DesignError
from solen.fabricate.process import (
    Deviation,
    FlatPrint,
    MeasuredFeature,
    Printing,
    Process,
    SidePrint,
    Target,
    as_designed,
    compensated,
    curve_of,
    default_process,
    exits_um,
    lens_face,
    predicted,
    printed_mm,
    redrawn,
    rings_of,
    walls_um,
)
from solen.fabricate.process.flat import wash_and_taper_um
from solen.geometry import Body
from solen.material.cure import stack_print_through_um
from tests.fabricate.print_support import box, process, ring, round_target, settings
from tests.fabricate.solid_support import body_of, design, oval_z

NO_SHRINKAGE = {"shrinkage_percent": 0.0, "shrinkage_z_percent": 0.0}
NARROW = {"halo_um": 20.0, "halo_per_depth": 0.0, **NO_SHRINKAGE}
"""A narrow halo, for small images."""


@pytest.fixture(scope="module")
def body() -> Body:
    return body_of(design())


@pytest.fixture(scope="module")
def lens(body: Body) -> Target:
    return Target.of(lens_face(body).curve, 301)


def test_a_printed_disc_agrees_with_the_radial_integral() -> None:
    """The image of a disc, its dose and its edge agree with an integral of a Bessel function."""
    process = settings(pixel_um=6.0, **NO_SHRINKAGE)
    printed = FlatPrint.of([ring(0.2)], round_target(0.2), process, 6.0)
    # on the window side of a layer far inside, as for coupons
    offsets_um = printed.offsets_um(3000.0 - 1e-6)
    (size_mm,) = printed_mm(process, [MeasuredFeature("pillar", 0.4, None, None, True)])
    # the integral approximates scattered light by four groups, with an error of 0.2 µm
    assert float(offsets_um.mean()) == pytest.approx(0.5e3 * (size_mm - 0.4), abs=0.2)
    # a grey level is 1/255 of a pixel of 6 µm, 0.02 µm; the ripple along a circle is several times this
    assert float(np.ptp(offsets_um)) < 0.5


def test_converges_with_the_pixel_size() -> None:
    means, ripples = [], []
    for pixel in (24.0, 12.0, 6.0, 3.0):
        process = settings(pixel_um=pixel, sigma_um=12.0, halo_fraction=0.0, **NARROW)
        offsets_um = FlatPrint.of([ring(0.3)], round_target(0.3), process, 1.0).offsets_um(500.0)
        means.append(float(offsets_um.mean()))
        ripples.append(float(offsets_um.std()))
    steps = np.abs(np.diff(means))
    # a pixel adds a sixth of its square to the variance of the blur, so each halving leaves a quarter
    assert steps[1] < 0.35 * steps[0]
    assert steps[2] < 0.35 * steps[1]
    assert ripples[0] > ripples[1] > ripples[2]
    assert ripples[3] < 0.05


def test_converges_with_the_layer_thickness() -> None:
    """For a constant dose per height, the ripple is proportional to the layer thickness."""
    ripples, means = [], []
    for layer in (40.0, 20.0, 10.0):
        process = settings(layer_um=layer, exposure_s=2.0 * layer / 25.0, burn_in_layers=0, Ec_mJ_per_cm2=1.0, **NARROW)
        printed = FlatPrint.of([ring(0.3)], round_target(0.3), process, 2.0)
        ripples.append(printed.ripple_um(1000.0))
        means.append(float(printed.profile_um(1000.0).mean()))
    assert ripples[1] == pytest.approx(ripples[0] / 2, rel=0.05)
    assert ripples[2] == pytest.approx(ripples[1] / 2, rel=0.05)
    assert abs(means[2] - means[1]) < 0.3 * abs(means[1] - means[0]) + 0.02


def test_shrinkage_washing_and_taper() -> None:
    target = round_target(0.5)
    target = Target(target.points_mm, target.outward, target.along_mm, (0.0, 0.0))

    def printed(**values: float) -> FlatPrint:
        return FlatPrint.of([ring(0.5)], target, settings(pixel_um=9.0, **NARROW | values), 1.0)

    default_um = printed().offsets_um(500.0)
    shrunk_um = printed(shrinkage_percent=2.0).offsets_um(500.0)
    assert np.allclose(shrunk_um, 0.98 * (500.0 + default_um) - 500.0, atol=0.05)
    washed = printed(wash_um=-4.0, taper_deg=1.0)
    assert np.allclose(washed.offsets_um(500.0), default_um - 4.0, atol=1e-6)
    offset_um = wash_and_taper_um(washed.settings, 1000.0, washed.thickness_um)
    assert offset_um == pytest.approx(-4.0 + 500.0 * np.tan(np.radians(1.0)))


def test_the_dose_tapers_walls_at_both_ends() -> None:
    """Burn-in layers are larger and the last layers smaller; inside, walls are straight."""
    heights, walls = walls_um(settings(), 160)
    assert heights[[0, -1]].tolist() == [12.5, 3987.5]
    assert np.all(np.diff(walls[-20:]) < 0.0)
    assert walls[0] > walls[5] > walls[6]
    assert float(np.ptp(walls[10:110])) < 1e-3
    assert walls[-1] < walls[80] - 10.0


def test_compensation_reduces_the_deviation_of_a_lens(body: Body, lens: Target) -> None:
    process = default_process().process
    before = Deviation(lens, FlatPrint.of(rings_of(as_designed(body)), lens, process, 4.0).profile_um(2000.0))
    compensation = compensated(Printing(body, lens, process, 4.0, 2000.0))
    assert before.rms_um > 20.0
    assert compensation.printed.rms_um < 1.0
    # the corner between lens and stem cannot be printed; away from the ends, the deviation vanishes
    assert abs(compensation.printed.largest_um) < 10.0
    assert float(np.abs(compensation.printed.um[10:-10]).max()) < 3.0
    # the drawing, printed again, agrees with the oval by bisection
    printed_um = FlatPrint.of(rings_of(compensation.outlines), lens, process, 4.0).profile_um(2000.0)
    x, z = lens.displaced(printed_um).T
    inner = np.abs(x) < 1.9
    assert float(np.sqrt(np.mean((1e3 * (z[inner] - oval_z(x[inner]))) ** 2))) < 5.0
    assert compensation.scale == pytest.approx(1.0 / 0.99)
    assert -50.0 < compensation.wall_um < -20.0


def test_compensated_outlines_are_closed_and_keep_the_names_of_faces(body: Body, lens: Target) -> None:
    outlines = redrawn(body, lens.displaced(np.full(301, -35.0)), -30.0, 1.01, lens.centre)
    (faces,) = outlines
    assert [face.name for face in faces] == [face.name for face in body.faces]
    for face, following in zip(faces, (*faces[1:], faces[0]), strict=True):
        assert np.array_equal(face.points[-1], following.points[0])
        assert np.all(np.isfinite(curve_of(face).points(np.linspace(0.0, 1.0, 20))))
    # a straight face is moved along its normal by the wall correction, then scaled about the centre of the lens
    original = body.face("receiver-right").curve
    points = next(face for face in faces if face.name == "receiver-right").points
    normal = np.array(original.normal_at(original.middle_point))  # to the left, into the material
    centre = np.array(lens.centre)
    for point in points:
        displacement = centre + (point - centre) / 1.01 - np.array(original.start)
        assert float(displacement @ normal) == pytest.approx(0.030, abs=1e-9)


def test_refuses_a_wall_correction_that_removes_the_body(body: Body, lens: Target) -> None:
    with pytest.raises(DesignError):
        redrawn(body, lens.points_mm, -2500.0)


def test_the_print_through_of_an_overhang_is_that_of_its_total_dose() -> None:
    process = settings(Dp_um=50.0, burn_in_layers=0, **NO_SHRINKAGE)
    foot, slab = box((-2.0, 0.0), (-3.0, -2.8)), box((-2.0, 2.0), (-1.0, 1.0))
    lower = np.column_stack([np.linspace(0.6, 1.4, 30), np.full(30, -1.0)])
    side = np.column_stack([np.full(30, 2.0), np.linspace(-0.5, 0.5, 30)])
    points, outward = np.vstack([lower, side]), np.repeat([[0.0, -1.0], [1.0, 0.0]], 30, axis=0)
    target = Target(points, outward, np.linspace(0.0, 1.0, 60), (1.0, -1.0))
    printed = SidePrint.of([foot, slab], target, process, "upright-lens-first").profile_um()
    expected = stack_print_through_um(26.0, 25.0, 50.0, 5.0)
    # the logarithm of the dose is interpolated linearly between five heights per layer
    assert np.allclose(printed[:30], expected, atol=0.5)


def test_only_faces_towards_the_plate_have_print_through(body: Body) -> None:
    target = Target.of(lens_face(body).curve, 801)
    rings = rings_of(as_designed(body))
    last = SidePrint.of(rings, target, settings(**NO_SHRINKAGE), "upright").profile_um()
    first = SidePrint.of(rings, target, settings(**NO_SHRINKAGE), "upright-lens-first").profile_um()
    side = SidePrint.of(rings, target, settings(**NO_SHRINKAGE), "on-edge")
    edge = side.profile_um()
    middle = slice(300, 500)
    assert float(np.abs(last).mean()) < 30.0
    assert float(first[100:300].mean()) > 120.0  # print-through of the overhang
    assert abs(float(first[middle].min())) < 20.0  # limited by the plate at the vertex
    assert float(edge[:200].mean()) > 120.0  # the half of the lens that faces the plate
    assert float(edge[-200:].mean()) < 40.0
    smooth, ripple = side.steps(edge)
    assert np.allclose(smooth + ripple, edge)
    # steps of 25 µm on a slope of 45° are 25 cos 45° = 18 µm high; on the half that faces the plate, they are filled
    assert 12.0 < float(np.ptp(np.percentile(ripple[500:750], [1, 99]))) < 22.0
    assert float(np.abs(ripple[100:300]).max()) < 2.0


def test_steps_are_proportional_to_the_layer_thickness(body: Body) -> None:
    target = Target.of(lens_face(body).curve, 1601)
    rings = rings_of(as_designed(body))
    heights = []
    for layer in (50.0, 25.0, 12.5):
        process = settings(layer_um=layer, exposure_s=2.0 * layer / 25.0 + 0.5, **NO_SHRINKAGE)
        printed = SidePrint.of(rings, target, process, "upright")
        heights.append(float(printed.steps(printed.profile_um())[1][300:600].std()))
    assert heights[1] == pytest.approx(heights[0] / 2, rel=0.35)
    assert heights[2] == pytest.approx(heights[1] / 2, rel=0.35)


def test_contributions_to_the_uncertainty(body: Body, lens: Target) -> None:
    rings = rings_of(as_designed(body))
    exact = predicted(rings, lens, process(), 4.0, height_um=2000.0)
    assert list(exact.contributions_um) == ["position in the pixel"]
    uncertain = Process(name="test", process=settings(), uncertainty={"wash_um": 7.0, "shrinkage_percent": 0.5})
    prediction = predicted(rings, lens, uncertain, 4.0, height_um=2000.0)
    assert prediction.contributions_um["wash_um"] == pytest.approx(7.0, abs=0.01)
    # a scale of 0.5 % moves the ends, 2.7 mm from the centre of the lens, by 13 µm, mostly along the face
    assert 0.5 < prediction.contributions_um["shrinkage_percent"] < 13.0
    assert float(prediction.u_um.mean()) > 7.0


def test_the_mean_growth_is_less_than_that_at_mid_height(body: Body, lens: Target) -> None:
    printed = FlatPrint.of(rings_of(as_designed(body)), lens, settings(**NARROW), 2.0)
    assert float(printed.profile_um(None).mean()) < float(printed.profile_um(1000.0).mean())
    with pytest.raises(DataError, match=r"--at = 2\.001"):
        printed.layer_at(2001.0)


def test_refuses_coarse_pixels_and_thin_parts(body: Body, lens: Target) -> None:
    rings = rings_of(as_designed(body))
    with pytest.raises(DataError, match=r"process\.pixel_um = 300\.0; .*20 pixels"):
        FlatPrint.of(rings, lens, settings(pixel_um=300.0, sigma_um=100.0, halo_um=200.0), 4.0)
    with pytest.raises(DataError, match="25 µm"):
        FlatPrint.of(rings, lens, settings(), 0.01)
    with pytest.raises(DataError, match="20 pixels"):
        SidePrint.of(rings, lens, settings(pixel_um=300.0), "upright")
    with pytest.raises(DataError, match=r"process\.layer_um = 1000"):
        SidePrint.of(rings, lens, settings(layer_um=1000.0, exposure_s=100.0), "upright")


def test_refuses_prints_that_are_too_expensive(body: Body, lens: Target) -> None:
    rings = rings_of(as_designed(body))
    with pytest.raises(DataError, match=r"process\.halo_um = 9000\.0"):
        FlatPrint.of(rings, lens, settings(halo_um=9000.0), 4.0)
    with pytest.raises(DataError, match=r"400,000 layers.*10,000"):
        FlatPrint.of(rings, lens, settings(layer_um=1.0), 400.0)
    with pytest.raises(DataError, match="thicker layers"):
        SidePrint.of(rings, lens, settings(layer_um=1.0), "on-edge")


def test_refuses_a_lens_that_does_not_cure(lens: Target) -> None:
    with pytest.raises(DataError, match="no wall"):
        exits_um(lambda points: np.full(points.shape[:-1], -1.0), lens, 50.0)


def test_compensation_converges_if_full_steps_oscillate(body: Body) -> None:
    """With pixels of 27 µm, full steps oscillate near the vertex, and are halved."""
    target = Target.of(lens_face(body).curve, 601)
    compensation = compensated(Printing(body, target, settings(sigma_um=13.0), 4.0, 2000.0))
    assert (np.diff(compensation.rounds_um) <= 1e-9).all()
    inner = np.abs(target.points_mm[:, 0]) < 1.95
    assert np.sqrt(np.mean(compensation.printed.um[inner] ** 2)) < 0.6
