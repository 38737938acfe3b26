"""Which column is the time, the angle and a receiver, by the headers that recorders and people write."""

from pathlib import Path

import numpy as np
import pytest

from solen.analysis import SignalOptions, Waveforms, waveforms
from solen.arrays import FloatArray
from solen.errors import DataError
from solen.recording import read

ROWS = np.column_stack([0.005 * np.arange(40), np.linspace(-3.0, 3.0, 40), np.linspace(1.0, 2.0, 40), np.full(40, 2.5)])


def taken(tmp_path: Path, header: str, rows: FloatArray = ROWS) -> Waveforms:
    path = tmp_path / "one.csv"
    text = "\n".join(",".join(f"{value:.7g}" for value in row) for row in rows)
    path.write_text(f"{header}\n{text}\n", encoding="utf-8")
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
def test_a_time_by_its_name_or_unit(tmp_path: Path, name: str) -> None:
    assert taken(tmp_path, f"{name},angle_deg,left_V,right_V").time_s == pytest.approx(ROWS[:, 0])


@pytest.mark.parametrize(("name", "scale"), [("t(ms)", 1e3), ("millis", 1e3), ("micros", 1e6), ("time_us", 1e6)])
def test_a_time_in_other_units(tmp_path: Path, name: str, scale: float) -> None:
    found = taken(tmp_path, f"{name},angle_deg,left_V,right_V", ROWS * [scale, 1.0, 1.0, 1.0])
    assert found.time_s == pytest.approx(ROWS[:, 0])


@pytest.mark.parametrize(
    ("name", "scale"),
    [
        *(("Winkel_deg", 1.0), ("theta", 1.0), ("Angle [°]", 1.0), ("rotation_angle", 1.0), ("stageAngle", 1.0)),
        *(("M-060 position (deg)", 1.0), ("Drehwinkel (°)", 1.0), ("rotation (degrees)", 1.0), ("phi", 1.0)),
        *(("angle (rad)", np.pi / 180.0), ("angle_mrad", 1e3 * np.pi / 180.0), ("angle (mdeg)", 1e3)),
    ],
)
def test_an_angle_by_its_name_or_unit(tmp_path: Path, name: str, scale: float) -> None:
    found = taken(tmp_path, f"time_s,{name},left_V,right_V", ROWS * [1.0, scale, 1.0, 1.0])
    assert found.angle_deg == pytest.approx(ROWS[:, 1], abs=1e-5)


@pytest.mark.parametrize(
    "names",
    ["VL,VR", "Vleft,Vright", "PD_L,PD_R", "PD1,PD2", "ch0,ch1", "Dev1/ai0,Dev1/ai1", "Voltage_0,Voltage_1", "A0,A1"],
)
def test_receivers_by_their_names(tmp_path: Path, names: str) -> None:
    found = taken(tmp_path, f"time_s,angle_deg,{names}")
    assert list(found.receivers) == names.split(",")
    assert found.volts == pytest.approx(ROWS[:, 2:])


def test_numbered_names_are_no_receivers_beside_volts(tmp_path: Path) -> None:
    assert taken(tmp_path, "time_s,angle_deg,left_V,ch1").receivers == ("left_V",)


def test_an_angle_in_counts_is_no_angle_in_degrees(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="specifies no unit and reaches 3000"):
        taken(tmp_path, "time_s,angle (counts),left_V,right_V", ROWS * [1.0, 1e3, 1.0, 1.0])


def test_an_angle_that_begins_anew_after_a_turn_is_counted_on(tmp_path: Path) -> None:
    rows = np.column_stack([ROWS[:, 0], ROWS[:, 1] % 360.0, ROWS[:, 2:]])
    found = taken(tmp_path, "time_s,angle_deg,left_V,right_V", rows)
    assert found.angle_deg == pytest.approx(ROWS[:, 1], abs=1e-4)
    assert any("jumps by a full rotation" in warning for warning in found.warnings)


def test_an_angle_about_the_half_turn_is_counted_on(tmp_path: Path) -> None:
    shown = (ROWS[:, 1] + 180.0 + 180.0) % 360.0 - 180.0
    found = taken(tmp_path, "time_s,angle_deg,left_V,right_V", np.column_stack([ROWS[:, 0], shown, ROWS[:, 2:]]))
    assert found.angle_deg is not None
    assert np.ptp(found.angle_deg) == pytest.approx(6.0, abs=1e-4)
