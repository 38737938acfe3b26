"""Rules for all files of the repository: names in their text, and imports of modules."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted((ROOT / "src" / "solen").rglob("*.py"))

# Written so that this file does not match itself.
REGISTRIES = re.compile(r"py[p]i\.org|py[t]honhosted|ana[c]onda\.(?:org|com)|np[m]js|/[s]imple/", re.IGNORECASE)
MACHINE_PATHS = re.compile(r"(?<![\w.~})-])/(?:work|root|opt|mnt|srv|(?:home|Users)/\w+)/|\b[A-Z]:[\\/]+Users\b")

POSIX_MODULES = {
    *("crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource", "spwd", "syslog"),
    *("termios", "tty"),
}
POSIX_NAMES = {
    *(f"os.{name}" for name in ("fork", "forkpty", "getuid", "geteuid", "getgid", "getegid", "chown", "chroot")),
    *(f"os.{name}" for name in ("getloadavg", "killpg", "mkfifo", "nice", "openpty", "setsid", "sysconf", "uname")),
    *(f"os.{name}" for name in ("sched_getaffinity", "sched_setaffinity", "statvfs", "wait", "WNOHANG")),
    *(f"signal.{name}" for name in ("alarm", "pause", "setitimer", "sigwait", "SIGALRM", "SIGHUP", "SIGKILL")),
    *(f"signal.{name}" for name in ("SIGUSR1", "SIGUSR2", "SIGQUIT", "SIGPIPE", "SIGCHLD", "SIGWINCH")),
}


def tracked() -> list[Path]:
    """Files that git tracks or would track; the test is skipped outside a clone."""
    git = shutil.which("git")
    if git is None or not (ROOT / ".git").exists():
        pytest.skip("not a clone of the project, or no git")
    command = [git, "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, capture_output=True, check=True).stdout.decode("utf-8")
    return [path for name in listed.split("\0") if name and (path := ROOT / name).is_file()]


def text_of(path: Path) -> str:
    """Text of a file; empty if it is not UTF-8."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return ""


def offending(pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{path.relative_to(ROOT)}:{number}: {line.strip()}"
        for path in tracked()
        for number, line in enumerate(text_of(path).splitlines(), 1)
        if pattern.search(line)
    ]


def test_no_file_names_package_registry() -> None:
    assert offending(REGISTRIES) == []


def test_no_file_names_machine_path() -> None:
    assert offending(MACHINE_PATHS) == []


@pytest.mark.parametrize("text", ["cd /" + "work/main", '"/' + 'home/ada/x"', "C:" + "\\Users\\ada", "(/" + "opt/y)"])
def test_recognises_machine_path(text: str) -> None:
    assert MACHINE_PATHS.search(text)


@pytest.mark.parametrize("text", ["https://example.org/work/1", "a/home/b/c", "../work/x", "~/opt/x"])
def test_accepts_other_path(text: str) -> None:
    assert not MACHINE_PATHS.search(text)


def posix_only(source: str) -> list[str]:
    """Names in source code that exist only on POSIX systems."""
    names_found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                names_found += [alias.name for alias in names if alias.name.partition(".")[0] in POSIX_MODULES]
            case ast.ImportFrom(module=str(module), level=0, names=names):
                names_found += [module] if module.partition(".")[0] in POSIX_MODULES else []
                names_found += [name for alias in names if (name := f"{module}.{alias.name}") in POSIX_NAMES]
            case ast.Attribute(value=ast.Name(id=owner), attr=attr) if f"{owner}.{attr}" in POSIX_NAMES:
                names_found.append(f"{owner}.{attr}")
            case _:
                pass
    return names_found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_library_uses_no_posix_only_name(path: Path) -> None:
    assert posix_only(path.read_text(encoding="utf-8")) == []


def test_recognises_posix_only_names() -> None:
    source = "import os, fcntl\nfrom signal import SIGALRM, SIGINT\nos.fork()\nos.fsync(0)\nfrom . import resource\n"
    assert sorted(posix_only(source)) == ["fcntl", "os.fork", "signal.SIGALRM"]


def test_imports_follow_order_of_stages() -> None:
    program = shutil.which("lint-imports", path=str(Path(sys.executable).parent))
    assert program is not None, "import-linter is not installed in this environment"
    done = subprocess.run(
        [program, "--no-cache"], cwd=ROOT, capture_output=True, text=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_citation_names_software_and_paper() -> None:
    citation: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message", "title", "authors", "version", "license"} <= citation.keys()
    assert str(citation["cff-version"]) == "1.2.0"
    (paper,) = citation["references"]
    assert {"type", "title", "authors"} <= paper.keys()
    assert [author["family-names"] for author in paper["authors"]] == ["Cafiso", "Trunin", "Gay", "Beccai"]


def test_versions_agree() -> None:
    import solen

    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == solen.__version__
    assert f'version = "{solen.__version__}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")


def private_names(path: Path) -> list[str]:
    """Private names of solen that a file imports, or uses as attributes of imported names."""
    tree, names, modules = ast.parse(path.read_text(encoding="utf-8")), [], set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "solen":
            names += [alias.name for alias in node.names if re.match(r"_[a-z]", alias.name)]
            modules |= {alias.asname or alias.name for alias in node.names}
            names += [part for part in (node.module or "").split(".") if part.startswith("_")]
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in modules:
            names += [node.attr] if re.match(r"_[a-z]", node.attr) else []
    return names


def test_no_test_uses_private_name() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    private = {path.relative_to(ROOT).as_posix(): names for path in files if (names := private_names(path))}
    assert private == {}


def test_results_are_not_decorated_as_dataclasses() -> None:
    """With a decorator, assigning to a field would raise the error of dataclasses, which has no remedy."""
    decorated = re.compile(r"^@dataclass\(.*repr=False.*\)\nclass \w+\((?!ABC)", re.MULTILINE)
    assert [path.relative_to(ROOT).as_posix() for path in SOURCES if decorated.search(text_of(path))] == []
