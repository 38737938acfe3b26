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
    before, after = (measured(one.goal, one.u_goal, sign=False) for one in (result.before, result.after))
    yield from _printed(result)
    what = "worst over the deviations" if result.robust else "value"
    yield f"{what}: {before} before, {after} after ({result.claimed:.4g} in the search)"
    width = max(len(one.key) for one in result.free)
    for one in result.free:
        yield f"  {one.key:{width}}  {one.before:.6g} -> {one.after:.6g}  (free from {one.low:g} to {one.high:g})"
    for text, met in result.after.meets.items():
        yield f"  {'holds' if met else 'MISSED'}: {text}"
    worst = [f"{'after, at worst':>18}"] * result.robust
    names = table_merits(result.before.merits)
    width = max(18, *map(len, names))
    yield "  ".join([f"{'':{width}}", f"{'before':>18}", f"{'after':>18}", *worst])
    for name in names:
        worst = [f"{_merit(result.after, name, worst=True):>18}"] * result.robust
        yield "  ".join(
            [f"{name:{width}}", f"{_merit(result.before, name):>18}", f"{_merit(result.after, name):>18}", *worst]
        )
    if result.sampled_difference is None or result.u_sampled_difference is None:
        yield "before and after are traced again, by other samples at half the steps"
    else:
        by_samples = measured(result.sampled_difference, result.u_sampled_difference, sign=False)
        yield f"largest difference in contrast between sampling and integration: {by_samples}"
    if result.prints_before is not None and result.prints_after is not None:
        yield from _prints(result.prints_before, result.prints_after)


def _prints(before: Tolerances, after: Tolerances) -> Iterator[str]:
    """Yield the prints of both designs, side by side."""
    yield (
        f"{before.prints} prints of each, with the same deviations (solen explore tolerance shows the effect of each):"
    )
    yield from varied(before, costs=False)
    yield f"{'mean, SD of prints':18}  {'before':>22}  {'after':>22}"
    others = {spread.merit: spread for spread in after.spreads}
    for spread in before.spreads:
        texts = [f"{each.mean:.4g}, SD {each.sd:.2g}" if each else "" for each in (spread, others.get(spread.merit))]
        yield f"{spread.merit:18}  {texts[0]:>22}  {texts[1]:>22}"
    for old, new in zip(before.yields, after.yields, strict=True):
        shares = [f"{measured(100 * one.share, 100 * one.u_share, sign=False)} %" for one in (old, new)]
        yield f"yield {old.requirement or 'of all'}: {shares[0]} before, {shares[1]} after"


@lines.register
def _(result: Front) -> Iterator[str]:
    yield (
        f"simulated: {result.name}, {' and '.join(result.goals)}: {result.evaluations} designs, {result.traced} "
        f"responses traced, {len(result.designs)} on the front"
    )
    yield from _printed(result)
    what = "worst over the deviations:" if result.robust else "values:"
    yield f"{what:24}  {'   '.join(f'{goal:>28}' for goal in result.goals)}"
    yield f"{'before':>24}  {_goals(result.before)}"
    for design in result.designs:
        missed = [text for text, met in design.meets.items() if not met]
        yield f"{f'design {design.number}':>24}  {_goals(design)}{f'   MISSED: {missed}' if missed else ''}"
    for key, value in result.before.free.items():
        yield f"  {key:>22}  {value:.6g} -> {', '.join(f'{design.free[key]:.6g}' for design in result.designs)}"


def _goals(one: FrontDesign) -> str:
    values = (measured(goal, u, sign=False) for goal, u in zip(one.goals, one.u_goals, strict=True))
    return "   ".join(f"{value:>28}" for value in values)


def _printed(result: Optimum | Front) -> Iterator[str]:
    left = result.max_evaluations - result.evaluations
    if left and not result.interrupted:
        yield f"{left} of {result.max_evaluations} evaluations are left: CMA-ES tries whole generations of designs"
    if result.printed_by is not None:
        yield f"traced with the lens as printed by {result.printed_by}"


def _merit(judged: GoalResult, name: str, *, worst: bool = False) -> str:
    of = judged.worst if worst else judged.merits
    return measured(of[name], of[f"u_{name}"], sign=False)
