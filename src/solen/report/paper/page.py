"""The page that compares reproduced figures with the paper's values: one self-contained file."""

import base64
from collections.abc import Sequence
from pathlib import Path

from markupsafe import Markup

from solen.paper.records import Drawing
from solen.paper.reproduction import ReproducedFigure
from solen.paper.statements import NEGLIGIBLE_PERCENT, SURE, Comparison
from solen.report.design.html import inline, rendered
from solen.report.design.summary import measured


def page(sections: Sequence[ReproducedFigure], missing: Sequence[str], folder: Path) -> str:
    """Return the page as HTML text; its images are read from a folder."""
    verdicts = [row.verdict for section in sections for row in section.comparisons]
    return rendered(
        "reproduction.html",
        sections=[
            (section, [_picture(folder / drawing.file, drawing) for drawing in section.drawings])
            for section in sections
        ],
        counts={verdict: verdicts.count(verdict) for verdict in ("agrees", "differs", "cannot be checked")},
        missing=missing,
        number=number,
        paper_number=paper_number,
        sure=SURE,
        negligible=NEGLIGIBLE_PERCENT,
    )


def number(row: Comparison) -> str:
    """Format solen's value with its uncertainty and unit."""
    if row.solen_value is None:
        return "–"
    return f"{measured(row.solen_value, row.u_solen_value, sign=False)}{_unit(row)}"


def paper_number(row: Comparison) -> str:
    """Format the paper's value with its unit, or a dash if the paper reports only no error or no difference."""
    if not row.paper_value:
        return "–"
    u = f" ± {row.u_paper_value:.2g}" if row.u_paper_value else ""
    return f"{row.paper_value:g}{u}{_unit(row)}"


def _unit(row: Comparison) -> str:
    return row.unit if row.unit.startswith("°") else f" {row.unit}" if row.unit else ""


def _picture(path: Path, one: Drawing) -> Markup:
    """Return an image to embed in the page: SVG unchanged, raster images as encoded data."""
    if path.suffix == ".svg":
        return inline(path.read_text(encoding="utf-8"), path.stem, one.alt)
    data = base64.b64encode(path.read_bytes()).decode()
    return Markup('<img alt="{}" src="data:image/png;base64,{}">').format(one.alt, data)
