"""The analysis recovers the true values of simulated recordings, to within their noise."""

from dataclasses import replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SensorResponse, group_of, sensor_response
from solen.analysis.response import grid_deg, on_grid
from solen.errors import DataError
from tests.analysis.simulated_support import Protocol, Truth, simulated

NOISY = Truth(noise_V=0.02, angle_noise_deg=0.01)


def response_of(truth: Truth, options: AnalysisOptions | None = None) -> SensorResponse:
    return sensor_response([simulated(truth)], options or AnalysisOptions())


def test_mean_curve_is_the_true_response() -> None:
    """Errors without noise: linear interpolation, f'' h²/8 with h = 0.075°, and the mean over a grid cell."""
    truth = Truth()
    response = response_of(truth)
    expected = truth.response_V(response.passes.angle_deg)
    for receiver, column in zip(response.receivers.values(), expected.T, strict=True):
        assert receiver.mean_V == pytest.approx(column, abs=5e-4)
    assert response.passes.angle_deg[[0, -1]].tolist() == [-3.0, 3.0]


def test_values_at_the_ends_of_the_grid_are_extrapolated() -> None:
    """The last reading of a ramp may be up to a quarter of a step before the last point of the grid."""
    angle, grid = np.arange(-2.982, 2.985, 0.071), grid_deg(-2.982, 2.982, 0.1)
    volts = np.column_stack([0.3 * angle, np.sin(angle)])
    curves = on_grid(angle, volts, grid)
    assert grid[[0, -1]].tolist() == [-3.0, 3.0]
    assert curves[:, 0] == pytest.approx(0.3 * grid, abs=1e-12)
    assert curves[[0, -1], 1] == pytest.approx(np.sin(grid[[0, -1]]), abs=5e-4)


@pytest.mark.parametrize(
    "truth", [replace(NOISY, irregular=0.9), replace(NOISY, rate_hz=1000.0), replace(NOISY, angle_step_deg=0.05)]
)
def test_mean_curve_is_independent_of_the_sampling(truth: Truth) -> None:
    response = response_of(truth)
    expected = truth.response_V(response.passes.angle_deg)
    # four times the noise of ten half-cycles, 0.02/√10, and half an encoder step at the largest slope of 0.5 V/°
    assert response.receivers["right"].mean_V == pytest.approx(expected[:, 1], abs=0.026 + 0.25 * truth.angle_step_deg)


def test_sensitivity_is_the_slope_of_the_response() -> None:
    right = response_of(NOISY).receivers["right"]
    angle = np.linspace(-3.0, 3.0, 61)
    slope = np.polyfit(angle, NOISY.response_V(angle)[:, 1], 1)[0]
    near = np.abs(angle) <= 0.5
    slope_near_zero = np.polyfit(angle[near], NOISY.response_V(angle[near])[:, 1], 1)[0]
    assert right.sensitivity_V_per_deg == pytest.approx(slope, abs=0.003)
    near_zero, u = right.sensitivity_near_zero_V_per_deg, right.u_sensitivity_near_zero_V_per_deg
    assert near_zero == pytest.approx(slope_near_zero, abs=0.02)
    assert abs(near_zero - slope_near_zero) < 6.0 * u
    assert right.resolution_near_zero_deg == pytest.approx(0.02 / slope_near_zero, rel=0.08)
    assert right.noise_V == pytest.approx(0.02, rel=0.05)


def test_uncertainty_of_the_sensitivity_is_correct() -> None:
    """The slope of about 88 % of the recordings is within two uncertainties from five cycles (t with 4)."""
    angle = np.linspace(-3.0, 3.0, 6001)
    slope = np.polyfit(angle, NOISY.response_V(angle)[:, 1], 1)[0]
    inside = 0
    for seed in range(60):
        right = response_of(replace(NOISY, seed=seed, angle_noise_deg=0.0)).receivers["right"]
        inside += abs(right.sensitivity_V_per_deg - slope) < 2.0 * right.u_sensitivity_V_per_deg
    assert 44 <= inside <= 59  # three standard deviations of the binomial distribution


@pytest.mark.parametrize("hysteresis_V", [0.0, 0.05, 0.2])
def test_determines_the_hysteresis(hysteresis_V: float) -> None:
    right = response_of(replace(NOISY, hysteresis_V=hysteresis_V)).receivers["right"]
    # the first sample of a ramp belongs to the preceding hold, i.e. to the other branch: 2 of 61 points
    assert right.mean_hysteresis_V == pytest.approx(hysteresis_V, abs=0.004 + 0.04 * hysteresis_V)
    # the standard uncertainty of each of ten windows of six points is 0.02 V·√(2/5/6) ≈ 5 mV
    assert right.hysteresis_V == pytest.approx(hysteresis_V, abs=0.015)


