"""A measured profile becomes a lens that is as smooth as its uncertainty requires, and no smoother."""

import math
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Spline
from solen.errors import DesignError
from solen.lens import FlatFace, MeasuredLens, OvalLens, lens_of, profile_of, profile_text
from solen.lens.fitted_profile import FittedProfile
from solen.plane import unit
from solen.refraction import refracted
from solen.spec import Design, loads
from tests.lens.measured_support import LENS, X, lens, noise_um, placed, profile

UNIFORM = np.linspace(-1.999, 1.999, 2003)


def normal_errors_mrad(measured: MeasuredLens, truth: OvalLens = LENS) -> FloatArray:
    return np.asarray(1e3 * (np.arctan(measured.slope(UNIFORM)) - np.arctan(truth.slope(UNIFORM))))


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_exact_points_of_an_oval_give_that_oval() -> None:
    measured = lens(profile())
    points = measured.front.points(np.linspace(0.0, 1.0, 4001))
    assert np.abs(points[:, 1] - LENS.z_mm(np.clip(points[:, 0], -2.0, 2.0))).max() < 1e-6  # the curve's tolerance
    assert measured.fit.deviation.rms_um < 1e-6
    assert measured.best_focus_mm(1.44) == pytest.approx(20.0, abs=1e-6)
    assert measured.best_focus_mm(1.5) == pytest.approx(LENS.best_focus_mm(1.5), abs=1e-3)
    assert measured.warnings == ()


def test_noise_of_half_a_micrometre_hardly_rotates_the_normals() -> None:
    """Straight lines between the points rotate normals by u √2 / 2 µm = 350 mrad, the lens by a thousandth of that."""
    noisy = profile(noise_um(0.5), 0.0005)
    measured = lens(noisy)
    raw = np.arctan(np.diff(noisy.z_mm) / np.diff(noisy.x_mm)) - np.arctan(LENS.slope(0.5 * (X[1:] + X[:-1])))
    assert 1e3 * rms(raw) > 200.0
    assert rms(normal_errors_mrad(measured)) < 0.35  # 0.02 to 0.15, depending on the seed of the noise
    assert measured.fit.smooth.residual == pytest.approx(1.0, abs=0.05)
    spot = measured.best_spot(1.44)
    assert spot is not None
    assert spot.rms_mm < 0.002  # a chip of 0.2 mm makes 2.8 mm
    assert spot.z_mm == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize(("size_um", "shape_mm"), [(20.0, 0.4), (5.0, 0.2)])
def test_a_bump_is_preserved(size_um: float, shape_mm: float) -> None:
    bump = size_um * np.exp(-(((X - 0.3) / shape_mm) ** 2))
    measured = lens(profile(bump + noise_um(0.5), 0.0005))
    expected = size_um * np.exp(-(((UNIFORM - 0.3) / shape_mm) ** 2))
    added_um = -1e3 * measured.fit.deviation_mm(UNIFORM) / np.hypot(1.0, LENS.slope(UNIFORM))
    assert rms(added_um - expected) < 0.25  # half the noise of one point
    assert measured.fit.deviation.max_um == pytest.approx(size_um, abs=0.6)
    assert measured.fit.deviation.max_x_mm == pytest.approx(0.3, abs=0.05)


def test_correlated_errors_are_smoothed_to_the_specified_uncertainty() -> None:
    """Likelihood alone would interpret such errors as shape and rotate the normals by more than 10 mrad."""
    measured = lens(profile(noise_um(0.5, neighbours=10.0), 0.0005))
    assert rms(normal_errors_mrad(measured)) < 3.0
    unknown = lens(profile(noise_um(0.5, neighbours=10.0), 1e-6))
    assert rms(normal_errors_mrad(unknown)) > 3.0


def test_warns_of_scatter_above_the_uncertainty() -> None:
    measured = lens(profile(noise_um(2.0), 0.0005))
    assert "scatter by 2" in measured.warnings[0]
    assert measured.fit.u_rms_um == pytest.approx(2.0, rel=0.12)
    assert rms(normal_errors_mrad(measured)) < 1.5


def test_warns_of_structure_finer_than_the_spline() -> None:
    measured = lens(profile(2.0 * np.sin(2.0 * np.pi * X / 0.012), 1e-5))
    assert "smoothed away" in " ".join(measured.warnings) or "scatter" in " ".join(measured.warnings)


