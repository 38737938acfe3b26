"""A measured profile becomes a lens: as smooth as its uncertainty asks for, and no smoother."""

import math
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.curve import Spline
from solen.errors import DesignError
from solen.interface import refracted
from solen.lens import FlatFace, MeasuredLens, OvalLens, lens_of, profile_of, profile_text
from solen.lens.fitted_profile import FittedProfile
from solen.plane import unit
from solen.spec import Design, loads
from tests.lens.measured_support import LENS, X, lens, noise_um, placed, profile

EVENLY = np.linspace(-1.999, 1.999, 2003)


def normals_off_mrad(found: MeasuredLens, truth: OvalLens = LENS) -> FloatArray:
    return np.asarray(1e3 * (np.arctan(found.slope(EVENLY)) - np.arctan(truth.slope(EVENLY))))


def rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def test_the_points_of_an_oval_are_that_oval() -> None:
    found = lens(profile())
    points = found.front.points(np.linspace(0.0, 1.0, 4001))
    assert np.abs(points[:, 1] - LENS.z_mm(np.clip(points[:, 0], -2.0, 2.0))).max() < 1e-6  # the curve's tolerance
    assert found.fit.deviation.rms_um < 1e-6
    assert found.best_focus_mm(1.44) == pytest.approx(20.0, abs=1e-6)
    assert found.best_focus_mm(1.5) == pytest.approx(LENS.best_focus_mm(1.5), abs=1e-3)
    assert found.warnings == ()


def test_noise_of_half_a_micrometre_hardly_turns_the_normals() -> None:
    """A straight line from point to point turns them by u √2 / 2 µm = 350 mrad; what is traced, by a thousandth."""
    noisy = profile(noise_um(0.5), 0.0005)
    found = lens(noisy)
    raw = np.arctan(np.diff(noisy.z_mm) / np.diff(noisy.x_mm)) - np.arctan(LENS.slope(0.5 * (X[1:] + X[:-1])))
    assert 1e3 * rms(raw) > 200.0
    assert rms(normals_off_mrad(found)) < 0.35  # 0.02 to 0.15 by the noise's seed
    assert found.fit.smooth.residual == pytest.approx(1.0, abs=0.05)
    spot = found.best_spot(1.44)
    assert spot is not None
    assert spot.rms_mm < 0.002  # a chip of 0.2 mm makes 2.8 mm
    assert spot.z_mm == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize(("size_um", "shape_mm"), [(20.0, 0.4), (5.0, 0.2)])
def test_a_bump_is_kept(size_um: float, shape_mm: float) -> None:
    bump = size_um * np.exp(-(((X - 0.3) / shape_mm) ** 2))
    found = lens(profile(bump + noise_um(0.5), 0.0005))
    expected = size_um * np.exp(-(((EVENLY - 0.3) / shape_mm) ** 2))
    more = -1e3 * found.fit.deviation_mm(EVENLY) / np.hypot(1.0, LENS.slope(EVENLY))
    assert rms(more - expected) < 0.25  # half the noise of one point
    assert found.fit.deviation.max_um == pytest.approx(size_um, abs=0.6)
    assert found.fit.deviation.max_x_mm == pytest.approx(0.3, abs=0.05)


def test_errors_that_neighbours_share_are_smoothed_to_the_stated_uncertainty() -> None:
    """Twenty points to a length: likelihood alone takes them for shape and turns the normals by over 10 mrad."""
    found = lens(profile(noise_um(0.5, neighbours=10.0), 0.0005))
    assert rms(normals_off_mrad(found)) < 3.0
    unknown = lens(profile(noise_um(0.5, neighbours=10.0), 1e-6))
    assert rms(normals_off_mrad(unknown)) > 3.0


def test_points_that_scatter_more_than_stated_are_reported() -> None:
    found = lens(profile(noise_um(2.0), 0.0005))
    assert "scatter by 2" in found.warnings[0]
    assert found.fit.u_rms_um == pytest.approx(2.0, rel=0.12)
    assert rms(normals_off_mrad(found)) < 1.5


