"""The oval lens compared with a table of its profile, finite differences and the paths of rays."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from solen.curve import CartesianOval
from solen.lens import FlatFace, OvalLens, lens_of, nearest_focus_mm, tangency
from solen.plane import along, dot, heading
from solen.refraction import refracted
from solen.spec import Design

TABLE = {  # z in mm at x = 0.5, 1, 1.5, 2 for s = 1, s' = 20, n1 = 1: computed independently of solen, to 50 digits
    1.44: (0.241014456653, 0.702758865073, 1.234155610981, 1.810852142230),
    1.49: (0.220174671037, 0.648978898213, 1.145237615443, 1.684402355194),
    1.54: (0.202792059492, 0.603567693776, 1.069894173036, 1.577210959584),
}
indices = pytest.mark.parametrize("n2", TABLE)


def paper(n2: float = 1.44, half_width_mm: float = 2.0) -> OvalLens:
    return OvalLens(1.0, 20.0, half_width_mm, n2)


@st.composite
def lenses(draw: st.DrawFn) -> OvalLens:
    s, f, n2 = draw(st.floats(0.3, 5)), draw(st.floats(3, 80)), draw(st.floats(1.2, 2.2))
    return OvalLens(s, f, draw(st.floats(0.05, 0.95)) * tangency(1.0, n2, s, f)[1], n2)


@indices
def test_the_profile_agrees_with_the_table(n2: float) -> None:
    z = paper(n2).z_mm([0.5, 1.0, 1.5, 2.0])
    assert np.abs(z - TABLE[n2]).max() < 1e-12
    assert np.array_equal(paper(n2).z_mm([-0.5, -1.0, -1.5, -2.0]), z)
    assert paper(n2).depth_mm == pytest.approx(TABLE[n2][3], abs=1e-12)


@settings(deadline=None)
@given(lens=lenses(), fraction=st.floats(-1, 1))
def test_the_profile_solves_the_equation_and_agrees_with_the_curve(lens: OvalLens, fraction: float) -> None:
    x = fraction * lens.half_width_mm
    z = float(lens.z_mm(x))
    assert abs(lens.front.residual_mm((x, z))) < 1e-12
    assert lens.front.hits((x, -1.0), (0.0, 1.0)) == pytest.approx([z + 1.0], abs=1e-11)
    assert math.dist(lens.front.start, (-lens.half_width_mm, lens.depth_mm)) < 1e-10
    assert math.dist(lens.front.end, (lens.half_width_mm, lens.depth_mm)) < 1e-10


@settings(deadline=None)
@given(lens=lenses(), fraction=st.floats(-0.98, 0.98))
def test_slope_and_curvature_are_the_derivatives(lens: OvalLens, fraction: float) -> None:
    x, h = fraction * lens.half_width_mm, 1e-4 * lens.half_width_mm
    z_below, at, z_above = lens.z_mm([x - h, x, x + h])
    slope = (z_above - z_below) / (2 * h)
    scale = max(1.0, abs(slope))
    assert float(lens.slope(x)) == pytest.approx(slope, abs=1e-5 * scale)
    bend = (z_above - 2 * at + z_below) / h**2 / (1 + slope**2) ** 1.5
    assert float(lens.curvature_per_mm(x)) == pytest.approx(bend, abs=1e-3 / lens.vertex_radius_mm)


@indices
def test_the_vertex_has_its_radius_of_curvature(n2: float) -> None:
    lens = paper(n2)
    assert lens.vertex_radius_mm == pytest.approx((n2 - 1) / (1 + n2 / 20), abs=1e-15)
    assert float(lens.curvature_per_mm(0.0)) == pytest.approx(1 / lens.vertex_radius_mm, abs=1e-12)
    assert float(lens.slope(0.0)) == 0.0
    assert float(lens.z_mm(1e-3)) == pytest.approx(0.5e-6 / lens.vertex_radius_mm, rel=1e-4)


def test_acceptance_and_apertures_of_the_papers_lens() -> None:
    lens = paper()
    assert lens.acceptance_deg == pytest.approx(35.4329160335, abs=1e-10)
    assert lens.edge_incidence_deg == pytest.approx(85.5221, abs=5e-5)
    assert lens.magnification == pytest.approx(20 / 1.44, abs=1e-13)
    assert lens.na_object == pytest.approx(math.sin(math.radians(35.4329160335)), abs=1e-11)
    edge = math.atan2(2.0, 20.0 - 1.810852142230)
    assert lens.na_image == pytest.approx(1.44 * math.sin(edge), abs=1e-11)
    assert math.degrees(edge) == pytest.approx(6.275, abs=1e-3)
    assert 2 * lens.acceptance_deg / 120 == pytest.approx(0.5905, abs=5e-5)


@settings(deadline=None)
@given(lens=lenses(), x=st.floats(-1e-4, 1e-4).filter(lambda x: abs(x) > 1e-5))
def test_magnification_is_that_of_a_shifted_emitter(lens: OvalLens, x: float) -> None:
    """A ray from a decentred emitter through the vertex passes through the inverted image of the emitter."""
    x *= lens.distance_mm
    norm = math.hypot(x, lens.distance_mm)
    out = refracted((-x / norm, lens.distance_mm / norm), (0.0, -1.0), 1.0, lens.design_index)
    assert out is not None
    assert out[0] / out[1] * lens.focus_mm == pytest.approx(-lens.magnification * x, rel=1e-6)


@pytest.mark.parametrize(("n2", "limit_mm"), [(1.44, 2.93), (1.49, 3.05), (1.54, 3.16)])
def test_tangency_limits_the_width(n2: float, limit_mm: float) -> None:
    angle_deg, half_width_mm = tangency(1.0, n2, 1.0, 20.0)
    assert half_width_mm == pytest.approx(limit_mm, abs=0.005)
    lens = paper(n2, half_width_mm * (1 - 1e-6))
    assert 89.8 < lens.edge_incidence_deg < 90.0
    assert lens.acceptance_deg == pytest.approx(angle_deg, abs=0.1)
    oval = lens.front
    assert np.isfinite(oval.radius_from_object(np.array([angle_deg - 1e-6]))).all()
    assert np.isnan(oval.radius_from_object(np.array([angle_deg + 1e-6]))).all()


@settings(deadline=None)
@given(n2=st.floats(1.2, 2.2), s=st.floats(0.3, 5), half_width=st.floats(0.2, 5))
def test_the_nearest_focus_is_at_tangency(n2: float, s: float, half_width: float) -> None:
    nearest = nearest_focus_mm(1.0, n2, s, half_width)
    assert tangency(1.0, n2, s, nearest * (1 + 3e-6))[1] > half_width
    if nearest > 1e-3:
        assert tangency(1.0, n2, s, nearest * (1 - 3e-6))[1] < half_width


@pytest.mark.parametrize("index", [1.40, 1.43, 1.44, 1.45, 1.484, 1.6])
def test_the_smallest_spot_agrees_with_single_rays(index: float) -> None:
    """Rays by the vector form of Snell's law on the exact curve, and a search for the smallest mean square."""
    lens = paper()
    rays = []
    for angle_deg in (np.arange(800) + 0.5) / 800 * lens.acceptance_deg:
        sin, cos = math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))
        (distance,) = lens.front.hits((0.0, -1.0), (sin, cos))
        point = (distance * sin, distance * cos - 1.0)
        normal = lens.front.normal_at(point)
        inside = refracted((sin, cos), (-normal[0], -normal[1]), 1.0, index)
        assert inside is not None
        rays.append((point[0], point[1], inside[0] / inside[1]))
    x, z, slope = np.array(rays).T
    spot = minimize_scalar(lambda at: float(np.sum((x + slope * (at - z)) ** 2)), bracket=(5.0, 40.0))
    assert lens.best_focus_mm(index) == pytest.approx(spot.x, rel=3e-5)


