"""A rig of a mount turned by hand and a Pico: from the paper's protocol to its Fig. 4D, by the commands."""

import re
import sys
import threading
import time
from pathlib import Path
from queue import SimpleQueue

import h5netcdf
import numpy as np
import pytest

from solen.analysis import study
from solen.arrays import FloatArray
from solen.bench.record import record
from solen.cli import run_command

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
RIG = """
schema = 1
name = "mount turned by hand"
[stage]
driver = "hand"
[board]
driver = "serial"
port = "{port}"
rate_hz = 100.0
bits = 16
range_v = 3.3
baud = 115200
[[sensor]]
name = "A"
design = "sensor.toml"
emitter = 1
right = 1
left = 2
"""
CYCLES = 6
SWING_V, PER_DEG = 2.4, 1.2
"""Swing and slope of the receivers that `tests.bench.pty_support` simulates."""


def protocol_with_stops(step_deg: float, hold_s: float, cycles: int) -> str:
    """Return the paper's rotation to 3 degrees on either side, with stops."""
    angles = [*np.arange(-step_deg, -3.01, -step_deg), *np.arange(-3 + step_deg, 3.01, step_deg)]
    angles += [*np.arange(3 - step_deg, -0.01, -step_deg)]
    steps = "".join(
        f"[[step]]\nto_deg = {round(float(angle), 3)}\nvelocity_deg_per_s = 15.0\nhold_s = {hold_s}\n"
        for angle in angles
    )
    return f'schema = 1\nname = "3 degrees in stops"\ncycles = {cycles}\nrest_s = {3.0 * hold_s}\n{steps}'


class Person:
    """Simulated person at the terminal, who turns the mount as the program asks, overshoots, and presses Enter.

    It replaces both the input and the output of the program.
    """

    def __init__(self, angle_file: Path) -> None:
        self._file, self._angle_deg = angle_file, 0.0
        self._lines: SimpleQueue[str] = SimpleQueue()
        self._set_angle(0.0)

    def readline(self) -> str:
        return self._lines.get()

    def flush(self) -> None:
        """Do nothing, as nothing is buffered."""

    def write(self, line: str) -> None:
        if request := re.search(r"to ([+-][\d.]+) deg", line):
            threading.Thread(target=self._turn, args=(float(request[1]),), daemon=True).start()

    def _turn(self, target_deg: float) -> None:
        for angle_deg in (*np.linspace(self._angle_deg, target_deg, 4)[1:], target_deg + 0.3, target_deg):
            self._set_angle(float(angle_deg))
            time.sleep(0.02)
        time.sleep(0.05)
        self._lines.put("\n")

    def _set_angle(self, angle_deg: float) -> None:
        new = self._file.with_suffix(".new")
        new.write_text(f"{angle_deg!r}", encoding="utf-8")
        new.replace(self._file)
        self._angle_deg = angle_deg


def record_by_hand(bench: Path, protocol: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Record a run with a mount turned by hand, and return the recording."""
    from tests.bench.pty_support import SlowClock, on_pty, pico

    angle, board = bench / "angle", bench / "pico"
    board.mkdir()
    person = Person(angle)
    with on_pty(pico(board), board, bench / "log", angle) as port, monkeypatch.context() as patch:
        (bench / "hand.toml").write_text(RIG.format(port=port), encoding="utf-8")
        (bench / "stops.toml").write_text(protocol, encoding="utf-8")
        patch.setattr("solen.bench.record.WallClock", SlowClock)
        patch.setattr("sys.stdin", person)
        patch.setattr("sys.stderr", person)
        run = record(bench / "stops.toml", bench / "hand.toml", bench / "out")
    assert run.outcome == "done"
    return run.path


def circuit_V(angle_deg: FloatArray, sign: float) -> FloatArray:
    """Return the voltage of a receiver with the emitter on minus off; the voltage falls with the light."""
    return np.asarray(-SWING_V / (1.0 + np.exp(PER_DEG * sign * angle_deg)))


def test_readings_at_stops_match_circuit(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = record_by_hand(bench, protocol_with_stops(1.5, 0.15, 1), monkeypatch)
    with h5netcdf.File(path, "r") as file:
        columns = {name: file.groups["A"].variables[name][...] for name in ("angle_deg", "right", "left")}
    assert set(columns["angle_deg"]) == {-3.0, -1.5, 0.0, 1.5, 3.0}  # and no reading during a motion
    for side, sign in (("right", 1.0), ("left", -1.0)):
        assert columns[side] == pytest.approx(circuit_V(columns["angle_deg"], sign), abs=1e-3)


@pytest.mark.evidence
def test_mount_turned_by_hand_gives_paper_figure(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = record_by_hand(bench, protocol_with_stops(0.5, 0.2, CYCLES), monkeypatch)
    figure = bench / "4D.svg"
    assert run_command(["bench", "analyse", str(path), "--figure", str(figure), "--quiet"]) == 0
    assert figure.stat().st_size > 10_000
    sensor = study([path]).to_dict()["sensors"]["A"]
    for side, sign in (("right", 1.0), ("left", -1.0)):
        curve = sensor["receivers"][side]
        angle_deg = np.array(curve["angle_deg"])
        at_stop = np.abs(2.0 * angle_deg - np.round(2.0 * angle_deg)) < 0.04  # the curve is interpolated between stops
        error_V = np.array(curve["mean_V"], float)[at_stop] - circuit_V(angle_deg[at_stop], sign)
        error_mV, hysteresis = 1e3 * float(np.nanstd(error_V)), curve["hysteresis_percent"]
        print(f"\n  {side}: error at the stops {error_mV:.2f} mV RMS; hysteresis {hysteresis:.3f} % FS")
        assert at_stop.sum() >= 11
        assert error_mV < 5.0
        assert hysteresis < 0.5
    assert sensor["cycles_used"] == CYCLES - 1  # the first is omitted, as in the paper