def test_structure_finer_than_the_spline_is_reported() -> None:
    found = lens(profile(2.0 * np.sin(2.0 * np.pi * X / 0.012), 1e-5))
    assert "smoothed away" in " ".join(found.warnings) or "scatter" in " ".join(found.warnings)


def test_a_shifted_and_a_turned_lens_are_recognised() -> None:
    """To first order in the shift; the second is some (20 µm)² by the vertex radius of 0.4 mm, a micrometre."""
    moved = lens(placed(x_shift_mm=0.005)).fit.deviation
    assert moved.shift_um[0] == pytest.approx(5.0, abs=0.1)
    assert moved.rest_um < 0.1
    turned = lens(placed(turn_deg=0.1)).fit.deviation
    assert turned.turn_mrad == pytest.approx(math.radians(0.1) * 1e3, abs=0.05)
    assert abs(turned.shift_um[0]) < 0.1


def test_the_smallest_spot_of_a_scaled_lens_is_that_of_its_rays() -> None:
    """A lens 3 % smaller, its emitter where it was: rays by the exact oval's own hits and Snell's law."""
    found = lens(placed(scale=0.97)).best_spot(1.44)
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
    assert found is not None
    assert found.z_mm == pytest.approx(best, rel=0.02)  # the outermost rays are not among these
    assert best < 19.5


def test_a_cropped_profile_goes_on_beside_the_design() -> None:
    cropped = profile(3.0, 0.0005, x=np.linspace(-1.7, 2.0, 1851))
    found = lens(cropped)
    assert "covers x from -1.700 to 2.000 mm of a lens of ±2 mm" in found.warnings[0]
    beyond = np.linspace(-2.0, -1.7, 31)
    more = -1e3 * found.fit.deviation_mm(beyond) / np.hypot(1.0, LENS.slope(beyond))
    assert np.abs(more - 3.0).max() < 0.3  # along z it stays as it is, and the oval's slope changes by a tenth
    assert found.fit.u_mm(np.array([-2.0]))[0] > 3.0 * found.fit.u_mm(np.array([-1.6]))[0]
    steps = np.abs(np.diff(found.slope(np.linspace(-1.72, -1.68, 401))))
    assert steps.max() < 1e-3  # no corner where it goes on


def test_a_wider_profile_is_cut_at_the_lens() -> None:
    wide = OvalLens(1.0, 20.0, 2.4, 1.44)
    found = lens(profile(x=np.linspace(-2.3, 2.3, 2301), oval=wide))
    assert found.front.start[0] == -2.0
    assert found.front.end[0] == 2.0
    assert found.fit.points[0].size == 2001


REFUSED = [
    (profile(x=np.linspace(-1.4, 2.0, 1701)), "needs at least 16 points, which cover -1.5 to 1.5 mm"),
    (profile(x=np.linspace(-0.03, 0.03, 31)), "31 points from -0.03 to 0.03 mm"),
    (profile_of(X, LENS.z_mm(X) + 1.2, 0.0), "+1.2 mm from the design"),
    (profile_of(X, LENS.z_mm(X) - 0.95, 0.0), "the emitter is at z = -1 mm"),
    (profile_of(X, 0.0 * X, 0.0), "-1.811 mm from the design"),
]


@pytest.mark.parametrize(("found", "words"), REFUSED)
def test_a_profile_of_another_thing_is_refused(found: object, words: str) -> None:
    with pytest.raises(DesignError) as refusal:
        lens(found)  # type: ignore[arg-type]
    assert words in str(refusal.value)
    assert str(refusal.value).startswith("lens.profile")
    assert "\n" not in str(refusal.value)


def test_drawn_outlines_scatter_as_the_profile_is_known() -> None:
    found = lens(profile(noise_um(0.5), 0.0005))
    x = np.array([-1.2, 0.3])
    steep = np.hypot(1.0, LENS.slope(x))
    drawn = np.array([(found.drawn_within(k).z_mm(x) - found.z_mm(x)) / steep for k in range(1, 301)])
    assert drawn.std(axis=0) == pytest.approx(0.0005, rel=0.15)  # 300 draws: 4 %
    assert np.abs(drawn.mean(axis=0)).max() < 4.0 * 0.0005 / 17.0
    assert np.array_equal(found.drawn_within(7).z_mm(x), found.drawn_within(7).z_mm(x))
    assert np.array_equal(found.drawn_within(0).z_mm(x), found.z_mm(x))


