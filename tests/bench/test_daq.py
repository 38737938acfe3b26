"""A data acquisition in place of a board: what it samples, which emitter is on, and what is made of it."""

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
from solen.arrays import FloatArray
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
from solen.bench.run import Instruments, begin, run
from solen.bench.simulated.board import SimulatedBoard
from solen.bench.simulated.daq import SimulatedDaq, settling
from solen.bench.simulated.sensors import SimulatedSensor, adc_of, simulated_sensors
from solen.bench.simulated.stage import SimulatedStage
from solen.errors import BenchError, DataError
from solen.readout import lagged, volts
from solen.spec import load, template, with_values
from solen.spec.toml import dumps
from tests.bench.rig_support import PROTOCOL, RIG
from tests.bench.test_kills import Killed, killed

DARK, ROOM = AmbientLight(), AmbientLight(mean_mw_cm2=0.05)
DAQS = {
    "counter": 'switching = "counter"',
    "sync": 'sync = "ai8"',
}


def daq_rig(more: str = DAQS["counter"], rig: str = RIG) -> str:
    return rig.replace("[board]", f"[daq]\n{more}")


@dataclass(frozen=True)
class Bench:
    """A folder of a rig with a board, and its traced sensors."""

    folder: Path
    rig: Rig
    prints: tuple[SimulatedSensor, ...]

    def of(self, more: str) -> tuple[Rig, tuple[SimulatedSensor, ...]]:
        """The same sensors on a data acquisition."""
        path = self.folder / "other.toml"
        path.write_text(daq_rig(more), encoding="utf-8")
        rig = load_rig(path)
        return rig, tuple(replace(one, circuit=replace(one.circuit, adc=adc_of(rig))) for one in self.prints)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    folder = tmp_path_factory.mktemp("bench")
    for name, text in (("sensor", template("paper-860")), ("rig", RIG), ("protocol", PROTOCOL)):
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    # a chip with a width: a point's response is over within a degree
    wide = with_values(load(folder / "sensor.toml"), {"emitter.width_mm": 0.2})
    (folder / "sensor.toml").write_text(dumps(wide), encoding="utf-8")
    rig = load_rig(folder / "rig.toml")
    return Bench(folder, rig, simulated_sensors(rig, folder, 3.0, np.random.default_rng(5)))


Angles = Callable[[FloatArray], FloatArray]
Make = Callable[[SimulatedClock, Angles], EmitterBoard | Daq]


def recorded(made: Bench, rig: Rig, make: Make, name: str) -> tuple[RecordedRun, Path]:
    """A protocol run and closed, without the command around it."""
    clock = SimulatedClock()
    stage = SimulatedStage(clock)
    on = Instruments(stage, make(clock, stage.axis.positions), clock, 0.5)
    sensors = [one.model_dump(mode="json") for one in rig.sensor]
    protocol = load_protocol(made.folder / "protocol.toml")
    header: Mapping[str, Any] = {
        "solen": "0", "simulated": True, "begun_utc": "2026-01-01T00:00:00+00:00", "protocol_name": "short",
        "rig_name": "small rig", "sensors": sensors, "zero": 0.0, "lever_mm": None, "top_count": 65_535,
        "protocol": protocol.model_dump(mode="json"),
    }  # fmt: skip
    path = made.folder / f"{name}.journal"
    with begin(path, on, header) as journal:
        run(protocol, on, journal)
    target = made.folder / f"{name}.nc"
    return write_recording(read_journal(path), target), target


def daq_of(
    rig: Rig, prints: tuple[SimulatedSensor, ...], room: AmbientLight = DARK, kind: type[SimulatedDaq] = SimulatedDaq
) -> Make:
    setup = rig.setup
    assert setup is not None
    return lambda clock, at: kind(clock, prints, at, room, np.random.default_rng(7), setup=setup)


def group(path: Path, name: str) -> dict[str, FloatArray]:
    with h5netcdf.File(path, "r") as file:
        return {key: variable[...] for key, variable in file.groups[name].variables.items()}


# what is sampled


