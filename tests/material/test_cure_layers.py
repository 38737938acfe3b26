"""Layers, lamp spectra, published bounds and exposures, compared with explicit sums, integrals and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from solen.errors import DataError
from solen.material.cure.exposures import trend
from solen.material.cure.layers import (
    cure_depth_um,
    dose_below,
    stack_dose,
    stack_print_through_um,
)
from solen.material.cure.penetration import attenuation, penetration_depth_um
from solen.material.cure.published_bounds import PAPER, binding, largest_Ec
from solen.material.index.illuminant import led, lines, measured_light


def dose_sum(height_um: float, Dp_um: float, layer_um: float, doses: list[float]) -> float:
    """Return the dose at a height, summed over the exposures, each attenuated between the window and that height."""
    total = 0.0
    for number, dose in enumerate(doses):
        window = (number + 1) * layer_um
        if window > height_um:
            total += dose * math.exp(-(window - height_um) / Dp_um)
    return total


@given(
    Dp_um=st.floats(5.0, 500.0),
    layer_um=st.floats(5.0, 200.0),
    doses=st.lists(st.floats(1.0, 100.0), min_size=1, max_size=12),
    fraction=st.floats(0.0, 0.999),
)
def test_the_dose_in_a_stack_is_the_sum_over_its_exposures(
    Dp_um: float, layer_um: float, doses: list[float], fraction: float
) -> None:
    stack = stack_dose(Dp_um, layer_um, doses)
    height = fraction * layer_um * len(doses)
    if min(abs(height / layer_um - number) for number in range(len(doses) + 1)) < 1e-9:
        return  # at the boundary of two layers, rounding decides to which one the height belongs
    assert float(stack.at(height)) == pytest.approx(dose_sum(height, Dp_um, layer_um, doses), rel=1e-9)


def test_the_mean_dose_of_a_layer_equals_the_integral() -> None:
    stack = stack_dose(100.0, 25.0, [39.0] * 3 + [26.0] * 9)
    for number in (0, 2, 5, 11):
        span = (number * 25.0 + 1e-9, (number + 1) * 25.0 - 1e-9)
        integral = quad(lambda z: float(stack.at(z)), *span)[0] / 25.0
        assert stack.layer_mean_mJ_per_cm2[number] == pytest.approx(integral, rel=1e-7)


def test_the_dose_inside_a_part_is_a_geometric_series() -> None:
    """26 mJ/cm² in layers of 25 µm at Dp = 100 µm: 4 times the dose at the window, 4.5 times that of a single layer."""
    stack = stack_dose(100.0, 25.0, [26.0] * 400)
    assert stack.interior_mean_mJ_per_cm2 == pytest.approx(104.0)
    assert stack.layer_mean_mJ_per_cm2[10] == pytest.approx(stack.interior_mean_mJ_per_cm2, rel=1e-12)
    later_exposures = 26.0 / math.expm1(25.0 / 100.0)
    assert stack.window_side_mJ_per_cm2[10] == pytest.approx(26.0 + later_exposures, rel=1e-12)
    assert stack.interior_range_mJ_per_cm2 == pytest.approx((later_exposures, 26.0 + later_exposures), rel=1e-12)
    assert stack.single_layer_mean_mJ_per_cm2 == pytest.approx(stack.layer_mean_mJ_per_cm2[-1], rel=1e-12)
    assert stack.interior_over_single_layer == pytest.approx(1.0 / (1.0 - math.exp(-0.25)), rel=1e-12)
    count, limit = stack.layers_to_99_percent, 0.99 * stack.interior_mean_mJ_per_cm2
    assert stack.layer_mean_mJ_per_cm2[-1 - count] >= limit > stack.layer_mean_mJ_per_cm2[-count]


def test_opaque_layers_receive_no_dose_from_later_exposures() -> None:
    stack = stack_dose(10.0, 1000.0, [26.0] * 5)
    assert stack.interior_over_single_layer == pytest.approx(1.0, abs=1e-12)
    assert stack.layer_mean_mJ_per_cm2 == pytest.approx(np.full(5, 0.26), rel=1e-12)


def test_depth_dose_and_print_through_agree() -> None:
    assert float(cure_depth_um(39.0, 110.0, 6.0)) == pytest.approx(110.0 * math.log(6.5))
    depth = float(cure_depth_um(39.0, 110.0, 6.0))
    assert float(dose_below(39.0, depth, 110.0)) == pytest.approx(6.0)  # at the cure depth, the dose is Ec
    print_through = stack_print_through_um(26.0, 25.0, 110.0, 6.0)
    assert dose_sum(-print_through, 110.0, 25.0, [26.0] * 1000) == pytest.approx(6.0, rel=1e-9)


@pytest.mark.parametrize(
    ("Dp_um", "layer_um", "doses"), [(0.0, 25.0, [1.0]), (100.0, -1.0, [1.0]), (1.0, 1.0, []), (1.0, 1.0, [0.0])]
)
def test_refuses_an_invalid_stack(Dp_um: float, layer_um: float, doses: list[float]) -> None:
    with pytest.raises(DataError, match="must be above 0"):
        stack_dose(Dp_um, layer_um, doses)


def test_published_statements_bound_the_critical_dose() -> None:
    """More than 200 µm at 39 mJ/cm²: Ec < 39 e^(−200/Dp); above Dp = 175/ln 1.5 µm, 25 µm at 26 mJ/cm² is stricter."""
    assert largest_Ec(100.0) == pytest.approx(39.0 * math.exp(-2.0))
    assert binding(100.0) is PAPER[0]
    crossing = 175.0 / math.log(1.5)
    assert binding(crossing - 1.0) is PAPER[0]
    assert binding(crossing + 1.0) is PAPER[1]
    for depth in (40.0, 100.0, 300.0, 1000.0):
        limit = largest_Ec(depth)
        assert all(statement.holds(depth, limit * (1.0 - 1e-9)) for statement in PAPER)
        assert not all(statement.holds(depth, limit * 1.001) for statement in PAPER)
    with pytest.raises(DataError, match="above 0 µm"):
        binding(0.0)


def test_penetration_depth_is_path_length_over_absorbance() -> None:
    assert penetration_depth_um(93.0, 1.0) == pytest.approx(93.0 / math.log(10.0))
    both = penetration_depth_um(93.0, [0.5, 2.0])
    assert both == pytest.approx([186.0 / math.log(10.0), 46.5 / math.log(10.0)])
    lamp = attenuation(93.0, [400.0, 410.0], [0.5, 2.0], lines([400.0, 410.0], [3.0, 1.0]))
    assert lamp.local_um() == pytest.approx(93.0 / (0.875 * math.log(10.0)))
    for path, absorbance, line in ((0.0, 1.0, "above 0 µm"), (93.0, 0.0, "penetration depth")):
        with pytest.raises(DataError, match=line):
            penetration_depth_um(path, absorbance)


def test_light_of_a_single_wavelength_decays_exponentially() -> None:
    result = attenuation(93.0, [380.0, 390.0], [0.8, 0.6], lines([385.0], [1.0]))
    for value in (result.local_um(), result.local_um(500.0), result.between_um(25.0, 200.0)):
        assert value == pytest.approx(93.0 / (0.7 * math.log(10.0)), rel=1e-12)


def test_the_penetration_depth_of_two_wavelengths_increases_with_depth() -> None:
    """At the surface it follows from the mean absorption, deep inside from the wavelength that is absorbed least."""
    result = attenuation(100.0, [400.0, 380.0], [0.1, 1.0], lines([380.0, 400.0], [1.0, 1.0]))
    strong, weak = 100.0 / math.log(10.0), 1000.0 / math.log(10.0)
    assert result.local_um() == pytest.approx(2.0 / (1.0 / strong + 1.0 / weak), rel=1e-12)
    assert result.local_um(5000.0) == pytest.approx(weak, rel=1e-6)
    depths = np.array([0.0, 50.0, 300.0])
    expected = 0.5 * (np.exp(-depths / strong) + np.exp(-depths / weak))
    assert result.transmitted(depths) == pytest.approx(expected, rel=1e-12)
    step = 1e-3
    slope = math.log(result.transmitted(np.array([50.0]))[0] / result.transmitted(np.array([50.0 + step]))[0]) / step
    assert result.local_um(50.0 + step / 2) == pytest.approx(1.0 / slope, rel=1e-6)
    assert result.local_um(25.0) < result.between_um(25.0, 200.0) < result.local_um(200.0)


def test_refuses_a_lamp_outside_the_absorbance_or_without_absorption() -> None:
    with pytest.raises(DataError, match="380 to 390 nm"):
        attenuation(93.0, [380.0, 390.0], [0.8, 0.6], led(385.0, 20.0))
    with pytest.raises(DataError, match="above 0"):
        attenuation(93.0, [380.0, 400.0], [0.8, -0.1], lines([399.0], [1.0]))
    with pytest.raises(DataError, match="contains no numbers"):
        attenuation(93.0, [380.0], [math.nan], lines([380.0], [1.0]))


def test_noise_outside_the_spectrum_of_a_lamp_is_ignored() -> None:
    nm = np.arange(300.0, 501.0)
    power = np.exp(-(((nm - 400.0) / 8.0) ** 2)) + 0.004 * np.sin(nm)  # above and below 0
    light = measured_light(nm, power)
    assert light.wavelength_nm.min() > 375.0
    assert light.wavelength_nm.max() < 425.0
    assert light.mean_nm == pytest.approx(400.0, abs=0.1)


def test_a_trend_is_a_line_with_a_confidence_interval() -> None:
    result = trend([2.0, 4.0, 6.0], [0.90, 0.89, 0.87])
    assert result is not None
    assert result.slope_per_s == pytest.approx(-0.0075)
    assert result.u_slope_per_s == pytest.approx(math.sqrt(0.01**2 / 6 / 8))  # residual 0.01/√6, Σ(x − x̄)² = 8
    half = 12.7062 * math.sqrt(0.01**2 / 6 / 8)  # t of one degree of freedom
    assert result.interval95_slope_per_s == pytest.approx((-0.0075 - half, -0.0075 + half))
    assert (result.samples, result.exposures) == (3, 3)
    assert result.value([4.0]) == pytest.approx([0.88667], abs=1e-5)
    two = trend([2.0, 4.0, 6.0], [0.9, math.nan, 0.8])
    assert two is not None
    assert two.slope_per_s == pytest.approx(-0.025)
    assert two.interval95_slope_per_s is None
    assert trend([2.0, 2.0], [0.9, 0.8]) is None
