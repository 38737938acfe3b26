"""A figure of the paper as reproduced by solen: its drawings and its comparisons with the paper."""

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
    """A drawing of a figure.

    Attributes
    ----------
    file
        Name of the file, such as ``3A.svg``; micrographs are ``.png``.
    alt
        Alternative text, for readers who cannot see the drawing.
    draw
        Function that draws it.
    options
        Width, letters and panels.
    mark
        Note on simulated data; empty if they are simulated in the paper, too.
    """

    file: str
    alt: str
    draw: "Callable[[], Figure]"
    options: FigureOptions = PAGE
    mark: str = ""


@dataclass(frozen=True)
class Made:
    """Drawings of a figure and its comparisons with the paper."""

    pictures: tuple[Picture, ...]
    comparisons: tuple[Comparison, ...]


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper: its title, and the commands and the function that make it."""

    name: str
    title: str
    commands: tuple[str, ...]
    make: Callable[[Path], Made]
