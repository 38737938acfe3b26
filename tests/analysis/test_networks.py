"""Networks: their readings by state, calibration and decoding of several motions, and what is refused."""

import io
import json
import time
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

NOISE_V, HELD = 3e-4, 20
MOTIONS = ("lean", "sway")


def readings(states: FloatArray, seed: int = 0, shares: object = light, held: int = HELD) -> NetworkReadings:
    """Turns of a network that rests in states, with noise that receivers share in part, and moves between them."""
    rng = np.random.default_rng(seed)
    angle = np.repeat(states, held, axis=0)
    signal = -shares(angle[:, 0], angle[:, 1])  # type: ignore[operator]
    common = 0.5 * NOISE_V * rng.standard_normal((len(angle), 1, 1))
    signal = signal + common + NOISE_V * rng.standard_normal(signal.shape)
    way = np.arange(len(angle)) % held >= held - 3  # the last turns of each are those of the way to the next
    angle = angle + np.where(way, rng.uniform(0.3, 0.5, len(angle)), 0.0)[:, None]
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
        provenance=Provenance("made.nc", simulated=True),
    )


def grid(steps: int) -> FloatArray:
    mesh = np.meshgrid(np.linspace(-10.0, 10.0, steps), np.linspace(-8.0, 8.0, steps), indexing="ij")
    return np.stack(mesh, axis=-1).reshape(-1, 2)


@pytest.fixture(scope="module")
def made() -> NetworkCalibrations:
    return calibrated_network([readings(grid(6))])


def test_a_state_is_the_mean_of_its_stop(made: NetworkCalibrations) -> None:
    found = analysed_network(readings(grid(4), held=40))
    assert len(found.angle_deg) == 16
    assert found.angle_deg == pytest.approx(grid(4), abs=1e-9)
    true = -light(*grid(4).T)
    z = (found.signal_V - true) / found.u_signal_V
    assert 0.8 < z.std() < 1.2
    assert found.noise_V == pytest.approx(NOISE_V * np.sqrt(1.25), rel=0.1)
    assert made.states == 36


def test_motions_that_were_never_visited_are_decoded_within_their_bands(made: NetworkCalibrations) -> None:
    states = np.random.default_rng(1).uniform([-10.0, -8.0], [10.0, 8.0], (300, 2))
    signal = readings(states, 2, held=4).signal[::4]
    decoded = made.calibration.decoder.decode(signal)
    assert not decoded.missing.any()
    assert decoded.outside.mean() < 0.01
    for level, (least, most) in enumerate(((0.62, 0.85), (0.92, 1.0))):
        within = decoded.holds(states, level).mean(axis=0)
        assert (within >= least).all(), within
        assert (within <= most).all(), within
    assert (np.abs(decoded.angle_deg - states) / decoded.sd_deg).max() < 6.0
    assert np.median(decoded.high_deg[..., 1] - decoded.low_deg[..., 1]) < 0.05 * 16.0


def test_a_saved_calibration_decodes_the_same(made: NetworkCalibrations, tmp_path: Path) -> None:
    file = tmp_path / "fork.calibration.json"
    file.write_text(text_of(made.calibration), encoding="utf-8")
    signal = readings(grid(3) * 0.7, 4).signal
    same = load_network(file).decoder.decode(signal).angle_deg
    assert same == pytest.approx(made.calibration.decoder.decode(signal).angle_deg, abs=1e-9)
    data = json.loads(file.read_text(encoding="utf-8"))
    file.write_text(json.dumps(data | {"noise_V2": data["noise_V2"][:-1]}), encoding="utf-8")
    with pytest.raises(DataError, match="noise_V2"):
        load_network(file)


def test_a_decoder_of_one_motion_names_what_decodes_a_network(made: NetworkCalibrations, tmp_path: Path) -> None:
    file = tmp_path / "fork.calibration.json"
    file.write_text(text_of(made.calibration), encoding="utf-8")
    for call in (lambda: load(file), lambda: Decoder(file), lambda: Decoder(made.calibration)):  # type: ignore[arg-type]
        with pytest.raises(DataError, match=r"solen\.analysis\.network\.load_network"):
            call()


def test_readings_of_no_state_and_missing_ones_are_marked(made: NetworkCalibrations) -> None:
    signal = readings(grid(2) * 0.5, 5).signal[:3].copy()
    signal[1] *= 1.1  # an emitter that became brighter
    signal[2, 1, 0] = np.nan
    decoded = made.calibration.decoder.decode(signal)
    assert decoded.outside.tolist() == [False, True, False]
    assert decoded.missing.tolist() == [False, False, True]
    assert np.isnan(decoded.angle_deg[2]).all()


