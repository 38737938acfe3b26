"""The result of a reproduction: the finished figures, and how many statements in the paper agree."""

from solen.paper.records import Drawing
from solen.paper.statements import AGREES, DIFFERS, UNCHECKED, Comparison, Verdict
from solen.ranks import Caution, note
from solen.results import Result, reported


class ReproducedFigure(Result):
    """A figure of the paper as reproduced by solen.

    Attributes
    ----------
    name, title
        Its name (``3B-D``) and what it shows.
    commands
        Commands that make this figure alone.
    drawings
        Drawings of the figure.
    comparisons
        Statements in the paper, each with the value computed by solen.
    made
        Whether this run made the figure; figures finished earlier are kept.
    """

    name: str
    title: str
    commands: tuple[str, ...]
    drawings: tuple[Drawing, ...]
    comparisons: tuple[Comparison, ...]
    made: bool


class Reproduction(Result):
    """The figures of the paper, reproduced by solen.

    Attributes
    ----------
    figures
        The finished figures.
    not_made
        Names of the figures that are not finished.
    """

    figures: tuple[ReproducedFigure, ...]
    not_made: tuple[str, ...]

    def _count(self, verdict: Verdict) -> int:
        return sum(row.verdict == verdict for figure in self.figures for row in figure.comparisons)

    @reported
    def agrees(self) -> int:
        """Number of statements in the paper that agree with solen."""
        return self._count(AGREES)

    @reported
    def differs(self) -> int:
        """Number of statements in the paper that differ from solen."""
        return self._count(DIFFERS)

    @reported
    def cannot_be_checked(self) -> int:
        """Number of statements that depend on unpublished data."""
        return self._count(UNCHECKED)

    @reported
    def simulated(self) -> bool:
        """Always true, because nothing was measured."""
        return True

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Warnings for readers of the comparison."""
        return (
            note(
                "data that the paper does not publish were simulated; figures made from them "
                "are not evidence for its statements"
            ),
        )
