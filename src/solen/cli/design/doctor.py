"""The commands about solen itself: what is installed, and completion in the shell."""

from collections.abc import Iterator
from typing import Literal

from solen.cli.app import app, lines
from solen.doctor import Installation, examine
from solen.errors import OutputError, SpecError
from solen.results import Outcome, Result

Shell = Literal["bash", "zsh", "fish"]
RELOAD: dict[str, str] = {"bash": "source ~/.bashrc", "zsh": "exec zsh", "fish": "exec fish"}


class Completion(Result):
    """Completion that was installed.

    Attributes
    ----------
    shell
        For which it is.
    load
        The line that makes it work in a shell that runs already.
    """

    shell: str
    load: str


def doctor() -> Outcome[Installation]:
    """Check the installation: versions, threads, optional packages, the compiled tracer; to paste into a bug report."""
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
    for package in installation.optional:
        yield f"  {package.name:22} {package.version or f'missing; {package.install}'}"
    for group, names in installation.plugins.items():
        if names:
            yield f"added to {group} by other packages: {', '.join(names)}"
    yield "in a bug report, paste the lines above, the command and all that it printed"


def completion(shell: Shell | None = None, /) -> Outcome[Completion]:
    """Install completion of commands and options in the shell.

    Parameters
    ----------
    shell
        Default: the shell that runs the command.
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
    yield f"{installed.shell} completes solen in new shells; in this one after: {installed.load}"


def _running_shell() -> Shell:
    from cyclopts.completion.detect import ShellDetectionError, detect_shell

    try:
        shell: str = detect_shell()
    except ShellDetectionError:
        shell = "unknown"
    if shell not in RELOAD:
        limit = f"completion is for {', '.join(RELOAD)}"
        raise SpecError("shell", value=shell, limit=limit, remedy="name yours: solen completion bash")
    return shell  # type: ignore[return-value]  # a key of RELOAD is one
