"""Output of the command that reproduces the figures of the paper."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.paper.reproduction import Reproduction
from solen.pipeline.project.reproduce import reproduce as reproduce


@lines.register
def _(result: Reproduction) -> Iterator[str]:
    from solen.report.paper.page import solen_number

    made = sum(figure.made for figure in result.figures)
    figures = "figure" if len(result.figures) == 1 else "figures"
    yield f"{len(result.figures)} {figures} of the paper: {made} made now, {len(result.figures) - made} kept"
    for figure in result.figures:
        yield f"figure {figure.name}"
        yield from (
            f"  {row.verdict:17}  {row.paper}; {row.quantity}: {solen_number(row)}" for row in figure.comparisons
        )
    yield f"{result.agrees} agree, {result.differs} differ, {result.cannot_be_checked} cannot be checked"
    if result.not_made:
        yield f"not requested and not made before: {', '.join(result.not_made)}"
