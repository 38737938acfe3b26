"""The lock holds names and versions, nothing else, and pins what pyproject.toml asks for."""

import tomllib

import pytest
from packaging.requirements import Requirement

from tools.pins import (
    PYTHONS,
    ROOT,
    SYSTEMS,
    applies,
    direct,
    environment,
    lock_lines,
    malformed,
    pins,
    reached,
    unpinned,
)

LOCK = (ROOT / "requirements.lock").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_lock_holds_names_and_versions_only() -> None:
    assert malformed(LOCK) == []
    assert "//" not in LOCK


def test_lock_is_sorted_and_without_repeats() -> None:
    lines = lock_lines(LOCK)
    assert sorted(line.partition("==")[0] for line in lines) == sorted(pins(LOCK))


def test_every_direct_dependency_is_pinned_to_a_version_it_accepts() -> None:
    assert unpinned(direct(PROJECT), pins(LOCK)) == []


def test_the_pythons_checked_are_those_claimed() -> None:
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
def test_other_lines_are_found_malformed(line: str) -> None:
    assert malformed(f"# a comment\n\nnumpy==2.1\n{line}\n") == [line]


def test_markers_are_read_for_the_target_not_for_this_machine() -> None:
    only_windows = Requirement('colorama==0.4.6; sys_platform == "win32"')
    assert [name for name, system in SYSTEMS.items() if applies(only_windows, environment("3.12", system))] == [
        "Windows x86_64"
    ]


def test_requirements_are_followed_through_extras_and_missing_pins_named() -> None:
    requires = {"a": [Requirement("b[x]>=2")], "b": [Requirement('c; extra == "x"'), Requirement('d; extra == "y"')]}
    found = reached([Requirement("a")], requires, environment("3.11", SYSTEMS["Linux x86_64"]))
    assert {name for name, _ in found} == {"a", "b", "c"}
    faults = unpinned(found.values(), pins("a==1\nb==1\n"))
    assert sorted(faults) == ["b[x]>=2 is not satisfied by b==1", 'c; extra == "x" is not pinned']