def test_settling_is_the_lag_of_a_first_order_step_by_step() -> None:
    # a switching that has gone on for 50 periods, in steps of 1 µs, of which a phase lasts 3 and 1 time constants
    tau_s, period_s, on = 100e-6, 400e-6, 300e-6
    inside = 1e-6 * (np.arange(50 * 400) % 400)
    level = np.where(inside < on - 1e-9, 1.0, 4.0)

    class Slow:
        time_constant_us = np.array([1e6 * tau_s])

    stepped = lagged(level[:, None], Slow(), 1e6)[-400:, 0]  # type: ignore[arg-type]  # all that it asks a circuit for
    lit = inside[-400:] < on - 1e-9
    after = np.where(lit, inside[-400:], inside[-400:] - on)[:, None]
    before = np.where(lit, period_s - on, on)[:, None]
    ends = np.where(lit, 1.0, 4.0)[:, None], np.where(lit, 4.0, 1.0)[:, None]
    # what is stepped to stands at the end of a step
    found = settling(*ends, after + 1e-6, before, period_s, np.array([tau_s]))[:, 0]
    assert found == pytest.approx(stepped, abs=1e-9)


def test_what_is_sampled_late_in_a_phase_is_what_the_circuit_says(made: Bench) -> None:
    rig, prints = made.of(DAQS["counter"])
    clock, room = SimulatedClock(), AmbientLight(mean_mw_cm2=0.05)
    daq = daq_of(rig, prints, room)(clock, lambda time_s: np.full(len(time_s), 1.0))
    assert isinstance(daq, SimulatedDaq)
    daq.start()
    clock.sleep(2.0)
    samples = daq.read()
    assert samples.counts.shape == (20_000, 4)
    read = volts_of(samples.counts, daq.coefficients).reshape(400, 50, 4)
    one = prints[0]
    # emitter 1 is on in samples 0 to 12, then off for the rest; 13 is near the edge
    for place, lit in ((12, one.at(np.array([1.0]))), (49, np.zeros((1, 2)))):
        expected = volts(lit, one.circuit, 0.05)[0]
        # 400 samples of some 230 µV and a step of 305 µV
        assert read[:, place, :2].mean(axis=0) == pytest.approx(expected, abs=5 * 250e-6 / 20)
    sampled = read[:, 1, :2].mean(axis=0)  # 100 µs after the switch: not there yet, and on the way
    on, off = (read[:, place, :2].mean(axis=0) for place in (12, 49))
    tau_s = 1e-6 * one.circuit.time_constant_us
    delays = daq.convert_s * np.array([0, 1])
    left = (off - on) * np.exp(-(100e-6 + delays) / tau_s)
    assert sampled - on == pytest.approx(left, abs=8 * 250e-6 / 20)
    assert left.max() > 2e-4


def test_a_reading_in_pieces_is_a_reading_at_once(made: Bench) -> None:
    rig, prints = made.of(DAQS["sync"])
    quiet = tuple(
        replace(one, circuit=replace(one.circuit, adc=replace(one.circuit.adc, noise_V=0.0))) for one in prints
    )
    taken = []
    for pieces in (1, 7):
        clock = SimulatedClock(3.0)
        daq = daq_of(rig, quiet)(clock, lambda time_s: np.sin(time_s))
        daq.start()
        parts = []
        for _ in range(pieces):
            clock.sleep(0.7 / pieces)
            parts.append(daq.read())
        assert isinstance(parts[0], Samples)
        taken.append(np.concatenate([part.counts for part in parts]))
    # shot and thermal noise are drawn in another order
    assert taken[0].shape == taken[1].shape == (7000, 5)
    assert np.abs(taken[0].astype(int) - taken[1]).max() <= 6


# which emitter is on


def asked(**more: Any) -> Setup:
    given = {"channels": ("ai0", "ai1", "ai8"), "synced": True, "rate_hz": 20_000.0, "emitters": 4, "switch_hz": 200.0}
    return Setup(**given | more)  # type: ignore[arg-type]  # a test may ask for anything


def sync_of(time_s: FloatArray, hz: float, turn: float, emitters: int) -> tuple[FloatArray, FloatArray]:
    """Phase in periods, and what a sync shows of it."""
    phase = time_s * hz + turn
    return phase, np.where(phase % 1.0 < 0.5 / emitters, 3.3, 0.02)


