"""The free-form lens compared with the oval, and with a profile and rays computed independently here."""

import math
from pathlib import Path

import numpy as np
import pytest

from solen.arrays import FloatArray
from solen.errors import DesignError, SpecError
from solen.fabricate.process import Settings
from solen.lens import MeasuredLens, OvalLens, SplineLens, profile_of
from solen.lens.spline import DEFAULT_MIN_FEATURE_UM
from solen.sensor import Sensor, check
from solen.sensor.check import foci_of
from solen.sensor.numbers import optical_keys, tolerance_of
from solen.spec import Design, dumps, loads, value_at

OVAL = OvalLens(1.0, 20.0, 2.0, 1.44)
KNOTS_UM = (-8.0, 6.0, -12.0, 15.0, -10.0, 5.0)


def design(knots_um: object = KNOTS_UM, **lens: object) -> Design:
    table = {"shape": "spline", "knots_um": knots_um, **lens}
    return Design(name="free", material={"index": 1.44}, lens=table)


def deviation_mm(x: FloatArray) -> FloatArray:
    """The deviation from its second derivatives: a natural spline through the knots of both sides, without scipy."""
    values = 1e-3 * np.array([0.0, *KNOTS_UM[::-1], *KNOTS_UM[1:], 0.0])
    at = np.linspace(-2.0, 2.0, len(values))
    h, n = at[1] - at[0], len(values)
    matrix, right = np.eye(n), np.zeros(n)
    for i in range(1, n - 1):
        matrix[i, i - 1 : i + 2] = h / 6.0, 2.0 * h / 3.0, h / 6.0
        right[i] = (values[i + 1] - 2.0 * values[i] + values[i - 1]) / h
    bend = np.linalg.solve(matrix, right)
    i = np.clip(((x - at[0]) // h).astype(int), 0, n - 2)
    a, b = (at[i + 1] - x) / h, (x - at[i]) / h
    return np.asarray(
        a * values[i] + b * values[i + 1] + ((a**3 - a) * bend[i] + (b**3 - b) * bend[i + 1]) * h**2 / 6.0
    )


def profile_mm(x: FloatArray) -> FloatArray:
    """z(x) = oval + deviation; the oval by bisection of its equation along z."""
    low, high = np.zeros_like(x), np.full_like(x, 2.0)
    for _ in range(80):
        z = 0.5 * (low + high)
        outside = np.hypot(z + 1.0, x) + 1.44 * np.hypot(x, 20.0 - z) > 1.0 + 1.44 * 20.0
        low, high = np.where(outside, z, low), np.where(outside, high, z)
    return np.asarray(low + deviation_mm(x))


def test_the_profile_is_the_oval_plus_a_smooth_deviation() -> None:
    lens = SplineLens(OVAL, KNOTS_UM)
    x = np.linspace(-2.0, 2.0, 401)
    assert np.abs(lens.z_mm(x) - profile_mm(x)).max() < 1e-12
    h = 1e-5
    inner = x[1:-1]
    assert np.abs(lens.slope(inner) - (profile_mm(inner + h) - profile_mm(inner - h)) / (2 * h)).max() < 1e-6
    bend = (lens.slope(inner + h) - lens.slope(inner - h)) / (2 * h) / np.hypot(1.0, lens.slope(inner)) ** 3
    assert np.abs(lens.curvature_per_mm(inner) - bend).max() < 1e-3  # the third derivative jumps at the knots
    assert np.allclose(1e3 * lens.deviation_mm(lens.knots_at_mm), [*KNOTS_UM, 0.0], atol=1e-12)
    front = lens.front.points(np.linspace(0.0, 1.0, 2001))
    assert np.abs(front[:, 1] - profile_mm(front[:, 0])).max() < 1e-6
    assert lens.depth_mm == OVAL.depth_mm
    assert (lens.max_deviation_um, lens.min_radius_um) == pytest.approx((15.02, 304.9), rel=1e-3)


def test_rays_obey_newton_s_method_and_snell_s_law() -> None:
    """Rays from the emitter at (0, -1) to z(x), refracted by Snell's law with a normal from finite differences."""
    angle = np.radians([-33.0, -12.3, -1.7, 4.9, 20.1, 34.2])
    run = np.tan(angle)
    x = run.copy()
    for _ in range(60):  # where x = tan(angle) (z + 1)
        h = 1e-6
        value = x - run * (profile_mm(x) + 1.0)
        x = x - value / (1.0 - run * (profile_mm(x + h) - profile_mm(x - h)) / (2 * h))
    h = 1e-4
    slope = (8.0 * (profile_mm(x + h) - profile_mm(x - h)) - profile_mm(x + 2 * h) + profile_mm(x - 2 * h)) / (12 * h)
    normal = np.stack([-slope, np.ones_like(x)]) / np.hypot(1.0, slope)  # into the material
    ray = np.stack([np.sin(angle), np.cos(angle)])
    cosine = (ray * normal).sum(axis=0)
    inside = ray / 1.44 + (np.sqrt(1.0 - (1.0 - cosine**2) / 1.44**2) - cosine / 1.44) * normal

    sensor = Sensor.of(design().set({"motion.moves": ("emitter",), "emitter.rays": 1, "emitter.cone_deg": 1e-6}))
    front = sensor.body().face("lens").curve
    for expected_x, direction, expected in zip(x, ray.T, inside.T, strict=True):
        (distance,) = front.hits((0.0, -1.0), tuple(direction))
        hit = np.array([0.0, -1.0]) + distance * direction
        assert hit == pytest.approx([expected_x, profile_mm(np.array([expected_x]))[0]], abs=5e-6)  # 1 nm, oblique
        normal = np.array(front.normal_at(tuple(hit)))
        normal *= np.sign(normal @ direction)
        cos = float(normal @ direction)
        refracted = direction / 1.44 + (math.sqrt(1.0 - (1.0 - cos**2) / 1.44**2) - cos / 1.44) * normal
        assert refracted == pytest.approx(expected, abs=2e-5)  # the curve is within 1 nm, its normals within 1e-5


def test_traced_rays_obey_snell_s_law() -> None:
    sensor = Sensor.of(design().set({"emitter.rays": 7, "emitter.cone_deg": 60.0}))
    for path in sensor.trace(0.0, "count", segments=True).paths():
        start, hit, after = path.points_mm[:3]
        assert hit[1] == pytest.approx(profile_mm(hit[:1])[0], abs=1e-6)
        h = 1e-4
        slope = (profile_mm(hit[:1] + h) - profile_mm(hit[:1] - h))[0] / (2 * h)
        tangent = np.array([1.0, slope]) / math.hypot(1.0, slope)
        incident, refracted = ((b - a) / np.hypot(*(b - a)) for a, b in ((start, hit), (hit, after)))
        assert incident @ tangent == pytest.approx(1.44 * (refracted @ tangent), abs=1e-5)


def test_without_deviation_it_is_the_oval() -> None:
    sensor = Sensor.of(design([0.0] * 6))
    oval = Sensor.of(sensor.design.set({"lens.shape": "cartesian-oval", "lens.knots_um": None}))
    assert sensor.lens.front == oval.lens.front
    for mode in ("count", "power"):
        powers = [
            {name: reading.power for name, reading in model.trace(-0.7, mode).detectors.items()}
            for model in (sensor, oval)
        ]
        assert powers[0] == powers[1]
    near = Sensor.of(design([1e-9] * 6)).integrate(-0.7)
    assert near.detectors["right"].power == pytest.approx(oval.integrate(-0.7).detectors["right"].power, abs=1e-6)
    x = np.linspace(-2.0, 2.0, 40001)
    added_mm2 = -np.trapezoid(deviation_mm(x), x)
    assert Sensor.of(design()).body().area_mm2() - oval.body().area_mm2() == pytest.approx(added_mm2, abs=2e-6)
    assert sensor.without_lens.design.lens.knots_um is None


def test_a_knot_is_an_entry_of_the_design() -> None:
    original = design()
    assert value_at(original, "lens.knots_um[3]") == 15.0
    changed = original.set({"lens.knots_um[3]": 2.5})
    assert changed.lens.knots_um == (-8.0, 6.0, -12.0, 2.5, -10.0, 5.0)
    assert changed == loads(dumps(changed))
    assert original.set({"lens.knots_um": [1.0, 2.0], "lens.knots_um[1]": 3.0}).lens.knots_um == (1.0, 3.0)
    sensor = Sensor.of(original)
    assert [key for key in optical_keys(sensor) if "knots" in key] == [f"lens.knots_um[{i}]" for i in range(6)]
    assert tolerance_of(sensor, "lens.knots_um[3]") == (2.0, False)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("lens.knots_um[6]", "the list has 6 entries"),
        ("lens.knots_um[x]", "the list has 6 entries"),
        ("lens.knots_um.0", "the list has 6 entries"),
        ("lens.focus_mm[0]", "unknown key|has 0 entries"),
        ("wall[0].index", "the list is empty|list has 0 entries"),
        ("lens.knots_um[0].x", "unknown key"),
    ],
)
def test_refuses_an_invalid_list_index(key: str, message: str) -> None:
    original = design()
    with pytest.raises(SpecError, match=message) as refusal:
        value_at(original, key)
    assert str(refusal.value).startswith(f"{key};")
    with pytest.raises(SpecError, match=message) as refusal:
        original.set({key: 1.0})
    assert str(refusal.value).startswith(f"{key};")


