"""A raw recording with everything a rig does to it is analysed alone, by one road, and its numbers are truthful."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solen.analysis import AnalysisOptions, Study, study
from solen.analysis.alignment import align
from solen.analysis.demodulation import DemodulationOptions
from solen.analysis.diagnosis import diagnosed
from solen.arrays import FloatArray
from solen.errors import DataError, SpecError
from solen.pipeline.bench.demodulate import demodulate as demodulate_file
from tests.analysis.diagnosis_support import PRIORS, response
from tests.analysis.rig_support import Rig
from tests.analysis.simulated_support import Protocol

ROUGH = Rig(lamps_V=0.05, gain_V=(11.5, 8.0))
"""Lamps flicker, and the left receiver reaches the lower rail at large angles."""
SHORT = replace(ROUGH, protocol=Protocol(cycles=3), sampled_hz=6000.0)


def departures(found: Study, rig: Rig, *, pooled: bool = False) -> list[FloatArray]:
    """By how many reported standard deviations each mean departs from the light, by receiver, where there is one.

    Of few ways one deviation is hardly known; pooled over the angles it is.
    """
    sensor = next(iter(found.sensors.values()))
    away = []
    for place, one in enumerate(sensor.receivers.values()):
        sd = np.sqrt(np.nanmean(one.sd_V**2)) if pooled else one.sd_V
        off = (one.mean_V + rig.light_V(one.angle_deg)[:, place]) / sd
        away.append(off[np.isfinite(off)])
    return away


def test_one_file_is_enough(tmp_path: Path) -> None:
    """German decimals, a log 35 ms ahead, lamps, one rail: all is detected, done, and stated in full."""
    found = study([ROUGH.write(tmp_path, german=True)])
    state, lag = found.switching["daq"], found.alignment["daq"]
    assert (state.on_off_hz, state.mains_hz, state.on) == (200.0, 50.0, "low")
    assert state.flicker_V == pytest.approx(0.05, rel=0.02)
    volts = ROUGH.sampled()[1]
    assert list(state.clipped_samples.values()) == [int((volts[:, 0] <= 0.0).sum()), 0]
    assert state.clipped_samples["left_V"] > 10_000
    assert abs(lag.lag_s - ROUGH.lag_s) < 2.8 * lag.u_lag_s < 1e-4
    for off in departures(found, ROUGH):
        assert np.abs(off).max() < 3.0
    left = next(iter(found.sensors.values())).receivers["left_V"]
    assert left.clipped_angles_deg[0][1] == 3.0
    for word in ("--angle-file", "stage.csv", "--on-off-hz 200", "--mains-hz 50", "--rails 0 inf"):
        assert word in (found.command or "")


def test_the_command_in_full_gives_the_same_numbers(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    found = study([path])
    again = study([path], found.options)
    assert again.command == found.command
    for one, other in zip(
        found.sensors["daq"].receivers.values(), again.sensors["daq"].receivers.values(), strict=True
    ):
        assert one.mean_V == pytest.approx(other.mean_V, abs=1e-12, nan_ok=True)
        assert one.clipped_samples == other.clipped_samples > -1


def test_both_ways_are_one_road(tmp_path: Path) -> None:
    """`solen bench demodulate`, then analyse: the same curves, clipped readings and corners as of the raw file."""
    path = SHORT.write(tmp_path, name="daq.mat")
    demodulate_file(path, options=DemodulationOptions(rate_hz=200.0), out=tmp_path / "readings.csv")
    log = AnalysisOptions(angle_file=(tmp_path / "stage.csv",))
    one, two = (next(iter(study([each], log).sensors.values())) for each in (path, tmp_path / "readings.csv"))
    for name, other in zip(one.receivers, two.receivers, strict=True):
        a, b = one.receivers[name], two.receivers[other]
        assert a.mean_V == pytest.approx(b.mean_V, abs=1e-5, nan_ok=True)
        assert (a.clipped_samples, a.clipped_angles_deg) == (b.clipped_samples, b.clipped_angles_deg)


@pytest.mark.parametrize("log_hz", [20.0, 50.0])
def test_corners_of_ramps_are_not_cut(tmp_path: Path, log_hz: float) -> None:
    rig = replace(SHORT, gain_V=(7.0, 8.0), log_hz=log_hz, protocol=Protocol(cycles=6))
    for off in departures(study([rig.write(tmp_path, name="daq.mat")]), rig):
        assert np.abs(off[[0, 1, 2, -3, -2, -1]]).max() < 3.0


def test_an_angle_beside_the_voltages_is_averaged_over_the_same_samples(tmp_path: Path) -> None:
    found = study([replace(SHORT, gain_V=(7.0, 8.0)).write(tmp_path, log=False, name="daq.mat")])
    for off in departures(found, replace(SHORT, gain_V=(7.0, 8.0)), pooled=True):
        assert np.abs(off).max() < 3.0


def test_light_that_raises_is_detected(tmp_path: Path) -> None:
    rig = replace(SHORT, gain_V=(-1.5, -2.0), dark_V=(0.6, 0.5), room_V=0.1)
    found = study([rig.write(tmp_path, name="daq.mat")])
    assert found.switching["daq"].on == "high"
    for off in departures(found, rig, pooled=True):
        assert np.abs(off).max() < 3.0


def test_a_lamp_that_switches_is_none_of_the_sensors(tmp_path: Path) -> None:
    """A dimmed lamp in the room, and an emitter that is always on."""
    rig = replace(SHORT, sampled_hz=2000.0, lamps_V=0.0, gain_V=(5.0, 6.0))
    time_s = np.arange(0.0, float(rig.protocol.corners()[0][-1]), 1.0 / rig.sampled_hz)
    volts = 4.9 - rig.light_V(rig.angle_deg(time_s)) - 0.1 * ((time_s * 120.3) % 1.0 < 0.5)[:, None]
    volts += 1e-3 * np.random.default_rng(0).standard_normal(volts.shape)
    rows = np.column_stack([time_s, rig.angle_deg(time_s), volts])
    header = "time_s,angle_deg,left_V,right_V"
    np.savetxt(tmp_path / "lit.csv", rows, delimiter=",", header=header, comments="", fmt="%.5f")
    found = study([tmp_path / "lit.csv"])
    assert not found.switching
    assert any("assumed to be ambient light" in line and "120.3" in line for line in found.warnings)


def test_what_is_asked_for_is_not_detected(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, log=False, name="daq.mat")
    stated = study([path], AnalysisOptions(on_off_hz=200.0, mains_hz=0.0, rails=(-1.0, 6.0)))
    state = stated.switching["daq"]
    assert (state.detected, state.mains_hz, sum(state.clipped_samples.values())) == (False, None, 0)
    plain = study([path], AnalysisOptions(on_off_hz=0.0))
    assert not plain.switching


def test_rails_are_no_limits_of_differences(tmp_path: Path) -> None:
    demodulate_file(
        SHORT.write(tmp_path, name="daq.mat"), options=DemodulationOptions(rate_hz=200.0), out=tmp_path / "readings.csv"
    )
    with pytest.raises(SpecError, match="0 5"):
        study([tmp_path / "readings.csv"], AnalysisOptions(rails=(0.0, 5.0)))


def test_a_log_without_times_has_a_rate(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    log_s, log_deg = SHORT.logged()
    np.savetxt(tmp_path / "bare.csv", log_deg, header="angle_deg", comments="", fmt="%.6f")
    options = AnalysisOptions(angle_file=(tmp_path / "bare.csv",), angle_rate_hz=SHORT.log_hz)
    found = study([path], options).alignment["daq"]
    assert found.lag_s == pytest.approx(SHORT.lag_s - log_s[0], abs=2.8 * found.u_lag_s)
    with pytest.raises(SpecError, match="angle_rate_hz"):
        AnalysisOptions(angle_rate_hz=50.0)


def test_one_log_beside_a_recording_is_taken_and_several_are_asked_about(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    (tmp_path / "notes.txt").write_text("nothing of the kind\n", encoding="utf-8")
    (tmp_path / "table.csv").write_text("a,b\n1,2\n3,4\n", encoding="utf-8")
    assert any("stage.csv" in line for line in study([path]).warnings)
    (tmp_path / "other.csv").write_bytes((tmp_path / "stage.csv").read_bytes())
    with pytest.raises(DataError, match=r"other\.csv, stage\.csv"):
        study([path])
    (tmp_path / "stage.csv").rename(tmp_path / "daq_stage.csv")
    assert any("daq_stage.csv" in line for line in study([path]).warnings)
    for name in ("other.csv", "daq_stage.csv"):
        (tmp_path / name).unlink()
    with pytest.raises(DataError, match="--angle-file"):
        study([path])


LOGS: tuple[dict[str, float], ...] = (
    {},
    {"log_hz": 10.0},
    {"log_hz": 20.0},
    {"log_hz": 20.0, "smooth_s": 0.05},
    {"log_hz": 100.0, "smooth_s": 0.02},
    {"encoder_deg": 0.01},
    {"encoder_deg": 0.05},
    {"encoder_deg": 0.3, "log_hz": 1000.0},
    {"stamp_s": 1e-3},
    {"log_hz": 53.0, "encoder_deg": 0.05},
)


def pull(rig: Rig, flicker_V: float = 0.0) -> float:
    """Error of a lag in its reported uncertainties, by readings at 200 Hz as a rig would give them."""
    draw = np.random.default_rng(rig.seed)
    time_s = np.arange(0.003 * draw.uniform(), float(rig.protocol.corners()[0][-1]), 0.005)
    volts = -rig.light_V(rig.angle_deg(time_s)) + 1e-3 * draw.standard_normal((time_s.size, 2))
    volts += flicker_V * np.cos(2.0 * np.pi * 100.0 * time_s + draw.uniform(0.0, 6.0))[:, None]
    log_s, log_deg = rig.logged()
    late_s = float(np.mean(replace(rig, stamp_s=0.0).logged()[0] - log_s))  # a constant part of rounding is a lag
    found = align(time_s, volts, log_s, log_deg)
    return (found.lag_s + late_s - rig.lag_s) / found.u_lag_s


def drawn(seed: int, **other: float) -> Rig:
    draw = np.random.default_rng(seed)
    own = {
        "lag_s": draw.uniform(-0.1, 0.1),
        "offset_mm": draw.uniform(-0.05, 0.05),
        "width_mm": draw.uniform(0.05, 0.3),
    }
    return replace(Rig(), seed=seed, **own | other)  # type: ignore[arg-type]  # its numbers


def test_the_uncertainty_of_a_lag_is_truthful() -> None:
    """Logs of every kind; 95 % by t with 4 degrees of freedom are 2.78."""
    pulls = np.array([pull(drawn(seed, **LOGS[seed % len(LOGS)])) for seed in range(120)])
    assert (np.abs(pulls) > 2.78).sum() <= 10  # 6 of 120 expected of the scatter alone; binomial 95 %
    assert np.sqrt(np.mean(np.clip(pulls, -5.0, 5.0) ** 2)) > 0.3  # nor are they wide without need


def test_flicker_that_keeps_step_with_the_cycles_is_in_the_uncertainty() -> None:
    pulls = np.array([pull(drawn(seed), flicker_V=0.05) for seed in range(30)])
    assert (np.abs(pulls) > 2.78).sum() <= 4


@pytest.mark.evidence
@pytest.mark.parametrize("place", range(len(LOGS)))
def test_the_uncertainty_of_a_lag_is_truthful_for_each_log(place: int) -> None:
    pulls = np.array([pull(drawn(seed, **LOGS[place])) for seed in range(200)])
    print(LOGS[place], f"beyond 2.78 u: {(np.abs(pulls) > 2.78).mean():.1%}, rms {pulls.std():.2f} u")
    assert (np.abs(pulls) > 2.78).mean() <= 0.09


def covered(seeds: range, folder: Path) -> dict[str, float]:
    """How often 95 % intervals hold the truth, from raw samples to a diagnosis."""
    of, hits = response(), {"emitter_offset_mm": 0, "chip_width_mm": 0, "lag": 0, "corners": 0}
    for seed in seeds:
        draw = np.random.default_rng(seed + 500)
        rig = replace(
            drawn(seed, width_mm=draw.uniform(0.1, 0.3)),
            lamps_V=0.05,
            gain_V=(11.5, 8.0),
            start=draw.uniform(),
            ppm=draw.uniform(-100.0, 100.0),
            mains_hz=50.0 + 0.02 * draw.standard_normal(),
            zero_deg=PRIORS["angle.zero_deg"] * draw.standard_normal(),
            index=PRIORS["material.index"] * draw.standard_normal(),
        )
        found = study([rig.write(folder, name="daq.mat")])
        estimates = diagnosed(next(iter(found.sensors.values())), of, PRIORS).estimates
        for name, true in (("emitter_offset_mm", rig.offset_mm), ("chip_width_mm", rig.width_mm)):
            low, high = estimates[name].low, estimates[name].high
            hits[name] += low is not None and high is not None and low <= true <= high
        lag = next(iter(found.alignment.values()))
        hits["lag"] += abs(lag.lag_s - rig.lag_s) <= 2.78 * lag.u_lag_s
        hits["corners"] += all(np.abs(off[[0, 1, -2, -1]]).max() <= 3.0 for off in departures(found, rig))
    return {name: count / len(seeds) for name, count in hits.items()}


def test_intervals_hold_from_raw_samples_to_a_diagnosis(tmp_path: Path) -> None:
    assert min(covered(range(4), tmp_path).values()) >= 0.75


@pytest.mark.evidence
def test_intervals_hold_from_raw_samples_to_a_diagnosis_over_200_seeds(tmp_path: Path) -> None:
    found = covered(range(200), tmp_path)
    print(found)
    assert min(found.values()) >= 0.90
    assert max(found["emitter_offset_mm"], found["chip_width_mm"]) <= 0.99  # nor are they wide without need