@pytest.mark.parametrize(("emitters", "rate_hz"), [(1, 10_000.0), (2, 10_000.0), (4, 20_000.0), (4, 13_333.0)])
@pytest.mark.parametrize("hz", [200.0, 199.6, 203.0])
def test_a_sync_tells_which_emitter_is_on(emitters: int, rate_hz: float, hz: float) -> None:
    setup = asked(emitters=emitters, rate_hz=rate_hz)
    time = np.arange(30_000) / rate_hz
    for turn in (0.0, 0.31, 0.77):
        phase, sync = sync_of(time, hz, turn, emitters)
        clock = clock_of(time, sync[:, None], setup, 200.0)
        assert clock.rate_hz == pytest.approx(hz * emitters, rel=1e-5)
        delay = -20e-6
        place = (phase + delay * hz) % 1.0 * emitters
        true = np.where(place % 1.0 < 0.5, np.floor(place) + 1, 0)
        found = states(clock, delay, 200e-6, emitters)
        used = found >= 0
        assert np.array_equal(found[used], true[used])
        # no more is left out than settling, and two samples at each edge
        assert np.mean(~used) <= 2 * emitters * hz * (200e-6 + 2.01 / rate_hz)


def test_a_sync_that_jitters_or_loses_a_period_is_followed_edge_by_edge() -> None:
    setup, rng = asked(rate_hz=20_000.0), np.random.default_rng(4)
    starts = np.cumsum(0.005 * (1.0 + 0.03 * rng.uniform(-1.0, 1.0, 400)))
    time = np.arange(0.02, 1.9, 1.0 / 20_000.0)
    number = np.searchsorted(starts, time, side="right") - 1
    inside = (time - starts[number]) / (starts[number + 1] - starts[number])
    sync = np.where((inside < 0.125) & (number != 200), 3.3, 0.0)
    clock = clock_of(time, sync[:, None], setup, 200.0)
    found = states(clock, 0.0, 200e-6, 4)
    place = inside * 4
    true = np.where(place % 1.0 < 0.5, np.floor(place) + 1, 0)
    # in the period whose pulse is missing, and there alone, phases may be off: by half of 3 % of it
    used = (found >= 0) & (np.abs(number - 200) > 1)
    assert np.mean(found[used] == true[used]) > 0.999
    assert np.array_equal(found[used & (inside > 0.01)] == 1, true[used & (inside > 0.01)] == 1)


@pytest.mark.parametrize(
    ("sync", "told"),
    [
        (np.full(2000, 1.0), "sync; changes by only 0 V; 0.5 V are needed"),
        (np.where(np.arange(2000) < 1000, 3.3, 0.0), "sync = 0; rises in a window of samples; two are needed"),
    ],
)
def test_a_sync_that_shows_nothing_is_reported(sync: FloatArray, told: str) -> None:
    with pytest.raises(DataError, match=told):
        clock_of(np.arange(2000) / 20_000.0, sync[:, None], asked(), 200.0)


# what is made of it


@pytest.fixture(scope="module")
def board(made: Bench) -> Path:
    layout, rng = Layout(2, 4), np.random.default_rng(6)

    def make(clock: SimulatedClock, at: Angles) -> SimulatedBoard:
        return SimulatedBoard(clock, made.prints, at, ROOM, rng, layout=layout, period_s=0.005)

    return recorded(made, made.rig, make, "board")[1]


@pytest.mark.parametrize("kind", list(DAQS))
def test_board_and_data_acquisition_give_the_same_curves_within_noise(made: Bench, board: Path, kind: str) -> None:
    rig, prints = made.of(DAQS[kind])
    done, path = recorded(made, rig, daq_of(rig, prints, ROOM), kind)
    assert done.cautions == ()
    both = [study([one]).to_dict()["sensors"] for one in (board, path)]
    for name in ("A", "B"):
        for side in ("right", "left"):
            one, other = (found[name]["receivers"][side] for found in both)
            angle = np.array(one["angle_deg"])
            mean = [np.array(found["mean_V"], float) for found in (one, other)]
            sd = [np.array(found["sd_V"], float) for found in (one, other)]
            ways = np.array(one["ways"], float)
            assert other["angle_deg"] == one["angle_deg"]
            # 5 standard errors of both, and what a curve bends by between readings 0.075 degrees apart
            bend = 0.125 * np.abs(np.gradient(np.gradient(mean[0], angle), angle)) * 0.075**2
            bound = 5 * np.hypot(*sd) / np.sqrt(ways) + bend + 2e-4
            both_ways = ways == ways.max()
            assert both_ways.mean() > 0.9
            assert (np.abs(mean[0] - mean[1]) <= bound)[both_ways].all()
            assert np.ptp(mean[0][both_ways]) > (100 if name == "A" else 1) * bound[both_ways].max()  # it could fail


