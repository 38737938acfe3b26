"""Options that many commands share, as the annotations of their parameters."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from solen.arrays import Progress

FLAT = Parameter(name="*")
"""Annotation of a command's `Options`: each field is an option of its own, ``Annotated[CutbackOptions, FLAT]``."""
Set = Annotated[
    Sequence[str] | None,
    Parameter(
        name="--set", negative=(), help="A key of the design and its value, as in --set lens.focus_mm=25; repeatable."
    ),
]
Sheet = Annotated[
    str | None, Parameter(name="--sheet", help="Sheet of a workbook; default: the only one with numbers.")
]
ProgressBar = Annotated[Progress | None, Parameter(parse=False)]
"""Called with the share that is done, up to 1; a command line shows it as a bar."""
Force = Annotated[bool, Parameter(name="--force", help="Replace a file that exists.")]
Out = Annotated[Path | None, Parameter(name="--out", help="Write the result to this .json file.")]
