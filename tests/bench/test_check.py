"""Before a run: checking a rig, watching its readings, and jogging its stage."""

import io
import math
import re
from collections.abc import Callable
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path

import h5netcdf
import numpy as np
import pytest
from scipy.signal import detrend

import solen.cli
import solen.cli.bench.look  # noqa: F401  registers its lines
from solen.arrays import FloatArray
from solen.bench.check import CheckOptions, JogOptions, RigCheck, check, jog, rig_check
from solen.bench.clock import WallClock
from solen.bench.live import TRACED_RANGE, InputReadings
from solen.bench.record import record
from solen.bench.rig import Rig, load_rig
from solen.bench.simulated.sensors import simulated_sensors
from solen.bench.watch import LiveReading, WatchOptions, watch
from solen.cli.app import lines
from solen.errors import BenchError, SpecError
from solen.pipeline.bench.record import new
from solen.ranks import ranked
from solen.readout import noise
from tests.bench.rig_support import PROTOCOL
from tests.bench.wire_support import Served
from tests.bench.zaber_controller_support import ZaberDevice

SENSORS = (
    {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2},
    {"name": "B", "design": "a.toml", "emitter": 2, "right": 4, "left": 3},
)
RIG = Rig(name="two", sensor=SENSORS)
TOP_V = 5.0


@dataclass
class Levels:
    """Levels with all emitters off, and the drop that each emitter causes at each input: (emitters, inputs) in V.

    `ambient` is the change of all levels with time, (200,) in V.
    """

    off: FloatArray
    drop: FloatArray
    ambient: FloatArray


Change = Callable[[Levels], None]


def check_of(change: Change | None = None, noise_V: float = 0.003) -> RigCheck:
    """Check a rig of two sensors whose emitters pull their inputs from 4.8 V to 3.1 V, with one change."""
    model = Levels(np.full((2, 4), 4.8), np.zeros((2, 4)), np.zeros(200))
    model.drop[0, :2] = model.drop[1, 2:] = 1.7
    if change is not None:
        change(model)
    rng = np.random.default_rng(3)
    levels = np.minimum(model.off + model.ambient[:, None, None] + rng.normal(0.0, 1e-4, (200, 2, 4)), TOP_V)
    signal = model.drop + rng.normal(0.0, noise_V, (200, 2, 4))
    return rig_check(RIG, InputReadings(np.linspace(0.0, 0.995, 200), signal, levels, levels == TOP_V, 0.0, TOP_V))


def test_good_rig_has_no_faults() -> None:
    result = check_of()
    assert result.faults == ()
    receiver = result.sensors["B"]["left"]
    assert (receiver.input, round(receiver.off_V, 2), round(receiver.signal_V, 2)) == (3, 4.8, 1.7)
    assert receiver.noise_V == pytest.approx(0.003, rel=0.2)
    assert np.array(result.answers_V) == pytest.approx(np.array([[1.7, 1.7, 0, 0], [0, 0, 1.7, 1.7]]), abs=2e-3)


def disconnected(levels: Levels) -> None:
    levels.drop[:, 1] = 0.0


def crossed(levels: Levels) -> None:
    levels.drop[:, [1, 2]] = levels.drop[:, [2, 1]]


def crossed_with_crosstalk(levels: Levels) -> None:
    crossed(levels)
    levels.drop[levels.drop == 0.0] = 0.1


def dead_emitter(levels: Levels) -> None:
    levels.drop[1] = 0.0


def short_circuit(levels: Levels) -> None:
    levels.off[:, 0], levels.drop[:, 0] = 0.004, 0.0


def inverted(levels: Levels) -> None:
    levels.drop[:, 3] *= -1.0


def too_bright(levels: Levels) -> None:
    levels.drop[0, 0] = 3.4


def too_dim(levels: Levels) -> None:
    levels.drop[0, 0] = 0.17


def saturated(levels: Levels) -> None:
    levels.off[:, 2] = 5.0