@pytest.mark.parametrize("knots", [KNOTS_UM, (0.0,) * 6])
def test_the_derivative_with_respect_to_a_knot_agrees_with_differences(knots: tuple[float, ...]) -> None:
    sensor, key, h = Sensor.of(design(knots)), "lens.knots_um[2]", 0.02
    derivative = sensor.derivative(key, -0.5)
    ends = [
        sensor.set({key: knots[2] + step}).integrate(-0.5, tolerance=1e-10).detectors["right"].power for step in (-h, h)
    ]
    assert derivative.reached
    assert derivative.detectors["right"].value == pytest.approx((ends[1] - ends[0]) / (2 * h), rel=1e-3)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"shape": "spline"}, "lens.knots_um; is missing"),
        ({"shape": "spline", "knots_um": []}, "lens.knots_um = .*at least 1"),
        ({"knots_um": [1.0]}, 'lens.knots_um = .*does not apply with shape = "cartesian-oval"'),
        ({"min_feature_um": 50.0}, "lens.min_feature_um = 50.0; does not apply without knots_um"),
        ({"shape": "spline", "knots_um": [1.0, "2"]}, r"lens.knots_um\[1\] = '2'; must be a number"),
        ({"shape": "spline", "knots_um": [1.0, 1e5]}, r"lens.knots_um\[1\] = 100000"),
    ],
)
def test_refuses_inconsistent_keys(table: dict[str, object], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        Design(name="bad", material={"index": 1.44}, lens=table)


@pytest.mark.parametrize(
    ("knots", "message"),
    [
        ([-950.0, -600.0], "z = -0.95 mm at x = 0 mm, but must be behind z = -0.9 mm"),
        ([0.0, 0.0, -300.0, 0.0, 0.0], "deg at x = "),
        ([0.0, 0.0, 0.0, 0.0, 0.0, -100.0], "deg at x = 2 mm, but must be below 90 deg"),
    ],
)
def test_refuses_a_face_that_light_cannot_use(knots: list[float], message: str) -> None:
    with pytest.raises(DesignError, match=message):
        Sensor.of(design(knots))


def test_warns_of_features_that_printing_rounds_off() -> None:
    assert not check(Sensor.of(design())).warnings
    fine = [3.0 * (-1) ** i for i in range(16)]
    (narrow, *_) = check(Sensor.of(design(fine))).warnings
    assert "125 µm wide" in narrow
    assert "lens.min_feature_um, 130 µm" in narrow
    assert not check(Sensor.of(design(fine, min_feature_um=50.0))).warnings
    radius = [warning for warning in check(Sensor.of(design(min_feature_um=310.0))).warnings if "radius" in warning]
    assert "305 µm" in radius[0]
    wave = SplineLens(OVAL, tuple(2.0 * math.cos(math.pi * i / 4) for i in range(12)))
    assert [feature.width_um for feature in wave.features[:3]] == pytest.approx([2e3 / 3] * 3, rel=0.05)
    assert [round(feature.height_um) for feature in wave.features[:3]] == [-2, 2, -2]


def test_the_default_least_feature_preserves_nine_tenths_of_a_wave() -> None:
    settings = Settings()
    wave_um = 2.0 * settings.min_feature_um
    x = np.linspace(0.0, wave_um, 4001)
    blur = np.exp(-0.5 * ((x - 0.5 * wave_um) / settings.edge_um) ** 2)
    kept = (blur * np.cos(2.0 * np.pi * (x / wave_um - 0.5))).sum() / blur.sum()
    assert kept == pytest.approx(0.9, abs=1e-4)
    assert settings.min_feature_um == pytest.approx(DEFAULT_MIN_FEATURE_UM, rel=0.05)


def test_a_printed_free_form_is_compared_with_its_design(tmp_path: Path) -> None:
    sensor = Sensor.of(design())
    assert isinstance(sensor.cut, SplineLens)
    x = np.linspace(-2.0, 2.0, 1201)
    printed = profile_of(x, profile_mm(x) - 3e-3 * np.cos(x), 1e-4, simulated=True)
    (tmp_path / "lens.csv").write_text(
        "x_mm,z_mm,u_mm\n" + "".join(f"{a},{b},1e-4\n" for a, b in zip(x, printed.z_mm, strict=True))
    )
    design_of_print = sensor.design.set({"lens.shape": "measured", "lens.profile": str(tmp_path / "lens.csv")})
    measured = Sensor.of(design_of_print)
    assert isinstance(measured.cut, MeasuredLens)
    assert measured.cut.designed == sensor.cut
    assert measured.as_designed.cut == sensor.cut
    assert measured.cut.fit.deviation.max_um == pytest.approx(3.0, abs=0.3)
    assert np.abs(measured.cut.z_mm(x) - printed.z_mm).max() < 5e-4  # smoothed as its uncertainty allows
    (focus,) = foci_of(measured)
    assert focus.designed_best_focus_mm == sensor.cut.best_focus_mm(1.44)
    assert focus.designed_best_focus_mm == pytest.approx(15.0, abs=0.1)