def test_the_smallest_spot_is_between_paraxial_and_marginal_focus() -> None:
    assert paper().best_focus_mm(1.44) == pytest.approx(20.0, abs=1e-9)
    assert paper().best_focus_mm(1.0) is None
    near, best, edge = (
        paper().paraxial_focus_mm(1.45),
        paper().best_focus_mm(1.45),
        paper().marginal_focus_mm(1.45),
    )
    assert near is not None
    assert best is not None
    assert edge is not None
    assert near < best < edge < 20.0


def test_foci_in_other_materials() -> None:
    lens = paper()
    assert lens.paraxial_focus_mm(1.484) == pytest.approx(8.28, abs=0.005)
    assert lens.paraxial_focus_mm(1.44) == pytest.approx(20.0, abs=1e-11)
    assert lens.marginal_focus_mm(1.44) == pytest.approx(20.0, abs=1e-9)
    assert lens.paraxial_focus_mm(1.40) is None  # the rays diverge
    assert lens.paraxial_focus_mm(1.0) is None
    assert lens.marginal_focus_mm(1.0) is None
    shorter, longer = lens.paraxial_focus_mm(1.45), lens.paraxial_focus_mm(1.43)
    assert shorter == pytest.approx(15.0, abs=0.5)
    assert longer == pytest.approx(30.0, abs=1.0)


