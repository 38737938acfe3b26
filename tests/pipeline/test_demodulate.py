"""`solen bench demodulate`: tables with states or waveforms in, readings with uncertainties out."""

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


def written(path: Path, heads: str, *columns: Sequence[object] | FloatArray) -> Path:
    rows = zip(*(list(column) for column in columns), strict=True)
    text = [heads, *(",".join(f"{one:.9g}" if isinstance(one, float) else str(one) for one in row) for row in rows)]
    path.write_text("\n".join(text) + "\n", encoding="utf-8")
    return path


def with_states(path: Path, heads: str = "time_s,right (V),led", readings: int = 60, emitters: int = 1) -> Path:
    time, values, state = stream(readings, lambda t: 4.0 - 0.5 * t, emitters)
    return written(path, heads, time, values[:, 0], state.tolist())


def test_readings_come_back_as_they_were_made(tmp_path: Path) -> None:
    """The table of readings is read again by the same reader, with units and gaps."""
    path = with_states(tmp_path / "a.csv", emitters=2)
    found = demodulate(path, out=tmp_path / "r.csv")
    assert found.method == "states"
    assert found.counts.readings == {1: 60, 2: 60}
    assert found.rate_hz == pytest.approx(200.0)
    again = read(tmp_path / "r.csv")
    assert again.channel("right").unit == "V"
    inner = slice(1, -1)
    emitter = again.channel("emitter").values
    assert again.channel("right").values[inner] == pytest.approx(-emitter[inner], abs=1e-8)
    assert again.channel("time").to("s")[2] == pytest.approx(PERIOD_S, abs=1e-6)
    assert set(again.names) == {"time", "emitter", "right", "u_right", "ambient_right", "clipped_right"}


@pytest.mark.parametrize(
    ("words", "states"),
    [(("off", "on"), (0, 1)), (("dark", "emitter 2"), (0, 2)), (("Aus", "E3"), (0, 3)), (("OFF", "LED_1"), (0, 1))],
)
def test_states_may_be_words(tmp_path: Path, words: tuple[str, str], states: tuple[int, int]) -> None:
    time, values, state = stream(20, np.zeros_like)
    texts = [words[1] if one else words[0] for one in state]
    found = demodulate(
        written(tmp_path / "a.csv", "time_s,right (V),lamp", time, values[:, 0], texts),
        DemodulationOptions(state="lamp"),
    )
    assert found.readings.emitters == (states[1],)


def test_voltages_are_found_by_their_units_and_by_their_names(tmp_path: Path) -> None:
    path = with_states(tmp_path / "a.csv", "time_s,right_V,state")
    assert list(demodulate(path).channels) == ["right"]
    other = with_states(tmp_path / "b.csv", "time_s,signal of it,state")
    with pytest.raises(SpecError, match="no column is in V"):
        demodulate(other)
    assert list(demodulate(other, DemodulationOptions(channel=("signal of it",))).channels) == ["signal of it"]


def test_a_waveform_is_demodulated_by_its_own_edges(tmp_path: Path) -> None:
    time, values, _ = waveform(2.0, ppm=60.0, noise=0.002)
    shaken = values + 0.2 * np.cos(2 * np.pi * 100.0 * time)[:, None] + 0.1 * time[:, None]
    path = written(tmp_path / "w.csv", "# simulated: yes\ntime_s,right (V),left (V)", time, shaken[:, 0], shaken[:, 1])
    options = DemodulationOptions(rate_hz=200.0)
    found = outcome_of(
        path, options=options, out=tmp_path / "r.csv", figure=FigureOptions(figure=tmp_path / "r.svg")
    ).result
    assert found.method == "waveform"
    assert any("--on low" in line for line in found.warnings)
    stated = outcome_of(path, options=DemodulationOptions(rate_hz=200.0, on="low")).result
    assert not any("--on low" in line for line in stated.warnings)
    assert found.off_stated_ppm == pytest.approx(60.0, abs=30.0)
    assert found.readings_averaged is None
    assert found.flicker is not None
    assert found.flicker.mains_hz == pytest.approx(50.0, abs=0.01)
    for name, depth in (("right", -1.0), ("left", -0.5)):
        one = found.channels[name].emitters[1]
        assert one.mean == pytest.approx(depth, abs=3e-3)
        assert one.sd < 0.002, "0.2 V of flicker are gone"
        assert one.u_reading < 0.01
    drawn = (tmp_path / "r.svg").read_text(encoding="utf-8")
    assert "simulated: w.csv" in drawn
    assert read(tmp_path / "r.csv").provenance.simulated


def test_single_samples_in_a_slot_are_averaged_over_periods_of_the_mains(tmp_path: Path) -> None:
    time, values, state = stream(400, lambda t: 0.2 * np.cos(2 * np.pi * 100.0 * t))
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time, values[:, 0], state.tolist())
    found = demodulate(path, DemodulationOptions(mains_hz=50.0), tmp_path / "r.csv")
    assert (found.readings_averaged, found.flicker) == (4, None)
    assert found.channels["right"].emitters[1].sd < 1e-3
    assert read(tmp_path / "r.csv").channel("window").to("s")[0] == pytest.approx(0.02)


def test_the_rejection_is_stated_beside_the_one_sided(tmp_path: Path) -> None:
    rows = {row.frequency_hz: row for row in demodulate(with_states(tmp_path / "a.csv")).rejection}
    assert rows[100.0].two_sided_dB == pytest.approx(0.0, abs=1e-6)
    assert rows[100.0].one_sided_dB == pytest.approx(-3.01, abs=0.01)
    assert rows[1.0].two_sided_dB > 70.0


