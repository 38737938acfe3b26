"""`solen resin index`: JSON, printed lines, and one line for bad input."""

import json
from pathlib import Path

import numpy as np
import pytest

from solen.cli import run_command
from solen.material.index import forward
from tests.command_support import answered, refusal

COMMAND = ("resin", "index")
NM = np.arange(400.0, 901.0, 20.0)
R, T = forward(1.49 + 4e3 / NM**2, 1e-5, 50.0, NM)


def layer(folder: Path) -> str:
    file = folder / "layer.csv"
    rows = [f"{nm},{t!r},{r!r}" for nm, t, r in zip(NM.tolist(), T.tolist(), R.tolist(), strict=True)]
    file.write_text("\n".join(["wavelength_nm,T,R", *rows]) + "\n", encoding="utf-8")
    return str(file)


def test_json_contains_documented_keys(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    figure, result = tmp_path / "n.png", tmp_path / "n.json"
    files = ["--figure", str(figure), "--out", str(result)]
    output = answered(capfd, *COMMAND, layer(tmp_path), "--thickness-um", "50", *files)
    arrays = ("wavelength_nm", "n", "u_n", "k", "u_k", "reason")
    assert {*arrays, "mode", "lossless_n", "options", "fit", "sources", "warnings"} <= output.keys()
    assert {len(output[key]) for key in arrays} == {NM.size}
    assert output["n"][0] == pytest.approx(1.49 + 4e3 / 400.0**2, abs=1e-9)
    assert figure.read_bytes().startswith(b"\x89PNG")
    assert json.loads(result.read_text(encoding="utf-8"))["n"] == output["n"]


def test_lines_contain_mode_and_warnings(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    options = ["--thickness-um", "50", "--mode", "as-published", "--at-nm", "500"]
    assert run_command([*COMMAND, layer(tmp_path), *options]) == 0
    printed = capfd.readouterr().out
    assert "mode as-published, NOT A MEASUREMENT" in printed
    assert "do not use: as published, not valid as a measurement" in printed
    assert "at, mean wavelength 500 nm: n = 1.3" in printed


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ((), "--thickness-um; is missing"),
        (("--thickness-um", "50", "--transmittance", "U"), "trace U; is not in layer.csv"),
        (("--thickness-um", "-50"), "--thickness-um = '-50'"),
        (("--u-T", "30%"), "--u-T = '30%'; must be a fraction or a percentage"),
        (("--polymer", "wax"), "--polymer = 'wax'; must be 'acrylate'"),
    ],
)
def test_bad_input_gives_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], options: tuple[str, ...], line: str
) -> None:
    assert line in refusal(capfd, tmp_path, *COMMAND, layer(tmp_path), *options)
