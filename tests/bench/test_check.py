"""Before a run: a rig that is looked over, watched, and its stage moved."""

import io
import math
import re
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

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
    """Levels with all emitters off, and how far each pulls each input down: (emitters, inputs)."""

    off: FloatArray
    pull: FloatArray


def looked(change: Any = None, noise_V: float = 0.003) -> RigCheck:
    """A rig of two sensors, each pulling its own inputs from 4.8 V by 1.7 V, with something changed."""
    off, pull = np.full((2, 4), 4.8), np.zeros((2, 4))
    pull[0, :2] = pull[1, 2:] = 1.7
    made = None if change is None else change(Levels(off, pull))
    room = np.zeros(200) if made is None else made
    rng = np.random.default_rng(3)
    levels = np.minimum(off + room[:, None, None] + rng.normal(0.0, 1e-4, (200, 2, 4)), TOP_V)
    signal = pull + rng.normal(0.0, noise_V, (200, 2, 4))
    return rig_check(RIG, InputReadings(np.linspace(0.0, 0.995, 200), signal, levels, levels == TOP_V, 0.0, TOP_V))


def test_a_good_rig_has_no_faults() -> None:
    found = looked()
    assert found.faults == ()
    one = found.sensors["B"]["left"]
    assert (one.input, round(one.off_V, 2), round(one.signal_V, 2)) == (3, 4.8, 1.7)
    assert one.noise_V == pytest.approx(0.003, rel=0.2)
    assert np.array(found.answers_V) == pytest.approx(np.array([[1.7, 1.7, 0, 0], [0, 0, 1.7, 1.7]]), abs=2e-3)


def cut(at: Levels) -> None:
    at.pull[:, 1] = 0.0


def crossed(at: Levels) -> None:
    at.pull[:, [1, 2]] = at.pull[:, [2, 1]]


def crossed_and_leaking(at: Levels) -> None:
    crossed(at)
    at.pull[at.pull == 0.0] = 0.1


def dead(at: Levels) -> None:
    at.pull[1] = 0.0


def short(at: Levels) -> None:
    at.off[:, 0], at.pull[:, 0] = 0.004, 0.0


def swapped(at: Levels) -> None:
    at.pull[:, 3] *= -1.0


def bright(at: Levels) -> None:
    at.pull[0, 0] = 3.4


def dim(at: Levels) -> None:
    at.pull[0, 0] = 0.17


def beyond(at: Levels) -> None:
    at.off[:, 2] = 5.0


def lamps(_: Levels) -> Any:
    return 0.3 * (np.sin(np.arange(200) * 0.21) - 1.0)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (cut, [r"A left \(input 2\): do not use: responds to no emitter"]),
        (crossed, [r"A left .* responds to emitter 2, not to 1", r"B left \(input 3\): .* emitter 1, not to 2"]),
        (crossed_and_leaking, ["A left .* emitter 2, not to 1", "B left .* emitter 1, not to 2"]),
        (dead, ["B right .* no emitter", "B left .* no emitter", "no input responds to emitter 2"]),
        (short, [r"A right \(input 1\): do not use: .* near 0 V"]),
        (swapped, ["B right .* rises when its emitter is on"]),
        (bright, [r"A right .* 1.5 times the light.* smaller load"]),
        (dim, [r"A right .*: note: .* larger load"]),
        (beyond, [r"B left .* upper limit of the range in \d\d % of the readings"]),
        (lamps, ["varies by 21. mV with the emitters off; shade it"] * 4),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(change: Any, told: list[str]) -> None:
    found = looked(change).faults
    assert len(found) == len(told), found
    assert all(re.search(pattern, line) for pattern, line in zip(told, found, strict=True)), found


def test_a_shorted_input_has_no_share_of_a_level() -> None:
    def shorted(at: Levels) -> None:
        at.off[:, 1] = at.pull[:, 1] = 0.0

    found = looked(shorted)
    own = replace(found.sensors["A"]["left"], off_V=0.0, signal_V=0.0)
    assert any("is near 0 V" in line for line in found.faults)
    shown = "\n".join(lines(replace(found, sensors={"A": {"left": own}})))
    assert "0 V off" in shown
    assert "signal 0 V, noise" in shown


def test_a_trimmer_that_was_turned_as_advised_is_fine() -> None:
    factor = looked(bright).sensors["A"]["right"].load_factor
    assert factor is not None
    assert factor == pytest.approx(0.4 * 4.8 / 3.4, rel=1e-3)

    def turned(at: Levels) -> None:
        at.pull[0, 0] = 3.4 * factor

    assert looked(turned).faults == ()


