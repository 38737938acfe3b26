"""Options of the commands that read recordings, and separation of the files typed after them."""

from pathlib import Path
from typing import Annotated, TypeVar

from cyclopts import Parameter

from solen.analysis import AnalysisOptions, SignalOptions

Flat = Parameter(name="*", consume_multiple=True)
"""Annotation of `Options`: each field is an option; a tuple is an option with several values."""
Analysed = Annotated[AnalysisOptions, Flat]
Recorded = Annotated[SignalOptions, Flat]
ANALYSED, RECORDED = AnalysisOptions(), SignalOptions()
T = TypeVar("T", bound=SignalOptions)


def split_files(files: tuple[Path, ...], options: T) -> tuple[tuple[Path, ...], T]:
    """Return all files, including those typed after ``--channel``, and the options without them."""
    added = [text for text in options.channel if "=" not in text and Path(text).is_file()]
    channel = tuple(text for text in options.channel if text not in added)
    return (*files, *map(Path, added)), options.model_copy(update={"channel": channel})