@settings(deadline=None)
@given(lens=lenses(), index_error=st.floats(-0.1, 0.1))
def test_the_marginal_focus_of_a_narrow_lens_is_paraxial(lens: OvalLens, index_error: float) -> None:
    index = lens.design_index + index_error
    narrow = OvalLens(lens.distance_mm, lens.focus_mm, 1e-3 * lens.vertex_radius_mm, lens.design_index)
    paraxial, marginal = narrow.paraxial_focus_mm(index), narrow.marginal_focus_mm(index)
    assume(paraxial is not None and paraxial < 500)
    assert marginal == pytest.approx(paraxial, rel=1e-2)


@settings(deadline=None)
@given(lens=lenses(), fraction=st.floats(-0.9999, 0.9999))
def test_every_ray_passes_through_the_focus(lens: OvalLens, fraction: float) -> None:
    emitter, direction = (0.0, -lens.distance_mm), heading(fraction * lens.acceptance_deg)
    (t,) = lens.front.hits(emitter, direction)
    at = along(emitter, direction, t)
    normal = lens.front.normal_at(at)
    assert dot(direction, normal) > 0  # the material is on the front's left
    inside = refracted(direction, (-normal[0], -normal[1]), 1.0, lens.design_index)
    assert inside is not None
    miss_mm = (lens.focus_mm - at[1]) * inside[0] - (0.0 - at[0]) * inside[1]
    assert abs(miss_mm) < 1e-9


@pytest.mark.parametrize("tolerance_mm", [1e-2, 1e-4, 1e-6])
def test_the_flattened_profile_is_within_tolerance(tolerance_mm: float) -> None:
    lens = paper()
    profile = lens.front.flattened(tolerance_mm)
    assert np.all(np.diff(profile[:, 0]) > 0)
    assert np.abs(profile[[0, -1], 0]) == pytest.approx(2.0, abs=1e-12)
    assert np.abs(profile[:, 1] - lens.z_mm(np.clip(profile[:, 0], -2, 2))).max() < 1e-11
    x = np.linspace(-2, 2, 4001)
    sag = np.abs(np.interp(x, profile[:, 0], profile[:, 1]) - lens.z_mm(x)) / np.hypot(1, lens.slope(x))
    assert sag.max() <= tolerance_mm
    assert len(profile) < 20 + 8 / math.sqrt(tolerance_mm)


def test_results_have_the_shape_of_the_input() -> None:
    assert paper().z_mm(0.5).shape == ()
    assert paper().z_mm([]).shape == (0,)
    assert paper().slope(np.zeros((2, 3))).shape == (2, 3)


def test_a_flat_face_accepts_the_angle_of_its_width() -> None:
    face = FlatFace(1.0, 2.0)
    assert face.acceptance_deg == pytest.approx(math.degrees(math.atan(2.0)), abs=1e-13)
    assert face.depth_mm == 0.0
    assert (face.front.start, face.front.end) == ((-2.0, 0.0), (2.0, 0.0))
    assert face.front.normal_at((0.0, 0.0)) == (0.0, 1.0)


def test_a_lens_is_designed_for_the_material_unless_specified() -> None:
    default = Design.model_validate({"name": "a", "material": {"index": 1.44}})
    other = Design.model_validate({"name": "a", "material": {"index": 1.484}, "lens": {"design_index": 1.44}})
    flat = Design.model_validate({"name": "a", "material": {"index": 1.44}, "lens": {"shape": "none"}})
    assert lens_of(default, 1.44) == lens_of(other, 1.484) == paper()
    assert lens_of(flat, 1.44) == FlatFace(1.0, 2.0)
    assert isinstance(lens_of(default, 1.5).front, CartesianOval)


def test_a_distant_focus_is_accurate() -> None:
    x, f, n = 1.0, 1e9, 1.44
    z = float(OvalLens(1.0, f, 2.0, n).z_mm(x))
    # n1 (|P−F1| − s) + n2 (|P−F2| − s') without cancellation: differences of squares over sums
    behind = math.hypot(f - z, x)
    residual = (x * x + z * z + 2 * z) / (math.hypot(1 + z, x) + 1) + n * (x * x + z * z - 2 * f * z) / (behind + f)
    assert abs(residual) < 1e-12
