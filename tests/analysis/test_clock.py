"""The clock of the emitters in a waveform: its rate, drift and edges are found as they were made."""

import numpy as np
import pytest

from solen.analysis.demodulation import DROPPED, find_clock, slots_of, subtract
from solen.arrays import FloatArray
from solen.errors import DataError
from tests.analysis.switching_support import waveform

SAMPLE_US = 100.0


def off_by_us(found: FloatArray, phase: FloatArray, rate_hz: float) -> FloatArray:
    """Distance of found edges from the true ones; whole periods do not count."""
    turns = found - phase
    return np.asarray(1e6 * (turns - np.round(np.median(turns))) / rate_hz)


@pytest.mark.parametrize("ppm", [0.0, 40.0, -300.0, 9000.0])
def test_rate_and_edges_are_found(ppm: float) -> None:
    time, values, phase = waveform(6.0, ppm=ppm, noise=0.1)
    found = find_clock(time, values, 200.0)
    assert found.rate_hz == pytest.approx(200.0 * (1 + 1e-6 * ppm), abs=5e-3)
    assert found.on_share == pytest.approx(0.5, abs=0.02)
    assert found.depth == pytest.approx(1.5, abs=0.1)
    assert np.abs(off_by_us(found.phase, phase, 200.0)).max() < SAMPLE_US, "a sample is no finer than that"


def test_a_drifting_clock_is_followed() -> None:
    """0.4 ms to and fro in 8 s: an even clock would be off by four samples."""
    drift = 4e-4

    def drift_s(time: FloatArray) -> FloatArray:
        return np.asarray(drift * np.sin(2 * np.pi * time / 8.0))

    time, values, phase = waveform(12.0, noise=0.05, drift_s=drift_s)
    found = find_clock(time, values, 200.0)
    assert np.abs(off_by_us(found.phase, phase, 200.0)).max() < SAMPLE_US
    assert 1e-6 * found.wander_us > 0.5 * drift


def test_a_waveform_gives_the_light_of_each_emitter() -> None:
    time, values, _ = waveform(4.0, emitters=3, noise=0.02, sampled_hz=30_000.0)
    clock = find_clock(time, values, 200.0, emitters=3)
    found = subtract(slots_of(time, values, clock.states(2e-4, 3)))
    assert found.emitters == (1, 2, 3)
    means = [found.signal[found.of(one)].mean(axis=0) for one in found.emitters]
    first = round(-means[0][0])  # the recording begins in the middle of a turn
    expected = [1 + (first - 1 + k) % 3 for k in range(3)]
    assert [-m[0] for m in means] == pytest.approx(expected, abs=0.01)
    assert [-2 * m[1] for m in means] == pytest.approx(expected, abs=0.01)
    assert found.counts.missing == {1: 0, 2: 0, 3: 0}
    assert found.period_s == pytest.approx(5e-3, rel=1e-3)


def test_light_that_raises_is_reported_as_such() -> None:
    time, values, phase = waveform(2.0, noise=0.02)
    found = find_clock(time, 4.0 - values, 200.0, on="high")
    assert np.abs(off_by_us(found.phase, phase, 200.0)).max() < SAMPLE_US


def test_settling_samples_and_edges_are_dropped() -> None:
    time, values, phase = waveform(1.0, noise=0.01)
    state = find_clock(time, values, 200.0).states(5e-4)
    inside = phase % 1.0
    settled = (inside % 0.5) * 5e-3 > 5e-4 + 1e-4
    on = inside < 0.5
    assert (state[settled & on & (inside < 0.47)] == 1).all()
    assert (state[settled & ~on & (inside < 0.97)] == 0).all()
    assert (state[(inside % 0.5) * 5e-3 < 4e-4] == DROPPED).all()


