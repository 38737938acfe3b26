"""Check ``requirements.lock``: its form, its completeness, and that every pin has a wheel for each supported system.

``python tools/pins.py`` checks the form and the direct dependencies, offline. ``python tools/pins.py --wheels`` also
asks the package index, through pip, for the wheels of each Python and platform below, and follows their requirements
with the markers of that Python and platform: every required package must be pinned, and every pin must be required
somewhere. This shows that the pins can be installed there, not that solen runs there.
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
    """An operating system on one processor: the wheels that it accepts and the values of its markers."""

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
    """Return the lines of a lock that are neither blank nor comments."""
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def malformed(text: str) -> list[str]:
    """Return the lines that are not ``name==version``, with or without a simple marker."""
    return [line for line in lock_lines(text) if not LINE.fullmatch(line)]


def pins(text: str) -> dict[str, Requirement]:
    """Return the lock's requirements by normalised name; raise ``ValueError`` if a name occurs twice."""
    found: dict[str, Requirement] = {}
    for line in lock_lines(text):
        requirement = Requirement(line)
        if found.setdefault(canonicalize_name(requirement.name), requirement) is not requirement:
            raise ValueError(f"{requirement.name} is pinned twice")
    return found


def direct(project: Mapping[str, Any]) -> list[Requirement]:
    """Return the requirements in ``pyproject.toml``: to build, to run, and of every extra."""
    about = project["project"]
    lists = (project["build-system"]["requires"], about["dependencies"], *about["optional-dependencies"].values())
    return [Requirement(text) for wanted in lists for text in wanted]


def unpinned(requirements: Iterable[Requirement], locked: Mapping[str, Requirement]) -> list[str]:
    """Return the requirements without a pin, or with a pin that does not satisfy them."""
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
    (only,) = pin.specifier
    return only.version


def environment(python: str, system: System) -> dict[str, str]:
    """Return the marker values of CPython ``python`` on ``system``; the patch release is assumed to be 0."""
    seen = {name: str(value) for name, value in default_environment().items()}
    versions = {"python_version": python, "python_full_version": f"{python}.0", "implementation_version": f"{python}.0"}
    kind = {"implementation_name": "cpython", "platform_python_implementation": "CPython"}
    return seen | versions | kind | dict(system.markers)


def applies(requirement: Requirement, seen: Mapping[str, str], extra: str = "") -> bool:
    """Return whether the requirement's marker is true in environment ``seen`` for ``extra``."""
    return requirement.marker is None or requirement.marker.evaluate({**seen, "extra": extra})


def wheels(chosen: Iterable[Requirement], python: str, system: System) -> dict[str, list[Requirement]]:
    """Ask pip for the wheel of each pin, and return the requirements of each.

    Raise ``RuntimeError`` with pip's last message if one has no wheel for that Python and system.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--no-deps", "--quiet"]
        command += ["--disable-pip-version-check", "--only-binary=:all:", "--target", str(Path(folder) / "target")]
        command += ["--implementation", "cp", "--python-version", python, "--report", str(report)]
        command += [f"--platform={tag}" for tag in system.tags]
        command += [f"{pin.name}=={pinned_version(pin)}" for pin in chosen]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR:")]
            raise RuntimeError(errors[-1] if errors else done.stderr)
        found = json.loads(report.read_text(encoding="utf-8"))["install"]
    return {
        canonicalize_name(one["metadata"]["name"]): [
            Requirement(text) for text in one["metadata"].get("requires_dist", ())
        ]
        for one in found
    }


def reached(
    start: Iterable[Requirement], requires: Mapping[str, list[Requirement]], seen: Mapping[str, str]
) -> dict[tuple[str, str], Requirement]:
    """Return all packages that ``start`` requires, directly or not, by package and text of the requirement."""
    found: dict[tuple[str, str], Requirement] = {}
    waiting = [one for one in start if applies(one, seen)]
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if (name, str(requirement)) in found:
            continue
        found[name, str(requirement)] = requirement
        extras = ("", *requirement.extras)
        waiting += [one for one in requires.get(name, ()) if any(applies(one, seen, extra) for extra in extras)]
    return found


def check_wheels(locked: Mapping[str, Requirement], wanted: list[Requirement]) -> list[str]:
    """Check the pins for every Python on every system; print a line for each and return the faults."""
    faults: list[str] = []
    used: set[str] = set()
    for label, system in SYSTEMS.items():
        for python in PYTHONS:
            seen = environment(python, system)
            chosen = {name: pin for name, pin in locked.items() if applies(pin, seen)}
            try:
                found = reached(wanted, wheels(chosen.values(), python, system), seen)
                new = unpinned(found.values(), chosen)
            except RuntimeError as refused:
                found, new = {}, [str(refused)]
            used |= {name for name, _ in found}
            print(f"Python {python} on {label}: {'; '.join(new) or f'{len(chosen)} pins, all wheels, complete'}")
            faults += new
    if not faults:
        faults += [f"{name} is pinned but nothing needs it" for name in locked if name not in used]
    return faults


def main() -> int:
    """Check the lock of this project; return 0 if it has no fault."""
    parser = argparse.ArgumentParser(description="Check requirements.lock.")
    parser.add_argument("--wheels", action="store_true", help="also ask the package index for every wheel")
    asked = parser.parse_args()
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    faults = [f"not name==version: {line}" for line in malformed(text)]
    if not faults:
        locked = pins(text)
        wanted = direct(tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8")))
        faults = unpinned(wanted, locked)
        if asked.wheels and not faults:
            faults = check_wheels(locked, wanted)
    for fault in faults:
        print(fault, file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
