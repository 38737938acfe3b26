"""Recognition of the columns for time, angle and receivers by usual headers."""

from pathlib import Path

import numpy as np
import pytest

from solen.analysis import SignalOptions, Waveforms, waveforms
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording import read

ROWS = np.column_stack([0.005 * np.arange(40), np.linspace(-3.0, 3.0, 40), np.linspace(1.0, 2.0, 40), np.full(40, 2.5)])


def recognised(tmp_path: Path, header: str, rows: FloatArray = ROWS) -> Waveforms:
    """Return the waveforms of a table with a given header."""
    path = tmp_path / "S1.csv"
    body = "\n".join(",".join(f"{value:.7g}" for value in row) for row in rows)
    path.write_text(f"{header}\n{body}\n", encoding="utf-8")
    return waveforms(read(path), SignalOptions())[""]


@pytest.mark.parametrize(
    "name",
    [
        "Time [s]",
        "t",
        "t(s)",
        "Time/s",
        "Zeit [s]",
        "Elapsed Time (s)",
        "X_Value",
        "seconds",
        "Uhrzeit [s]",
        "tempo [s]",
    ],
)
def test_recognises_the_time_by_its_name_or_unit(tmp_path: Path, name: str) -> None:
    assert recognised(tmp_path, f"{name},angle_deg,left_V,right_V").time_s == pytest.approx(ROWS[:, 0])


@pytest.mark.parametrize(("name", "scale"), [("t(ms)", 1e3), ("millis", 1e3), ("micros", 1e6), ("time_us", 1e6)])
def test_converts_the_time(tmp_path: Path, name: str, scale: float) -> None:
    signals = recognised(tmp_path, f"{name},angle_deg,left_V,right_V", ROWS * [scale, 1.0, 1.0, 1.0])
    assert signals.time_s == pytest.approx(ROWS[:, 0])


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        *(("Winkel_deg", 1.0), ("theta", 1.0), ("Angle [°]", 1.0), ("rotation_angle", 1.0), ("stageAngle", 1.0)),
        *(("M-060 position (deg)", 1.0), ("Drehwinkel (°)", 1.0), ("rotation (degrees)", 1.0), ("phi", 1.0)),
        *(("angle (rad)", np.pi / 180.0), ("angle_mrad", 1e3 * np.pi / 180.0), ("angle (mdeg)", 1e3)),
    ],
)
def test_recognises_the_angle_by_its_name_or_unit(tmp_path: Path, name: str, scale: float) -> None:
    signals = recognised(tmp_path, f"time_s,{name},left_V,right_V", ROWS * [1.0, scale, 1.0, 1.0])
    assert signals.angle_deg == pytest.approx(ROWS[:, 1], abs=1e-5)


@pytest.mark.parametrize(
    "names",
    ["VL,VR", "Vleft,Vright", "PD_L,PD_R", "PD1,PD2", "ch0,ch1", "Dev1/ai0,Dev1/ai1", "Voltage_0,Voltage_1", "A0,A1"],
)
def test_recognises_receivers_by_their_names(tmp_path: Path, names: str) -> None:
    signals = recognised(tmp_path, f"time_s,angle_deg,{names}")
    assert list(signals.receivers) == names.split(",")
    assert signals.volts == pytest.approx(ROWS[:, 2:])


def test_numbered_columns_are_not_receivers_if_another_is_in_volts(tmp_path: Path) -> None:
    assert recognised(tmp_path, "time_s,angle_deg,left_V,ch1").receivers == ("left_V",)


def test_refuses_an_angle_in_counts(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="specifies no unit and reaches 3000"):
        recognised(tmp_path, "time_s,angle (counts),left_V,right_V", ROWS * [1.0, 1e3, 1.0, 1.0])


def test_unwraps_an_angle_that_jumps_from_360_to_0_deg(tmp_path: Path) -> None:
    rows = np.column_stack([ROWS[:, 0], ROWS[:, 1] % 360.0, ROWS[:, 2:]])
    signals = recognised(tmp_path, "time_s,angle_deg,left_V,right_V", rows)
    assert signals.angle_deg == pytest.approx(ROWS[:, 1], abs=1e-4)
    assert any("jumps by a full rotation" in warning for warning in signals.warnings)


def test_unwraps_an_angle_that_jumps_from_180_to_minus_180_deg(tmp_path: Path) -> None:
    wrapped = (ROWS[:, 1] + 180.0 + 180.0) % 360.0 - 180.0
    signals = recognised(
        tmp_path, "time_s,angle_deg,left_V,right_V", np.column_stack([ROWS[:, 0], wrapped, ROWS[:, 2:]])
    )
    assert signals.angle_deg is not None
    assert np.ptp(signals.angle_deg) == pytest.approx(6.0, abs=1e-4)
