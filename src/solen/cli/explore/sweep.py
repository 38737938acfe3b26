"""The command that sweeps parameters of a design."""

from collections.abc import Iterator

from solen.cli.app import lines
from solen.explore.merits import table_merits
from solen.explore.swept import Sweep
from solen.pipeline.explore.sweep import sweep as sweep
from solen.report.design.summary import measured

MAX_ROWS = 40


@lines.register
def _(result: Sweep) -> Iterator[str]:
    how = (
        f"a grid of {' x '.join(map(str, result.shape))}"
        if result.is_grid
        else f"part {result.part}"
        if result.part
        else "samples"
    )
    failed = sum(result.failures.values())
    known = result.points * (1 + len(result.robust)) - result.traced - failed
    traced = f"{result.traced} traced, {known} known, {failed} failed"
    yield f"simulated: {result.name}, {result.points} points ({how}): {traced}"
    if result.robust:
        yield f"each as designed and with {len(result.robust)} deviations, of which the worst are in the file"
    heads = [*result.values, *table_merits(result.merits)]
    widths = [max(12, len(head)) for head in heads]
    yield "  ".join(f"{head:>{width}}" for head, width in zip(heads, widths, strict=True))
    for place in range(min(result.points, MAX_ROWS)):
        cells = [*(_value(values[place]) for values in result.values.values()), *_merits(result, place)]
        yield "  ".join(f"{cell:>{width}}" for cell, width in zip(cells, widths, strict=True))
    if result.points > MAX_ROWS:
        yield f"... {result.points - MAX_ROWS} more rows in the table"


def _value(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _merits(result: Sweep, place: int) -> Iterator[str]:
    for name in table_merits(result.merits):
        value, u = result.merits[name][place], result.merits[f"u_{name}"][place]
        yield measured(value, u, sign=False)
