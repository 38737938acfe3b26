"""What a bug report needs, and completion in the shell."""

import platform
from pathlib import Path

import pytest

import solen
from solen.cli import run_command
from solen.extras import PACKAGES
from tests.command_support import answered, refusal


def test_the_doctor_names_versions_threads_extras_and_the_cache(capfd: pytest.CaptureFixture[str]) -> None:
    found = answered(capfd, "doctor")
    assert found["version"] == solen.__version__
    assert found["python"].startswith(platform.python_version())
    assert found["threads"] >= 1
    assert found["packages"]["numpy"]
    assert {package["name"] for package in found["optional"]} == {one.distribution for one in PACKAGES.values()}
    assert {package["install"] for package in found["optional"]} == {one.command for one in PACKAGES.values()}
    assert found["cache"]["folder"] is None or found["cache"]["files"] >= 0


def test_the_doctor_says_what_is_missing_and_what_brings_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("ezdxf", "tifffile"):
        monkeypatch.setitem(__import__("sys").modules, module, None)
    assert run_command(["doctor"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["dxf"].endswith(f"ezdxf missing; {PACKAGES['ezdxf'].command}")
    assert lines["vision"].endswith(f"tifffile missing; {PACKAGES['tifffile'].command}")
    assert "pip" not in lines["tdms"]


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_is_installed_with_one_command(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, shell: str
) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    for name in ("ZSH", "ZSH_CUSTOM"):
        monkeypatch.delenv(name, raising=False)
    found = answered(capfd, "completion", shell)
    script = Path(found["files"]["completion"])
    assert script.is_relative_to(tmp_path)
    text = script.read_text(encoding="utf-8")
    assert "cutback" in text
    assert "keep-all" in text
    assert found["shell"] == shell


def test_completion_refuses_another_shell(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("cyclopts.completion.detect.detect_shell", lambda: "powershell")
    assert "powershell" in refusal(capsys, tmp_path, "completion")
    assert "tcsh" in refusal(capsys, tmp_path, "completion", "tcsh")


def test_quiet_prints_nothing_but_warnings(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["doctor", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
