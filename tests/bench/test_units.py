"""A rig whose receivers are not read in volts: from the rig file to angles, every unit is that of the rig."""

import json
import re
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest

from solen.analysis import Study
from solen.analysis.calibration import Decoding
from solen.bench.check import CheckOptions, check
from solen.bench.record import RecordOptions, record
from solen.bench.rig import load_rig
from solen.errors import BenchError, DataError
from solen.pipeline.bench.analyse import analyse
from solen.pipeline.bench.calibrate import calibrate
from solen.pipeline.bench.decode import decode
from solen.pipeline.bench.table import table

VOLTS_PER_COUNT = 5.0 / 65536


def write_rig(bench: Path, unit: str, keys: str = "") -> Path:
    path = bench / f"rig-{unit}.toml"
    text = (bench / "rig.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("[board]\n", f'[board]\nunit = "{unit}"\n{keys}'), encoding="utf-8")
    return path


def volt_keys(data: Any) -> list[str]:
    """Return the keys at any depth that name volts."""
    if isinstance(data, list):
        return [key for value in data for key in volt_keys(value)]
    if not isinstance(data, dict):
        return []
    nested = [value for key, value in data.items() if key not in {"options", "sources"}]
    return [key for key in data if re.search(r"_V\d?(_|$)|volt", key)] + volt_keys(nested)


def record_with(bench: Path, rig: Path, name: str) -> Path:
    return record(bench / "protocol.toml", rig, bench / "out", RecordOptions(name=name)).path


@pytest.mark.parametrize(("unit", "keys", "per_count"), [("pF", "per_count = 0.001\n", 1e-3), ("counts", "", 1.0)])
def test_recording_and_analysis_have_unit_of_board(bench: Path, unit: str, keys: str, per_count: float) -> None:
    path = record_with(bench, write_rig(bench, unit, keys), "run")
    in_volts = record_with(bench, bench / "rig.toml", "volts")
    with h5netcdf.File(path, "r") as file:
        assert "voltage" not in file.variables
        assert file.variables["signal"].attrs["units"] == unit
        assert {file["A"][name].attrs["units"] for name in ("right", "left", "right_ambient")} == {unit}
    study, study_in_volts = (analyse(recording).result for recording in (path, in_volts))
    assert isinstance(study, Study)
    assert isinstance(study_in_volts, Study)
    assert study.unit == unit
    assert not volt_keys(study.to_dict())
    for name, receiver in study.sensors["A"].receivers.items():
        swing_V = study_in_volts.sensors["A"].receivers[name].swing_V
        assert receiver.swing_V == pytest.approx(per_count / VOLTS_PER_COUNT * swing_V, rel=1e-3)


def test_calibration_and_decoding_have_unit_of_board(bench: Path) -> None:
    text = (bench / "protocol.toml").read_text(encoding="utf-8").replace("cycles = 3", "cycles = 5")
    (bench / "protocol.toml").write_text(text, encoding="utf-8")
    rig = write_rig(bench, "pF", "per_count = 0.001\n")
    path, again, in_volts = (
        record_with(bench, rig_file, name)
        for name, rig_file in (("run", rig), ("again", rig), ("volts", bench / "rig.toml"))
    )
    outcome = calibrate(path)
    assert not volt_keys(outcome.to_dict())
    calibration = outcome.files["calibration.A"]
    assert not volt_keys(json.loads(calibration.read_text(encoding="utf-8")))
    decoded = decode(calibration, str(again)).result
    assert isinstance(decoded, Decoding)
    assert decoded.against_angle is not None
    assert decoded.against_angle.within_95 > 0.9
    with pytest.raises(DataError, match=r"readings in V, but the calibration .* is in pF"):
        decode(calibration, str(in_volts))
    live = decode(calibration, "-", text=["time_s,left (pF),right (pF)\n", *lines_of(again)]).result
    assert isinstance(live, Decoding)
    assert live.lowest_deg == pytest.approx(decoded.lowest_deg, abs=0.02)
    with pytest.raises(DataError, match=r"readings in V, but the calibration .* is in pF"):
        decode(calibration, "-", text=["time_s,left (mV),right (mV)\n", "0,1,2\n"])
    sources = table(calibration, bench / "code").files
    assert "in pF, ambient light subtracted" in sources["solen_decode.h"].read_text(encoding="utf-8")


def lines_of(path: Path) -> list[str]:
    with h5netcdf.File(path, "r") as file:
        rows = np.column_stack([file["A"][name][:] for name in ("time_s", "left", "right")])
    return [f"{a},{b},{c}\n" for a, b, c in rows.tolist()]


def test_check_has_unit_of_board(bench: Path) -> None:
    result = check(write_rig(bench, "lux", "per_count = 0.5\n"), CheckOptions(seconds=0.5))
    in_volts = check(bench / "rig.toml", CheckOptions(seconds=0.5))
    assert not volt_keys(result.to_dict())
    receiver = result.sensors["A"]["left"]
    assert receiver.signal_V == pytest.approx(0.5 / VOLTS_PER_COUNT * in_volts.sensors["A"]["left"].signal_V)
    assert receiver.load_factor is None
    assert result.faults == ()


@pytest.mark.parametrize(
    ("board", "message"),
    [
        ('unit = "pF"', "per_count; is missing; set it to the size of one count in pF"),
        ("per_count = 2.0", r"per_count = 2\.0.*unit other than V"),
        (
            'driver = "serial"\nport = "COM3"\nunit = "lux"\nper_count = 1.0\nrange_v = 5.0',
            r"range_v = 5\.0.*not for lux",
        ),
    ],
)
def test_size_of_count_is_specified_once(bench: Path, board: str, message: str) -> None:
    sensor = '[[sensor]]\nname = "A"\ndesign = "a.toml"\nemitter = 1\nright = 1\nleft = 2\n'
    (bench / "unit.toml").write_text(f'schema = 1\nname = "x"\n[board]\n{board}\n{sensor}', encoding="utf-8")
    with pytest.raises(BenchError, match=message):
        load_rig(bench / "unit.toml")
