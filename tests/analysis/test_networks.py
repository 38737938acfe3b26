"""Networks: readings by state, calibration and decoding of several motions, and refused recordings."""

import io
import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.analysis.calibration import CalibrationOptions, DecodeOptions, Decoder
from solen.analysis.calibration.file import load
from solen.analysis.network import (
    NetworkCalibrations,
    NetworkReadings,
    analysed_network,
    calibrated_network,
    network_readings,
)
from solen.analysis.network.file import load_network, text_of
from solen.analysis.network.stream_decoder import NetworkDecoding
from solen.arrays import FloatArray
from solen.bench.journal import Journal
from solen.bench.record import RecordOptions, record
from solen.errors import DataError, SpecError
from solen.pipeline.bench.calibrate import calibrate
from solen.pipeline.bench.decode import decode
from solen.recording import Provenance
from tests.bench.lsl_support import recorded_streams
from tests.bench.network_support import EMITTERS, LEAN, PLAN, RECEIVERS, RIG, SWAY, light, without_tracing, write
from tests.command_support import answered

NOISE_V, CYCLES_PER_STATE = 3e-4, 20
MOTIONS = ("lean", "sway")


Fractions = Callable[[FloatArray, FloatArray], FloatArray]
"""Fractions of the light (…, emitters, receivers) as a function of both angles."""


def readings(
    states: FloatArray, seed: int = 0, fractions: Fractions = light, cycles: int = CYCLES_PER_STATE
) -> NetworkReadings:
    """Return readings of a network in several states, with noise that is partly common to the receivers."""
    rng = np.random.default_rng(seed)
    angle = np.repeat(states, cycles, axis=0)
    signal = -fractions(angle[:, 0], angle[:, 1])
    common = 0.5 * NOISE_V * rng.standard_normal((len(angle), 1, 1))
    signal = signal + common + NOISE_V * rng.standard_normal(signal.shape)
    moving = np.arange(len(angle)) % cycles >= cycles - 3  # the last switching cycles are on the way to the next state
    angle = angle + np.where(moving, rng.uniform(0.3, 0.5, len(angle)), 0.0)[:, None]
    return NetworkReadings(
        sensor="fork",
        motions=MOTIONS,
        emitters=EMITTERS,
        receivers=RECEIVERS,
        time_s=np.arange(len(angle)) / 100.0,
        angle_deg=angle,
        signal=signal,
        clipped=np.zeros(signal.shape, bool),
        unit="V",
        ambient="subtracted",
        provenance=Provenance("fork.nc", simulated=True),
    )


def grid(steps: int) -> FloatArray:
    """Return a grid of states with a number of angles of each motion."""
    mesh = np.meshgrid(np.linspace(-10.0, 10.0, steps), np.linspace(-8.0, 8.0, steps), indexing="ij")
    return np.stack(mesh, axis=-1).reshape(-1, 2)


@pytest.fixture(scope="module")
def calibrations() -> NetworkCalibrations:
    return calibrated_network([readings(grid(6))])


def test_averages_the_readings_of_each_state(calibrations: NetworkCalibrations) -> None:
    analysis = analysed_network(readings(grid(4), cycles=40))
    assert len(analysis.angle_deg) == 16
    assert analysis.angle_deg == pytest.approx(grid(4), abs=1e-9)
    true = -light(*grid(4).T)
    z = (analysis.signal_V - true) / analysis.u_signal_V
    assert 0.8 < z.std() < 1.2
    assert analysis.noise_V == pytest.approx(NOISE_V * np.sqrt(1.25), rel=0.1)
    assert calibrations.states == 36


