"""Settings sheets with a working curve (with or without the spectrum of a lamp) and with a process."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.integrate import quad

from solen.fabricate.process import default_process, process_text, with_cure
from solen.fabricate.process.terms import terms_at
from solen.material.cure.law import CureLaw
from tests.command_support import answered, refusal

LAMP = [[0.3, 2.1], [0.5, 0.7], [0.2, 0.1]]
"""Fractions and relative absorptions of the lines; the last penetrates far deeper than the others."""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    trimesh.creation.box((2.0, 2.0, 0.5)).export("box.stl")
    law = {"lamp": "l", "Dp_um": 80.0, "u_Dp_um": 3.0, "Ec_mJ_per_cm2": 4.0, "u_Ec_mJ_per_cm2": 0.2}
    cure = {"kind": "cure", "Dp_um": 100.0, "Ec_mJ_per_cm2": 5.0, "covariance": [[9.0, 0.1], [0.1, 0.04]]}
    cure["in_lamp"] = law | {"lamp_lines": LAMP, "preferred": "spectrum"}
    Path("cure.json").write_text(json.dumps(cure), encoding="utf-8")
    Path("jacobs.json").write_text(json.dumps(cure | {"in_lamp": None}), encoding="utf-8")
    return tmp_path


def print_layers(capfd: pytest.CaptureFixture[str], *options: str) -> tuple[dict[str, Any], str, list[str]]:
    """Return the settings of a job, their sheet and the warnings."""
    result = answered(capfd, "print", "layers", "box.stl", "--out", "out", "--sheet-only", *options)
    texts = {name: Path(result["files"][name]).read_text(encoding="utf-8") for name in ("settings", "sheet")}
    return json.loads(texts["settings"]), texts["sheet"], result["warnings"]


def transmitted(depth_um: float, Dp_um: float = 80.0) -> float:
    return sum(fraction * float(np.exp(-absorption * depth_um / Dp_um)) for fraction, absorption in LAMP)


@pytest.mark.usefixtures("folder")
def test_cure_depths_and_doses_with_the_spectrum_of_a_lamp(capfd: pytest.CaptureFixture[str]) -> None:
    """The cure depth is that at which the sum over the lines is Ec; the mean dose of a layer is a sum of integrals."""
    settings, sheet, _ = print_layers(capfd, "--cure", "cure.json", "--irradiance-mW-per-cm2", "13")
    assert 26.0 * transmitted(settings["cure_depth_um"]) == pytest.approx(4.0, rel=1e-6)
    assert 39.0 * transmitted(settings["burn_in_cure_depth_um"]) == pytest.approx(4.0, rel=1e-6)
    exposures = [3.0] * 6 + [2.0] * 14
    assert settings["layer_exposures_s"] == exposures
    assert settings["layer_doses_mJ_per_cm2"] == pytest.approx([13.0 * s for s in exposures])
    for index in (0, 5, 10, 19):
        total = sum(
            13.0 * exposures[later] * quad(transmitted, 25.0 * (later - index), 25.0 * (later - index + 1))[0] / 25.0
            for later in range(index, 20)
        )
        assert settings["layer_received_mJ_per_cm2"][index] == pytest.approx(total, rel=1e-5)
    assert "3 lines" in sheet
    assert f"{settings['layer_received_mJ_per_cm2'][10]:.3g}" in sheet


@pytest.mark.usefixtures("folder")
def test_cure_depths_without_a_lamp_follow_jacobs(capfd: pytest.CaptureFixture[str]) -> None:
    settings, *_ = print_layers(capfd, "--cure", "jacobs.json", "--irradiance-mW-per-cm2", "13")
    assert settings["cure_depth_um"] == pytest.approx(100.0 * np.log(26.0 / 5.0))
    assert print_layers(capfd)[0]["layer_received_mJ_per_cm2"] is None


@pytest.mark.usefixtures("folder")
def test_exposures_are_those_of_a_process_and_differing_options_are_reported(capfd: pytest.CaptureFixture[str]) -> None:
    process = default_process().with_settings(exposure_s=2.5, layer_um=50.0, irradiance_mW_per_cm2=11.0)
    Path("mine.toml").write_text(process_text(process), encoding="utf-8")
    settings, _, warnings = print_layers(capfd, "--process", "mine.toml")
    assert (settings["exposure_s"], settings["layer_um"], settings["irradiance_mW_per_cm2"]) == (2.5, 50.0, 11.0)
    assert settings["cure_depth_um"] is None  # Dp and Ec are assumptions
    assert not any("process" in line for line in warnings)
    settings, _, warnings = print_layers(capfd, "--process", "mine.toml", "--exposure-s", "3", "--cure", "cure.json")
    assert settings["exposure_s"] == 3.0
    assert settings["cure_depth_um"] > 0.0
    assert any("--exposure-s 3" in line and "2.5" in line for line in warnings)


@pytest.mark.usefixtures("folder")
def test_a_process_takes_the_working_curve_and_its_uncertainty() -> None:
    process = with_cure(default_process(), Path("cure.json"))
    assert process.process.lamp == tuple(map(tuple, LAMP))
    assert (process.uncertainty["Dp_um"], process.uncertainty["Ec_mJ_per_cm2"]) == (3.0, 0.2)
    keys, covariance = with_cure(default_process(), Path("jacobs.json")).covariance()
    assert covariance[keys.index("Dp_um"), keys.index("Ec_mJ_per_cm2")] == pytest.approx(0.1)
    law, settings = process.process.law, process.process
    terms = terms_at(settings, 20, 10 * 25.0 + 12.5)
    received = CureLaw(law.Dp_um, law.Ec_mJ_per_cm2, law.lines).mean_doses(settings.exposures(20), 25.0)
    assert terms.total == pytest.approx(received[10], rel=0.03)  # the dose at mid-height and the mean of the layer


def test_refuses_a_file_that_is_not_a_working_curve(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    Path("other.json").write_text('{"kind": "index"}', encoding="utf-8")
    command = ("print", "layers", "box.stl", "--out", "out", "--cure", "other.json")
    assert "other.json" in refusal(capfd, folder, *command)