def test_a_shift_and_a_rotation_are_determined() -> None:
    """They are determined to first order; the second order of a shift of 20 µm at a radius of 0.4 mm is 1 µm."""
    moved = lens(placed(x_shift_mm=0.005)).fit.deviation
    assert moved.shift_um[0] == pytest.approx(5.0, abs=0.1)
    assert moved.rest_um < 0.1
    turned = lens(placed(turn_deg=0.1)).fit.deviation
    assert turned.turn_mrad == pytest.approx(math.radians(0.1) * 1e3, abs=0.05)
    assert abs(turned.shift_um[0]) < 0.1


def test_the_smallest_spot_of_a_scaled_lens_agrees_with_single_rays() -> None:
    """A lens 3 % smaller with the emitter at the same distance: rays from exact intersections and Snell's law."""
    measured = lens(placed(scale=0.97)).best_spot(1.44)
    small = OvalLens(0.97, 0.97 * 20.0, 0.97 * 2.0, 1.44)
    edge_deg = lens(placed(scale=0.97)).designed.acceptance_deg
    starts, slopes = [], []
    for angle in np.radians(np.linspace(-edge_deg, edge_deg, 400)) * 0.985:  # inside the narrower oval
        ray = (float(np.sin(angle)), float(np.cos(angle)))
        distance = min(small.front.hits((0.0, -1.0), ray))
        x, z = distance * ray[0], distance * ray[1] - 1.0
        normal = small.front.normal_at((x, z))
        inside = refracted(unit(ray), (-normal[0], -normal[1]), 1.0, 1.44)
        assert inside is not None
        slopes.append(inside[0] / inside[1])
        starts.append(x - slopes[-1] * z)
    a, t = np.array(starts), np.array(slopes)
    best = -float(np.cov(a, t)[0, 1] / np.var(t, ddof=1))
    assert measured is not None
    assert measured.z_mm == pytest.approx(best, rel=0.02)  # the outermost rays are not among these
    assert best < 19.5


def test_a_cropped_profile_continues_with_its_last_deviation() -> None:
    cropped = profile(3.0, 0.0005, x=np.linspace(-1.7, 2.0, 1851))
    measured = lens(cropped)
    assert "covers x from -1.700 to 2.000 mm of a lens of ±2 mm" in measured.warnings[0]
    beyond = np.linspace(-2.0, -1.7, 31)
    added_um = -1e3 * measured.fit.deviation_mm(beyond) / np.hypot(1.0, LENS.slope(beyond))
    assert np.abs(added_um - 3.0).max() < 0.3  # it is constant along z, while the oval's slope changes by a tenth
    assert measured.fit.u_mm(np.array([-2.0]))[0] > 3.0 * measured.fit.u_mm(np.array([-1.6]))[0]
    steps = np.abs(np.diff(measured.slope(np.linspace(-1.72, -1.68, 401))))
    assert steps.max() < 1e-3  # no corner at the end of the profile


def test_a_wider_profile_is_cut_at_the_lens() -> None:
    wide = OvalLens(1.0, 20.0, 2.4, 1.44)
    measured = lens(profile(x=np.linspace(-2.3, 2.3, 2301), oval=wide))
    assert measured.front.start[0] == -2.0
    assert measured.front.end[0] == 2.0
    assert measured.fit.points[0].size == 2001


REFUSED = [
    (profile(x=np.linspace(-1.4, 2.0, 1701)), "must have at least 16, which cover -1.5 to 1.5 mm"),
    (profile(x=np.linspace(-0.03, 0.03, 31)), "31 points on the lens, from -0.03 to 0.03 mm"),
    (profile_of(X, LENS.z_mm(X) + 1.2, 0.0), "by +1.2 mm at x"),
    (profile_of(X, LENS.z_mm(X) - 0.95, 0.0), "the emitter is at z = -1 mm"),
    (profile_of(X, 0.0 * X, 0.0), "by -1.811 mm at x"),
]


@pytest.mark.parametrize(("measured", "message"), REFUSED)
def test_refuses_the_profile_of_another_lens(measured: object, message: str) -> None:
    with pytest.raises(DesignError) as refusal:
        lens(measured)  # type: ignore[arg-type]
    assert message in str(refusal.value)
    assert str(refusal.value).startswith("lens.profile")
    assert "\n" not in str(refusal.value)


