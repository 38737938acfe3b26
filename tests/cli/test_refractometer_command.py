"""`solen resin refractometer` on the command line: one JSON object, lines for a reader, one line for what is wrong."""

import json
import subprocess
import sys
from pathlib import Path


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "solen", "resin", "refractometer", *arguments]
    return subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)


def test_json_is_one_object(tmp_path: Path) -> None:
    result = tmp_path / "n.json"
    done = run("1.487", "--u", "0.0005", "--at-nm", "860", "--json", "--out", str(result))
    assert (done.returncode, done.stderr) == (0, "")
    found = json.loads(done.stdout)
    assert {"wavelength_nm", "n", "u_n", "mode", "fit", "sources", "warnings", "files"} <= found.keys()
    assert abs(found["at"][0]["n"] - 1.4796) < 5e-4
    assert json.loads(result.read_text(encoding="utf-8"))["kind"] == "refractometer"


def test_several_values_and_a_readers_lines() -> None:
    lines = ["--wavelength-nm", "450", "--wavelength-nm", "589.3", "--wavelength-nm", "860"]
    done = run("1.500", "1.490", "1.485", "--u", "0.0005", *lines)
    assert done.returncode == 0
    assert "n_D (589.3 nm)  1.49059 ± 3.6e-04" in done.stdout
    assert "Abbe number     60.2 ± 2.8" in done.stdout
    assert "warning" not in done.stdout


def test_bad_input_ends_with_one_line_and_exit_code_2() -> None:
    for arguments in (("1.49",), ("1.49", "1.5", "--u", "0.001"), ("glass", "--u", "0.001"), ("0.5", "--u", "0.001")):
        done = run(*arguments)
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(done.stderr.splitlines()) == 1
