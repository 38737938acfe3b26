"""Check ``requirements.lock``: syntax, completeness, and that every pin has a wheel for each supported system.

``python tools/pins.py`` checks the syntax and the direct dependencies, offline. ``python tools/pins.py --wheels`` also
queries the package index, through pip, for the wheels of each Python version and system below, and follows their
requirements with the environment markers of that version and system: every required package must be pinned, and every
pin must be required on at least one system. This shows that the pins can be installed on a system, not that solen runs
on it.
"""

import argparse
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
LINE = re.compile(r"[a-z0-9][a-z0-9.-]*==[0-9][A-Za-z0-9.+]*(; [a-z_]+ (==|!=|<|<=|>|>=) \"[\w.]+\")?")
PYTHONS = ("3.11", "3.12", "3.13")


@dataclass(frozen=True)
class System:
    """An operating system on a processor: its wheel tags and the values of its environment markers."""

    tags: tuple[str, ...]
    markers: Mapping[str, str]


SYSTEMS = {
    "Linux x86_64": System(
        (
            *(f"manylinux_2_{minor}_x86_64" for minor in (28, 27, 26, 24, 17, 12, 5)),
            "manylinux2014_x86_64",
            "manylinux2010_x86_64",
            "manylinux1_x86_64",
        ),
        {"os_name": "posix", "sys_platform": "linux", "platform_system": "Linux", "platform_machine": "x86_64"},
    ),
    "Windows x86_64": System(
        ("win_amd64",),
        {"os_name": "nt", "sys_platform": "win32", "platform_system": "Windows", "platform_machine": "AMD64"},
    ),
    "macOS 14 arm64": System(
        ("macosx_14_0_arm64",),
        {"os_name": "posix", "sys_platform": "darwin", "platform_system": "Darwin", "platform_machine": "arm64"},
    ),
}


def lock_lines(text: str) -> list[str]:
    """Return the lines of a lock file that are neither blank nor comments."""
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def malformed_lines(text: str) -> list[str]:
    """Return the lines that are not ``name==version``, optionally with a simple marker."""
    return [line for line in lock_lines(text) if not LINE.fullmatch(line)]


def pins_of(text: str) -> dict[str, Requirement]:
    """Return the requirements in a lock file, keyed by normalised name; raise ``ValueError`` if a name occurs twice."""
    locked: dict[str, Requirement] = {}
    for line in lock_lines(text):
        requirement = Requirement(line)
        if locked.setdefault(canonicalize_name(requirement.name), requirement) is not requirement:
            raise ValueError(f"{requirement.name} is pinned twice")
    return locked


def direct_requirements(project: Mapping[str, Any]) -> list[Requirement]:
    """Return the requirements in ``pyproject.toml``: for the build, at run time, and of every extra."""
    metadata = project["project"]
    extras = metadata["optional-dependencies"].values()
    lists = (project["build-system"]["requires"], metadata["dependencies"], *extras)
    return [Requirement(line) for lines in lists for line in lines]


def pin_faults(requirements: Iterable[Requirement], locked: Mapping[str, Requirement]) -> list[str]:
    """Return a message for each requirement that is not pinned, or whose pin does not satisfy it."""
    faults = []
    for requirement in requirements:
        pin = locked.get(canonicalize_name(requirement.name))
        if pin is None:
            faults.append(f"{requirement} is not pinned")
        elif not requirement.specifier.contains(pinned_version(pin), prereleases=True):
            faults.append(f"{requirement} is not satisfied by {pin}")
    return faults


def pinned_version(pin: Requirement) -> str:
    """Return the version of a ``name==version`` requirement."""
    (specifier,) = pin.specifier
    return specifier.version


def marker_values(python: str, system: System) -> dict[str, str]:
    """Return the marker values of CPython ``python`` on ``system``; the patch release is taken as 0."""
    default = {name: str(value) for name, value in default_environment().items()}
    versions = {"python_version": python, "python_full_version": f"{python}.0", "implementation_version": f"{python}.0"}
    kind = {"implementation_name": "cpython", "platform_python_implementation": "CPython"}
    return default | versions | kind | dict(system.markers)


def applies(requirement: Requirement, markers: Mapping[str, str], extra: str = "") -> bool:
    """Return whether a requirement applies to an environment and an extra."""
    return requirement.marker is None or requirement.marker.evaluate({**markers, "extra": extra})


def wheel_requirements(pins: Iterable[Requirement], python: str, system: System) -> dict[str, list[Requirement]]:
    """Return the requirements of the wheel of each pin, keyed by package, as found by pip.

    Raise ``RuntimeError`` with the last message of pip if there is no wheel for this Python version and system.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--no-deps", "--quiet"]
        command += ["--disable-pip-version-check", "--only-binary=:all:", "--target", str(Path(folder) / "target")]
        command += ["--implementation", "cp", "--python-version", python, "--report", str(report)]
        command += [f"--platform={tag}" for tag in system.tags]
        command += [f"{pin.name}=={pinned_version(pin)}" for pin in pins]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR:")]
            raise RuntimeError(errors[-1] if errors else done.stderr)
        installed = json.loads(report.read_text(encoding="utf-8"))["install"]
    return {
        canonicalize_name(wheel["metadata"]["name"]): [
            Requirement(text) for text in wheel["metadata"].get("requires_dist", ())
        ]
        for wheel in installed
    }


def required_packages(
    direct: Iterable[Requirement], requires: Mapping[str, list[Requirement]], markers: Mapping[str, str]
) -> dict[tuple[str, str], Requirement]:
    """Return the direct and indirect requirements, keyed by package and text of the requirement."""
    required: dict[tuple[str, str], Requirement] = {}
    pending = [requirement for requirement in direct if applies(requirement, markers)]
    while pending:
        requirement = pending.pop()
        name = canonicalize_name(requirement.name)
        if (name, str(requirement)) in required:
            continue
        required[name, str(requirement)] = requirement
        extras = ("", *requirement.extras)
        pending += [
            inner for inner in requires.get(name, ()) if any(applies(inner, markers, extra) for extra in extras)
        ]
    return required


def check_wheels(locked: Mapping[str, Requirement], direct: list[Requirement]) -> list[str]:
    """Check the pins for every Python version on every system; print a line for each and return the faults."""
    faults: list[str] = []
    used: set[str] = set()
    for label, system in SYSTEMS.items():
        for python in PYTHONS:
            markers = marker_values(python, system)
            pins = {name: pin for name, pin in locked.items() if applies(pin, markers)}
            try:
                required = required_packages(direct, wheel_requirements(pins.values(), python, system), markers)
                new_faults = pin_faults(required.values(), pins)
            except RuntimeError as error:
                required, new_faults = {}, [str(error)]
            used |= {name for name, _ in required}
            verdict = "; ".join(new_faults) or f"{len(pins)} pins, complete, each with a wheel"
            print(f"Python {python} on {label}: {verdict}")
            faults += new_faults
    if not faults:
        faults += [f"{name} is pinned but not required" for name in locked if name not in used]
    return faults


def main() -> int:
    """Check the lock file of this project; return 0 if it has no fault."""
    parser = argparse.ArgumentParser(description="Check requirements.lock.")
    parser.add_argument("--wheels", action="store_true", help="also query the package index for the wheel of every pin")
    options = parser.parse_args()
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    faults = [f"not name==version: {line}" for line in malformed_lines(text)]
    if not faults:
        locked = pins_of(text)
        direct = direct_requirements(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8")))
        faults = pin_faults(direct, locked)
        if options.wheels and not faults:
            faults = check_wheels(locked, direct)
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
