"""Commands that check the installation and install shell completion."""

from collections.abc import Iterator
from itertools import groupby
from typing import Literal

from solen.cli.app import app, lines
from solen.doctor import Installation, OptionalPackage, examine
from solen.errors import OutputError, SpecError
from solen.results import Outcome, Result

Shell = Literal["bash", "zsh", "fish"]
RELOAD: dict[str, str] = {"bash": "source ~/.bashrc", "zsh": "exec zsh", "fish": "exec fish"}


class Completion(Result):
    """Installed shell completion.

    Attributes
    ----------
    shell
        Name of the shell.
    load
        The line that activates completion in a running shell.
    """

    shell: str
    load: str


def doctor() -> Outcome[Installation]:
    """Check the installation: versions, threads, optional packages, compiled tracer, for bug reports."""
    return Outcome(examine())


@lines.register
def _(installation: Installation) -> Iterator[str]:
    system = f"{installation.platform}, {installation.threads} threads"
    yield f"solen {installation.version}, Python {installation.python}, {system}"
    yield f"  {installation.executable}"
    yield "  " + ", ".join(f"{name} {version}" for name, version in installation.packages.items())
    cache = installation.cache
    size = f"{cache.files} functions, {cache.size_bytes / 1e6:.1f} MB" if cache.files else "empty until the first trace"
    yield f"  compiled tracer: {cache.folder or 'not kept'} ({size})"
    yield "optional packages:"
    for extra, packages in groupby(installation.optional, key=lambda package: package.extra):
        yield f"  {extra:10} {_state(tuple(packages))}"
    for group, names in installation.plugins.items():
        if names:
            yield f"{group} added by other packages: {', '.join(names)}"
    yield "for a bug report, paste the lines above, the command and its full output"


def _state(packages: tuple[OptionalPackage, ...]) -> str:
    """Return the versions of the packages of one extra, and the command that installs it if any are missing."""
    state = ", ".join(f"{package.name} {package.version or 'missing'}" for package in packages)
    return state if all(package.version for package in packages) else f"{state}; {packages[0].install}"


def completion(shell: Shell | None = None, /) -> Outcome[Completion]:
    """Install completion of commands and options in the shell.

    Parameters
    ----------
    shell
        The shell; default: the one that runs this command.
    """
    shell = shell or _running_shell()
    try:
        script = app.install_completion(shell=shell)
    except OSError as bad:
        limit = f"cannot be written: {bad.strerror or bad}"
        raise OutputError(f"completion for {shell}", limit=limit, remedy="check your home folder") from None
    return Outcome(Completion(shell, RELOAD[shell]), {"completion": script})


@lines.register
def _(installed: Completion) -> Iterator[str]:
    yield f"completion is active in new {installed.shell} shells; to activate it in this shell, run: {installed.load}"


def _running_shell() -> Shell:
    from cyclopts.completion.detect import ShellDetectionError, detect_shell

    try:
        shell: str = detect_shell()
    except ShellDetectionError:
        shell = "unknown"
    if shell not in RELOAD:
        limit = f"completion is available for {', '.join(RELOAD)}"
        raise SpecError("shell", value=shell, limit=limit, remedy="name your shell: solen completion bash")
    return shell  # type: ignore[return-value]  # the keys of RELOAD are shells
