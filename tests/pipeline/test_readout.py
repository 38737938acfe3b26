"""`solen readout`: from a design file to volts, and what is said of them."""

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
def found(design: Path) -> dict[str, Any]:
    return readout(design, set_=FAST).to_dict()


def test_its_source_and_its_idle_keys_are_reported(design: Path) -> None:
    found = readout(design, set_=(*FAST, "motion.step_deg=3", "receivers.height_mm=1")).to_dict()
    (source,) = found["sources"]
    assert (source["file"], source["format"], len(source["sha256"])) == ("sensor.toml", "design", 64)
    assert any(text.startswith("receivers.height_mm = 1 has no effect in the plane") for text in found["warnings"])


def test_a_negative_angle_lowers_the_right_voltage(found: dict[str, Any]) -> None:
    """As in the paper: turned to the right, the right receiver is brighter, which is a lower voltage."""
    assert found["angle_deg"] == [-3.0, -1.5, 0.0, 1.5, 3.0]
    assert found["circuit"]["names"] == ["right", "left"]
    right, left = np.array(found["voltage_V"]).T
    assert (np.diff(right) > 0).all()
    assert (np.diff(left) < 0).all()
    assert right == pytest.approx(left[::-1], abs=1e-3), "the sensor is symmetric"
    assert found["contrast"][0] > 0.8
    assert found["simulated"] is True


def test_the_numbers_hang_together(found: dict[str, Any]) -> None:
    circuit, volts = found["circuit"], np.array(found["voltage_V"])
    irradiance = np.array(found["irradiance_mW_per_cm2"])
    asked_A = irradiance * 450e-6 * circuit["transistor"]["response"]
    mW = circuit["drive"]["typical_mW"]
    assert np.array(found["power_fraction"]) * mW / 0.12 == pytest.approx(irradiance, rel=1e-6)
    dim = asked_A * 2000.0 < 3.0
    assert dim.any()
    assert volts[dim] == pytest.approx(5.0 - 2000.0 * asked_A[dim], abs=1e-4)
    parts = [found["noise"][f"{name}_V"] for name in ("shot", "thermal", "converter", "quantisation")]
    assert np.array(found["noise"]["reading_V"]) == pytest.approx(np.sqrt(np.square(parts).sum(axis=0)))
    middle = found["sd_V"][2][0] / abs(found["slope_V_per_deg"][2][0])
    assert found["resolution_deg"][2][0] == pytest.approx(middle)
    assert found["resolution_of_all_deg"][2] == pytest.approx(middle / math.sqrt(2.0), rel=1e-2), "two alike"
    assert (np.array(found["voltage_by_case_V"]["brightest"]) < volts).all()
    assert (np.array(found["voltage_by_case_V"]["dimmest"]) > volts).all()
    assert found["range"]["lowest_V"] == volts.min()


def test_what_rests_on_estimates_is_reported(found: dict[str, Any]) -> None:
    by_name = {part["name"]: part["estimates"] for part in found["parts"]}
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
def test_what_must_be_known_is_said(design: Path, assignments: tuple[str, ...], words: str) -> None:
    told = readout(design, set_=("motion.step_deg=3", *assignments)).result.warnings
    assert any(words in one for one in told), told


def test_nothing_is_said_where_nothing_is_wrong(design: Path) -> None:
    """A receiver that sees red, its emitter's own power: nothing is left but the plane."""
    mine = 'schema = 1\nname = "Red"\nkind = "emitter"\nmaker = "me"\ndocument = "notes"\n' + "".join(
        f'[{key}]\ntypical = {value}\nbasis = "measured"\nsource = "bench"\n'
        for key, value in (("peak_nm", 650), ("power_mw", 40), ("current_ma", 100))
    )
    mine += '[pattern]\nangle_deg = [0, 90]\nrelative = [1, 0]\nbasis = "measured"\nsource = "bench"\n'
    (design.parent / "red.toml").write_text(mine, encoding="utf-8")
    parts = ("readout.part=TEMT7000X01", "readout.emitter_part=red.toml", "readout.emitter_current_ma=1")
    told = readout(design, set_=(*FAST, "motion.step_deg=0.75", "emitter.wavelength_nm=650", *parts)).result.warnings
    assert len(told) == 1, told


def test_a_directional_part_loses_light_from_the_side(design: Path) -> None:
    """A lens in front of the part that sees ±10° alone gets less of what arrives at all angles."""
    text = 'schema = 1\nname = "Narrow"\nkind = "receiver"\nmaker = "me"\ndocument = "notes"\n' + "".join(
        f'[{key}]\ntypical = {value}\nbasis = "measured"\nsource = "bench"\n'
        for key, value in (("current_ua_per_mw_cm2", 450), ("half_angle_deg", 10))
    )
    (design.parent / "narrow.toml").write_text(text, encoding="utf-8")
    (design.parent / "flat.toml").write_text(text.replace("= 10\n", "= 60\n"), encoding="utf-8")
    found = [
        readout(design, set_=("motion.step_deg=3", f"readout.part={name}.toml")).result for name in ("narrow", "flat")
    ]
    narrow, flat = (one.power_fraction[0, 0] for one in found if isinstance(one, DesignReadings))
    assert 0.01 < narrow / flat < 0.9


@pytest.mark.parametrize(
    ("assignments", "error", "words"),
    [
        (("readout.part=VSMY1850",), DataError, "but a receiver"),
        (("readout.lod_ohm=1",), SpecError, "did you mean readout.load_ohm"),
        (("body.kind=outline", "body.file=none.dxf"), Exception, "none.dxf"),
    ],
)
def test_a_design_without_a_readout_is_refused(
    design: Path, assignments: tuple[str, ...], error: type[Exception], words: str
) -> None:
    with pytest.raises(error) as refusal:
        readout(design, set_=assignments)
    assert words in str(refusal.value)
    assert not isinstance(refusal.value, DesignError)


def test_files_are_written_or_none(design: Path, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"end in \.json"):
        readout(design, set_=FAST, out=tmp_path / "a.csv", figure=FigureOptions(figure=tmp_path / "a.png"))
    found = readout(
        design, set_=("motion.step_deg=3",), out=tmp_path / "a.json", figure=FigureOptions(figure=tmp_path / "a.svg")
    )
    drawn = (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert "simulated: Paper 860 nm" in drawn
    assert "brighter is lower" in drawn
    data = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert data["kind"] == "readout"
    assert data["voltage_V"] == found.to_dict()["voltage_V"]


def test_the_command(design: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["readout", str(design), "--set", "motion.step_deg=3"]
    assert run_command(command) == 0
    printed = capfd.readouterr()
    assert printed.err == ""
    assert "brightest parts" in printed.out
    assert answered(capfd, *command)["range"]["highest_V"] <= 5.0
