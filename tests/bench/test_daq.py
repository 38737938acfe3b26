"""A DAQ device instead of a board: its samples, the states of the emitters, and the recording."""

import datetime as dt
import json
import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.arrays import FloatArray, IntArray
from solen.bench import record as recording
from solen.bench import waveform
from solen.bench.catalogue import list_recordings
from solen.bench.clock import SimulatedClock
from solen.bench.daq import DaqLosses, Samples, Setup, volts_of
from solen.bench.frames import Layout
from solen.bench.journal import read_journal
from solen.bench.live import LiveReadings
from solen.bench.netcdf import RecordedRun, write_recording
from solen.bench.phases import clock_of, states
from solen.bench.protocol import load_protocol
from solen.bench.record import RecordOptions, record, recover
from solen.bench.rig import AmbientLight, Rig, load_rig
from solen.bench.roles import Daq, EmitterBoard
from solen.bench.run import Instruments, Tick, begin
from solen.bench.run import run as run_protocol
from solen.bench.simulated import sensors as simulated
from solen.bench.simulated.board import SimulatedBoard
from solen.bench.simulated.daq import SimulatedDaq, settling
from solen.bench.simulated.sensors import SimulatedSensor, adc_of
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError, DataError
from solen.readout import lagged, volts
from solen.spec import load, template, with_values
from solen.spec.toml import dumps
from tests.bench.fork_support import Killed, kill_runs, start_process
from tests.bench.rig_support import DAQS, PROTOCOL, RIG, daq_rig

DARK, BRIGHT = AmbientLight(), AmbientLight(mean_mw_cm2=0.05)


@dataclass(frozen=True)
class TracedRig:
    """A rig with a board, and its traced sensors."""

    folder: Path
    rig: Rig
    sensors: tuple[SimulatedSensor, ...]

    def with_daq(self, settings: str) -> tuple[Rig, tuple[SimulatedSensor, ...]]:
        """Return the rig with a DAQ device instead of the board, and its sensors."""
        path = self.folder / "other.toml"
        path.write_text(daq_rig(settings), encoding="utf-8")
        rig = load_rig(path)
        return rig, tuple(replace(sensor, circuit=replace(sensor.circuit, adc=adc_of(rig))) for sensor in self.sensors)


@pytest.fixture(scope="module")
def traced(tmp_path_factory: pytest.TempPathFactory) -> TracedRig:
    """Rig traced coarsely; its emitter has a width, because the response of a point source ends within a degree."""
    folder = tmp_path_factory.mktemp("bench")
    for name, text in (("sensor", template("paper-860")), ("rig", RIG), ("protocol", PROTOCOL)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    wide = with_values(load(folder / "sensor.toml"), {"emitter.width_mm": 0.2})
    (folder / "sensor.toml").write_text(dumps(wide), encoding="utf-8")
    rig = load_rig(folder / "rig.toml")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("ANGLES", 13), ("TOLERANCE", 1e-3), ("MAX_INTERPOLATION_ERROR", 5e-3)):
            patch.setattr(simulated, name, value)
        return TracedRig(folder, rig, simulated.simulated_sensors(rig, folder, 3.0, np.random.default_rng(5)))


Angles = Callable[[FloatArray], FloatArray]
OpenSampler = Callable[[SimulatedClock, Angles], EmitterBoard | Daq]


def record_with(traced: TracedRig, rig: Rig, open_sampler: OpenSampler, name: str) -> tuple[RecordedRun, Path]:
    """Run the protocol without the command, and return the closed recording."""
    clock = SimulatedClock()
    stage = SimulatedStage(clock)
    instruments = Instruments(stage, open_sampler(clock, stage.axis.positions), clock, 0.5)
    sensors = [sensor.model_dump(mode="json") for sensor in rig.sensor]
    protocol = load_protocol(traced.folder / "protocol.toml")
    header: Mapping[str, Any] = {
        "solen": "0", "simulated": True, "begun_utc": "2026-01-01T00:00:00+00:00", "protocol_name": "short",
        "rig_name": "small rig", "sensors": sensors, "zero": 0.0, "lever_mm": None, "top_count": 65_535,
        "protocol": protocol.model_dump(mode="json"),
    }  # fmt: skip
    path = traced.folder / f"{name}.journal"
    with begin(path, instruments, header) as journal:
        run_protocol(protocol, instruments, journal)
    target = traced.folder / f"{name}.nc"
    return write_recording(read_journal(path), target), target


