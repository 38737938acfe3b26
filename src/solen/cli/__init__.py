"""The command line. Its commands are functions of `solen.pipeline`, listed in the table `solen.cli.commands`.

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
"""Smallest number of letters of an option with which a longer, unknown one must begin for it to be suggested."""
GC_THRESHOLDS = 20_000, 50, 50
"""Thresholds of Python's cyclic garbage collector. Its default of 700 new objects is exceeded all the time while
modules load, which took a tenth of a run; the higher thresholds cost a few megabytes.
"""


def main() -> None:
    """Run a command as the entry point; report errors that a user can correct in one line."""
    gc.set_threshold(*GC_THRESHOLDS)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for terminals that lack a character
    arguments = sys.argv[1:]
    named = " ".join(arguments[: 2 if arguments[:1] and arguments[0] in GROUPS else 1])
    with nullcontext() if is_silent(arguments) else progress_messages(f"solen {named}"):
        code = run_command(arguments)
    gc.freeze()  # otherwise Python collects once more at exit, a tenth of a run
    sys.exit(code)


def run_command(arguments: Sequence[str]) -> int:
    """Run a command line, print its answer and return its exit code."""
    SHOWN.as_json, SHOWN.quiet = "--json" in arguments, "--quiet" in arguments
    rest = [argument for argument in arguments if argument not in {"--json", "--quiet"}]
    try:
        answer = _answer(rest)
        if isinstance(answer, Outcome):
            show_outcome(answer)
        sys.stdout.flush()
    except SolenError as bad:
        return _refuse(str(bad), BAD_INPUT)
    except cyclopts.CycloptsError as bad:
        return _refuse(_one_line(bad, rest), BAD_INPUT)
    except KeyboardInterrupt as bad:  # a run on the bench reports the files it keeps
        return _refuse(
            str(bad) or "interrupted; no incomplete file was written", getattr(bad, "exit_code", INTERRUPTED)
        )
    except (BrokenPipeError, SystemExit):  # the reader closed the pipe; rich exits like this in help
        _drop_output()
        return 0
    except OSError as bad:
        _drop_output()
        return _refuse(f"output cannot be written: {bad.strerror or bad}", BAD_INPUT)
    return 0


def _answer(arguments: Sequence[str]) -> Any:
    """Run a command and return its result; show a progress bar if the command reports progress."""
    command, bound, unset = app.parse_args(arguments, exit_on_error=False, print_error=False)
    if "progress" not in unset:
        return command(*bound.args, **bound.kwargs)
    with progress_bar(command.__name__) as progress:
        return command(*bound.args, **bound.kwargs, progress=progress)


def _one_line(bad: cyclopts.CycloptsError, arguments: Sequence[str]) -> str:
    """Return an error of a command line in one line; a value outside an option's limits is named by its option."""
    if isinstance(bad, cyclopts.MissingArgumentError):
        for option, value in pairwise(arguments):
            if option == bad.keyword and re.match(r"-[\d.]", value):  # not a number, so parsed as an option
                return f"{option} = {value}; is not a number; write it without a unit"
    if isinstance(bad, cyclopts.UnknownOptionError):
        return _unknown_option(bad)
    if isinstance(bad, cyclopts.UnusedCliTokensError):
        further = bad.unused_tokens or []
        limit = "is a surplus argument" if len(further) == 1 else "are surplus arguments"
        return f"{' '.join(further)}; {limit}; see the command's --help"
    if isinstance(bad.__cause__, ValueError) and hasattr(bad.__cause__, "errors"):
        from solen.spec.strict import option_refusal

        return str(option_refusal(bad.__cause__, command_line=True))
    return " ".join(str(bad).split())


def _unknown_option(bad: cyclopts.UnknownOptionError) -> str:
    """Return a line on an unknown option, with a similar one or one with the same beginning as a suggestion."""
    option = (bad.token.keyword or bad.token.value).split("=", 1)[0]
    known = [name for one in bad.argument_collection for name in one.names if name.startswith("--")]
    names: dict[str, str] = {}  # each option by its name and leading words: angle and angle-deg are --angle-deg
    for name in known:
        names |= dict.fromkeys(accumulate(name[2:].lower().split("-"), "{}-{}".format), name)
    names |= {name[2:].lower(): name for name in known}
    word = option.lstrip("-").lower()
    begun = [short for short in names if word.startswith(short) and len(short) >= MIN_PREFIX]
    near = max(begun, key=len, default="") or next(iter(difflib.get_close_matches(word, names, 1, MIN_SIMILARITY)), "")
    return f"Unknown option: {option}; " + (f"did you mean {names[near]}?" if near else "see the command's --help")


def _drop_output() -> None:
    """Discard buffered output that stdout no longer accepts, so that flushing at exit does not fail."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115  it lives until the interpreter ends


def _refuse(line: str, code: int) -> int:
    sys.stderr.write(f"solen: {line}\n")  # `print` is the name of a package here
    return code