def test_two_states_that_look_alike_are_both_given() -> None:
    def twice(lean: FloatArray, sway: FloatArray) -> FloatArray:
        return light(np.abs(lean), sway)

    made = calibrated_network([readings(grid(9), shares=twice)])
    decoded = made.calibration.decoder.decode(readings(np.array([[6.0, 2.0]]), 3, twice).signal[:15])
    assert decoded.ambiguous.mean() > 0.8
    both = np.sort(np.stack([decoded.angle_deg[:, 0], decoded.other_deg[:, 0]]), axis=0)[:, decoded.ambiguous]
    assert pytest.approx(np.tile([-6.0, 6.0], (both.shape[1], 1)), abs=0.5) == both.T


@pytest.mark.parametrize(
    ("mixed", "named"),
    [
        (lambda lean, sway: light(lean + 1.25 * sway, 0.0 * sway), ("lean", "sway", "same way")),
        (lambda lean, sway: light(lean, 0.0 * sway), ("sway", "cannot be measured")),
    ],
)
def test_motions_that_cannot_be_separated_are_refused_by_their_names(mixed: object, named: tuple[str, ...]) -> None:
    with pytest.raises(DataError) as refused:
        calibrated_network([readings(grid(6), shares=mixed)])
    assert all(one in str(refused.value) for one in named), refused.value
    assert "\n" not in str(refused.value)


def test_a_grid_alone_is_warned_of_as_it_may_miss_what_lies_between(made: NetworkCalibrations) -> None:
    assert any("grid" in line for line in made.warnings)


def test_true_readings_of_a_sharp_response_are_rarely_outside() -> None:
    """Between the states the map is off by more than it knows: 3.5 % were beyond one in a thousand of its own law."""

    def sharp(lean: FloatArray, sway: FloatArray) -> FloatArray:
        return light(lean, sway) * (1.0 + 0.1 * np.tanh(2.0 * (lean - sway)))[..., None, None]

    rng = np.random.default_rng(3)
    ends = [-10.0, -8.0], [10.0, 8.0]
    made = calibrated_network([readings(np.concatenate([grid(5), rng.uniform(*ends, (40, 2))]), shares=sharp)])
    decoder = made.calibration.decoder
    signal = readings(rng.uniform(*ends, (400, 2)), 2, sharp, held=4).signal[::4]
    assert decoder.decode(signal).outside.mean() < 0.005
    assert decoder.decode(1.5 * signal).outside.mean() > 0.95


@pytest.mark.evidence
def test_scattered_states_show_what_a_grid_alone_misses() -> None:
    def fine(lean: FloatArray, sway: FloatArray) -> FloatArray:
        """As before at every place of a grid of 6, and another 1 deg beside it."""
        return light(lean, sway) * (1.0 + 0.1 * np.sin(np.pi * (lean + 10.0) / 4.0))[..., None, None]

    scattered = np.random.default_rng(3).uniform([-10.0, -8.0], [10.0, 8.0], (80, 2))
    states = np.random.default_rng(1).uniform([-9.5, -7.5], [9.5, 7.5], (200, 2))
    signal = readings(states, 2, fine, held=4).signal[::4]
    blind = calibrated_network([readings(grid(6), shares=fine)])
    assert blind.calibration.checks[0].within_95 > 0.88  # the check sees nothing of it
    assert blind.calibration.decoder.decode(signal).holds(states, 1).mean() < 0.5
    seen = calibrated_network([readings(np.concatenate([grid(6), scattered]), shares=fine)])
    assert not any("grid" in line for line in seen.warnings)
    assert seen.calibration.decoder.decode(signal).holds(states, 1).mean() > 0.88


@pytest.mark.evidence
def test_bands_hold_their_share_over_many_seeds() -> None:
    within = []
    for seed in range(200):
        rng = np.random.default_rng([9, seed])
        scattered = rng.uniform([-10.0, -8.0], [10.0, 8.0], (30, 2))
        made = calibrated_network([readings(np.concatenate([grid(4), scattered]), seed)])
        states = rng.uniform([-10.0, -8.0], [10.0, 8.0], (20, 2))
        signal = readings(states, 1000 + seed, held=4).signal[::4]
        decoded = made.calibration.decoder.decode(signal)
        within.append([decoded.holds(states, level).mean(axis=0) for level in (0, 1)])
    found = np.mean(within, axis=0)
    print(found)
    assert ((found[0] > 0.62) & (found[0] < 0.8)).all(), found
    assert ((found[1] > 0.9) & (found[1] < 0.99)).all(), found