def lamps(levels: Levels) -> None:
    levels.ambient[:] = 0.3 * (np.sin(np.arange(200) * 0.21) - 1.0)


@pytest.mark.parametrize(
    ("change", "patterns"),
    [
        (disconnected, [r"A left \(input 2\): do not use: responds to no emitter"]),
        (crossed, [r"A left .* responds to emitter 2, not to 1", r"B left \(input 3\): .* emitter 1, not to 2"]),
        (crossed_with_crosstalk, ["A left .* emitter 2, not to 1", "B left .* emitter 1, not to 2"]),
        (dead_emitter, ["B right .* no emitter", "B left .* no emitter", "no input responds to emitter 2"]),
        (short_circuit, [r"A right \(input 1\): do not use: .* near 0 V"]),
        (inverted, ["B right .* rises when its emitter is on"]),
        (too_bright, [r"A right .* 1.5 times the light.* smaller load"]),
        (too_dim, [r"A right .*: note: .* larger load"]),
        (saturated, [r"B left .* upper limit of the range in \d\d % of the readings"]),
        (lamps, ["varies by 21. mV with the emitters off; shade it"] * 4),
    ],
)  # fmt: skip
def test_names_faults(change: Change, patterns: list[str]) -> None:
    faults = check_of(change).faults
    assert len(faults) == len(patterns), faults
    assert all(re.search(pattern, fault) for pattern, fault in zip(patterns, faults, strict=True)), faults


def test_shorted_input_has_no_relative_signal() -> None:
    def zero_level(levels: Levels) -> None:
        levels.off[:, 1] = levels.drop[:, 1] = 0.0

    result = check_of(zero_level)
    shorted = replace(result.sensors["A"]["left"], off_V=0.0, signal_V=0.0)
    assert any("is near 0 V" in fault for fault in result.faults)
    printed = "\n".join(lines(replace(result, sensors={"A": {"left": shorted}})))
    assert "0 V off" in printed
    assert "signal 0 V, noise" in printed


def test_recommended_load_removes_fault() -> None:
    factor = check_of(too_bright).sensors["A"]["right"].load_factor
    assert factor is not None
    assert factor == pytest.approx(0.4 * 4.8 / 3.4, rel=1e-3)

    def adjusted(levels: Levels) -> None:
        levels.drop[0, 0] = 3.4 * factor

    assert check_of(adjusted).faults == ()


@pytest.mark.parametrize("sampler", ["[board]\n", '[daq]\nswitching = "counter"\n'])
def test_checks_and_watches_simulated_rig(bench: Path, sampler: str) -> None:
    rig = changed_rig(bench, ("[board]\n", sampler))
    result = check(rig, CheckOptions(seconds=1.0))
    assert result.simulated
    assert result.faults == ()
    assert result.periods >= 195
    signal = [result.answers_V[0][:2], result.answers_V[1][2:]]
    crosstalk = [result.answers_V[0][2:], result.answers_V[1][:2]]
    assert np.min(signal) > 0.3
    assert np.abs(crosstalk).max() < 0.05
    readings: list[LiveReading] = []
    summary = watch(rig, WatchOptions(seconds=0.5), readings.append)
    assert summary.looks == len(readings) >= 4
    assert readings[0].signal_V["A"]["right"] == pytest.approx(result.sensors["A"]["right"].signal_V, abs=0.05)


def changed_rig(bench: Path, *changes: tuple[str, str]) -> Path:
    """Replace parts of the small rig's file, and return the file."""
    rig = bench / "rig.toml"
    text = rig.read_text(encoding="utf-8")
    for old, new_text in changes:
        assert old in text
        text = text.replace(old, new_text)
    rig.write_text(text, encoding="utf-8")
    return rig


