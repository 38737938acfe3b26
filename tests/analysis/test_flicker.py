"""Flicker of lamps is fitted to the off phases and leaves the on phases, without averaging over time."""

from dataclasses import replace

import numpy as np
import pytest

from solen.analysis.demodulation import OFF, find_clock, slots_of, subtract
from solen.analysis.demodulation.flicker import Flicker, find_flicker
from solen.arrays import FloatArray
from tests.analysis.made_support import Protocol
from tests.analysis.rig_support import Rig

STILL = Rig(protocol=Protocol(cycles=2), lamps_V=0.1)


def left_of(rig: Rig) -> tuple[Flicker | None, FloatArray]:
    """The flicker, and what the readings depart from the light by once it is subtracted, (m, 2)."""
    time_s, volts = rig.sampled()
    clock = find_clock(time_s, volts, rig.switch_hz)
    state = clock.states(3e-4)
    found = find_flicker(time_s, volts, state, clock.rate_hz)
    less = volts if found is None else volts - found.values
    readings = subtract(slots_of(time_s, less, state, gap_s=clock.shorter_s))
    steady = np.abs(np.gradient(rig.angle_deg(readings.time_s))) < 1e-9
    return found, (readings.signal + rig.light_V(rig.angle_deg(readings.time_s)))[steady]


@pytest.mark.parametrize("mains_hz", [50.03, 49.96, 60.02, 59.95])
@pytest.mark.parametrize("other", [{}, {"noise_V": 0.001}, {"lamps_V": 0.01}, {"switch_hz": 160.0}], ids=str)
def test_lamps_leave_no_more_than_the_noise(mains_hz: float, other: dict[str, float]) -> None:
    """The light of a lamp at twice and four times the mains; a reading of 21 samples has 0.27 of a sample's noise."""
    rig = replace(STILL, mains_hz=mains_hz, **other)  # type: ignore[arg-type]  # its numbers
    found, off = left_of(rig)
    assert found is not None
    assert found.mains_hz == pytest.approx(mains_hz, abs=0.004)
    assert found.amplitude[0] == pytest.approx(rig.lamps_V, rel=0.1)
    assert off.std(axis=0).max() < 0.4 * rig.noise_V
    assert np.abs(off.mean(axis=0)).max() < 0.3 * rig.noise_V


def test_lamps_that_keep_step_with_the_emitter_leave_no_offset() -> None:
    """100.00 and 200.00 Hz beside 200.00: only the shape inside the off slots tells lamp and emitter apart."""
    found, off = left_of(replace(STILL, mains_hz=50.0, ppm=0.0))
    assert found is not None
    assert found.multiples == (2, 4)
    assert off.std(axis=0).max() < 0.4 * STILL.noise_V
    assert np.abs(off.mean(axis=0)).max() < 0.5 * STILL.noise_V  # 17 mV without


def test_a_slow_receiver_is_no_lamp() -> None:
    rig = replace(STILL, lamps_V=0.05, constant_s=1e-4, mains_hz=50.0, ppm=0.0)
    found, off = left_of(rig)
    assert found is not None
    assert found.amplitude[0] == pytest.approx(0.05, rel=0.1)
    assert off.std(axis=0).max() < 0.02


@pytest.mark.parametrize("seed", range(6))
def test_a_steady_room_has_no_flicker(seed: int) -> None:
    assert left_of(replace(STILL, lamps_V=0.0, drift_V_per_min=1.0, seed=seed))[0] is None


def test_few_samples_show_none() -> None:
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


def test_a_lamp_switched_on_disturbs_its_own_moment_only() -> None:
    time_s, volts = STILL.sampled()
    at_s = 3.0101
    volts -= 0.4 * (time_s > at_s)[:, None]
    clock = find_clock(time_s, volts, 200.0)
    state = clock.states(3e-4)
    found = find_flicker(time_s, volts, state, clock.rate_hz)
    assert found is not None
    readings = subtract(slots_of(time_s, volts - found.values, state, gap_s=clock.shorter_s))
    off = readings.signal + STILL.light_V(STILL.angle_deg(readings.time_s))
    near = (np.abs(readings.time_s - at_s) < 0.3) & (np.abs(readings.time_s - at_s) > 0.01)
    assert np.abs(off[near]).max() < 5.0 * 0.4 * STILL.noise_V