def test_what_a_calibration_lacks_is_named(made: NetworkCalibrations) -> None:
    one = readings(grid(3))
    with pytest.raises(DataError, match=r"2 states|does not move"):
        calibrated_network([readings(grid(3)[:2])])
    still = readings(np.stack([np.linspace(-5.0, 5.0, 9), np.zeros(9)], axis=1))
    with pytest.raises(DataError, match="sway does not move"):
        calibrated_network([still])
    with pytest.raises(DataError, match="emitter b"):
        replace(one, emitters=("a", "c")).ordered(MOTIONS, EMITTERS, RECEIVERS)
    with pytest.raises(DataError, match="angles"):
        calibrated_network([replace(one, motions=(), angle_deg=np.zeros((len(one.time_s), 0)))])
    assert made.calibration.checks[0].within_95 > 0.9


def test_a_table_of_another_recorder_holds_the_same(tmp_path: Path) -> None:
    one = readings(grid(3), held=12)
    names = [f"{lit}.{read}" for lit in EMITTERS for read in RECEIVERS]
    table = np.column_stack([one.time_s, one.angle_deg, 1e3 * one.signal.reshape(len(one.time_s), -1)])
    path = tmp_path / "mine.csv"
    head = ",".join(["time_s", "lean_deg", "sway_deg", *(f"{name} (mV)" for name in names)])
    np.savetxt(path, table, delimiter=",", header=head, comments="")
    found = network_readings(path)
    assert (found.motions, found.emitters, found.receivers) == (MOTIONS, EMITTERS, RECEIVERS)
    assert found.signal == pytest.approx(one.signal, abs=1e-12)
    np.savetxt(path, table[:, :-1], delimiter=",", header=head.rpartition(",")[0], comments="")
    with pytest.raises(DataError, match=r"b\.right"):
        network_readings(path)


END = Journal.end


