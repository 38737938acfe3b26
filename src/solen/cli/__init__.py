"""The commands, in the order of the chain. Each is a thin door on `solen.pipeline`.

With ``--json`` a command prints one JSON object on stdout and everything else on stderr. Bad input ends with one line
on stderr and exit code 2; Ctrl-C with one line and 130. Nothing heavy is imported before a command needs it: the
modules beside this one hold the commands, each registers with `solen.cli.app`.
"""

import io
import os
import sys

import cyclopts

from solen.cli import (
    analyse,
    bench,
    coupons,
    cure,
    cutback,
    decode,
    demodulate,
    design,
    diagnose,
    export,
    index,
    inspect,
    layers,
    printed,
    readout,
    refractometer,
    resin,
    spectra,
    stiffness,
)
from solen.cli.app import app
from solen.errors import SolenError

__all__ = [
    "analyse",
    "app",
    "bench",
    "coupons",
    "cure",
    "cutback",
    "decode",
    "demodulate",
    "design",
    "diagnose",
    "export",
    "index",
    "inspect",
    "layers",
    "main",
    "printed",
    "readout",
    "refractometer",
    "resin",
    "spectra",
    "stiffness",
]

BAD_INPUT, INTERRUPTED = 2, 130


def main() -> None:
    """Entry point: run a command and turn what a user can mend into one line."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal that lacks a letter is no reason to fail
    sys.exit(_run(sys.argv[1:]))


def _run(arguments: list[str]) -> int:
    """Exit code of a command line."""
    try:
        app(arguments, exit_on_error=False, print_error=False, result_action="return_none")
        sys.stdout.flush()
    except SolenError as bad:
        return _refuse(str(bad), BAD_INPUT)
    except cyclopts.CycloptsError as bad:
        return _refuse(" ".join(str(bad).split()), BAD_INPUT)
    except KeyboardInterrupt:
        return _refuse("interrupted; no file is half-written", INTERRUPTED)
    except BrokenPipeError:  # the reader of a pipe had enough
        _drop_output()
        return 0
    except OSError as bad:
        _drop_output()
        return _refuse(f"output cannot be written: {bad.strerror or bad}", BAD_INPUT)
    return 0


def _drop_output() -> None:
    """Send what is still to be flushed at exit nowhere, where stdout can take no more."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: PTH123, SIM115  it lives until the interpreter ends


def _refuse(line: str, code: int) -> int:
    print(f"solen: {line}", file=sys.stderr)
    return code