@pytest.mark.parametrize("kind", ["board", "daq"])
def test_a_simulated_rig_is_looked_over_and_watched(bench: Path, kind: str) -> None:
    rig = bench / "rig.toml"
    if kind == "daq":
        text = rig.read_text(encoding="utf-8").replace("[board]\n", '[daq]\nswitching = "counter"\n')
        rig.write_text(text, encoding="utf-8")
    found = check(rig, CheckOptions(seconds=1.0))
    assert found.simulated
    assert found.faults == ()
    assert found.periods >= 195
    own = [found.answers_V[0][:2], found.answers_V[1][2:]]
    others = [found.answers_V[0][2:], found.answers_V[1][:2]]
    assert np.min(own) > 0.3
    assert np.abs(others).max() < 0.05
    seen: list[LiveReading] = []
    told = watch(rig, WatchOptions(seconds=0.5), seen.append)
    assert told.looks == len(seen) >= 4
    assert seen[0].signal_V["A"]["right"] == pytest.approx(found.sensors["A"]["right"].signal_V, abs=0.05)


def changed(bench: Path, *changes: tuple[str, str]) -> Path:
    """The small rig with something else in its file."""
    rig = bench / "rig.toml"
    text = rig.read_text(encoding="utf-8")
    for before, after in changes:
        assert before in text
        text = text.replace(before, after)
    rig.write_text(text, encoding="utf-8")
    return rig


def in_light(rig_file: Path) -> tuple[RigCheck, FloatArray]:
    """A rig that is looked over for 10 s, and the formula's noise of a reading: sensors by right and left."""
    rig = load_rig(rig_file)
    sensors = simulated_sensors(rig, rig_file.parent, TRACED_RANGE["deg"], np.random.default_rng([rig.seed, 0]))
    levels = [
        [noise(one.circuit, share, rig.ambient.mean_mw_cm2).before_V for share in (one.at(np.zeros(1))[0], np.zeros(2))]
        for one in sensors
    ]
    meant = [np.sqrt(on**2 + 0.5 * off**2) for on, off in levels]  # on less the mean of two
    return check(rig_file, CheckOptions(seconds=10.0)), np.array(meant)


def test_noise_is_that_of_the_formula(bench: Path) -> None:
    steady = ("flicker_percent = 20.0\ndrift_percent_per_min = 50.0", "")
    found, meant = in_light(changed(bench, steady, ("[board]\n", "[board]\nrange_v = 5.1\n")))
    shown = [[one.noise_V for one in sides.values()] for sides in found.sensors.values()]
    assert shown == pytest.approx(meant, rel=0.07)  # 2.2 % is one standard deviation of 1000 readings


@pytest.mark.parametrize("sampler", ["[board]\n", '[daq]\nswitching = "counter"\n'])
def test_noise_before_a_run_is_that_of_its_readings(bench: Path, sampler: str) -> None:
    lamps = ("[ambient]\n", "[ambient]\nflicker_hz = 99.0\n")  # it beats with the switching: every phase within 1 s
    rig = changed(bench, ("[board]\n", sampler), lamps)
    steps = PROTOCOL.replace("cycles = 3\nrest_s = 0.2", "cycles = 1\nrest_s = 5.0")
    (bench / "still.toml").write_text(steps, encoding="utf-8")
    path = record(bench / "still.toml", rig, bench / "out").path
    found = check(rig, CheckOptions(seconds=8.0))
    with h5netcdf.File(path, "r") as file:
        for name, sides in found.sensors.items():
            time_s = file[name]["time_s"][:]
            for side, own in sides.items():
                pieces = [file[name][side][:][(time_s > at) & (time_s < at + 0.8)] for at in (0.2, 1.2, 2.2, 3.2, 4.0)]
                lines = [np.polyval(np.polyfit(np.arange(len(one)), one, 1), np.arange(len(one))) for one in pieces]
                scatter = np.concatenate(pieces) - np.concatenate(lines)
                assert own.noise_V == pytest.approx(float(scatter.std()), rel=0.12)


@pytest.mark.evidence
@pytest.mark.parametrize("name", ["rig", "rig-bending", "rig-daq"])
def test_the_shipped_rigs_are_well(tmp_path: Path, name: str) -> None:
    new(tmp_path)
    assert check(tmp_path / f"{name}.toml").faults == ()


@pytest.mark.parametrize("setup", ['switching = "counter"', 'switching = "external"\nsync = "ai8"'])
def test_switching_slower_than_a_look_leaves_no_gaps(bench: Path, setup: str) -> None:
    rig = bench / "rig.toml"
    text = rig.read_text(encoding="utf-8").replace("[board]\n", f"[daq]\n{setup}\nswitch_hz = 12.5\n")
    rig.write_text(text, encoding="utf-8")
    found = check(rig, CheckOptions(seconds=2.0))
    assert found.periods >= 15
    assert np.isfinite(found.answers_V).all()
    seen: list[LiveReading] = []
    assert watch(rig, WatchOptions(seconds=1.0, every_s=0.02), seen.append).looks >= 3
    assert np.isfinite([[*one.signal_V["A"].values(), *one.off_V["B"].values()] for one in seen]).all()


