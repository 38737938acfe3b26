"""Options shared by many commands, as annotations of their parameters."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.progress import Progress

FLAT = Parameter(name="*")
"""Annotation of the `Options` of a command that makes each field an option: ``Annotated[CutbackOptions, FLAT]``."""
Set = Annotated[
    Sequence[str] | None,
    Parameter(name="--set", negative=(), help="Set a key of the design, as in --set lens.focus_mm=25; repeatable."),
]
Sheet = Annotated[
    str | None, Parameter(name="--sheet", help="Sheet of a workbook; default: the only sheet with numbers.")
]
ProgressBar = Annotated[Progress | None, Parameter(parse=False)]
"""Function called with the completed fraction of the work, up to 1; the command line shows a progress bar."""
Force = Annotated[bool, Parameter(name="--force", help="Replace an existing file.")]
Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json file.")]
