"""A rig whose receivers count something else than volts: from the rig file to angles, nothing is called volts."""

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


def rig_in(bench: Path, unit: str, more: str = "") -> Path:
    path = bench / f"rig-{unit}.toml"
    text = (bench / "rig.toml").read_text(encoding="utf-8")
    path.write_text(text.replace("[board]\n", f'[board]\nunit = "{unit}"\n{more}'), encoding="utf-8")
    return path


def volts_keys(value: Any) -> list[str]:
    """Keys anywhere that name volts."""
    if isinstance(value, list):
        return [key for one in value for key in volts_keys(one)]
    if not isinstance(value, dict):
        return []
    own = [key for key in value if re.search(r"_V\d?(_|$)|volt", key)]
    return own + [key for name, one in value.items() if name not in {"options", "sources"} for key in volts_keys(one)]


@pytest.mark.parametrize(("unit", "more", "per_count"), [("pF", "per_count = 0.001\n", 1e-3), ("counts", "", 1.0)])
def test_a_board_in_another_unit_goes_from_rig_to_angles(bench: Path, unit: str, more: str, per_count: float) -> None:
    rig = rig_in(bench, unit, more)
    steps = (bench / "protocol.toml").read_text(encoding="utf-8").replace("cycles = 3", "cycles = 5")
    (bench / "protocol.toml").write_text(steps, encoding="utf-8")
    paths = {
        name: record(bench / "protocol.toml", one, bench / "out", RecordOptions(name=name)).path
        for name, one in (("own", rig), ("again", rig), ("volts", bench / "rig.toml"))
    }
    scale = per_count / VOLTS_PER_COUNT
    with h5netcdf.File(paths["own"], "r") as file:
        assert "voltage" not in file.variables
        assert file.variables["signal"].attrs["units"] == unit
        assert {file["A"][name].attrs["units"] for name in ("right", "left", "right_ambient")} == {unit}
    found, volts = (analyse(paths[name]).result for name in ("own", "volts"))
    assert isinstance(found, Study)
    assert isinstance(volts, Study)
    assert found.unit == unit
    assert not volts_keys(found.to_dict())
    for name, own in found.sensors["A"].receivers.items():
        assert own.swing_V == pytest.approx(scale * volts.sensors["A"].receivers[name].swing_V, rel=1e-3)
    made = calibrate(paths["own"])
    assert not volts_keys(made.to_dict())
    place = made.files["calibration.A"]
    assert not volts_keys(json.loads(place.read_text(encoding="utf-8")))
    decoded = decode(place, str(paths["again"])).result
    assert isinstance(decoded, Decoding)
    assert decoded.against_angle is not None
    assert decoded.against_angle.within_95 > 0.9
    with pytest.raises(DataError, match=rf"'V'; is the unit of the readings.* is {unit}"):
        decode(place, str(paths["volts"]))
    live = decode(place, "-", text=[f"time_s,left ({unit}),right ({unit})\n", *lines_of(paths["again"])]).result
    assert isinstance(live, Decoding)
    assert live.lowest_deg == pytest.approx(decoded.lowest_deg, abs=0.02)
    with pytest.raises(DataError, match=rf"of the readings.* is {unit}"):
        decode(place, "-", text=["time_s,left (mV),right (mV)\n", "0,1,2\n"])
    sources = table(place, bench / "code").files
    assert f"in {unit}, ambient light subtracted" in sources["solen_decode.h"].read_text(encoding="utf-8")


def lines_of(path: Path) -> list[str]:
    with h5netcdf.File(path, "r") as file:
        rows = np.column_stack([file["A"][name][:] for name in ("time_s", "left", "right")])
    return [f"{a},{b},{c}\n" for a, b, c in rows.tolist()]


def test_a_rig_in_another_unit_is_looked_over_in_it(bench: Path) -> None:
    found = check(rig_in(bench, "lux", "per_count = 0.5\n"), CheckOptions(seconds=0.5))
    volts = check(bench / "rig.toml", CheckOptions(seconds=0.5))
    scale = 0.5 / VOLTS_PER_COUNT
    assert not volts_keys(found.to_dict())
    own = found.sensors["A"]["left"]
    assert own.signal_V == pytest.approx(scale * volts.sensors["A"]["left"].signal_V)
    assert own.load_factor is None
    assert found.faults == ()


@pytest.mark.parametrize(
    ("board", "told"),
    [
        ('unit = "pF"', "per_count; must state the size of one count in pF"),
        ("per_count = 2.0", r"per_count = 2\.0.*units other than V"),
        (
            'driver = "serial"\nport = "COM3"\nunit = "lux"\nper_count = 1.0\nrange_v = 5.0',
            r"range_v = 5\.0.*not for lux",
        ),
    ],
)
def test_a_unit_states_what_a_count_is(bench: Path, board: str, told: str) -> None:
    sensor = '[[sensor]]\nname = "A"\ndesign = "a.toml"\nemitter = 1\nright = 1\nleft = 2\n'
    (bench / "own.toml").write_text(f'schema = 1\nname = "x"\n[board]\n{board}\n{sensor}', encoding="utf-8")
    with pytest.raises(BenchError, match=told):
        load_rig(bench / "own.toml")
