"""What was put into a made recording comes out again, within what its noise allows."""

from dataclasses import replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, SensorResponse, group_of, sensor_response
from solen.analysis.response import grid_deg, on_grid
from solen.errors import DataError
from tests.analysis.simulated_support import Protocol, Truth, made

NOISY = Truth(noise_V=0.02, angle_noise_deg=0.01)


def found_of(truth: Truth, settings: AnalysisOptions | None = None) -> SensorResponse:
    return sensor_response([made(truth)], settings or AnalysisOptions())


def test_the_curve_is_the_response() -> None:
    """Without noise what is left is the straight line between samples, f'' h²/8 with h = 0.075°, and a cell's mean."""
    truth = Truth()
    found = found_of(truth)
    expected = truth.response_V(found.passes.angle_deg)
    for place in (0, 1):
        assert list(found.receivers.values())[place].mean_V == pytest.approx(expected[:, place], abs=5e-4)
    assert found.passes.angle_deg[[0, -1]].tolist() == [-3.0, 3.0]


def test_the_ends_of_a_curve_are_at_their_angles() -> None:
    """The last reading of a ramp may lie up to a quarter of a step before the last point of the grid."""
    angle, grid = np.arange(-2.982, 2.985, 0.071), grid_deg(-2.982, 2.982, 0.1)
    volts = np.column_stack([0.3 * angle, np.sin(angle)])
    found = on_grid(angle, volts, grid)
    assert grid[[0, -1]].tolist() == [-3.0, 3.0]
    assert found[:, 0] == pytest.approx(0.3 * grid, abs=1e-12)
    assert found[[0, -1], 1] == pytest.approx(np.sin(grid[[0, -1]]), abs=5e-4)


@pytest.mark.parametrize("other", [{"irregular": 0.9}, {"rate_hz": 1000.0}, {"angle_step_deg": 0.05}])
def test_the_curve_does_not_depend_on_how_it_was_sampled(other: dict[str, float]) -> None:
    truth = replace(NOISY, **other)  # type: ignore[arg-type]  # its numbers
    found = found_of(truth)
    expected = truth.response_V(found.passes.angle_deg)
    # ten ways: 0.02/√10 of noise, four times that; 0.025° of an encoder's step at 0.5 V/° where it is steepest
    assert found.receivers["right"].mean_V == pytest.approx(expected[:, 1], abs=0.026 + 0.25 * truth.angle_step_deg)


def test_sensitivity_is_the_slope() -> None:
    truth = NOISY
    own = found_of(truth).receivers["right"]
    angle = np.linspace(-3.0, 3.0, 61)
    line = np.polyfit(angle, truth.response_V(angle)[:, 1], 1)[0]
    near = np.abs(angle) <= 0.5
    zero = np.polyfit(angle[near], truth.response_V(angle[near])[:, 1], 1)[0]
    assert own.sensitivity_V_per_deg == pytest.approx(line, abs=0.003)
    near_zero, u = own.sensitivity_near_zero_V_per_deg, own.u_sensitivity_near_zero_V_per_deg
    assert near_zero == pytest.approx(zero, abs=0.02)
    assert abs(near_zero - zero) < 6.0 * u
    assert own.resolution_near_zero_deg == pytest.approx(0.02 / zero, rel=0.08)
    assert own.noise_V == pytest.approx(0.02, rel=0.05)


def test_intervals_of_numbers_hold_at_their_rate() -> None:
    """Of 60 recordings, the slope of about 88 % should lie within two uncertainties of five cycles (t with 4)."""
    angle = np.linspace(-3.0, 3.0, 6001)  # all angles, whatever the grid
    line = np.polyfit(angle, NOISY.response_V(angle)[:, 1], 1)[0]
    inside = 0
    for seed in range(60):
        own = found_of(replace(NOISY, seed=seed, angle_noise_deg=0.0)).receivers["right"]
        inside += abs(own.sensitivity_V_per_deg - line) < 2.0 * own.u_sensitivity_V_per_deg
    assert 44 <= inside <= 59  # three standard deviations of the binomial


@pytest.mark.parametrize("hysteresis_V", [0.0, 0.05, 0.2])
def test_hysteresis_comes_back(hysteresis_V: float) -> None:
    own = found_of(replace(NOISY, hysteresis_V=hysteresis_V)).receivers["right"]
    # the sample on which a way begins is still that of the hold before, on the other branch: 2 of 61 points
    assert own.mean_hysteresis_V == pytest.approx(hysteresis_V, abs=0.004 + 0.04 * hysteresis_V)
    # the largest of ten windows of six points: 0.02 V·√(2/5/6) ≈ 5 mV, of which the largest is some two
    assert own.hysteresis_V == pytest.approx(hysteresis_V, abs=0.015)