def predicted_noise_V(rig_file: Path) -> FloatArray:
    """Return the noise of a reading at rest as predicted from the circuit, (sensors, receivers)."""
    rig = load_rig(rig_file)
    sensors = simulated_sensors(rig, rig_file.parent, TRACED_RANGE["deg"], np.random.default_rng([rig.seed, 0]))
    ambient = rig.ambient.mean_mw_cm2
    on_V = np.array([noise(sensor.circuit, sensor.at(np.zeros(1))[0], ambient).before_V for sensor in sensors])
    off_V = np.array([noise(sensor.circuit, np.zeros(2), ambient).before_V for sensor in sensors])
    return np.asarray(np.sqrt(on_V**2 + 0.5 * off_V**2))  # a reading is on minus the mean of two off levels


def test_noise_matches_prediction(bench: Path) -> None:
    constant_light = ("flicker_percent = 20.0\ndrift_percent_per_min = 50.0", "")
    rig = changed_rig(bench, constant_light, ("[board]\n", "[board]\nrange_v = 5.1\n"))
    result = check(rig, CheckOptions(seconds=10.0))
    noise_V = [[receiver.noise_V for receiver in sides.values()] for sides in result.sensors.values()]
    assert noise_V == pytest.approx(predicted_noise_V(rig), rel=0.07)  # the standard deviation is 2.2 %


@pytest.mark.parametrize("sampler", ["[board]\n", '[daq]\nswitching = "counter"\n'])
def test_noise_of_check_matches_recording(bench: Path, sampler: str) -> None:
    flicker = ("[ambient]\n", "[ambient]\nflicker_hz = 99.0\n")  # all phases relative to the switching within 1 s
    rig = changed_rig(bench, ("[board]\n", sampler), flicker)
    protocol = PROTOCOL.replace("cycles = 3\nrest_s = 0.2", "cycles = 1\nrest_s = 5.0")
    (bench / "rest.toml").write_text(protocol, encoding="utf-8")
    path = record(bench / "rest.toml", rig, bench / "out").path
    result = check(rig, CheckOptions(seconds=8.0))
    with h5netcdf.File(path, "r") as file:
        for name, sides in result.sensors.items():
            time_s = file[name]["time_s"][:]
            for side, receiver in sides.items():
                volts = file[name][side][:]
                segments = [volts[(time_s > begin) & (time_s < begin + 0.8)] for begin in (0.2, 1.2, 2.2, 3.2, 4.0)]
                scatter = np.concatenate([detrend(segment) for segment in segments])
                assert receiver.noise_V == pytest.approx(float(scatter.std()), rel=0.12)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["rig", "rig-bending", "rig-daq"])
def test_shipped_rigs_have_no_faults(tmp_path: Path, name: str) -> None:
    new(tmp_path)
    assert check(tmp_path / f"{name}.toml").faults == ()


@pytest.mark.parametrize("setup", ['switching = "counter"', 'switching = "external"\nsync = "ai8"'])
def test_readings_have_no_gaps_if_switching_is_slow(bench: Path, setup: str) -> None:
    rig = changed_rig(bench, ("[board]\n", f"[daq]\n{setup}\nswitch_hz = 12.5\n"))
    result = check(rig, CheckOptions(seconds=2.0))
    assert result.periods >= 15
    assert np.isfinite(result.answers_V).all()
    readings: list[LiveReading] = []
    assert watch(rig, WatchOptions(seconds=1.0, every_s=0.02), readings.append).looks >= 3
    assert np.isfinite([[*shot.signal_V["A"].values(), *shot.off_V["B"].values()] for shot in readings]).all()


def test_watch_prints_table(bench: Path) -> None:
    printed = io.StringIO()
    with redirect_stdout(printed):
        assert solen.cli.run_command(["bench", "watch", "--rig", str(bench / "rig.toml"), "--seconds", "0.5"]) == 0
    rows = printed.getvalue().splitlines()
    assert rows[0] == "time/s,A right/V,A left/V,B right/V,B left/V"
    assert len(rows[1].split(",")) == 5
    assert rows[-1].endswith("simulated")