def test_lines_that_are_watched_are_a_table(bench: Path) -> None:
    shown = io.StringIO()
    with redirect_stdout(shown):
        assert solen.cli.run_command(["bench", "watch", "--rig", str(bench / "rig.toml"), "--seconds", "0.5"]) == 0
    rows = shown.getvalue().splitlines()
    assert rows[0] == "time/s,A right/V,A left/V,B right/V,B left/V"
    assert len(rows[1].split(",")) == 5
    assert rows[-1].endswith("simulated")


def test_levels_where_a_converter_is_not_straight_are_warned_of(bench: Path) -> None:
    rig = changed(bench, ("[board]\n", "[board]\nstraight_v = [0.5, 4.9]\n"))
    found = check(rig, CheckOptions(seconds=0.5))
    assert len(found.faults) == 4  # in the dark they stand near 5 V
    assert all("beyond 0.5 to 4.9, where the converter is not linear" in line for line in found.faults)
    done = record(bench / "protocol.toml", rig, bench / "out")
    assert any("A: 100 % of the readings" in line and "not linear" in line for line in done.warnings)


@pytest.mark.parametrize("seconds", [0.05, 0.001])
def test_a_short_watch_has_a_look(bench: Path, seconds: float) -> None:
    seen: list[LiveReading] = []
    assert watch(bench / "rig.toml", WatchOptions(seconds=seconds), seen.append).looks == len(seen) == 1


def test_ctrl_c_ends_watching(bench: Path) -> None:
    def enough(_: LiveReading) -> None:
        raise KeyboardInterrupt

    assert watch(bench / "rig.toml", WatchOptions(), enough).looks == 1


def zaber(folder: Path, url: str, more: str = "") -> Path:
    path = folder / "stage.toml"
    stage = f'driver = "zaber"\nport = "{url}"\nsteps_per_unit = 4000.0\nhome = "here"\ntravel = [-3.0, 3.0]\n{more}'
    board = '[board]\ndriver = "serial"\nport = "COM3"\n'
    sensor = '[[sensor]]\nname = "A"\ndesign = "a.toml"\nemitter = 1\nright = 1\nleft = 2\n'
    path.write_text(f'schema = 1\nname = "x"\n[stage]\n{stage}{board}{sensor}', encoding="utf-8")
    return path


def test_a_stage_is_jogged_within_its_travel(tmp_path: Path) -> None:
    device = ZaberDevice(WallClock())
    with Served(device) as served:
        rig = zaber(tmp_path, served.url)
        assert jog(rig).stands_deg is None  # no zero was set
        assert jog(rig, JogOptions(to=1.0, velocity=20.0)).stands_deg == 1.0
        moved = jog(rig, JogOptions(by=-1.5, velocity=20.0))
        assert (moved.begun_deg, moved.stands_deg) == (1.0, -0.5)
        begun = len(device.axis.moves)
        assert jog(rig).stands_deg == -0.5
        for options in (JogOptions(to=3.5), JogOptions(by=4.0)):
            with pytest.raises(BenchError, match=r"3\.5; is outside the travel of the rig, -3 to 3"):
                jog(rig, options)
        with pytest.raises(SpecError, match="one of the two"):
            jog(rig, JogOptions(to=1.0, by=1.0))
        assert len(device.axis.moves) == begun
        rig.write_text(rig.read_text(encoding="utf-8").replace("-3.0, 3.0", "0.0, 3.0"), encoding="utf-8")
        assert jog(rig, JogOptions(to=0.5, velocity=20.0)).stands_deg == 0.5  # back from beyond


@pytest.mark.parametrize(
    ("key", "value"), [("to", math.nan), ("to", math.inf), ("by", math.nan), ("velocity", math.inf)]
)
def test_a_jog_takes_finite_numbers(key: str, value: float) -> None:
    with pytest.raises(SpecError, match=rf"^{key} = .*finite"):
        JogOptions(**{key: value})


def test_several_wires_are_all_named_to_a_reader() -> None:
    found = ranked(looked(dead).warnings)
    assert len(found) == 2
    assert any("no input responds to emitter 2" in line for line in found)

    def all_dead(at: Levels) -> None:
        at.pull[:] = 0.0

    shown = " ".join(ranked(looked(all_dead).warnings))
    assert all(name in shown for name in ("A right", "A left", "B right", "B left", "emitter 1 and 2"))