def test_decodes_states_between_the_calibrated_ones(calibrations: NetworkCalibrations) -> None:
    states = np.random.default_rng(1).uniform([-10.0, -8.0], [10.0, 8.0], (300, 2))
    signal = readings(states, 2, cycles=4).signal[::4]
    decoded = calibrations.calibration.decoder.decode(signal)
    assert not decoded.missing.any()
    assert decoded.outside.mean() < 0.01
    for level, (low, high) in enumerate(((0.62, 0.85), (0.92, 1.0))):
        within = decoded.holds(states, level).mean(axis=0)
        assert (within >= low).all(), within
        assert (within <= high).all(), within
    assert (np.abs(decoded.angle_deg - states) / decoded.sd_deg).max() < 6.0
    assert np.median(decoded.high_deg[..., 1] - decoded.low_deg[..., 1]) < 0.05 * 16.0


def test_loaded_calibration_decodes_to_the_same_angles(calibrations: NetworkCalibrations, tmp_path: Path) -> None:
    file = tmp_path / "fork.calibration.json"
    file.write_text(text_of(calibrations.calibration), encoding="utf-8")
    signal = readings(grid(3) * 0.7, 4).signal
    angles = load_network(file).decoder.decode(signal).angle_deg
    assert angles == pytest.approx(calibrations.calibration.decoder.decode(signal).angle_deg, abs=1e-9)
    data = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(data | {"noise_V2": data["noise_V2"][:-1]}), encoding="utf-8")
    with pytest.raises(DataError, match="noise_V2"):
        load_network(file)


def test_decoder_of_one_motion_refers_to_that_of_a_network(calibrations: NetworkCalibrations, tmp_path: Path) -> None:
    file = tmp_path / "fork.calibration.json"
    file.write_text(text_of(calibrations.calibration), encoding="utf-8")
    for call in (lambda: load(file), lambda: Decoder(file), lambda: Decoder(calibrations.calibration)):  # type: ignore[arg-type]
        with pytest.raises(DataError, match=r"solen\.analysis\.network\.load_network"):
            call()


def test_flags_readings_that_match_no_state_and_missing_ones(calibrations: NetworkCalibrations) -> None:
    signal = readings(grid(2) * 0.5, 5).signal[:3].copy()
    signal[1] *= 1.1  # an emitter that became brighter
    signal[2, 1, 0] = np.nan
    decoded = calibrations.calibration.decoder.decode(signal)
    assert decoded.outside.tolist() == [False, True, False]
    assert decoded.missing.tolist() == [False, False, True]
    assert np.isnan(decoded.angle_deg[2]).all()


def test_reports_both_states_with_the_same_readings() -> None:
    def symmetric(lean: FloatArray, sway: FloatArray) -> FloatArray:
        return light(np.abs(lean), sway)

    calibration = calibrated_network([readings(grid(9), fractions=symmetric)]).calibration
    decoded = calibration.decoder.decode(readings(np.array([[6.0, 2.0]]), 3, symmetric).signal[:15])
    assert decoded.ambiguous.mean() > 0.8
    both = np.sort(np.stack([decoded.angle_deg[:, 0], decoded.other_deg[:, 0]]), axis=0)[:, decoded.ambiguous]
    assert pytest.approx(np.tile([-6.0, 6.0], (both.shape[1], 1)), abs=0.5) == both.T


@pytest.mark.parametrize(
    ("fractions", "names"),
    [
        (lambda lean, sway: light(lean + 1.25 * sway, 0.0 * sway), ("lean", "sway", "same effects")),
        (lambda lean, sway: light(lean, 0.0 * sway), ("sway", "cannot be measured")),
    ],
)
def test_refuses_motions_that_cannot_be_determined_separately(fractions: Fractions, names: tuple[str, ...]) -> None:
    with pytest.raises(DataError) as refused:
        calibrated_network([readings(grid(6), fractions=fractions)])
    assert all(name in str(refused.value) for name in names), refused.value
    assert "\n" not in str(refused.value)


def test_warns_that_a_grid_does_not_show_errors_between_its_states(calibrations: NetworkCalibrations) -> None:
    assert any("grid" in line for line in calibrations.warnings)