def test_a_flickering_room_does_not_move_the_clock() -> None:
    time, values, phase = waveform(4.0, noise=0.02)
    flicker = 0.5 * np.cos(2 * np.pi * 100.0 * time)[:, None]
    found = find_clock(time, values + flicker, 200.0)
    assert np.abs(off_by_us(found.phase, phase, 200.0)).max() < SAMPLE_US


@pytest.mark.parametrize("emitters", [1, 2, 3])
def test_emitters_of_unlike_strength_in_a_room_that_warms_are_still_switches(emitters: int) -> None:
    """10 kHz holds whole samples of a few turns, so that a phase is always seen of the same emitter, or never."""
    time, values, _ = waveform(4.0, noise=0.002, emitters=emitters)
    assert find_clock(time, values + 0.3 * time[:, None], 200.0, emitters=emitters).between_share < 0.15


def test_a_sample_at_an_edge_is_in_no_slot() -> None:
    """Emitters switched by the recorder's own clock: the sample at the edge is of one phase or the other by chance."""
    time, values, _ = waveform(4.0, noise=0.002, start=0.0)
    draw = np.random.default_rng(4)
    phase = 200.0 * time % 1.0
    edge = np.isclose(phase, 0.5) | np.isclose(phase, 0.0) | np.isclose(phase, 1.0)
    values[edge] = np.where(draw.random(edge.sum()) < 0.5, 4.0, 3.0)[:, None]
    clock = find_clock(time, values, 200.0)
    found = subtract(slots_of(time, values, clock.states(0.0), gap_s=clock.shorter_s))
    assert found.signal[:, 0] == pytest.approx(-1.0, abs=0.005)


def test_samples_that_lack_here_and_there_part_no_slot_of_a_known_clock() -> None:
    time, values, _ = waveform(4.0, noise=0.002)
    kept = np.random.default_rng(5).random(time.size) > 0.1
    clock = find_clock(time[kept], values[kept], 200.0)
    states = clock.states(3e-4)
    found = subtract(slots_of(time[kept], values[kept], states, gap_s=clock.shorter_s))
    assert found.counts.missing == {1: 0}
    assert found.time_s.size == pytest.approx(800, abs=1)
    parted = subtract(slots_of(time[kept], values[kept], states))
    assert parted.time_s.size > 1600


@pytest.mark.parametrize("part", [2, 3])
def test_a_part_of_the_rate_is_refused(part: int) -> None:
    """At 100 Hz a period holds two on phases; what stands out there is no clock of one emitter."""
    time, values, _ = waveform(4.0, noise=0.02)
    flicker = 0.1 * np.cos(2 * np.pi * 200.0 / part * time)[:, None]
    with pytest.raises(DataError, match=f"contains {part} on phases; specify 200"):
        find_clock(time, values + flicker, 200.0 / part)


def test_a_sine_lies_between_on_and_off_for_a_third() -> None:
    time, values, _ = waveform(4.0, noise=0.02)
    assert find_clock(time, values, 200.0).between_share < 0.03
    sine = np.cos(2 * np.pi * 200.0 * time)[:, None]
    assert find_clock(time, sine, 200.0).between_share == pytest.approx(1 / 3, abs=0.05)


@pytest.mark.parametrize(
    ("seconds", "sampled_hz", "depth", "words"),
    [
        (2.0, 10_000.0, 0.0, "no clear modulation"),
        (0.03, 10_000.0, 1.0, "at least 8 periods of 200 Hz"),
        (4.0, 1000.0, 1.0, "samples in a period of 200 Hz, but at least 6"),
    ],
)
def test_a_waveform_without_a_clock_is_refused(seconds: float, sampled_hz: float, depth: float, words: str) -> None:
    time, values, _ = waveform(seconds, sampled_hz=sampled_hz)
    rng = np.random.default_rng(0)
    with pytest.raises(DataError) as refusal:
        find_clock(time, depth * values + 0.1 * rng.standard_normal(values.shape), 200.0)
    assert words in str(refusal.value)
