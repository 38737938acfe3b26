"""The command that traces prints of a design whose parameters vary."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.explore.prints import VariedParameter, Yield
from solen.explore.tolerance import Tolerances
from solen.explore.variations import SPECIFIED
from solen.pipeline.explore.tolerance import tolerance as tolerance
from solen.report.design.summary import measured

MAX_CAUSES, MAX_UNKNOWN = 3, 0.5
"""Largest number of causes named per merit, and unexplained fraction of its variance above which none is named."""


@lines.register
def _(result: Tolerances) -> Iterator[str]:
    yield f"simulated: {result.name}, {result.prints} prints, seed {result.seed}, {result.traced} responses traced"
    yield from map(_yield, result.yields)
    yield f"varied, as deviations from the design{_sources(result)}:"
    yield from varied(result, costs=True)
    factor = result.varied[0].factor_together
    if factor is not None and factor < 1.0:
        yield f"  95 % yield requires scaling all deviations by {factor:.2g}"
    yield "merits of the design and of the prints, and the causes of their variance:"
    width = max(len(spread.merit) for spread in result.spreads)
    for spread in result.spreads:
        causes = sorted(spread.total.items(), key=lambda item: item[1], reverse=True)[:MAX_CAUSES]
        text = ", ".join(f"{key} {100 * fraction:.0f} %" for key, fraction in causes if fraction > 0.005)
        if spread.held_out > MAX_UNKNOWN:
            text = "causes not resolved"
        base = measured(spread.base, spread.u_base, sign=False)
        yield f"  {spread.merit:{width}}  {base}; prints {spread.mean:.4g}, SD {spread.sd:.2g}; {text or 'constant'}"


def varied(result: Tolerances, *, costs: bool) -> Iterator[str]:
    """Yield a line for each varied parameter, with ``costs`` also its effect on the yield."""
    width = max(len(row.key) for row in result.varied)
    for row in result.varied:
        value = "together" if row.value is None else f"{row.value:.6g}"
        cost = _cost(row) if costs else ""
        yield f"  {row.key:{width}}  {value:>9}  {_distribution(row)}{_source(row)}{cost}"


def _yield(row: Yield) -> str:
    text = f"{row.requirement or 'yield'}: {measured(100 * row.share, 100 * row.u_share, sign=False)} % as printed"
    if row.calibrated_share is not None and row.u_calibrated_share is not None:
        calibrated = measured(100 * row.calibrated_share, 100 * row.u_calibrated_share, sign=False)
        text += f", {calibrated} % after null and gain are calibrated"
    if row.adjusted_share is not None and row.u_adjusted_share is not None:
        text += f", {measured(100 * row.adjusted_share, 100 * row.u_adjusted_share, sign=False)} % after adjustment"
    return text


def _sources(result: Tolerances) -> str:
    """Return a note on the number of varied parameters whose deviation was not specified."""
    unspecified = sum(row.source != SPECIFIED for row in result.varied)
    return f" ({unspecified} not specified, their sources in brackets)" if unspecified else " (nothing else varies)"


def _source(row: VariedParameter) -> str:
    return "" if row.source == SPECIFIED else f" [{row.source}]"


def _distribution(row: VariedParameter) -> str:
    first, second = (value + 0.0 for value in row.deviation)  # converts −0 to 0
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
