"""Analysis of raw recordings of a simulated rig, with switching, lamps, clipping and a log on another clock."""

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

LAMPS = Rig(lamps_V=0.05, gain_V=(11.5, 8.0))
"""Lamps flicker, and the left receiver reaches the lower rail at large angles."""
SHORT = replace(LAMPS, protocol=Protocol(cycles=3), sampled_hz=6000.0)


def errors(result: Study, rig: Rig, *, pooled: bool = False) -> list[FloatArray]:
    """Return the errors of each receiver's means in standard deviations, pooled over the angles if there are few."""
    sensor = next(iter(result.sensors.values()))
    rows = []
    for column, receiver in enumerate(sensor.receivers.values()):
        sd = np.sqrt(np.nanmean(receiver.sd_V**2)) if pooled else receiver.sd_V
        row = (receiver.mean_V + rig.light_V(receiver.angle_deg)[:, column]) / sd
        rows.append(row[np.isfinite(row)])
    return rows


def test_detects_all_properties_of_a_raw_recording(tmp_path: Path) -> None:
    """Decimal commas, a log 35 ms ahead, lamps, and one rail."""
    result = study([LAMPS.write(tmp_path, german=True)])
    switching, alignment = result.switching["daq"], result.alignment["daq"]
    assert (switching.on_off_hz, switching.mains_hz, switching.on) == (200.0, 50.0, "low")
    assert switching.flicker_V == pytest.approx(0.05, rel=0.02)
    volts = LAMPS.sampled()[1]
    assert list(switching.clipped_samples.values()) == [int((volts[:, 0] <= 0.0).sum()), 0]
    assert switching.clipped_samples["left_V"] > 10_000
    assert abs(alignment.lag_s - LAMPS.lag_s) < 2.8 * alignment.u_lag_s < 1e-4
    for row in errors(result, LAMPS):
        assert np.abs(row).max() < 3.0
    left = next(iter(result.sensors.values())).receivers["left_V"]
    assert left.clipped_angles_deg[0][1] == 3.0
    for option in ("--angle-file", "stage.csv", "--on-off-hz 200", "--mains-hz 50", "--rails 0 inf"):
        assert option in (result.command or "")


