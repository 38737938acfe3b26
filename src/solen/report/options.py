"""Style and file of a figure: the options of every command with ``--figure``."""

import math
from pathlib import Path
from typing import Annotated

from annotated_types import Ge, Le
from pydantic import Field

from solen.errors import OutputError, SpecError
from solen.spec.strict import Finite, Options, reported_as

PIXELS = (".png", ".tiff", ".tif")
KINDS = (".svg", ".pdf", ".eps", *PIXELS)
MIN_PT = 6.0
"""Smallest font size, as journals require."""
LETTERS_LIMIT = "must be one letter: A, a or (a)"
Limits = tuple[str | None, str, float, float]
"""Panel (None for all), name of the axis (x or y), and ends of the axis."""


class FigureOptions(Options):
    """File and style of a figure."""

    figure: Path | None = None
    """Draw the result into this .svg, .pdf, .eps, .png or .tiff."""
    width_mm: Annotated[Finite, Ge(40.0), Le(600.0)] | None = None
    """Width of the figure, such as 90 for a column and 180 for a page; panels that do not fit side by side are
    stacked.
    """
    height_mm: Annotated[Finite, Ge(30.0), Le(600.0)] | None = None
    """Height of the figure; by default the height that its panels need."""
    font: str | None = None
    """Font of the lettering; by default the first installed of Helvetica Neue, Arial, Liberation Sans and DejaVu
    Sans.
    """
    font_pt: Annotated[Finite, Ge(MIN_PT), Le(24.0)] | None = None
    """Font size of the lettering; by default 9, or 8 with --width-mm. No lettering is smaller than 6."""
    no_titles: bool = False
    """Omit titles from the picture, except a note that data are simulated; the file's description keeps them."""
    letters: Annotated[str | None, Field(pattern=r"^([A-Za-z]|\([A-Za-z]\))$"), reported_as(LETTERS_LIMIT)] = None
    """Letter the panels, starting with A, a or (a), or with E if a figure is assembled from several files."""
    panels: str = ""
    """Draw only some panels, such as AC; the first is A, AA comes after Z. Separate double letters by commas: A,AA."""
    limits: tuple[str, ...] = ()
    """Limits of an axis: x=400:900 for all panels, B.y=0:1 for one; repeatable."""
    dpi: int = Field(300, ge=72, le=1200)
    """Resolution of .png and .tiff in pixels per inch."""

    @property
    def size_pt(self) -> float:
        """Font size of the lettering."""
        return self.font_pt or (9.0 if self.width_mm is None else 8.0)

    def ends(self) -> list[Limits]:
        """Return the axis limits; raise `SpecError` if one is malformed."""
        return [_ends(text) for text in self.limits]

    def check(self, *others: Path | None) -> None:
        """Check these options and the files of other figures that share them.

        Raises
        ------
        OutputError
            If a figure has an unknown extension.
        SpecError
            If a style option is given without a figure, or limits are malformed.
        """
        files = [file for file in (self.figure, *others) if file is not None]
        specified = [name for name, field in type(self).model_fields.items() if getattr(self, name) != field.default]
        if specified and not files:
            raise SpecError(
                f"--{specified[0].replace('_', '-')}", limit="applies only to a figure", remedy="add --figure FILE"
            )
        for file in files:
            if file.suffix.lower() not in KINDS:
                raise OutputError(str(file), limit=f"a figure must end in {', '.join(KINDS)}", remedy="rename it")
        if files and "dpi" in specified and not any(file.suffix.lower() in PIXELS for file in files):
            limit = f"applies to {', '.join(PIXELS)}, and {files[0].name} has no pixels"
            raise SpecError("--dpi", value=self.dpi, limit=limit, remedy="omit it")
        self.ends()


def _ends(text: str) -> Limits:
    target, _, ends = text.partition("=")
    panel, _, axis = target.strip().rpartition(".")
    first, _, last = ends.partition(":")
    try:
        low, high = float(first), float(last)
    except ValueError:
        low = high = 0.0
    if axis not in {"x", "y"} or (panel and not panel.isalpha()) or not 0.0 < abs(high - low) < math.inf:
        limit = "must be an axis and two different numbers"
        raise SpecError("--limits", value=text, limit=limit, remedy="write x=400:900, or B.y=0:1 for panel B")
    return panel.upper() or None, axis, low, high