def test_hysteresis_within_the_noise_is_said_to_be_a_bound() -> None:
    found = found_of(NOISY)
    told = [warning for warning in found.warnings if "is an upper bound" in warning]
    assert told
    assert all("at most three times its standard uncertainty" in warning for warning in told)
    assert not any("is an upper bound" in warning for warning in found_of(replace(NOISY, hysteresis_V=0.2)).warnings)


def test_drift_comes_back_and_is_no_hysteresis() -> None:
    own = found_of(replace(NOISY, drift_V_per_min=0.6)).receivers["left"]
    assert own.drift_V_per_min == pytest.approx(0.6, abs=4.0 * own.u_drift_V_per_min)
    assert own.u_drift_V_per_min < 0.05
    assert own.drift_V_per_cycle == pytest.approx(0.6 * 2.4 / 60.0, abs=4.0 * own.u_drift_V_per_cycle)


def test_a_drift_that_looks_like_a_hysteresis_is_said() -> None:
    """0.6 V/min is 12 mV in half a cycle of 2.4 s: at 0° falling ways come that much later than rising ones."""
    found = found_of(replace(NOISY, drift_V_per_min=0.6))
    assert any("separates rising and falling half-cycles by up to 0.012 V" in warning for warning in found.warnings)
    larger = found_of(replace(NOISY, drift_V_per_min=0.6, hysteresis_V=0.2))
    assert not any("separates rising and falling half-cycles" in warning for warning in larger.warnings)


@pytest.mark.parametrize("noise_deg", [0.05, 0.1, 0.2])
def test_a_noisy_angle_shows_its_cycles(noise_deg: float) -> None:
    """A fifteenth of the way to one side in noise: cycles and curve are found, the ends of the range are lost to it."""
    truth = Truth(angle_noise_deg=noise_deg, noise_V=0.005)
    found = found_of(truth)
    assert [cycle.start_s for cycle in found.runs[0].motion.cycles] == pytest.approx(
        truth.protocol.starts_s(), abs=0.05
    )
    inner = np.abs(found.passes.angle_deg) < 2.0
    expected = truth.response_V(found.passes.angle_deg)[inner, 1]
    # sorted by a noisy angle neighbours mix: f'' σ²/2 and, of ten ways, 0.5 V/°·σ/√(10·2) of each cell
    assert found.receivers["right"].mean_V[inner] == pytest.approx(expected, abs=0.02 + 0.35 * noise_deg)
    assert inner.sum() > 35


def test_ways_of_unlike_length_are_said() -> None:
    found = found_of(Truth(Protocol(levels_deg=(0.0, 1.0, 0.0, -1.0, 0.0, 3.0, 0.0, -3.0), cycles=3)))
    assert any("from -3° to 3°" in warning and "-1° to 1°" in warning for warning in found.warnings)
    assert not any("refer to this range" in warning for warning in found_of(NOISY).warnings)


def test_linearity_of_a_parabola_in_both_definitions() -> None:
    """y = x² on [−1, 1]: the best line leaves 1/2 of 1 (independent), that by least squares 1 − mean of x²."""
    signals = made(Truth(Protocol(levels_deg=(0.0, 1.0, 0.0, -1.0)), rate_hz=2000.0))
    volts = np.column_stack([signals.angle_deg**2, signals.angle_deg])
    found = sensor_response([replace(signals, volts=volts)], AnalysisOptions())
    own = found.receivers["left"]
    assert own.independent_linearity_percent == pytest.approx(50.0, abs=0.5)
    assert own.linearity_percent == pytest.approx(200.0 / 3.0, abs=0.2)


def test_clipped_angles_have_no_mean() -> None:
    truth = replace(NOISY, rails_V=(1.2, 5.0))
    found = found_of(truth)
    mean = found.receivers["right"].mean_V
    expected = truth.response_V(found.passes.angle_deg)[:, 1]
    assert np.isnan(mean[expected < 1.2]).all()
    assert np.isfinite(mean[expected > 1.35]).all()
    held = np.isfinite(mean)
    assert mean[held] == pytest.approx(expected[held], abs=0.03)
    assert found.receivers["right"].clipped_samples > 0
    assert any("clipped at 1.2 V" in warning for warning in found.warnings)


def test_a_hold_at_the_end_of_a_response_that_levels_off_is_not_clipped() -> None:
    """Without noise a hold repeats the largest value; only on the way is a value that repeats one that was cut."""
    slow = Truth(Protocol(levels_deg=(0.0, 10.0), speed_deg_per_s=2.0), rate_hz=20.0)
    assert found_of(slow).receivers["right"].clipped_samples == 0


@pytest.mark.parametrize("truth", [Truth(), NOISY, Truth(angle_step_deg=0.1), Truth(noise_V=0.0005)])
def test_what_is_not_clipped_is_not_said_to_be(truth: Truth) -> None:
    signals = made(truth)
    coarse = replace(signals, volts=np.round(signals.volts / 0.01) * 0.01)  # a converter of 10 mV
    for one in (signals, coarse):
        found = sensor_response([one], AnalysisOptions())
        assert [found.receivers[name].clipped_samples for name in found.receivers] == [0, 0]