def test_command_with_all_settings_gives_the_same_result(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    detected = study([path])
    specified = study([path], detected.options)
    assert specified.command == detected.command
    for first, second in zip(
        detected.sensors["daq"].receivers.values(), specified.sensors["daq"].receivers.values(), strict=True
    ):
        assert first.mean_V == pytest.approx(second.mean_V, abs=1e-12, nan_ok=True)
        assert first.clipped_samples == second.clipped_samples > -1


def test_raw_and_demodulated_files_give_the_same_result(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    demodulate_file(path, options=DemodulationOptions(rate_hz=200.0), out=tmp_path / "readings.csv")
    log = AnalysisOptions(angle_file=(tmp_path / "stage.csv",))
    raw, readings = (
        next(iter(study([file], log).sensors.values())).receivers for file in (path, tmp_path / "readings.csv")
    )
    for first, second in zip(raw.values(), readings.values(), strict=True):
        assert first.mean_V == pytest.approx(second.mean_V, abs=1e-5, nan_ok=True)
        assert (first.clipped_samples, first.clipped_angles_deg) == (second.clipped_samples, second.clipped_angles_deg)


@pytest.mark.parametrize("log_hz", [20.0, 50.0])
def test_interpolated_log_does_not_cut_the_corners_of_ramps(tmp_path: Path, log_hz: float) -> None:
    rig = replace(SHORT, gain_V=(7.0, 8.0), log_hz=log_hz, protocol=Protocol(cycles=6))
    for row in errors(study([rig.write(tmp_path, name="daq.mat")]), rig):
        assert np.abs(row[[0, 1, 2, -3, -2, -1]]).max() < 3.0


def test_recorded_angle_is_averaged_over_the_samples_of_a_reading(tmp_path: Path) -> None:
    rig = replace(SHORT, gain_V=(7.0, 8.0))
    for row in errors(study([rig.write(tmp_path, log=False, name="daq.mat")]), rig, pooled=True):
        assert np.abs(row).max() < 3.0


def test_detects_light_that_raises_the_voltage(tmp_path: Path) -> None:
    rig = replace(SHORT, gain_V=(-1.5, -2.0), dark_V=(0.6, 0.5), room_V=0.1)
    result = study([rig.write(tmp_path, name="daq.mat")])
    assert result.switching["daq"].on == "high"
    for row in errors(result, rig, pooled=True):
        assert np.abs(row).max() < 3.0


def test_dimmed_lamp_is_not_taken_for_the_emitter(tmp_path: Path) -> None:
    """The emitter is always on."""
    rig = replace(SHORT, sampled_hz=2000.0, lamps_V=0.0, gain_V=(5.0, 6.0))
    time_s = np.arange(0.0, float(rig.protocol.corners()[0][-1]), 1.0 / rig.sampled_hz)
    volts = 4.9 - rig.light_V(rig.angle_deg(time_s)) - 0.1 * ((time_s * 120.3) % 1.0 < 0.5)[:, None]
    volts += 1e-3 * np.random.default_rng(0).standard_normal(volts.shape)
    rows = np.column_stack([time_s, rig.angle_deg(time_s), volts])
    header = "time_s,angle_deg,left_V,right_V"
    np.savetxt(tmp_path / "lit.csv", rows, delimiter=",", header=header, comments="", fmt="%.5f")
    result = study([tmp_path / "lit.csv"])
    assert not result.switching
    assert any("assumed to be ambient light" in line and "120.3" in line for line in result.warnings)


def test_options_replace_the_detection(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, log=False, name="daq.mat")
    specified = study([path], AnalysisOptions(on_off_hz=200.0, mains_hz=0.0, rails=(-1.0, 6.0)))
    switching = specified.switching["daq"]
    assert (switching.detected, switching.mains_hz, sum(switching.clipped_samples.values())) == (False, None, 0)
    assert not study([path], AnalysisOptions(on_off_hz=0.0)).switching


def test_refuses_rails_for_readings_without_ambient_light(tmp_path: Path) -> None:
    demodulate_file(
        SHORT.write(tmp_path, name="daq.mat"), options=DemodulationOptions(rate_hz=200.0), out=tmp_path / "readings.csv"
    )
    with pytest.raises(SpecError, match="0 5"):
        study([tmp_path / "readings.csv"], AnalysisOptions(rails=(0.0, 5.0)))


def test_log_without_times_requires_a_rate(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    log_s, log_deg = SHORT.logged()
    np.savetxt(tmp_path / "bare.csv", log_deg, header="angle_deg", comments="", fmt="%.6f")
    options = AnalysisOptions(angle_file=(tmp_path / "bare.csv",), angle_rate_hz=SHORT.log_hz)
    alignment = study([path], options).alignment["daq"]
    assert alignment.lag_s == pytest.approx(SHORT.lag_s - log_s[0], abs=2.8 * alignment.u_lag_s)
    with pytest.raises(SpecError, match="angle_rate_hz"):
        AnalysisOptions(angle_rate_hz=50.0)


def test_uses_the_only_log_in_the_folder_and_refuses_several(tmp_path: Path) -> None:
    path = SHORT.write(tmp_path, name="daq.mat")
    (tmp_path / "notes.txt").write_text("no table\n", encoding="utf-8")
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


LOGS = (
    Rig(),
    Rig(log_hz=10.0),
    Rig(log_hz=20.0),
    Rig(log_hz=20.0, smooth_s=0.05),
    Rig(log_hz=100.0, smooth_s=0.02),
    Rig(encoder_deg=0.01),
    Rig(encoder_deg=0.05),
    Rig(encoder_deg=0.3, log_hz=1000.0),
    Rig(stamp_s=1e-3),
    Rig(log_hz=53.0, encoder_deg=0.05),
)


def error_ratio(rig: Rig, flicker_V: float = 0.0) -> float:
    """Return the ratio of a lag's error to its uncertainty, for readings at 200 Hz."""
    rng = np.random.default_rng(rig.seed)
    time_s = np.arange(0.003 * rng.uniform(), float(rig.protocol.corners()[0][-1]), 0.005)
    volts = -rig.light_V(rig.angle_deg(time_s)) + 1e-3 * rng.standard_normal((time_s.size, 2))
    volts += flicker_V * np.cos(2.0 * np.pi * 100.0 * time_s + rng.uniform(0.0, 6.0))[:, None]
    log_s, log_deg = rig.logged()
    rounding_s = float(np.mean(replace(rig, stamp_s=0.0).logged()[0] - log_s))  # its mean is equivalent to a lag
    alignment = align(time_s, volts, log_s, log_deg)
    return (alignment.lag_s + rounding_s - rig.lag_s) / alignment.u_lag_s


def drawn(seed: int, rig: Rig) -> Rig:
    """Return a rig with drawn lag, decentre and chip width."""
    rng = np.random.default_rng(seed)
    lag_s, offset_mm, width_mm = rng.uniform(-0.1, 0.1), rng.uniform(-0.05, 0.05), rng.uniform(0.05, 0.3)
    return replace(rig, seed=seed, lag_s=lag_s, offset_mm=offset_mm, width_mm=width_mm)


def test_uncertainty_of_the_lag_is_correct() -> None:
    """For all kinds of logs; 2.78 is the 95 % limit of t with 4 degrees of freedom."""
    ratios = np.array([error_ratio(drawn(seed, LOGS[seed % len(LOGS)])) for seed in range(120)])
    assert (np.abs(ratios) > 2.78).sum() <= 10  # 6 of 120 are expected; 95 % limit of the binomial distribution
    assert np.sqrt(np.mean(np.clip(ratios, -5.0, 5.0) ** 2)) > 0.3  # not unnecessarily large


def test_uncertainty_of_the_lag_includes_flicker_synchronous_with_the_cycles() -> None:
    ratios = np.array([error_ratio(drawn(seed, Rig()), flicker_V=0.05) for seed in range(30)])
    assert (np.abs(ratios) > 2.78).sum() <= 4


@pytest.mark.evidence
@pytest.mark.parametrize("rig", LOGS)
def test_uncertainty_of_the_lag_is_correct_for_each_kind_of_log(rig: Rig) -> None:
    ratios = np.array([error_ratio(drawn(seed, rig)) for seed in range(200)])
    print(rig, f"above 2.78 u: {(np.abs(ratios) > 2.78).mean():.1%}, RMS {ratios.std():.2f} u")
    assert (np.abs(ratios) > 2.78).mean() <= 0.09


def coverage(seeds: range, folder: Path) -> dict[str, float]:
    """Return the fractions of 95 % intervals that contain the true values, from raw samples to a diagnosis."""
    design, hits = response(), {"emitter_offset_mm": 0, "chip_width_mm": 0, "lag": 0, "corners": 0}
    for seed in seeds:
        rng = np.random.default_rng(seed + 500)
        width_mm = rng.uniform(0.1, 0.3)
        rig = replace(
            drawn(seed, LAMPS),
            width_mm=width_mm,
            start=rng.uniform(),
            ppm=rng.uniform(-100.0, 100.0),
            mains_hz=50.0 + 0.02 * rng.standard_normal(),
            zero_deg=PRIORS["angle.zero_deg"] * rng.standard_normal(),
            index=PRIORS["material.index"] * rng.standard_normal(),
        )
        result = study([rig.write(folder, name="daq.mat")])
        estimates = diagnosed(next(iter(result.sensors.values())), design, PRIORS).estimates
        for name, true in (("emitter_offset_mm", rig.offset_mm), ("chip_width_mm", rig.width_mm)):
            low, high = estimates[name].low, estimates[name].high
            hits[name] += low is not None and high is not None and low <= true <= high
        alignment = next(iter(result.alignment.values()))
        hits["lag"] += abs(alignment.lag_s - rig.lag_s) <= 2.78 * alignment.u_lag_s
        hits["corners"] += all(np.abs(row[[0, 1, -2, -1]]).max() <= 3.0 for row in errors(result, rig))
    return {name: count / len(seeds) for name, count in hits.items()}


def test_intervals_contain_true_values_from_raw_samples_to_a_diagnosis(tmp_path: Path) -> None:
    assert min(coverage(range(3), tmp_path).values()) > 0.6


@pytest.mark.evidence
def test_intervals_have_their_coverage_from_raw_samples_to_a_diagnosis(tmp_path: Path) -> None:
    fractions = coverage(range(200), tmp_path)
    print(fractions)
    assert min(fractions.values()) >= 0.90
    assert max(fractions["emitter_offset_mm"], fractions["chip_width_mm"]) <= 0.99  # not unnecessarily wide
