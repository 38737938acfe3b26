"""Areas and lengths of exact outlines agree with closed forms and with an independent quadrature."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from solen.curve import Arc, Parabola, Segment, Spline
from solen.fabricate import area_mm2, perimeter_mm
from solen.geometry import Face
from solen.plane import Rigid
from tests.fabricate.solid_support import HALF, body_of, design, oval_z


def test_area_and_perimeter_of_an_annulus_far_from_the_origin() -> None:
    center = (1e4, -2e4)
    outer, inner = Arc.circle(center, 5.0), Arc.circle(center, 3.0).reversed()
    outlines = ([Face("outer", outer)], [Face("inner", inner)])
    assert area_mm2(outlines) == pytest.approx(math.pi * 16.0, rel=1e-12)
    assert perimeter_mm(outlines) == pytest.approx(math.tau * 8.0, rel=1e-12)


def test_a_parabolic_segment_is_two_thirds_of_its_box() -> None:
    """Archimedes: the area under 1 − x²/9 from −3 to 3 is 2/3 · 6 · 1."""
    arch = Parabola((0.0, 1.0), (-1.0, 0.0), -1.0 / 9.0, -3.0, 3.0)
    assert arch.start == pytest.approx((3.0, 0.0))
    assert area_mm2([[Face("arch", arch), Face("chord", Segment(arch.end, arch.start))]]) == pytest.approx(
        4.0, rel=1e-13
    )


def test_the_area_of_a_spline_does_not_depend_on_its_pose() -> None:
    outline = Spline.through([(0.0, 0.0), (4.0, 0.0), (5.0, 3.0), (1.0, 2.0)], closed=True)
    moved = outline.moved(Rigid.about((30.0, 4.0), 77.0))
    area = area_mm2([[Face("spline", outline)]])
    assert area_mm2([[Face("spline", moved)]]) == pytest.approx(area, rel=1e-13)
    points = outline.points(np.linspace(0.0, 1.0, 400_001))
    x, z = points.T
    shoelace = float(np.sum(x[:-1] * z[1:] - x[1:] * z[:-1])) / 2
    assert area == pytest.approx(shoelace, rel=1e-9)


@pytest.mark.parametrize("index", [1.44, 1.54])
def test_the_area_of_a_sensor_is_that_of_lens_stem_and_arms(index: float) -> None:
    """Lens: a box minus the integral of the oval; stem: 2 ∫ (2 + c u²) du; arms: two polygons."""
    body = design().body
    depth = float(oval_z(np.array([HALF]), index)[0])
    lens = 2 * HALF * depth - quad(lambda x: float(oval_z(np.array([x]), index)[0]), -HALF, HALF, epsabs=1e-11)[0]
    length, bend = body.stem_length_mm, body.stem_curve_per_mm
    stem = 2 * (HALF * length + bend * length**3 / 3)
    fork, angle = HALF + bend * length**2, math.atan(2 * bend * length)
    outer = (fork + body.arm_length_mm * math.sin(angle), body.arm_length_mm * math.cos(angle))
    inner = (outer[0] - body.arm_width_mm * math.cos(angle), outer[1] + body.arm_width_mm * math.sin(angle))
    crotch = (0.0, inner[1] - inner[0] / math.tan(angle))
    corners = [(0.0, 0.0), (fork, 0.0), outer, inner, crotch]
    arm = sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)) / 2
    area = area_mm2([body_of(design(material__index=index)).faces])
    assert area == pytest.approx(lens + stem + 2 * arm, abs=1e-9)
