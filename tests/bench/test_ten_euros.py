"""A mount turned by hand and a Pico, all that there is: from the paper's protocol to its Fig. 4D, by the commands."""

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
name = "ten euros"
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
"""Of the circuit that `tests.bench.pty_support` simulates."""


def stops(step_deg: float, hold_s: float, cycles: int) -> str:
    """The paper's turn to 3 degrees on either side, in stops; it has six cycles of it."""
    to = [*np.arange(-step_deg, -3.01, -step_deg), *np.arange(-3 + step_deg, 3.01, step_deg)]
    to += [*np.arange(3 - step_deg, -0.01, -step_deg)]
    steps = "".join(
        f"[[step]]\nto_deg = {round(float(one), 3)}\nvelocity_deg_per_s = 15.0\nhold_s = {hold_s}\n" for one in to
    )
    return f'schema = 1\nname = "3 degrees in stops"\ncycles = {cycles}\nrest_s = {3.0 * hold_s}\n{steps}'


class Person:
    """Somebody at a terminal, who turns the mount where the program asks, beyond it and back, and presses Enter.

    It is what the program reads from and writes to.
    """

    def __init__(self, angle: Path) -> None:
        self._file, self._at = angle, 0.0
        self._lines: SimpleQueue[str] = SimpleQueue()
        self._put(0.0)

    def readline(self) -> str:
        return self._lines.get()

    def flush(self) -> None:
        """Nothing waits."""

    def write(self, line: str) -> None:
        if asked := re.search(r"to ([+-][\d.]+) deg", line):
            threading.Thread(target=self._turn, args=(float(asked[1]),), daemon=True).start()

    def _turn(self, target: float) -> None:
        for one in (*np.linspace(self._at, target, 4)[1:], target + 0.3, target):
            self._put(float(one))
            time.sleep(0.02)
        time.sleep(0.05)
        self._lines.put("\n")

    def _put(self, angle: float) -> None:
        new = self._file.with_suffix(".new")
        new.write_text(f"{angle!r}", encoding="utf-8")
        Path(new).replace(self._file)
        self._at = angle


def run_by_hand(bench: Path, protocol: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The recording of a run with somebody at the terminal."""
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
    """On less off of a receiver of the circuit; brighter is lower."""
    return np.asarray(-SWING_V / (1.0 + np.exp(PER_DEG * sign * angle_deg)))


def test_readings_at_stops_are_those_of_the_circuit(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = run_by_hand(bench, stops(1.5, 0.15, 1), monkeypatch)
    with h5netcdf.File(path, "r") as file:
        read = {name: file.groups["A"].variables[name][...] for name in ("angle_deg", "right", "left")}
    assert set(read["angle_deg"]) == {-3.0, -1.5, 0.0, 1.5, 3.0}  # and nothing of the way between them
    for side, sign in (("right", 1.0), ("left", -1.0)):
        assert read[side] == pytest.approx(circuit_V(read["angle_deg"], sign), abs=1e-3)


@pytest.mark.evidence
def test_a_hand_and_a_pico_draw_the_paper_s_figure(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, figure = run_by_hand(bench, stops(0.5, 0.2, CYCLES), monkeypatch), bench / "4D.svg"
    assert run_command(["bench", "analyse", str(path), "--figure", str(figure), "--quiet"]) == 0
    assert figure.stat().st_size > 10_000
    sensor = study([path]).to_dict()["sensors"]["A"]
    for side, sign in (("right", 1.0), ("left", -1.0)):
        found = sensor["receivers"][side]
        at = np.array(found["angle_deg"])
        stopped = np.abs(2.0 * at - np.round(2.0 * at)) < 0.04  # between stops the curve is a straight line
        off_mV = 1e3 * float(np.nanstd(np.array(found["mean_V"], float)[stopped] - circuit_V(at[stopped], sign)))
        hysteresis = found["hysteresis_percent"]
        print(f"\n  {side}: {off_mV:.2f} mV rms from the circuit's own at stops; hysteresis {hysteresis:.3f} % FS")
        assert stopped.sum() >= 11
        assert off_mV < 5.0
        assert hysteresis < 0.5
    assert sensor["cycles_used"] == CYCLES - 1  # the first is left out, as in the paper