def test_warns_of_levels_outside_linear_range_of_adc(bench: Path) -> None:
    rig = changed_rig(bench, ("[board]\n", "[board]\nlinear_v = [0.5, 4.9]\n"))
    result = check(rig, CheckOptions(seconds=0.5))
    assert len(result.faults) == 4  # in the dark all levels are near 5 V
    assert all("0.5 to 4.9 V, the linear range of the ADC" in fault for fault in result.faults)
    run = record(bench / "protocol.toml", rig, bench / "out")
    assert any("A: 100 % of the readings" in line and "linear range" in line for line in run.warnings)


@pytest.mark.parametrize("seconds", [0.05, 0.001])
def test_short_watch_reads_once(bench: Path, seconds: float) -> None:
    readings: list[LiveReading] = []
    assert watch(bench / "rig.toml", WatchOptions(seconds=seconds), readings.append).looks == len(readings) == 1


def test_ctrl_c_ends_watching(bench: Path) -> None:
    def interrupt(_: LiveReading) -> None:
        raise KeyboardInterrupt

    assert watch(bench / "rig.toml", WatchOptions(), interrupt).looks == 1


def zaber_rig(folder: Path, url: str) -> Path:
    """Write the file of a rig with a Zaber stage, and return it."""
    path = folder / "stage.toml"
    stage = f'driver = "zaber"\nport = "{url}"\nsteps_per_unit = 4000.0\nhome = "here"\ntravel = [-3.0, 3.0]\n'
    board = '[board]\ndriver = "serial"\nport = "COM3"\n'
    sensor = '[[sensor]]\nname = "A"\ndesign = "a.toml"\nemitter = 1\nright = 1\nleft = 2\n'
    path.write_text(f'schema = 1\nname = "x"\n[stage]\n{stage}{board}{sensor}', encoding="utf-8")
    return path


def test_jogs_stage_within_travel(tmp_path: Path) -> None:
    device = ZaberDevice(WallClock())
    with Served(device) as served:
        rig = zaber_rig(tmp_path, served.url)
        assert jog(rig).stands_deg is None  # no zero was set
        assert jog(rig, JogOptions(to=1.0, velocity=20.0)).stands_deg == 1.0
        moved = jog(rig, JogOptions(by=-1.5, velocity=20.0))
        assert (moved.begun_deg, moved.stands_deg) == (1.0, -0.5)
        moves = len(device.axis.moves)
        assert jog(rig).stands_deg == -0.5
        for options in (JogOptions(to=3.5), JogOptions(by=4.0)):
            with pytest.raises(BenchError, match=r"3\.5; is outside the travel of the rig, -3 to 3"):
                jog(rig, options)
        with pytest.raises(SpecError, match=r"--to.*--by"):
            jog(rig, JogOptions(to=1.0, by=1.0))
        assert len(device.axis.moves) == moves
        rig.write_text(rig.read_text(encoding="utf-8").replace("-3.0, 3.0", "0.0, 3.0"), encoding="utf-8")
        assert jog(rig, JogOptions(to=0.5, velocity=20.0)).stands_deg == 0.5  # from outside the travel


@pytest.mark.parametrize(
    ("key", "value"), [("to", math.nan), ("to", math.inf), ("by", math.nan), ("velocity", math.inf)]
)
def test_refuses_non_finite_jog(key: str, value: float) -> None:
    with pytest.raises(SpecError, match=rf"^{key} = .*finite"):
        JogOptions(**{key: value})


def test_summary_names_all_faulty_inputs() -> None:
    warnings = ranked(check_of(dead_emitter).warnings)
    assert len(warnings) == 2
    assert any("no input responds to emitter 2" in line for line in warnings)

    def all_dead(levels: Levels) -> None:
        levels.drop[:] = 0.0

    printed = " ".join(ranked(check_of(all_dead).warnings))
    assert all(name in printed for name in ("A right", "A left", "B right", "B left", "emitter 1 and 2"))