def test_known_rails_mark_every_sample_at_them() -> None:
    found = found_of(NOISY, AnalysisOptions(rails=(1.3, 2.7)))
    signals = made(NOISY)
    expected = int(((signals.volts[:, 1] <= 1.3) | (signals.volts[:, 1] >= 2.7)).sum())
    assert found.receivers["right"].clipped_samples == expected


def test_a_gap_in_a_way_leaves_its_angles_empty_for_that_cycle() -> None:
    signals = made(Truth())
    held = (signals.time_s < 5.9) | (signals.time_s > 5.97)  # 1.5° to 2.55° of the third cycle's first way
    times, angles, volts = signals.time_s[held], signals.angle_deg[held], signals.volts[held]
    found = sensor_response([replace(signals, time_s=times, angle_deg=angles, volts=volts)], AnalysisOptions())
    count = found.receivers["right"].rising.ways
    angle = found.passes.angle_deg
    assert (count[(angle > 1.6) & (angle < 2.5)] == 4).all()
    assert (count[angle < 1.4] == 5).all()


def test_signs_against_the_convention_are_said_and_not_mended() -> None:
    signals = made(NOISY)
    turned = sensor_response([replace(signals, angle_deg=-signals.angle_deg)], AnalysisOptions())
    assert any("the reverse of the convention" in warning for warning in turned.warnings)
    assert turned.receivers["right"].swing_V < 0.0
    assert not any("convention" in warning for warning in found_of(NOISY).warnings)
    control = sensor_response([replace(signals, angle_deg=-signals.angle_deg, lens=False)], AnalysisOptions())
    assert not any("convention" in warning for warning in control.warnings)  # without a lens there is none


def test_receivers_that_move_together_are_said() -> None:
    signals = made(NOISY)
    both = replace(signals, volts=signals.volts[:, [0, 0]])
    assert any(
        "both change in the same direction" in warning
        for warning in sensor_response([both], AnalysisOptions()).warnings
    )


def test_balance_and_crosstalk() -> None:
    truth = NOISY
    pair = sensor_response([made(truth)], AnalysisOptions(dark_V=4.0)).left_minus_right
    assert pair is not None
    assert pair.balance_deg == pytest.approx(0.0, abs=4.0 * pair.u_balance_deg)
    toward_right = pair.crosstalk[0]
    assert toward_right.angle_deg == -3.0
    assert toward_right.change_percent == pytest.approx(-100.0, abs=5.0)
    left, right = truth.response_V(np.array([-3.0]))[0]
    assert toward_right.light_percent == pytest.approx(100.0 * (4.0 - left) / (4.0 - right), abs=2.0)
    assert pair.contrast is not None
    assert pair.contrast.at_low == pytest.approx((left - right) / (8.0 - left - right), abs=0.01)


def test_recordings_of_one_sensor_are_pooled_and_sensors_compared() -> None:
    one = [made(replace(NOISY, seed=seed)) for seed in (1, 2)]
    pooled = sensor_response(one, AnalysisOptions())
    assert pooled.passes.cycles == 10
    sensors = [
        sensor_response([made(replace(NOISY, swing_V=swing), f"S{swing}")], AnalysisOptions())
        for swing in (0.9, 1.0, 1.1)
    ]
    group = group_of(sensors)
    assert group is not None
    angles = group.angle_deg
    spread = 0.1 * np.abs(np.tanh(angles / 2.0))  # the standard deviation of 0.9, 1.0, 1.1
    assert group.receivers["right"].sd_V == pytest.approx(spread, abs=0.02)


def test_too_few_cycles_are_refused() -> None:
    with pytest.raises(DataError, match="contains 1 complete cycle, of which --drop 1 omits all"):
        found_of(Truth(Protocol(cycles=1)))
    alone = found_of(Truth(Protocol(cycles=1)), AnalysisOptions(drop=0))
    assert alone.passes.cycles == 1
    assert any("one cycle is used" in warning for warning in alone.warnings)


def test_a_rest_that_is_only_passed_loses_no_angle() -> None:
    """A sine about 0 without a hold: the null is at the place where cycles begin."""
    time_s = np.arange(0.0, 8 * 2.5, 0.005)
    angle = 3.0 * np.sin(2.0 * np.pi * time_s / 2.5)
    volts = NOISY.response_V(angle) + 3e-4 * np.random.default_rng(2).standard_normal((time_s.size, 2))
    signals = replace(made(NOISY), time_s=time_s, angle_deg=angle, volts=volts)
    pair = sensor_response([signals], AnalysisOptions()).left_minus_right
    assert pair is not None
    assert pair.balance_deg == pytest.approx(0.0, abs=4.0 * pair.u_balance_deg)
    assert pair.u_balance_deg < 1e-3
