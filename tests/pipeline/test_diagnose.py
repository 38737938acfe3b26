"""`solen bench diagnose` on files; the traced response is replaced by one in closed form."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from solen.analysis import study
from solen.analysis.diagnosis import DiagnosisOptions, Response, SensorDiagnoses, diagnosed_sensors
from solen.arrays import FloatArray
from solen.cli import run_command
from solen.errors import DataError, SpecError
from solen.spec import loads
from tests.analysis.diagnosis_support import Lit, integral, response
from tests.analysis.simulated_support import made
from tests.command_support import answered

DESIGN = 'schema = 1\nname = "one"\n[material]\nindex = 1.44\n[emitter]\nwidth_mm = 0.2\n'
DRAWN = {"emitter.offset_mm": 0.02, "emitter.width_mm": 0.2}


@pytest.fixture(autouse=True)
def closed_form(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """No design is traced, but for evidence."""
    if request.node.get_closest_marker("evidence") is not None:
        return
    found = response()
    monkeypatch.setattr(Response, "of", lambda *_: found)


@pytest.fixture
def design(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.toml"
    path.write_text(DESIGN, encoding="utf-8")
    return path


def table(path: Path, lit: Lit, header: str = "time_s,angle_deg,left_V,right_V") -> Path:
    signals = made(lit)
    rows = np.column_stack([signals.time_s, signals.angle_deg, signals.volts]).tolist()
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def bench(path: Path, lit: Lit, design: str = DESIGN) -> Path:
    """As a bench run leaves it: a group for each sensor, the design in the header."""
    signals = made(lit)
    sensors = [{"name": "lens-1", "design": "sensor.toml", "lens": True, "drawn": DRAWN}]
    with h5py.File(path, "w") as file:
        file.attrs["simulated"] = "yes"
        file.attrs["header"] = json.dumps({"simulated": True, "designs": {"sensor.toml": design}, "sensors": sensors})
        group = file.create_group("lens-1")
        group.attrs["sensor"], group.attrs["lens"] = "lens-1", "yes"
        room = np.full(signals.time_s.size, 4.98)
        columns = {"right": signals.volts[:, 1] - 5.0, "left": signals.volts[:, 0] - 5.0}
        units = {"time_s": "s", "angle_deg": "deg"}
        values = {"time_s": signals.time_s, "angle_deg": signals.angle_deg, **columns}
        values |= {"right_ambient": room, "left_ambient": room}
        for name, one in values.items():
            group.create_dataset(name, data=one).attrs["units"] = units.get(name, "V")
    return path


def ask(path: Path, **options: Any) -> SensorDiagnoses:
    return diagnosed_sensors(study([path]), DiagnosisOptions(**options))


def test_a_table_and_a_design(tmp_path: Path, design: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "S1.csv", Lit(noise_V=2e-3))
    out, figure = tmp_path / "d.json", tmp_path / "d.svg"
    found = answered(
        capfd, "bench", "diagnose", str(path), "--design", str(design), "--out", str(out), "--figure", str(figure)
    )
    sensor = found["sensors"]["S1"]
    decentre = sensor["parameters"]["emitter_offset_mm"]
    low, high = decentre["interval95_value"]
    assert low < 0.02 < high
    assert decentre["u_value"] > 0.0
    assert decentre["unit"] == "mm"
    assert sensor["words"][0].endswith("mm to the right")
    assert sensor["parameters"]["loss_per_mm"]["value"] is None
    assert sensor["parameters"]["loss_per_mm"]["determined"] is False
    assert set(sensor["not_determined"]["loss_per_mm"]) >= {"gain right", "gain left"}
    assert len(sensor["correlated"]) == len(sensor["correlations"])
    assert any("in proportion to the light" in line for line in found["warnings"])
    assert found["simulated"] is False
    assert found["sources"][0]["file"] == "S1.csv"
    assert json.loads(out.read_text(encoding="utf-8"))["kind"] == "diagnosis"
    drawn = figure.read_text(encoding="utf-8")
    assert "simulated" not in drawn
    assert "mm to the right" in drawn


def test_a_bench_run_carries_its_design(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = bench(tmp_path / "run.nc", Lit(noise_V=1e-3, offsets_V=(5.0, 5.0)))
    found = answered(capfd, "bench", "diagnose", str(path), "--figure", str(tmp_path / "d.svg"))
    sensor = found["sensors"]["lens-1"]
    assert found["simulated"] is True
    assert sensor["drawn"] == DRAWN
    assert sensor["lens"] is True
    assert not any("in proportion" in line for line in found["warnings"])  # its circuit is known
    assert "simulated data" in (tmp_path / "d.svg").read_text(encoding="utf-8")
    lines = _lines(capfd, str(path))
    assert lines[0] == "lens-1, lens: 5 cycles, ± is the half-width of the 95 % interval; simulated"
    assert lines[1].startswith("  emitter 0.0")


def _lines(capfd: pytest.CaptureFixture[str], *arguments: str) -> list[str]:
    assert run_command(["bench", "diagnose", *arguments]) == 0
    return capfd.readouterr().out.splitlines()


def test_what_is_known_beforehand_widens(tmp_path: Path, design: Path) -> None:
    path = table(tmp_path / "S1.csv", Lit(noise_V=1e-3))
    known, vague = (ask(path, design=design, zero_u_deg=u) for u in (0.01, 0.4))
    one, other = (each.sensors["S1"].parameters["emitter_offset_mm"].u_value for each in (known, vague))
    assert one is not None
    assert other is not None
    assert other > one
    assert vague.prior == {"angle_zero_deg": 0.4, "material.index": 0.003}


def test_refusals_are_one_line(tmp_path: Path, design: Path) -> None:
    path = table(tmp_path / "S1.csv", Lit(noise_V=2e-3))
    with pytest.raises(DataError, match="contains no design; name its design file with --design"):
        ask(path)
    with pytest.raises(SpecError, match="no sensor has this name; choose from S1"):
        ask(path, design=design, sensor=("S9",))
    with pytest.raises(SpecError, match="zero_u_deg"):
        ask(path, design=design, zero_u_deg=2.0)
    with pytest.raises(SpecError, match="brighter"):
        ask(path, design=design, brighter="red")
    with pytest.raises(SpecError, match="is fitted anyway"):
        ask(path, design=design, spread=("emitter.offset_mm=0.1",))
    with pytest.raises(SpecError, match="must be greater than 0"):
        ask(path, design=design, spread=("material.index=-1",))
    with pytest.raises(SpecError, match="must be KEY=U"):
        DiagnosisOptions(spread=("emitter.distance_mm",))
    assert DiagnosisOptions(spread=("emitter.distance_mm=0.02",)).spreads["emitter.distance_mm"] == 0.02
    nameless = table(tmp_path / "S2.csv", Lit(), "time_s,angle_deg,a_V,b_V")
    with pytest.raises(DataError, match="do not distinguish right from left"):
        ask(nameless, design=design)


def test_another_motion_is_refused(tmp_path: Path) -> None:
    path = bench(tmp_path / "run.nc", Lit(noise_V=1e-3))
    other = tmp_path / "other.toml"
    other.write_text(DESIGN + '[motion]\npivot = "emitter"\n', encoding="utf-8")
    with pytest.raises(DataError, match=r"motion\.pivot = 'emitter'; the recording of lens-1 was made with stem-base"):
        ask(path, design=other)
    beyond = loads(DESIGN + "[motion]\nfrom_deg = -1.0\nto_deg = 1.0\n")
    assert beyond.motion.to_deg == 1.0
    narrow = tmp_path / "narrow.toml"
    narrow.write_text(DESIGN + "[motion]\nfrom_deg = -1.0\nto_deg = 1.0\n", encoding="utf-8")
    found = ask(path, design=narrow)
    assert any("check that the motion is the same" in line for line in found.warnings)


def test_a_damaged_header_is_no_header(tmp_path: Path, design: Path) -> None:
    path = bench(tmp_path / "run.nc", Lit(noise_V=1e-3))
    with h5py.File(path, "a") as file:
        file.attrs["header"] = "{half of"
    with pytest.raises(DataError, match="contains no design"):
        ask(path)
    assert ask(path, design=design).sensors["lens-1"].drawn is None


@dataclass(frozen=True)
class Denser(Lit):
    """A recording of the design in closed form, of another index."""

    index: float = 0.0

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        ends = [integral(angle_deg, np.full(angle_deg.shape, 0.02 + half), self.index) for half in (0.1, -0.1)]
        left_right = ((ends[0] - ends[1]) / 0.2)[::-1].T
        return np.asarray(np.array([4.8, 5.0]) - np.array([7.0, 8.0]) * left_right)


@pytest.mark.parametrize(("index", "told"), [(0.003, False), (-0.009, True)])
def test_a_number_beyond_its_tables_is_reported(tmp_path: Path, design: Path, index: float, told: bool) -> None:
    found = ask(table(tmp_path / "S1.csv", Denser(noise_V=1e-3, index=index)), design=design)
    value = found.sensors["S1"].parameters["material.index"].value
    assert value == pytest.approx(index, rel=0.2)
    assert any("the estimate of material.index" in line and "0.0045" in line for line in found.warnings) == told


class Bent(Lit):
    """A recording that no chip of the design makes."""

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        return super().response_V(angle_deg) + 0.3 * np.cos(2.0 * angle_deg)[:, None]


def test_a_model_of_the_plane_that_misses_is_referred_to_space(tmp_path: Path, design: Path) -> None:
    path = table(tmp_path / "S1.csv", Bent(noise_V=2e-3))
    in_space = tmp_path / "space.toml"
    stated = 'pattern = "lambertian"\n[trace]\ndimension = "extruded"\n'
    in_space.write_text(DESIGN + stated, encoding="utf-8")
    told = [any("extruded" in line for line in ask(path, design=one).warnings) for one in (design, in_space)]
    assert told == [True, False]
    assert any("deviates from the mean curves" in line for line in ask(path, design=in_space).warnings)


@pytest.mark.evidence
def test_a_bench_run_is_diagnosed_as_it_was_drawn(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "bench"
    assert run_command(["bench", "new", str(folder)]) == 0
    rig = ["bench", "run", str(folder / "rotation.toml"), "--rig", str(folder / "rig.toml")]
    assert run_command([*rig, "--out", str(folder / "rec")]) == 0
    found = answered(capfd, "bench", "diagnose", str(folder / "rec" / "rotation.nc"))
    assert set(found["sensors"]) == {"lens-1", "lens-2", "lens-3", "no-lens"}
    for label, sensor in found["sensors"].items():
        keys = {"emitter_offset_mm": "emitter.offset_mm", "chip_width_mm": "emitter.width_mm"}
        for name, key in (keys | {gain: gain for gain in ("gain_right_V", "gain_left_V")}).items():
            low, high = sensor["parameters"][name]["interval95_value"]
            print(label, name, low, sensor["drawn"][key], high)
            assert low <= sensor["drawn"][key] <= high