def test_random_outlines_scatter_by_the_uncertainty() -> None:
    measured = lens(profile(noise_um(0.5), 0.0005))
    x = np.array([-1.2, 0.3])
    length_per_x = np.hypot(1.0, LENS.slope(x))
    outlines = np.array([(measured.with_outline(k).z_mm(x) - measured.z_mm(x)) / length_per_x for k in range(1, 301)])
    assert outlines.std(axis=0) == pytest.approx(0.0005, rel=0.15)  # 300 draws: 4 %
    assert np.abs(outlines.mean(axis=0)).max() < 4.0 * 0.0005 / 17.0
    assert np.array_equal(measured.with_outline(7).z_mm(x), measured.with_outline(7).z_mm(x))
    assert np.array_equal(measured.with_outline(0).z_mm(x), measured.z_mm(x))


def test_the_curve_of_a_random_outline_hardly_rotates_normals() -> None:
    measured = lens(profile(noise_um(0.5), 0.0005))
    smooth = measured.with_outline(0).front
    assert isinstance(smooth, Spline)
    for outlines in (measured.with_outline(1), measured.with_outline(2)):
        assert isinstance(outlines.front, Spline)
        x, z = outlines.front.points(np.linspace(0.0, 1.0, 4001)[5:-5]).T
        lean = np.arctan(np.gradient(z, x)) - np.arctan(outlines.slope(x))
        assert 1e3 * np.std(lean) < 0.1 * measured.fit.u_slope_mrad
        assert len(outlines.front.pieces) < 0.6 * len(smooth.pieces) + 5


def test_errors_of_random_outlines_have_the_correlation_length() -> None:
    measured = lens(profile(noise_um(0.5), 0.0005))
    table, length_mm = measured.fit.length_table, measured.fit.correlation_mm
    x = table.x_at(1.0 + np.array([0.0, length_mm, 3.0 * length_mm]))
    outlines = np.array([measured.with_outline(k).z_mm(x) - measured.z_mm(x) for k in range(1, 401)])
    correlation = np.corrcoef(outlines.T)[0]
    assert correlation[1] == pytest.approx(math.exp(-0.5), abs=0.1)
    assert abs(correlation[2]) < 0.2
    slopes = np.array([measured.with_outline(k).slope(UNIFORM[::40]) for k in range(1, 101)])
    angle = np.arctan(slopes) - np.arctan(measured.slope(UNIFORM[::40]))
    assert 1e3 * rms(angle) == pytest.approx(measured.fit.u_slope_mrad, rel=0.2)


def test_the_uncertainty_of_the_focus_is_proportional_to_that_of_points() -> None:
    sharp, vague = (lens(profile(noise_um(u), 1e-3 * u)).u_best_focus_mm(1.44) for u in (0.2, 2.0))
    assert sharp is not None
    assert vague is not None
    assert vague == pytest.approx(10.0 * sharp, rel=0.35)  # proportional, except for the smoothing


def design_with(folder: Path, text: str = "") -> Design:
    return loads(
        'schema = 1\nname = "print"\n[material]\nindex = 1.44\n[lens]\nshape = "measured"\nprofile = "lens.json"\n'
        + text,
        folder=folder,
    )


def test_a_profile_file_is_read_once_until_it_changes(tmp_path: Path) -> None:
    path = tmp_path / "lens.json"
    path.write_text(profile_text(profile()), encoding="utf-8")
    first = lens_of(design_with(tmp_path), 1.44)
    assert isinstance(first, MeasuredLens)
    assert lens_of(design_with(tmp_path), 1.44) is first
    path.write_text(profile_text(profile(5.0)), encoding="utf-8")
    second = lens_of(design_with(tmp_path), 1.44)
    assert isinstance(second, MeasuredLens)
    assert second.fit.deviation.rms_um == pytest.approx(5.0, abs=0.01)


def test_width_and_depth_are_those_of_the_design(tmp_path: Path) -> None:
    (tmp_path / "lens.json").write_text(profile_text(profile(9.0)), encoding="utf-8")
    measured = lens_of(design_with(tmp_path, "design_index = 1.44\n"), 1.6)
    assert (measured.half_width_mm, measured.distance_mm) == (2.0, 1.0)
    assert measured.depth_mm == LENS.depth_mm
    assert not isinstance(measured, FlatFace)


def test_coverage_of_a_complete_profile() -> None:
    fit = FittedProfile(LENS, profile())
    assert fit.reach_mm == (-2.0, 2.0)
    assert fit.missing_fraction == 0.0
    assert fit.unmeasured_acceptance == pytest.approx(0.0, abs=1e-12)
