"""The command that searches for a better design."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.cli.explore.tolerance import varied
from solen.explore.merits import table_merits
from solen.explore.optimise import Front, FrontDesign, GoalResult, Optimum
from solen.explore.tolerance import Tolerances
from solen.pipeline.explore.optimise import optimise as optimise
from solen.report.design.summary import measured


@lines.register
def _(result: Optimum) -> Iterator[str]:
    yield f"simulated: {result.name}, {result.goal}: {result.evaluations} designs, {result.traced} responses traced"
    before, after = (measured(goal.goal, goal.u_goal, sign=False) for goal in (result.before, result.after))
    yield from _search_notes(result)
    what = "worst over the deviations" if result.robust else "value"
    yield f"{what}: {before} before, {after} after ({result.claimed:.4g} in the search)"
    width = max(len(row.key) for row in result.free)
    for row in result.free:
        yield f"  {row.key:{width}}  {row.before:.6g} -> {row.after:.6g}  (free from {row.low:g} to {row.high:g})"
    for text, met in result.after.meets.items():
        yield f"  {'met' if met else 'NOT MET'}: {text}"
    worst = [f"{'after, worst case':>18}"] * result.robust
    names = table_merits(result.before.merits)
    width = max(18, *map(len, names))
    yield "  ".join([f"{'':{width}}", f"{'before':>18}", f"{'after':>18}", *worst])
    for name in names:
        worst = [f"{_merit(result.after, name, worst=True):>18}"] * result.robust
        yield "  ".join(
            [f"{name:{width}}", f"{_merit(result.before, name):>18}", f"{_merit(result.after, name):>18}", *worst]
        )
    if result.sampled_difference is None or result.u_sampled_difference is None:
        yield "both designs were traced again, with other samples and half the steps"
    else:
        difference = measured(result.sampled_difference, result.u_sampled_difference, sign=False)
        yield f"largest difference in contrast between sampling and integration: {difference}"
    if result.prints_before is not None and result.prints_after is not None:
        yield from _prints(result.prints_before, result.prints_after)


def _prints(before: Tolerances, after: Tolerances) -> Iterator[str]:
    """Yield lines that compare the prints of both designs."""
    yield (
        f"{before.prints} prints of each design, with the same deviations (solen explore tolerance shows the effect of "
        "each deviation):"
    )
    yield from varied(before, costs=False)
    yield f"{'mean, SD of prints':18}  {'before':>22}  {'after':>22}"
    after_spreads = {spread.merit: spread for spread in after.spreads}
    for old in before.spreads:
        new = after_spreads.get(old.merit)
        texts = [f"{spread.mean:.4g}, SD {spread.sd:.2g}" if spread else "" for spread in (old, new)]
        yield f"{old.merit:18}  {texts[0]:>22}  {texts[1]:>22}"
    for yields in zip(before.yields, after.yields, strict=True):
        texts = [f"{measured(100 * each.share, 100 * each.u_share, sign=False)} %" for each in yields]
        yield f"yield {yields[0].requirement or 'for all requirements'}: {texts[0]} before, {texts[1]} after"


@lines.register
def _(result: Front) -> Iterator[str]:
    yield (
        f"simulated: {result.name}, {' and '.join(result.goals)}: {result.evaluations} designs, {result.traced} "
        f"responses traced, {len(result.designs)} on the front"
    )
    yield from _search_notes(result)
    what = "worst over the deviations:" if result.robust else "values:"
    yield f"{what:24}  {'   '.join(f'{goal:>28}' for goal in result.goals)}"
    yield f"{'before':>24}  {_goals(result.before)}"
    for design in result.designs:
        missed = ", ".join(text for text, met in design.meets.items() if not met)
        yield f"{f'design {design.number}':>24}  {_goals(design)}{f'   NOT MET: {missed}' if missed else ''}"
    for key, value in result.before.free.items():
        yield f"  {key:>22}  {value:.6g} -> {', '.join(f'{design.free[key]:.6g}' for design in result.designs)}"


def _goals(design: FrontDesign) -> str:
    values = (measured(goal, u, sign=False) for goal, u in zip(design.goals, design.u_goals, strict=True))
    return "   ".join(f"{value:>28}" for value in values)


def _search_notes(result: Optimum | Front) -> Iterator[str]:
    unused = result.max_evaluations - result.evaluations
    if unused and not result.interrupted:
        yield f"{unused} of {result.max_evaluations} evaluations are unused: CMA-ES evaluates only complete generations"
    if result.printed_by is not None:
        yield f"traced with the lens as printed by {result.printed_by}"


def _merit(result: GoalResult, name: str, *, worst: bool = False) -> str:
    merits = result.worst if worst else result.merits
    return measured(merits[name], merits[f"u_{name}"], sign=False)
