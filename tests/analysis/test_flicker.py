"""Flicker of lamps is fitted to the off phases and subtracted from the on phases, without averaging over time."""

from dataclasses import replace

import numpy as np
import pytest

from solen.analysis.demodulation import OFF, find_clock, slots_of, subtract
from solen.analysis.demodulation.flicker import Flicker, find_flicker
from solen.arrays import FloatArray
from tests.analysis.rig_support import Rig
from tests.analysis.simulated_support import Protocol

LAMPS = Rig(protocol=Protocol(cycles=2), lamps_V=0.1)


def flicker_and_errors(rig: Rig) -> tuple[Flicker | None, FloatArray]:
    """Return the flicker, and the errors of readings at rest after its subtraction, (m, 2)."""
    time_s, volts = rig.sampled()
    clock = find_clock(time_s, volts, rig.switch_hz)
    state = clock.states(3e-4)
    flicker = find_flicker(time_s, volts, state, clock.rate_hz)
    without_flicker = volts if flicker is None else volts - flicker.values
    readings = subtract(slots_of(time_s, without_flicker, state, gap_s=clock.shorter_s))
    stationary = np.abs(np.gradient(rig.angle_deg(readings.time_s))) < 1e-9
    return flicker, (readings.signal + rig.light_V(rig.angle_deg(readings.time_s)))[stationary]


@pytest.mark.parametrize("mains_hz", [50.03, 49.96, 60.02, 59.95])
@pytest.mark.parametrize(
    "rig",
    [LAMPS, replace(LAMPS, noise_V=0.001), replace(LAMPS, lamps_V=0.01), replace(LAMPS, switch_hz=160.0)],
    ids=["usual", "low noise", "weak lamps", "160 Hz"],
)
def test_removes_flicker_to_within_the_noise(mains_hz: float, rig: Rig) -> None:
    """Lamps flicker at two and four times the mains; a reading of 21 samples has 0.27 times the noise of a sample."""
    flicker, errors = flicker_and_errors(replace(rig, mains_hz=mains_hz))
    assert flicker is not None
    assert flicker.mains_hz == pytest.approx(mains_hz, abs=0.004)
    assert flicker.amplitude[0] == pytest.approx(rig.lamps_V, rel=0.1)
    assert errors.std(axis=0).max() < 0.4 * rig.noise_V
    assert np.abs(errors.mean(axis=0)).max() < 0.3 * rig.noise_V


def test_removes_a_harmonic_at_the_switching_rate() -> None:
    """A harmonic at exactly 200 Hz differs from the emitter's light only by its waveform within the off slots."""
    flicker, errors = flicker_and_errors(replace(LAMPS, mains_hz=50.0, ppm=0.0))
    assert flicker is not None
    assert flicker.multiples == (2, 4)
    assert errors.std(axis=0).max() < 0.4 * LAMPS.noise_V
    assert np.abs(errors.mean(axis=0)).max() < 0.5 * LAMPS.noise_V  # 17 mV without this correction


def test_settling_of_a_slow_receiver_is_not_taken_for_flicker() -> None:
    rig = replace(LAMPS, lamps_V=0.05, constant_s=1e-4, mains_hz=50.0, ppm=0.0)
    flicker, errors = flicker_and_errors(rig)
    assert flicker is not None
    assert flicker.amplitude[0] == pytest.approx(0.05, rel=0.1)
    assert errors.std(axis=0).max() < 0.02


@pytest.mark.parametrize("seed", range(6))
def test_finds_no_flicker_in_drifting_light(seed: int) -> None:
    assert flicker_and_errors(replace(LAMPS, lamps_V=0.0, drift_V_per_min=1.0, seed=seed))[0] is None


def test_finds_no_flicker_in_single_samples() -> None:
    time_s = np.arange(400) / 400.0
    state = np.where(np.arange(400) % 2, OFF, 1)
    values = np.cos(2.0 * np.pi * 100.0 * time_s)[:, None]
    assert find_flicker(time_s, values, state.astype(np.int64), 200.0) is None


@pytest.mark.parametrize("rate_hz", [10.0, 25.0, 50.0])
def test_finds_no_flicker_if_harmonics_are_at_multiples_of_the_rate(rate_hz: float) -> None:
    time_s = np.arange(0.0, 4.0, 1e-4)
    state = np.where((time_s * rate_hz) % 1.0 < 0.5, 1, OFF)
    values = 0.1 * np.sin(2.0 * np.pi * 100.0 * time_s)[:, None]
    assert find_flicker(time_s, values, state.astype(np.int64), rate_hz) is None


def test_step_of_the_light_affects_only_readings_at_its_time() -> None:
    time_s, volts = LAMPS.sampled()
    step_s = 3.0101
    volts -= 0.4 * (time_s > step_s)[:, None]
    clock = find_clock(time_s, volts, 200.0)
    state = clock.states(3e-4)
    flicker = find_flicker(time_s, volts, state, clock.rate_hz)
    assert flicker is not None
    readings = subtract(slots_of(time_s, volts - flicker.values, state, gap_s=clock.shorter_s))
    errors = readings.signal + LAMPS.light_V(LAMPS.angle_deg(readings.time_s))
    near = (np.abs(readings.time_s - step_s) < 0.3) & (np.abs(readings.time_s - step_s) > 0.01)
    assert np.abs(errors[near]).max() < 5.0 * 0.4 * LAMPS.noise_V
