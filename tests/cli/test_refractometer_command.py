"""`solen resin refractometer`: JSON, printed lines, and one line for bad input."""

import json
from pathlib import Path

import pytest

from solen.cli import run_command
from tests.command_support import answered, refusal

COMMAND = ("resin", "refractometer")


def test_json_contains_documented_keys(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    result = tmp_path / "n.json"
    output = answered(capfd, *COMMAND, "1.487", "--u", "0.0005", "--at-nm", "860", "--out", str(result))
    assert {"wavelength_nm", "n", "u_n", "mode", "fit", "sources", "warnings", "files"} <= output.keys()
    assert abs(output["at"][0]["n"] - 1.4796) < 5e-4
    assert json.loads(result.read_text(encoding="utf-8"))["kind"] == "refractometer"


def test_several_values_give_formula_and_abbe_number(capfd: pytest.CaptureFixture[str]) -> None:
    lines = ["--wavelength-nm", "450", "--wavelength-nm", "589.3", "--wavelength-nm", "860"]
    assert run_command([*COMMAND, "1.500", "1.490", "1.485", "--u", "0.0005", *lines]) == 0
    printed = capfd.readouterr().out
    assert "n_D (589.3 nm)  1.49059 ± 3.6e-04" in printed
    assert "Abbe number     60.2 ± 2.8" in printed
    assert "warning" not in printed


@pytest.mark.parametrize(
    "arguments", [("1.49",), ("1.49", "1.5", "--u", "0.001"), ("glass", "--u", "0.001"), ("0.5", "--u", "0.001")]
)
def test_bad_input_gives_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: tuple[str, ...]
) -> None:
    refusal(capfd, tmp_path, *COMMAND, *arguments)
