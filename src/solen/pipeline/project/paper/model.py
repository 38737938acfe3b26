"""A figure of the paper as solen makes it: its pictures, not yet drawn, and its comparisons with the paper."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from solen.paper.statements import Comparison
from solen.report.options import FigureOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = FigureOptions(width_mm=180)
COLUMN = FigureOptions(width_mm=110)


@dataclass(frozen=True)
class Picture:
    """A picture: its file, the text in its place, and its figure.

    Attributes
    ----------
    file
        ``3A.svg``; photographs are ``.png``.
    alt
        Text for those who do not see it.
    draw
        Draws it.
    look
        Width, letters, panels.
    mark
        What it says of simulated data; empty where the paper simulates as well.
    """

    file: str
    alt: str
    draw: "Callable[[], Figure]"
    look: FigureOptions = PAGE
    mark: str = ""


@dataclass(frozen=True)
class Made:
    """Pictures and comparisons of a figure."""

    pictures: tuple[Picture, ...]
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper: contents, the commands that make it alone and the function that does so."""

    name: str
    title: str
    commands: tuple[str, ...]
    make: Callable[[Path], Made]