def test_clipping_is_found_and_reported(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    time, values, state = stream(400, lambda t: 4.0 + 0.8 * np.sin(2 * np.pi * t))
    noisy = np.minimum(values[:, 0] + 0.001 * rng.standard_normal(len(time)), 4.5)
    found = demodulate(
        written(tmp_path / "a.csv", "time_s,right (V),state", time, noisy, state.tolist()), DemodulationOptions()
    )
    assert 50 < found.counts.clipped < 300
    assert any("samples at a limit" in one for one in found.warnings)
    free = demodulate(tmp_path / "a.csv", DemodulationOptions(low=-10.0, high=10.0))
    assert free.counts.clipped == 0


def test_missing_slots_are_reported(tmp_path: Path) -> None:
    time, values, state = stream(50, np.zeros_like)
    kept = np.ones(100, dtype=bool)
    kept[[20, 41, 51, 53]] = False
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time[kept], values[kept, 0], state[kept].tolist())
    told = " ".join(demodulate(path).warnings)
    assert "1 on slots of a regular sequence are missing" in told
    assert "1 on slots have no off slot near" in told


@pytest.mark.parametrize(
    ("options", "heads", "error", "words"),
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
        ({}, "time_s,right (V),other", SpecError, "no state column, and no switching rate"),
        ({}, "moment,right (V),led", DataError, "has no column time"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, options: dict[str, Any], heads: str, error: type[Exception], words: str
) -> None:
    path = with_states(tmp_path / "a.csv", heads or "time_s,right (V),led")
    with pytest.raises(error) as refusal:
        demodulate(path, DemodulationOptions(**options), out=tmp_path / "r.csv")
    assert words in str(refusal.value)
    assert not (tmp_path / "r.csv").exists()


def test_a_state_that_is_none_is_named_with_its_row(tmp_path: Path) -> None:
    time, values, state = stream(5, np.zeros_like)
    texts = ["on" if one else "off" for one in state]
    texts[6] = "maybe"
    path = written(tmp_path / "a.csv", "time_s,right (V),state", time, values[:, 0], texts)
    with pytest.raises(DataError, match=r"state in row 7 = 'maybe'"):
        demodulate(path)
    path = written(
        tmp_path / "b.csv", "time_s,right (V),state", time, values[:, 0], [0.5 * one for one in state.tolist()]
    )
    with pytest.raises(DataError, match=r"state in row 1 = 0\.5; must be an integer"):
        demodulate(path)


def test_the_angle_goes_along(tmp_path: Path) -> None:
    """What else was recorded stands beside the readings at their times, for the analysis of the response."""
    time, values, state = stream(40, np.zeros_like)
    path = written(
        tmp_path / "a.csv", "time_s,angle_deg,right (V),state", time, 3.0 * time - 1.0, values[:, 0], state.tolist()
    )
    demodulate(path, out=tmp_path / "r.csv")
    again = read(tmp_path / "r.csv")
    angle = again.need("angle")
    assert angle.unit == "deg"
    assert angle.values == pytest.approx(3.0 * again.channel("time").values - 1.0, abs=1e-6)
    assert "state" not in again.names


@pytest.mark.parametrize("on", ["low", "high"])
def test_swapped_phases_are_reported(tmp_path: Path, on: str) -> None:
    """The emitter's light follows the motion, the room hardly moves: what varies must be the on phase."""
    time, values, _ = waveform(2.0, noise=0.002)
    moved = 4.0 - (4.0 - values) * (0.6 + 0.4 * np.sin(2 * np.pi * time))[:, None]
    path = written(tmp_path / "w.csv", "time_s,right (V),left (V)", time, moved[:, 0], moved[:, 1])
    told = [
        one
        for one in demodulate(path, DemodulationOptions(rate_hz=200.0, on=on)).warnings
        if "may be swapped (check --on)" in one
    ]
    assert len(told) == (on == "high")


def test_notes_flicker_that_the_switching_rate_hides(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 4.0, 1e-4)
    volts = 2.0 - 1.0 * ((time_s * 50.0) % 1.0 < 0.5) + 0.1 * np.sin(2.0 * np.pi * 100.0 * time_s)
    path = written(tmp_path / "w.csv", "time_s,right (V)", time_s, volts)
    result = demodulate(path, DemodulationOptions(rate_hz=50.0))
    assert result.flicker is None
    assert any("a mains frequency of 50 Hz cannot be distinguished" in text for text in result.warnings)


def test_settling_longer_than_a_phase_is_refused(tmp_path: Path) -> None:
    time, values, _ = waveform(1.0, noise=0.002)
    path = written(tmp_path / "w.csv", "time_s,right (V)", time, values[:, 0])
    with pytest.raises(SpecError, match=r"leaves no sample of the shorter phase, which lasts 2[45]"):
        demodulate(path, DemodulationOptions(rate_hz=200.0, settle_us=2600.0))
    with pytest.raises(DataError, match="two readings from an emitter"):
        demodulate(with_states(tmp_path / "a.csv", readings=1), DemodulationOptions(mains_hz=50.0))


def test_readings_are_written_as_csv_and_over_nothing_that_is_there(tmp_path: Path) -> None:
    path = with_states(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("measured once", encoding="utf-8")
    for name, limit in (("a.json", r"end in \.csv"), ("a.csv", "input file"), ("b.csv", "--force")):
        with pytest.raises(OutputError, match=limit):
            demodulate(path, out=tmp_path / name)


def test_the_command(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = with_states(tmp_path / "a.csv")
    command = ["bench", "demodulate", str(path), "--out", str(tmp_path / "r.csv")]
    assert run_command(command) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    assert "60 readings" in printed.out
    assert answered(capfd, *command, "--force")["sources"][0]["file"] == "a.csv"
