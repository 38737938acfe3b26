"""`solen readout`: voltages of a design, warnings and files."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solen.cli import run_command
from solen.errors import DataError, DesignError, OutputError, SpecError
from solen.pipeline.design.readout import readout
from solen.report.options import FigureOptions
from solen.sensor.readings import DesignReadings
from solen.spec import template
from tests.command_support import answered

FAST = ("motion.step_deg=1.5", "emitter.width_mm=0.2")


@pytest.fixture(scope="module")
def design(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("readout") / "sensor.toml"
    path.write_text(template("paper-860"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def results(design: Path) -> dict[str, Any]:
    return readout(design, set_=FAST).to_dict()


def test_reports_source_and_keys_without_effect(design: Path) -> None:
    results = readout(design, set_=(*FAST, "motion.step_deg=3", "receivers.height_mm=1")).to_dict()
    (source,) = results["sources"]
    assert (source["file"], source["format"], len(source["sha256"])) == ("sensor.toml", "design", 64)
    assert any(text.startswith("receivers.height_mm = 1 has no effect in the plane") for text in results["warnings"])


def test_negative_angle_lowers_right_voltage(results: dict[str, Any]) -> None:
    """As in the paper: if the sensor turns to the right, the right receiver gets more light and has a lower voltage."""
    assert results["angle_deg"] == [-3.0, -1.5, 0.0, 1.5, 3.0]
    assert results["circuit"]["names"] == ["right", "left"]
    right, left = np.array(results["voltage_V"]).T
    assert (np.diff(right) > 0).all()
    assert (np.diff(left) < 0).all()
    assert right == pytest.approx(left[::-1], abs=1e-3), "the sensor is symmetric"
    assert results["contrast"][0] > 0.8
    assert results["simulated"] is True


def test_results_are_consistent(results: dict[str, Any]) -> None:
    circuit, volts = results["circuit"], np.array(results["voltage_V"])
    irradiance = np.array(results["irradiance_mW_per_cm2"])
    ideal_A = irradiance * 450e-6 * circuit["transistor"]["response"]
    mW = circuit["drive"]["typical_mW"]
    assert np.array(results["power_fraction"]) * mW / 0.12 == pytest.approx(irradiance, rel=1e-6)
    linear = ideal_A * 2000.0 < 3.0
    assert linear.any()
    assert volts[linear] == pytest.approx(5.0 - 2000.0 * ideal_A[linear], abs=1e-4)
    noise = [results["noise"][f"{name}_V"] for name in ("shot", "thermal", "converter", "quantisation")]
    assert np.array(results["noise"]["reading_V"]) == pytest.approx(np.sqrt(np.square(noise).sum(axis=0)))
    at_rest_deg = results["sd_V"][2][0] / abs(results["slope_V_per_deg"][2][0])
    assert results["resolution_deg"][2][0] == pytest.approx(at_rest_deg)
    assert results["resolution_of_all_deg"][2] == pytest.approx(at_rest_deg / math.sqrt(2.0), rel=1e-2)
    assert (np.array(results["voltage_by_case_V"]["brightest"]) < volts).all()
    assert (np.array(results["voltage_by_case_V"]["dimmest"]) > volts).all()
    assert results["range"]["lowest_V"] == volts.min()


def test_reports_estimated_values(results: dict[str, Any]) -> None:
    by_name = {part["name"]: part["estimates"] for part in results["parts"]}
    assert set(by_name) == {"TEMT7100X01", "VSMY1850", "TC33X-2-202E", "USB-6218"}
    assert "spectrum" in by_name["TEMT7100X01"]
    assert "current_ua_per_mw_cm2" not in by_name["TEMT7100X01"]
    assert by_name["TC33X-2-202E"] == []
    assert "range" in by_name["USB-6218"]


@pytest.mark.parametrize(
    ("assignments", "words"),
    [
        (("emitter.wavelength_nm=450",), "at 450 nm is 1.2 % of its specified sensitivity"),
        (("emitter.wavelength_nm=450",), "VSMY1850, which emits at 850 nm"),
        (("readout.emitter_current_ma=20",), "typical parts saturate: 0.16 V"),
        (("readout.emitter_current_ma=1",), "the brightest parts saturate with a load of 2000 ohm"),
        (("readout.emitter_current_ma=150",), "150 mA exceeds the 100 mA that VSMY1850 may carry"),
        (("readout.load_ohm=100",), "up to 50 mA, which exceeds the 20 mA"),
        (("readout.supply_v=24",), "the supply voltage of 24 V exceeds the 20 V"),
        (("readout.adc=ATmega328P",), "outside the range of ATmega328P, 0 to 5 V"),
        (("readout.load_ohm=200000",), "reduce the load or the rate"),
        ((), "rays in the plane"),
        ((), "use a smaller motion.step_deg"),
    ],
)
def test_warnings(design: Path, assignments: tuple[str, ...], words: str) -> None:
    warnings = readout(design, set_=("motion.step_deg=3", *assignments)).result.warnings
    assert any(words in warning for warning in warnings), warnings


def test_no_warning_for_valid_readout(design: Path) -> None:
    """With suitable parts, the only warning is that of rays in the plane."""
    emitter = 'schema = 1\nname = "Red"\nkind = "emitter"\nmaker = "me"\ndocument = "notes"\n' + "".join(
        f'[{key}]\ntypical = {value}\nbasis = "measured"\nsource = "bench"\n'
        for key, value in (("peak_nm", 650), ("power_mw", 40), ("current_ma", 100))
    )
    emitter += '[pattern]\nangle_deg = [0, 90]\nrelative = [1, 0]\nbasis = "measured"\nsource = "bench"\n'
    (design.parent / "red.toml").write_text(emitter, encoding="utf-8")
    parts = ("readout.part=TEMT7000X01", "readout.emitter_part=red.toml", "readout.emitter_current_ma=1")
    set_ = (*FAST, "motion.step_deg=0.75", "emitter.wavelength_nm=650", *parts)
    warnings = readout(design, set_=set_).result.warnings
    assert len(warnings) == 1, warnings


def test_directional_part_receives_less_light(design: Path) -> None:
    """A part with a half angle of 10° receives only part of the light that arrives from all directions."""
    text = 'schema = 1\nname = "Narrow"\nkind = "receiver"\nmaker = "me"\ndocument = "notes"\n' + "".join(
        f'[{key}]\ntypical = {value}\nbasis = "measured"\nsource = "bench"\n'
        for key, value in (("current_ua_per_mw_cm2", 450), ("half_angle_deg", 10))
    )
    (design.parent / "narrow.toml").write_text(text, encoding="utf-8")
    (design.parent / "wide.toml").write_text(text.replace("= 10\n", "= 60\n"), encoding="utf-8")
    results = [
        readout(design, set_=("motion.step_deg=3", f"readout.part={name}.toml")).result for name in ("narrow", "wide")
    ]
    narrow, wide = (result.power_fraction[0, 0] for result in results if isinstance(result, DesignReadings))
    assert 0.01 < narrow / wide < 0.9


@pytest.mark.parametrize(
    ("assignments", "error", "words"),
    [
        (("readout.part=VSMY1850",), DataError, "but a receiver"),
        (("readout.lod_ohm=1",), SpecError, "did you mean readout.load_ohm"),
        (("body.kind=outline", "body.file=none.dxf"), Exception, "none.dxf"),
    ],
)
def test_refuses_invalid_readout(
    design: Path, assignments: tuple[str, ...], error: type[Exception], words: str
) -> None:
    with pytest.raises(error) as raised:
        readout(design, set_=assignments)
    assert words in str(raised.value)
    assert not isinstance(raised.value, DesignError)


def test_writes_all_files_or_none(design: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"end in \.json"):
        readout(design, set_=FAST, out=tmp_path / "a.csv", figure=FigureOptions(figure=tmp_path / "a.png"))
    outcome = readout(
        design, set_=("motion.step_deg=3",), out=tmp_path / "a.json", figure=FigureOptions(figure=tmp_path / "a.svg")
    )
    figure = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "simulated: Paper 860 nm" in figure
    assert "lower if brighter" in figure
    data = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert data["kind"] == "readout"
    assert data["voltage_V"] == outcome.to_dict()["voltage_V"]


def test_command(design: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["readout", str(design), "--set", "motion.step_deg=3"]
    assert run_command(command) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    assert "brightest parts" in printed.out
    assert answered(capfd, *command)["range"]["highest_V"] <= 5.0