def daq_of(
    rig: Rig, sensors: tuple[SimulatedSensor, ...], room: AmbientLight = DARK, kind: type[SimulatedDaq] = SimulatedDaq
) -> OpenSampler:
    setup = rig.setup
    assert setup is not None
    return lambda clock, angles: kind(clock, sensors, angles, room, np.random.default_rng(7), setup=setup)


def group(path: Path, name: str) -> dict[str, FloatArray]:
    with h5netcdf.File(path, "r") as file:
        return {key: variable[...] for key, variable in file.groups[name].variables.items()}


def signal_V(sensor: SimulatedSensor, angle_deg: FloatArray) -> FloatArray:
    """Return the voltages of the receivers with the emitter on minus those with it off, (N, 2), without noise."""
    return volts(sensor.at(angle_deg), sensor.circuit) - volts(np.zeros((1, 2)), sensor.circuit)


# the samples


def test_settling_is_first_order_lag() -> None:
    # 50 periods in steps of 1 µs; the phases last 3 time constants and 1 time constant
    tau_s, period_s, on_s = 100e-6, 400e-6, 300e-6
    in_period_s = 1e-6 * (np.arange(50 * 400) % 400)
    level = np.where(in_period_s < on_s - 1e-9, 1.0, 4.0)

    class Slow:
        time_constant_us = np.array([1e6 * tau_s])

    stepwise = lagged(level[:, None], Slow(), 1e6)[-400:, 0]  # type: ignore[arg-type]  # only the time constant is used
    lit = in_period_s[-400:] < on_s - 1e-9
    after_s = np.where(lit, in_period_s[-400:], in_period_s[-400:] - on_s)[:, None]
    before_s = np.where(lit, period_s - on_s, on_s)[:, None]
    levels = np.where(lit, 1.0, 4.0)[:, None], np.where(lit, 4.0, 1.0)[:, None]
    # a step's result is the level at its end
    settled = settling(*levels, after_s + 1e-6, before_s, period_s, np.array([tau_s]))[:, 0]
    assert settled == pytest.approx(stepwise, abs=1e-9)


