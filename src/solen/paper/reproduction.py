"""The result of a reproduction: the finished figures, and how many statements in the paper agree."""

from solen.paper.records import Drawing
from solen.paper.statements import AGREES, DIFFERS, UNCHECKED, Comparison, Verdict
from solen.ranks import Caution, note
from solen.results import Result, reported


class ReproducedFigure(Result):
    """A figure of the paper as solen made it.

    Attributes
    ----------
    name, title
        Its name (``3B-D``), and what it shows.
    commands
        Commands that make this figure alone.
    drawings
        Pictures of the figure.
    comparisons
        Statements of the paper with solen's numbers.
    made
        Whether this run made it; a figure finished earlier is kept.
    """

    name: str
    title: str
    commands: tuple[str, ...]
    drawings: tuple[Drawing, ...]
    comparisons: tuple[Comparison, ...]
    made: bool


class Reproduction(Result):
    """The paper's figures from a run of solen.

    Attributes
    ----------
    figures
        The finished figures.
    not_made
        Names of the other figures.
    """

    figures: tuple[ReproducedFigure, ...]
    not_made: tuple[str, ...]

    def _count(self, verdict: Verdict) -> int:
        return sum(row.verdict == verdict for figure in self.figures for row in figure.comparisons)

    @reported
    def agrees(self) -> int:
        """Number of statements in the paper that agree."""
        return self._count(AGREES)

    @reported
    def differs(self) -> int:
        """Number of statements that differ."""
        return self._count(DIFFERS)

    @reported
    def cannot_be_checked(self) -> int:
        """Number of statements that rest on data that are not published."""
        return self._count(UNCHECKED)

    @reported
    def simulated(self) -> bool:
        """Always true, because nothing was measured."""
        return True

    @reported
    def warnings(self) -> tuple[Caution, ...]:
        """Warnings that a reader of the comparison needs to know."""
        return (
            note(
                "data that the paper does not publish were simulated; figures made from them "
                "are not evidence for its statements"
            ),
        )
