"""Clocks and slow lines: what they leave open is stated, and covers the hysteresis that they feign."""

import math
import time
from pathlib import Path

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.arrays import FloatArray
from solen.bench.clock import WallClock
from solen.bench.clock_fit import fit_clock
from solen.bench.gcs2 import Gcs2Stage
from solen.bench.journal import read_journal
from solen.bench.protocol import Protocol
from solen.bench.timing import Positions
from solen.errors import BenchError
from tests.bench.slow_wire_support import recorded

WINDOWS_S = 0.0156
STEPS = [(-3.0, 0.8), (0.0, 0.0), (3.0, 0.8), (0.0, 0.0)]


def protocol(**more: float) -> Protocol:
    step = [{"to_deg": to, "velocity_deg_per_s": 15.0, "hold_s": hold} for to, hold in STEPS]
    return Protocol(**{"name": "turns", "cycles": 3, "step": step} | more)


def timed(path: Path) -> dict[str, float]:
    with h5netcdf.File(path, "r") as file:
        return {name: float(file.attrs[name]) for name in file.attrs if name.endswith("_s") and name != "cut_short"}


CASES = [(step_s, trip_s, share) for step_s in (0.0, WINDOWS_S) for trip_s in (0.0, 0.008, 0.016, 0.030)
         for share in (0.5, 0.0, 1.0)]  # fmt: skip
ALWAYS = {(0.0, 0.016, 0.5), (0.0, 0.030, 0.0), (WINDOWS_S, 0.0, 0.5), (WINDOWS_S, 0.016, 1.0)}


@pytest.mark.parametrize(
    ("step_s", "trip_s", "share"),
    [case if case in ALWAYS else pytest.param(*case, marks=pytest.mark.evidence) for case in CASES],
)
def test_a_sensor_without_hysteresis_has_no_more_of_it_than_timing_is_stated_to_add(
    tmp_path: Path, step_s: float, trip_s: float, share: float
) -> None:
    run, _, _ = recorded(tmp_path, protocol(), round_trip_s=trip_s, share=share, step_s=step_s)
    found = study([run.path]).to_dict()["sensors"]["A"]["receivers"]["right"]
    told = timed(run.path)
    stated_percent = 100.0 * 2.0 * 15.0 * told["timing_bound_s"] / 6.0
    shown, where = found["hysteresis_percent"], f"clock step {1e3 * step_s:g} ms, round trip {1e3 * trip_s:g} ms"
    print(f"\n  {where}, {share:g} of it before: {shown:.3f} % FS, timing is stated to add {stated_percent:.2f} %")
    assert shown < max(0.5, stated_percent)
    if share == 0.5 and step_s == 0.0:
        assert found["hysteresis_percent"] < 0.05
    assert told["look_round_trip_s"] == pytest.approx(trip_s, abs=0.2 * step_s + 1e-9)
    assert told["clock_resolution_s"] == step_s
    warned = [line for line in run.warnings if "to a hysteresis" in line]
    assert bool(warned) == (step_s + trip_s > 0.0)
    assert all("15 deg/s" in line for line in warned)


def test_a_single_look_without_a_position_keeps_the_remark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    true, asked = Gcs2Stage.position, iter(range(10**6))
    monkeypatch.setattr(Gcs2Stage, "position", lambda self: math.nan if next(asked) == 60 else true(self))
    run, _, _ = recorded(tmp_path, protocol(), round_trip_s=0.016)
    with h5netcdf.File(run.path, "r") as file:
        assert np.isnan(file.variables["stage_position"][...]).sum() == 1
    assert any("to a hysteresis" in line for line in run.warnings)