def test_flags_few_true_readings_of_a_steep_response_as_outside() -> None:
    """Errors between the states exceed their uncertainty: 3.5 % of the readings exceeded the limit for 0.1 %."""

    def sharp(lean: FloatArray, sway: FloatArray) -> FloatArray:
        return light(lean, sway) * (1.0 + 0.1 * np.tanh(2.0 * (lean - sway)))[..., None, None]

    rng = np.random.default_rng(3)
    ends = [-10.0, -8.0], [10.0, 8.0]
    states = np.concatenate([grid(5), rng.uniform(*ends, (40, 2))])
    decoder = calibrated_network([readings(states, fractions=sharp)]).calibration.decoder
    signal = readings(rng.uniform(*ends, (400, 2)), 2, sharp, cycles=4).signal[::4]
    assert decoder.decode(signal).outside.mean() < 0.005
    assert decoder.decode(1.5 * signal).outside.mean() > 0.95


@pytest.mark.evidence
def test_scattered_states_show_errors_between_the_states_of_a_grid() -> None:
    def fine(lean: FloatArray, sway: FloatArray) -> FloatArray:
        """Return fractions that differ from `light` only between the states of a grid of 6 × 6."""
        return light(lean, sway) * (1.0 + 0.1 * np.sin(np.pi * (lean + 10.0) / 4.0))[..., None, None]

    scattered = np.random.default_rng(3).uniform([-10.0, -8.0], [10.0, 8.0], (80, 2))
    states = np.random.default_rng(1).uniform([-9.5, -7.5], [9.5, 7.5], (200, 2))
    signal = readings(states, 2, fine, cycles=4).signal[::4]
    of_grid = calibrated_network([readings(grid(6), fractions=fine)])
    assert of_grid.calibration.checks[0].within_95 > 0.88  # the check does not show the errors
    assert of_grid.calibration.decoder.decode(signal).holds(states, 1).mean() < 0.5
    of_both = calibrated_network([readings(np.concatenate([grid(6), scattered]), fractions=fine)])
    assert not any("grid" in line for line in of_both.warnings)
    assert of_both.calibration.decoder.decode(signal).holds(states, 1).mean() > 0.88


@pytest.mark.evidence
def test_bands_have_their_coverage_over_many_seeds() -> None:
    within = []
    for seed in range(200):
        rng = np.random.default_rng([9, seed])
        scattered = rng.uniform([-10.0, -8.0], [10.0, 8.0], (30, 2))
        decoder = calibrated_network([readings(np.concatenate([grid(4), scattered]), seed)]).calibration.decoder
        states = rng.uniform([-10.0, -8.0], [10.0, 8.0], (20, 2))
        decoded = decoder.decode(readings(states, 1000 + seed, cycles=4).signal[::4])
        within.append([decoded.holds(states, level).mean(axis=0) for level in (0, 1)])
    fractions = np.mean(within, axis=0)
    print(fractions)
    assert ((fractions[0] > 0.62) & (fractions[0] < 0.8)).all(), fractions
    assert ((fractions[1] > 0.9) & (fractions[1] < 0.99)).all(), fractions


def test_refuses_too_few_states_motions_and_emitters() -> None:
    complete = readings(grid(3))
    with pytest.raises(DataError, match=r"2 states|does not move"):
        calibrated_network([readings(grid(3)[:2])])
    stationary = readings(np.stack([np.linspace(-5.0, 5.0, 9), np.zeros(9)], axis=1))
    with pytest.raises(DataError, match="sway does not move"):
        calibrated_network([stationary])
    with pytest.raises(DataError, match="emitter b"):
        replace(complete, emitters=("a", "c")).ordered(MOTIONS, EMITTERS, RECEIVERS)
    with pytest.raises(DataError, match="angles"):
        calibrated_network([replace(complete, motions=(), angle_deg=np.zeros((len(complete.time_s), 0)))])


def test_held_out_states_are_within_their_bands(calibrations: NetworkCalibrations) -> None:
    assert calibrations.calibration.checks[0].within_95 > 0.9