def test_notes_that_a_hysteresis_within_the_noise_is_an_upper_bound() -> None:
    notes = [line for line in response_of(NOISY).warnings if "is an upper bound" in line]
    assert notes
    assert all("at most three times its standard uncertainty" in note for note in notes)
    significant = response_of(replace(NOISY, hysteresis_V=0.2))
    assert not any("is an upper bound" in line for line in significant.warnings)


def test_determines_the_drift() -> None:
    left = response_of(replace(NOISY, drift_V_per_min=0.6)).receivers["left"]
    assert left.drift_V_per_min == pytest.approx(0.6, abs=4.0 * left.u_drift_V_per_min)
    assert left.u_drift_V_per_min < 0.05
    assert left.drift_V_per_cycle == pytest.approx(0.6 * 2.4 / 60.0, abs=4.0 * left.u_drift_V_per_cycle)


def test_warns_of_a_drift_that_looks_like_hysteresis() -> None:
    """0.6 V/min are 12 mV in half a cycle of 2.4 s, by which the falling ramps are later than the rising ones."""
    response = response_of(replace(NOISY, drift_V_per_min=0.6))
    assert any("separates rising and falling half-cycles by up to 0.012 V" in warning for warning in response.warnings)
    larger = response_of(replace(NOISY, drift_V_per_min=0.6, hysteresis_V=0.2))
    assert not any("separates rising and falling half-cycles" in warning for warning in larger.warnings)


@pytest.mark.parametrize("noise_deg", [0.05, 0.1, 0.2])
def test_determines_cycles_and_curve_from_a_noisy_angle(noise_deg: float) -> None:
    truth = Truth(angle_noise_deg=noise_deg, noise_V=0.005)
    response = response_of(truth)
    starts = [cycle.start_s for cycle in response.runs[0].motion.cycles]
    assert starts == pytest.approx(truth.protocol.starts_s(), abs=0.05)
    inner = np.abs(response.passes.angle_deg) < 2.0
    expected = truth.response_V(response.passes.angle_deg)[inner, 1]
    # noise σ of the angle adds f'' σ²/2 and, in each cell of ten half-cycles, a scatter of 0.5 V/°·σ/√(10·2)
    assert response.receivers["right"].mean_V[inner] == pytest.approx(expected, abs=0.02 + 0.35 * noise_deg)
    assert inner.sum() > 35


def test_warns_of_half_cycles_with_different_ranges() -> None:
    response = response_of(Truth(Protocol(levels_deg=(0.0, 1.0, 0.0, -1.0, 0.0, 3.0, 0.0, -3.0), cycles=3)))
    assert any("from -3° to 3°" in warning and "-1° to 1°" in warning for warning in response.warnings)
    assert not any("refer to this range" in warning for warning in response_of(NOISY).warnings)


def test_linearity_of_a_parabola_in_both_definitions() -> None:
    """For y = x² on [−1, 1] the largest deviation is 1/2 from the best line, and 2/3 from the least-squares line."""
    signals = simulated(Truth(Protocol(levels_deg=(0.0, 1.0, 0.0, -1.0)), rate_hz=2000.0))
    volts = np.column_stack([signals.angle_deg**2, signals.angle_deg])
    left = sensor_response([replace(signals, volts=volts)], AnalysisOptions()).receivers["left"]
    assert left.independent_linearity_percent == pytest.approx(50.0, abs=0.5)
    assert left.linearity_percent == pytest.approx(200.0 / 3.0, abs=0.2)


def test_there_is_no_mean_at_clipped_angles() -> None:
    truth = replace(NOISY, rails_V=(1.2, 5.0))
    response = response_of(truth)
    right = response.receivers["right"]
    expected = truth.response_V(response.passes.angle_deg)[:, 1]
    assert np.isnan(right.mean_V[expected < 1.2]).all()
    assert np.isfinite(right.mean_V[expected > 1.35]).all()
    finite = np.isfinite(right.mean_V)
    assert right.mean_V[finite] == pytest.approx(expected[finite], abs=0.03)
    assert right.clipped_samples > 0
    assert any("clipped at 1.2 V" in warning for warning in response.warnings)


def test_saturated_response_in_a_hold_is_not_taken_for_clipping() -> None:
    """Without noise a hold repeats the largest value; only repetitions during a ramp indicate clipping."""
    slow = Truth(Protocol(levels_deg=(0.0, 10.0), speed_deg_per_s=2.0), rate_hz=20.0)
    assert response_of(slow).receivers["right"].clipped_samples == 0


@pytest.mark.parametrize("truth", [Truth(), NOISY, Truth(angle_step_deg=0.1), Truth(noise_V=0.0005)])
def test_finds_no_clipping_in_unclipped_signals(truth: Truth) -> None:
    signals = simulated(truth)
    coarse = replace(signals, volts=np.round(signals.volts / 0.01) * 0.01)  # an ADC with steps of 10 mV
    for recorded in (signals, coarse):
        response = sensor_response([recorded], AnalysisOptions())
        assert [receiver.clipped_samples for receiver in response.receivers.values()] == [0, 0]


