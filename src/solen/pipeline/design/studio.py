"""An HTML page with sliders for a design, which needs no server."""

from pathlib import Path

from solen import files
from solen.errors import OutputError
from solen.explore.sliders import Sliders, SlidersOptions
from solen.explore.sliders import sliders as computed_sliders
from solen.pipeline.design.designs import open_design
from solen.pipeline.options import ProgressBar, Set
from solen.results import Outcome


def export(
    file: Path,
    page: Path,
    options: SlidersOptions = SlidersOptions(),
    assignments: Set = None,
    progress: ProgressBar = None,
) -> Outcome[Sliders]:
    """Write an HTML page with sliders for a design."""
    from solen.report.design.player import html

    if page.suffix.lower() != ".html":
        raise OutputError(str(page), limit="a page must end in .html", remedy="rename it")
    result = computed_sliders(open_design(file, assignments), options, progress)
    return Outcome(result, {"page": files.write_text(page, html(result))})
