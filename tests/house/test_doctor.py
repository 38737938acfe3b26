"""The `solen doctor` and `solen completion` commands."""

import platform
from pathlib import Path

import pytest

import solen
from solen.cli import run_command
from solen.extras import PACKAGES
from tests.command_support import answered, refusal


def test_doctor_reports_versions_threads_extras_and_cache(capfd: pytest.CaptureFixture[str]) -> None:
    result = answered(capfd, "doctor")
    assert result["version"] == solen.__version__
    assert result["python"].startswith(platform.python_version())
    assert result["threads"] >= 1
    assert result["packages"]["numpy"]
    assert {package["name"] for package in result["optional"]} == {
        package.distribution for package in PACKAGES.values()
    }
    assert {package["install"] for package in result["optional"]} == {package.command for package in PACKAGES.values()}
    assert result["cache"]["folder"] is None or result["cache"]["files"] >= 0


def test_doctor_names_missing_packages_and_how_to_install_them(
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
def test_installs_completion(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, shell: str
) -> None:
    for name in ("HOME", "USERPROFILE"):
        monkeypatch.setenv(name, str(tmp_path))
    for name in ("ZSH", "ZSH_CUSTOM"):
        monkeypatch.delenv(name, raising=False)
    result = answered(capfd, "completion", shell)
    script = Path(result["files"]["completion"])
    assert script.is_relative_to(tmp_path)
    text = script.read_text(encoding="utf-8")
    assert "cutback" in text
    assert "keep-all" in text
    assert result["shell"] == shell


def test_refuses_completion_for_other_shell(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("cyclopts.completion.detect.detect_shell", lambda: "powershell")
    assert "powershell" in refusal(capsys, tmp_path, "completion")
    assert "tcsh" in refusal(capsys, tmp_path, "completion", "tcsh")


def test_quiet_prints_only_warnings(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command(["doctor", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