def test_the_curve_of_a_drawn_outline_turns_normals_by_far_less_than_the_uncertainty() -> None:
    found = lens(profile(noise_um(0.5), 0.0005))
    whole = found.drawn_within(0).front
    assert isinstance(whole, Spline)
    for drawn in (found.drawn_within(1), found.drawn_within(2)):
        assert isinstance(drawn.front, Spline)
        x, z = drawn.front.points(np.linspace(0.0, 1.0, 4001)[5:-5]).T
        lean = np.arctan(np.gradient(z, x)) - np.arctan(drawn.slope(x))
        assert 1e3 * np.std(lean) < 0.1 * found.fit.u_slope_mrad
        assert len(drawn.front.pieces) < 0.6 * len(whole.pieces) + 5


def test_errors_of_a_drawn_outline_go_together_over_the_stated_length() -> None:
    found = lens(profile(noise_um(0.5), 0.0005))
    track, length_mm = found.fit.track, found.fit.correlation_mm
    x = track.x_at(1.0 + np.array([0.0, length_mm, 3.0 * length_mm]))
    drawn = np.array([found.drawn_within(k).z_mm(x) - found.z_mm(x) for k in range(1, 401)])
    correlation = np.corrcoef(drawn.T)[0]
    assert correlation[1] == pytest.approx(math.exp(-0.5), abs=0.1)
    assert abs(correlation[2]) < 0.2
    slopes = np.array([found.drawn_within(k).slope(EVENLY[::40]) for k in range(1, 101)])
    angle = np.arctan(slopes) - np.arctan(found.slope(EVENLY[::40]))
    assert 1e3 * rms(angle) == pytest.approx(found.fit.u_slope_mrad, rel=0.2)


def test_the_focus_has_the_uncertainty_that_drawn_outlines_give() -> None:
    sharp, vague = (lens(profile(noise_um(u), 1e-3 * u)).u_best_focus_mm(1.44) for u in (0.2, 2.0))
    assert sharp is not None
    assert vague is not None
    assert vague == pytest.approx(10.0 * sharp, rel=0.35)  # in proportion, but for where it is smoothed


def design_with(folder: Path, text: str = "") -> Design:
    return loads(
        'schema = 1\nname = "print"\n[material]\nindex = 1.44\n[lens]\nshape = "measured"\nprofile = "lens.json"\n'
        + text,
        folder=folder,
    )


def test_a_design_s_lens_is_read_once_as_long_as_its_file_stays(tmp_path: Path) -> None:
    path = tmp_path / "lens.json"
    path.write_text(profile_text(profile()), encoding="utf-8")
    first = lens_of(design_with(tmp_path), 1.44)
    assert isinstance(first, MeasuredLens)
    assert lens_of(design_with(tmp_path), 1.44) is first
    path.write_text(profile_text(profile(5.0)), encoding="utf-8")
    second = lens_of(design_with(tmp_path), 1.44)
    assert isinstance(second, MeasuredLens)
    assert second.fit.deviation.rms_um == pytest.approx(5.0, abs=0.01)


def test_width_and_depth_are_the_design_s(tmp_path: Path) -> None:
    (tmp_path / "lens.json").write_text(profile_text(profile(9.0)), encoding="utf-8")
    found = lens_of(design_with(tmp_path, "design_index = 1.44\n"), 1.6)
    assert (found.half_width_mm, found.distance_mm) == (2.0, 1.0)
    assert found.depth_mm == LENS.depth_mm
    assert not isinstance(found, FlatFace)


def test_a_fit_knows_lens_and_profile() -> None:
    fit = FittedProfile(LENS, profile())
    assert fit.reach_mm == (-2.0, 2.0)
    assert fit.missing == 0.0
    assert fit.unseen == pytest.approx(0.0, abs=1e-12)