def test_samples_match_circuit_and_its_time_constant(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq(DAQS["counter"])
    clock, sensor = SimulatedClock(), sensors[0]
    daq = daq_of(rig, sensors, BRIGHT)(clock, lambda time_s: np.full(len(time_s), 1.0))
    assert isinstance(daq, SimulatedDaq)
    daq.start()
    clock.sleep(2.0)
    samples = daq.read()
    assert samples.counts.shape == (20_000, 4)
    mean_V = volts_of(samples.counts, daq.coefficients).reshape(400, 50, 4)[..., :2].mean(axis=0)
    # emitter 1 is on in samples 0 to 12, sample 13 is close to the edge, and the others are off
    for index, fractions in ((12, sensor.at(np.array([1.0]))), (49, np.zeros((1, 2)))):
        expected = volts(fractions, sensor.circuit, 0.05)[0]
        # the mean of 400 samples with a noise of about 230 µV and a step of 305 µV
        assert mean_V[index] == pytest.approx(expected, abs=5 * 250e-6 / 20)
    on, off = mean_V[12], mean_V[49]
    after_s = 100e-6 + daq.convert_s * np.array([0, 1])  # of sample 1, while the level is still settling
    remainder = (off - on) * np.exp(-after_s / (1e-6 * sensor.circuit.time_constant_us))
    assert mean_V[1] - on == pytest.approx(remainder, abs=8 * 250e-6 / 20)
    assert remainder.max() > 2e-4


def test_samples_do_not_depend_on_number_of_readings(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq(DAQS["sync"])
    noiseless = tuple(
        replace(sensor, circuit=replace(sensor.circuit, adc=replace(sensor.circuit.adc, noise_V=0.0)))
        for sensor in sensors
    )
    counts = []
    for readings in (1, 7):
        clock = SimulatedClock(3.0)
        daq = daq_of(rig, noiseless)(clock, lambda time_s: np.sin(time_s))
        daq.start()
        parts = []
        for _ in range(readings):
            clock.sleep(0.7 / readings)
            parts.append(daq.read())
        assert isinstance(parts[0], Samples)
        counts.append(np.concatenate([part.counts for part in parts]))
    # shot and thermal noise are drawn in a different order
    assert counts[0].shape == counts[1].shape == (7000, 5)
    assert np.abs(counts[0].astype(int) - counts[1]).max() <= 6


# the states of the emitters


def setup_with(**settings: Any) -> Setup:
    defaults = {
        "channels": ("ai0", "ai1", "ai8"), "synced": True, "rate_hz": 20_000.0, "emitters": 4, "switch_hz": 200.0,
    }  # fmt: skip
    return Setup(**defaults | settings)  # type: ignore[arg-type]  # the values have several types


def emitter_at(phase: FloatArray, emitters: int) -> IntArray:
    """Return the emitter that is on at a phase in periods, or 0."""
    slots = phase % 1.0 * emitters
    return np.where(slots % 1.0 < 0.5, slots.astype(int) + 1, 0)


@pytest.mark.parametrize(("emitters", "rate_hz"), [(1, 10_000.0), (2, 10_000.0), (4, 20_000.0), (4, 13_333.0)])
@pytest.mark.parametrize("hz", [200.0, 199.6, 203.0])
def test_sync_determines_states(emitters: int, rate_hz: float, hz: float) -> None:
    setup = setup_with(emitters=emitters, rate_hz=rate_hz)
    time_s, delay_s = np.arange(30_000) / rate_hz, -20e-6
    for initial_phase in (0.0, 0.31, 0.77):
        phase = time_s * hz + initial_phase
        sync = np.where(phase % 1.0 < 0.5 / emitters, 3.3, 0.02)
        clock = clock_of(time_s, sync[:, None], setup, 200.0)
        assert clock.rate_hz == pytest.approx(hz * emitters, rel=1e-5)
        state = states(clock, delay_s, 200e-6, emitters)
        used = state >= 0
        assert np.array_equal(state[used], emitter_at(phase + delay_s * hz, emitters)[used])
        # only the settling time and two samples at each edge are omitted
        assert np.mean(~used) <= 2 * emitters * hz * (200e-6 + 2.01 / rate_hz)


def test_sync_may_jitter_and_miss_pulse() -> None:
    setup, rng = setup_with(rate_hz=20_000.0), np.random.default_rng(4)
    starts_s = np.cumsum(0.005 * (1.0 + 0.03 * rng.uniform(-1.0, 1.0, 400)))
    time_s = np.arange(0.02, 1.9, 1.0 / 20_000.0)
    period = np.searchsorted(starts_s, time_s, side="right") - 1
    phase = (time_s - starts_s[period]) / (starts_s[period + 1] - starts_s[period])
    sync = np.where((phase < 0.125) & (period != 200), 3.3, 0.0)
    clock = clock_of(time_s, sync[:, None], setup, 200.0)
    state, expected = states(clock, 0.0, 200e-6, 4), emitter_at(phase, 4)
    # only near the missing pulse may the phase be wrong, by half of 3 % of a period
    used = (state >= 0) & (np.abs(period - 200) > 1)
    assert np.mean(state[used] == expected[used]) > 0.999
    used &= phase > 0.01
    assert np.array_equal(state[used] == 1, expected[used] == 1)


@pytest.mark.parametrize(
    ("sync", "message"),
    [
        (np.full(2000, 1.0), "sync; changes by only 0 V; 0.5 V are needed"),
        (np.where(np.arange(2000) < 1000, 3.3, 0.0), "rising edges of the sync = 0; two are needed"),
    ],
)
def test_refuses_sync_without_edges(sync: FloatArray, message: str) -> None:
    with pytest.raises(DataError, match=message):
        clock_of(np.arange(2000) / 20_000.0, sync[:, None], setup_with(), 200.0)


# the recording


@pytest.fixture(scope="module")
def board(traced: TracedRig) -> Path:
    """Recording of the same sensors with a board."""
    layout, rng = Layout(2, 4), np.random.default_rng(6)

    def open_board(clock: SimulatedClock, angles: Angles) -> SimulatedBoard:
        return SimulatedBoard(clock, traced.sensors, angles, BRIGHT, rng, layout=layout, period_s=0.005)

    return record_with(traced, traced.rig, open_board, "board")[1]


@pytest.mark.parametrize("kind", list(DAQS))
def test_daq_and_board_give_same_curves(traced: TracedRig, board: Path, kind: str) -> None:
    rig, sensors = traced.with_daq(DAQS[kind])
    run, path = record_with(traced, rig, daq_of(rig, sensors, BRIGHT), kind)
    assert run.cautions == ()
    by_board, by_daq = (study([recording]).to_dict()["sensors"] for recording in (board, path))
    for name in ("A", "B"):
        for side in ("right", "left"):
            curves = [sensors[name]["receivers"][side] for sensors in (by_board, by_daq)]
            assert curves[0]["angle_deg"] == curves[1]["angle_deg"]
            angle, ways = np.array(curves[0]["angle_deg"]), np.array(curves[0]["ways"], float)
            mean, sd = ([np.array(curve[key], float) for curve in curves] for key in ("mean_V", "sd_V"))
            # 5 standard errors of both, and the sagitta of the curve between readings every 0.075 deg
            sagitta = 0.125 * np.abs(np.gradient(np.gradient(mean[0], angle), angle)) * 0.075**2
            bound = 5 * np.hypot(*sd) / np.sqrt(ways) + sagitta + 2e-4
            all_cycles = ways == ways.max()
            assert all_cycles.mean() > 0.9
            assert (np.abs(mean[0] - mean[1]) <= bound)[all_cycles].all()
            assert np.ptp(mean[0][all_cycles]) > (100 if name == "A" else 1) * bound[all_cycles].max()


def test_readings_match_circuit_at_every_angle(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq("rate_hz = 20000.0\n" + DAQS["sync"])
    run, path = record_with(traced, rig, daq_of(rig, sensors), "angles")
    sensor, columns = sensors[0], group(path, "A")
    assert run.sensors["A"] == len(columns["time_s"])
    expected = signal_V(sensor, columns["angle_deg"])
    at_rest = np.isin(np.round(columns["angle_deg"], 6), (-3.0, 3.0))
    for index, side in enumerate(("right", "left")):
        error = columns[side] - expected[:, index]
        noise_V = error[at_rest].std()
        assert abs(error[at_rest].mean()) < 5 * noise_V / math.sqrt(at_rest.sum()) + 2e-6
        # at a deceleration of 200 deg/s², the angle interpolated between positions every 20 ms is up to
        # 200 · 0.02² / 8 = 0.01 deg wrong
        light = sensor.fractions[:, index]
        per_deg = np.abs(np.diff(light) / np.diff(sensor.angle_deg)).max() / light.max()
        assert np.abs(error[~at_rest]).max() < 1.1 * 0.01 * per_deg * np.ptp(expected[:, index]) + 5 * noise_V
    assert np.diff(columns["time_s"]) == pytest.approx(0.005, abs=1e-4)  # no reading is lost or double


def test_recording_contains_raw_samples(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq(DAQS["counter"])
    _, path = record_with(traced, rig, daq_of(rig, sensors), "raw")
    content = read_journal(path.with_suffix(".journal"))
    assert "samples" not in content.streams
    blocks = np.concatenate(list(content.blocks("samples")))
    with h5netcdf.File(path, "r") as file:
        raw = file.variables["counts"]
        assert raw.dtype == np.int16
        assert np.array_equal(raw[...], blocks["counts"].reshape(-1, 4))
        assert len(raw.chunks) == 2
        assert file.variables["coefficients"].shape == (4, 2)
        number, time_s = file.variables["number"][...], file.variables["time_s"][...]
        assert number.tolist() == list(range(0, 50 * len(number), 50))
        assert np.diff(time_s) == pytest.approx(0.005 / (1 + 20e-6), rel=1e-6 * 50)
        assert json.loads(file.attrs["header"])["daq"]["setup"]["switching"] == "counter"


def test_readings_do_not_depend_on_window(traced: TracedRig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, sensors = traced.with_daq(DAQS["sync"])
    _, path = record_with(traced, rig, daq_of(rig, sensors), "windows")
    columns = []
    for window_s in (100.0, 0.25):
        monkeypatch.setattr(waveform, "WINDOW_S", window_s)
        write_recording(read_journal(path.with_suffix(".journal")), path)
        columns.append(group(path, "B"))
    single, several = columns
    assert len(several["time_s"]) == len(single["time_s"])
    assert several["time_s"] == pytest.approx(single["time_s"], abs=2e-4)
    assert several["right"] == pytest.approx(single["right"], abs=3e-3)


class Overrun(SimulatedDaq):
    """A device whose samples are overwritten once, in a reading after the first second."""

    def read(self) -> Samples:
        samples = super().read()
        if samples.first > 10_000 and len(samples.counts) > 0 and self.losses.overruns == 0:
            self.losses.overruns, self.losses.samples = 1, len(samples.counts)
            self._begun_s, self._next, self._gap = self.clock.now_s(), 0, True
            return replace(samples, segment=1, first=0, counts=samples.counts[:0], notices=("samples overwritten",))
        return replace(samples, segment=self.losses.overruns)


def test_readings_continue_after_gap(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq(DAQS["counter"])
    run, path = record_with(traced, rig, daq_of(rig, sensors, kind=Overrun), "gap")
    with h5netcdf.File(path, "r") as file:
        assert set(file.variables["stretch"][...]) == {0, 1}
        assert list(json.loads(file.attrs["clock"])) == ["0.0", "0.1"]
        events = json.loads(file.attrs["events"])
    assert [event["reason"] for event in events if event["what"] == "remark"] == ["samples overwritten"]
    assert events[-1]["losses"]["overruns"] == 1
    columns = group(path, "A")
    intervals_s = np.diff(columns["time_s"])
    assert np.sum(intervals_s > 0.006) == 1
    assert intervals_s.min() > 0.004
    assert intervals_s.max() == pytest.approx(0.5, abs=0.02)  # the interval between readings
    after_gap = columns["time_s"] > columns["time_s"][np.argmax(intervals_s)] + 0.01
    used = after_gap & (np.abs(columns["angle_deg"] + 3.0) < 1e-6)
    expected = signal_V(sensors[0], np.array([-3.0]))[0, 0]
    assert columns["right"][used].mean() == pytest.approx(expected, abs=1e-4)
    assert run.cautions == ("samples overwritten",)


def test_without_switching_recording_has_no_readings(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq(DAQS["sync"])

    class Unplugged(SimulatedDaq):
        def read(self) -> Samples:
            samples = super().read()
            samples.counts[:, -1] = 3
            return samples

    run, path = record_with(traced, rig, daq_of(rig, sensors, kind=Unplugged), "unplugged")
    assert run.sensors == {"A": 0, "B": 0}
    assert "sync; changes by only 0 V" in run.cautions[0]
    with h5netcdf.File(path, "r") as file:
        assert json.loads(file.attrs["remarks"]) == list(run.cautions)
        assert file.variables["counts"].shape[0] > 10_000


def test_signal_shows_state_without_counters_or_sync(traced: TracedRig) -> None:
    rig, sensors = traced.with_daq(DAQS["counter"])
    assert rig.daq is not None
    daq = rig.daq.model_copy(update={"switching": "external"})
    single = rig.model_copy(update={"sensor": rig.sensor[:1], "daq": daq})
    run, path = record_with(traced, single, daq_of(single, sensors[:1]), "signal")
    columns = group(path, "A")
    used = np.abs(columns["angle_deg"] + 3.0) < 1e-6
    expected = signal_V(sensors[0], np.array([-3.0]))[0]
    assert [columns[side][used].mean() for side in ("right", "left")] == pytest.approx(expected, abs=1e-4)
    assert run.cautions == ()


# rigs and runs


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[daq]", "[board]\n[daq]"), r"daq; cannot be combined with \[board\]; omit one"),
        (("[daq]", '[daq]\ndriver = "nidaqmx"'), r"daq\.device; is required by the driver nidaqmx"),
        (("[daq]", '[daq]\nmodel = "USB-1"'), "model = 'USB-1'; must be one of USB-6218"),
        (("[daq]", "[daq]\nrate_hz = 80000.0"), r"other\.toml: daq\.rate_hz = 80000\.0; gives 320000 .* for 4 inputs"),
        (("[daq]", '[daq]\nchannels = ["ai0"]'), "channels = 'ai0'; must list 4, one for each input"),
        (('switching = "counter"', 'switching = "external"'), "sync; is required with 2 alternating emitters"),
        (("[daq]", '[daq]\nsync = "ai9"'), "sync = 'ai9'; cannot be combined with switching"),
        (("[daq]", '[daq]\ndriver = "nidaqmx"\ndevice = "Dev1"'), "ambient; is for a simulated rig"),
    ],
)
def test_refuses_bad_rig_in_one_line(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    path = tmp_path / "other.toml"
    path.write_text(daq_rig().replace(*change, 1), encoding="utf-8")
    with pytest.raises(BenchError, match=message) as bad:
        load_rig(path)
    assert len(str(bad.value).splitlines()) == 1


def test_resumes_stopped_run(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (bench / "rig.toml").write_text(daq_rig(), encoding="utf-8")
    monkeypatch.setattr(recording, "MIN_SIMULATED_READ_S", 0.1)
    files = bench / "protocol.toml", bench / "rig.toml", bench / "out"

    def stop(tick: Tick) -> None:
        if tick.counts is not None:
            assert tick.counts.shape == (1, 2, 4)
            assert (tick.counts[0, 1] > tick.counts[0, 0] + 1000).any()  # the off level exceeds the on level
        if tick.cycle > 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(*files, watch=stop)
    run = record(*files, RecordOptions(resume=True))
    assert (run.outcome, run.cycles, run.warnings) == ("done", 3, ())
    assert run.losses == {"samples": 0, "overruns": 0}
    with h5netcdf.File(bench / "out" / "protocol.nc", "r") as file:
        time_s, part = file.variables["time_s"][...], file.variables["part"][...]
        assert file.variables["counts"].shape == (50 * len(time_s), 4)
    assert (np.diff(time_s) > 0.0).all()
    assert set(part) == {0, 1}
    assert (np.diff(group(bench / "out" / "protocol.nc", "A")["time_s"]) > 0.004).all()
    (entry,) = list_recordings(bench / "out").recordings
    assert entry.periods == run.periods == len(time_s)


def recover_killed(run: Killed) -> str:
    """Check that a run's samples older than half a second are recorded once; return when it was killed."""
    if run.recording.exists():
        assert (np.diff(group(run.recording, "A")["time_s"]) > 0.004).all()
        return "after its end"
    if not run.journal.exists():
        return "before its journal"
    content = read_journal(run.journal)
    frames = np.concatenate([np.zeros(0), *(rows["number"] for rows in content.blocks("samples"))])
    assert frames.tolist() == list(range(0, 50 * len(frames), 50))
    assert len(frames) == content.counts["samples"]
    if content.events:
        begin_s = dt.datetime.fromisoformat(content.events[0]["utc"]).timestamp()
        assert len(frames) >= int(200 * (run.killed_s - begin_s - 0.5))
    closed = recover(run.journal)
    assert (closed.outcome, closed.periods) == ("killed", len(frames))
    time_s = group(run.recording, "A")["time_s"]
    assert len(time_s) >= len(frames) - 1 if len(frames) > 1 else True
    assert (np.diff(time_s) > 0.004).all()
    return "while sampling" if len(frames) else "before the first sample"


@pytest.mark.evidence
def test_run_killed_at_random_moment_loses_less_than_half_second(bench: Path) -> None:
    (bench / "rig.toml").write_text(daq_rig(), encoding="utf-8")
    rng, moments = np.random.default_rng(8), Counter[str]()
    for first in range(0, 20, 4):
        delays_s = rng.uniform(0.0, 2.0, 4).tolist()
        killed = kill_runs(start_process, bench, delays_s, first, from_sampling=True)
        moments.update(recover_killed(run) for run in killed)
    print(f"20 kills: {dict(moments)}")
    assert moments["while sampling"] >= 10


class Multiplexed:
    """Two inputs at 4 V, which an emitter pulls to 1 V, and a sync, converted every 1 ms: 200 periods of 10 ms."""

    name, rate_hz, switch_hz, convert_s = "multiplexed", 10_000.0, 100.0, 1e-3
    setup = Setup(("ai0", "ai1", "ai2"), True, 10_000.0, 1, 100.0, switching="external")
    coefficients, losses = np.tile([0.0, 1e-3], (3, 1)), DaqLosses()

    def start(self) -> None:
        pass

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass

    def read(self) -> Samples:
        time_s = np.arange(20_000)[:, None] / self.rate_hz + self.convert_s * np.arange(3)
        lit = (time_s * self.switch_hz + 0.123) % 1.0 < 0.5
        return Samples(0, 0, np.where(lit, [1000, 1000, 3300], [4000, 4000, 0]).astype(np.int16))


def test_live_readings_take_conversion_times_into_account() -> None:
    sensor = {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2}
    daq: Daq = Multiplexed()
    levels = LiveReadings(daq, Rig(name="two", sensor=(sensor,))).read()
    assert levels is not None
    assert levels.signal == pytest.approx(np.full(levels.signal.shape, 3.0), abs=1e-9)
    assert levels.off == pytest.approx(np.full(levels.off.shape, 4.0), abs=1e-9)
