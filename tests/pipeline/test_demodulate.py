"""`solen bench demodulate`: readings with uncertainties from tables with emitter states and from waveforms."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.analysis.demodulation import Demodulation, DemodulationOptions
from solen.arrays import FloatArray
from solen.cli import run_command
from solen.errors import DataError, OutputError, SpecError
from solen.pipeline.bench.demodulate import demodulate as outcome_of
from solen.recording import read
from solen.report.options import FigureOptions
from tests.analysis.switching_support import PERIOD_S, stream, waveform
from tests.command_support import answered


def demodulate(
    path: Path, options: DemodulationOptions = DemodulationOptions(), out: Path | None = None
) -> Demodulation:
    return outcome_of(path, options=options, out=out).result


def written(path: Path, header: str, *columns: Sequence[object] | FloatArray) -> Path:
    """Write a table and return its path."""
    rows = zip(*(list(column) for column in columns), strict=True)
    cells = ([f"{value:.9g}" if isinstance(value, float) else str(value) for value in row] for row in rows)
    path.write_text("\n".join([header, *map(",".join, cells)]) + "\n", encoding="utf-8")
    return path


def with_states(path: Path, header: str = "time_s,right (V),led", readings: int = 60, emitters: int = 1) -> Path:
    """Write a table of single samples with a column of emitter states."""
    time, values, state = stream(readings, lambda t: 4.0 - 0.5 * t, emitters)
    return written(path, header, time, values[:, 0], state.tolist())


def test_table_of_readings_can_be_read_again(tmp_path: Path) -> None:
    path = with_states(tmp_path / "a.csv", emitters=2)
    result = demodulate(path, out=tmp_path / "r.csv")
    assert result.method == "states"
    assert result.counts.readings == {1: 60, 2: 60}
    assert result.rate_hz == pytest.approx(200.0)
    table = read(tmp_path / "r.csv")
    assert table.channel("right").unit == "V"
    inner = slice(1, -1)
    emitter = table.channel("emitter").values
    assert table.channel("right").values[inner] == pytest.approx(-emitter[inner], abs=1e-8)
    assert table.channel("time").to("s")[2] == pytest.approx(PERIOD_S, abs=1e-6)
    assert set(table.names) == {"time", "emitter", "right", "u_right", "ambient_right", "clipped_right"}


@pytest.mark.parametrize(
    ("off", "on", "emitter"), [("off", "on", 1), ("dark", "emitter 2", 2), ("Aus", "E3", 3), ("OFF", "LED_1", 1)]
)
def test_recognises_names_of_states(tmp_path: Path, off: str, on: str, emitter: int) -> None:
    time, values, state = stream(20, np.zeros_like)
    path = written(
        tmp_path / "a.csv", "time_s,right (V),lamp", time, values[:, 0], [on if value else off for value in state]
    )
    assert demodulate(path, DemodulationOptions(state="lamp")).readings.emitters == (emitter,)


def test_uses_columns_in_volts_or_named_columns(tmp_path: Path) -> None:
    path = with_states(tmp_path / "a.csv", "time_s,right_V,state")
    assert list(demodulate(path).channels) == ["right"]
    without_unit = with_states(tmp_path / "b.csv", "time_s,receiver signal,state")
    with pytest.raises(SpecError, match="no column is in V"):
        demodulate(without_unit)
    options = DemodulationOptions(channel=("receiver signal",))
    assert list(demodulate(without_unit, options).channels) == ["receiver signal"]


def test_demodulates_a_waveform_by_its_edges(tmp_path: Path) -> None:
    time, values, _ = waveform(2.0, ppm=60.0, noise=0.002)
    lit = values + 0.2 * np.cos(2 * np.pi * 100.0 * time)[:, None] + 0.1 * time[:, None]
    path = written(tmp_path / "w.csv", "# simulated: yes\ntime_s,right (V),left (V)", time, lit[:, 0], lit[:, 1])
    options, figure = DemodulationOptions(rate_hz=200.0), tmp_path / "r.svg"
    result = outcome_of(path, options=options, out=tmp_path / "r.csv", figure=FigureOptions(figure=figure)).result
    assert result.method == "waveform"
    assert any("--on low" in line for line in result.warnings)
    specified = outcome_of(path, options=DemodulationOptions(rate_hz=200.0, on="low")).result
    assert not any("--on low" in line for line in specified.warnings)
    assert result.off_stated_ppm == pytest.approx(60.0, abs=30.0)
    assert result.readings_averaged is None
    assert result.flicker is not None
    assert result.flicker.mains_hz == pytest.approx(50.0, abs=0.01)
    for name, depth in (("right", -1.0), ("left", -0.5)):
        emitter = result.channels[name].emitters[1]
        assert emitter.mean == pytest.approx(depth, abs=3e-3)
        assert emitter.sd < 0.002  # without the flicker of 0.2 V
        assert emitter.u_reading < 0.01
    assert "simulated: w.csv" in figure.read_text(encoding="utf-8")
    assert read(tmp_path / "r.csv").provenance.simulated


def test_averages_single_samples_over_mains_periods(tmp_path: Path) -> None:
    time, values, state = stream(400, lambda t: 0.2 * np.cos(2 * np.pi * 100.0 * t))
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time, values[:, 0], state.tolist())
    result = demodulate(path, DemodulationOptions(mains_hz=50.0), tmp_path / "r.csv")
    assert (result.readings_averaged, result.flicker) == (4, None)
    assert result.channels["right"].emitters[1].sd < 1e-3
    assert read(tmp_path / "r.csv").channel("window").to("s")[0] == pytest.approx(0.02)


def test_reports_two_sided_and_one_sided_rejection(tmp_path: Path) -> None:
    rows = {row.frequency_hz: row for row in demodulate(with_states(tmp_path / "a.csv")).rejection}
    assert rows[100.0].two_sided_dB == pytest.approx(0.0, abs=1e-6)
    assert rows[100.0].one_sided_dB == pytest.approx(-3.01, abs=0.01)
    assert rows[1.0].two_sided_dB > 70.0


def test_detects_clipping(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    time, values, state = stream(400, lambda t: 4.0 + 0.8 * np.sin(2 * np.pi * t))
    clipped = np.minimum(values[:, 0] + 0.001 * rng.standard_normal(len(time)), 4.5)
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time, clipped, state.tolist())
    result = demodulate(path)
    assert 50 < result.counts.clipped < 300
    assert any("samples at a limit" in warning for warning in result.warnings)
    assert demodulate(path, DemodulationOptions(low=-10.0, high=10.0)).counts.clipped == 0


def test_warns_of_missing_slots(tmp_path: Path) -> None:
    time, values, state = stream(50, np.zeros_like)
    kept = np.ones(100, dtype=bool)
    kept[[20, 41, 51, 53]] = False
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time[kept], values[kept, 0], state[kept].tolist())
    warnings = " ".join(demodulate(path).warnings)
    assert "1 on slots of a regular sequence are missing" in warnings
    assert "1 on slots have no off slot near" in warnings


@pytest.mark.parametrize(
    ("options", "header", "error", "message"),
    [
        ({"on": "up"}, "", SpecError, "on = 'up'"),
        ({"kernel": "three"}, "", SpecError, "kernel = 'three'"),
        ({"emitters": 0}, "", SpecError, "emitters"),
        ({"mains_hz": -1.0}, "", SpecError, "mains_hz"),
        ({"settle_us": -1.0}, "", SpecError, "settle_us"),
        ({"state": "led", "rate_hz": 200.0}, "", SpecError, "--state"),
        ({"state": "lid"}, "", DataError, "did you mean led"),
        ({"time": "tine"}, "", DataError, "tine"),
        ({"channel": ("rihgt",)}, "", DataError, "did you mean right"),
        ({}, "time_s,right (V),other", SpecError, "as the emitter state, and no switching rate"),
        ({}, "moment,right (V),led", DataError, "has no column time"),
    ],
)
def test_refuses_invalid_options_and_columns(
    tmp_path: Path, options: dict[str, Any], header: str, error: type[Exception], message: str
) -> None:
    path = with_states(tmp_path / "a.csv", header or "time_s,right (V),led")
    with pytest.raises(error, match=message):
        demodulate(path, DemodulationOptions(**options), out=tmp_path / "r.csv")
    assert not (tmp_path / "r.csv").exists()


def test_refuses_an_unknown_state(tmp_path: Path) -> None:
    time, values, state = stream(5, np.zeros_like)
    names = ["on" if value else "off" for value in state]
    names[6] = "maybe"
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time, values[:, 0], names)
    with pytest.raises(DataError, match=r"state in row 7 = 'maybe'"):
        demodulate(path)
    halves = (0.5 * state).tolist()
    path = written(tmp_path / "b.csv", "time_s,right (V),state", time, values[:, 0], halves)
    with pytest.raises(DataError, match=r"state in row 1 = 0\.5; must be an integer"):
        demodulate(path)


def test_table_of_readings_contains_the_angle(tmp_path: Path) -> None:
    time, values, state = stream(40, np.zeros_like)
    path = written(
        tmp_path / "a.csv", "time_s,angle_deg,right (V),state", time, 3.0 * time - 1.0, values[:, 0], state.tolist()
    )
    demodulate(path, out=tmp_path / "r.csv")
    table = read(tmp_path / "r.csv")
    angle = table.need("angle")
    assert angle.unit == "deg"
    assert angle.values == pytest.approx(3.0 * table.channel("time").values - 1.0, abs=1e-6)
    assert "state" not in table.names


@pytest.mark.parametrize("on", ["low", "high"])
def test_warns_of_swapped_phases(tmp_path: Path, on: str) -> None:
    """The light of the emitter follows the motion, so the phase that varies is the on phase."""
    time, values, _ = waveform(2.0, noise=0.002)
    moving = 4.0 - (4.0 - values) * (0.6 + 0.4 * np.sin(2 * np.pi * time))[:, None]
    path = written(tmp_path / "w.csv", "time_s,right (V),left (V)", time, moving[:, 0], moving[:, 1])
    warnings = demodulate(path, DemodulationOptions(rate_hz=200.0, on=on)).warnings
    assert sum("may be swapped (check --on)" in warning for warning in warnings) == (on == "high")


def test_notes_flicker_that_the_switching_rate_hides(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 4.0, 1e-4)
    volts = 2.0 - 1.0 * ((time_s * 50.0) % 1.0 < 0.5) + 0.1 * np.sin(2.0 * np.pi * 100.0 * time_s)
    path = written(tmp_path / "w.csv", "time_s,right (V)", time_s, volts)
    result = demodulate(path, DemodulationOptions(rate_hz=50.0))
    assert result.flicker is None
    assert any("a mains frequency of 50 Hz cannot be distinguished" in note for note in result.warnings)


def test_refuses_settling_longer_than_a_phase(tmp_path: Path) -> None:
    time, values, _ = waveform(1.0, noise=0.002)
    path = written(tmp_path / "w.csv", "time_s,right (V)", time, values[:, 0])
    with pytest.raises(SpecError, match=r"leaves no sample of the shorter phase, which lasts 2[45]"):
        demodulate(path, DemodulationOptions(rate_hz=200.0, settle_us=2600.0))
    with pytest.raises(DataError, match="two readings from an emitter"):
        demodulate(with_states(tmp_path / "a.csv", readings=1), DemodulationOptions(mains_hz=50.0))


def test_refuses_other_formats_and_existing_files(tmp_path: Path) -> None:
    path = with_states(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("existing", encoding="utf-8")
    for name, limit in (("a.json", r"end in \.csv"), ("a.csv", "input file"), ("b.csv", "--force")):
        with pytest.raises(OutputError, match=limit):
            demodulate(path, out=tmp_path / name)


def test_command_prints_a_summary(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = with_states(tmp_path / "a.csv")
    command = ["bench", "demodulate", str(path), "--out", str(tmp_path / "r.csv")]
    assert run_command(command) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    assert "60 readings" in printed.out
    assert answered(capfd, *command, "--force")["sources"][0]["file"] == "a.csv"
