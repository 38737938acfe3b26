"""The command that traces prints of a design whose parameters vary."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.explore.prints import VariedParameter, Yield
from solen.explore.tolerance import Tolerances
from solen.explore.variations import SPECIFIED
from solen.pipeline.explore.tolerance import tolerance as tolerance
from solen.report.design.summary import measured

SHOWN, MAX_UNKNOWN = 3, 0.5
"""Number of parameters named per merit, and the unexplained fraction of its variance above which no causes are
named.
"""


@lines.register
def _(result: Tolerances) -> Iterator[str]:
    yield f"simulated: {result.name}, {result.prints} prints, seed {result.seed}, {result.traced} responses traced"
    for one in result.yields:
        yield _yield(one)
    yield f"varied, as deviations from the design{_sources(result)}:"
    yield from varied(result, costs=True)
    factor = result.varied[0].factor_together
    if factor is not None and factor < 1.0:
        yield f"  95 % yield requires scaling all deviations by {factor:.2g}"
    yield "merits over the prints, and what their variance is due to:"
    width = max(len(spread.merit) for spread in result.spreads)
    for merit in result.spreads:
        causes = sorted(merit.total.items(), key=lambda item: item[1], reverse=True)[:SHOWN]
        due = ", ".join(f"{key} {100 * share:.0f} %" for key, share in causes if share > 0.005)
        if merit.held_out > MAX_UNKNOWN:
            due = "causes not resolved"
        base = measured(merit.base, merit.u_base, sign=False)
        yield f"  {merit.merit:{width}}  {base}; prints {merit.mean:.4g}, SD {merit.sd:.2g}; {due or 'constant'}"


def varied(result: Tolerances, *, costs: bool) -> Iterator[str]:
    """Yield lines of the varied parameters, the costliest first, with the cost of each."""
    width = max(len(one.key) for one in result.varied)
    for row in result.varied:
        value = "together" if row.value is None else f"{row.value:.6g}"
        cost = _cost(row) if costs else ""
        yield f"  {row.key:{width}}  {value:>9}  {_distribution(row)}{_source(row)}{cost}"


def _yield(one: Yield) -> str:
    what = f"{one.requirement}: " if one.requirement else "yield: "
    as_printed = measured(100 * one.share, 100 * one.u_share, sign=False)
    text = f"{what}{as_printed} % as printed"
    if one.calibrated_share is not None and one.u_calibrated_share is not None:
        calibrated = measured(100 * one.calibrated_share, 100 * one.u_calibrated_share, sign=False)
        text += f", {calibrated} % after null and gain are calibrated"
    if one.adjusted_share is None or one.u_adjusted_share is None:
        return text
    return f"{text}, {measured(100 * one.adjusted_share, 100 * one.u_adjusted_share, sign=False)} % after adjustment"


def _sources(result: Tolerances) -> str:
    """Return a remark on the number of varied parameters whose deviation is assumed."""
    assumed = sum(row.source != SPECIFIED for row in result.varied)
    return f" ({assumed} not specified: see the source of each)" if assumed else " (nothing else varies)"


def _source(row: VariedParameter) -> str:
    return "" if row.source == SPECIFIED else f" [{row.source}]"


def _distribution(row: VariedParameter) -> str:
    first, second = (end + 0.0 for end in row.deviation)  # 0 for −0
    if row.distribution == "uniform":
        return f"uniform {first:+.3g} to {second:+.3g}"
    return f"normal {first:+.3g}, SD {second:.3g}" if first else f"normal, SD {second:.3g}"


def _cost(row: VariedParameter) -> str:
    if row.share_if_exact is None:
        return ""
    if row.factor_alone is None:
        alone = "reducing it alone does not give 95 %"
    else:
        alone = f"95 % if scaled by {row.factor_alone:.2g}" if row.factor_alone < 1.0 else "95 % without any change"
    return f"; yield {100 * row.share_if_exact:.0f} % if its deviation is 0; {alone}"
