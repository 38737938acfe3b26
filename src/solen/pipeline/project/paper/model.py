"""A figure of the paper as made by solen: its drawings, ready to be rendered, and its comparisons with the paper."""

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
    """A picture: its file, the alternative text, and its figure.

    Attributes
    ----------
    file
        Name of the file, such as ``3A.svg``; photographs are ``.png``.
    alt
        Text for readers who cannot see the picture.
    draw
        Function that draws the picture.
    look
        Width, letters, panels.
    mark
        Note on simulated data; empty if the paper simulates them as well.
    """

    file: str
    alt: str
    draw: "Callable[[], Figure]"
    look: FigureOptions = PAGE
    mark: str = ""


@dataclass(frozen=True)
class Made:
    """Drawings in a figure and its comparisons with the paper."""

    pictures: tuple[Picture, ...]
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper: its contents, the commands that make it, and the function that makes it here."""

    name: str
    title: str
    commands: tuple[str, ...]
    make: Callable[[Path], Made]
