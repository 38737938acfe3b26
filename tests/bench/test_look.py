"""Before a run: a rig that is looked over, watched, and its stage moved."""

import io
import math
import re
from contextlib import redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import solen.cli
from solen.arrays import FloatArray
from solen.bench.check import CheckOptions, JogOptions, RigCheck, check, jog, judged
from solen.bench.clock import WallClock
from solen.bench.glance import Glance
from solen.bench.rig import Rig
from solen.bench.watch import Seen, WatchOptions, watch
from solen.errors import BenchError, SpecError
from solen.ranks import ranked
from tests.bench.wire_support import Served
from tests.bench.zaber_controller_support import ZaberDevice

SENSORS = (
    {"name": "A", "design": "a.toml", "emitter": 1, "right": 1, "left": 2},
    {"name": "B", "design": "a.toml", "emitter": 2, "right": 4, "left": 3},
)
RIG = Rig(name="two", sensor=SENSORS)


@dataclass
class Levels:
    """Levels with all emitters off, and how far each pulls each input down: (emitters, inputs)."""

    off: FloatArray
    pull: FloatArray


def looked(change: Any = None, noise: float = 0.003) -> RigCheck:
    """A rig of two sensors, each pulling its own inputs from 4.8 V by 1.7 V, with something changed."""
    off, pull = np.full((2, 4), 4.8), np.zeros((2, 4))
    pull[0, :2] = pull[1, 2:] = 1.7
    made = None if change is None else change(Levels(off, pull))
    room = np.zeros(200) if made is None else made
    rng = np.random.default_rng(3)
    levels = off + room[:, None, None]
    draws = [rng.normal(0.0, noise, (200, 2, 4)) for _ in range(2)]
    return judged(RIG, Glance(levels - pull + draws[0], levels + draws[1], 0.0, 5.0))


def test_a_good_rig_has_no_faults() -> None:
    found = looked()
    assert found.faults == ()
    one = found.sensors["B"]["left"]
    assert (one.input, round(one.off_V, 2), round(one.signal_V, 2)) == (3, 4.8, 1.7)
    assert one.noise_V == pytest.approx(0.003 * np.sqrt(2.0), rel=0.2)
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
    return 0.3 * np.sin(np.arange(200) * 0.21)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (cut, [r"A left \(input 2\) at 4.8 V: answers to no emitter"]),
        (crossed, [r"A left .* emitter 2 for 1: answers", r"B left \(input 3\), emitter 1 for 2: answers"]),
        (crossed_and_leaking, ["A left .* emitter 2 for 1: answers", "B left .* emitter 1 for 2: answers"]),
        (dead, ["B right .* no emitter", "B left .* no emitter", "no input sees emitter 2"]),
        (short, [r"A right \(input 1\) at 0.00\d+ V: stays"]),
        (swapped, ["B right .* rises with its emitter on"]),
        (bright, [r"A right .* down by 71 % .* 0.49 times its load: .* less load"]),
        (dim, [r"A right .* down by 4 % .* 9.9 times its load: .* more load"]),
        (beyond, ["B left .* upper end of the range"]),
        (lamps, ["21. mV: varies with the emitters off; shade it"] * 4),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(change: Any, told: list[str]) -> None:
    found = looked(change).faults
    assert len(found) == len(told), found
    assert all(re.search(pattern, line) for pattern, line in zip(told, found, strict=True)), found


def test_a_trimmer_that_was_turned_as_advised_is_fine() -> None:
    factor = looked(bright).sensors["A"]["right"].factor
    assert factor is not None

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
    assert found.periods >= (200 if kind == "board" else 18)
    own = [found.answers_V[0][:2], found.answers_V[1][2:]]
    others = [found.answers_V[0][2:], found.answers_V[1][:2]]
    assert np.min(own) > 0.3
    assert np.abs(others).max() < 0.05
    seen: list[Seen] = []
    told = watch(rig, WatchOptions(seconds=0.5), seen.append)
    assert told.looks == len(seen) >= 4
    assert seen[0].signal_V["A"][0] == pytest.approx(found.sensors["A"]["right"].signal_V, abs=0.05)


@pytest.mark.parametrize("setup", ['switching = "counter"', 'switching = "external"\nsync = "ai8"'])
def test_switching_slower_than_a_look_leaves_no_gaps(bench: Path, setup: str) -> None:
    rig = bench / "rig.toml"
    text = rig.read_text(encoding="utf-8").replace("[board]\n", f"[daq]\n{setup}\nswitch_hz = 12.5\n")
    rig.write_text(text, encoding="utf-8")
    found = check(rig, CheckOptions(seconds=2.0))
    assert found.periods >= 15
    assert np.isfinite(found.answers_V).all()
    seen: list[Seen] = []
    assert watch(rig, WatchOptions(seconds=1.0, every_s=0.02), seen.append).looks >= 3
    assert np.isfinite([one.signal_V["A"] + one.off_V["B"] for one in seen]).all()


def test_lines_that_are_watched_are_a_table(bench: Path) -> None:
    shown = io.StringIO()
    with redirect_stdout(shown):
        assert solen.cli.run_command(["bench", "watch", "--rig", str(bench / "rig.toml"), "--seconds", "0.5"]) == 0
    rows = shown.getvalue().splitlines()
    assert rows[0] == "time/s,A right/V,A left/V,B right/V,B left/V"
    assert len(rows[1].split(",")) == 5
    assert rows[-1].endswith("simulated")


def test_ctrl_c_ends_watching(bench: Path) -> None:
    def enough(_: Seen) -> None:
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
            with pytest.raises(BenchError, match=r"3\.5; is beyond travel in the rig, -3 to 3"):
                jog(rig, options)
        with pytest.raises(SpecError, match="give one of them"):
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
    assert any("no input sees emitter 2" in line for line in found)

    def all_dead(at: Levels) -> None:
        at.pull[:] = 0.0

    shown = " ".join(ranked(looked(all_dead).warnings))
    assert all(name in shown for name in ("A right", "A left", "B right", "B left", "emitter 1 and 2"))
