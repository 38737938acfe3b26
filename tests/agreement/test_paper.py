"""The paper's sensor: its values, and a quadrature that has only the equation of the oval in common with solen."""

import math
from typing import Literal

import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from solen.geometry import y_body
from solen.lens import lens_of
from solen.material import optical
from solen.scene import Scene, sensor_scene
from solen.spec import Design, Emitter, Lens, Material
from solen.trace import Mode, Trace, trace

INDICES = [1.44, 1.49, 1.54]
RAYS = 50_000


def design(index: float, shape: Literal["cartesian-oval", "none"] = "cartesian-oval") -> Design:
    return Design(name="paper", material=Material(index=index), emitter=Emitter(), lens=Lens(shape=shape))


def scene(design: Design, angle_deg: float) -> Scene:
    material = optical(design)
    return sensor_scene(design, y_body(design, lens_of(design, material.index), angle_deg), material, RAYS)


def trace_sensor(
    index: float, angle_deg: float, mode: Mode, shape: Literal["cartesian-oval", "none"] = "cartesian-oval"
) -> Trace:
    result = trace(scene(design(index, shape), angle_deg), mode)
    assert result.undefined == 0
    assert result.ledger.total == pytest.approx(1.0, abs=1e-12)
    return result


def detected(result: Trace) -> tuple[float, float]:
    return result.detectors["left"].power, result.detectors["right"].power


def contrast(result: Trace) -> float:
    left, right = detected(result)
    return (right - left) / (right + left)


def path_excess(x: float, z: float, n: float) -> float:
    """Return the optical path via a point minus that along the axis, for s = 1 mm in air and s' = 20 mm."""
    return math.hypot(x, z + 1.0) + n * math.hypot(x, 20.0 - z) - (1.0 + 20.0 * n)


def edge_rad(n: float) -> float:
    """Return the angle of the ray to the edge of the lens at x = 2 mm."""
    z = brentq(lambda z: path_excess(2.0, z, n), 0.0, 10.0)
    return math.atan2(2.0, 1.0 + z)


def transmittance(angle: float, n: float) -> float:
    """Return Fresnel's transmittance for unpolarised light where a ray first meets the oval."""
    s, c = math.sin(angle), math.cos(angle)
    inner = next(0.5 * k for k in range(1, 40) if path_excess(0.5 * k * s, 0.5 * k * c - 1.0, n) < 0) if angle else 1.5
    r = brentq(lambda r: path_excess(r * s, r * c - 1.0, n), 0.5, inner, xtol=1e-14)
    x, z = r * s, r * c - 1.0
    to_focus = math.hypot(x, 20.0 - z)
    gx, gz = s + n * x / to_focus, c - n * (20.0 - z) / to_focus  # gradient of the equation, along the normal
    cos_in = abs(s * gx + c * gz) / math.hypot(gx, gz)
    cos_out = math.sqrt(1 - (1 - cos_in**2) / n**2)
    rs = (cos_in - n * cos_out) / (cos_in + n * cos_out)
    rp = (n * cos_in - cos_out) / (n * cos_in + cos_out)
    return 1 - 0.5 * (rs**2 + rp**2)


def power_entering(n: float) -> float:
    """Return the fraction of a fan uniform over ±60 degrees that enters the lens, by quadrature."""
    value, error = quad(lambda a: transmittance(a, n), 0.0, edge_rad(n), epsabs=1e-9)
    assert error < 1e-8
    return value / math.radians(60.0)


def test_quadrature_gives_the_known_value() -> None:
    assert power_entering(1.44) == pytest.approx(0.520710341335, abs=1e-8)
    assert math.degrees(edge_rad(1.44)) == pytest.approx(35.4329160335, abs=1e-9)


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("side", ["right", "left"])
def test_all_light_on_one_side_at_three_degrees(side: str, index: float) -> None:
    """At −3 degrees the lens is rotated to the right and illuminates the right receiver."""
    result = trace_sensor(index, -3.0 if side == "right" else 3.0, "count")
    bright, dark = ("right", "left") if side == "right" else ("left", "right")
    step = 5e-4  # light through the step of a few µm between the rotated lens and the stem
    assert result.detectors[bright].power == pytest.approx(math.degrees(edge_rad(index)) / 60, abs=step)
    assert result.detectors[dark].power == 0.0
    if index == 1.44:
        assert result.detectors[bright].power == pytest.approx(0.5905, abs=0.003)


@pytest.mark.parametrize("index", INDICES)
def test_sides_are_equal_at_zero(index: float) -> None:
    result = trace_sensor(index, 0.0, "count")
    assert result.detectors["left"].rays == result.detectors["right"].rays
    left, right = detected(result)
    assert left + right == pytest.approx(math.degrees(edge_rad(index)) / 60, abs=2 / RAYS)


@pytest.mark.parametrize("angle_deg", [-3.0, 0.0, 3.0])
@pytest.mark.parametrize("index", INDICES)
def test_power_agrees_with_quadrature(index: float, angle_deg: float) -> None:
    left, right = detected(trace_sensor(index, angle_deg, "power"))
    assert left + right == pytest.approx(power_entering(index), abs=0.002)
    if index == 1.44:
        assert left + right == pytest.approx(0.5207, abs=0.002)


@pytest.mark.parametrize("index", INDICES)
@pytest.mark.parametrize("mode", ["count", "power"])
def test_sides_are_almost_equal_without_lens(mode: Mode, index: float) -> None:
    negative, positive = (contrast(trace_sensor(index, angle, mode, "none")) for angle in (-3.0, 3.0))
    assert abs(negative) < 0.12
    assert positive == pytest.approx(-negative, abs=1e-3)