def test_raw_and_corrected_stamps_are_kept(tmp_path: Path) -> None:
    run, _, stage = recorded(tmp_path, protocol(cycles=1), round_trip_s=0.016)
    with h5netcdf.File(run.path, "r") as file:
        at, bound, answer, position = (
            file.variables[f"stage_{name}"][...] for name in ("time_s", "bound_s", "answer_s", "position")
        )
        assert "board_us" in file.variables
    assert answer - at == pytest.approx(0.008)
    assert bound == pytest.approx(0.008)
    assert position == pytest.approx(stage.axis.positions(at), abs=1e-6)


def test_while_it_moves_the_stage_is_asked_where_it_is_and_nothing_else(tmp_path: Path) -> None:
    _, wire, stage = recorded(tmp_path, protocol(cycles=1), round_trip_s=0.016)
    for move in stage.axis.moves[2:]:
        cruise_s = move.begin_s + 0.05, move.begin_s + abs(move.target - move.start) / move.velocity
        asked = {data.split()[0] for at, data in wire.sent if cruise_s[0] < at < cruise_s[1]}
        assert asked == {b"POS?"}


def test_slow_cycles_follow_the_others(tmp_path: Path) -> None:
    slow = protocol(cycles=1, slow_cycles=1, slow_share=0.5)
    run, _, stage = recorded(tmp_path, slow, round_trip_s=0.0)
    assert [move.velocity for move in stage.axis.moves if move.target != move.start] == [15.0] * 4 + [7.5] * 4
    assert run.cycles == slow.all_cycles == 2
    assert slow.shortest_s == pytest.approx(2.0 + 2 * 1.6 + 0.8 + 1.6)
    with pytest.raises(BenchError, match=r"slow_share = 0\.5; .*slow_cycles"):
        protocol(slow_share=0.5)


def test_the_wall_clock_is_the_finest_and_knows_its_step() -> None:
    coarse = WallClock(3.0, lambda: math.floor(time.perf_counter() / WINDOWS_S) * WINDOWS_S)
    assert coarse.resolution_s == pytest.approx(WINDOWS_S)
    assert WallClock().resolution_s < 1e-3


@pytest.mark.parametrize("states_time", [True, False])
def test_exchanges_bound_the_delay_that_listening_leaves_unknown(states_time: bool) -> None:
    rng = np.random.default_rng(3)
    board_s: FloatArray = np.asarray(np.arange(1, 600) * 0.1, np.float64)
    came: FloatArray = np.asarray(7.0 + board_s + 0.012 + rng.exponential(0.004, len(board_s)))  # at least 12 ms late
    asked = np.linspace(8.0, 60.0, 30)
    out, back = 0.002 + rng.exponential(0.001, 30), 0.012 + rng.exponential(0.004, 30)
    read = asked + out - 7.0 if states_time else np.full(30, np.nan)
    line = fit_clock(board_s, came, np.stack([asked, asked + out + back, read], axis=1))
    assert line.bound_s is not None
    assert abs(line.begin_s - 7.0) <= line.bound_s < 0.01
    alone = fit_clock(board_s, came)
    assert alone.bound_s is None
    assert alone.begin_s == pytest.approx(7.012, abs=1e-3)


def test_looks_without_a_question_s_stamp_are_taken_as_they_came() -> None:
    old = np.zeros(2, np.dtype([("part", "<u2"), ("t_s", "<f8"), ("position", "<f8")]))
    old["t_s"], old["position"] = (1.0, 2.0), (0.0, 3.0)
    looks = Positions.of(old, 0.0)
    assert looks.at(np.array([1.5])) == pytest.approx(1.5)
    assert not looks.bound_s.any()


def test_what_a_journal_holds_of_clocks(tmp_path: Path) -> None:
    recorded(tmp_path, protocol(cycles=1), round_trip_s=0.008, step_s=WINDOWS_S)
    found = read_journal(tmp_path / "slow.journal")
    assert found.header["clock_resolution_s"] == WINDOWS_S
    assert (found.streams["stage"]["t_s"] >= found.streams["stage"]["sent_s"]).all()
    assert len(found.streams["exchange"]) >= 5