def test_readings_are_those_of_the_circuit_at_every_angle(made: Bench) -> None:
    rig, prints = made.of("rate_hz = 20000.0\n" + DAQS["sync"])
    done, path = recorded(made, rig, daq_of(rig, prints), "truth")
    one, read = prints[0], group(path, "A")
    assert done.sensors["A"] == len(read["time_s"])
    expected = volts(one.at(read["angle_deg"]), one.circuit) - volts(np.zeros((1, 2)), one.circuit)
    for place, side in enumerate(("right", "left")):
        held = np.isin(np.round(read["angle_deg"], 6), (-3.0, 3.0))
        off = read[side][held] - expected[held, place]
        assert abs(off.mean()) < 5 * off.std() / math.sqrt(held.sum()) + 2e-6
        moving = read[side][~held] - expected[~held, place]
        # where the stage brakes by 200 deg/s², between looks 20 ms apart, its angle is off by up to 200 · 0.02² / 8
        per_deg = np.abs(np.diff(one.fractions[:, place]) / np.diff(one.angle_deg)).max() / one.fractions.max()
        assert np.abs(moving).max() < 1.1 * 0.01 * per_deg * np.ptp(expected[:, place]) + 5 * off.std()
    # 200 readings per second, none lost and none double
    assert np.diff(read["time_s"]) == pytest.approx(0.005, abs=1e-4)


def test_raw_samples_are_in_the_file_with_what_makes_volts_of_them(made: Bench) -> None:
    rig, prints = made.of(DAQS["counter"])
    _, path = recorded(made, rig, daq_of(rig, prints), "raw")
    journaled = read_journal(path.with_suffix(".journal"))
    assert "samples" not in journaled.streams
    blocks = np.concatenate(list(journaled.blocks("samples")))
    with h5netcdf.File(path, "r") as file:
        raw = file.variables["counts"]
        assert raw.dtype == np.int16
        assert np.array_equal(raw[...], blocks["counts"].reshape(-1, 4))
        assert len(raw.chunks) == 2
        assert file.variables["coefficients"].shape == (4, 2)
        number, time = file.variables["number"][...], file.variables["time_s"][...]
        assert number.tolist() == list(range(0, 50 * len(number), 50))
        assert np.diff(time) == pytest.approx(0.005 / (1 + 20e-6), rel=1e-6 * 50)
        assert json.loads(file.attrs["header"])["daq"]["setup"]["switching"] == "counter"


