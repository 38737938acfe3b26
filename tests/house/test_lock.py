"""The lock file contains only names and versions, and pins the requirements in pyproject.toml."""

import tomllib

import pytest
from packaging.requirements import Requirement

from tools.pins import (
    PYTHONS,
    ROOT,
    SYSTEMS,
    applies,
    direct_requirements,
    lock_lines,
    malformed_lines,
    marker_values,
    pin_faults,
    pins_of,
    required_packages,
)

LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_lock_contains_only_names_and_versions() -> None:
    assert malformed_lines(LOCK) == []
    assert "//" not in LOCK


def test_lock_is_sorted_without_duplicates() -> None:
    lines = lock_lines(LOCK)
    assert sorted(line.partition("==")[0] for line in lines) == sorted(pins_of(LOCK))


def test_pins_satisfy_direct_requirements() -> None:
    assert pin_faults(direct_requirements(PROJECT), pins_of(LOCK)) == []


def test_checked_python_versions_are_those_of_classifiers() -> None:
    claimed = [text.rpartition(" ")[2] for text in PROJECT["project"]["classifiers"] if "Python :: 3." in text]
    assert claimed == list(PYTHONS)
    assert PROJECT["project"]["requires-python"] == f">={PYTHONS[0]}"


@pytest.mark.parametrize(
    "line",
    [
        "numpy>=2",
        "numpy",
        "numpy==2.*",
        "numpy @ https://example.org/numpy.whl",
        "numpy==2.1 --hash=sha256:0",
        "-e .",
        "--index-url https://example.org",
        "NumPy==2.1",
    ],
)
def test_finds_malformed_line(line: str) -> None:
    assert malformed_lines(f"# a comment\n\nnumpy==2.1\n{line}\n") == [line]


def test_evaluates_markers_for_target_system() -> None:
    windows_only = Requirement('colorama==0.4.6; sys_platform == "win32"')
    assert [name for name, system in SYSTEMS.items() if applies(windows_only, marker_values("3.12", system))] == [
        "Windows x86_64"
    ]


def test_follows_requirements_of_extras_and_names_missing_pins() -> None:
    requires = {"a": [Requirement("b[x]>=2")], "b": [Requirement('c; extra == "x"'), Requirement('d; extra == "y"')]}
    required = required_packages([Requirement("a")], requires, marker_values("3.11", SYSTEMS["Linux x86_64"]))
    assert {name for name, _ in required} == {"a", "b", "c"}
    faults = pin_faults(required.values(), pins_of("a==1\nb==1\n"))
    assert sorted(faults) == ["b[x]>=2 is not satisfied by b==1", 'c; extra == "x" is not pinned']
