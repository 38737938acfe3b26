"""Clocks and slow lines: the bound on timing errors covers the apparent hysteresis that they cause."""

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
from tests.bench.slow_wire_support import record_slow

WINDOWS_S = 0.0156
"""Step of the system tick of Windows in s."""
STEPS = [(-3.0, 0.8), (0.0, 0.0), (3.0, 0.8), (0.0, 0.0)]


def protocol(**options: float) -> Protocol:
    step = [{"to_deg": to, "velocity_deg_per_s": 15.0, "hold_s": hold} for to, hold in STEPS]
    return Protocol(**{"name": "turns", "cycles": 3, "step": step} | options)


def timing_of(path: Path) -> dict[str, float]:
    with h5netcdf.File(path, "r") as file:
        return {name: float(file.attrs[name]) for name in file.attrs if name.endswith("_s") and name != "cut_short"}


CASES = [
    (step_s, round_trip_s, query_fraction)
    for step_s in (0.0, WINDOWS_S)
    for round_trip_s in (0.0, 0.008, 0.016, 0.030)
    for query_fraction in (0.5, 0.0, 1.0)
]
DEFAULT_CASES = {(0.0, 0.016, 0.5), (0.0, 0.030, 0.0), (WINDOWS_S, 0.0, 0.5), (WINDOWS_S, 0.016, 1.0)}


@pytest.mark.parametrize(
    ("step_s", "round_trip_s", "query_fraction"),
    [case if case in DEFAULT_CASES else pytest.param(*case, marks=pytest.mark.evidence) for case in CASES],
)
def test_timing_bound_covers_apparent_hysteresis(
    tmp_path: Path, step_s: float, round_trip_s: float, query_fraction: float
) -> None:
    run, _, _ = record_slow(
        tmp_path, protocol(), round_trip_s=round_trip_s, query_fraction=query_fraction, step_s=step_s
    )
    hysteresis = study([run.path]).to_dict()["sensors"]["A"]["receivers"]["right"]["hysteresis_percent"]
    timing = timing_of(run.path)
    bound = 100.0 * 2.0 * 15.0 * timing["timing_bound_s"] / 6.0
    print(f"\n  clock step {1e3 * step_s:g} ms, round trip {1e3 * round_trip_s:g} ms, {query_fraction:g} of it for the")
    print(f"  query: hysteresis {hysteresis:.3f} % FS; bound from timing {bound:.2f} %")
    assert hysteresis < max(0.5, bound)
    if query_fraction == 0.5 and step_s == 0.0:
        assert hysteresis < 0.05
    assert timing["look_round_trip_s"] == pytest.approx(round_trip_s, abs=0.2 * step_s + 1e-9)
    assert timing["clock_resolution_s"] == step_s
    warnings = [line for line in run.warnings if "to hysteresis" in line]
    assert bool(warnings) == (step_s + round_trip_s > 0.0)
    assert all("15 deg/s" in line for line in warnings)


def test_warns_of_timing_although_one_position_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    position, calls = Gcs2Stage.position, iter(range(10**6))
    monkeypatch.setattr(Gcs2Stage, "position", lambda self: math.nan if next(calls) == 60 else position(self))
    run, _, _ = record_slow(tmp_path, protocol(), round_trip_s=0.016)
    with h5netcdf.File(run.path, "r") as file:
        assert np.isnan(file.variables["stage_position"][...]).sum() == 1
    assert any("to hysteresis" in line for line in run.warnings)


def test_recording_contains_raw_and_corrected_times(tmp_path: Path) -> None:
    run, _, stage = record_slow(tmp_path, protocol(cycles=1), round_trip_s=0.016)
    with h5netcdf.File(run.path, "r") as file:
        time_s, bound_s, reply_s, position = (
            file.variables[f"stage_{name}"][...] for name in ("time_s", "bound_s", "answer_s", "position")
        )
        assert "board_us" in file.variables
    assert reply_s - time_s == pytest.approx(0.008)
    assert bound_s == pytest.approx(0.008)
    assert position == pytest.approx(stage.axis.positions(time_s), abs=1e-6)


def test_queries_only_position_during_move(tmp_path: Path) -> None:
    _, wire, stage = record_slow(tmp_path, protocol(cycles=1), round_trip_s=0.016)
    for move in stage.axis.moves[2:]:
        begin_s, end_s = move.begin_s + 0.05, move.begin_s + abs(move.target - move.start) / move.velocity
        assert {data.split()[0] for at_s, data in wire.sent if begin_s < at_s < end_s} == {b"POS?"}


def test_slow_cycles_follow_other_cycles(tmp_path: Path) -> None:
    slow = protocol(cycles=1, slow_cycles=1, slow_share=0.5)
    run, _, stage = record_slow(tmp_path, slow, round_trip_s=0.0)
    assert [move.velocity for move in stage.axis.moves if move.target != move.start] == [15.0] * 4 + [7.5] * 4
    assert run.cycles == slow.all_cycles == 2
    assert slow.shortest_s == pytest.approx(2.0 + 2 * 1.6 + 0.8 + 1.6)
    with pytest.raises(BenchError, match=r"slow_share = 0\.5; .*slow_cycles"):
        protocol(slow_share=0.5)


def test_wall_clock_determines_its_resolution() -> None:
    coarse = WallClock(3.0, lambda: math.floor(time.perf_counter() / WINDOWS_S) * WINDOWS_S)
    assert coarse.resolution_s == pytest.approx(WINDOWS_S)
    assert WallClock().resolution_s < 1e-3


@pytest.mark.parametrize("with_board_time", [True, False])
def test_exchanges_bound_clock_offset(with_board_time: bool) -> None:
    rng = np.random.default_rng(3)
    board_s: FloatArray = np.asarray(np.arange(1, 600) * 0.1, np.float64)
    arrival_s: FloatArray = np.asarray(7.0 + board_s + 0.012 + rng.exponential(0.004, len(board_s)))
    sent_s = np.linspace(8.0, 60.0, 30)
    query_s, reply_s = 0.002 + rng.exponential(0.001, 30), 0.012 + rng.exponential(0.004, 30)
    read_s = sent_s + query_s - 7.0 if with_board_time else np.full(30, np.nan)
    line = fit_clock(board_s, arrival_s, np.stack([sent_s, sent_s + query_s + reply_s, read_s], axis=1))
    assert line.bound_s is not None
    assert abs(line.begin_s - 7.0) <= line.bound_s < 0.01
    without_exchanges = fit_clock(board_s, arrival_s)
    assert without_exchanges.bound_s is None
    assert without_exchanges.begin_s == pytest.approx(7.012, abs=1e-3)


def test_positions_of_old_journals_have_time_of_reply() -> None:
    rows = np.zeros(2, np.dtype([("part", "<u2"), ("t_s", "<f8"), ("position", "<f8")]))
    rows["t_s"], rows["position"] = (1.0, 2.0), (0.0, 3.0)
    positions = Positions.of(rows, 0.0)
    assert positions.at(np.array([1.5])) == pytest.approx(1.5)
    assert not positions.bound_s.any()


def test_journal_contains_clock_data(tmp_path: Path) -> None:
    record_slow(tmp_path, protocol(cycles=1), round_trip_s=0.008, step_s=WINDOWS_S)
    content = read_journal(tmp_path / "slow.journal")
    assert content.header["clock_resolution_s"] == WINDOWS_S
    assert (content.streams["stage"]["t_s"] >= content.streams["stage"]["sent_s"]).all()
    assert len(content.streams["exchange"]) >= 5
