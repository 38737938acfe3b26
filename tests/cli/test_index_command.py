"""`solen resin index` on the command line: one JSON object, lines for a reader, one line for what is wrong."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from solen.material.index import forward

NM = np.arange(400.0, 901.0, 20.0)
R, T = forward(1.49 + 4e3 / NM**2, 1e-5, 50.0, NM)


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "solen", "resin", "index", *arguments]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)


def layer(folder: Path) -> str:
    file = folder / "layer.csv"
    rows = [f"{nm},{t!r},{r!r}" for nm, t, r in zip(NM.tolist(), T.tolist(), R.tolist(), strict=True)]
    file.write_text("\n".join(["wavelength_nm,T,R", *rows]) + "\n", encoding="utf-8")
    return str(file)


def test_json_is_one_object_with_what_scripts_rely_on(tmp_path: Path) -> None:
    picture, result = tmp_path / "n.png", tmp_path / "n.json"
    done = run(layer(tmp_path), "--thickness-um", "50", "--json", "--figure", str(picture), "--out", str(result))
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    arrays = ("wavelength_nm", "n", "u_n", "k", "u_k", "reason")
    assert {*arrays, "mode", "lossless_n", "options", "fit", "sources", "warnings"} <= found.keys()
    assert {len(found[key]) for key in arrays} == {NM.size}
    assert found["n"][0] == 1.49 + 4e3 / 400.0**2 or abs(found["n"][0] - 1.49 - 4e3 / 400.0**2) < 1e-9
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert json.loads(result.read_text(encoding="utf-8"))["n"] == found["n"]


def test_lines_name_the_mode_and_the_warnings(tmp_path: Path) -> None:
    done = run(layer(tmp_path), "--thickness-um", "50", "--mode", "as-published", "--at-nm", "500")
    assert done.returncode == 0
    assert "mode as-published, NO MEASUREMENT" in done.stdout
    assert "warning: as published, refused as a measurement" in done.stdout
    assert "at, mean wavelength 500 nm: n = 1.3" in done.stdout


def test_what_is_wrong_is_one_line_and_code_2(tmp_path: Path) -> None:
    for arguments, line in (
        ([layer(tmp_path)], "solen: --thickness-um; is missing"),
        ([layer(tmp_path), "--thickness-um", "50", "--transmittance", "U"], "solen: trace U; not in layer.csv"),
        ([str(tmp_path / "no.csv"), "--thickness-um", "50"], "solen: "),
    ):
        done = run(*arguments)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr.startswith(line)
        assert len(done.stderr.splitlines()) == 1
