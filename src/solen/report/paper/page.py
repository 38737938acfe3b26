"""The page that compares reproduced figures with the values of the paper: one self-contained HTML file."""

import base64
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from solen.paper.records import Drawing
from solen.paper.reproduction import ReproducedFigure
from solen.paper.statements import COVERAGE_FACTOR, NEGLIGIBLE_PERCENT, Comparison
from solen.report.design.html import inline, rendered
from solen.report.design.summary import measured


def page(sections: Sequence[ReproducedFigure], missing: Sequence[str], folder: Path) -> str:
    """Return the page as HTML; its images are read from a folder."""
    verdicts = [row.verdict for section in sections for row in section.comparisons]
    return rendered(
        "reproduction.html",
        sections=[
            (section, [_image(folder / drawing.file, drawing) for drawing in section.drawings]) for section in sections
        ],
        counts={verdict: verdicts.count(verdict) for verdict in ("agrees", "differs", "cannot be checked")},
        missing=missing,
        solen_number=solen_number,
        paper_number=paper_number,
        coverage_factor=COVERAGE_FACTOR,
        negligible=NEGLIGIBLE_PERCENT,
    )


def solen_number(row: Comparison) -> str:
    """Format the value computed by solen, with its uncertainty and unit."""
    if row.solen_value is None:
        return "–"
    return f"{measured(row.solen_value, row.u_solen_value, sign=False)}{_unit(row)}"


def paper_number(row: Comparison) -> str:
    """Format the value of the paper with its unit, or a dash if it is 0 or none is reported."""
    if not row.paper_value:
        return "–"
    u = f" ± {row.u_paper_value:.2g}" if row.u_paper_value else ""
    return f"{row.paper_value:g}{u}{_unit(row)}"


def _unit(row: Comparison) -> str:
    return row.unit if row.unit.startswith("°") else f" {row.unit}" if row.unit else ""


def _image(path: Path, drawing: Drawing) -> Markup:
    """Return an image to embed in the page: SVG unchanged, raster images as encoded data."""
    if path.suffix == ".svg":
        return inline(path.read_text(encoding="utf-8"), path.stem, drawing.alt)
    data = base64.b64encode(path.read_bytes()).decode()
    return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(drawing.alt, data)
