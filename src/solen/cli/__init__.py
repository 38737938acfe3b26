"""The command line; its commands are functions of `solen.pipeline`, listed in the table `solen.cli.commands`.

With ``--json`` a command prints one JSON object on stdout and everything else on stderr. Bad input ends with one line
on stderr and exit code 2; Ctrl-C ends with one line and exit code 130.
"""

import difflib
import gc
import io
import os
import re
import sys
from collections.abc import Sequence
from contextlib import nullcontext
from itertools import accumulate, pairwise
from typing import Any

import cyclopts

from solen.cli.app import SHOWN, app, progress_bar, show_outcome
from solen.cli.commands import GROUPS
from solen.cli.waiting import is_silent, progress_messages
from solen.errors import SolenError
from solen.results import Outcome

BAD_INPUT, INTERRUPTED = 2, 130
MIN_SIMILARITY = 0.75
"""Similarity above which a known option is suggested for an unknown one."""
MIN_PREFIX = 3
"""Minimum length of an option that is suggested for an unknown option that begins with it."""
GC_THRESHOLDS = 20_000, 50, 50
"""Thresholds of the cyclic garbage collector of Python. With the default of 700 new objects, the collector ran
continually while modules were imported, which took a tenth of the run time; the higher thresholds cost a few megabytes.
"""


def main() -> None:
    """Run the command in the arguments of the process, and exit with its code."""
    gc.set_threshold(*GC_THRESHOLDS)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for characters that the terminal does not support
    arguments = sys.argv[1:]
    command = " ".join(arguments[: 2 if arguments[:1] and arguments[0] in GROUPS else 1])
    with nullcontext() if is_silent(arguments) else progress_messages(f"solen {command}"):
        code = run_command(arguments)
    gc.freeze()  # avoids the collection at exit, a tenth of a run
    sys.exit(code)


def run_command(arguments: Sequence[str]) -> int:
    """Run a command, print its result and return its exit code; print an error that a user can correct as one line."""
    SHOWN.as_json, SHOWN.quiet = "--json" in arguments, "--quiet" in arguments
    remaining = [argument for argument in arguments if argument not in {"--json", "--quiet"}]
    try:
        result = _result(remaining)
        if isinstance(result, Outcome):
            show_outcome(result)
        sys.stdout.flush()
    except SolenError as bad:
        return _report(str(bad), BAD_INPUT)
    except cyclopts.CycloptsError as bad:
        return _report(_one_line(bad, remaining), BAD_INPUT)
    except KeyboardInterrupt as bad:  # a bench run reports the files that it keeps
        return _report(
            str(bad) or "interrupted; no incomplete file was written", getattr(bad, "exit_code", INTERRUPTED)
        )
    except (BrokenPipeError, SystemExit):  # the pipe was closed; in help, rich then raises SystemExit
        _drop_output()
        return 0
    except OSError as bad:
        _drop_output()
        return _report(f"output cannot be written: {bad.strerror or bad}", BAD_INPUT)
    return 0


def _result(arguments: Sequence[str]) -> Any:
    """Run a command and return its result; show a progress bar if the command reports progress."""
    command, bound, unset = app.parse_args(arguments, exit_on_error=False, print_error=False)
    if "progress" not in unset:
        return command(*bound.args, **bound.kwargs)
    with progress_bar(command.__name__) as progress:
        return command(*bound.args, **bound.kwargs, progress=progress)


def _one_line(bad: cyclopts.CycloptsError, arguments: Sequence[str]) -> str:
    """Return a command line error as one line; for a value outside its limits, the line names the option."""
    if isinstance(bad, cyclopts.MissingArgumentError):
        for option, value in pairwise(arguments):
            if option == bad.keyword and re.match(r"-[\d.]", value):  # parsed as an option
                return f"{option} = {value}; must be a number; write it without a unit"
    if isinstance(bad, cyclopts.UnknownOptionError):
        return _unknown_option(bad)
    if isinstance(bad, cyclopts.UnusedCliTokensError):
        surplus = bad.unused_tokens or []
        limit = "is a surplus argument" if len(surplus) == 1 else "are surplus arguments"
        return f"{' '.join(surplus)}; {limit}; see the command's --help"
    if isinstance(bad.__cause__, ValueError) and hasattr(bad.__cause__, "errors"):
        from solen.spec.strict import option_refusal

        return str(option_refusal(bad.__cause__, command_line=True))
    return " ".join(str(bad).split())


def _unknown_option(bad: cyclopts.UnknownOptionError) -> str:
    """Return the error for an unknown option, which suggests a similar option or one with the same beginning."""
    option = (bad.token.keyword or bad.token.value).split("=", 1)[0]
    known = [name for argument in bad.argument_collection for name in argument.names if name.startswith("--")]
    names: dict[str, str] = {}  # keyed by the name and its first words: angle, angle-deg
    for name in known:
        names |= dict.fromkeys(accumulate(name[2:].lower().split("-"), "{}-{}".format), name)
    names |= {name[2:].lower(): name for name in known}
    word = option.lstrip("-").lower()
    prefixes = [short for short in names if word.startswith(short) and len(short) >= MIN_PREFIX]
    suggestion = max(prefixes, key=len, default="") or next(
        iter(difflib.get_close_matches(word, names, 1, MIN_SIMILARITY)), ""
    )
    return f"Unknown option: {option}; " + (
        f"did you mean {names[suggestion]}?" if suggestion else "see the command's --help"
    )


def _drop_output() -> None:
    """Discard buffered output that stdout no longer accepts, so that flushing at exit does not fail."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115  open until the interpreter exits


def _report(line: str, code: int) -> int:
    sys.stderr.write(f"solen: {line}\n")  # `print` is a package here
    return code