def test_windows_lose_no_reading_and_double_none(made: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, prints = made.of(DAQS["sync"])
    made_of = []
    for name, window_s in (("whole", 100.0), ("pieces", 0.25)):
        monkeypatch.setattr(waveform, "WINDOW_S", window_s)
        made_of.append(group(recorded(made, rig, daq_of(rig, prints), name)[1], "B"))
    whole, pieces = made_of
    assert len(pieces["time_s"]) == len(whole["time_s"])
    assert pieces["time_s"] == pytest.approx(whole["time_s"], abs=2e-4)
    assert pieces["right"] == pytest.approx(whole["right"], abs=3e-3)


class Overrun(SimulatedDaq):
    """One whose samples of 0.3 s are overwritten once."""

    def read(self) -> Samples:
        samples = super().read()
        if samples.first > 10_000 and len(samples.counts) > 0 and self.losses.overruns == 0:
            self.losses.overruns, self.losses.samples = 1, len(samples.counts)
            self._begun_s, self._next, self._gap = self.clock.now_s(), 0, True
            return replace(samples, segment=1, first=0, counts=samples.counts[:0], notices=("some were overwritten",))
        return replace(samples, segment=self.losses.overruns)


def test_after_a_gap_readings_go_on_and_the_gap_is_reported(made: Bench) -> None:
    rig, prints = made.of(DAQS["counter"])
    done, path = recorded(made, rig, daq_of(rig, prints, kind=Overrun), "gap")
    with h5netcdf.File(path, "r") as file:
        assert set(file.variables["stretch"][...]) == {0, 1}
        assert list(json.loads(file.attrs["clock"])) == ["0.0", "0.1"]
        events = json.loads(file.attrs["events"])
    assert [one["reason"] for one in events if one["what"] == "remark"] == ["some were overwritten"]
    assert events[-1]["losses"]["overruns"] == 1
    time = group(path, "A")["time_s"]
    steps = np.diff(time)
    assert np.sum(steps > 0.006) == 1
    assert steps.min() > 0.004
    assert steps.max() == pytest.approx(0.5, abs=0.02)  # a reading's worth of samples
    read, one = group(path, "A"), prints[0]
    late = (time > time[np.argmax(steps)] + 0.01) & (np.abs(read["angle_deg"] + 3.0) < 1e-6)
    expected = volts(one.at(np.array([-3.0])), one.circuit) - volts(np.zeros((1, 2)), one.circuit)
    assert read["right"][late].mean() == pytest.approx(expected[0, 0], abs=1e-4)
    assert done.cautions == ("some were overwritten",)


def test_emitters_that_do_not_switch_give_no_reading_and_the_file_says_so(made: Bench) -> None:
    rig, prints = made.of(DAQS["sync"])

    class Unplugged(SimulatedDaq):
        def read(self) -> Samples:
            samples = super().read()
            samples.counts[:, -1] = 3
            return samples

    done, path = recorded(made, rig, daq_of(rig, prints, kind=Unplugged), "unplugged")
    assert done.sensors == {"A": 0, "B": 0}
    assert "sync; changes by only 0 V" in done.cautions[0]
    with h5netcdf.File(path, "r") as file:
        assert json.loads(file.attrs["remarks"]) == list(done.cautions)
        assert file.variables["counts"].shape[0] > 10_000


def test_without_counters_or_a_sync_the_signal_tells_when_its_emitter_is_on(made: Bench) -> None:
    rig, prints = made.of(DAQS["counter"])
    assert rig.daq is not None
    daq = rig.daq.model_copy(update={"switching": "external"})
    one = rig.model_copy(update={"sensor": rig.sensor[:1], "daq": daq})
    done, path = recorded(made, one, daq_of(one, prints[:1]), "signal")
    read, single = group(path, "A"), prints[0]
    held = np.abs(read["angle_deg"] + 3.0) < 1e-6
    expected = volts(single.at(np.array([-3.0])), single.circuit) - volts(np.zeros((1, 2)), single.circuit)
    assert [read[side][held].mean() for side in ("right", "left")] == pytest.approx(expected[0], abs=1e-4)
    assert done.cautions == ()


# rigs and runs


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (("[daq]", "[board]\n[daq]"), r"daq; cannot be combined with \[board\]; keep the one in the rig"),
        (("[daq]", '[daq]\ndriver = "nidaqmx"'), "device; is for a real instrument, and a real instrument requires it"),
        (("[daq]", '[daq]\nmodel = "USB-1"'), "model = 'USB-1'; must be one of USB-6218"),
        (("[daq]", "[daq]\nrate_hz = 80000.0"), r"other\.toml: daq\.rate_hz = 80000\.0; for 4 inputs is 320000"),
        (("[daq]", '[daq]\nchannels = ["ai0"]'), "names 1 inputs; the sensors use 4"),
        (('switching = "counter"', 'switching = "external"'), "sync; is needed with 2 alternating emitters"),
        (("[daq]", '[daq]\nsync = "ai9"'), "sync = 'ai9'; cannot be combined with outputs that follow the clock"),
        (("[daq]", '[daq]\ndriver = "nidaqmx"\ndevice = "Dev1"'), "ambient; is for a simulated rig"),
    ],
)
def test_bad_rigs_are_reported_in_one_line(tmp_path: Path, change: tuple[str, str], told: str) -> None:
    path = tmp_path / "other.toml"
    path.write_text(daq_rig().replace(*change, 1), encoding="utf-8")
    with pytest.raises(BenchError, match=told) as refusal:
        load_rig(path)
    assert len(str(refusal.value).splitlines()) == 1


