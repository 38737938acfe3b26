"""A log on another clock is laid on the voltages, and a recording without an angle gets the protocol's."""

import math
from dataclasses import replace

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, sensor_response
from solen.analysis.alignment import Alignment, align
from solen.analysis.protocol_angle import Protocol as Asked
from solen.analysis.protocol_angle import angle_by_protocol
from solen.arrays import FloatArray
from solen.errors import DataError
from tests.analysis.made_support import Protocol, Truth, made

TRUTH = Truth(noise_V=0.02)


def logged(truth: Truth, lag_s: float, rate: float = 0.0, log_hz: float = 50.0) -> tuple[FloatArray, FloatArray]:
    """Times and angles of a stage's log whose clock is ahead by a lag in the middle of the recording."""
    end = float(truth.protocol.corners()[0][-1])
    times = np.arange(0.0, end, 1.0 / log_hz)
    draw = np.random.default_rng(truth.seed + 1000)
    angle = truth.protocol.angle_deg(times) + 0.003 * draw.standard_normal(times.size)
    return times + lag_s + rate * (times - 0.5 * end), angle


def aligned(truth: Truth, lag_s: float, rate: float = 0.0, log_hz: float = 50.0) -> Alignment:
    signals = made(truth)
    return align(signals.time_s, signals.volts, *logged(truth, lag_s, rate, log_hz))


@pytest.mark.parametrize("lag_s", [0.0, 0.0123, -37.77, 1234.5678, 1.7e9])
@pytest.mark.parametrize("log_hz", [20.0, 1000.0])
def test_a_lag_comes_back_to_a_millisecond(lag_s: float, log_hz: float) -> None:
    """20 mV on 7 V/s is 3 ms a sample, over 160 samples a cycle and five cycles 0.1 ms."""
    found = aligned(TRUTH, lag_s, log_hz=log_hz)
    assert found.lag_s == pytest.approx(lag_s, abs=1e-3)
    assert 2e-5 < found.u_lag_s < 4e-4


def test_the_interval_of_a_lag_holds_at_its_rate() -> None:
    inside = sum(
        abs((found := aligned(replace(TRUTH, seed=n), 0.3)).lag_s - 0.3) < 2.8 * found.u_lag_s for n in range(40)
    )
    assert inside >= 34  # t with 4 degrees of freedom: 95 %, less three standard deviations


@pytest.mark.parametrize(
    ("log_hz", "rate_hz", "step_deg"),
    [(50.0, 20.0, 0.0), (10.0, 200.0, 0.0), (20.0, 200.0, 0.0), (53.0, 200.0, 0.05), (1000.0, 200.0, 0.3)],
    ids=["slow recorder", "log of 10 Hz", "log of 20 Hz", "encoder", "coarse encoder"],
)
def test_the_interval_of_a_lag_holds_where_every_cycle_is_sampled_alike(
    log_hz: float, rate_hz: float, step_deg: float
) -> None:
    """2.4 s hold whole samples of both: what is off is off in each cycle, so that their scatter does not show it."""
    truth = replace(TRUTH, rate_hz=rate_hz)
    times, angles = made(truth).time_s, truth.protocol.angle_deg
    inside = 0
    for n in range(60):
        draw = np.random.default_rng(n)
        lag, phases = draw.uniform(-0.5, 0.5), draw.uniform(0.0, 1.0, 2)
        ours = times + phases[0] / rate_hz
        volts = truth.response_V(angles(ours)) + 0.02 * draw.standard_normal((ours.size, 2))
        log_s = np.arange(phases[1] / log_hz, times[-1], 1.0 / log_hz)
        log = angles(log_s) + 0.002 * draw.standard_normal(log_s.size)
        found = align(ours, volts, log_s + lag, step_deg * np.round(log / step_deg) if step_deg else log)
        inside += abs(found.lag_s - lag) < 2.8 * found.u_lag_s
    assert inside >= 50  # 95 % by t with 4 degrees of freedom; three standard deviations of the binomial are 5 of 60


@pytest.mark.parametrize(("phase_s", "u_s"), [(0.0, 0.1 / 15.0 / math.sqrt(12.0)), (0.0071, 1e-4)])
def test_a_log_without_noise_that_keeps_step_with_the_motion_is_no_encoder(phase_s: float, u_s: float) -> None:
    """50 Hz at 15°/s are 0.3° an entry: few levels, but no steps. Where all end in one decimal they may be rounded."""
    signals = made(TRUTH)
    log_s = np.arange(phase_s, float(signals.time_s[-1]), 0.02)
    found = align(signals.time_s, signals.volts, log_s + 0.3, TRUTH.protocol.angle_deg(log_s))
    assert found.lag_s == pytest.approx(0.3, abs=1e-3)
    assert 0.5 * u_s < found.u_lag_s < 3.0 * u_s