def kept_journal(journal: Journal, **more: Any) -> None:
    """End a journal, and keep it beside the recording that is made of it."""
    END(journal, **more)
    journal.path.with_name(f"kept-{journal.path.name}").write_bytes(journal.path.read_bytes())


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings of a simulated rig: a grid of 5 × 5 states, and some states beside them."""
    folder = tmp_path_factory.mktemp("bench")
    places = {"[-10.0, 0.0, 10.0]": LEAN[::5].tolist(), "[-8.0, 0.0, 8.0]": SWAY[::4].tolist()}
    plan = PLAN.replace("lean = [-10.0, 0.0, 10.0]", f"lean = {places['[-10.0, 0.0, 10.0]']}")
    plan = plan.replace("sway = [-8.0, 0.0, 8.0]", f"sway = {places['[-8.0, 0.0, 8.0]']}")
    beside = ((-7.3, 2.2), (4.1, -5.5), (8.8, 6.1))
    steps = (
        f"[[step]]\nto_deg = {{lean = {lean}, sway = {sway}}}\nvelocity_deg_per_s = 20.0\nhold_s = 0.2\n"
        for lean, sway in beside
    )
    write(folder, plan=plan, visits='schema = 1\nname = "visits"\nrest_s = 0.0\n' + "".join(steps))
    with pytest.MonkeyPatch.context() as patch:
        without_tracing(patch)
        patch.setattr(Journal, "end", kept_journal)
        for name in ("plan", "visits"):
            record(folder / f"{name}.toml", folder / "rig.toml", folder, RecordOptions())
    return folder


def test_from_a_simulated_rig_to_motions(bench: Path) -> None:
    outcome = calibrate(bench / "plan.nc")
    (file,) = outcome.files.values()
    assert file.name == "plan.fork.calibration.json"
    decoded = decode(file, str(bench / "visits.nc"), out=bench / "angles.csv").result
    assert decoded.simulated
    assert [one.motion for one in decoded.against] == list(MOTIONS)  # type: ignore[union-attr]
    assert all(one.within_95 > 0.9 and one.rms_deg < 0.15 for one in decoded.against)  # type: ignore[union-attr]
    rows = (bench / "angles.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0] == "# simulated: yes"
    assert rows[1].startswith("time_s,lean_deg,lean_low68_deg")
    assert len(rows) == decoded.readings + decoded.missing + 2
    # the same from lines, in another order of the columns, and from a live stream that lacks one
    turns = network_readings(bench / "visits.nc")
    names = [f"{lit}.{read}" for lit in EMITTERS[::-1] for read in RECEIVERS]
    order = turns.ordered((), EMITTERS[::-1], RECEIVERS).signal.reshape(len(turns.time_s), -1)
    lines = [",".join(["t_ms", *names])]
    lines += [f"{1e3 * t},{','.join(map(str, row))}" for t, row in zip(turns.time_s, order.tolist(), strict=True)]
    lines[3] = lines[3].rpartition(",")[0] + ","
    live = decode(file, "-", text=lines[:40]).result
    assert (live.readings, live.missing) == (38, 1)
    with pytest.raises(DataError, match=r"a\.right"):
        decode(file, "-", text=[one.rpartition(",")[0] for one in lines])


def test_what_commands_print_of_a_network_fits_their_schema(bench: Path, capfd: pytest.CaptureFixture[str]) -> None:
    recording, known = str(bench / "plan.nc"), str(bench / "printed.json")
    assert answered(capfd, "bench", "analyse", recording)["emitters"] == list(EMITTERS)
    assert answered(capfd, "bench", "calibrate", recording, "--out", known)["states"] == 25
    assert answered(capfd, "bench", "decode", known, str(bench / "visits.nc"))["readings"] > 0


def test_a_run_of_a_network_is_followed_while_it_grows(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (file,) = calibrate(bench / "plan.nc", out=bench / "known.calibration.json").files.values()
    closed, followed, streams = io.StringIO(), io.StringIO(), recorded_streams(monkeypatch)
    of_recording = decode(file, str(bench / "visits.nc"), rows=closed).result
    data, growing = (bench / "kept-visits.journal").read_bytes(), bench / "growing.journal"
    cuts = np.linspace(len(data) // 3, len(data), 5).astype(int).tolist()
    growing.write_bytes(data[: cuts[0]])

    def grow(_: float) -> None:
        with growing.open("ab") as journal:
            journal.write(data[cuts.pop(0) : cuts[0]])

    monkeypatch.setattr(time, "sleep", grow)
    of_journal = decode(file, str(growing), DecodeOptions(follow=True), rows=followed, send="lsl:fork").result
    assert len(cuts) == 1
    assert of_journal.readings == of_recording.readings > 100
    header, *rows = (row.split(",") for row in followed.getvalue().splitlines())
    same = [row.split(",") for row in closed.getvalue().splitlines()[1:]]
    kept = [row[1:] for row in rows if "missing" not in row], [row[1:] for row in same if "missing" not in row]
    angles = [np.array([[float(cell) for cell in row[:10]] for row in each]) for each in kept]
    assert angles[0] == pytest.approx(angles[1], abs=1e-4)
    sent = ["time_s", *(f"{name}_{end}" for name in MOTIONS for end in ("deg", "low95_deg", "high95_deg"))]
    assert [value for name, value in streams[1:8] if name == "label"] == sent
    samples = np.array([values for values, stamp in streams[8:]])
    assert samples.shape == (len(rows), 7)
    assert samples[-1] == pytest.approx([float(rows[-1][header.index(name)]) for name in sent])


def test_clipped_readings_of_a_journal_are_counted_as_those_of_its_recording(bench: Path, tmp_path: Path) -> None:
    (file,) = calibrate(bench / "plan.nc", out=tmp_path / "known.calibration.json").files.values()
    write(tmp_path, rig=RIG.replace("rate_hz = 100.0", "rate_hz = 100.0\nrange_v = 4.99"))
    with pytest.MonkeyPatch.context() as patch:
        without_tracing(patch)
        patch.setattr(Journal, "end", kept_journal)
        recorded = record(tmp_path / "plan.toml", tmp_path / "rig.toml", tmp_path, RecordOptions())
    assert any("fork.a: readings are clipped at a limit of the range: end " in line for line in recorded.warnings)
    found = [decode(file, str(tmp_path / name)).result for name in ("plan.nc", "kept-plan.journal")]
    assert found[0].clipped == found[1].clipped > 10
    with pytest.raises(DataError, match="solen bench recover"):
        calibrate(tmp_path / "kept-plan.journal")


def test_options_of_sensors_with_one_motion_are_refused(bench: Path) -> None:
    (file,) = calibrate(bench / "plan.nc", out=bench / "other.calibration.json").files.values()
    for call in (
        lambda: calibrate(bench / "plan.nc", options=CalibrationOptions(pool=True)),
        lambda: calibrate(bench / "plan.nc", options=CalibrationOptions(sensor="hand")),
        lambda: decode(file, str(bench / "visits.nc"), DecodeOptions(gain_percent=5.0)),
    ):
        with pytest.raises(SpecError, match=r"pool|hand|gain"):
            call()