def test_samples_at_or_outside_given_rails_are_clipped() -> None:
    response = response_of(NOISY, AnalysisOptions(rails=(1.3, 2.7)))
    volts = simulated(NOISY).volts[:, 1]
    expected = int(((volts <= 1.3) | (volts >= 2.7)).sum())
    assert response.receivers["right"].clipped_samples == expected


def test_cycle_with_a_gap_does_not_contribute_at_its_angles() -> None:
    signals = simulated(Truth())
    kept = (signals.time_s < 5.9) | (signals.time_s > 5.97)  # gap from 1.5° to 2.55° in the first ramp of cycle 3
    times, angles, volts = signals.time_s[kept], signals.angle_deg[kept], signals.volts[kept]
    response = sensor_response([replace(signals, time_s=times, angle_deg=angles, volts=volts)], AnalysisOptions())
    count = response.receivers["right"].rising.ways
    angle = response.passes.angle_deg
    assert (count[(angle > 1.6) & (angle < 2.5)] == 4).all()
    assert (count[angle < 1.4] == 5).all()


def test_warns_of_a_sign_opposite_to_the_convention() -> None:
    signals = simulated(NOISY)
    inverted = sensor_response([replace(signals, angle_deg=-signals.angle_deg)], AnalysisOptions())
    assert any("the reverse of the convention" in warning for warning in inverted.warnings)
    assert inverted.receivers["right"].swing_V < 0.0
    assert not any("convention" in warning for warning in response_of(NOISY).warnings)
    control = sensor_response([replace(signals, angle_deg=-signals.angle_deg, lens=False)], AnalysisOptions())
    assert not any("convention" in warning for warning in control.warnings)  # there is none without a lens


def test_warns_of_receivers_that_change_in_the_same_direction() -> None:
    signals = simulated(NOISY)
    equal = replace(signals, volts=signals.volts[:, [0, 0]])
    warnings = sensor_response([equal], AnalysisOptions()).warnings
    assert any("both change in the same direction" in warning for warning in warnings)


def test_determines_balance_and_crosstalk() -> None:
    truth = NOISY
    pair = sensor_response([simulated(truth)], AnalysisOptions(dark_V=4.0)).left_minus_right
    assert pair is not None
    assert pair.balance_deg == pytest.approx(0.0, abs=4.0 * pair.u_balance_deg)
    toward_right = pair.crosstalk[0]
    assert toward_right.angle_deg == -3.0
    assert toward_right.change_percent == pytest.approx(-100.0, abs=5.0)
    left, right = truth.response_V(np.array([-3.0]))[0]
    assert toward_right.light_percent == pytest.approx(100.0 * (4.0 - left) / (4.0 - right), abs=2.0)
    assert pair.contrast is not None
    assert pair.contrast.at_low == pytest.approx((left - right) / (8.0 - left - right), abs=0.01)


def test_pools_recordings_of_a_sensor_and_compares_sensors() -> None:
    recordings = [simulated(replace(NOISY, seed=seed)) for seed in (1, 2)]
    assert sensor_response(recordings, AnalysisOptions()).passes.cycles == 10
    sensors = [
        sensor_response([simulated(replace(NOISY, swing_V=swing), f"S{swing}")], AnalysisOptions())
        for swing in (0.9, 1.0, 1.1)
    ]
    group = group_of(sensors)
    assert group is not None
    expected_sd = 0.1 * np.abs(np.tanh(group.angle_deg / 2.0))  # 0.1 is the standard deviation of the swings
    assert group.receivers["right"].sd_V == pytest.approx(expected_sd, abs=0.02)


def test_refuses_a_recording_without_usable_cycles() -> None:
    with pytest.raises(DataError, match="contains 1 complete cycle, of which --drop 1 omits all"):
        response_of(Truth(Protocol(cycles=1)))
    single = response_of(Truth(Protocol(cycles=1)), AnalysisOptions(drop=0))
    assert single.passes.cycles == 1
    assert any("one cycle is used" in warning for warning in single.warnings)


def test_sinusoidal_motion_has_values_at_the_angle_where_cycles_begin() -> None:
    """There is no hold at 0, where cycles begin and both voltages are equal."""
    time_s = np.arange(0.0, 8 * 2.5, 0.005)
    angle = 3.0 * np.sin(2.0 * np.pi * time_s / 2.5)
    volts = NOISY.response_V(angle) + 3e-4 * np.random.default_rng(2).standard_normal((time_s.size, 2))
    signals = replace(simulated(NOISY), time_s=time_s, angle_deg=angle, volts=volts)
    pair = sensor_response([signals], AnalysisOptions()).left_minus_right
    assert pair is not None
    assert pair.balance_deg == pytest.approx(0.0, abs=4.0 * pair.u_balance_deg)
    assert pair.u_balance_deg < 1e-3
