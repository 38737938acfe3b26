"""An hour of four sensors is recorded and analysed within the specified memory."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.analysis.demodulation import slots_of, subtract
from solen.bench.readings import BoardAdc, demodulated
from solen.bench.simulated.stage import Axis
from solen.pipeline.bench.record import new


def test_single_position_of_axis_equals_array_of_positions() -> None:
    axis = Axis(200.0, 0.25)
    assert axis.at(3.0) == 0.25
    for at_s, target in ((0.5, -3.0), (1.0, 3.0), (1.1, 2.9), (3.0, 2.999), (4.0, 2.999)):
        axis.send(at_s, target, 15.0)
    axis.halt(4.5)
    time_s = np.sort(np.random.default_rng(1).uniform(0.0, 6.0, 4000))
    assert [axis.at(at_s) for at_s in time_s.tolist()] == pytest.approx(axis.positions(time_s), abs=1e-12)


@pytest.mark.parametrize(("emitters", "emitter"), [(1, 1), (2, 1), (4, 1), (4, 3), (4, 4)])
def test_demodulation_of_one_emitter_equals_that_of_all(emitters: int, emitter: int) -> None:
    rng, periods = np.random.default_rng(2), 60
    counts = rng.integers(0, 65536, (periods, emitters, 2, 4), dtype=np.uint16)
    time_s = np.delete(np.arange(periods + 3) * 0.005, [20, 21, 40])  # three periods are lost
    readings = demodulated(counts, time_s, emitter, [2, 1], BoardAdc(0.005, 5.0 / 65536, 65535))
    phases = 2 * emitters
    phase_s = (time_s[:, None] + (np.arange(phases) + 1.0) / phases * 0.005).ravel()
    state = np.tile(np.where(np.arange(phases) % 2, 0, 1 + np.arange(phases) // 2), periods)
    volts = counts.reshape(-1, 4)[:, [2, 1]] * np.float64(5.0 / 65536)
    of_all = subtract(slots_of(phase_s, volts.astype(np.float64), state))
    selected = of_all.of(emitter)
    assert np.array_equal(readings.time_s, of_all.time_s[selected])
    assert np.array_equal(readings.signal, of_all.signal[selected])
    assert np.array_equal(readings.ambient, of_all.ambient[selected])


def run_measured(*words: str | Path) -> tuple[Any, float, float]:
    """Run a command, and return its JSON, its wall time in s and its peak memory in MB."""
    command = [sys.executable, "-m", "solen", *map(str, words), "--json"]
    begin_s = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, encoding="utf-8") as child:
        assert child.stdout is not None
        stdout = child.stdout.read()
        _, status, used = os.wait4(child.pid, 0)  # type: ignore[attr-defined, unused-ignore]  # POSIX only
        child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0
    unit = 2**20 if sys.platform == "darwin" else 2**10
    return json.loads(stdout), time.monotonic() - begin_s, used.ru_maxrss / unit


@pytest.mark.evidence
@pytest.mark.skipif(sys.platform == "win32", reason="there is no wait4")
def test_hour_of_four_sensors_takes_less_than_500_MB(tmp_path: Path) -> None:
    new(tmp_path)
    protocol = (tmp_path / "rotation.toml").read_text(encoding="utf-8")
    (tmp_path / "hour.toml").write_text(protocol.replace("cycles = 6", "cycles = 1324"), encoding="utf-8")
    run = ("bench", "run", tmp_path / "hour.toml", "--rig", tmp_path / "rig.toml", "--out", tmp_path / "out")
    recording, record_s, record_mb = run_measured(*run)
    analysis, analyse_s, analyse_mb = run_measured("bench", "analyse", recording["files"]["recording"])
    size_mb = Path(recording["files"]["recording"]).stat().st_size / 1e6
    print(
        f"\n  {recording['periods']} periods ({recording['duration_s']:.0f} s) of {len(recording['sensors'])} sensors:"
        f" recorded in {record_s:.1f} s and {record_mb:.0f} MB ({size_mb:.0f} MB on disk),"
        f" analysed in {analyse_s:.1f} s and {analyse_mb:.0f} MB"
    )
    assert recording["duration_s"] >= 3600.0
    assert (recording["cycles"], len(analysis["sensors"])) == (1326, 4)  # two of the cycles are slow
    assert max(record_mb, analyse_mb) < 500.0