def test_reads_the_table_of_another_recorder(tmp_path: Path) -> None:
    expected = readings(grid(3), cycles=12)
    names = [f"{emitter}.{receiver}" for emitter in EMITTERS for receiver in RECEIVERS]
    signal_mV = 1e3 * expected.signal.reshape(len(expected.time_s), -1)
    table = np.column_stack([expected.time_s, expected.angle_deg, signal_mV])
    path = tmp_path / "mine.csv"
    head = ",".join(["time_s", "lean_deg", "sway_deg", *(f"{name} (mV)" for name in names)])
    np.savetxt(path, table, delimiter=",", header=head, comments="")
    network = network_readings(path)
    assert (network.motions, network.emitters, network.receivers) == (MOTIONS, EMITTERS, RECEIVERS)
    assert network.signal == pytest.approx(expected.signal, abs=1e-12)
    np.savetxt(path, table[:, :-1], delimiter=",", header=head.rpartition(",")[0], comments="")
    with pytest.raises(DataError, match=r"b\.right"):
        network_readings(path)


END = Journal.end


def end_and_copy(journal: Journal, **kwargs: Any) -> None:
    """End a journal and copy it, because it is deleted after the recording is written."""
    END(journal, **kwargs)
    journal.path.with_name(f"kept-{journal.path.name}").write_bytes(journal.path.read_bytes())


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of two recordings of a simulated rig: a grid of 5 × 5 states, and three other states."""
    folder = tmp_path_factory.mktemp("bench")
    plan = PLAN.replace("lean = [-10.0, 0.0, 10.0]", f"lean = {LEAN[::5].tolist()}")
    plan = plan.replace("sway = [-8.0, 0.0, 8.0]", f"sway = {SWAY[::4].tolist()}")
    steps = (
        f"[[step]]\nto_deg = {{lean = {lean}, sway = {sway}}}\nvelocity_deg_per_s = 20.0\nhold_s = 0.2\n"
        for lean, sway in ((-7.3, 2.2), (4.1, -5.5), (8.8, 6.1))
    )
    write(folder, plan=plan, visits='schema = 1\nname = "visits"\nrest_s = 0.0\n' + "".join(steps))
    with pytest.MonkeyPatch.context() as patch:
        without_tracing(patch)
        patch.setattr(Journal, "end", end_and_copy)
        for name in ("plan", "visits"):
            record(folder / f"{name}.toml", folder / "rig.toml", folder, RecordOptions())
    return folder


@pytest.fixture(scope="module")
def bench_calibration(bench: Path) -> Path:
    """Return a calibration from the grid of states."""
    (file,) = calibrate(bench / "plan.nc", out=bench / "grid.calibration.json").files.values()
    return file


def test_decodes_motions_of_a_simulated_rig(bench: Path) -> None:
    outcome = calibrate(bench / "plan.nc")
    (file,) = outcome.files.values()
    assert file.name == "plan.fork.calibration.json"
    decoded = decode(file, str(bench / "visits.nc"), out=bench / "angles.csv").result
    assert isinstance(decoded, NetworkDecoding)
    assert decoded.simulated
    assert [check.motion for check in decoded.against] == list(MOTIONS)
    assert all(check.within_95 > 0.9 and check.rms_deg < 0.15 for check in decoded.against)
    rows = (bench / "angles.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "# simulated: yes"
    assert rows[1].startswith("time_s,lean_deg,lean_low68_deg")
    assert len(rows) == decoded.readings + decoded.missing + 2


def test_decodes_lines_with_the_columns_in_another_order(bench: Path, bench_calibration: Path) -> None:
    network = network_readings(bench / "visits.nc")
    names = [f"{emitter}.{receiver}" for emitter in EMITTERS[::-1] for receiver in RECEIVERS]
    signal = network.ordered((), EMITTERS[::-1], RECEIVERS).signal.reshape(len(network.time_s), -1)
    lines = [",".join(["t_ms", *names])]
    lines += [f"{1e3 * t},{','.join(map(str, row))}" for t, row in zip(network.time_s, signal.tolist(), strict=True)]
    lines[3] = lines[3].rpartition(",")[0] + ","
    live = decode(bench_calibration, "-", text=lines[:40]).result
    assert (live.readings, live.missing) == (38, 1)
    with pytest.raises(DataError, match=r"a\.right"):
        decode(bench_calibration, "-", text=[line.rpartition(",")[0] for line in lines])


def test_results_of_a_network_match_their_schemas(bench: Path, capfd: pytest.CaptureFixture[str]) -> None:
    recording, calibration = str(bench / "plan.nc"), str(bench / "printed.json")
    assert answered(capfd, "bench", "analyse", recording)["emitters"] == list(EMITTERS)
    assert answered(capfd, "bench", "calibrate", recording, "--out", calibration)["states"] == 25
    assert answered(capfd, "bench", "decode", calibration, str(bench / "visits.nc"))["readings"] > 0


def test_follows_a_run_of_a_network(bench: Path, bench_calibration: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    closed, followed, streams = io.StringIO(), io.StringIO(), recorded_streams(monkeypatch)
    of_recording = decode(bench_calibration, str(bench / "visits.nc"), rows=closed).result
    data, growing = (bench / "kept-visits.journal").read_bytes(), bench / "growing.journal"
    cuts = np.linspace(len(data) // 3, len(data), 5).astype(int).tolist()
    growing.write_bytes(data[: cuts[0]])

    def grow(_: float) -> None:
        with growing.open("ab") as journal:
            journal.write(data[cuts.pop(0) : cuts[0]])

    monkeypatch.setattr(time, "sleep", grow)
    of_journal = decode(
        bench_calibration, str(growing), DecodeOptions(follow=True), rows=followed, send="lsl:fork"
    ).result
    assert len(cuts) == 1
    assert of_journal.readings == of_recording.readings > 100
    header, *rows = (row.split(",") for row in followed.getvalue().splitlines())
    recorded = [row.split(",") for row in closed.getvalue().splitlines()[1:]]
    of_run, expected = (
        np.array([[float(cell) for cell in row[1:11]] for row in source if "missing" not in row])
        for source in (rows, recorded)
    )
    assert of_run == pytest.approx(expected, abs=1e-4)
    sent = ["time_s", *(f"{name}_{end}" for name in MOTIONS for end in ("deg", "low95_deg", "high95_deg"))]
    assert [value for name, value in streams[1:8] if name == "label"] == sent
    samples = np.array([values for values, stamp in streams[8:]])
    assert samples.shape == (len(rows), 7)
    assert samples[-1] == pytest.approx([float(rows[-1][header.index(name)]) for name in sent])


def test_counts_clipped_readings_of_a_journal_as_in_its_recording(bench_calibration: Path, tmp_path: Path) -> None:
    write(tmp_path, rig=RIG.replace("rate_hz = 100.0", "rate_hz = 100.0\nrange_v = 4.99"))
    with pytest.MonkeyPatch.context() as patch:
        without_tracing(patch)
        patch.setattr(Journal, "end", end_and_copy)
        recorded = record(tmp_path / "plan.toml", tmp_path / "rig.toml", tmp_path, RecordOptions())
    assert any("fork.a: readings are clipped at a limit of the range: end " in line for line in recorded.warnings)
    of_recording, of_journal = (
        decode(bench_calibration, str(tmp_path / name)).result for name in ("plan.nc", "kept-plan.journal")
    )
    assert of_recording.clipped == of_journal.clipped > 10
    with pytest.raises(DataError, match="solen bench recover"):
        calibrate(tmp_path / "kept-plan.journal")


def test_refuses_options_for_sensors_with_one_motion(bench: Path, bench_calibration: Path) -> None:
    for call in (
        lambda: calibrate(bench / "plan.nc", options=CalibrationOptions(pool=True)),
        lambda: calibrate(bench / "plan.nc", options=CalibrationOptions(sensor="hand")),
        lambda: decode(bench_calibration, str(bench / "visits.nc"), DecodeOptions(gain_percent=5.0)),
    ):
        with pytest.raises(SpecError, match=r"pool|hand|gain"):
            call()