def test_a_run_that_was_stopped_is_taken_up_and_closed(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (bench / "rig.toml").write_text(daq_rig(), encoding="utf-8")
    monkeypatch.setattr(recording, "READ_SIMULATED_S", 0.1)
    files = bench / "protocol.toml", bench / "rig.toml", bench / "out"

    def stop(tick: Any) -> None:
        if tick.counts is not None:
            assert tick.counts.shape == (1, 2, 4)
            assert (tick.counts[0, 1] > tick.counts[0, 0] + 1000).any()  # off stands above on
        if tick.cycle > 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(*files, watch=stop)
    found = record(*files, RecordOptions(resume=True))
    assert (found.outcome, found.cycles, found.warnings) == ("done", 3, ())
    assert found.losses == {"samples": 0, "overruns": 0}
    with h5netcdf.File(bench / "out" / "protocol.nc", "r") as file:
        time, part = file.variables["time_s"][...], file.variables["part"][...]
        assert file.variables["counts"].shape == (50 * len(time), 4)
    assert (np.diff(time) > 0.0).all()
    assert set(part) == {0, 1}
    assert (np.diff(group(bench / "out" / "protocol.nc", "A")["time_s"]) > 0.004).all()
    (row,) = list_recordings(bench / "out").recordings
    assert row.periods == found.periods == len(time)


def check_killed(one: Killed) -> str:
    """Every sample older than half a second is there, none is double, and the file opens."""
    if one.recording.exists():
        assert (np.diff(group(one.recording, "A")["time_s"]) > 0.004).all()
        return "after its end"
    if not one.journal.exists():
        return "before its journal"
    found = read_journal(one.journal)
    frames = np.concatenate([np.zeros(0), *(rows["number"] for rows in found.blocks("samples"))])
    assert frames.tolist() == list(range(0, 50 * len(frames), 50))
    assert len(frames) == found.counts["samples"]
    if found.events:
        begun_s = dt.datetime.fromisoformat(found.events[0]["utc"]).timestamp()
        assert len(frames) >= int(200 * (one.at_s - begun_s - 0.5))
    done = recover(one.journal)
    assert (done.outcome, done.periods) == ("killed", len(frames))
    read = group(one.recording, "A")
    assert len(read["time_s"]) >= len(frames) - 1 if len(frames) > 1 else True
    assert (np.diff(read["time_s"]) > 0.004).all()
    return "in the middle" if len(frames) else "before the first sample"


@pytest.mark.evidence
def test_a_run_that_is_killed_at_any_moment_loses_less_than_half_a_second(bench: Path) -> None:
    (bench / "rig.toml").write_text(daq_rig(), encoding="utf-8")
    rng, found = np.random.default_rng(8), Counter[str]()
    for first in range(0, 20, 4):
        found.update(
            check_killed(one) for one in killed(bench, rng.uniform(0.0, 2.0, 4).tolist(), first, sampling=True)
        )
    print(f"20 kills: {dict(found)}")
    assert found["in the middle"] >= 10


class Multiplexed:
    """Two inputs of 4 V, pulled to 1 V by an emitter, and a sync, converted 1 ms apart: 200 periods of 10 ms."""

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
        taken_s = np.arange(20_000)[:, None] / self.rate_hz + self.convert_s * np.arange(3)
        lit = (taken_s * self.switch_hz + 0.123) % 1.0 < 0.5
        return Samples(0, 0, np.where(lit, [1000, 1000, 3300], [4000, 4000, 0]).astype(np.int16))


def test_a_glance_counts_from_the_channel_of_the_sync() -> None:
    sensor = {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2}
    daq: Daq = Multiplexed()
    levels = LiveReadings(daq, Rig(name="two", sensor=(sensor,))).read()
    assert levels is not None
    assert levels.signal == pytest.approx(np.full(levels.signal.shape, 3.0), abs=1e-9)
    assert levels.off == pytest.approx(np.full(levels.off.shape, 4.0), abs=1e-9)
