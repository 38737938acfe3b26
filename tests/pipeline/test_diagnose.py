"""`solen bench diagnose` for files, with a response in closed form instead of a traced one."""

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
from tests.analysis.diagnosis_support import LitSensor, integral, response
from tests.analysis.simulated_support import simulated
from tests.command_support import answered

DESIGN = 'schema = 1\nname = "one"\n[material]\nindex = 1.44\n[emitter]\nwidth_mm = 0.2\n'
DRAWN = {"emitter.offset_mm": 0.02, "emitter.width_mm": 0.2}


@pytest.fixture(autouse=True)
def closed_form(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Replace tracing by the response in closed form, except in tests marked as evidence."""
    if request.node.get_closest_marker("evidence") is not None:
        return
    closed = response()
    monkeypatch.setattr(Response, "of", lambda *_: closed)


@pytest.fixture
def design(tmp_path: Path) -> Path:
    path = tmp_path / "sensor.toml"
    path.write_text(DESIGN, encoding="utf-8")
    return path


def table(path: Path, truth: LitSensor, header: str = "time_s,angle_deg,left_V,right_V") -> Path:
    """Write a simulated recording as a table."""
    signals = simulated(truth)
    rows = np.column_stack([signals.time_s, signals.angle_deg, signals.volts]).tolist()
    lines = [",".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def bench_recording(path: Path, truth: LitSensor, design: str = DESIGN) -> Path:
    """Write a recording as `solen bench run` does, with the design in its header."""
    signals = simulated(truth)
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
        for name, column in values.items():
            group.create_dataset(name, data=column).attrs["units"] = units.get(name, "V")
    return path


def diagnose(path: Path, **options: Any) -> SensorDiagnoses:
    return diagnosed_sensors(study([path]), DiagnosisOptions(**options))


def test_diagnoses_a_table_with_a_design(tmp_path: Path, design: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "S1.csv", LitSensor(noise_V=2e-3))
    out, figure = tmp_path / "d.json", tmp_path / "d.svg"
    result = answered(
        capfd, "bench", "diagnose", str(path), "--design", str(design), "--out", str(out), "--figure", str(figure)
    )
    sensor = result["sensors"]["S1"]
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
    assert any("in proportion to the light" in line and "[readout]" in line for line in result["warnings"])
    assert result["simulated"] is False
    assert result["sources"][0]["file"] == "S1.csv"
    assert json.loads(out.read_text(encoding="utf-8"))["kind"] == "diagnosis"
    svg = figure.read_text(encoding="utf-8")
    assert "simulated" not in svg
    assert "mm to the right" in svg


def test_design_is_read_from_a_bench_recording(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = bench_recording(tmp_path / "run.nc", LitSensor(noise_V=1e-3, offsets_V=(5.0, 5.0)))
    result = answered(capfd, "bench", "diagnose", str(path), "--figure", str(tmp_path / "d.svg"))
    sensor = result["sensors"]["lens-1"]
    assert result["simulated"] is True
    assert sensor["drawn"] == DRAWN
    assert sensor["lens"] is True
    assert not any("in proportion" in line for line in result["warnings"])  # the recording specifies the circuit
    assert "simulated data" in (tmp_path / "d.svg").read_text(encoding="utf-8")
    assert run_command(["bench", "diagnose", str(path)]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines[0] == "lens-1, lens: 5 cycles, ± is the half-width of the 95 % interval; simulated"
    assert lines[1].startswith("  emitter 0.0")


def test_warning_for_rising_voltages_refers_to_the_option(tmp_path: Path, design: Path) -> None:
    """A [readout] table would not help, because load lines are not used for voltages that rise with light."""
    path = table(tmp_path / "S1.csv", LitSensor(noise_V=2e-3, gains_V=(-8.0, -7.0), offsets_V=(0.1, 0.1)))
    result = diagnose(path, design=design, brighter="higher")
    (warning,) = [line for line in result.warnings if "in proportion to the light" in line]
    assert "--brighter higher" in warning
    assert "[readout]" not in warning
    gain = result.sensors["S1"].parameters["gain_right_V"].value
    assert gain == pytest.approx(8.0, rel=0.05)


def test_prior_uncertainty_widens_the_intervals(tmp_path: Path, design: Path) -> None:
    path = table(tmp_path / "S1.csv", LitSensor(noise_V=1e-3))
    narrow, wide = (diagnose(path, design=design, zero_u_deg=u) for u in (0.01, 0.4))
    u_narrow, u_wide = (result.sensors["S1"].parameters["emitter_offset_mm"].u_value for result in (narrow, wide))
    assert u_narrow is not None
    assert u_wide is not None
    assert u_wide > u_narrow
    assert wide.prior == {"angle_zero_deg": 0.4, "material.index": 0.003}


def test_refuses_invalid_options(tmp_path: Path, design: Path) -> None:
    path = table(tmp_path / "S1.csv", LitSensor(noise_V=2e-3))
    with pytest.raises(DataError, match="contains no design; name the design file of the sensor with --design"):
        diagnose(path)
    with pytest.raises(SpecError, match="no sensor has this name; choose from S1"):
        diagnose(path, design=design, sensor=("S9",))
    with pytest.raises(SpecError, match="zero_u_deg"):
        diagnose(path, design=design, zero_u_deg=2.0)
    with pytest.raises(SpecError, match="brighter"):
        diagnose(path, design=design, brighter="red")
    with pytest.raises(SpecError, match="is fitted anyway"):
        diagnose(path, design=design, spread=("emitter.offset_mm=0.1",))
    with pytest.raises(SpecError, match="must be greater than 0"):
        diagnose(path, design=design, spread=("material.index=-1",))
    with pytest.raises(SpecError, match="must be KEY=U"):
        DiagnosisOptions(spread=("emitter.distance_mm",))
    assert DiagnosisOptions(spread=("emitter.distance_mm=0.02",)).spreads["emitter.distance_mm"] == 0.02
    nameless = table(tmp_path / "S2.csv", LitSensor(), "time_s,angle_deg,a_V,b_V")
    with pytest.raises(DataError, match="do not distinguish right from left"):
        diagnose(nameless, design=design)


def test_refuses_a_design_with_another_motion(tmp_path: Path) -> None:
    path = bench_recording(tmp_path / "run.nc", LitSensor(noise_V=1e-3))
    other = tmp_path / "other.toml"
    other.write_text(DESIGN + '[motion]\npivot = "emitter"\n', encoding="utf-8")
    with pytest.raises(DataError, match=r"motion\.pivot = 'emitter'; the recording of lens-1 was made with stem-base"):
        diagnose(path, design=other)
    narrow = tmp_path / "narrow.toml"
    narrow.write_text(DESIGN + "[motion]\nfrom_deg = -1.0\nto_deg = 1.0\n", encoding="utf-8")
    result = diagnose(path, design=narrow)
    assert any("check that the motion is the same" in line for line in result.warnings)


def test_ignores_a_damaged_header(tmp_path: Path, design: Path) -> None:
    path = bench_recording(tmp_path / "run.nc", LitSensor(noise_V=1e-3))
    with h5py.File(path, "a") as file:
        file.attrs["header"] = "{truncated"
    with pytest.raises(DataError, match="contains no design"):
        diagnose(path)
    assert diagnose(path, design=design).sensors["lens-1"].drawn is None


@dataclass(frozen=True)
class OtherIndex(LitSensor):
    """True values of a recording with the response in closed form, for another index."""

    index: float = 0.0

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        ends = [integral(angle_deg, np.full(angle_deg.shape, 0.02 + half), self.index) for half in (0.1, -0.1)]
        left_right = ((ends[0] - ends[1]) / 0.2)[::-1].T
        return np.asarray(np.array([4.8, 5.0]) - np.array([7.0, 8.0]) * left_right)


@pytest.mark.parametrize(("index", "outside"), [(0.003, False), (-0.009, True)])
def test_warns_of_an_estimate_outside_the_traced_values(
    tmp_path: Path, design: Path, index: float, *, outside: bool
) -> None:
    result = diagnose(table(tmp_path / "S1.csv", OtherIndex(noise_V=1e-3, index=index)), design=design)
    value = result.sensors["S1"].parameters["material.index"].value
    assert value == pytest.approx(index, rel=0.2)
    assert any("the estimate of material.index" in line and "0.0045" in line for line in result.warnings) == outside


class Deviating(LitSensor):
    """True values of a recording that cannot be fitted by any chip in the design."""

    def response_V(self, angle_deg: FloatArray) -> FloatArray:
        return super().response_V(angle_deg) + 0.05 * np.cos(2.0 * angle_deg)[:, None]


def test_misfit_in_the_plane_suggests_a_design_in_space(tmp_path: Path, design: Path) -> None:
    path = table(tmp_path / "S1.csv", Deviating(noise_V=2e-3))
    in_space = tmp_path / "space.toml"
    in_space.write_text(f'{DESIGN}pattern = "lambertian"\n[trace]\ndimension = "extruded"\n', encoding="utf-8")
    of_plane, of_space = (diagnose(path, design=file).warnings for file in (design, in_space))
    assert any("extruded" in line for line in of_plane)
    assert not any("extruded" in line for line in of_space)
    assert any("deviates from the mean curves" in line for line in of_space)


@pytest.mark.evidence
def test_intervals_contain_the_drawn_values_of_a_bench_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "bench"
    assert run_command(["bench", "new", str(folder)]) == 0
    rig = ["bench", "run", str(folder / "rotation.toml"), "--rig", str(folder / "rig.toml")]
    assert run_command([*rig, "--out", str(folder / "rec")]) == 0
    result = answered(capfd, "bench", "diagnose", str(folder / "rec" / "rotation.nc"))
    assert set(result["sensors"]) == {"lens-1", "lens-2", "lens-3", "no-lens"}
    for label, sensor in result["sensors"].items():
        keys = {"emitter_offset_mm": "emitter.offset_mm", "chip_width_mm": "emitter.width_mm"}
        for name, key in (keys | {gain: gain for gain in ("gain_right_V", "gain_left_V")}).items():
            low, high = sensor["parameters"][name]["interval95_value"]
            print(label, name, low, sensor["drawn"][key], high)
            assert low <= sensor["drawn"][key] <= high