def test_a_clock_that_runs_off_is_followed() -> None:
    truth = replace(TRUTH, protocol=Protocol(cycles=30))
    found = aligned(truth, 5.0, rate=300e-6)
    assert found.rate_ppm == pytest.approx(300.0, abs=5.0 * found.u_rate_ppm)
    assert found.u_rate_ppm < 20.0
    assert found.lag_s == pytest.approx(5.0, abs=1e-3)
    expected = truth.protocol.angle_deg(made(truth).time_s)
    known = np.isfinite(found.angle_deg)
    assert found.angle_deg[known] == pytest.approx(expected[known], abs=0.3)  # at corners between samples of 20 ms


def test_a_rate_that_is_not_resolved_is_none() -> None:
    assert aligned(TRUTH, 0.2).rate_ppm == 0.0


def test_the_response_is_that_of_one_clock() -> None:
    signals = made(TRUTH)
    found = aligned(TRUTH, 0.4)
    known = np.isfinite(found.angle_deg)
    laid = replace(signals, time_s=signals.time_s[known], angle_deg=found.angle_deg[known], volts=signals.volts[known])
    mean = sensor_response([laid], AnalysisOptions(drop=0))
    expected = TRUTH.response_V(mean.passes.angle_deg)[:, 1]
    assert mean.receivers["right"].mean_V == pytest.approx(expected, abs=0.035)


def test_a_hysteresis_is_said_to_look_like_a_lag() -> None:
    found = aligned(replace(TRUTH, hysteresis_V=0.05), 0.2)
    assert any("hysteresis and lag cannot be distinguished" in warning for warning in found.warnings)
    # 0.05 V at 0.45 V/° and 15 °/s would be 3.7 ms for each way; nothing larger may come of it
    assert found.lag_s == pytest.approx(0.2, abs=0.004)


def test_a_log_of_another_test_is_refused() -> None:
    signals = made(TRUTH)
    noise = np.random.default_rng(3).standard_normal(signals.volts.shape)
    with pytest.raises(DataError, match="does not match the voltages"):
        align(signals.time_s, noise, *logged(TRUTH, 0.0))


@pytest.mark.parametrize(
    "protocol",
    [Protocol(), Protocol(rest_hold_s=0.8), Protocol(levels_deg=(0.0, -3.0, 0.0, 3.0)), Protocol(cycles=3)],
    ids=["paper", "rests", "other side", "few"],
)
def test_cycles_without_an_angle(protocol: Protocol) -> None:
    truth = replace(TRUTH, protocol=protocol, drift_V_per_min=0.3)
    signals = made(truth)
    found = angle_by_protocol(signals.time_s, signals.volts, signals.receivers, Asked(3.0))
    assert found.starts_s == pytest.approx(protocol.starts_s(), abs=0.005)
    assert found.angle_deg == pytest.approx(protocol.angle_deg(signals.time_s), abs=0.08)  # 5 ms at 15 °/s


def test_sides_that_no_name_tells_begin_with_a_positive_one() -> None:
    signals = made(replace(TRUTH, protocol=Protocol(levels_deg=(0.0, -3.0, 0.0, 3.0))))
    found = angle_by_protocol(signals.time_s, signals.volts, ("a", "b"), Asked(3.0))
    assert found.angle_deg == pytest.approx(-signals.angle_deg, abs=0.08)
    assert any("first excursion is assumed to be positive" in warning for warning in found.warnings)


@pytest.mark.parametrize("other", [{"hold_s": 2.0}, {"hold_s": 0.2}, {"speed_deg_per_s": 5.0}], ids=str)
def test_a_protocol_that_was_another_is_refused(other: dict[str, float]) -> None:
    signals = made(replace(TRUTH, protocol=Protocol(**other)))  # type: ignore[arg-type]  # its numbers
    with pytest.raises(DataError, match=r"does not match ±3° at 15°/s with holds of 0\.8 s"):
        angle_by_protocol(signals.time_s, signals.volts, signals.receivers, Asked(3.0))


@pytest.mark.parametrize("other", [{"noise_V": 0.3}, {"drift_V_per_min": 3.0}, {"hysteresis_V": 0.3}], ids=str)
def test_noise_drift_and_hysteresis_are_no_other_protocol(other: dict[str, float]) -> None:
    signals = made(replace(TRUTH, **other))  # type: ignore[arg-type]  # its numbers
    wander = 0.5 * np.sin(0.3 * signals.time_s)[:, None]
    found = angle_by_protocol(signals.time_s, signals.volts + wander * [0.0, 1.0], signals.receivers, Asked(3.0))
    assert found.starts_s == pytest.approx(TRUTH.protocol.starts_s(), abs=0.1)


def test_what_does_not_repeat_is_refused() -> None:
    time_s = np.arange(0.0, 20.0, 0.005)
    noise = np.random.default_rng(4).standard_normal((time_s.size, 2))
    with pytest.raises(DataError, match="is not periodic"):
        angle_by_protocol(time_s, noise, ("left", "right"), Asked(3.0))
    with pytest.raises(DataError, match="less than one and a half cycles"):
        angle_by_protocol(time_s[:400], noise[:400], ("left", "right"), Asked(3.0))
